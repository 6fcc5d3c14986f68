//! Wavefront OBJ: polygons with object and material names. Our own reader, because errors must
//! name line and column, and because quadrilaterals must stay quadrilaterals.

use super::super::source::{MAX_OBJ_BYTES, Source, Sources};
use super::dress::{Described, dress};
use super::mesh::{Corner, Model, NO_NORMAL, Part, Place, Polygons, error_at};
use super::{mtl, note};
use crate::error::{Error, Result};
use glam::DVec3;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::Path;

/// More corners than this no polygon has.
const MOST_CORNERS: usize = 2048;

/// Reads the OBJ file `path` and the MTL files it names.
pub fn read(path: &Path, sources: &mut Sources) -> Result<Model> {
    let source = Source::read(path, MAX_OBJ_BYTES)?;
    let (mut model, libraries) = Parser::new(path).parse(&source.text)?;
    drop(source);
    let mut described: Vec<Described> = Vec::new();
    let (mut known, mut names) = (HashSet::new(), HashSet::new());
    model.with_defaults = !libraries.is_empty();
    for library in libraries {
        let Some(file) = library.candidates.iter().map(|name| super::beside(path, name)).find(|f| f.exists())
        else {
            let names = library.candidates.first().cloned().unwrap_or_default();
            model.note(format_args!("there is no material file {names}: materials it would define are grey"));
            continue;
        };
        if !known.insert(file.clone()) {
            continue;
        }
        let (defined, notes) = match mtl::read(&file, sources) {
            Ok(read) => read,
            Err(Error::Io { message, .. }) => {
                return Err(model.error(library.place, format!("cannot read {}: {message}", file.display())));
            }
            Err(other) => return Err(other),
        };
        model.notes.extend(notes);
        for mtl::Defined { name, look, place } in defined {
            if names.insert(name.clone()) {
                described.push(Described { name, look, place, file: file.clone() });
            }
        }
    }
    let bright: Vec<String> =
        described.iter().filter(|d| d.look.emission != [0.0; 3]).map(|d| d.name.clone()).collect();
    if !bright.is_empty() {
        model.note(format_args!("Ke has no unit in MTL and is taken for cd/m2: {}", note::names(&bright)));
    }
    dress(&mut model, described);
    Ok(model)
}

/// A `mtllib` record.
struct Library {
    place: Place,
    /// The names it may mean: the rest of the line as one, and each word of it.
    candidates: Vec<String>,
}

struct Parser {
    model: Model,
    polygons: Polygons,
    libraries: Vec<Library>,
    object: Option<String>,
    material: Option<String>,
    normals: Normals,
    known_parts: HashMap<(Option<String>, Option<String>), u32>,
    last_part: Option<u32>,
    ignored: BTreeSet<String>,
}

/// The `vn` records: equal ones share a number.
#[derive(Default)]
struct Normals {
    number: Vec<u32>,
    known: HashMap<[u64; 3], u32>,
}

/// A word of the text, and where its record is.
#[derive(Clone, Copy)]
struct Word<'a> {
    text: &'a str,
    line: &'a str,
    number: u32,
}

impl Word<'_> {
    fn place(&self) -> Place {
        // Words are slices of the line, so their distance is their byte position.
        let bytes = self.text.as_ptr() as usize - self.line.as_ptr() as usize;
        Place { line: self.number, column: self.line[..bytes].chars().count() as u32 + 1 }
    }
}

impl Parser {
    fn new(path: &Path) -> Parser {
        Parser {
            model: Model::new(path),
            polygons: Polygons::default(),
            libraries: Vec::new(),
            object: None,
            material: None,
            normals: Normals::default(),
            known_parts: HashMap::new(),
            last_part: None,
            ignored: BTreeSet::new(),
        }
    }

    fn parse(mut self, text: &str) -> Result<(Model, Vec<Library>)> {
        let mut words: Vec<Word> = Vec::new();
        let mut corners: Vec<Corner> = Vec::new();
        let mut lines = text.lines().zip(1..);
        while let Some((mut line, mut number)) = lines.next() {
            words.clear();
            // A backslash at its end continues a line.
            loop {
                let content = line.split('#').next().unwrap_or("");
                let on = content.trim_end().strip_suffix('\\');
                let add = |text| Word { text, line, number };
                words.extend(on.unwrap_or(content).split_whitespace().map(add));
                match on.and_then(|_| lines.next()) {
                    Some(next) => (line, number) = next,
                    None => break,
                }
            }
            if let Some((keyword, words)) = words.split_first() {
                self.record(*keyword, words, &mut corners)?;
            }
        }
        self.finish()
    }

    fn record(&mut self, keyword: Word, words: &[Word], corners: &mut Vec<Corner>) -> Result<()> {
        match keyword.text {
            "v" => {
                let vertex = self.vector(keyword, words)?;
                self.model.vertices.push(vertex);
            }
            "vn" => {
                let normal = self.vector(keyword, words)?;
                let next = self.normals.known.len() as u32;
                let bits = (normal + 0.0).to_array().map(f64::to_bits);
                self.normals.number.push(*self.normals.known.entry(bits).or_insert(next));
            }
            "f" => self.face(keyword, words, corners)?,
            "o" | "g" => (self.object, self.last_part) = (name(words), None),
            "usemtl" => (self.material, self.last_part) = (name(words), None),
            "mtllib" => {
                let each = words.iter().map(|w| w.text.to_owned());
                let candidates = name(words).into_iter().chain(each).collect();
                self.libraries.push(Library { place: keyword.place(), candidates });
            }
            // Textures have their mean colour everywhere, and what is smooth is said by normals.
            "vt" | "s" => {}
            other => {
                if self.ignored.len() < 16 {
                    self.ignored.insert(other.chars().take(32).collect());
                }
            }
        }
        Ok(())
    }

    fn vector(&self, keyword: Word, words: &[Word]) -> Result<DVec3> {
        let mut xyz = [0.0; 3];
        for (i, x) in xyz.iter_mut().enumerate() {
            let word = words.get(i).ok_or_else(|| {
                let what = if keyword.text == "v" { "a vertex" } else { "a normal" };
                self.error(keyword.place(), format!("{what} has three coordinates"))
            })?;
            *x = word
                .text
                .parse()
                .map_err(|_| self.error(word.place(), format!("\"{}\" is not a number", word.text)))?;
        }
        Ok(DVec3::from_array(xyz))
    }

    fn face(&mut self, keyword: Word, words: &[Word], corners: &mut Vec<Corner>) -> Result<()> {
        corners.clear();
        for word in words {
            let corner = self.corner(word.text).map_err(|message| self.error(word.place(), message))?;
            corners.push(corner);
        }
        let count = corners.len();
        if !(3..=MOST_CORNERS).contains(&count) {
            let message = format!("a face has three to {MOST_CORNERS} corners, this has {count}");
            return Err(self.error(keyword.place(), message));
        }
        let place = keyword.place();
        let part = match self.last_part {
            Some(part) => part,
            None => self.part(place),
        };
        self.polygons.push(corners, &self.model.vertices, part, place);
        Ok(())
    }

    /// The corner that `word` (v, v/vt, v//vn or v/vt/vn) names: numbers from 1, or back from the last.
    fn corner(&self, word: &str) -> std::result::Result<Corner, String> {
        let mut numbers = word.split('/');
        let vertex = index(numbers.next().unwrap_or(""), word, "vertex", self.model.vertices.len())?;
        let normal = match numbers.nth(1) {
            None | Some("") => NO_NORMAL,
            Some(text) => {
                let normal = index(text, word, "normal", self.normals.number.len())?;
                self.normals.number[normal as usize]
            }
        };
        Ok(Corner { vertex, normal })
    }

    fn part(&mut self, place: Place) -> u32 {
        let key = (self.object.clone(), self.material.clone());
        let part = *self.known_parts.entry(key).or_insert_with_key(|(object, material)| {
            self.model.parts.push(Part { object: object.clone(), material: material.clone(), place });
            self.model.parts.len() as u32 - 1
        });
        self.last_part = Some(part);
        part
    }

    fn finish(mut self) -> Result<(Model, Vec<Library>)> {
        let made = self.polygons.finish(&self.model.vertices);
        self.model.take(made);
        if !self.ignored.is_empty() {
            let list: Vec<&str> = self.ignored.iter().map(String::as_str).collect();
            self.model.note(format_args!("ignored the records {}", list.join(", ")));
        }
        Ok((self.model, self.libraries))
    }

    fn error(&self, place: Place, message: impl Into<String>) -> Error {
        error_at(&self.model.path, place, message)
    }
}

/// The index, from 0, that `text` in `word` means where `known` things of the kind `what` are known.
fn index(text: &str, word: &str, what: &str, known: usize) -> std::result::Result<u32, String> {
    let index: i64 = text.parse().map_err(|_| format!("\"{word}\" is not a {what} index"))?;
    let known = known as i64;
    let found = if index < 0 { known.checked_add(index) } else { index.checked_sub(1) };
    match found {
        Some(v) if (0..known.min(i64::from(u32::MAX))).contains(&v) => Ok(v as u32),
        _ => Err(format!("{what} {index} does not exist: {known} are known up to here")),
    }
}

/// The rest of the line as one name.
fn name(words: &[Word]) -> Option<String> {
    let words: Vec<&str> = words.iter().map(|w| w.text).collect();
    (!words.is_empty()).then(|| words.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Model> {
        Parser::new(Path::new("t.obj")).parse(text).map(|(model, _)| model)
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\n";

    #[test]
    fn every_form_of_index_names_the_same_vertex() {
        let text =
            format!("{SQUARE}f 1 2/7 3//1 4/1/-1\nf -4 -3 \\ # and on\n -2 -1\no box\nusemtl red\nf 1 2 3\n");
        let model = parse(&text).expect("parses");
        assert_eq!(model.faces[0].corners, [0, 1, 2, 3]);
        assert_eq!(model.faces[1].corners, [0, 1, 2, 3]);
        assert_eq!((model.faces[2].count, model.faces[2].corners), (3, [0, 1, 2, 2]));
        assert_eq!(model.parts.len(), 2);
        assert_eq!(model.parts[1].object.as_deref(), Some("box"));
        assert_eq!(model.parts[1].material.as_deref(), Some("red"));
    }

    #[test]
    fn errors_name_line_and_column() {
        for (text, line, column, word) in [
            ("f 1 2 9\n".to_owned(), 6, 7, "vertex 9"),
            ("f 1 2 0\n".to_owned(), 6, 7, "vertex 0"),
            ("f 1 -9 2\n".to_owned(), 6, 5, "vertex -9"),
            ("f 1 2 3//2\n".to_owned(), 6, 7, "normal 2"),
            ("f 1 2 3//x\n".to_owned(), 6, 7, "normal index"),
            ("f 1 2 \\\n 9\n".to_owned(), 7, 2, "vertex 9"),
            (" f 1 2\n".to_owned(), 6, 2, "three to"),
            ("v 1 2\n".to_owned(), 6, 1, "three coordinates"),
            ("v 1 é 2\n".to_owned(), 6, 5, "not a number"),
            ("f 1 2 9223372036854775808\n".to_owned(), 6, 7, "not a vertex index"),
        ] {
            match parse(&format!("{SQUARE}{text}")) {
                Err(Error::Scene { line: l, column: c, message, .. }) => {
                    assert_eq!((l, c), (line, column), "{text}: {message}");
                    assert!(message.contains(word), "{message}");
                }
                other => panic!("{text}: {other:?}"),
            }
        }
    }

    #[test]
    fn what_is_ignored_is_said_once() {
        let model = parse(&format!("l 1 2\ncurv 1\ncurv 2\n{SQUARE}f 1 2 3\n")).expect("parses");
        assert_eq!(model.notes.len(), 1);
        assert!(model.notes[0].ends_with("curv, l"), "{}", model.notes[0]);
    }

    #[test]
    fn polygons_are_split_and_normals_join() {
        let roof = "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 2 2 0\nv 0 2 0\nv 0 0 -1\nv 2 0 -1\nvn 0 0 1\nvn 0 -1 0\n";
        let model = parse(&format!("{roof}f 1 2 3 4 5\n")).expect("parses");
        assert_eq!(model.faces.iter().map(|f| usize::from(f.count) - 2).sum::<usize>(), 3);
        assert!(model.notes.iter().any(|n| n.contains("more than four corners")), "{:?}", model.notes);
        let patches = |normals: [usize; 2]| {
            let [a, b] = normals;
            let text = format!("{roof}f 1//{a} 2//{a} 4//1 5//1\nf 6//2 7//2 2//{b} 1//{b}\n");
            let model = parse(&text).expect("parses");
            model.faces.iter().map(|f| f.patch).collect::<Vec<_>>()
        };
        assert_eq!(patches([1, 1]), [0, 0], "one normal at both ends of the edge");
        assert_eq!(patches([1, 2]), [0, 1], "an edge");
    }
}

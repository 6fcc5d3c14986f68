//! Wavefront OBJ: polygons with object and material names. Our own reader, because errors must
//! name line and column, and because quadrilaterals must stay quadrilaterals.

use super::source::{MAX_OBJ_BYTES, Source};
use crate::error::{Error, Result};
use glam::DVec3;
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

/// The polygons of an OBJ file.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// The file.
    pub path: PathBuf,
    /// `v` records, in the units of the file.
    pub vertices: Vec<DVec3>,
    /// `f` records.
    pub faces: Vec<Face>,
    /// What the faces belong to.
    pub parts: Vec<Part>,
    /// What was ignored, one sentence each.
    pub notes: Vec<String>,
}

/// A triangle or quadrilateral.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Vertices; a triangle's last is repeated.
    pub corners: [u32; 4],
    /// 3 or 4.
    pub count: u8,
    /// Index into [`Mesh::parts`].
    pub part: u32,
    /// Where it is written.
    pub place: Place,
}

/// All faces of one object that wear one material.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// The last `o` or `g` before them.
    pub object: Option<String>,
    /// The last `usemtl` before them.
    pub material: Option<String>,
    /// The first face of the part.
    pub place: Place,
}

/// Line and column in the file, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    /// Line.
    pub line: u32,
    /// Column in characters.
    pub column: u32,
}

impl Mesh {
    /// Reads the OBJ file `path`.
    pub fn read(path: &Path) -> Result<Mesh> {
        let source = Source::read(path, MAX_OBJ_BYTES)?;
        Parser::new(path).parse(&source.text)
    }

    /// The error `message` at `place`.
    pub fn error(&self, place: Place, message: impl Into<String>) -> Error {
        error_at(&self.path, place, message)
    }
}

fn error_at(path: &Path, place: Place, message: impl Into<String>) -> Error {
    Error::Scene {
        path: path.to_path_buf(),
        line: place.line as usize,
        column: place.column as usize,
        message: message.into(),
    }
}

struct Parser {
    mesh: Mesh,
    object: Option<String>,
    material: Option<String>,
    known_parts: HashMap<(Option<String>, Option<String>), u32>,
    ignored: BTreeSet<String>,
}

impl Parser {
    fn new(path: &Path) -> Parser {
        let mesh = Mesh {
            path: path.to_path_buf(),
            vertices: Vec::new(),
            faces: Vec::new(),
            parts: Vec::new(),
            notes: Vec::new(),
        };
        Parser { mesh, object: None, material: None, known_parts: HashMap::new(), ignored: BTreeSet::new() }
    }

    fn parse(mut self, text: &str) -> Result<Mesh> {
        for (i, line) in text.lines().enumerate() {
            let content = line.split('#').next().unwrap_or("");
            let mut words = content.split_whitespace();
            let Some(keyword) = words.next() else { continue };
            let place = |word: &str| Place {
                line: i as u32 + 1,
                // Words are slices of the line, so their distance is their byte position.
                column: line[..word.as_ptr() as usize - line.as_ptr() as usize].chars().count() as u32 + 1,
            };
            match keyword {
                "v" => {
                    let vertex = self.vertex(words, place(keyword), place)?;
                    self.mesh.vertices.push(vertex);
                }
                "f" => self.face(words, place(keyword), place)?,
                "o" | "g" => self.object = name(words),
                "usemtl" => self.material = name(words),
                // Normals and texture coordinates have no use here: facets are what light meets.
                "vn" | "vt" => {}
                _ => {
                    if self.ignored.len() < 16 {
                        self.ignored.insert(keyword.chars().take(32).collect());
                    }
                }
            }
        }
        if !self.ignored.is_empty() {
            let list: Vec<&str> = self.ignored.iter().map(String::as_str).collect();
            let note = format!("{}: ignored the records {}", self.mesh.path.display(), list.join(", "));
            self.mesh.notes.push(note);
        }
        Ok(self.mesh)
    }

    fn vertex<'a>(
        &self,
        mut words: impl Iterator<Item = &'a str>,
        at: Place,
        place: impl Fn(&str) -> Place,
    ) -> Result<DVec3> {
        let mut xyz = [0.0; 3];
        for x in &mut xyz {
            let word = words.next().ok_or_else(|| self.error(at, "a vertex has three coordinates"))?;
            *x = word.parse().map_err(|_| self.error(place(word), format!("\"{word}\" is not a number")))?;
        }
        Ok(DVec3::from_array(xyz))
    }

    fn face<'a>(
        &mut self,
        words: impl Iterator<Item = &'a str>,
        at: Place,
        place: impl Fn(&str) -> Place,
    ) -> Result<()> {
        let mut corners = [0; 4];
        let mut count = 0;
        for word in words {
            if count == 4 {
                let message = "a face with more than four corners; split it into triangles or quadrilaterals";
                return Err(self.error(at, message));
            }
            corners[count] = self.index(word).map_err(|message| self.error(place(word), message))?;
            count += 1;
        }
        if count < 3 {
            return Err(self.error(at, format!("a face has at least three corners, this has {count}")));
        }
        if count == 3 {
            corners[3] = corners[2];
        }
        let part = self.part(at);
        self.mesh.faces.push(Face { corners, count: count as u8, part, place: at });
        Ok(())
    }

    /// The vertex that `word` (v, v/vt, v//vn or v/vt/vn) names: from 1, or back from the last.
    fn index(&self, word: &str) -> std::result::Result<u32, String> {
        let first = word.split('/').next().unwrap_or("");
        let index: i64 = first.parse().map_err(|_| format!("\"{word}\" is not a vertex index"))?;
        let known = self.mesh.vertices.len() as i64;
        let vertex = if index < 0 { known.checked_add(index) } else { index.checked_sub(1) };
        match vertex {
            Some(v) if (0..known.min(i64::from(u32::MAX))).contains(&v) => Ok(v as u32),
            _ => Err(format!("vertex {index} does not exist: {known} are known up to here")),
        }
    }

    fn part(&mut self, place: Place) -> u32 {
        let key = (self.object.clone(), self.material.clone());
        *self.known_parts.entry(key).or_insert_with_key(|(object, material)| {
            self.mesh.parts.push(Part { object: object.clone(), material: material.clone(), place });
            self.mesh.parts.len() as u32 - 1
        })
    }

    fn error(&self, place: Place, message: impl Into<String>) -> Error {
        error_at(&self.mesh.path, place, message)
    }
}

/// The rest of the line as one name.
fn name<'a>(words: impl Iterator<Item = &'a str>) -> Option<String> {
    let name = words.collect::<Vec<_>>().join(" ");
    (!name.is_empty()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Mesh> {
        Parser::new(Path::new("t.obj")).parse(text)
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn every_form_of_index_names_the_same_vertex() {
        let text = format!("{SQUARE}f 1 2/7 3//5 4/1/2\nf -4 -3 -2 -1\no box\nusemtl red\nf 1 2 3\n");
        let mesh = parse(&text).expect("parses");
        assert_eq!(mesh.faces[0].corners, [0, 1, 2, 3]);
        assert_eq!(mesh.faces[1].corners, [0, 1, 2, 3]);
        assert_eq!((mesh.faces[2].count, mesh.faces[2].corners), (3, [0, 1, 2, 2]));
        assert_eq!(mesh.parts.len(), 2);
        assert_eq!(mesh.parts[1].object.as_deref(), Some("box"));
        assert_eq!(mesh.parts[1].material.as_deref(), Some("red"));
    }

    #[test]
    fn errors_name_line_and_column() {
        for (text, line, column, word) in [
            ("f 1 2 9\n".to_owned(), 5, 7, "vertex 9"),
            ("f 1 2 0\n".to_owned(), 5, 7, "vertex 0"),
            ("f 1 -9 2\n".to_owned(), 5, 5, "vertex -9"),
            ("f 1 2 3 4 1\n".to_owned(), 5, 1, "split"),
            (" f 1 2\n".to_owned(), 5, 2, "three corners"),
            ("v 1 2\n".to_owned(), 5, 1, "three coordinates"),
            ("v 1 é 2\n".to_owned(), 5, 5, "not a number"),
            ("f 1 2 9223372036854775808\n".to_owned(), 5, 7, "not a vertex index"),
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
        let mesh = parse(&format!("mtllib a.mtl\ns 1\ns off\n{SQUARE}vn 0 0 1\nf 1 2 3\n")).expect("parses");
        assert_eq!(mesh.notes.len(), 1);
        assert!(mesh.notes[0].ends_with("mtllib, s"), "{}", mesh.notes[0]);
    }
}

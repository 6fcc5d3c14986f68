//! Materials of Wavefront OBJ files: MTL.

use super::super::source::{MAX_OBJ_BYTES, Source, Sources};
use super::look::{Body, Look, PLAIN, Rgb, beckmann_of_exponent};
use super::note;
use super::texture;
use crate::error::Result;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

/// A material of an MTL file.
pub struct Defined {
    /// Its name.
    pub name: String,
    /// What it looks like.
    pub look: Look,
    /// Where it is written, a position in the sources.
    pub place: usize,
}

/// The index of glass where none is given.
const GLASS: f64 = 1.5;
/// The largest luminance, cd/m², and the largest exponent: more is a slip.
const MOST: f64 = 1e12;

/// What the statements of a material say.
#[derive(Default)]
struct Statements {
    kd: Option<Rgb>,
    ks: Option<Rgb>,
    ke: Option<Rgb>,
    tf: Option<Rgb>,
    ns: Option<f64>,
    ni: Option<f64>,
    d: Option<f64>,
    tr: Option<f64>,
    illum: Option<f64>,
    map_kd: Option<PathBuf>,
    map_ke: Option<PathBuf>,
}

/// What is said once at the end, with the names of the materials.
#[derive(Default)]
struct Asides {
    kinds: BTreeMap<&'static str, Vec<String>>,
    ignored: BTreeSet<String>,
    unreadable: BTreeSet<String>,
}

/// Reads the materials of the MTL file `path`, and what there is to say about them.
pub fn read(path: &Path, sources: &mut Sources) -> Result<(Vec<Defined>, Vec<String>)> {
    let source = Source::read(path, MAX_OBJ_BYTES)?;
    let text = source.text.clone();
    let base = sources.add(source);
    Parser { path, text: &text, base, sources, asides: Asides::default(), numbers: HashMap::new() }.parse()
}

struct Parser<'a> {
    path: &'a Path,
    text: &'a str,
    base: usize,
    sources: &'a Sources,
    asides: Asides,
    /// By name: which of the materials it is.
    numbers: HashMap<String, usize>,
}

impl<'a> Parser<'a> {
    fn parse(mut self) -> Result<(Vec<Defined>, Vec<String>)> {
        let mut defined: Vec<Defined> = Vec::new();
        let mut current: Option<(String, usize, Statements)> = None;
        for line in self.text.lines() {
            let content = line.split('#').next().unwrap_or("").trim();
            let Some(keyword) = content.split_whitespace().next() else { continue };
            let rest = content[keyword.len()..].trim();
            let place = self.place(keyword);
            if keyword == "newmtl" {
                if rest.is_empty() {
                    return Err(self.sources.error(place, "a material has a name; write it after newmtl"));
                }
                self.define(&mut defined, current.take());
                current = Some((rest.to_owned(), place, Statements::default()));
                continue;
            }
            let Some((name, _, statements)) = &mut current else {
                return Err(self
                    .sources
                    .error(place, "a statement before any newmtl; name the material first"));
            };
            let name = name.clone();
            self.statement(statements, &name, keyword, rest)?;
        }
        self.define(&mut defined, current.take());
        let notes = self.notes();
        Ok((defined, notes))
    }

    /// The position of a word of the text in the sources.
    fn place(&self, word: &str) -> usize {
        self.base + (word.as_ptr() as usize - self.text.as_ptr() as usize)
    }

    fn statement(
        &mut self,
        statements: &mut Statements,
        name: &str,
        keyword: &'a str,
        rest: &'a str,
    ) -> Result<()> {
        match keyword {
            "Kd" => statements.kd = self.colour(keyword, rest, name, 1.0)?,
            "Ks" => statements.ks = self.colour(keyword, rest, name, 1.0)?,
            "Tf" => statements.tf = self.colour(keyword, rest, name, 1.0)?,
            "Ke" => statements.ke = self.colour(keyword, rest, name, MOST)?,
            "Ns" => statements.ns = Some(self.number(keyword, rest)?.min(MOST)),
            "Ni" => statements.ni = Some(self.number(keyword, rest)?.clamp(1.0, 10.0)),
            "d" => statements.d = Some(self.number(keyword, rest.trim_start_matches("-halo"))?),
            "Tr" => statements.tr = Some(self.number(keyword, rest)?),
            "illum" => statements.illum = Some(self.number(keyword, rest)?),
            "map_Kd" => statements.map_kd = Some(self.file(rest)),
            "map_Ke" => statements.map_ke = Some(self.file(rest)),
            // Ambient light is what is computed here.
            "Ka" | "map_Ka" => {}
            _ => {
                if self.asides.ignored.len() < 16 {
                    self.asides.ignored.insert(keyword.chars().take(32).collect());
                }
            }
        }
        Ok(())
    }

    /// The first number of `rest`, finite and not negative.
    fn number(&self, keyword: &str, rest: &str) -> Result<f64> {
        let word = rest.split_whitespace().next();
        match word.map(str::parse::<f64>) {
            Some(Ok(x)) if x >= 0.0 && x.is_finite() => Ok(x),
            _ => {
                let place = self.place(word.unwrap_or(keyword));
                let message = format!("{keyword} is followed by a finite number that is not negative");
                Err(self.sources.error(place, message))
            }
        }
    }

    /// Three numbers, or one for all three; above `most` they are held to it. `None` for other kinds of colours.
    fn colour(&mut self, keyword: &'a str, rest: &'a str, name: &str, most: f64) -> Result<Option<Rgb>> {
        let words: Vec<&str> = rest.split_whitespace().collect();
        if matches!(words.first(), Some(&("spectral" | "xyz"))) {
            self.asides.add("a colour as `spectral` or `xyz` is not read", name);
            return Ok(None);
        }
        let mut rgb = [self.number(keyword, rest)?; 3];
        for (x, word) in rgb.iter_mut().zip(&words) {
            *x = self.number(keyword, &rest[word.as_ptr() as usize - rest.as_ptr() as usize..])?;
        }
        if rgb.iter().any(|x| *x > most) {
            self.asides.add("a reflectance or filter above 1 is held to 1", name);
        }
        Ok(Some(rgb.map(|x| x.min(most))))
    }

    /// The file that a map statement names, after its options.
    fn file(&self, rest: &str) -> PathBuf {
        let mut words = rest;
        while words.starts_with('-') {
            let end = words.find(char::is_whitespace).unwrap_or(words.len());
            words = words[end..].trim_start();
            while let Some(word) = words.split_whitespace().next()
                && (word.parse::<f64>().is_ok() || matches!(word, "on" | "off"))
                && word.len() < words.len()
            {
                words = words[word.len()..].trim_start();
            }
        }
        super::beside(self.path, words)
    }

    fn define(&mut self, defined: &mut Vec<Defined>, material: Option<(String, usize, Statements)>) {
        let Some((name, place, statements)) = material else { return };
        let look = self.look(&name, statements);
        match self.numbers.entry(name.clone()) {
            Entry::Occupied(known) => {
                self.asides.add("defined twice, the last time counts", &name);
                defined[*known.get()] = Defined { name, look, place };
            }
            Entry::Vacant(new) => {
                new.insert(defined.len());
                defined.push(Defined { name, look, place });
            }
        }
    }

    /// The mean colour of a texture times `factor`.
    fn textured(&mut self, name: &str, map: Option<&PathBuf>, factor: Option<Rgb>) -> Option<Rgb> {
        let Some(path) = map else { return factor };
        match super::read_bytes(path, texture::MAX_IMAGE_BYTES).and_then(|bytes| texture::mean(&bytes)) {
            Ok(mean) => {
                self.asides.add("a texture is replaced by its mean colour", name);
                // Some programs write black for what the texture says all of.
                let factor = factor.filter(|f| *f != [0.0; 3]).unwrap_or([1.0; 3]);
                Some([0, 1, 2].map(|c| factor[c] * mean.colour[c]))
            }
            Err(why) => {
                if self.asides.unreadable.len() < 16 {
                    self.asides.unreadable.insert(format!("{} ({why})", path.display()));
                }
                factor
            }
        }
    }

    fn look(&mut self, name: &str, statements: Statements) -> Look {
        let kd = self.textured(name, statements.map_kd.as_ref(), statements.kd);
        let ke = self.textured(name, statements.map_ke.as_ref(), statements.ke);
        let emission = ke.unwrap_or([0.0; 3]);
        let ks = statements.ks.unwrap_or([0.0; 3]);
        let illum = statements.illum.map_or(2, |i| i as u32);
        let opacity = statements.d.or(statements.tr.map(|t| 1.0 - t)).unwrap_or(1.0);
        let filter = statements.tf.unwrap_or([1.0; 3]);
        let glass = matches!(illum, 4 | 6 | 7 | 9);
        if glass || opacity < 0.5 {
            if !glass {
                self.asides.add("taken for glass because d is below 0.5", name);
            }
            // Without glass in mind programs write an index of 1.
            let index = statements.ni.filter(|n| glass || *n > 1.0).unwrap_or(GLASS);
            let body = Body::Glass { index, filter, over: None };
            return Look { body, emission, two_sided: false };
        }
        if opacity < 1.0 {
            self.asides.add("taken as opaque though d says it is partly transparent", name);
        }
        let specular = if illum < 2 { [0.0; 3] } else { ks };
        let mirror = matches!(illum, 3 | 5 | 8);
        let m = if mirror { 0.0 } else { beckmann_of_exponent(statements.ns.unwrap_or(0.0)) };
        let nothing = specular == [0.0; 3] && emission == [0.0; 3];
        let diffuse = kd.unwrap_or(if nothing { [PLAIN; 3] } else { [0.0; 3] });
        let body = Body::Opaque { diffuse, specular, index: None, m };
        Look { body, emission, two_sided: false }
    }

    fn notes(self) -> Vec<String> {
        let file = self.path.display();
        let mut notes: Vec<String> = Vec::new();
        for (what, names) in &self.asides.kinds {
            notes.push(format!("{file}: {what}: {}", note::names(names)));
        }
        if !self.asides.unreadable.is_empty() {
            let files: Vec<String> = self.asides.unreadable.iter().cloned().collect();
            notes.push(format!("{file}: textures that cannot be read are left out: {}", note::names(&files)));
        }
        if !self.asides.ignored.is_empty() {
            let list: Vec<String> = self.asides.ignored.iter().cloned().collect();
            notes.push(format!("{file}: ignored the statements {}", list.join(", ")));
        }
        notes
    }
}

impl Asides {
    fn add(&mut self, what: &'static str, name: &str) {
        let names = self.kinds.entry(what).or_default();
        if names.last().is_none_or(|last| last != name) {
            names.push(name.to_owned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    fn parse(text: &str) -> Result<(Vec<Defined>, Vec<String>)> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.mtl");
        std::fs::write(&path, text).expect("written");
        read(&path, &mut Sources::default())
    }

    fn look(statements: &str) -> Look {
        parse(&format!("newmtl a\n{statements}\n")).expect("parses").0.remove(0).look
    }

    #[test]
    fn statements_become_physics() {
        let opaque = |diffuse, specular, m| Body::Opaque { diffuse, specular, index: None, m };
        let glass = |index, filter| Body::Glass { index, filter, over: None };
        let rough = beckmann_of_exponent(48.0);
        assert!((rough - 0.2).abs() < 1e-15);
        for (statements, body) in [
            ("Kd 0.5 0.2 0.1", opaque([0.5, 0.2, 0.1], [0.0; 3], 1.0)),
            ("Kd 0.5", opaque([0.5; 3], [0.0; 3], 1.0)),
            ("Kd 0 0 0\nKs 0.04 0.04 0.04\nNs 48", opaque([0.0; 3], [0.04; 3], rough)),
            ("Kd 0.1 0.1 0.1\nKs 0.9 0.9 0.9\nNs 48\nillum 1", opaque([0.1; 3], [0.0; 3], rough)),
            ("Ks 0.9 0.8 0.7\nNs 48\nillum 3", opaque([0.0; 3], [0.9, 0.8, 0.7], 0.0)),
            ("Ke 1 1 1", opaque([0.0; 3], [0.0; 3], 1.0)),
            ("Ka 1 1 1", opaque([PLAIN; 3], [0.0; 3], 1.0)),
            ("Ni 1.33\nTf 0.5 1 1\nillum 7", glass(1.33, [0.5, 1.0, 1.0])),
            ("Kd 1 1 1\nNi 1\nd 0.1", glass(1.5, [1.0; 3])),
            ("Kd 1 1 1\nTr 0.9", glass(1.5, [1.0; 3])),
            ("Kd 0.3 0.3 0.3\nd 1\nTr 1", opaque([0.3; 3], [0.0; 3], 1.0)),
        ] {
            let Look { body: found, .. } = look(statements);
            let m_counts = |b: &Body| !matches!(b, Body::Opaque { specular, .. } if *specular == [0.0; 3]);
            if m_counts(&body) {
                assert_eq!(found, body, "{statements}");
            } else if let (Body::Opaque { diffuse: a, .. }, Body::Opaque { diffuse: b, .. }) = (&found, &body)
            {
                assert_eq!((a, m_counts(&found)), (b, false), "{statements}");
            }
        }
    }

    #[test]
    fn errors_name_line_and_column() {
        for (text, line, column, word) in [
            ("newmtl a\nKd 0.5 nan 0\n", 2, 8, "Kd"),
            ("newmtl a\nKd 0.5 -1 0\n", 2, 8, "Kd"),
            ("newmtl a\n  Ns\n", 2, 3, "Ns"),
            ("newmtl a\nNi é\n", 2, 4, "Ni"),
            ("Kd 1 1 1\n", 1, 1, "before any newmtl"),
            ("newmtl\n", 1, 1, "name"),
        ] {
            match parse(text) {
                Err(Error::Scene { line: l, column: c, message, .. }) => {
                    assert_eq!((l, c), (line, column), "{text}: {message}");
                    assert!(message.contains(word), "{message}");
                }
                Err(other) => panic!("{text}: {other}"),
                Ok(_) => panic!("{text}: accepted"),
            }
        }
    }

    #[test]
    fn what_is_approximated_is_said_once() {
        let text = "newmtl a\nKd 2 1 1\nmap_Kd -s 1 1 1 no such file.png\nbump b.png\nnewmtl b\nKd 3 1 1\nbump b.png\n";
        let (_, notes) = parse(text).expect("parses");
        assert_eq!(notes.len(), 3, "{notes:?}");
        assert!(notes[0].ends_with("held to 1: a, b"), "{}", notes[0]);
        assert!(notes[1].contains("no such file.png"), "{}", notes[1]);
        assert!(notes[2].ends_with("statements bump"), "{}", notes[2]);
    }
}

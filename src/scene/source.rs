//! The text files that a scene was read from, and positions in them.

use crate::error::{Error, Result};
use std::io::Read;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Scene and changes files above this size are refused, bytes.
const MAX_TOML_BYTES: u64 = 64 << 20;
/// OBJ files above this size are refused, bytes.
pub const MAX_OBJ_BYTES: u64 = 1 << 30;
/// Spectrum files above this size are refused, bytes.
pub const MAX_CSV_BYTES: u64 = 16 << 20;
/// Luminaire files above this size are refused, bytes.
pub const MAX_IES_BYTES: u64 = 16 << 20;

/// A text file that was read whole.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file as the user named it.
    pub path: PathBuf,
    /// Its text, without a byte order mark.
    pub text: String,
}

impl Source {
    /// Reads `path`: a regular file of UTF-8 text of at most `max_bytes`.
    pub fn read(path: &Path, max_bytes: u64) -> Result<Source> {
        let bytes = read_bytes(path, max_bytes)?;
        let path = path.to_path_buf();
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Source { path, text }),
            Err(e) => {
                let valid = &e.as_bytes()[..e.utf8_error().valid_up_to()];
                let source = Source { path, text: String::from_utf8_lossy(valid).into_owned() };
                let message = "the file is not UTF-8 text from here on; save it as UTF-8";
                Err(source.error(source.text.len(), message))
            }
        }
    }

    /// The same of UTF-8 text or, where it is none, of Latin-1.
    pub fn read_latin(path: &Path, max_bytes: u64) -> Result<Source> {
        let text = String::from_utf8(read_bytes(path, max_bytes)?)
            .unwrap_or_else(|e| e.as_bytes().iter().map(|&b| char::from(b)).collect());
        Ok(Source { path: path.to_path_buf(), text })
    }

    /// The error `message` at byte `offset` of the text.
    pub fn error(&self, offset: usize, message: impl Into<String>) -> Error {
        let before = &self.text.as_bytes()[..offset.min(self.text.len())];
        let line_start = before.iter().rposition(|&b| b == b'\n').map_or(0, |p| p + 1);
        let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
        let column = String::from_utf8_lossy(&before[line_start..]).chars().count() + 1;
        Error::Scene { path: self.path.clone(), line, column, message: message.into() }
    }
}

/// The bytes of a regular file of at most `max_bytes`, without a byte order mark.
fn read_bytes(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a directory" } else { "not a regular file" };
        return Err(Error::io(path, format!("this is {what}; name a file")));
    }
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
    file.take(max_bytes + 1).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
    if bytes.len() as u64 > max_bytes {
        let message = format!("the file is larger than {} MiB; divide it", max_bytes >> 20);
        return Err(Error::io(path, message));
    }
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    Ok(bytes)
}

/// A scene file and the changes files on top of it. Positions count through all of them in the
/// order of reading, so that one number says which file and where in it.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    files: Vec<(usize, Source)>,
    end: usize,
}

impl Sources {
    /// Reads and parses one more TOML file. The parser sees it behind as many blanks as there
    /// is text before it, so that its spans are positions in these sources.
    pub fn parse<T: serde::de::DeserializeOwned>(&mut self, path: &Path) -> Result<T> {
        let source = Source::read(path, MAX_TOML_BYTES)?;
        let base = self.end;
        let shifted = " ".repeat(base) + &source.text;
        self.end = shifted.len() + 1;
        self.files.push((base, source));
        toml::from_str(&shifted).map_err(|e| {
            // The parser's lists of names grow a suggestion; other messages stay as they are.
            let message = super::suggest::with_suggestion(e.message());
            self.error(e.span().map_or(base, |s| s.start), message)
        })
    }

    /// Adds a file that was read elsewhere, or that has no text; its position 0 is the position returned.
    pub fn add(&mut self, source: Source) -> usize {
        let base = self.end;
        self.end = base + source.text.len() + 1;
        self.files.push((base, source));
        base
    }

    /// The directory of the file that holds position `offset`: relative paths start there.
    pub fn directory(&self, offset: usize) -> PathBuf {
        self.holding(offset).1.path.parent().map(Path::to_path_buf).unwrap_or_default()
    }

    /// The error `message` at position `offset`.
    pub fn error(&self, offset: usize, message: impl Into<String>) -> Error {
        let (base, source) = self.holding(offset);
        source.error(offset.saturating_sub(*base), message)
    }

    /// What went wrong with the file `path`, which `name` names: one that cannot be had is the fault of the line that
    /// names it.
    pub fn blame(&self, name: &Spanned<String>, path: &Path, error: Error) -> Error {
        match error {
            Error::Io { message, .. } => {
                self.error(name.span().start, format!("cannot read {}: {message}", path.display()))
            }
            other => other,
        }
    }

    fn holding(&self, offset: usize) -> &(usize, Source) {
        let after = self.files.partition_point(|(base, _)| *base <= offset);
        &self.files[after.saturating_sub(1)]
    }
}

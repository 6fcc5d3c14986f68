//! Scenes made elsewhere: Wavefront OBJ with MTL, and glTF 2.0.
//!
//! Either becomes a [`Model`]: faces, and tables of materials, lights and cameras as a scene file would write them, so that
//! what a scene file or a changes file says goes over them as over its own.

mod buffers;
mod census;
mod dress;
mod gltf;
mod gltf_lights;
mod gltf_materials;
mod look;
mod mesh;
mod mtl;
mod note;
mod obj;
mod polygon;
mod shell;
mod texture;

pub use mesh::{Face, Material, Model, Place};
pub use note::names;

pub use look::plain;

use super::source::Sources;
use crate::error::Result;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The kinds of files that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0, as JSON or binary.
    Gltf,
}

impl Kind {
    /// By the ending of the name; `None` for all others, scene files among them.
    pub fn of(path: &Path) -> Option<Kind> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Kind::Obj),
            "gltf" | "glb" => Some(Kind::Gltf),
            _ => None,
        }
    }
}

/// Reads `path` and the files that it names.
pub fn read(kind: Kind, path: &Path, sources: &mut Sources) -> Result<Model> {
    match kind {
        Kind::Obj => obj::read(path, sources),
        Kind::Gltf => gltf::read(path, sources),
    }
}

/// The file that `name` means in a file at `path`: beside it, unless `name` is absolute.
fn beside(path: &Path, name: &str) -> PathBuf {
    let name = name.trim().replace('\\', "/");
    path.parent().unwrap_or(Path::new("")).join(name)
}

/// All bytes of the regular file `path`, at most `most`; else why they cannot be had.
fn read_bytes(path: &Path, most: u64) -> std::result::Result<Vec<u8>, String> {
    let metadata = std::fs::metadata(path).map_err(|e| e.to_string())?;
    if !metadata.is_file() {
        return Err("this is not a regular file".into());
    }
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| e.to_string())?;
    file.take(most + 1).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
    if bytes.len() as u64 > most {
        return Err(format!("the file is larger than {} MiB", most >> 20));
    }
    Ok(bytes)
}

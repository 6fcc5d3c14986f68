//! Files that appear whole or not at all.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// [`write_with`] for what is all in memory.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// Lets `put` write a file beside `path` and then renames it, so that nobody ever sees half of it
/// and an older file survives a failure.
///
/// # Errors
/// [`Error::Io`] when `path` cannot be written or `put` fails; nothing is left behind.
pub(crate) fn write_with(path: &Path, put: impl FnOnce(&mut File) -> io::Result<()>) -> Result<()> {
    let Some(name) = path.file_name() else {
        return Err(Error::io(path, "this names no file; give a file name"));
    };
    if path.is_dir() {
        return Err(Error::io(path, "this is a directory; give a file name in it"));
    }
    // The process number keeps two programs apart, and create_new keeps two threads apart.
    let mut temporary = PathBuf::new();
    let mut opened = Err(ErrorKind::AlreadyExists.into());
    for attempt in 0..100 {
        let mut draft = std::ffi::OsString::from(".");
        draft.push(name);
        draft.push(format!(".{}-{attempt}.part", std::process::id()));
        temporary = path.with_file_name(draft);
        opened = OpenOptions::new().write(true).create_new(true).open(&temporary);
        if !matches!(&opened, Err(e) if e.kind() == ErrorKind::AlreadyExists) {
            break;
        }
    }
    let mut file = opened.map_err(|e| Error::io(path, explain(&e)))?;
    let written = put(&mut file).and_then(|()| file.flush());
    drop(file);
    written.and_then(|()| fs::rename(&temporary, path)).map_err(|e| {
        // What is left of a failed attempt is of no use; that it may not go away changes nothing.
        let _ = fs::remove_file(&temporary);
        Error::io(path, explain(&e))
    })
}

/// The system's reason and what to do about it.
pub(crate) fn explain(error: &io::Error) -> String {
    let remedy = match error.kind() {
        ErrorKind::NotFound => "the directory or file does not exist: create it or correct the path",
        ErrorKind::PermissionDenied => "no permission: choose another place or change its permissions",
        ErrorKind::StorageFull => "the disk is full: free some space",
        ErrorKind::ReadOnlyFilesystem => "the file system is read-only: choose another place",
        _ => return error.to_string(),
    };
    format!("{remedy} ({error})")
}

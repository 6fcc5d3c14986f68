//! Where files go, and whether they may.

use super::args::Lighting;
use luxgraph::error::{Error, Result};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Files that a run reads and must not overwrite.
pub fn inputs<'a>(scene: &'a Path, changes: &'a [PathBuf], options: &'a Lighting) -> Vec<&'a Path> {
    std::iter::once(scene).chain(changes.iter().chain(&options.graph).map(PathBuf::as_path)).collect()
}

/// Where the files of one image go.
pub struct Targets {
    /// The EXR.
    pub exr: PathBuf,
    /// The PNG.
    pub png: PathBuf,
    /// The JSON report, if asked for.
    pub report: Option<PathBuf>,
}

impl Targets {
    /// [`check_outputs`] of all of them.
    pub fn check(&self, inputs: &[&Path]) -> Result<()> {
        check_outputs(&[Some(&self.exr), Some(&self.png), self.report.as_ref()], inputs)
    }
}

/// Fails now rather than after the work when a folder is missing or read-only, or a name cannot serve:
/// it is a folder's, one of the `inputs` has it, or another output.
pub fn check_outputs(outputs: &[Option<&PathBuf>], inputs: &[&Path]) -> Result<()> {
    let paths: Vec<&Path> = outputs.iter().copied().flatten().map(PathBuf::as_path).collect();
    for (i, &path) in paths.iter().enumerate() {
        if inputs.iter().any(|input| same_file(input, path)) {
            return Err(Error::Settings(format!(
                "{}: this would be overwritten, but it is read; name another output",
                path.display()
            )));
        }
        if paths[..i].iter().any(|other| same_file(other, path)) {
            return Err(Error::Settings(format!(
                "{}: two outputs would have this name; name an image OUT.exr, and other files otherwise",
                path.display()
            )));
        }
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !parent.is_dir() {
            return Err(Error::io(path, format!("there is no folder {}; make it first", parent.display())));
        }
        if path.is_dir() {
            return Err(Error::io(path, "this is a folder; name a file"));
        }
        let trial = parent.join(format!(".luxgraph-{}", std::process::id()));
        match File::create_new(&trial).and_then(|_| std::fs::remove_file(&trial)) {
            Err(e) if e.kind() != ErrorKind::AlreadyExists => {
                return Err(Error::io(path, format!("the folder cannot be written to: {e}")));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Whether two paths name one file, which need not exist.
fn same_file(a: &Path, b: &Path) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

//! Errors, sorted by what the user can do about them.

use std::path::PathBuf;

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong, by remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene or changes file is wrong: where, what, and what to write instead.
    #[error("{}:{line}:{column}: {message}", path.display())]
    Scene {
        /// The file as the user named it.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// What is wrong and what to do.
        message: String,
    },
    /// A command-line or library setting cannot be used.
    #[error("{0}")]
    Settings(String),
    /// The ray tracer failed or is not built in.
    #[error("ray tracer: {0}")]
    Tracer(String),
    /// A saved graph does not belong to this scene or is damaged.
    #[error("{}: {message}", path.display())]
    Graph {
        /// The graph file.
        path: PathBuf,
        /// What does not match, and what to do.
        message: String,
    },
    /// A file could not be read or written.
    #[error("{}: {message}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        message: String,
    },
    /// The computation could not reach an answer.
    #[error("{0}")]
    Numerical(String),
}

impl Error {
    /// Whether the input or the arguments are to blame (exit status 2) rather than the run (1).
    pub fn is_input(&self) -> bool {
        matches!(self, Error::Scene { .. } | Error::Settings(_) | Error::Graph { .. })
    }

    /// An [`Error::Io`] for `path`.
    pub fn io(path: impl Into<PathBuf>, reason: impl std::fmt::Display) -> Self {
        Error::Io { path: path.into(), message: reason.to_string() }
    }
}

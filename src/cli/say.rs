//! Printing that outlives its reader: `luxgraph info SCENE | head` closes the pipe early, which is no
//! reason to end badly or to leave a report unwritten.

use std::io::{self, ErrorKind, Write};

/// Writes a line to standard output.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::say::line(std::io::stdout(), format_args!($($text)*)) };
}

/// Writes a line to standard error.
macro_rules! tell {
    ($($text:tt)*) => { $crate::cli::say::line(std::io::stderr(), format_args!($($text)*)) };
}

pub(crate) use {say, tell};

/// Writes a line to `out`. That nobody reads any more is no failure; anything else, a full disk say,
/// ends the program with status 1.
pub fn line(mut out: impl Write, text: std::fmt::Arguments) {
    let written: io::Result<()> = writeln!(out, "{text}").and_then(|()| out.flush());
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        // There may be nowhere left to say so; the status tells.
        let _ = writeln!(io::stderr(), "luxgraph: the output cannot be written: {error}");
        std::process::exit(1);
    }
}

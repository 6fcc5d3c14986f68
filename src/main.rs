//! The luxgraph command: parses the arguments, delegates to the library, reports errors.

mod cli;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = cli::args::Cli::parse();
    match cli::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            cli::say::tell!("luxgraph: {error}");
            ExitCode::from(if error.is_input() { 2 } else { 1 })
        }
    }
}

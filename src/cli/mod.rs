//! Commands: from arguments as typed to calls of the library.

pub mod args;
mod bench;
mod compare;
mod crosscheck;
mod export;
mod info;
mod measure;
mod progress;
mod reference;
mod relight;
mod render;
mod run;
pub mod say;
mod tradeoff;
mod validate;

use args::{BenchWhat, Cli, Command};
use luxgraph::error::{Error, Result};

/// Carries out one command line.
pub fn run(cli: Cli) -> Result<()> {
    match cli.command {
        Command::Render(args) => with_threads(args.options.lighting.threads, || render::run(&args)),
        Command::Relight(args) => with_threads(args.options.lighting.threads, || relight::run(&args)),
        Command::Reference(args) => with_threads(args.threads, || reference::run(&args)),
        Command::Export(args) => export::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Measure(args) => with_threads(args.lighting.threads, || measure::run(&args)),
        Command::Crosscheck(args) => with_threads(args.threads, || crosscheck::run(&args)),
        Command::Info(args) => info::run(&args),
        Command::Validate(args) => with_threads(args.threads, || validate::run(&args)),
        Command::Tradeoff(args) => with_threads(args.threads, || tradeoff::run(&args)),
        Command::Bench(args) => match &args.what {
            None => with_threads(args.stages.threads, || bench::stages(&args.stages)),
            Some(BenchWhat::Paper { scene, tracer, threads, report }) => {
                with_threads(*threads, || bench::paper(scene, *tracer, report.as_deref()))
            }
            Some(BenchWhat::Hall(args)) if args.links => with_threads(args.threads, || bench::linked(args)),
            Some(BenchWhat::Hall(args)) => with_threads(args.threads, || bench::growth(args)),
        },
    }
}

/// Runs `work` on a pool of `threads`, or of one for each processor.
fn with_threads(threads: Option<u16>, work: impl FnOnce() -> Result<()> + Send) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0).into())
        .build()
        .map_err(|e| Error::Settings(format!("could not start the threads asked for: {e}")))?;
    pool.install(work)
}

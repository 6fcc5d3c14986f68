//! Commands: from arguments as typed to calls of the library.

pub mod args;
mod bench;
mod compare;
mod crosscheck;
mod export;
mod info;
mod measure;
mod options;
mod outputs;
mod progress;
mod reference;
mod relight;
mod render;
mod run;
pub mod say;
mod tradeoff;
mod validate;

use args::{Cli, Command};
use bench::BenchWhat;
use luxgraph::error::{Error, Result};

/// Carries out one command line.
pub fn run(cli: Cli) -> Result<()> {
    match cli.command {
        Command::Render(args) => with_threads(args.options.lighting.tracing.threads, || render::run(&args)),
        Command::Relight(args) => with_threads(args.options.lighting.tracing.threads, || relight::run(&args)),
        Command::Reference(args) => with_threads(args.tracing.threads, || reference::run(&args)),
        Command::Export(args) => export::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Measure(args) => with_threads(args.lighting.tracing.threads, || measure::run(&args)),
        Command::Crosscheck(args) => with_threads(args.threads, || crosscheck::run(&args)),
        Command::Info(args) => info::run(&args),
        Command::Validate(args) => with_threads(args.tracing.threads, || validate::run(&args)),
        Command::Tradeoff(args) => with_threads(args.tracing.threads, || tradeoff::run(&args)),
        Command::Bench(args) => match &args.what {
            None => with_threads(args.stages.tracing.threads, || bench::stages(&args.stages)),
            Some(BenchWhat::Paper(args)) => with_threads(args.tracing.threads, || bench::paper(args)),
            Some(BenchWhat::Hall(args)) if args.links => {
                with_threads(args.tracing.threads, || bench::linked(args))
            }
            Some(BenchWhat::Hall(args)) => with_threads(args.tracing.threads, || bench::growth(args)),
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

//! `luxgraph compare`

use super::outputs::check_outputs;
use super::say::say;
use clap::Args;
use luxgraph::error::Result;
use luxgraph::output::{self, exr};
use luxgraph::report::write_json;
use std::path::PathBuf;

/// `compare`
#[derive(Debug, Args)]
pub struct Compare {
    /// The image that counts as true, EXR with channels R, G, B
    #[arg(value_name = "REFERENCE.exr")]
    pub reference: PathBuf,
    /// The other, of the same size
    #[arg(value_name = "IMAGE.exr")]
    pub image: PathBuf,
    /// PNG of the relative difference of luminance: white none, red brighter, blue darker, full colour at 20 %
    #[arg(short, long, value_name = "OUT.png")]
    pub output: Option<PathBuf>,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// Tells how far an image is from a reference.
pub fn run(args: &Compare) -> Result<()> {
    check_outputs(&[args.output.as_ref(), args.report.as_ref()], &[&args.reference, &args.image])?;
    let (reference, image) = (exr::read(&args.reference)?, exr::read(&args.image)?);
    let difference = output::compare(&reference, &image)?;
    say!("relative RMSE of luminance {:.4} %", 100.0 * difference.relative_rmse);
    say!("mean luminance {:+.4} %", 100.0 * difference.relative_bias);
    say!("CIEDE2000 mean {:.3}, 95th percentile {:.3}", difference.delta_e_mean, difference.delta_e_95);
    if difference.same_bits {
        say!("every value has the same bits");
    }
    if let Some(path) = &args.output {
        output::write_difference(path, &reference, &image)?;
        say!("wrote {}", path.display());
    }
    if let Some(path) = &args.report {
        write_json(path, &difference)?;
    }
    Ok(())
}

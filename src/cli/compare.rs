//! `luxgraph compare`

use super::args::Compare;
use super::run::check_outputs;
use super::say::say;
use luxgraph::error::Result;
use luxgraph::output::{self, exr};
use luxgraph::report::write_json;

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

//! `luxgraph bench hall --links`

use super::BenchHall;
use super::growth::asked;
use crate::cli::progress::Bars;
use crate::cli::say::say;
use luxgraph::error::Result;
use luxgraph::report::bench::linked::{LinkedGrowth, LinkedSize, STAGES, linked_growth};
use luxgraph::report::paper_tables::group;
use luxgraph::report::{Machine, write_json};
use luxgraph::visibility::LinkSettings;
use serde::Serialize;

/// What `bench hall --links` measured.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    wavelengths: usize,
    #[serde(flatten)]
    growth: LinkedGrowth,
}

/// Times the exchange over links on a hall of desks at several numbers of points.
pub fn run(args: &BenchHall) -> Result<()> {
    let (scene, settings) = asked(args)?;
    let mut links = LinkSettings::default();
    links.tolerance = args.link_tolerance.unwrap_or(links.tolerance);
    say!(
        "a hall of {} quadrilaterals over links of a form factor of {} at most: wall time and that of all processors in \
         s, and peak memory in MB",
        group(scene.geometry.surfaces.len() as u64),
        links.tolerance
    );
    let heads: String = STAGES.iter().map(|stage| format!("{stage:>24}")).collect();
    say!("{:>9}{heads}   links/point  rays/point  sweeps", "points");
    let asked = (&args.points[..], args.full);
    let growth = linked_growth(&scene, &settings, &links, asked, &mut print, &Bars::new())?;
    if growth.sizes.len() > 1 {
        say!(
            "links, set-up and solution: N^{:.2}; processors N^{:.2}",
            growth.exponent,
            growth.exponent_of_cpu
        );
    }
    let machine = Machine::this();
    say!("on {}, {} threads, tracer {}", machine.processor, machine.threads, growth.tracer);
    if let Some(path) = &args.report {
        write_json(path, &Report { machine, wavelengths: settings.wavelengths.len(), growth })?;
    }
    Ok(())
}

fn print(size: &LinkedSize) {
    let costs = size
        .stages
        .iter()
        .map(|c| format!("{:>9.2} {:>8.2} {:>5.0}", c.s, c.cpu_s, c.peak_memory_bytes as f64 / 1e6));
    let costs: String = costs.collect();
    let by_point = |count: u64| count as f64 / size.points as f64;
    say!(
        "{:>9}{costs}{:>14.0}{:>12.0}{:>8.0}",
        group(size.points as u64),
        by_point(size.links.links),
        by_point(size.links.rays_cast),
        size.sweeps
    );
    if let Some(full) = &size.full {
        say!(
            "          over all pairs: {:.2} s, {:.2} s of processors; over links the irradiance is off by {:.3} % (root \
             mean square by area; radiance {:.3} %, sum {:+.3} %, worst point {:.1} % of the mean)",
            full.cost.s,
            full.cost.cpu_s,
            100.0 * full.error.irradiance,
            100.0 * full.error.radiance,
            100.0 * full.error.bias,
            100.0 * full.error.largest
        );
    }
}

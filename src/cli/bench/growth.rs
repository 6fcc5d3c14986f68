//! `luxgraph bench hall`

use super::BenchHall;
use crate::cli::options::tracer_choice;
use crate::cli::progress::Bars;
use crate::cli::say::say;
use luxgraph::error::Result;
use luxgraph::report::bench::hall::hall;
use luxgraph::report::bench::scale::{Growth, STAGES, Size, growth};
use luxgraph::report::paper_tables::group;
use luxgraph::report::{Machine, write_json};
use luxgraph::scene::Scene;
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use serde::Serialize;

/// What `bench hall` measured.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    wavelengths: usize,
    #[serde(flatten)]
    growth: Growth,
}

/// The hall and the settings that were asked for.
pub(super) fn asked(args: &BenchHall) -> Result<(Scene, Settings)> {
    let settings = Settings {
        tracer: tracer_choice(args.tracing.tracer),
        wavelengths: Wavelengths::parse(&args.wavelengths)?,
        ..Settings::default()
    };
    Ok((hall(args.rows.into(), args.columns.into()), settings))
}

/// Times every stage on a hall of desks at several numbers of points.
pub fn run(args: &BenchHall) -> Result<()> {
    let (scene, settings) = asked(args)?;
    say!(
        "a hall of {} quadrilaterals: time in s, and peak memory in MB during it",
        group(scene.geometry.surfaces.len() as u64)
    );
    let heads: String = STAGES.iter().map(|stage| format!("{stage:>18}")).collect();
    say!("{:>9}{heads}  sweeps  graph MB", "points");
    let growth = growth(&scene, &settings, &args.points, &mut print, &Bars::new())?;
    if growth.sizes.len() > 1 {
        let exponents: String = growth.exponents.iter().map(|e| format!("{e:>10.2}        ")).collect();
        say!("{:>9}{exponents}", "exponent");
        say!("graph and first pass together: N^{:.2}", growth.exponent_of_light);
    }
    let machine = Machine::this();
    say!("on {}, {} threads, tracer {}", machine.processor, machine.threads, growth.tracer);
    if let Some(path) = &args.report {
        write_json(path, &Report { machine, wavelengths: settings.wavelengths.len(), growth })?;
    }
    Ok(())
}

fn print(size: &Size) {
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    let costs = size.stages.iter().map(|c| format!("{:>10.2} {:>7.0}", c.s, megabytes(c.peak_memory_bytes)));
    let costs: String = costs.collect();
    let graph = megabytes(size.graph_memory_bytes);
    say!("{:>9}{costs}  {:>6.0}  {graph:>8.1}", group(size.points as u64), size.sweeps);
}

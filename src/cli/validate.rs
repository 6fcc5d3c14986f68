//! `luxgraph validate`

use super::args::Tracing;
use super::options::tracer_choice;
use super::outputs::check_outputs;
use super::progress::Bars;
use super::say::say;
use clap::Args;
use luxgraph::error::{Error, Result};
use luxgraph::report::wavelength_table::WavelengthTable;
use luxgraph::report::{Machine, write_json};
use luxgraph::tracers::embree;
use luxgraph::validate::{self, Case, Group, Tolerance};
use serde::Serialize;
use std::path::PathBuf;

/// `validate`
#[derive(Debug, Args)]
pub struct Validate {
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Write every case as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// All that was checked.
#[derive(Serialize)]
struct Report {
    luxgraph: &'static str,
    machine: Machine,
    tracer: &'static str,
    cases: usize,
    passed: usize,
    wall_s: f64,
    groups: Vec<Group>,
    wavelength_table: WavelengthTable,
}

/// Runs all checks, prints them in groups, and fails where one fails.
pub fn run(args: &Validate) -> Result<()> {
    check_outputs(&[args.report.as_ref()], &[])?;
    let choice = tracer_choice(args.tracing.tracer);
    let tracer = match choice {
        luxgraph::tracers::TracerChoice::Voxel => "voxel",
        _ if embree::available().is_some() => "embree",
        _ => "voxel",
    };
    let groups = validate::run(choice, &Bars::new())?;
    groups.iter().for_each(print);
    let cases = groups.iter().map(|g| g.cases.len()).sum();
    let passed = groups.iter().map(Group::passed).sum();
    let wall_s = groups.iter().map(|g| g.wall_s).sum();
    let wavelength_table = WavelengthTable::measure()?;
    say!("\nThe choice of wavelengths, for comparison: {wavelength_table}");
    say!("\ntracer {tracer}, {wall_s:.1} s");
    say!("{passed} of {cases} pass");
    if let Some(path) = &args.report {
        let (luxgraph, machine) = (env!("CARGO_PKG_VERSION"), Machine::this());
        write_json(
            path,
            &Report { luxgraph, machine, tracer, cases, passed, wall_s, groups, wavelength_table },
        )?;
    }
    if passed == cases {
        return Ok(());
    }
    Err(Error::Numerical(format!("{} of {cases} checks fail; they are marked FAIL above", cases - passed)))
}

/// One group: its title, its cases under their sources, and the worst of them.
fn print(group: &Group) {
    say!("\n{:<82} {:>13} {:>13} {:>10} {:>10}", group.title, "expected", "found", "error", "tolerance");
    let mut source = "";
    for case in &group.cases {
        if case.source != source {
            source = case.source;
            say!("  {source}:");
        }
        let (error, tolerance) = errors(case);
        say!(
            "    {:<78} {:>13} {:>13} {error:>10} {tolerance:>10}  {}",
            case.name,
            number(case.expected),
            number(case.found),
            if case.passes() { "pass" } else { "FAIL" }
        );
    }
    if let Some(worst) = group.worst() {
        let (error, tolerance) = errors(worst);
        say!(
            "  {} of {} pass; nearest to its tolerance: {}, error {error} of {tolerance}",
            group.passed(),
            group.cases.len(),
            worst.name
        );
    }
}

/// Error and tolerance of a case as text.
fn errors(case: &Case) -> (String, String) {
    match case.tolerance {
        Tolerance::Relative(t) => (percent(case.error()), percent(t)),
        Tolerance::Absolute(t) => (format!("{:.2e}", case.error()), format!("{t:.0e}")),
    }
}

fn percent(share: f64) -> String {
    if share != 0.0 && share < 1e-5 {
        format!("{:.0e} %", 100.0 * share)
    } else {
        format!("{:.3} %", 100.0 * share)
    }
}

/// Seven significant digits.
fn number(x: f64) -> String {
    if x != 0.0 && !(1e-3..1e7).contains(&x.abs()) {
        return format!("{x:.6e}");
    }
    let before = x.abs().max(1.0).log10().floor() as usize;
    format!("{x:.*}", 6 - before.min(6))
}

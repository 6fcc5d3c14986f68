//! `luxgraph measure`

use super::args::Lighting;
use super::options::{at_points, lighting_settings};
use super::outputs::{check_outputs, inputs};
use super::progress::Bars;
use super::run::{counts, prepare};
use super::say::say;
use clap::Args;
use luxgraph::error::{Error, Result};
use luxgraph::first_pass::FirstPassStats;
use luxgraph::measure::{Illuminance, Reading, Row, write_csv};
use luxgraph::report::{Counts, Machine, peak_memory_bytes, write_json};
use luxgraph::scene::{MaterialId, Scene, Sensor};
use luxgraph::spectrum::Wavelengths;
use luxgraph::visibility::{GraphStats, LinkStats};
use luxgraph::{pipeline, scene};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// `measure`
#[derive(Debug, Args)]
pub struct Measure {
    /// Scene file with `[[sensors]]` or `[[grids]]` (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Table of all readings, spectral ones included
    #[arg(short, long, value_name = "OUT.csv")]
    pub output: Option<PathBuf>,
    /// Change the scene's materials and lights first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// Options of the light.
    #[command(flatten)]
    pub lighting: Lighting,
}

/// All that one run measured.
#[derive(Serialize)]
struct Report {
    luxgraph: &'static str,
    machine: Machine,
    scene: Vec<String>,
    tracer: String,
    wavelengths_nm: Vec<f64>,
    counts: Counts,
    graph_loaded: bool,
    graph: GraphStats,
    #[serde(skip_serializing_if = "Option::is_none")]
    links: Option<LinkStats>,
    first_pass: FirstPassStats,
    sensors: Vec<SensorReport>,
    grids: Vec<GridReport>,
    notes: Vec<&'static str>,
    measure_s: f64,
    total_s: f64,
    peak_memory_bytes: u64,
}

/// One sensor.
#[derive(Serialize)]
struct SensorReport {
    name: String,
    position_m: [f64; 3],
    normal: [f64; 3],
    total: Illuminance,
    direct: Illuminance,
    indirect: Illuminance,
    irradiance_w_m2_nm: Vec<f64>,
}

/// A grid as a whole.
#[derive(Serialize)]
struct GridReport {
    name: String,
    counts: [u32; 2],
    illuminance: Spread,
    melanopic_edi: Spread,
    /// Direct illuminance over all.
    share_direct: f64,
}

/// Smallest, mean and largest reading of a grid, and the smallest over the mean (uniformity).
#[derive(Serialize)]
struct Spread {
    min_lx: f64,
    mean_lx: f64,
    max_lx: f64,
    uniformity: f64,
}

impl Spread {
    fn of(values: &[f64]) -> Self {
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        let min = values.iter().copied().fold(f64::INFINITY, f64::min);
        Spread {
            min_lx: min,
            mean_lx: mean,
            max_lx: values.iter().copied().fold(0.0, f64::max),
            uniformity: if mean > 0.0 { min / mean } else { 0.0 },
        }
    }
}

/// Measures at all sensors and grids of a scene.
pub fn run(args: &Measure) -> Result<()> {
    let started = Instant::now();
    let options = &args.lighting;
    let settings = lighting_settings(options)?;
    let inputs = inputs(&args.scene, &args.changes, options);
    check_outputs(&[args.output.as_ref(), options.report.as_ref()], &inputs)?;
    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    if scene.sensors.is_empty() && scene.grids.is_empty() {
        return Err(Error::Settings(format!(
            "{}: there is nothing to measure with; add [[sensors]] or [[grids]] (scenes/FORMAT.md)",
            args.scene.display()
        )));
    }
    let (sensors, cells) = sensors(&scene);
    let bars = Bars::new();
    let settings = at_points(settings, options, &scene)?;
    let (tracer, prepared) = prepare(&scene, &settings, options.graph.as_deref(), &bars)?;
    let (tracer, geometry) = (tracer.as_ref(), &scene.geometry);
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &bars)?;
    let clock = Instant::now();
    let readings = pipeline::measure(geometry, &prepared, &lit, &sensors, tracer, &settings.measure, &bars)?;
    let measure_s = clock.elapsed().as_secs_f64();
    say!("{} sensors measured in {measure_s:.2} s", sensors.len());

    let (appearance, solution) = &lit;
    let wavelengths = &appearance.wavelengths;
    let reports: Vec<SensorReport> =
        sensors.iter().zip(&readings).map(|(s, r)| sensor_report(s, r, wavelengths)).collect();
    let (singles, of_grids) = reports.split_at(scene.sensors.len());
    let grids = grid_reports(&scene, of_grids);
    print_sensors(singles);
    print_grids(&grids);
    let notes = notes(&scene, wavelengths);
    for note in &notes {
        say!("note: {note}");
    }
    if let Some(path) = &args.output {
        let rows: Vec<Row> = (sensors.iter().zip(&cells).zip(&readings))
            .map(|((sensor, &cell), reading)| Row { sensor, cell, reading })
            .collect();
        write_csv(path, &rows, wavelengths)?;
        say!("wrote {}", path.display());
    }
    if let Some(path) = &options.report {
        let report = Report {
            luxgraph: env!("CARGO_PKG_VERSION"),
            machine: Machine::this(),
            scene: std::iter::once(&args.scene)
                .chain(&args.changes)
                .map(|p| p.display().to_string())
                .collect(),
            tracer: tracer.name(),
            wavelengths_nm: wavelengths.nm.clone(),
            counts: counts(&scene, &prepared, appearance),
            graph_loaded: prepared.graph_loaded,
            graph: prepared.graph.stats.clone(),
            links: prepared.links.as_ref().map(|links| links.stats.clone()),
            first_pass: solution.stats.clone(),
            sensors: reports,
            grids,
            notes,
            measure_s,
            total_s: started.elapsed().as_secs_f64(),
            peak_memory_bytes: peak_memory_bytes(),
        };
        write_json(path, &report)?;
    }
    Ok(())
}

/// All sensors, single ones first, and where each is in its grid.
fn sensors(scene: &Scene) -> (Vec<Sensor>, Vec<Option<[u32; 2]>>) {
    let singles = scene.sensors.iter().map(|s| (s.clone(), None));
    let grids = scene.grids.iter().flat_map(|grid| {
        let cell = |k: usize| [k as u32 % grid.counts[0], k as u32 / grid.counts[0]];
        grid.sensors().enumerate().map(move |(k, sensor)| (sensor, Some(cell(k))))
    });
    singles.chain(grids).unzip()
}

fn sensor_report(sensor: &Sensor, reading: &Reading, wavelengths: &Wavelengths) -> SensorReport {
    let irradiance = reading.total();
    SensorReport {
        name: sensor.name.clone(),
        position_m: sensor.position.to_array(),
        normal: sensor.normal.to_array(),
        total: Illuminance::of(&irradiance, wavelengths),
        direct: Illuminance::of(&reading.direct, wavelengths),
        indirect: Illuminance::of(&reading.indirect(), wavelengths),
        irradiance_w_m2_nm: irradiance,
    }
}

fn grid_reports(scene: &Scene, mut reports: &[SensorReport]) -> Vec<GridReport> {
    let mut grids = Vec::new();
    for grid in &scene.grids {
        let (own, rest) = reports.split_at(grid.len());
        reports = rest;
        let of = |value: &dyn Fn(&SensorReport) -> f64| own.iter().map(value).collect::<Vec<f64>>();
        let illuminance = Spread::of(&of(&|r| r.total.illuminance_lx));
        let direct = Spread::of(&of(&|r| r.direct.illuminance_lx)).mean_lx;
        grids.push(GridReport {
            name: grid.name.clone(),
            counts: grid.counts,
            share_direct: share(direct, illuminance.mean_lx),
            melanopic_edi: Spread::of(&of(&|r| r.total.melanopic_edi_lx)),
            illuminance,
        });
    }
    grids
}

/// `part` of `whole`, 0 in the dark.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

fn print_sensors(reports: &[SensorReport]) {
    if reports.is_empty() {
        return;
    }
    let width = reports.iter().map(|r| r.name.chars().count()).fold(6, usize::max);
    say!("{:<width$} {:>10} {:>17} {:>8}", "sensor", "lx", "melanopic EDI lx", "direct");
    for r in reports {
        say!(
            "{:<width$} {:>10.2} {:>17.2} {:>6.1} %",
            r.name,
            r.total.illuminance_lx,
            r.total.melanopic_edi_lx,
            100.0 * share(r.direct.illuminance_lx, r.total.illuminance_lx)
        );
    }
}

fn print_grids(grids: &[GridReport]) {
    if grids.is_empty() {
        return;
    }
    let width = grids.iter().map(|g| g.name.chars().count()).fold(4, usize::max);
    say!(
        "{:<width$} {:>9} {:>10} {:>10} {:>10} {:>9} {:>17} {:>8}",
        "grid",
        "points",
        "min lx",
        "mean lx",
        "max lx",
        "min/mean",
        "mean EDI lx",
        "direct"
    );
    for g in grids {
        say!(
            "{:<width$} {:>9} {:>10.2} {:>10.2} {:>10.2} {:>9.3} {:>17.2} {:>6.1} %",
            g.name,
            format!("{} x {}", g.counts[0], g.counts[1]),
            g.illuminance.min_lx,
            g.illuminance.mean_lx,
            g.illuminance.max_lx,
            g.illuminance.uniformity,
            g.melanopic_edi.mean_lx,
            100.0 * g.share_direct
        );
    }
}

/// What a reader of the figures must know.
fn notes(scene: &Scene, wavelengths: &Wavelengths) -> Vec<&'static str> {
    let mut notes = Vec::new();
    if wavelengths.len() < 16 {
        notes.push(
            "melanopic EDI from so few wavelengths is an estimate (a few per cent); --wavelengths 16 or more \
             brings it within 0.5 %",
        );
    }
    let specular = |m: &MaterialId| scene.appearance.materials[m.0 as usize].is_specular();
    if !scene.geometry.lights.is_empty() && scene.appearance.surface_material.iter().any(specular) {
        notes.push(
            "what point lights send to a sensor over one mirror, one glossy surface or straight through panes \
             is counted; over more, or through solid glass, it is not",
        );
    }
    notes
}

//! `luxgraph tradeoff`

use super::args::{Tracing, View, parse_size};
use super::options::{camera, tracer_choice};
use super::progress::Bars;
use super::run::note;
use super::say::{say, tell};
use clap::Args;
use luxgraph::error::{Error, Result};
use luxgraph::output::exr;
use luxgraph::report::tradeoff::judge::{Judge, JudgeSettings};
use luxgraph::report::tradeoff::knobs::{Extent, trials};
use luxgraph::report::tradeoff::plot::{self, Quantity};
use luxgraph::report::tradeoff::table::{self, Row, Took};
use luxgraph::report::tradeoff::trial::{Bench, Outcome};
use luxgraph::report::{Machine, write_json};
use luxgraph::scene::{Camera, Scene};
use luxgraph::settings::Settings;
use luxgraph::{scene, tracers};
use serde::Serialize;
use std::path::PathBuf;

/// `tradeoff`
#[derive(Debug, Args)]
pub struct Tradeoff {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Folder for tradeoff.csv, the plots and the judge; made if it is not there. What an earlier run measured there
    /// under the same conditions is not measured again
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Camera of the scene file [default: its first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height of the image in pixels [default: the camera's, scaled to 20,000 pixels, or 5,000 with --quick]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Turn few knobs, on a small image before a noisier judge
    #[arg(long)]
    pub quick: bool,
    /// An image that counts as true but for its channel noise.Y, as `reference` writes it [default: one is made]
    #[arg(long, value_name = "JUDGE.exr", conflicts_with = "judge_samples")]
    pub reference: Option<PathBuf>,
    /// Paths a pixel of the judge [default: 4096, or 512 with --quick]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1048576))]
    pub judge_samples: Option<u32>,
    /// Leave out settings whose graph and first pass are expected to take longer, s
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub longest: f64,
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// Pixels of an image whose size is not given.
const PIXELS: f64 = 20_000.0;
const PIXELS_QUICK: f64 = 5_000.0;

/// All that one run measured.
#[derive(Serialize)]
struct Report<'a> {
    luxgraph: &'static str,
    machine: Machine,
    scene: String,
    camera: String,
    size: [u32; 2],
    tracer: String,
    judge_noise: f64,
    rows: &'a [Row],
}

/// Sweeps the knobs over a scene.
pub fn run(args: &Tradeoff) -> Result<()> {
    let scene = scene::load(&args.scene)?;
    note(&scene);
    let camera = sized(args, &scene)?;
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io(&args.output, e))?;
    let settings = Settings { tracer: tracer_choice(args.tracing.tracer), ..Settings::default() };
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let bars = Bars::new();
    let (extent, asked) = match args.quick {
        true => (Extent::Quick, JudgeSettings { samples: 512, sensor_samples: 1 << 15, sensors: 9 }),
        false => (Extent::Full, JudgeSettings { samples: 4096, sensor_samples: 1 << 18, sensors: 32 }),
    };
    let asked = JudgeSettings { samples: args.judge_samples.unwrap_or(asked.samples), ..asked };
    let view = (&scene, &camera);
    let judge = Judge::of(&args.output, args.reference.as_deref(), view, tracer.as_ref(), &asked, &bars)?;
    say!(
        "judge{}: noise {:.2} % of the mean luminance, {:.2} CIEDE2000",
        if judge.kept { " of an earlier run" } else { "" },
        100.0 * judge.judged.relative_noise(),
        judge.judged.delta_e_of_noise()
    );

    let csv = args.output.join("tradeoff.csv");
    let before = table::read(&csv);
    let mut rows: Vec<Row> = Vec::new();
    let mut bench = Bench::new(view, tracer.as_ref(), &judge, args.longest);
    let trials = trials(&scene, &settings, extent);
    let width = trials.iter().map(|t| t.knob.len() + t.value.len()).fold(0, usize::max) + 2;
    say!("{:<width$} {:>7} {:>9} {:>9} {:>9} {:>7}", "knob: value", "points", "s", "error", "noise", "dE");
    for trial in &trials {
        let label = format!("{}: {}", trial.knob, trial.value);
        let key = bench.key(trial);
        let row = match before.iter().find(|row| row.against.key == key) {
            Some(row) => {
                let (knob, value) = (trial.knob.clone(), trial.value.clone());
                Row { took: Took { knob, value, ..row.took.clone() }, ..row.clone() }
            }
            None => match bench.run(trial, &bars)? {
                Outcome::Measured(row) => *row,
                Outcome::TooLong(s) => {
                    tell!(
                        "note: {label}: left out, would take some {s:.0} s; --longest allows {} s",
                        args.longest
                    );
                    continue;
                }
                Outcome::Refused(why) => {
                    tell!("note: {label}: left out: {why}");
                    continue;
                }
            },
        };
        say!(
            "{label:<width$} {:>7} {:>9.3} {:>7.2} % {:>7.2} % {:>7.2}",
            row.took.points,
            row.took.total_s,
            100.0 * row.known_error(),
            100.0 * row.errors.noise,
            row.errors.delta_e_mean
        );
        rows.push(row);
        table::mark_front(&mut rows);
        table::write(&csv, &rows)?;
    }

    let name = args.scene.file_stem().unwrap_or_default().to_string_lossy();
    for (file, quantity) in [("luminance", Quantity::Luminance), ("colour", Quantity::Colour)] {
        plot::write(&args.output.join(file), &format!("{name}, camera {}", camera.name), &rows, quantity)?;
    }
    say!("on the Pareto front of processor time and error of luminance:");
    let mut front: Vec<&Row> = rows.iter().filter(|row| row.took.on_front).collect();
    front.sort_by(|a, b| a.took.processor_s.total_cmp(&b.took.processor_s));
    for row in front {
        let error = 100.0 * row.known_error();
        say!("{:>9.2} s {error:>7.2} %  {}: {}", row.took.processor_s, row.took.knob, row.took.value);
    }
    say!("wrote {} and plots beside it", csv.display());
    if let Some(path) = &args.report {
        let report = Report {
            luxgraph: env!("CARGO_PKG_VERSION"),
            machine: Machine::this(),
            scene: args.scene.display().to_string(),
            camera: camera.name.clone(),
            size: camera.resolution,
            tracer: tracer.name(),
            judge_noise: judge.judged.relative_noise(),
            rows: &rows,
        };
        write_json(path, &report)?;
    }
    Ok(())
}

/// The camera, as large as asked for, as the judge that was given, or as is enough.
fn sized(args: &Tradeoff, scene: &Scene) -> Result<Camera> {
    let size = match (&args.reference, args.size) {
        (Some(path), None) => {
            let image = exr::read(path)?;
            Some([image.width, image.height])
        }
        (_, size) => size,
    };
    let mut camera = camera(scene, &View { camera: args.camera.clone(), size })?;
    if size.is_none() {
        let [w, h] = camera.resolution.map(f64::from);
        let pixels = if args.quick { PIXELS_QUICK } else { PIXELS };
        let scale = (pixels / (w * h)).sqrt().min(1.0);
        camera.resolution = [w, h].map(|side| ((side * scale).round() as u32).max(1));
    }
    Ok(camera)
}

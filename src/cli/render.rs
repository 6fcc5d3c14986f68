//! `luxgraph render`

use super::args::Options;
use super::options::{at_points, camera, exposure, settings};
use super::outputs::{Targets, inputs};
use super::progress::Bars;
use super::run::{Job, note, prepare};
use super::say::{say, tell};
use clap::Args;
use luxgraph::error::{Error, Result};
use luxgraph::pipeline::Prepared;
use luxgraph::points::LightRefinement;
use luxgraph::scene::Scene;
use luxgraph::second_pass::Checkpoint;
use luxgraph::settings::Settings;
use luxgraph::target::{self, Fixed, Reached, Target};
use luxgraph::tracers::RayTracer;
use luxgraph::{pipeline, scene, share, tracers};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `render`
#[derive(Debug, Args)]
pub struct Render {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Image in linear RGB, Y in cd/m²; a PNG of the same name is written beside it
    #[arg(short, long, value_name = "OUT.exr")]
    pub output: Option<PathBuf>,
    /// Where the PNG goes instead
    #[arg(long, value_name = "OUT.png")]
    pub preview: Option<PathBuf>,
    /// Change the scene first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// Add sample points where the light of the first pass bends, above all at the edges of shadows: where the luminance of
    /// neighbours strays from a linear one by more than this share of the scene's mean, 5% for instance
    #[arg(long, value_name = "SHARE", conflicts_with_all = ["graph", "error", "within"])]
    pub refine: Option<String>,
    /// With --refine: at most so many times as many points
    #[arg(long, value_name = "FACTOR", requires = "refine", default_value_t = 4.0)]
    pub refine_growth: f64,
    /// Options common to render and relight.
    #[command(flatten)]
    pub options: Options,
    /// Choose points, rung, wavelengths and samples so that luminance is wrong by this much at most (root mean square
    /// over the pixels that show no lamp, of their mean), 2% for instance; what is reached is estimated and told.
    /// --quality is where the choice begins; --second-pass and --wavelengths stay as they are given
    #[arg(long, value_name = "SHARE", conflicts_with_all = ["within", "samples", "resume", "graph", "noise", "points"])]
    pub error: Option<String>,
    /// The same for a time, 30s or 2min: as little wrong as can be had within it
    #[arg(long, value_name = "TIME", conflicts_with_all = ["samples", "resume", "graph", "noise", "points"])]
    pub within: Option<String>,
    /// Go on with a render of the same scene and settings that was interrupted: its finished rows are in
    /// OUT.exr.partial
    #[arg(long)]
    pub resume: bool,
}

/// Renders one image.
pub fn run(args: &Render) -> Result<()> {
    let started = Instant::now();
    let options = &args.options;
    let mut settings = settings(options)?;
    settings.refinement = refinement(args)?;
    let exposure = exposure(&options.picture.exposure)?;
    let target = target(args)?;
    let exr = args.output.clone().unwrap_or_else(|| {
        Path::new(args.scene.file_stem().unwrap_or("image".as_ref())).with_extension("exr")
    });
    let png = args.preview.clone().unwrap_or_else(|| exr.with_extension("png"));
    let targets = Targets { exr, png, report: options.lighting.report.clone() };
    targets.check(&inputs(&args.scene, &args.changes, &options.lighting))?;

    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    let camera = camera(&scene, &options.view)?;
    let settings = at_points(settings, &options.lighting, &scene)?;
    let bars = Bars::new();
    if let Some(target) = target {
        note(&scene);
        let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
        let lighting = &options.lighting;
        let fixed =
            Fixed { rung: options.second_pass.is_some(), wavelengths: lighting.wavelengths.is_some() };
        let view = (&scene, &camera);
        // What is estimated from one number of points to the next is the error of all pairs.
        let settings = Settings { most_paired: usize::MAX, ..settings };
        let reached = target::render(view, tracer.as_ref(), &settings, (target, fixed), &bars)?;
        tell_reached(target, &reached);
        let job = Job {
            scene: &scene,
            sources: sources(args),
            prepared: &reached.prepared,
            camera: &camera,
            settings: &reached.settings,
            tracer: tracer.as_ref(),
            exposure,
            spectral: options.picture.spectral,
            checkpoint: None,
            target: Some(report(target, &reached)),
            started,
        };
        return job.write(&targets, &reached.light, (&reached.image, None), reached.second_pass.clone());
    }
    let (tracer, prepared) = prepare(&scene, &settings, options.lighting.graph.as_deref(), &bars)?;
    let prepared = refine(&scene, prepared, &settings, tracer.as_ref(), &bars)?;
    let job = Job {
        scene: &scene,
        sources: sources(args),
        prepared: &prepared,
        camera: &camera,
        settings: &settings,
        tracer: tracer.as_ref(),
        exposure,
        spectral: options.picture.spectral,
        checkpoint: Some(Checkpoint::beside(&targets.exr, args.resume)),
        target: None,
        started,
    };
    let mut first_pass = pipeline::first_pass(&scene.geometry, &prepared, &settings, &bars)?;
    job.run(&targets, first_pass.as_mut(), &bars)
}

/// How far elements are divided for the light's sake.
fn refinement(args: &Render) -> Result<Option<LightRefinement>> {
    if !(1.0..=1000.0).contains(&args.refine_growth) {
        return Err(Error::Settings(format!("--refine-growth {}: give 1 to 1000", args.refine_growth)));
    }
    let growth = args.refine_growth;
    let with = |tolerance| LightRefinement { tolerance, growth, ..LightRefinement::default() };
    Ok(args.refine.as_deref().map(|text| share::parse("--refine", text)).transpose()?.map(with))
}

/// Divides elements where that was asked for; says in one line what came out.
fn refine(
    scene: &Scene,
    prepared: Prepared,
    settings: &Settings,
    tracer: &dyn RayTracer,
    bars: &Bars,
) -> Result<Prepared> {
    let Some(refinement) = &settings.refinement else { return Ok(prepared) };
    let (geometry, appearance, sampling) = (&scene.geometry, &scene.appearance, &scene.sampling);
    let (started, before) = (Instant::now(), prepared.points.len());
    let finer = pipeline::refine_by_light(geometry, prepared, appearance, sampling, settings, tracer, bars)?;
    let (after, seconds) = (finer.points.len(), started.elapsed().as_secs_f64());
    say!("refined by the light: {before} points became {after} in {seconds:.2} s");
    if after as f64 > 0.99 * refinement.growth * before as f64 {
        tell!("note: more points would be needed for this --refine: raise --refine-growth");
    }
    Ok(finer)
}

/// Scene file and changes, as named by the user.
fn sources(args: &Render) -> Vec<String> {
    std::iter::once(&args.scene).chain(&args.changes).map(|p| p.display().to_string()).collect()
}

/// What is asked for in place of settings, if anything.
fn target(args: &Render) -> Result<Option<Target>> {
    Ok(match (&args.error, &args.within) {
        (Some(error), _) => Some(Target::parse_error(error)?),
        (None, Some(time)) => Some(Target::parse_time(time)?),
        (None, None) => None,
    })
}

/// Says what was asked, what was reached and by which settings.
fn tell_reached(target: Target, reached: &Reached) {
    let (estimate, settings) = (&reached.estimate, &reached.settings);
    for step in &reached.steps {
        say!("{:>7} points, {:.2} s", step.points, step.light_s);
    }
    say!(
        "chosen: {} points, {} wavelengths, second pass {:?}, {} samples a pixel",
        reached.prepared.points.len(),
        settings.wavelengths.len(),
        settings.second_pass.rung,
        settings.second_pass.samples
    );
    let percent = |share: f64| 100.0 * share;
    let parts = format!(
        "points {:.2}, wavelengths {:.2}, solver {:.3}, chains {:.3}, noise {:.2} %",
        percent(estimate.points),
        percent(estimate.wavelengths),
        percent(estimate.solver),
        percent(estimate.chains),
        percent(estimate.noise)
    );
    let (found, took) = (percent(estimate.total), reached.total_s);
    match target {
        Target::Error(asked) => {
            say!("error asked {:.2} %, estimated {found:.2} % ({parts}), in {took:.2} s", percent(asked));
            if estimate.total > asked {
                tell!(
                    "note: the error asked for was not reached: more points or samples would be out of proportion"
                );
            }
        }
        Target::Within(asked) => {
            say!("time asked {asked:.2} s, taken {took:.2} s; error estimated {found:.2} % ({parts})");
            if took > asked {
                tell!(
                    "note: the time asked for was not enough for two levels of points and 4 samples a pixel, or misjudged"
                );
            }
        }
    }
}

/// The same for the report.
fn report(target: Target, reached: &Reached) -> serde_json::Value {
    #[derive(Serialize)]
    struct Asked<'a> {
        asked_error: Option<f64>,
        asked_s: Option<f64>,
        estimated_error: target::Estimate,
        steps: &'a [target::Step],
        taken_s: f64,
    }
    let (asked_error, asked_s) = match target {
        Target::Error(error) => (Some(error), None),
        Target::Within(s) => (None, Some(s)),
    };
    let (estimated_error, steps, taken_s) = (reached.estimate, &reached.steps[..], reached.total_s);
    serde_json::json!(Asked { asked_error, asked_s, estimated_error, steps, taken_s })
}

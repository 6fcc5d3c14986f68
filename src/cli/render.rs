//! `luxgraph render`

use super::args::Render;
use super::progress::Bars;
use super::run::{Job, Targets, announce, camera, exposure, settings};
use luxgraph::error::Result;
use luxgraph::second_pass::Checkpoint;
use luxgraph::{pipeline, scene, tracers};
use std::path::Path;
use std::time::Instant;

/// Renders one image.
pub fn run(args: &Render) -> Result<()> {
    let started = Instant::now();
    let options = &args.options;
    let settings = settings(options)?;
    let exposure = exposure(&options.exposure)?;
    let exr = args.output.clone().unwrap_or_else(|| {
        Path::new(args.scene.file_stem().unwrap_or("image".as_ref())).with_extension("exr")
    });
    let png = args.preview.clone().unwrap_or_else(|| exr.with_extension("png"));
    let targets = Targets { exr, png, report: options.report.clone() };
    targets.check()?;

    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    let camera = camera(&scene, options)?;
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let bars = Bars::new();
    let graph = options.graph.as_deref();
    let prepared =
        pipeline::prepare(&scene.geometry, &scene.sampling, &settings, tracer.as_ref(), graph, &bars)?;
    announce(&scene, &prepared, tracer.as_ref());
    let sources =
        std::iter::once(&args.scene).chain(&args.changes).map(|p| p.display().to_string()).collect();
    let job = Job {
        scene: &scene,
        sources,
        prepared: &prepared,
        camera: &camera,
        settings: &settings,
        tracer: tracer.as_ref(),
        exposure,
        spectral: options.spectral,
        checkpoint: Some(Checkpoint::beside(&targets.exr, args.resume)),
        started,
    };
    job.run(&targets, &bars)
}

//! `luxgraph render`

use super::args::Render;
use super::progress::Bars;
use super::run::{Job, Targets, camera, exposure, inputs, prepare, settings};
use luxgraph::error::Result;
use luxgraph::pipeline;
use luxgraph::scene;
use luxgraph::second_pass::Checkpoint;
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
    let targets = Targets { exr, png, report: options.lighting.report.clone() };
    targets.check(&inputs(&args.scene, &args.changes, &options.lighting))?;

    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    let camera = camera(&scene, options.camera.as_deref(), options.size)?;
    let bars = Bars::new();
    let (tracer, prepared) = prepare(&scene, &settings, options.lighting.graph.as_deref(), &bars)?;
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
    let mut first_pass = pipeline::first_pass(&scene.geometry, &prepared, &settings, &bars)?;
    job.run(&targets, first_pass.as_mut(), &bars)
}

//! `luxgraph reference`

use super::args::{Picture, Tracing, View};
use super::options::{camera, exposure, tracer_choice};
use super::outputs::Targets;
use super::progress::Bars;
use super::run::note;
use super::say::{say, tell};
use clap::Args;
use luxgraph::error::Result;
use luxgraph::output::{self, exr::ExrOptions};
use luxgraph::reference::{self, ReferenceSettings, ReferenceStats};
use luxgraph::report::{Machine, peak_memory_bytes, write_json};
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::{scene, tracers};
use serde::Serialize;
use std::path::PathBuf;

/// `reference`
#[derive(Debug, Args)]
pub struct Reference {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Image as `render` writes it, with the standard error of luminance as channel noise.Y, cd/m²; a PNG of the same
    /// name is written beside it
    #[arg(short, long, value_name = "OUT.exr")]
    pub output: PathBuf,
    /// Change the scene first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// The view.
    #[command(flatten)]
    pub view: View,
    /// Paths a pixel; more than 16 are rounded up to a multiple of 16
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1048576))]
    pub samples: u32,
    /// meyer4, or how many bands from 380 to 780 nm
    #[arg(long, value_name = "meyer4|N", default_value = "8")]
    pub wavelengths: String,
    /// Seed of the paths
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,
    /// How the image is written.
    #[command(flatten)]
    pub picture: Picture,
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Write samples, rays, noise and time as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// What `reference` did.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    tracer: String,
    wavelengths_nm: Vec<f64>,
    #[serde(flatten)]
    stats: ReferenceStats,
    exposure_ev: f64,
    peak_memory_bytes: u64,
}

/// Renders one reference.
pub fn run(args: &Reference) -> Result<()> {
    let exposure = exposure(&args.picture.exposure)?;
    let wavelengths = Wavelengths::parse(&args.wavelengths)?;
    let png = args.output.with_extension("png");
    let targets = Targets { exr: args.output.clone(), png, report: args.report.clone() };
    let inputs: Vec<_> = std::iter::once(&args.scene).chain(&args.changes).map(|p| p.as_path()).collect();
    targets.check(&inputs)?;
    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    note(&scene);
    if !scene.geometry.lights.is_empty() {
        tell!(
            "note: what mirrors and glass pass on of point lights is not found by chance, and missing here"
        );
    }
    let camera = camera(&scene, &args.view)?;
    let geometry = &scene.geometry;
    let tracer = tracers::choose(tracer_choice(args.tracing.tracer), geometry)?;
    let appearance = scene.appearance.sample(geometry, &wavelengths, Settings::default().fresnel_entries);
    let settings = ReferenceSettings { samples: args.samples, seed: args.seed };
    let found = reference::render(geometry, &appearance, &camera, tracer.as_ref(), &settings, &Bars::new())?;
    let stats = &found.stats;
    say!(
        "reference: {:.2} s, {} samples a pixel, {} rays and {} shadow rays with {}, longest path {}",
        stats.reference_s,
        stats.samples,
        stats.rays,
        stats.shadow_rays,
        tracer.name(),
        stats.longest
    );
    if let Some(noise) = stats.relative_noise {
        say!("noise: {:.3} % of the mean luminance, root mean square over the pixels", 100.0 * noise);
    }
    let layers = ExrOptions { xyz: args.picture.spectral, spectral: args.picture.spectral };
    output::exr::write_with(&targets.exr, &found.image, &layers, &[(output::exr::NOISE, &found.noise)])?;
    let exposure_ev = output::png::write(&targets.png, &found.image, exposure)?;
    say!("wrote {} and {} (exposure {exposure_ev:+.2} EV)", targets.exr.display(), targets.png.display());
    if let Some(path) = &targets.report {
        let report = Report {
            machine: Machine::this(),
            tracer: tracer.name(),
            wavelengths_nm: appearance.wavelengths.nm.clone(),
            stats: found.stats,
            exposure_ev,
            peak_memory_bytes: peak_memory_bytes(),
        };
        write_json(path, &report)?;
    }
    Ok(())
}

//! `luxgraph reference`

use super::args::Reference;
use super::progress::Bars;
use super::run::{Targets, camera, exposure, note, tracer_choice};
use super::say::{say, tell};
use luxgraph::error::Result;
use luxgraph::output::{self, exr::ExrOptions};
use luxgraph::reference::{self, ReferenceSettings, ReferenceStats};
use luxgraph::report::{Machine, peak_memory_bytes, write_json};
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::{scene, tracers};
use serde::Serialize;

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
    let exposure = exposure(&args.exposure)?;
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
    let camera = camera(&scene, args.camera.as_deref(), args.size)?;
    let geometry = &scene.geometry;
    let tracer = tracers::choose(tracer_choice(args.tracer), geometry)?;
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
    let layers = ExrOptions { xyz: args.spectral, spectral: args.spectral };
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

//! A model taken through the whole program.

use super::model::Model;
use luxgraph::error::Result;
use luxgraph::first_pass::FirstPassStats;
use luxgraph::geometry::SurfaceId;
use luxgraph::observer::Silent;
use luxgraph::points::SamplePoints;
use luxgraph::scene::SampledAppearance;
use luxgraph::settings::Settings;
use luxgraph::tracers::{self, TracerChoice, embree};
use luxgraph::{pipeline, scene};

/// What came out.
pub struct Lit {
    /// Materials are in the order of the alphabet.
    pub appearance: SampledAppearance,
    pub points: SamplePoints,
    /// L^d of every point, `[N][W]`.
    pub radiance: Vec<f32>,
    /// The view, `[pixels][W]`.
    pub image: Vec<f32>,
    pub stats: FirstPassStats,
    pub wavelengths: usize,
}

/// All tracers of this build.
pub fn all_tracers() -> Vec<TracerChoice> {
    let embree = embree::available().map(|_| TracerChoice::Embree);
    [TracerChoice::Voxel].into_iter().chain(embree).collect()
}

/// Solved to 1e-5: what is left is the arithmetic's and the sampling's.
pub fn tight() -> Settings {
    let mut settings = Settings::default();
    settings.first_pass.tolerance = 1e-5;
    settings.first_pass.chain.tolerance = 1e-6;
    settings.second_pass.samples = 2;
    settings.second_pass.lobe_samples = 2;
    settings
}

/// The light of `model`, tightly solved.
pub fn light(model: &Model, tracer: TracerChoice) -> Result<Lit> {
    light_of(&model.toml(), &Settings { tracer, ..tight() })
}

/// Reads `toml` and takes it through both passes. Panics at a radiance that is not a number or is negative.
pub fn light_of(toml: &str, settings: &Settings) -> Result<Lit> {
    let folder = tempfile::tempdir().expect("a folder for the scene");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, toml).expect("the scene can be written");
    let scene = scene::load(&path)?;
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let prepared =
        pipeline::prepare(&scene.geometry, &scene.sampling, settings, tracer.as_ref(), None, &Silent)?;
    let lit = pipeline::light(&scene.geometry, &prepared, &scene.appearance, settings, &Silent)?;
    let (image, _) = pipeline::view(
        &scene.geometry,
        &prepared,
        &lit,
        &scene.cameras[0],
        tracer.as_ref(),
        &settings.second_pass,
        &Silent,
    )?;
    let (appearance, solution) = lit;
    for (what, values) in [("point", &solution.radiance), ("pixel", &image.radiance)] {
        let bad = values.iter().position(|l| !l.is_finite() || *l < 0.0);
        assert_eq!(bad, None, "{what}: {:?} in\n{toml}", bad.map(|i| values[i]));
    }
    Ok(Lit {
        appearance,
        points: prepared.points,
        radiance: solution.radiance,
        image: image.radiance,
        stats: solution.stats,
        wavelengths: solution.wavelengths.len(),
    })
}

impl Lit {
    /// E of a material at the first wavelength, W m⁻² sr⁻¹ nm⁻¹.
    pub fn emission(&self, material: usize) -> f64 {
        f64::from(self.appearance.materials[material].emission[0])
    }

    /// L^d of point `i` at the first wavelength.
    pub fn of(&self, i: usize) -> f64 {
        f64::from(self.radiance[i * self.wavelengths])
    }

    /// L^d of all points at the first wavelength.
    pub fn all(&self) -> Vec<f64> {
        (0..self.points.len()).map(|i| self.of(i)).collect()
    }

    /// L^d of the points of some surfaces.
    pub fn on(&self, surfaces: impl Fn(SurfaceId) -> bool) -> Vec<f64> {
        (0..self.points.len()).filter(|&i| surfaces(self.points.surface[i])).map(|i| self.of(i)).collect()
    }

    /// Mean of L^d over area.
    pub fn mean(&self) -> f64 {
        let areas = || self.points.area.iter().map(|&a| f64::from(a));
        self.all().iter().zip(areas()).map(|(l, a)| l * a).sum::<f64>() / areas().sum::<f64>()
    }

    /// All pixels at the first wavelength.
    pub fn pixels(&self) -> Vec<f64> {
        self.image.iter().step_by(self.wavelengths).map(|&l| f64::from(l)).collect()
    }
}

//! Measures light: the irradiance of plane elements anywhere in a scene whose diffuse light is known.
//!
//! Three parts add up. *Direct* light comes straight from emitting surfaces and point lights, by exact
//! polygon factors and shadow rays (`direct`). *Diffuse* light is what all surfaces reflect
//! diffusely, the first pass's solution read between its points and gathered over the hemisphere
//! (`diffuse`). *Specular* light reaches the sensor over mirrors, gloss and glass (`specular`). No
//! part depends on where sample points happen to lie, and none is drawn by chance.

mod cell;
mod csv;
mod diffuse;
mod direct;
mod images;
mod mirrored;
mod place;
mod settings;
mod specular;

pub use csv::{Row, write_csv};
pub(crate) use place::Place;
pub use settings::MeasureSettings;

use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::Sensor;
use crate::second_pass::LitScene;
use crate::spectrum::Wavelengths;
use crate::tracers::RayTracer;
use rayon::prelude::*;

/// Spectral irradiance of a sensor, W m⁻² nm⁻¹ at the wavelengths of the solution: `[W]` each.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Straight from lights and emitting surfaces.
    pub direct: Vec<f64>,
    /// From all surfaces that reflect diffusely, their emission left out.
    pub diffuse: Vec<f64>,
    /// Over mirrors, glossy surfaces and glass, whatever it shows.
    pub specular: Vec<f64>,
}

/// What a spectral irradiance is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Illuminance {
    /// Illuminance, lx.
    pub illuminance_lx: f64,
    /// Melanopic equivalent daylight illuminance (CIE S 026), lx.
    pub melanopic_edi_lx: f64,
}

impl Reading {
    /// What does not come straight from a light: diffuse and specular.
    pub fn indirect(&self) -> Vec<f64> {
        self.diffuse.iter().zip(&self.specular).map(|(d, s)| d + s).collect()
    }

    /// All light.
    pub fn total(&self) -> Vec<f64> {
        self.direct.iter().zip(self.indirect()).map(|(d, i)| d + i).collect()
    }
}

impl Illuminance {
    /// Of an irradiance at `wavelengths`, W m⁻² nm⁻¹. Colours so saturated that the quadrature makes
    /// them negative count as 0.
    pub fn of(irradiance: &[f64], wavelengths: &Wavelengths) -> Self {
        Illuminance {
            illuminance_lx: wavelengths.xyz(irradiance)[1].max(0.0),
            melanopic_edi_lx: wavelengths.melanopic_edi(irradiance).max(0.0),
        }
    }
}

/// Reads all `sensors` in a lit scene with these sample `points`. Same bits for any number of threads.
///
/// A sensor that lies on a surface, within 10⁻⁴ of the scene's size, looks from there along its
/// normal and is not blocked by that surface. Light that a point light sends over two specular surfaces in
/// a row, or through solid glass, straight to a sensor is left out; what falls on diffuse surfaces that
/// way is not.
///
/// # Errors
/// [`Error::Settings`] for a sensor without a place or a direction and for settings that cannot be
/// used; [`Error::Numerical`] for a solution that is not finite or not of these points.
pub fn measure(
    scene: &LitScene,
    points: &SamplePoints,
    tracer: &dyn RayTracer,
    sensors: &[Sensor],
    settings: &MeasureSettings,
    observer: &dyn Observer,
) -> Result<Vec<Reading>> {
    settings.check()?;
    check(scene, points)?;
    let places: Vec<place::Place> =
        sensors.iter().map(|s| place::Place::new(scene.geometry, tracer, s)).collect::<Result<_>>()?;
    let field = scene.interpolator.field(scene.solution);
    let direct = direct::Direct::new(scene, tracer, settings);
    let diffuse = diffuse::Diffuse::new(scene, points, tracer, settings, &field);
    let specular = specular::Specular::new(scene, points, tracer, settings, &field);
    observer.begin("sensors", sensors.len() as u64);
    let readings = places
        .par_iter()
        .map(|place| {
            let reading = Reading {
                direct: direct.at(place),
                diffuse: diffuse.at(place),
                specular: specular.at(place),
            };
            observer.advance(1);
            reading
        })
        .collect();
    observer.end();
    Ok(readings)
}

/// Whether the parts belong together and hold nothing that is not a number.
fn check(scene: &LitScene, points: &SamplePoints) -> Result<()> {
    let refuse = |what: &str| Err(Error::Numerical(format!("measure: {what}")));
    let (solution, appearance) = (scene.solution, scene.appearance);
    if solution.wavelengths.is_empty() || solution.wavelengths != appearance.wavelengths {
        return refuse("the solution and the appearance are not sampled at the same wavelengths");
    }
    let radiances = points.len() * solution.wavelengths.len();
    if solution.radiance.len() != radiances || scene.interpolator.len() != points.len() {
        return refuse("the solution does not belong to these sample points");
    }
    let geometry = scene.geometry;
    if appearance.surface_material.len() != geometry.surfaces.len()
        || appearance.lights.len() != geometry.lights.len()
    {
        return refuse("the appearance does not belong to this geometry");
    }
    if !solution.radiance.iter().all(|l| l.is_finite()) {
        return refuse("the solution of the first pass is not finite");
    }
    Ok(())
}

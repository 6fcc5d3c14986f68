//! Lights of known flux, and what melanopsin makes of known spectra.

use super::model::Model;
use super::{Case, Tolerance, shapes};
use crate::error::{Error, Result};
use crate::scene::{Distribution, LightLevel};
use crate::settings::Settings;
use crate::spectrum::{Spectrum, Wavelengths, library};
use crate::tracers::TracerChoice;
use glam::DVec3;
use std::f64::consts::PI;

const FLUX: &str = "definition: flux over pi (Lambertian) or 4 pi (isotropic) at 1 m";
const SPHERE: &str = "unit sphere, reflectance 0.5, isotropic pi cd at the centre: L = 1 by energy balance";
const MELANOPIC: &str = "CIE S 026/E:2018, melanopic equivalent daylight illuminance of 100 lx";

pub fn run(tracer: TracerChoice) -> Result<Vec<Case>> {
    let settings = Settings { tracer, ..Settings::default() };
    let mut cases = Vec::new();
    let half = Tolerance::Relative(0.005);
    let down = Distribution::Lambertian { axis: DVec3::NEG_Z };
    for (name, distribution, expected) in [
        ("Lambertian point of 100 lm, on its axis, lx", down, 100.0 / PI),
        ("isotropic point of 100 lm, lx", Distribution::Isotropic, 25.0 / PI),
    ] {
        let mut model = table();
        let white = Spectrum::Constant(1.0);
        model.point([0.0, 0.0, 1.0], distribution, white, LightLevel::LuminousFlux(100.0));
        let found = model.light(&settings)?.illuminance_at([0.0; 3], [0.0, 0.0, 1.0])?;
        cases.push(Case { name: name.into(), source: FLUX, expected, found, tolerance: half });
    }
    // So small that it is a point for a sensor at 1 m: 1e-4 m2 of 1e6 / pi cd/m2.
    let mut model = table();
    let lamp = model.diffuse(0.0, 1e6 / PI);
    let [low, high] = [-0.005, 0.005];
    model.quad([[low, low, 1.0], [low, high, 1.0], [high, high, 1.0], [high, low, 1.0]], lamp, f64::MAX);
    let found = model.light(&settings)?.illuminance_at([0.0; 3], [0.0, 0.0, 1.0])?;
    let name = "Lambertian square of 0.01 m and 100 lm, on its axis, lx".into();
    cases.push(Case { name, source: FLUX, expected: 100.0 / PI, found, tolerance: half });
    cases.push(sphere(&settings)?);

    // Four wavelengths are too few for the action spectrum of melanopsin.
    let settings = Settings { wavelengths: Wavelengths::bands(32)?, ..settings };
    for (illuminant, expected) in [("A", 49.58), ("D65", 100.0)] {
        let spectrum = library::illuminant(illuminant)
            .ok_or_else(|| Error::Numerical(format!("the built-in illuminant {illuminant} is missing")))?;
        let mut model = table();
        let level = LightLevel::LuminousIntensity(100.0);
        model.point([0.0, 0.0, 1.0], Distribution::Isotropic, spectrum, level);
        let lit = model.light(&settings)?;
        let readings = lit.read([([0.0; 3], [0.0, 0.0, 1.0])])?;
        let found = readings.iter().map(|r| lit.lux(&r.total()).melanopic_edi_lx).sum();
        let name = format!("illuminant {illuminant}, lx");
        cases.push(Case { name, source: MELANOPIC, expected, found, tolerance: half });
    }
    Ok(cases)
}

/// A black square that the sensor lies on.
fn table() -> Model {
    let mut model = Model::default();
    let black = model.diffuse(0.0, 0.0);
    model.quad([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], black, f64::MAX);
    model
}

/// Light from the middle of a sphere.
fn sphere(settings: &Settings) -> Result<Case> {
    let mut model = Model::default();
    let grey = model.diffuse(0.5, 0.0);
    model.add(shapes::sphere([0.0; 3], 1.0, true), grey, 4.0 * PI / 1000.0);
    let level = LightLevel::LuminousIntensity(PI);
    model.point([0.0; 3], Distribution::Isotropic, Spectrum::Constant(1.0), level);
    let lit = model.light(settings)?;
    let points = (0..lit.prepared.points.len()).map(|i| (1.0, lit.luminance(i)));
    let name = "worst point of the sphere, cd/m2";
    Ok(Case::worst(name, SPHERE, Tolerance::Relative(0.005), points))
}

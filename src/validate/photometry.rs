//! Lights of known flux, and what melanopsin makes of known spectra.

use super::model::Model;
use super::{Case, Tolerance};
use crate::error::{Error, Result};
use crate::geometry::Shape;
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

/// The sphere as 1280 triangles that have its area together.
fn sphere(settings: &Settings) -> Result<Case> {
    let mut triangles = icosahedron();
    for _ in 0..3 {
        triangles = triangles.into_iter().flat_map(divide).collect();
    }
    let area: f64 = triangles.iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).length()).sum();
    let radius = (4.0 * PI / area).sqrt();
    let mut model = Model::default();
    let grey = model.diffuse(0.5, 0.0);
    for [a, b, c] in triangles {
        // Seen from within.
        model.add(Shape::Triangle([a, c, b].map(|v| radius * v)), grey, f64::MAX);
    }
    let level = LightLevel::LuminousIntensity(PI);
    model.point([0.0; 3], Distribution::Isotropic, Spectrum::Constant(1.0), level);
    let lit = model.light(settings)?;
    let points = (0..lit.prepared.points.len()).map(|i| (1.0, lit.luminance(i)));
    let name = "1280 triangles of the sphere's area, worst of them, cd/m2";
    Ok(Case::worst(name, SPHERE, Tolerance::Relative(0.005), points))
}

/// Corners on the unit sphere, counter-clockwise from outside.
fn icosahedron() -> Vec<[DVec3; 3]> {
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut corners = Vec::new();
    for a in [-1.0, 1.0] {
        for b in [-golden, golden] {
            corners.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
        }
    }
    let mut triangles = Vec::new();
    // Faces are the triples of neighbours, 2 apart.
    let near = |a: DVec3, b: DVec3| (a.distance(b) - 2.0).abs() < 1e-9;
    for (i, &a) in corners.iter().enumerate() {
        for (j, &b) in corners.iter().enumerate().skip(i + 1) {
            for &c in corners.iter().skip(j + 1).filter(|&&c| near(a, b) && near(b, c) && near(c, a)) {
                let outwards = (b - a).cross(c - a).dot(a) > 0.0;
                let face = if outwards { [a, b, c] } else { [a, c, b] };
                triangles.push(face.map(DVec3::normalize));
            }
        }
    }
    triangles
}

/// Four triangles with all corners on the unit sphere.
fn divide([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [x, y, z] = [b + c, c + a, a + b].map(DVec3::normalize);
    [[a, z, y], [z, b, x], [y, x, c], [x, y, z]]
}

//! Form factors between simple shapes, and whether those of closed rooms add up.

use super::model::Model;
use super::shapes::{sphere, walls};
use super::{Case, Tolerance, hollow};
use crate::error::Result;
use crate::first_pass::Kernel;
use crate::geometry::{Disc, Shape};
use crate::settings::Settings;
use crate::tracers::TracerChoice;
use glam::DVec3;
use std::f64::consts::PI;

const CATALOGUE: &str = "closed form (Howell, A Catalog of Radiation Heat Transfer Configuration Factors)";
const CENTRES: &str = "closed form, error of cos cos dS / (pi r^2) between the centres of two unit squares";
const CLOSURE: &str = "sum over a closed room: 1";
const SPHERE: &str = "A / (4 pi R^2) whatever the point";
const RADIUS: &str = "spectral radius of cos cos dS / (pi r^2), where 1 is right (power iteration in f64)";

/// Elements along an edge of a receiver.
const FINE: f64 = 32.0;

pub fn run(tracer: TracerChoice) -> Result<Vec<Case>> {
    let settings = Settings { tracer, ..Settings::default() };
    let mut cases = Vec::new();
    let mut compare = |name: String, found: f64, expected: f64| {
        cases.push(Case { name, source: CATALOGUE, expected, found, tolerance: Tolerance::Relative(0.005) });
    };
    for (ratio, expected) in [
        (0.1, 0.003_162_056_84),
        (0.5, 0.068_589_588_82),
        (1.0, 0.199_824_895_698_387_46),
        (2.0, 0.415_253_283_58),
        (10.0, 0.826_994_522_37),
        (100.0, 0.980_416_602_93),
    ] {
        let elements = if ratio > 10.0 { 2.0 * FINE } else { FINE };
        let found = factor(&settings, &[opposite(1.0 / ratio)], &[square(1.0)], 1.0 / (elements * elements))?;
        compare(format!("opposite squares, side/distance {ratio}"), found, expected);
    }
    let small = 1.0 / (FINE * FINE);
    let found = factor(&settings, &[wall(1.0)], &[square(1.0)], small)?;
    compare("squares with a common edge, 90 degrees".into(), found, 0.200_043_776_075_403_16);
    let low = factor(&settings, &[wall(1.0)], &[square(2.0)], small)?;
    compare("perpendicular rectangles, H = 1, W = 2".into(), low, 0.116_426_301_40);
    let high = factor(&settings, &[wall(2.0)], &[square(1.0)], small)?;
    compare("perpendicular rectangles, H = 2, W = 1".into(), high, 0.232_852_602_80);
    compare("reciprocity: A1 F12 / (A2 F21) of these two".into(), 2.0 * low / high, 1.0);
    let found = factor(&settings, &[disc(1.0, false)], &[disc(0.0, true)], 2e-3)?;
    compare("coaxial unit discs, distance 1".into(), found, (3.0 - 5.0_f64.sqrt()) / 2.0);
    cases.extend(spheres(&settings)?);
    cases.extend(hollow::run(&settings)?);

    let mut growths = Vec::new();
    for (n, growth) in [(1, 1.591_549), (2, 1.272_989), (4, 1.143_124), (8, 1.075_485), (16, 1.038_990)] {
        let mut model = Model::default();
        let grey = model.diffuse(0.5, 1.0);
        for corners in walls([0.0; 3], [1.0; 3]) {
            model.quad(corners, grey, 1.0 / f64::from(n * n));
        }
        let lit = model.light(&settings)?;
        let row_sum = lit.solution().stats.row_sum;
        let sums = [row_sum.min, row_sum.max].map(|found| (1.0, found));
        let cube = format!("unit cube, {n} x {n} elements a face");
        let worst = format!("{cube}: sum of factors of the worst point");
        cases.push(Case::worst(worst, CLOSURE, Tolerance::Absolute(1e-5), sums));
        growths.push(Case {
            name: format!("{cube}: growth a bounce with the paper's kernel"),
            source: RADIUS,
            expected: growth,
            found: lit.growth(Kernel::Paper),
            tolerance: Tolerance::Relative(1e-5),
        });
    }
    cases.extend(growths);
    let mut settings = settings;
    settings.first_pass.kernel = Kernel::Paper;
    for (ratio, expected) in
        [(1.0, 59.3), (2.0, 16.0), (3.0, 7.3), (4.0, 4.1), (5.0, 2.65), (8.0, 1.04), (10.0, 0.66)]
    {
        let exact = opposite_squares(ratio);
        let found = factor(&settings, &[opposite(ratio)], &[square(1.0)], 1.0)?;
        let name = format!("the paper's kernel, opposite squares at {ratio} sides: too high by, %");
        let found = 100.0 * (found / exact - 1.0);
        cases.push(Case { name, source: CENTRES, expected, found, tolerance: Tolerance::Absolute(0.06) });
    }
    // The same at any refinement.
    let found = factor(&settings, &[wall(1.0)], &[square(1.0)], 1.0)?;
    let name = "the paper's kernel, two equal squares with a common edge, 90 degrees".into();
    cases.push(Case {
        name,
        source: CENTRES,
        expected: 1.0 / PI,
        found,
        tolerance: Tolerance::Relative(1e-5),
    });
    Ok(cases)
}

/// Factor from the receiver to the emitter, from the light that falls on the receiver.
fn factor(settings: &Settings, emitter: &[Shape], receiver: &[Shape], max_area: f64) -> Result<f64> {
    let mut model = Model::default();
    let (lamp, grey) = (model.diffuse(0.0, 1.0), model.diffuse(0.5, 0.0));
    emitter.iter().for_each(|shape| model.add(shape.clone(), lamp, f64::MAX));
    receiver.iter().for_each(|shape| model.add(shape.clone(), grey, max_area));
    let lit = model.light(settings)?;
    let receiving = (0..receiver.len()).flat_map(|s| lit.on(emitter.len() + s));
    Ok(lit.mean(receiving, |i| lit.illuminance(i)) / PI)
}

/// Factor between opposite unit squares this far apart.
fn opposite_squares(distance: f64) -> f64 {
    let x = 1.0 / distance;
    let root = (1.0 + x * x).sqrt();
    let logarithm = 0.5 * ((1.0 + x * x).powi(2) / (1.0 + 2.0 * x * x)).ln();
    2.0 / (PI * x * x) * (logarithm + 2.0 * x * root * (x / root).atan() - 2.0 * x * x.atan())
}

fn quad(corners: [[f64; 3]; 4]) -> Shape {
    Shape::Quad(corners.map(DVec3::from_array))
}

/// In the plane z = 0, looking up: `width` along x, 1 along y.
fn square(width: f64) -> Shape {
    quad([[0.0, 0.0, 0.0], [width, 0.0, 0.0], [width, 1.0, 0.0], [0.0, 1.0, 0.0]])
}

/// The unit square above the origin, looking down.
fn opposite(z: f64) -> Shape {
    quad([[0.0, 0.0, z], [0.0, 1.0, z], [1.0, 1.0, z], [1.0, 0.0, z]])
}

/// In the plane x = 0, looking along x: 1 along y, `height` along z.
fn wall(height: f64) -> Shape {
    quad([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, height], [0.0, 0.0, height]])
}

/// The unit disc at this height, looking up or down.
fn disc(z: f64, up: bool) -> Shape {
    let normal = if up { DVec3::Z } else { DVec3::NEG_Z };
    Shape::from(Disc { centre: z * DVec3::Z, normal, radius: 1.0 })
}

/// Factors of a ball seen from a plane element at `degrees` from its normal, and of the inside of a sphere.
fn spheres(settings: &Settings) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    let patch =
        quad([[-0.005, -0.005, 0.0], [0.005, -0.005, 0.0], [0.005, 0.005, 0.0], [-0.005, 0.005, 0.0]]);
    for (degrees, distance) in [(0.0_f64, 2.0), (60.0, 2.0), (30.0, 5.0), (0.0, 1.05)] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let ball = sphere([distance * sin, 0.0, distance * cos], 1.0, false);
        let mut model = Model::default();
        let (lamp, grey) = (model.diffuse(0.0, 1.0), model.diffuse(0.5, 0.0));
        // From close by only a cap is seen: its elements must be small enough to be in it.
        model.add(ball, lamp, if distance < 2.0 { 0.01 } else { f64::MAX });
        model.add(patch.clone(), grey, 1.0);
        let lit = model.light(settings)?;
        let found = lit.mean(lit.on(1), |i| lit.illuminance(i)) / PI;
        let name = format!("plane element to a unit sphere {distance} away at {degrees} degrees");
        let expected = cos / (distance * distance);
        cases.push(Case { name, source: CATALOGUE, expected, found, tolerance: Tolerance::Relative(0.005) });
    }
    for level in [2, 4, 5] {
        let mut model = Model::default();
        let (radius, grey) = (1.7, model.diffuse(0.5, 1.0));
        let whole = 4.0 * PI * radius * radius;
        model.add(sphere([0.3, -0.2, 4.0], radius, true), grey, 1.01 * whole / 4f64.powi(level));
        let lit = model.light(settings)?;
        let expected = |j: usize| f64::from(lit.prepared.points.area[j]) / whole;
        let factors = lit.factors();
        let pairs = factors.iter().map(|&(j, factor)| (expected(j), factor));
        let name = format!("inside of a sphere, {} elements: worst pair", lit.prepared.points.len());
        cases.push(Case::worst(name, SPHERE, Tolerance::Relative(1e-4), pairs));
    }
    Ok(cases)
}

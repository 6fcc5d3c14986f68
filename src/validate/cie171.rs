//! The analytical cases of CIE 171:2006, *Test cases to assess the accuracy of lighting computer
//! programs*. Its tolerance is 5 % a point; these are held to 0.5 %. The numbers are the closed forms
//! that the cases stand for, evaluated anew. This is validation against the cases, not certification.

use super::model::{Lit, Model};
use super::shapes::walls;
use super::{Case, Tolerance};
use crate::error::Result;
use crate::material::fresnel;
use crate::scene::{Distribution, LightLevel};
use crate::settings::Settings;
use crate::spectrum::Spectrum;
use crate::tracers::TracerChoice;
use glam::DVec3;
use std::f64::consts::PI;

const POINT: &str = "5.2, Lambertian point source of 1000 cd 3 m above a plane: I0 cos^4 / h^2";
const AREA: &str =
    "5.3, source of 1 x 1 m and 1000 cd in the ceiling of a room 4 x 4 x 3 m: Lambert's polygon";
const FLUX: &str = "5.4, 10 000 lm in a closed black room 4 x 4 x 3 m: all of it arrives";
const GLASS: &str = "5.5, clear glass, n = 1.52: Fresnel's equations, inter-reflections in the pane included";
const DIFFUSE: &str = "5.6, light reflected by a floor 4 x 4 m, as a share of E rho: Lambert's polygon";
const HIDDEN: &str = "5.7, the same from a wall 4 x 3 m behind a box of 1 m (the published table is in error): \
                      Lambert's polygon over the part that shows";
const INTERREFLECTION: &str = "5.8, 10 000 lm at the centre of a cube of 4 m: rho flux / (96 m2 (1 - rho))";

const TOLERANCE: Tolerance = Tolerance::Relative(0.005);
/// Largest area of an element of a wall, m².
const AREA_OF_ELEMENTS: f64 = 0.0625;

pub fn run(tracer: TracerChoice) -> Result<Vec<Case>> {
    let settings = Settings { tracer, ..Settings::default() };
    let mut cases = Vec::new();
    for group in
        [point_source, area_source, flux, clear_glass, diffuse_reflection, obstruction, inter_reflection]
    {
        cases.extend(group(&settings)?);
    }
    Ok(cases)
}

/// Reads sensors that look along `normal` and compares: (place, lx).
fn compare<const N: usize>(
    lit: &Lit,
    source: &'static str,
    (where_, unit): (&str, &str),
    normal: [f64; 3],
    expected: [([f64; 3], f64); N],
) -> Result<Vec<Case>> {
    let readings = lit.read(expected.map(|(place, _)| (place, normal)))?;
    let case = |(([x, y, z], expected), reading): (([f64; 3], f64), &crate::measure::Reading)| Case {
        name: format!("{where_} at ({x}, {y}, {z}) m, {unit}"),
        source,
        expected,
        found: lit.lux(&reading.total()).illuminance_lx,
        // Where all is dark a share means nothing: 0.005 is what the last digit of the table can be off.
        tolerance: if expected == 0.0 { Tolerance::Absolute(0.005) } else { TOLERANCE },
    };
    Ok(expected.into_iter().zip(&readings).map(case).collect())
}

/// A room 4 x 4 x `height` m of black walls, the ceiling left out.
fn black_room(height: f64) -> Model {
    let mut model = Model::default();
    let black = model.diffuse(0.0, 0.0);
    let [sides @ .., _] = walls([0.0; 3], [4.0, 4.0, height]);
    sides.into_iter().for_each(|wall| model.quad(wall, black, f64::MAX));
    model
}

fn white() -> Spectrum {
    Spectrum::Constant(1.0)
}

fn point_source(settings: &Settings) -> Result<Vec<Case>> {
    let mut model = Model::default();
    let black = model.diffuse(0.0, 0.0);
    model.quad([[-4.0, -4.0, 0.0], [4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]], black, f64::MAX);
    let down = Distribution::Lambertian { axis: DVec3::NEG_Z };
    model.point([0.0, 0.0, 3.0], down, white(), LightLevel::LuminousIntensity(1000.0));
    let places = [
        ([0.0, 0.0, 0.0], 111.11),
        ([0.5, 0.0, 0.0], 105.19),
        ([1.0, 0.0, 0.0], 90.00),
        ([1.5, 0.0, 0.0], 71.11),
        ([0.5, 0.5, 0.0], 99.72),
        ([1.0, 0.5, 0.0], 85.66),
        ([1.5, 0.5, 0.0], 68.05),
        ([1.0, 1.0, 0.0], 74.38),
        ([1.5, 1.0, 0.0], 59.98),
        ([1.5, 1.5, 0.0], 49.38),
    ];
    compare(&model.light(settings)?, POINT, ("plane", "lx"), [0.0, 0.0, 1.0], places)
}

fn area_source(settings: &Settings) -> Result<Vec<Case>> {
    let mut model = black_room(3.0);
    let lamp = model.diffuse(0.0, 1000.0);
    model.quad([[1.5, 1.5, 3.0], [1.5, 2.5, 3.0], [2.5, 2.5, 3.0], [2.5, 1.5, 3.0]], lamp, f64::MAX);
    let lit = model.light(settings)?;
    let wall = [
        (2.75, 32.6769),
        (2.25, 75.1939),
        (1.75, 81.3232),
        (1.25, 69.0606),
        (0.75, 53.4035),
        (0.25, 40.0019),
    ];
    let floor = [(0.25, 61.4241), (0.75, 79.2552), (1.25, 95.6673), (1.75, 105.7782)];
    let wall = compare(&lit, AREA, ("wall", "lx"), [0.0, 1.0, 0.0], wall.map(|(z, e)| ([2.0, 0.0, z], e)))?;
    let floor =
        compare(&lit, AREA, ("floor", "lx"), [0.0, 0.0, 1.0], floor.map(|(y, e)| ([2.0, y, 0.0], e)))?;
    Ok([wall, floor].concat())
}

fn flux(settings: &Settings) -> Result<Vec<Case>> {
    const ROWS: usize = 20;
    let mut model = black_room(3.0);
    let [.., ceiling] = walls([0.0; 3], [4.0, 4.0, 3.0]);
    let black = model.diffuse(0.0, 0.0);
    model.quad(ceiling, black, f64::MAX);
    model.point([2.0, 2.0, 1.5], Distribution::Isotropic, white(), LightLevel::LuminousFlux(1e4));
    let lit = model.light(settings)?;
    let mut arrived = 0.0;
    for [a, b, c, d] in walls([0.0; 3], [4.0, 4.0, 3.0]).map(|wall| wall.map(DVec3::from_array)) {
        let area = (b - a).cross(d - a);
        let at = |k: usize| (k as f64 + 0.5) / ROWS as f64;
        let place = |k: usize| a.lerp(b, at(k % ROWS)).lerp(d.lerp(c, at(k % ROWS)), at(k / ROWS));
        let sensors = (0..ROWS * ROWS).map(|k| (place(k).to_array(), area.normalize().to_array()));
        let readings = lit.read(sensors)?;
        let sum: f64 = readings.iter().map(|r| lit.lux(&r.total()).illuminance_lx).sum();
        arrived += sum * area.length() / (ROWS * ROWS) as f64;
    }
    let balance = &lit.solution().stats.flux;
    let case = |name: &str, found| Case {
        name: name.into(),
        source: FLUX,
        expected: 1.0,
        found,
        tolerance: TOLERANCE,
    };
    Ok(vec![
        case("400 sensors on each wall: sum of E A / flux", arrived / 1e4),
        case("first pass: flux absorbed / flux emitted", balance.absorbed[0] / balance.emitted[0]),
    ])
}

fn clear_glass(settings: &Settings) -> Result<Vec<Case>> {
    let case =
        |name: String, expected, found, tolerance| Case { name, source: GLASS, expected, found, tolerance };
    let face = fresnel::unpolarised(1.0, 1.52, 0.0);
    let mut cases = vec![case("reflectance of one face".into(), 0.042_580, face, Tolerance::Relative(1e-4))];
    // A light 3 m above the floor; a pane 1 m above the floor.
    let mut readings = Vec::new();
    let angles = [
        (0.0, 0.918_318),
        (30.0, 0.915_957),
        (45.0, 0.902_528),
        (60.0, 0.843_471),
        (70.0, 0.724_713),
        (80.0, 0.456_043),
    ];
    let sensors = || {
        angles.map(|(degrees, _): (f64, f64)| ([3.0 * degrees.to_radians().tan(), 0.0, 0.0], [0.0, 0.0, 1.0]))
    };
    for glazed in [false, true] {
        let mut model = Model::default();
        let (black, glass) = (model.diffuse(0.0, 0.0), model.pane(1.52));
        let square = |z: f64| [[-20.0, -20.0, z], [20.0, -20.0, z], [20.0, 20.0, z], [-20.0, 20.0, z]];
        model.quad(square(0.0), black, f64::MAX);
        if glazed {
            model.quad(square(1.0), glass, 2.0);
        }
        model.point([0.0, 0.0, 3.0], Distribution::Isotropic, white(), LightLevel::LuminousIntensity(1e4));
        let lit = model.light(settings)?;
        let lux =
            lit.read(sensors())?.iter().map(|r| lit.lux(&r.total()).illuminance_lx).collect::<Vec<f64>>();
        readings.push(lux);
    }
    for (k, (degrees, expected)) in angles.into_iter().enumerate() {
        let name = format!("point light through a pane, {degrees} degrees: E with / E without");
        cases.push(case(name, expected, readings[1][k] / readings[0][k], TOLERANCE));
    }
    Ok(cases)
}

fn diffuse_reflection(settings: &Settings) -> Result<Vec<Case>> {
    // A light 100 km above gives the floor 100 lx / 0.5 everywhere and the walls next to nothing.
    const HIGH: f64 = 1e5;
    let mut model = Model::default();
    let (black, grey) = (model.diffuse(0.0, 0.0), model.diffuse(0.5, 0.0));
    let [sides @ .., floor, _] = walls([0.0; 3], [4.0, 4.0, 3.0]);
    sides.into_iter().for_each(|wall| model.quad(wall, black, f64::MAX));
    model.quad(floor, grey, AREA_OF_ELEMENTS);
    let level = LightLevel::LuminousIntensity(200.0 * HIGH * HIGH);
    model.point([2.0, 2.0, HIGH], Distribution::Isotropic, white(), level);
    let lit = model.light(settings)?;
    let wall = [(0.75, 35.9005), (1.25, 27.9916), (1.75, 21.6385), (2.25, 16.7163), (2.75, 12.9674)];
    let ceiling = [(0.25, 26.7952), (0.75, 30.9387), (1.25, 33.9757), (1.75, 35.5666)];
    let share = "%";
    let wall =
        compare(&lit, DIFFUSE, ("wall", share), [0.0, 1.0, 0.0], wall.map(|(z, e)| ([2.0, 0.0, z], e)))?;
    let ceiling = ceiling.map(|(y, e)| ([2.0, y, 3.0], e));
    let ceiling = compare(&lit, DIFFUSE, ("ceiling", share), [0.0, 0.0, -1.0], ceiling)?;
    Ok([wall, ceiling].concat())
}

fn obstruction(settings: &Settings) -> Result<Vec<Case>> {
    // The wall at y = 4 sends what one of reflectance rho under 100 lx / rho would.
    let mut model = Model::default();
    let (black, source) = (model.diffuse(0.0, 0.0), model.diffuse(0.0, 100.0 / PI));
    let [left, right, near, far, floor, _] = walls([0.0; 3], [4.0, 4.0, 3.0]);
    [left, right, near, floor].into_iter().for_each(|wall| model.quad(wall, black, f64::MAX));
    model.quad(far, source, f64::MAX);
    for [a, b, c, d] in walls([0.0, 2.5, 0.0], [4.0, 2.7, 1.0]) {
        model.quad([d, c, b, a], black, f64::MAX);
    }
    let lit = model.light(settings)?;
    let wall =
        [(2.75, 16.0706), (2.25, 16.3297), (1.75, 15.3988), (1.25, 13.3220), (0.75, 10.3169), (0.25, 7.0790)];
    let floor = [(0.25, 3.3823), (0.75, 3.6290), (1.25, 3.0130), (1.75, 0.0), (2.25, 0.0)];
    let wall = compare(&lit, HIDDEN, ("wall", "%"), [0.0, 1.0, 0.0], wall.map(|(z, e)| ([2.0, 0.0, z], e)))?;
    let floor =
        compare(&lit, HIDDEN, ("floor", "%"), [0.0, 0.0, 1.0], floor.map(|(y, e)| ([2.0, y, 0.0], e)))?;
    Ok([wall, floor].concat())
}

fn inter_reflection(settings: &Settings) -> Result<Vec<Case>> {
    const ROWS: u32 = 4;
    let mut cases = Vec::new();
    for rho in [0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95] {
        let mut model = Model::default();
        let grey = model.diffuse(rho, 0.0);
        walls([0.0; 3], [4.0; 3]).into_iter().for_each(|wall| model.quad(wall, grey, AREA_OF_ELEMENTS));
        model.point([2.0; 3], Distribution::Isotropic, white(), LightLevel::LuminousFlux(1e4));
        let lit = model.light(settings)?;
        // A quarter of the floor stands for all walls.
        let at = |k: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(ROWS);
        let floor = (0..ROWS * ROWS).map(|k| ([at(k % ROWS), at(k / ROWS), 0.0], [0.0, 0.0, 1.0]));
        let readings = lit.read(floor)?;
        let sum: f64 = readings.iter().map(|r| lit.lux(&r.indirect()).illuminance_lx).sum();
        let expected = rho * 1e4 / (96.0 * (1.0 - rho));
        let mut case = |name: String, found| {
            cases.push(Case { name, source: INTERREFLECTION, expected, found, tolerance: TOLERANCE });
        };
        case(format!("reflectance {rho}: mean indirect E, 16 sensors, lx"), sum / f64::from(ROWS * ROWS));
        let total = lit.mean(0..lit.prepared.points.len(), |i| lit.illuminance(i));
        case(format!("reflectance {rho}: mean indirect E, first pass, lx"), total - 1e4 / 96.0);
    }
    Ok(cases)
}

//! Light of sun and sky, in the open and through an opening.

use super::model::Model;
use super::{Case, Tolerance};
use crate::error::Result;
use crate::scene::{SkyLevel, SkyShape};
use crate::settings::Settings;
use crate::tracers::TracerChoice;
use glam::DVec3;
use std::f64::consts::PI;

const OPEN: &str = "closed form: pi L (uniform), 7/9 pi L (overcast), half of the first on a wall";
const STANDARD: &str = "CIE S 011/E:2003, integrated over the hemisphere by quadrature";
const SUN: &str = "definition: E cos(theta)";
const WINDOW: &str = "vertical window seen from a horizontal plane: closed form (uniform), quadrature over the window (overcast)";

/// Width, sill and head of the window, and how far the wall is from the sensor's end of the room, m.
const WINDOW_SIZE: [f64; 3] = [2.0, 1.0, 2.2];
const DEPTH: f64 = 5.0;

pub fn run(tracer: TracerChoice) -> Result<Vec<Case>> {
    let settings = Settings { tracer, ..Settings::default() };
    let half = Tolerance::Relative(0.005);
    let mut cases = Vec::new();
    let mut case = |name: String, source, expected, found, tolerance| {
        cases.push(Case { name, source, expected, found, tolerance });
    };
    let up = ([0.0; 3], [0.0, 0.0, 1.0]);
    let wall = ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]);
    for (name, kind, (position, normal), expected) in [
        ("uniform sky of 1000 cd/m2, horizontal, lx", 5, up, 1000.0 * PI),
        ("uniform sky of 1000 cd/m2, vertical, lx", 5, wall, 500.0 * PI),
        ("overcast sky of 1000 cd/m2, horizontal, lx", 16, up, 7000.0 / 9.0 * PI),
        // Integral of (1 + 2 sin g)/3 cos^2 g over the quarter sphere: (pi/4 + 2/3) 2/3.
        ("overcast sky of 1000 cd/m2, vertical, lx", 16, wall, 1000.0 * (PI / 4.0 + 2.0 / 3.0) * 2.0 / 3.0),
    ] {
        let flat = normal[2] > 0.5;
        let mut model = field(if flat { 0.2 } else { 0.0 });
        model.sky(kind, 40.0, SkyLevel::ZenithLuminance(1000.0));
        let lit = model.light(&settings)?;
        case(name.into(), OPEN, expected, lit.illuminance_at(position, normal)?, half);
        if flat {
            let found = lit.mean(lit.on(0), |i| lit.illuminance(i));
            case(format!("{name}, first pass"), OPEN, expected, found, half);
        }
    }
    for kind in 1..=15 {
        let mut model = field(0.2);
        model.sky(kind, 40.0, SkyLevel::ZenithLuminance(1000.0));
        let lit = model.light(&settings)?;
        let (sin, cos) = 40f64.to_radians().sin_cos();
        let shape = SkyShape { up: DVec3::Z, sun: DVec3::new(cos, 0.0, sin), kind };
        let expected = 1000.0 * shape.horizontal();
        let found = lit.mean(lit.on(0), |i| lit.illuminance(i));
        case(format!("standard sky {kind}, horizontal, first pass, lx"), STANDARD, expected, found, half);
    }
    let mut model = field(0.2);
    let from = DVec3::new(0.48, 0.6, 0.64);
    model.sun(from, 50_000.0);
    let lit = model.light(&settings)?;
    let found = lit.illuminance_at([0.0; 3], [0.0, 0.0, 1.0])?;
    case("sun of 50 klx at 39.8 degrees, lx".into(), SUN, 32_000.0, found, half);
    let found = lit.mean(lit.on(0), |i| lit.illuminance(i));
    case("the same, first pass, lx".into(), SUN, 32_000.0, found, half);

    for distance in [1.0, 2.0, 3.5] {
        for (name, kind, luminance) in [("uniform", 5, None), ("overcast", 16, Some(()))] {
            let mut model = room();
            model.sky(kind, 40.0, SkyLevel::ZenithLuminance(1000.0));
            let lit = model.light(&settings)?;
            let expected = 1000.0
                * match luminance {
                    None => PI * window_factor(distance),
                    Some(()) => overcast_window(distance),
                };
            let found = lit.illuminance_at([distance, 0.0, 0.0], [0.0, 0.0, 1.0])?;
            let name = format!("{name} sky through a window {distance} m away, lx");
            case(name, WINDOW, expected, found, Tolerance::Relative(0.01));
        }
    }
    Ok(cases)
}

/// A small grey field in the open.
fn field(reflectance: f64) -> Model {
    let mut model = Model::default();
    let grey = model.diffuse(reflectance, 0.0);
    model.quad([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], grey, 0.3);
    model
}

/// A black room with an opening without glass in the wall x = 0.
fn room() -> Model {
    let mut model = Model::default();
    let black = model.diffuse(0.0, 0.0);
    let [width, sill, head] = WINDOW_SIZE;
    let (a, h, d) = (3.0, 3.0, DEPTH);
    let half = 0.5 * width;
    let wall = |y: [f64; 2], z: [f64; 2]| {
        [[0.0, y[0], z[0]], [0.0, y[1], z[0]], [0.0, y[1], z[1]], [0.0, y[0], z[1]]]
    };
    for quad in [
        wall([-a, a], [0.0, sill]),
        wall([-a, a], [head, h]),
        wall([-a, -half], [sill, head]),
        wall([half, a], [sill, head]),
        [[d, -a, 0.0], [d, -a, h], [d, a, h], [d, a, 0.0]],
        [[0.0, -a, 0.0], [d, -a, 0.0], [d, a, 0.0], [0.0, a, 0.0]],
        [[0.0, -a, h], [0.0, a, h], [d, a, h], [d, -a, h]],
        [[0.0, -a, 0.0], [0.0, -a, h], [d, -a, h], [d, -a, 0.0]],
        [[0.0, a, 0.0], [d, a, 0.0], [d, a, h], [0.0, a, h]],
    ] {
        model.quad(quad, black, 1.0);
    }
    model
}

/// Configuration factor from a horizontal plane element to the window, `x` away from its middle: half of it is a rectangle
/// with a corner straight ahead, down to the plane of the element (Hopkinson, Petherbridge and Longmore, 1966).
fn window_factor(x: f64) -> f64 {
    let [width, sill, head] = WINDOW_SIZE;
    let half = |height: f64| {
        let (m, n) = (height / x, 0.5 * width / x);
        let root = (1.0 + m * m).sqrt();
        (n.atan() - (n / root).atan() / root) / (2.0 * PI)
    };
    2.0 * (half(head) - half(sill))
}

/// Illuminance over the luminance of the zenith of an overcast sky through the window: the sum over pieces of it.
fn overcast_window(x: f64) -> f64 {
    const STEPS: u32 = 400;
    let [width, sill, head] = WINDOW_SIZE;
    let share = |k: u32| (f64::from(k) + 0.5) / f64::from(STEPS);
    let piece = width * (head - sill) / f64::from(STEPS * STEPS);
    let at = |i: u32, k: u32| {
        let (y, z) = ((share(i) - 0.5) * width, sill + share(k) * (head - sill));
        let distance2 = x * x + y * y + z * z;
        let sine = z / distance2.sqrt();
        (1.0 + 2.0 * sine) / 3.0 * sine * x / (distance2 * distance2.sqrt()) * piece
    };
    (0..STEPS).flat_map(|i| (0..STEPS).map(move |k| (i, k))).map(|(i, k)| at(i, k)).sum()
}

//! A luminaire by its table of intensities, over a plane: E = I(γ, C) cos θ / r².

use super::model::Model;
use super::{Case, Tolerance};
use crate::error::{Error, Result};
use crate::scene::{Distribution, LightLevel, Web, WebType};
use crate::settings::Settings;
use crate::spectrum::Spectrum;
use crate::tracers::TracerChoice;
use glam::{DMat3, DVec3};
use std::sync::Arc;

const LAW: &str =
    "the table's intensity, linear between its angles, by the inverse square and the cosine law";

/// Candela at 0, 30, 60 and 90 degrees from nadir, in the planes C = 0, 90 and 180 degrees.
const VERTICAL: [f64; 4] = [0.0, 30.0, 60.0, 90.0];
const HORIZONTAL: [f64; 3] = [0.0, 90.0, 180.0];
const CANDELA: [[f64; 4]; 3] =
    [[800.0, 950.0, 400.0, 0.0], [800.0, 700.0, 250.0, 20.0], [800.0, 500.0, 100.0, 0.0]];

/// Height of the luminaire above the plane, and the sides of its opening when it is not a point, m.
const HEIGHT: f64 = 3.0;
const OPENING: [f64; 2] = [0.06, 0.04];

pub fn run(tracer: TracerChoice) -> Result<Vec<Case>> {
    let settings = Settings { tracer, ..Settings::default() };
    let grid = || (-2..=2).flat_map(|i| (-2..=2).map(move |k| [0.9 * f64::from(i), 0.8 * f64::from(k)]));
    // An opening fifty times smaller than the distance is a point within half a per cent, even where the table bends.
    let spread: Vec<[f64; 2]> = (0..3)
        .flat_map(|i| (0..2).map(move |k| [(f64::from(i) - 1.0) / 3.0, (f64::from(k) - 0.5) / 2.0]))
        .collect();
    let spread = spread.iter().map(|[u, v]| [u * OPENING[0], v * OPENING[1]]).collect();
    let mut cases = Vec::new();
    for (name, places, tolerance) in [("point", vec![[0.0; 2]], 0.001), ("0.06 x 0.04 m", spread, 0.005)] {
        let found = illuminance(&settings, &places, grid())?;
        for ([x, y], found) in grid().zip(found) {
            let expected = expected(x, y);
            let name = format!("luminaire by its table, {name}, {HEIGHT} m above ({x:.1}, {y:.1}), lx");
            cases.push(Case {
                name,
                source: LAW,
                expected,
                found,
                tolerance: Tolerance::Relative(tolerance),
            });
        }
    }
    Ok(cases)
}

/// The table between its angles, cd: C beyond 180 degrees mirrors what is before.
fn intensity(gamma: f64, c: f64) -> f64 {
    let c = if c > 180.0 { 360.0 - c } else { c };
    let (i, k) = (((gamma / 30.0) as usize).min(2), ((c / 90.0) as usize).min(1));
    let (f, g) = (gamma / 30.0 - i as f64, c / 90.0 - k as f64);
    let along = |k: usize| (1.0 - f) * CANDELA[k][i] + f * CANDELA[k][i + 1];
    (1.0 - g) * along(k) + g * along(k + 1)
}

/// Illuminance of the plane at (x, y) from the luminaire above the origin, lx.
fn expected(x: f64, y: f64) -> f64 {
    let r2 = x * x + y * y + HEIGHT * HEIGHT;
    let cos = HEIGHT / r2.sqrt();
    intensity(cos.acos().to_degrees(), y.atan2(x).to_degrees().rem_euclid(360.0)) * cos / r2
}

/// What sensors on a black floor read under a luminaire of so many points beside the origin.
fn illuminance(
    settings: &Settings,
    lamps: &[[f64; 2]],
    grid: impl Iterator<Item = [f64; 2]>,
) -> Result<Vec<f64>> {
    let candela = CANDELA.concat();
    let largest = candela.iter().copied().fold(0.0, f64::max);
    let web = Web::new(WebType::C, VERTICAL.to_vec(), HORIZONTAL.to_vec(), candela, None)
        .map_err(|(why, _)| Error::Numerical(why.into()))?;
    let web = Arc::new(web);
    let mut model = Model::default();
    let black = model.diffuse(0.0, 0.0);
    model.quad([[-3.0, -3.0, 0.0], [3.0, -3.0, 0.0], [3.0, 3.0, 0.0], [-3.0, 3.0, 0.0]], black, f64::MAX);
    for [x, y] in lamps {
        let distribution = Distribution::Web { web: web.clone(), frame: DMat3::IDENTITY };
        let level = LightLevel::LuminousIntensity(largest / lamps.len() as f64);
        model.point([*x, *y, HEIGHT], distribution, Spectrum::Constant(1.0), level);
    }
    let lit = model.light(settings)?;
    let sensors = grid.map(|[x, y]| ([x, y, 0.0], DVec3::Z.to_array()));
    Ok(lit.read(sensors)?.iter().map(|r| lit.lux(&r.total()).illuminance_lx).collect())
}

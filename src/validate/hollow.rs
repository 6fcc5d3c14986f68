//! Form factors in closed cylinders and cones, from wall to end and from end to wall, and whether they add up.

use super::model::Model;
use super::shapes::closed_cone;
use super::{Case, Tolerance};
use crate::error::Result;
use crate::settings::Settings;
use std::f64::consts::PI;

const CLOSED: &str = "closed form: reciprocity and sums over coaxial discs (Howell, A Catalog of Radiation Heat \
                      Transfer Configuration Factors)";
const CLOSURE: &str = "sum over a closed vessel: 1";

/// So little is sent back that only light straight from the emitter counts.
const DARK: f64 = 1e-5;

/// Radius, radius at the top and height.
type Vessel = [f64; 3];

pub fn run(settings: &Settings) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    let vessels = [
        ("cylinder, radius 1, height 2", [1.0, 1.0, 2.0]),
        ("cylinder, radius 1, height 0.5", [1.0, 1.0, 0.5]),
        ("cone, radius 1, height 1", [1.0, 0.0, 1.0]),
        ("cone cut off, radii 1 and 0.5, height 1", [1.0, 0.5, 1.0]),
    ];
    for (name, vessel) in vessels {
        let [radius, top, height] = vessel;
        let between = between_discs(vessel);
        let wall = (radius + top) * (radius - top).hypot(height);
        let mut compare = |what: &str, expected: f64, found: f64| {
            let (name, tolerance) = (format!("inside of a {name}: {what}"), Tolerance::Relative(0.005));
            cases.push(Case { name, source: CLOSED, expected, found, tolerance });
        };
        compare("base to wall", 1.0 - between, factor(settings, vessel, 0, 1)?);
        let to_base = radius * radius * (1.0 - between) / wall;
        compare("wall to base", to_base, factor(settings, vessel, 1, 0)?);
        let mut model = Model::default();
        let grey = model.diffuse(0.5, 1.0);
        closed_cone(radius, top, height).into_iter().for_each(|shape| model.add(shape, grey, 0.02));
        let row_sum = model.light(settings)?.solution().stats.row_sum;
        let sums = [row_sum.min, row_sum.max].map(|found| (1.0, found));
        let name = format!("inside of a {name}: sum of factors of the worst point");
        cases.push(Case::worst(name, CLOSURE, Tolerance::Absolute(1e-4), sums));
    }
    Ok(cases)
}

/// Factor between the ends.
fn between_discs([radius, top, height]: Vessel) -> f64 {
    let (a, b) = (radius / height, top / height);
    let x = 1.0 + (1.0 + b * b) / (a * a);
    0.5 * (x - (x * x - 4.0 * (b / a).powi(2)).sqrt())
}

/// Factor to one from another of the wall (0), the base (1) and the top (2).
fn factor(settings: &Settings, [radius, top, height]: Vessel, to: usize, from: usize) -> Result<f64> {
    let mut model = Model::default();
    let (lamp, dark) = (model.diffuse(0.0, 1.0), model.diffuse(DARK, 0.0));
    for (s, shape) in closed_cone(radius, top, height).into_iter().enumerate() {
        model.add(shape, if s == to { lamp } else { dark }, 0.01 * height);
    }
    let lit = model.light(settings)?;
    Ok(lit.mean(lit.on(from), |i| lit.illuminance(i)) / PI)
}

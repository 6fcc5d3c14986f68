//! Closed shapes whose light is known: every wall emits E and reflects the same share ρ, and so
//! every wall has the radiance E / (1 - ρ), whatever the shape.

use super::model::{Lit, Model};
use super::shapes::{sphere, walls};
use super::{Case, Tolerance};
use crate::error::Result;
use crate::geometry::Shape;
use crate::settings::Settings;
use crate::tracers::TracerChoice;
use glam::DVec3;
use std::f64::consts::PI;

const FURNACE: &str = "energy balance: E / (1 - reflectance) everywhere";

pub fn run(tracer: TracerChoice) -> Result<Vec<Case>> {
    let settings = Settings { tracer, ..Settings::default() };
    let mut cases = Vec::new();
    for rho in [0.95, 0.99] {
        for n in [1, 2, 4, 8, 16] {
            let name = format!("unit cube, reflectance {rho}, {n} x {n} elements a face");
            let area = 1.0 / f64::from(n * n);
            cases.push(furnace(&settings, name, &box_room([0.0; 3], [1.0; 3]), area, rho)?);
        }
    }
    let room = box_room([0.0; 3], [4.0, 4.0, 3.0]);
    cases.push(furnace(&settings, "room 4 x 4 x 3 m, reflectance 0.95".into(), &room, 0.1, 0.95)?);
    let corridor = box_room([0.0; 3], [1.0, 20.0, 1.0]);
    cases.push(furnace(&settings, "corridor 1 x 20 x 1 m, reflectance 0.95".into(), &corridor, 0.1, 0.95)?);
    let slot = box_room([0.0; 3], [0.01, 1.0, 10.0]);
    cases.push(furnace(&settings, "slot 0.01 x 1 x 10 m, reflectance 0.95".into(), &slot, 0.02, 0.95)?);
    cases.push(furnace(&settings, "tetrahedron, reflectance 0.95".into(), &tetrahedron(), 5e-3, 0.95)?);
    for elements in [16.0, 256.0, 4096.0] {
        let name = format!("unit sphere, reflectance 0.95, {elements} elements");
        cases.push(furnace(
            &settings,
            name,
            &[sphere([0.0; 3], 1.0, true)],
            1.01 * 4.0 * PI / elements,
            0.95,
        )?);
    }
    // Where something hides something, visibility from centre to centre sets the limit.
    let (mut boxed, mut around_ball) = (room.clone(), room);
    around_ball.push(sphere([1.7, 1.9, 1.3], 0.7, false));
    let outside = walls([1.0, 1.0, 1.0], [2.0, 2.0, 2.0]).map(|[a, b, c, d]| [d, c, b, a]);
    boxed.extend(outside.map(|corners| Shape::Quad(corners.map(DVec3::from_array))));
    for (name, shapes, max_area) in [
        ("L-shaped room 2 x 2 x 1 m, reflectance 0.8", l_room(), 0.01),
        ("room 4 x 4 x 3 m around a box, reflectance 0.8", boxed, 0.04),
        ("room 4 x 4 x 3 m around a ball, reflectance 0.8", around_ball, 0.04),
    ] {
        let lit = light(&settings, &shapes, max_area, 0.8)?;
        let points = || 0..lit.prepared.points.len();
        let mean = lit.mean(points(), |i| lit.luminance(i));
        let case = |what: &str, share, found: &mut dyn Iterator<Item = f64>| {
            let pairs = found.map(|l| (5.0, l));
            Case::worst(format!("{name}, {what}, cd/m2"), FURNACE, Tolerance::Relative(share), pairs)
        };
        cases.push(case("mean", 0.005, &mut std::iter::once(mean)));
        cases.push(case("worst point", 0.01, &mut points().map(|i| lit.luminance(i))));
    }
    Ok(cases)
}

/// The scene in which every wall has this reflectance and emits 1 cd/m².
fn light<'a>(settings: &'a Settings, shapes: &[Shape], max_area: f64, rho: f64) -> Result<Lit<'a>> {
    let mut model = Model::default();
    let wall = model.diffuse(rho, 1.0);
    shapes.iter().for_each(|shape| model.add(shape.clone(), wall, max_area));
    model.light(settings)
}

/// The point furthest from E / (1 - ρ). Within 0.1 % everywhere.
fn furnace(settings: &Settings, name: String, shapes: &[Shape], max_area: f64, rho: f64) -> Result<Case> {
    let lit = light(settings, shapes, max_area, rho)?;
    let expected = 1.0 / (1.0 - rho);
    let points = (0..lit.prepared.points.len()).map(|i| (expected, lit.luminance(i)));
    Ok(Case::worst(format!("{name}, worst point, cd/m2"), FURNACE, Tolerance::Relative(1e-3), points))
}

fn box_room(low: [f64; 3], high: [f64; 3]) -> Vec<Shape> {
    walls(low, high).map(|corners| Shape::Quad(corners.map(DVec3::from_array))).to_vec()
}

/// The corner x, y, z >= 0, x + y + z <= 1, seen from within.
fn tetrahedron() -> Vec<Shape> {
    let [o, x, y, z] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    [[o, x, y], [o, y, z], [o, z, x], [x, z, y]].map(Shape::Triangle).to_vec()
}

/// Two cubes of 1 m to the sides of a third, seen from within.
fn l_room() -> Vec<Shape> {
    let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let at = |[x, y]: [f64; 2], z: f64| DVec3::new(x, y, z);
    let wall = |k: usize| {
        let (a, b) = (outline[k], outline[(k + 1) % 6]);
        Shape::Quad([at(a, 0.0), at(a, 1.0), at(b, 1.0), at(b, 0.0)])
    };
    let floors = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].into_iter().flat_map(|[x, y]| {
        let square = [[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]];
        let [a, b, c, d] = square.map(|c| at(c, 1.0));
        [Shape::Quad(square.map(|c| at(c, 0.0))), Shape::Quad([a, d, c, b])]
    });
    (0..6).map(wall).chain(floors).collect()
}

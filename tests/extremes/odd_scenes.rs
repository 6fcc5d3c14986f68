//! Scenes with hardly anything in them, and eyes in odd places.

use super::lit::{Lit, all_tracers, light, light_of, tight};
use super::model::{Model, Quad, block, glowing};
use super::table::Table;
use glam::DVec3;
use luxgraph::settings::Settings;
use luxgraph::tracers::TracerChoice;
use std::f64::consts::PI;

/// Some quads that wear "wall", one sample point each, seen from above.
fn plain(quads: Vec<Quad>, rho: f64, emission: f64) -> Model {
    Model {
        quads: quads.into_iter().map(|q| ("wall", q)).collect(),
        triangles: Vec::new(),
        materials: glowing("wall", rho, emission),
        max_area: 100.0,
        eye: DVec3::new(0.0, 0.0, 2.0),
        target: DVec3::ZERO,
    }
}

fn square(z: f64, up: bool) -> Quad {
    let at = |x: f64, y: f64| DVec3::new(x, y, z);
    let corners = [at(-0.5, -0.5), at(0.5, -0.5), at(0.5, 0.5), at(-0.5, 0.5)];
    if up { corners } else { [corners[3], corners[2], corners[1], corners[0]] }
}

#[test]
fn one_point_two_points_and_no_light() {
    let mut table = Table::new("hardly anything");
    for tracer in all_tracers() {
        let lit = light(&plain(vec![square(0.0, true)], 0.5, 1.0), tracer).expect("one quad");
        assert_eq!(lit.points.len(), 1);
        table.all(&format!("one quad, {tracer:?}, B = E"), lit.emission(0), lit.all(), 0.0);
        let brightest = lit.pixels().into_iter().fold(0.0, f64::max);
        table.relative(&format!("one quad, {tracer:?}, brightest pixel"), lit.emission(0), brightest, 1e-6);

        let behind = light(&plain(vec![square(0.0, false)], 0.5, 1.0), tracer).expect("its back");
        table.absolute(&format!("its back, {tracer:?}, pixels"), 0.0, behind.pixels().iter().sum(), 0.0);

        let mut triangle = plain(vec![], 0.5, 1.0);
        let [a, b, c, _] = square(0.0, true);
        triangle.triangles = vec![("wall", [a, b, c])];
        let lit = light(&triangle, tracer).expect("one triangle");
        table.all(&format!("one triangle, {tracer:?}, B = E"), lit.emission(0), lit.all(), 0.0);

        // From the middle of a square the opposite one, as far away as it is wide, subtends F.
        let x = 0.5;
        let root = f64::sqrt(1.0 + x * x);
        let f = 4.0 / PI * x / root * f64::atan(x / root);
        let lit = light(&plain(vec![square(0.0, true), square(1.0, false)], 0.8, 1.0), tracer).expect("two");
        assert_eq!(lit.points.len(), 2);
        table.all(
            &format!("two points, {tracer:?}, B = E/(1 - rho F)"),
            lit.emission(0) / (1.0 - 0.8 * f),
            lit.all(),
            1e-5,
        );

        for (name, model) in
            [("no light", Model::furnace(0.9, 0.0)), ("no light, no reflectance", Model::furnace(0.0, 0.0))]
        {
            let lit = light(&model, tracer).expect(name);
            let sum = lit.all().iter().chain(&lit.pixels()).sum::<f64>();
            table.absolute(&format!("{name}, {tracer:?}, all"), 0.0, sum, 0.0);
        }
        let lit = light(&Model::furnace(0.0, 1.0), tracer).expect("only lights");
        table.all(&format!("only lights, {tracer:?}, B = E"), lit.emission(0), lit.all(), 1e-6);
    }
    table.judge();
}

#[test]
fn a_thousand_quads_in_one_place() {
    let mut table = Table::new("a thousand quads in one place");
    for tracer in all_tracers() {
        let lit = light(&plain(vec![square(0.0, true); 1000], 0.5, 1.0), tracer).expect("a thousand");
        table.all(&format!("{tracer:?}, B = E"), lit.emission(0), lit.all(), 0.0);
    }
    table.judge();
}

#[test]
fn eyes_in_walls_and_far_away() {
    let mut table = Table::new("furnace with a block in it: least and largest pixel");
    let mut model = Model::furnace(0.5, 1.0);
    model.quads.extend(block(DVec3::splat(-0.2), DVec3::splat(0.2)).into_iter().map(|q| ("wall", q)));
    let v = DVec3::new;
    for tracer in all_tracers() {
        let mut check = |case: &str, eye: DVec3, target: DVec3, expected: f64| {
            let lit: Lit =
                light(&Model { eye, target, ..model.clone() }, tracer).expect("a room with a block");
            let pixels = lit.pixels();
            let (low, high) = pixels.iter().fold((f64::INFINITY, 0.0f64), |(l, h), &p| (l.min(p), h.max(p)));
            let e = lit.emission(0);
            table.absolute(&format!("{case}, {tracer:?}, least / E"), expected, low / e, 0.1);
            table.absolute(&format!("{case}, {tracer:?}, largest / E"), expected, high / e, 0.1);
        };
        check("in the room", v(-0.8, 0.1, 0.2), v(1.0, 0.0, 0.0), 2.0);
        check("on a wall, looking in", v(-1.0, 0.1, 0.2), v(1.0, 0.0, 0.0), 2.0);
        check("on a wall, looking out", v(-1.0, 0.1, 0.2), v(-2.0, 0.0, 0.0), 0.0);
        check("inside the block", v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), 0.0);
        check("on the block, looking in", v(-0.2, 0.0, 0.0), v(1.0, 0.0, 0.0), 0.0);
        check("1e9 m away", v(1e9, 1e8, 1e7), v(0.0, 0.0, 0.0), 0.0);
        check("1e18 m away", v(1e18, 1e17, 1e16), v(0.0, 0.0, 0.0), 0.0);
    }
    table.judge();
}

#[test]
fn what_asks_for_too_much_is_refused() {
    let mut table = Table::new("asking for too much");
    let mut model = Model::furnace(0.5, 1.0);
    for (area, what) in [
        (1e-7, "max_area"),
        (1e-300, "max_area"),
        (0.0, "positive"),
        (-1.0, "positive"),
        (f64::NAN, "positive"),
    ] {
        model.max_area = area;
        let toml = model.toml().replace("NaN", "nan");
        let answer = light_of(&toml, &Settings { tracer: TracerChoice::Voxel, ..tight() });
        table.refused(&format!("max_area {area:e}"), answer, what);
    }
    table.judge();
}

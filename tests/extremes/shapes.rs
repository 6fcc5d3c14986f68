//! Thin, long, touching and crossing surfaces.

use super::lit::{all_tracers, light};
use super::model::{Model, block, glowing};
use super::table::Table;
use glam::DVec3;
use luxgraph::tracers::TracerChoice;

#[test]
fn thin_slabs_and_long_strips_are_furnaces_too() {
    let mut table = Table::new("closed boxes, rho 0.5, B = 2 E: mean and worst point");
    for tracer in all_tracers() {
        for (name, size, elements) in [
            ("1 x 1 x 1e-2", DVec3::new(1.0, 1.0, 1e-2), 200.0),
            ("1 x 1 x 1e-5", DVec3::new(1.0, 1.0, 1e-5), 200.0),
            ("100 x 0.01 x 0.01 (aspect ratio 1e4)", DVec3::new(100.0, 0.01, 0.01), 200.0),
            ("100 x 0.01 x 0.01, finer", DVec3::new(100.0, 0.01, 0.01), 3000.0),
            ("1e4 x 1 x 1 (aspect ratio 1e4)", DVec3::new(1e4, 1.0, 1.0), 200.0),
        ] {
            let model = Model::closed_box(-0.5 * size, 0.5 * size, glowing("wall", 0.5, 1.0), elements);
            let lit = light(&model, tracer).unwrap_or_else(|e| panic!("{name}: {e}"));
            let expected = 2.0 * lit.emission(0);
            table.relative(&format!("{name}, {tracer:?}, mean"), expected, lit.mean(), 5e-3);
            table.all(&format!("{name}, {tracer:?}, worst point"), expected, lit.all(), 2e-3);
        }
    }
    table.judge();
}

/// The furnace with something in it that must not be felt.
fn with(quads: Vec<[DVec3; 4]>) -> Model {
    let mut model = Model::furnace(0.5, 1.0);
    model.quads.extend(quads.into_iter().map(|q| ("both", q)));
    model.materials += &(glowing("both", 0.5, 1.0) + "two_sided = true\n");
    model
}

fn square(centre: DVec3, u: DVec3, v: DVec3) -> [DVec3; 4] {
    [centre - u - v, centre + u - v, centre + u + v, centre - u + v]
}

#[test]
fn surfaces_that_touch_cross_or_all_but_meet_leave_a_furnace_alone() {
    let mut table =
        Table::new("furnace, rho 0.5, B = 2 E, with two squares in it: mean of the walls; all points");
    let (x, y, z) = (0.3 * DVec3::X, 0.3 * DVec3::Y, 0.2 * DVec3::Z);
    let pair = |gap: f64| vec![square(DVec3::ZERO, x, y), square(gap * DVec3::Z, x, y)];
    let cases = [
        ("side by side, one edge in common", vec![square(-x, x, y), square(x, x, y)]),
        ("at right angles, one edge in common", vec![square(-x, x, y), square(z, y, z)]),
        ("crossing at right angles", vec![square(DVec3::ZERO, x, y), square(DVec3::ZERO, x, z)]),
        ("crossing at 0.001 rad", vec![square(DVec3::ZERO, x, y), square(DVec3::ZERO, x, y + 1e-3 * z)]),
        ("0.1 apart", pair(0.1)),
        ("1e-3 apart", pair(1e-3)),
        ("1e-5 apart", pair(1e-5)),
        ("1e-7 apart", pair(1e-7)),
        ("one and the same place", pair(0.0)),
        ("a slab 1e-5 thick", block(DVec3::new(-0.4, -0.4, 0.0), DVec3::new(0.4, 0.4, 1e-5))),
        ("flat on a wall", vec![square(-0.5 * DVec3::Z, x, y)]),
        ("1e-7 above a wall", vec![square((1e-7 - 0.5) * DVec3::Z, x, y)]),
        ("through a wall", vec![square(-0.5 * DVec3::Z, x, z)]),
    ];
    for tracer in all_tracers() {
        for (name, quads) in &cases {
            let lit = light(&with(quads.clone()), tracer).unwrap_or_else(|e| panic!("{name}: {e}"));
            let emission = lit.emission(0);
            let walls = lit.on(|s| s.index() < 6);
            let mean = walls.iter().sum::<f64>() / walls.len() as f64;
            let found = lit.all();
            let (low, high) = (
                found.iter().copied().fold(f64::INFINITY, f64::min) / emission,
                found.iter().copied().fold(0.0, f64::max) / emission,
            );
            table.relative(&format!("{name}, {tracer:?}, walls"), 2.0 * emission, mean, 2e-2);
            // What a cover leaves no light has its own glow at least, and nobody more than the furnace.
            println!("{name}: from {low} to {high} E");
            table.absolute(&format!("{name}, {tracer:?}, below E"), 0.0, (1.0 - low).max(0.0), 1e-6);
            table.absolute(&format!("{name}, {tracer:?}, above 2 E"), 0.0, (high / 2.0 - 1.0).max(0.0), 5e-2);
        }
    }
    table.judge();
}

#[test]
fn shapes_below_what_numbers_tell_apart_are_refused_or_harmless() {
    let mut table = Table::new("degenerate shapes");
    let voxel = TracerChoice::Voxel;
    let line = vec![square(DVec3::ZERO, 0.3 * DVec3::X, 1e-9 * DVec3::Y)];
    table.refused("a quad 0.6 by 2e-9", light(&with(line), voxel), "area");
    let speck = vec![square(DVec3::ZERO, 1e-9 * DVec3::X, 1e-9 * DVec3::Y)];
    let lit = light(&with(speck), voxel).expect("a quad of 2e-9");
    table.all("a quad of 2e-9", 2.0 * lit.emission(0), lit.all(), 2e-2);
    let speck = vec![square(0.3 * DVec3::X, 1e-9 * DVec3::X, 1e-9 * DVec3::Y)];
    table.refused("a quad of 2e-9 at 0.3 m", light(&with(speck), voxel), "area");
    let denormal = vec![square(DVec3::ZERO, 1e-39 * DVec3::X, 1e-39 * DVec3::Y)];
    let lit = light(&with(denormal), voxel).expect("a quad of 2e-39");
    table.all("a quad of 2e-39", 2.0 * lit.emission(0), lit.all(), 2e-2);
    let offset = vec![square(DVec3::splat(1e-310), 0.3 * DVec3::X, 0.3 * DVec3::Y)];
    let lit = light(&with(offset), voxel).expect("a quad moved by 1e-310");
    table.relative("a quad moved by 1e-310", 2.0 * lit.emission(0), lit.mean(), 1e-2);
    table.judge();
}

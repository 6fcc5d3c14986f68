//! Scenes of every size and place.

use super::lit::{Lit, all_tracers, light};
use super::model::Model;
use super::table::Table;
use glam::DVec3;
use luxgraph::tracers::TracerChoice;

/// The largest relative deviation of a point or pixel from its counterpart.
fn deviation(found: &Lit, expected: &Lit) -> f64 {
    assert_eq!(found.radiance.len(), expected.radiance.len());
    let largest = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs() / b.max(f32::MIN_POSITIVE))).fold(0.0, f64::max)
    };
    largest(&found.radiance, &expected.radiance).max(largest(&found.image, &expected.image))
}

#[test]
fn a_furnace_of_any_size_and_place() {
    let mut table = Table::new("furnace, rho 0.5, B = 2 E: all points and pixels");
    let model = Model::furnace(0.5, 1.0);
    for tracer in all_tracers() {
        let mut check = |case: String, model: &Model| {
            let lit = light(model, tracer).unwrap_or_else(|e| panic!("{case}: {e}"));
            let expected = 2.0 * lit.emission(0);
            table.all(&format!("{case}, {tracer:?}, points"), expected, lit.all(), 2e-4);
            table.all(&format!("{case}, {tracer:?}, pixels"), expected, lit.pixels(), 2e-4);
        };
        for scale in [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e12, 1e17] {
            check(format!("scale {scale:e}"), &model.placed(scale, DVec3::ZERO));
        }
        for away in [1e3, 1e6, -1e9] {
            let place = DVec3::new(away, -0.7 * away, 0.3 * away);
            check(format!("{away:e} m away"), &model.placed(1.0, place));
        }
    }
    table.judge();
}

#[test]
fn a_furnished_room_at_a_power_of_two_has_the_same_bits() {
    let mut table = Table::new("furnished furnace, scaled by a power of two: bits that differ");
    let mut model = Model::furnished_furnace(0.6, 1.0);
    // A wall of gold and a lamp that is brighter than the rest: nothing is uniform.
    model.quads[0].0 = "gold";
    model.quads[5].0 = "lamp";
    model.materials += "[materials.gold]\nfresnel = \"gold\"\nspecular = 0.8\nroughness = 0.2\n";
    model.materials += &super::model::glowing("lamp", 0.2, 30.0);
    for tracer in all_tracers() {
        let expected = light(&model, tracer).expect("at scale 1");
        for power in [-39, -20, -7, 1, 20, 40] {
            let found = light(&model.placed(2f64.powi(power), DVec3::ZERO), tracer).expect("at any scale");
            let differ = |a: &[f32], b: &[f32]| {
                assert_eq!(a.len(), b.len());
                a.iter().zip(b).filter(|(a, b)| a.to_bits() != b.to_bits()).count() as f64
            };
            table.absolute(
                &format!("2^{power}, {tracer:?}, points"),
                0.0,
                differ(&found.radiance, &expected.radiance),
                0.0,
            );
            table.absolute(
                &format!("2^{power}, {tracer:?}, pixels"),
                0.0,
                differ(&found.image, &expected.image),
                0.0,
            );
            table.absolute(
                &format!("2^{power}, {tracer:?}, largest difference"),
                0.0,
                deviation(&found, &expected),
                0.0,
            );
        }
    }
    table.judge();
}

#[test]
fn a_furnished_room_at_any_scale_and_place_has_the_same_light() {
    let mut table = Table::new("furnished furnace, moved: mean of all points, largest deviation of one");
    let model = Model::furnished_furnace(0.6, 1.0);
    for tracer in all_tracers() {
        let expected = light(&model, tracer).expect("at scale 1");
        let moves = [1e-6, 1e-3, 0.3, 1e3, 1e6].map(|s| (s, DVec3::ZERO));
        let away = [1e2, 1e4, 1e6].map(|d| (1.0, DVec3::new(d, 0.1 * d, -d)));
        for (scale, place) in moves.into_iter().chain(away) {
            let found = light(&model.placed(scale, place), tracer).expect("at any place");
            let case = format!("scale {scale:e}, {:e} m away, {tracer:?}", place.length());
            table.relative(&format!("{case}, mean"), expected.mean(), found.mean(), 1e-6);
            table.absolute(&format!("{case}, largest"), 0.0, deviation(&found, &expected), 1e-5);
        }
    }
    table.judge();
}

#[test]
fn where_numbers_end_there_is_an_error_that_says_so() {
    let mut table = Table::new("places and sizes that no number holds");
    let model = Model::furnace(0.5, 1.0);
    // At 1e17 m neighbouring f64 are 16 m apart: the room is no room any more.
    table.refused("1e17 m away", light(&model.placed(1.0, DVec3::splat(1e17)), TracerChoice::Voxel), "area");
    table.refused("scale 1e19", light(&model.placed(1e19, DVec3::ZERO), TracerChoice::Voxel), "1e18");
    for (scale, what) in
        [(1e-13, "radius"), (1e-30, "radius"), (1e-40, "radius"), (1e-160, "area"), (1e-320, "area")]
    {
        let case = format!("scale {scale:e}");
        table.refused(&case, light(&model.placed(scale, DVec3::ZERO), TracerChoice::Voxel), what);
    }
    table.judge();
}

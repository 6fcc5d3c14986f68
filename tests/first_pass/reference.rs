//! Are the extended form factors those of the paper's algorithm?

use crate::small_scenes::*;
use glam::DVec3;
use luxgraph::first_pass::diffuse::DiffuseOperator;
use luxgraph::first_pass::reference::{evaluate, extended_form_factors};
use luxgraph::first_pass::system::System;
use luxgraph::first_pass::{ChainLimits, FirstPassSettings, visibility_calls};
use luxgraph::observer::Silent;

/// Compares all EFF, each row (receiver) relative to its largest entry; returns the literal count of
/// calls and the counted one.
fn compare(scene: &TestScene, lg_max: u32) -> (f64, f64) {
    let settings = FirstPassSettings::default();
    let diffuse =
        DiffuseOperator::new(&scene.geometry, &scene.points, &scene.graph, settings.kernel, &Silent);
    let system = System::new(&scene.geometry, &diffuse, &scene.appearance, &settings, &Silent);
    let limits = ChainLimits { lg_max: Some(lg_max), eff_min: 0.0, tolerance: 0.0 };
    let found = extended_form_factors(&system, &limits);
    let tolerance = scene.geometry.plane_tolerance() as f32;
    let expected = evaluate(&system, &scene.graph, tolerance, lg_max, 0.0);
    let n = scene.points.len();
    let (mut worst, mut chains) = (0.0f64, 0.0f64);
    let direct = extended_form_factors(&system, &ChainLimits { lg_max: Some(0), ..limits });
    for i in 0..n {
        let row = |v: &[f64]| -> Vec<f64> { (0..n).map(|j| v[(j * n + i) * W]).collect() };
        let (a, b, d) = (row(&found.values), row(&expected.values), row(&direct.values));
        let largest = b.iter().copied().fold(0.0, f64::max);
        for j in 0..n {
            if largest > 0.0 {
                worst = worst.max((a[j] - b[j]).abs() / largest);
                chains = chains.max((b[j] - d[j]) / largest);
            }
        }
    }
    println!(
        "{n} points, {} specular: worst {worst:.2e}, chains up to {chains:.3}",
        system.specular.points.len()
    );
    assert!(n > 100 && chains > 0.01, "the scene does not test chains: {n} points, {chains}");
    assert!(worst < 1e-4, "{worst}");
    let counted = visibility_calls::count(&scene.points, &system.specular, tolerance, lg_max);
    (expected.visibility_calls as f64, counted)
}

fn sheet(z: f64) -> [DVec3; 4] {
    let v = |x, y| DVec3::new(x, y, z);
    [v(0.25, 0.25), v(0.75, 0.25), v(0.75, 0.75), v(0.25, 0.75)]
}

#[test]
fn facing_mirrors() {
    let materials = vec![diffuse(0.5, 0.0), glossy(0.8, 0.9, 0.0, 0.1, 0.0)];
    let quads = room(DVec3::ZERO, DVec3::new(1.0, 1.0, 2.0), [0, 0, 0, 0, 1, 1]);
    let scene = TestScene::new(&quads, materials, 1.0 / 16.0);
    let (literal, counted) = compare(&scene, 2);
    assert_eq!(literal, counted);
}

#[test]
fn facing_mirrors_and_a_pane() {
    let materials = vec![diffuse(0.5, 0.0), glossy(0.9, 0.9, 0.05, 0.1, 0.0), pane(0.1, 0.85)];
    let mut quads = cube([1, 1, 0, 0, 0, 0]);
    quads.push((sheet(0.5), 2, true));
    compare(&TestScene::new(&quads, materials, 1.0 / 16.0), 2);
}

#[test]
fn an_absorbing_block_of_glass() {
    let materials = vec![diffuse(0.5, 0.0), solid(1.5, 0.7)];
    let mut quads = cube([0; 6]);
    quads.extend(block(DVec3::splat(0.3), DVec3::splat(0.7), 1, true));
    compare(&TestScene::new(&quads, materials, 1.0 / 16.0), 3);
}

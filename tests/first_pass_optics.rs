//! Do mirrors and glass send light where optics says?

mod first_pass_support;

use first_pass_support::*;
use glam::DVec3;
use luxgraph::first_pass::FirstPassSettings;

fn horizontal(lo: [f64; 2], hi: [f64; 2], z: f64, up: bool) -> [DVec3; 4] {
    let v = |x, y| DVec3::new(x, y, z);
    let q = [v(lo[0], lo[1]), v(hi[0], lo[1]), v(hi[0], hi[1]), v(lo[0], hi[1])];
    if up { q } else { [q[3], q[2], q[1], q[0]] }
}

/// A vertical mirror or its absence, a small lamp beside it, and a receiver of reflectance 0.5.
fn mirror_scene(mirror: bool, image: bool) -> TestScene {
    let lamp = |x: f64| horizontal([x - 0.1, -0.1], [x + 0.1, 0.1], 1.0, false);
    let v = |y, z| DVec3::new(0.0, y, z);
    // The floor goes from the mirror (x = 0) on, the lamp hangs at x = 0.6.
    let mut quads = vec![(horizontal([0.0, -1.0], [2.0, 1.0], 0.0, true), 0, false)];
    quads.push((lamp(if image { -0.6 } else { 0.6 }), 1, false));
    if mirror {
        quads.push(([v(-1.5, 0.0), v(1.5, 0.0), v(1.5, 1.5), v(-1.5, 1.5)], 2, false));
    }
    let materials = vec![diffuse(0.5, 0.0), diffuse(0.0, 100.0), glossy(1.0, 1.0, 0.0, 0.0, 0.0)];
    TestScene::new(&quads, materials, 0.02)
}

#[test]
fn a_mirror_shows_the_image_of_a_lamp() {
    let settings = FirstPassSettings::default();
    let with = mirror_scene(true, false);
    let lit_with = with.solve(&settings).unwrap();
    let without = mirror_scene(false, false);
    let direct = without.solve(&settings).unwrap();
    let image = mirror_scene(false, true);
    let expected = image.solve(&settings).unwrap();
    let place = |scene: &TestScene, i: usize| scene.points.position[i] + scene.geometry.centre.as_vec3();
    let at = |scene: &TestScene, p: glam::Vec3| {
        scene.of_surface(0).into_iter().find(|&i| place(scene, i).distance(p) < 1e-3).unwrap()
    };
    let (mut squares, mut all, mut sum, mut reference) = (0.0_f32, 0.0_f32, 0.0, 0.0);
    for a in with.of_surface(0) {
        let p = place(&with, a);
        let found = lit_with.of(a)[0] - direct.of(at(&without, p))[0];
        let expected = expected.of(at(&image, p))[0];
        squares += (found - expected).powi(2);
        all += expected.powi(2);
        sum += found;
        reference += expected;
    }
    let error = (squares / all).sqrt();
    println!("mirror: total {:.4}, root mean square error {error:.4}", sum / reference);
    assert!((sum / reference - 1.0).abs() < 0.03, "total {}", sum / reference);
    // The mirror's elements are as large as the lamp.
    assert!(error < 0.1, "{error}");
}

/// Radiance of the floor of a dark room whose ceiling is open, or a sheet, under a glowing room.
fn under(sheet: Option<usize>) -> f64 {
    let mut quads = room(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.5), [0, 0, 0, 0, 3, 0]);
    quads.truncate(5);
    let mut upper = room(DVec3::new(0.0, 0.0, 0.5), DVec3::ONE, [1; 6]);
    upper.remove(4);
    quads.extend(upper);
    if let Some(material) = sheet {
        quads.push((horizontal([0.0, 0.0], [1.0, 1.0], 0.5, true), material, true));
    }
    let materials = vec![diffuse(0.0, 0.0), diffuse(0.0, 1.0), pane(0.1, 0.8), diffuse(0.5, 0.0)];
    let scene = TestScene::new(&quads, materials, 1.0 / 64.0);
    let solution = scene.solve(&FirstPassSettings::default()).unwrap();
    println!("pane: {:?}", solution.stats);
    scene.mean(&solution, 4)
}

#[test]
fn a_pane_lets_its_transmittance_through() {
    let share = under(Some(2)) / under(None);
    assert!((share / 0.8 - 1.0).abs() < 0.02, "{share}");
}

#[test]
fn a_furnace_stays_uniform_around_a_glass_block() {
    // In a closed room of radiance 1 nothing that does not absorb can be seen.
    let mut quads = cube([0; 6]);
    quads.extend(block(DVec3::splat(0.3), DVec3::splat(0.7), 1, true));
    let scene = TestScene::new(&quads, vec![diffuse(0.5, 0.5), solid(1.5, 0.0)], 1.0 / 64.0);
    let solution = scene.solve(&FirstPassSettings::default()).unwrap();
    println!("block: {:?}", solution.stats);
    for s in 0..6 {
        let l = scene.mean(&solution, s);
        assert!((l - 1.0).abs() < 0.02, "{s}: {l}");
    }
}

#[test]
fn absorbing_glass_absorbs() {
    // What goes in at a clear block comes out again; behind a black one it stays.
    let flux = |absorption: f32| {
        let mut quads = cube([0; 6]);
        quads.extend(block(DVec3::splat(0.3), DVec3::splat(0.7), 1, true));
        let scene = TestScene::new(&quads, vec![diffuse(0.0, 1.0), solid(1.5, absorption)], 1.0 / 64.0);
        let stats = scene.solve(&FirstPassSettings::default()).unwrap().stats;
        assert!(stats.flux.error[0].abs() < 0.02, "{:?}", stats.flux);
        stats
    };
    let (clear, dark) = (flux(0.0), flux(1000.0));
    assert!(dark.longest_chain < clear.longest_chain);
}

//! Does the path tracer return what closed forms say, does it know its own noise, and do both passes agree with it?

use crate::small_scenes::*;
use glam::DVec3;
use luxgraph::first_pass::FirstPassSettings;
use luxgraph::observer::Silent;
use luxgraph::reference::{Reference, ReferenceSettings, irradiance, render};
use luxgraph::scene::{Camera, Distribution, Light, LightKind, Sensor};
use luxgraph::second_pass::{self, Interpolator, LitScene, SecondPassSettings};
use luxgraph::tracers::VoxelTracer;
use std::f64::consts::PI;

fn camera(position: [f64; 3], target: [f64; 3], fov_deg: f64) -> Camera {
    let (position, target) = (position.into(), target.into());
    Camera { name: "c".into(), position, target, up: DVec3::Y, fov_deg, resolution: [24, 18] }
}

fn reference(scene: &TestScene, camera: &Camera, samples: u32, seed: u32) -> Reference {
    let tracer = VoxelTracer::new(&scene.geometry);
    let settings = ReferenceSettings { samples, seed };
    render(&scene.geometry, &scene.appearance, camera, &tracer, &settings, &Silent).unwrap()
}

/// Mean radiance of the image at the first wavelength.
fn mean(reference: &Reference) -> f64 {
    let l = &reference.image.radiance;
    l.iter().step_by(W).map(|&l| f64::from(l)).sum::<f64>() / (l.len() / W) as f64
}

#[test]
fn a_furnace_is_even_whatever_stands_in_it() {
    // Walls glow and reflect: L = 1 / (1 - 0.7). Perfect mirrors, panes and glass change nothing of it.
    let expected = 1.0 / 0.3;
    let things: [(&str, Vec<Quad>, f64); 4] = [
        ("nothing", vec![], 5e-3),
        ("a mirror", block(DVec3::splat(0.4), DVec3::splat(0.7), 1, false), 5e-3),
        ("a block of glass", block(DVec3::splat(0.4), DVec3::splat(0.7), 2, true), 5e-3),
        (
            "a pane",
            vec![(
                [[0.2, 0.2], [0.8, 0.2], [0.8, 0.8], [0.2, 0.8]].map(|[x, y]| DVec3::new(x, y, 0.5)),
                3,
                true,
            )],
            5e-3,
        ),
    ];
    for (name, thing, tolerance) in things {
        let mut quads = cube([0; 6]);
        quads.extend(thing);
        let materials =
            vec![diffuse(0.7, 1.0), glossy(1.0, 1.0, 0.0, 0.0, 0.0), solid(1.5, 0.0), pane(0.2, 0.8)];
        let scene = TestScene::new(&quads, materials, 1.0);
        let found = reference(&scene, &camera([0.1, 0.15, 0.05], [0.9, 0.7, 0.9], 80.0), 256, 1);
        let mean = mean(&found);
        println!("{name}: {mean}, noise {:?}", found.stats.relative_noise);
        assert!((mean / expected - 1.0).abs() < tolerance, "{name}: {mean}");
        // In even light every path that is cut short by chance makes noise, and nothing else does.
        assert!(found.stats.relative_noise.unwrap() < 0.05, "{name}");
    }
}

/// A rough block in a black glowing room: every view of it shows its directional albedo.
#[test]
fn a_rough_lobe_returns_its_albedo() {
    for m in [0.15, 0.5] {
        let mut quads = cube([0; 6]);
        quads.push((
            [[0.1, 0.9], [0.9, 0.9], [0.9, 0.1], [0.1, 0.1]].map(|[x, z]| DVec3::new(x, 0.3, z)),
            1,
            false,
        ));
        let scene = TestScene::new(&quads, vec![diffuse(0.0, 1.0), glossy(1.0, 0.8, m, 0.0, 0.0)], 1.0);
        let view = Camera { resolution: [3, 3], ..camera([0.5, 0.9, 0.2], [0.5, 0.3, 0.5], 2.0) };
        let cosine = (view.position - view.target).normalize().y;
        let expected = 0.8 * luxgraph::material::directional_albedo(m, cosine);
        let found = mean(&reference(&scene, &view, 1 << 14, 3));
        assert!((found / expected - 1.0).abs() < 5e-3, "m {m}: {found} {expected}");
    }
}

/// E = π L F of a small square over the floor, and I / r² of a point light, by the floor's radiance.
#[test]
fn lamps_light_what_is_under_them() {
    let square = |half: f64, y: f64, material: usize| -> Quad {
        let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
        (corners.map(|[x, z]| DVec3::new(x, y, z)), material, false)
    };
    let floor = [[-2.0, 2.0], [2.0, 2.0], [2.0, -2.0], [-2.0, -2.0]].map(|[x, z]| DVec3::new(x, 0.0, z));
    let view = Camera { resolution: [2, 2], ..camera([0.3, 0.5, 0.4], [0.0, 0.0, 0.0], 0.2) };
    for half in [0.02, 0.5] {
        let quads = vec![(floor, 0, false), square(half, 1.0, 1)];
        let scene = TestScene::new(&quads, vec![diffuse(0.5, 0.0), diffuse(0.0, 2.0)], 4.0);
        // Form factor from a point to a square above it (four times Howell's B-3).
        let x = half / (1.0 + half * half).sqrt();
        let factor = 4.0 * 2.0 * x * x.atan() / (2.0 * PI);
        let expected = 0.5 / PI * PI * 2.0 * factor;
        let found = mean(&reference(&scene, &view, 1 << 13, 5));
        assert!((found / expected - 1.0).abs() < 5e-3, "half {half}: {found} {expected}");
    }
    let mut scene = TestScene::new(&[(floor, 0, false)], vec![diffuse(0.5, 0.0)], 4.0);
    let position = DVec3::new(0.0, 1.5, 0.0) - scene.geometry.centre;
    scene.geometry.lights = vec![Light {
        name: "l".into(),
        kind: LightKind::Point { position, distribution: Distribution::Isotropic },
    }];
    scene.appearance.lights = vec![vec![3.0; W]];
    let found = mean(&reference(&scene, &view, 16, 0));
    let expected = 0.5 / PI * 3.0 / (1.5 * 1.5);
    assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
}

/// A room with a lamp, a mirror wall, a glossy block and a screen.
fn furnished() -> TestScene {
    let mut quads = cube([0, 0, 0, 1, 0, 2]);
    let lamp = [[0.35, 0.35], [0.65, 0.35], [0.65, 0.65], [0.35, 0.65]].map(|[x, z]| DVec3::new(x, 0.9, z));
    quads.push((lamp, 3, false));
    quads.extend(block(DVec3::new(0.55, 0.0, 0.3), DVec3::new(0.8, 0.4, 0.6), 4, false));
    let materials = vec![
        diffuse(0.6, 0.0),
        diffuse(0.8, 0.0),
        glossy(0.9, 0.9, 0.0, 0.05, 0.0),
        diffuse(0.0, 5.0),
        glossy(0.5, 0.8, 0.35, 0.3, 0.0),
    ];
    TestScene::new(&quads, materials, 1.0 / 256.0)
}

#[test]
fn noise_is_what_two_seeds_differ_by() {
    let scene = furnished();
    let view = camera([0.1, 0.5, 0.05], [0.7, 0.4, 0.9], 70.0);
    let [a, b] = [1, 2].map(|seed| reference(&scene, &view, 64, seed));
    let (mut apart, mut expected) = (0.0, 0.0);
    for pixel in 0..a.image.pixels() {
        apart += (a.image.xyz(pixel)[1] - b.image.xyz(pixel)[1]).powi(2);
        expected += f64::from(a.noise[pixel]).powi(2) + f64::from(b.noise[pixel]).powi(2);
    }
    println!("{} of what was expected; {:?}", apart / expected, a.stats.relative_noise);
    assert!((0.7..1.4).contains(&(apart / expected)), "{}", apart / expected);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let scene = furnished();
    let view = camera([0.1, 0.5, 0.05], [0.7, 0.4, 0.9], 70.0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| reference(&scene, &view, 20, 1));
        (found.image.radiance, found.noise, found.stats.samples)
    };
    let one = with(1);
    assert!(one == with(3) && one.2 == 32, "samples are whole replicates");
}

#[test]
fn both_passes_agree_with_the_judge() {
    let scene = furnished();
    let view = camera([0.1, 0.5, 0.05], [0.7, 0.4, 0.9], 70.0);
    let judge = reference(&scene, &view, 512, 1);
    let TestScene { geometry, points, appearance, .. } = &scene;
    let tracer = VoxelTracer::new(geometry);
    let solution = &scene.solve(&FirstPassSettings::default()).unwrap();
    let interpolator = &Interpolator::new(geometry, points, &tracer);
    let lit = LitScene { geometry, interpolator, appearance, solution };
    let (image, _) =
        second_pass::render(&lit, &view, &tracer, &SecondPassSettings::default(), &Silent).unwrap();
    let luminance = |image: &second_pass::SpectralImage| {
        (0..image.pixels()).map(|p| image.xyz(p)[1]).sum::<f64>() / image.pixels() as f64
    };
    let off = luminance(&image) / luminance(&judge.image) - 1.0;
    println!("mean luminance {:+.3} %, noise {:?}", 100.0 * off, judge.stats.relative_noise);
    assert!(off.abs() < 0.01, "{off}");
}

#[test]
fn what_cannot_be_rendered_is_refused() {
    let scene = furnished();
    let tracer = VoxelTracer::new(&scene.geometry);
    let view = camera([0.1, 0.5, 0.05], [0.7, 0.4, 0.9], 70.0);
    let none = ReferenceSettings { samples: 0, seed: 0 };
    assert!(render(&scene.geometry, &scene.appearance, &view, &tracer, &none, &Silent).is_err());
    let mut stranger = scene.appearance.clone();
    stranger.surface_material.pop();
    let some = ReferenceSettings { samples: 1, seed: 0 };
    assert!(render(&scene.geometry, &stranger, &view, &tracer, &some, &Silent).is_err());
    let one = render(&scene.geometry, &scene.appearance, &view, &tracer, &some, &Silent).unwrap();
    assert!(one.noise.is_empty() && one.stats.relative_noise.is_none());
}

#[test]
fn a_sensor_in_a_furnace_reads_pi_times_its_radiance() {
    // Light from everywhere alike, however it is found: asked for or met, straight or reflected.
    let mut quads = cube([0; 6]);
    quads.extend(block(DVec3::splat(0.4), DVec3::splat(0.7), 1, false));
    let materials = vec![diffuse(0.7, 1.0), glossy(1.0, 1.0, 0.0, 0.0, 0.0)];
    let scene = TestScene::new(&quads, materials, 1.0);
    let tracer = VoxelTracer::new(&scene.geometry);
    let sensor = |position: [f64; 3], normal: [f64; 3]| Sensor {
        name: "s".into(),
        position: position.into(),
        normal: normal.into(),
    };
    // In the middle of nothing, and on a wall.
    let sensors = [sensor([0.2, 0.3, 0.2], [0.3, -0.5, 0.9]), sensor([0.5, 0.0, 0.5], [0.0, 1.0, 0.0])];
    let settings = ReferenceSettings { samples: 1 << 13, seed: 0 };
    let found =
        irradiance(&scene.geometry, &scene.appearance, &sensors, &tracer, &settings, &Silent).unwrap();
    for found in &found {
        let error = found.irradiance[0] / (PI / 0.3) - 1.0;
        let noise = found.noise_lx.unwrap() / found.illuminance_lx;
        println!("{error}, noise {noise}");
        assert!(error.abs() < 4.0 * noise && noise < 0.01, "{error} {noise}");
    }
    let nowhere = sensor([0.5; 3], [0.0; 3]);
    assert!(irradiance(&scene.geometry, &scene.appearance, &[nowhere], &tracer, &settings, &Silent).is_err());
}

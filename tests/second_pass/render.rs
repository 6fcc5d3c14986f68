//! Does the second pass see what physics says a camera sees?

use glam::DVec3;
use luxgraph::error::Error;
use luxgraph::first_pass::DiffuseSolution;
use luxgraph::geometry::Shape;
use luxgraph::material::{FresnelTable, SampledMaterial, Transmission};
use luxgraph::observer::Silent;
use luxgraph::points::{SamplePoints, Sampling, divide_by_area};
use luxgraph::scene::{Camera, Geometry, MaterialId, ObjectId, SampledAppearance};
use luxgraph::second_pass::{
    Interpolator, LitScene, Passes, Rung, SecondPassSettings, SecondPassStats, SpectralImage, render,
};
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::brute_force::BruteForce;

const W: usize = 2;

fn wavelengths() -> Wavelengths {
    Wavelengths::points(vec![480.0, 580.0], vec![[10.0, 30.0, 50.0], [90.0, 80.0, 1.0]])
}

fn table(f: impl Fn(f64) -> f64) -> FresnelTable {
    FresnelTable::new(W, 257, |_, cos| f(cos))
}

/// Unpolarised reflectance where `eta` is the index beyond over the index here.
fn dielectric(cos: f64, eta: f64) -> f64 {
    let sin2 = (1.0 - cos * cos) / (eta * eta);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let t = (1.0 - sin2).sqrt();
    let (s, p) = ((cos - eta * t) / (cos + eta * t), (eta * cos - t) / (eta * cos + t));
    0.5 * (s * s + p * p)
}

fn diffuse() -> SampledMaterial {
    SampledMaterial {
        diffuse: vec![0.5; W],
        s: 0.0,
        m: 0.0,
        reflect: table(|_| 1.0),
        transmission: None,
        spread: None,
        emission: vec![0.0; W],
    }
}

fn specular(m: f64) -> SampledMaterial {
    SampledMaterial { diffuse: vec![0.0; W], s: 1.0, m, ..diffuse() }
}

fn pane(reflectance: f64, transmittance: f64) -> SampledMaterial {
    SampledMaterial {
        reflect: table(move |_| reflectance),
        transmission: Some(Transmission::Pane { transmit: table(move |_| transmittance) }),
        ..specular(0.0)
    }
}

fn solid(n: f64, absorption: f32) -> SampledMaterial {
    SampledMaterial {
        reflect: table(move |c| dielectric(c, n)),
        transmission: Some(Transmission::Solid {
            n,
            inside: table(move |c| dielectric(c, 1.0 / n)),
            absorption: vec![absorption; W],
        }),
        ..specular(0.0)
    }
}

/// The six faces of a box, facing inwards or outwards.
fn faces(low: DVec3, high: DVec3, inwards: bool) -> Vec<Shape> {
    let p = |x: bool, y: bool, z: bool| {
        DVec3::new(
            if x { high.x } else { low.x },
            if y { high.y } else { low.y },
            if z { high.z } else { low.z },
        )
    };
    let (o, i) = (false, true);
    [
        [p(o, o, o), p(o, i, o), p(i, i, o), p(i, o, o)],
        [p(o, o, i), p(i, o, i), p(i, i, i), p(o, i, i)],
        [p(o, o, o), p(i, o, o), p(i, o, i), p(o, o, i)],
        [p(o, i, o), p(o, i, i), p(i, i, i), p(i, i, o)],
        [p(o, o, o), p(o, o, i), p(o, i, i), p(o, i, o)],
        [p(i, o, o), p(i, i, o), p(i, i, i), p(i, o, i)],
    ]
    .into_iter()
    .map(|mut v| {
        if inwards {
            v.reverse();
        }
        Shape::Quad(v)
    })
    .collect()
}

struct World {
    geometry: Geometry,
    points: SamplePoints,
    appearance: SampledAppearance,
    solution: DiffuseSolution,
}

impl World {
    /// Shapes with whether they are two-sided and their material; L^d by place and material.
    fn new(
        shapes: Vec<(Shape, bool, u32)>,
        materials: Vec<SampledMaterial>,
        radiance: impl Fn(DVec3, u32) -> [f32; W],
    ) -> World {
        let of: Vec<u32> = shapes.iter().map(|s| s.2).collect();
        let shapes =
            shapes.into_iter().enumerate().map(|(i, (s, two, _))| (s, two, i as u32, ObjectId(0))).collect();
        let geometry = Geometry::new(shapes, vec!["scene".into()]);
        let elements = divide_by_area(&geometry, &Sampling::by_area(0.1));
        let points = SamplePoints::new(&geometry, &elements, 1, |_| 0);
        let place = |i: usize| points.position[i].as_dvec3() + geometry.centre;
        let radiance =
            (0..points.len()).flat_map(|i| radiance(place(i), of[points.surface[i].index()])).collect();
        let appearance = SampledAppearance {
            wavelengths: wavelengths(),
            materials,
            surface_material: of.iter().map(|m| MaterialId(*m)).collect(),
            lights: Vec::new(),
            sky: None,
        };
        let solution =
            DiffuseSolution { wavelengths: wavelengths(), parts: None, radiance, stats: Default::default() };
        World { geometry, points, appearance, solution }
    }

    fn render(&self, camera: &Camera, settings: &SecondPassSettings) -> (SpectralImage, SecondPassStats) {
        let tracer = BruteForce::new(&self.geometry);
        let interpolator = Interpolator::new(&self.geometry, &self.points, &tracer);
        let scene = LitScene {
            geometry: &self.geometry,
            interpolator: &interpolator,
            appearance: &self.appearance,
            solution: &self.solution,
        };
        render(&scene, camera, &tracer, settings, &Silent).expect("renders")
    }
}

fn room(material: u32) -> Vec<(Shape, bool, u32)> {
    faces(DVec3::splat(-2.0), DVec3::splat(2.0), true).into_iter().map(|s| (s, false, material)).collect()
}

fn camera(position: DVec3, target: DVec3) -> Camera {
    Camera { name: "c".into(), position, target, up: DVec3::Z, fov_deg: 60.0, resolution: [20, 18] }
}

fn assert_all(image: &SpectralImage, expected: f32, tolerance: f32) {
    for (i, l) in image.radiance.iter().enumerate() {
        assert!((l - expected).abs() <= tolerance * expected, "value {i}: {l} for {expected}");
    }
}

const EXACT: SecondPassSettings = SecondPassSettings {
    noise: None,
    rung: Rung::Interpolate,
    lamp_samples: 1,
    gather_samples: 1,
    passes: Passes::Both,
    samples: 4,
    lobe_samples: 2,
    max_depth: 16,
    tolerance: 0.0,
    clamp: f64::INFINITY,
    seed: 1,
};

#[test]
fn a_furnace_looks_the_same_through_mirrors_and_panes() {
    let square = Shape::Quad([
        DVec3::new(0.5, -1.0, -1.0),
        DVec3::new(0.5, -1.0, 1.0),
        DVec3::new(0.5, 1.0, 1.0),
        DVec3::new(0.5, 1.0, -1.0),
    ]);
    let view = camera(DVec3::new(-1.5, 0.2, 0.1), DVec3::new(0.5, 0.0, 0.0));
    for material in [specular(0.0), pane(0.3, 0.7), pane(0.0, 1.0)] {
        let mut shapes = room(0);
        shapes.push((square.clone(), true, 1));
        let world =
            World::new(shapes, vec![diffuse(), material], |_, m| if m == 0 { [3.0; W] } else { [0.0; W] });
        let (image, stats) = world.render(&view, &EXACT);
        assert_all(&image, 3.0, 1e-5);
        assert_eq!((stats.missed_rays, stats.paths_cut), (0, 0));
    }
}

#[test]
fn a_pane_takes_what_it_absorbs() {
    let mut shapes = room(0);
    let z = |x: f64, y: f64| DVec3::new(0.5, x, y);
    shapes.push((Shape::Quad([z(-2.0, -2.0), z(-2.0, 2.0), z(2.0, 2.0), z(2.0, -2.0)]), true, 1));
    let light = |p: DVec3, m: u32| if m == 0 && p.x > 1.99 { [5.0; W] } else { [0.0; W] };
    let world = World::new(shapes, vec![diffuse(), pane(0.2, 0.6)], light);
    let mut view = camera(DVec3::new(-1.5, 0.0, 0.0), DVec3::new(2.0, 0.0, 0.0));
    view.fov_deg = 10.0;
    assert_all(&world.render(&view, &EXACT).0, 3.0, 1e-5);
}

#[test]
fn light_leaves_glass_by_fresnel_up_to_the_critical_angle() {
    // From behind one face of glass in a furnace of radiance 1: F is reflected, n2 (1 - F) comes through.
    let n = 1.5;
    let critical = (1.0f64 / n).asin();
    let z = |x: f64, y: f64| DVec3::new(0.5, x, y);
    let face = Shape::Quad([z(-2.0, -2.0), z(2.0, -2.0), z(2.0, 2.0), z(-2.0, 2.0)]);
    let mut shapes = room(0);
    shapes.push((face, false, 1));
    let world =
        World::new(shapes, vec![diffuse(), solid(n, 0.0)], |_, m| if m == 0 { [1.0; W] } else { [0.0; W] });
    for degrees in [-30.0f64, -5.0, -0.5, -0.2, -0.1, -0.05, -0.02, 0.02, 0.5, 10.0] {
        let angle = critical + degrees.to_radians();
        let position = DVec3::new(-0.5, 0.0, -0.9);
        let mut view = camera(position, position + DVec3::new(angle.cos(), 0.0, angle.sin()));
        (view.fov_deg, view.resolution) = (1e-4, [2, 2]);
        let f = dielectric(angle.cos(), 1.0 / n);
        let expected = f + n * n * (1.0 - f);
        assert_all(&world.render(&view, &EXACT).0, expected as f32, 2e-3);
    }
}

#[test]
fn a_clear_solid_in_a_furnace_is_invisible_and_an_absorbing_one_obeys_beer_lambert() {
    // Radiance is scaled by n2 on the way in and back on the way out: nothing remains of it.
    let view = camera(DVec3::new(-1.8, 0.3, 0.2), DVec3::ZERO);
    let glass = faces(DVec3::new(-0.5, -0.6, -0.7), DVec3::new(0.5, 0.6, 0.7), false);
    let world = |material: SampledMaterial| {
        let mut shapes = room(0);
        shapes.extend(glass.iter().map(|s| (s.clone(), false, 1)));
        World::new(shapes, vec![diffuse(), material], |_, m| if m == 0 { [3.0; W] } else { [0.0; W] })
    };
    let settings = SecondPassSettings { max_depth: 60, samples: 64, ..EXACT };
    let (image, stats) = world(solid(1.5, 0.0)).render(&view, &settings);
    let mean = image.radiance.iter().map(|l| f64::from(*l)).sum::<f64>() / image.radiance.len() as f64;
    // Light caught by total reflection in the box ends at the depth limit, as reported.
    assert!((mean + 3.0 * stats.cut_share - 3.0).abs() < 3e-3, "{mean} {stats:?}");

    // Straight through 1 m of glass of index 1: exp(-a).
    let mut straight = camera(DVec3::new(-1.8, 0.0, 0.0), DVec3::ZERO);
    straight.fov_deg = 0.01;
    let (image, _) = world(solid(1.0, 0.8)).render(&straight, &EXACT);
    assert_all(&image, 3.0 * (-0.8f32).exp(), 1e-5);
}

#[test]
fn a_camera_inside_glass_is_inside_glass() {
    let glass = faces(DVec3::splat(-0.5), DVec3::splat(0.5), false);
    let mut shapes = room(0);
    shapes.extend(glass.iter().map(|s| (s.clone(), false, 1)));
    let light = |_, m| if m == 0 { [3.0; W] } else { [0.0; W] };
    let world = World::new(shapes, vec![diffuse(), solid(1.0, 0.8)], light);
    let mut view = camera(DVec3::ZERO, DVec3::X);
    view.fov_deg = 0.01;
    assert_all(&world.render(&view, &EXACT).0, 3.0 * (-0.4f32).exp(), 1e-5);
}

#[test]
fn a_mirror_shows_the_gradient_behind_the_camera() {
    // All of the wall at x = 2 is a mirror; the wall at x = -2 has a gradient in y and z.
    let mut shapes = room(0);
    shapes[5].2 = 1;
    let linear = |p: DVec3| (10.0 + 2.0 * p.y + p.z) as f32;
    let light = |p: DVec3, m| if m == 0 { [linear(p), 1.0] } else { [0.0; W] };
    let world = World::new(shapes, vec![diffuse(), specular(0.0)], light);
    let mut view = camera(DVec3::new(-1.0, 0.1, 0.2), DVec3::new(2.0, 0.1, 0.2));
    view.fov_deg = 25.0;
    let (image, _) = world.render(&view, &SecondPassSettings { samples: 256, ..EXACT });
    for y in 0..18 {
        for x in 0..20 {
            let d = view.ray(x as f64 + 0.5, y as f64 + 0.5, DVec3::ZERO).direction;
            let far = view.position + d * (7.0 / d.x);
            let l = image.radiance[(y * 20 + x) * W];
            assert!((l - linear(far)).abs() < 0.02, "{x} {y}: {l} for {}", linear(far));
        }
    }
}

#[test]
fn a_rough_mirror_in_a_furnace_shows_its_albedo_quietly() {
    // The wall at x = 2 is rough gold without colour; albedo at 0 degrees for m = 0.3: 0.9956.
    let mut shapes = room(0);
    shapes[5].2 = 1;
    let light = |_, m| if m == 0 { [2.0; W] } else { [0.0; W] };
    let world = World::new(shapes, vec![diffuse(), specular(0.3)], light);
    let mut view = camera(DVec3::new(-1.0, 0.0, 0.0), DVec3::new(2.0, 0.0, 0.0));
    view.fov_deg = 1.0;
    let settings = SecondPassSettings { samples: 16, lobe_samples: 4, ..EXACT };
    let (image, _) = world.render(&view, &settings);
    let mean = image.radiance.iter().map(|l| f64::from(*l)).sum::<f64>() / image.radiance.len() as f64;
    assert!((mean - 2.0 * 0.9956).abs() < 2e-3, "{mean}");
    for l in &image.radiance {
        assert!((f64::from(*l) - mean).abs() < 0.02 * mean, "noise at 16 samples: {l}");
    }
}

#[test]
fn the_first_pass_alone_shows_no_reflection_and_backs_are_black() {
    let mut shapes = room(0);
    shapes[5].2 = 1;
    let light = |_, m| if m == 0 { [2.0; W] } else { [0.5; W] };
    let world = World::new(shapes, vec![diffuse(), specular(0.0)], light);
    let mut view = camera(DVec3::new(-1.0, 0.0, 0.0), DVec3::new(2.0, 0.0, 0.0));
    view.fov_deg = 20.0;
    let first = SecondPassSettings { passes: Passes::FirstPassOnly, ..EXACT };
    let (image, stats) = world.render(&view, &first);
    assert_all(&image, 0.5, 1e-6);
    assert_eq!((stats.reflected_rays, stats.camera_rays), (0, 20 * 18 * 4));
    assert_all(&world.render(&view, &EXACT).0, 2.5, 1e-5);

    // From outside the room only backs are seen: they are black, and block.
    view.position = DVec3::new(-9.0, 0.0, 0.0);
    let (image, stats) = world.render(&view, &EXACT);
    assert!(image.radiance.iter().all(|l| *l == 0.0));
    assert_eq!(stats.missed_rays, 0);
}

#[test]
fn same_bits_from_any_number_of_threads_and_roulette_keeps_the_mean() {
    let mut shapes = room(0);
    shapes[5].2 = 1;
    shapes[3].2 = 2;
    let glass = faces(DVec3::new(-0.5, -0.6, -0.7), DVec3::new(0.5, 0.6, 0.7), false);
    shapes.extend(glass.iter().map(|s| (s.clone(), false, 3)));
    let light = |p: DVec3, m| if m == 0 { [(3.0 + p.z) as f32, (3.0 - p.y) as f32] } else { [0.1; W] };
    let materials = vec![diffuse(), specular(0.3), specular(0.0), solid(1.5, 0.3)];
    let world = World::new(shapes, materials, light);
    let mut view = camera(DVec3::new(-1.5, -1.0, 0.4), DVec3::new(1.0, 0.5, 0.0));
    view.resolution = [37, 23];
    let settings = SecondPassSettings { samples: 8, tolerance: 0.05, ..EXACT };
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a thread pool");
        pool.install(|| world.render(&view, &settings))
    };
    let ((one, mut a), (two, b)) = (with_threads(1), with_threads(2));
    assert!(one.radiance.iter().zip(&two.radiance).all(|(a, b)| a.to_bits() == b.to_bits()));
    a.second_pass_s = b.second_pass_s;
    assert_eq!(a, b);
    assert!(a.paths_ended > 0 && one.radiance.iter().all(|l| l.is_finite() && *l >= 0.0));

    let mean = |image: &SpectralImage| image.radiance.iter().map(|l| f64::from(*l)).sum::<f64>();
    let (reference, _) = world.render(&view, &SecondPassSettings { samples: 64, ..EXACT });
    let ratio = mean(&one) / mean(&reference);
    assert!((ratio - 1.0).abs() < 5e-3, "roulette is unbiased: {ratio}");
}

#[test]
fn grazing_views_give_finite_numbers() {
    let mut shapes = room(0);
    for (face, material) in [(0, 1), (1, 2), (5, 3)] {
        shapes[face].2 = material;
    }
    let light = |_, m| if m == 0 { [3.0; W] } else { [0.0; W] };
    let materials = vec![diffuse(), specular(0.3), specular(1.0), specular(1e-4)];
    let world = World::new(shapes, materials, light);
    for height in [-2.0, -2.0 + 1e-12, -2.0 + 1e-6, 2.0 - 1e-9] {
        let view = camera(DVec3::new(-2.0, 0.0, height), DVec3::new(2.0, 0.0, height));
        let (image, _) = world.render(&view, &EXACT);
        assert!(image.radiance.iter().all(|l| l.is_finite() && *l >= 0.0), "at {height}");
    }
}

#[test]
fn what_cannot_be_rendered_is_refused() {
    let world = World::new(room(0), vec![diffuse()], |_, _| [1.0; W]);
    let view = camera(DVec3::ZERO, DVec3::X);
    let tracer = BruteForce::new(&world.geometry);
    let interpolator = Interpolator::new(&world.geometry, &world.points, &tracer);
    let attempt = |solution: &DiffuseSolution, view: &Camera, settings: &SecondPassSettings| {
        let scene = LitScene {
            geometry: &world.geometry,
            interpolator: &interpolator,
            appearance: &world.appearance,
            solution,
        };
        render(&scene, view, &tracer, settings, &Silent).map(|_| ())
    };
    assert!(attempt(&world.solution, &view, &EXACT).is_ok());
    for settings in [
        SecondPassSettings { samples: 0, ..EXACT },
        SecondPassSettings { samples: 60_000, lobe_samples: 60_000, ..EXACT },
        SecondPassSettings { tolerance: f64::NAN, ..EXACT },
        SecondPassSettings { max_depth: u32::MAX, ..EXACT },
    ] {
        assert!(matches!(attempt(&world.solution, &view, &settings), Err(Error::Settings(_))));
    }
    let blind = Camera { target: view.position, ..view.clone() };
    assert!(matches!(attempt(&world.solution, &blind, &EXACT), Err(Error::Settings(_))));
    let mut broken = world.solution.clone();
    broken.radiance[7] = f32::NAN;
    assert!(matches!(attempt(&broken, &view, &EXACT), Err(Error::Numerical(_))));
    broken.radiance.truncate(3);
    assert!(matches!(attempt(&broken, &view, &EXACT), Err(Error::Numerical(_))));
}

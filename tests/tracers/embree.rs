//! Does Embree, behind our interface, answer as the scene demands?
#![cfg(feature = "embree")]

use crate::strewn_room::room;
use glam::{DVec3, Vec3};
use luxgraph::geometry::{Ray, Shape, Side, SurfaceId};
use luxgraph::observer::Silent;
use luxgraph::scene::{Geometry, ObjectId};
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::crosscheck::crosscheck;
use luxgraph::tracers::judge::END_ULPS;
use luxgraph::tracers::{EmbreeTracer, RayTracer, Segment, embree};

fn ray(origin: [f64; 3], direction: [f64; 3], t_min: f64, t_max: f64) -> Ray {
    Ray { origin: DVec3::from(origin), direction: DVec3::from(direction), t_min, t_max }
}

fn down(t_min: f64, t_max: f64) -> Ray {
    ray([0.25, 0.5, 2.0], [0.0, 0.0, -2.0], t_min, t_max)
}

/// The unit square and a triangle one metre below it.
fn square_over_triangle() -> Geometry {
    let v = |x, y, z| DVec3::new(x, y, z);
    let square = Shape::Quad([v(-1.0, -1.0, 0.5), v(1.0, -1.0, 0.5), v(1.0, 1.0, 0.5), v(-1.0, 1.0, 0.5)]);
    let triangle = Shape::Triangle([v(-1.0, -1.0, -0.5), v(1.0, -1.0, -0.5), v(-1.0, 1.0, -0.5)]);
    let object = ObjectId(0);
    Geometry::new(vec![(square, false, 0, object), (triangle, false, 1, object)], vec!["o".into()])
}

#[test]
fn names_the_version_that_is_loaded() {
    let version = embree::available().unwrap();
    assert!(version.starts_with("3.") || version.starts_with("4."), "{version}");
    let tracer = EmbreeTracer::new(&square_over_triangle()).unwrap();
    assert_eq!(tracer.name(), format!("embree {version}"));
}

#[test]
fn hits_have_the_exact_parameter_and_side() {
    let tracer = EmbreeTracer::new(&square_over_triangle()).unwrap();
    let hit = tracer.closest(&down(0.0, 100.0)).unwrap();
    assert_eq!((hit.surface, hit.t, hit.side), (SurfaceId(0), 0.75, Side::Front));
    let hit = tracer.closest(&ray([0.25, 0.5, -2.0], [0.0, 0.0, 1.0], 0.0, f64::INFINITY)).unwrap();
    assert_eq!((hit.surface, hit.t, hit.side), (SurfaceId(0), 2.5, Side::Back));
    // The triangle ends on x + y = 0: (0.25, 0.5) lies outside, (-0.5, -0.25) inside.
    let hit = tracer.closest(&ray([-0.5, -0.25, -2.0], [0.0, 0.0, 1.0], 0.0, f64::INFINITY)).unwrap();
    assert_eq!((hit.surface, hit.t), (SurfaceId(1), 1.5));
}

#[test]
fn the_limits_of_a_ray_are_open_and_decided_in_double_precision() {
    let tracer = EmbreeTracer::new(&square_over_triangle()).unwrap();
    let below = 0.75f64.next_down();
    assert!(tracer.closest(&down(0.0, 0.75)).is_none());
    assert!(tracer.closest(&down(0.0, 0.75f64.next_up())).is_some());
    assert!(tracer.closest(&down(0.75, 1.0)).is_none());
    assert!(tracer.closest(&down(below, 1.0)).is_some());
    // A ray that starts on a surface does not meet it, and goes on to the next.
    let start = ray([-0.5, -0.25, 0.5], [0.0, 0.0, -1.0], 0.0, 10.0);
    assert_eq!(tracer.closest(&start).unwrap().surface, SurfaceId(1));
    // Limits before the origin count too.
    assert_eq!(tracer.closest(&ray([0.25, 0.5, -2.0], [0.0, 0.0, -1.0], -100.0, 0.0)).unwrap().t, -2.5);
}

#[test]
fn a_ray_from_afar_is_as_exact_as_one_from_near() {
    let geometry = room(6, 0.4);
    let (tracer, truth) = (EmbreeTracer::new(&geometry).unwrap(), BruteForce::new(&geometry));
    for i in 0..500 {
        let target =
            DVec3::new(f64::from(i % 23) * 0.1 - 1.1, f64::from(i % 19) * 0.1 - 0.9, f64::from(i % 7) * 0.1);
        let towards = DVec3::new(1.0, f64::from(i % 29) * 0.1, f64::from(i % 31) * 0.1).normalize();
        let ray = Ray {
            origin: target - 1e7 * towards,
            direction: 1e-3 * towards,
            t_min: 0.0,
            t_max: f64::INFINITY,
        };
        let (found, true_hit) = (tracer.closest(&ray).unwrap(), truth.closest(&ray).unwrap());
        assert_eq!(found.surface, true_hit.surface, "ray {i}");
        assert!((found.t - true_hit.t).abs() * 1e-3 < 1e-6, "ray {i}: {} {}", found.t, true_hit.t);
    }
}

#[test]
fn rays_that_are_not_finite_hit_nothing_and_harm_nobody() {
    let tracer = EmbreeTracer::new(&square_over_triangle()).unwrap();
    let bad = [f64::NAN, f64::INFINITY, 1e30, 1e300];
    let mut rays: Vec<Ray> = bad
        .iter()
        .flat_map(|&x| [ray([x, 0.0, 0.0], [0.0, 0.0, 1.0], 0.0, 1.0), ray([0.0; 3], [0.0, x, x], 0.0, x)])
        .chain([ray([0.0; 3], [0.0; 3], 0.0, 1.0), down(f64::NAN, 1.0), down(0.0, f64::NAN), down(1.0, 0.0)])
        .collect();
    rays.resize(40, down(0.0, 10.0));
    let mut hits = vec![None; rays.len()];
    tracer.closest_batch(&rays, &mut hits);
    assert!(hits[12..].iter().all(|h| h.is_some_and(|h| h.t == 0.75)), "{hits:?}");
    assert!(hits[8..12].iter().all(Option::is_none), "{hits:?}");

    let wrong = [Vec3::NAN, Vec3::INFINITY, Vec3::splat(3e38), Vec3::ZERO];
    let mut segments: Vec<Segment> = wrong.iter().map(|&p| Segment { from: p, to: p * -1.0 }).collect();
    segments.resize(37, Segment { from: Vec3::new(0.1, 0.2, 2.0), to: Vec3::new(0.3, -0.2, -2.0) });
    let mut blocked = vec![false; segments.len()];
    tracer.occluded_batch(&segments, &mut blocked);
    assert!(!blocked[..4].contains(&true) && !blocked[4..].contains(&false), "{blocked:?}");
    assert_eq!(tracer.blocker(&segments[0]), None);
}

#[test]
fn vertices_that_are_no_positions_are_refused_with_a_reason() {
    let mut geometry = square_over_triangle();
    for x in [f64::NAN, f64::INFINITY, 1e19] {
        geometry.surfaces[1].shape = Shape::Triangle([DVec3::splat(x), DVec3::X, DVec3::Y]);
        let error = EmbreeTracer::new(&geometry).err().unwrap().to_string();
        assert!(error.contains("surface 1"), "{error}");
    }
}

#[test]
fn a_scene_without_surfaces_blocks_nothing() {
    let tracer = EmbreeTracer::new(&Geometry::new(Vec::new(), Vec::new())).unwrap();
    assert!(tracer.closest(&down(0.0, 10.0)).is_none());
    assert!(tracer.blocker(&Segment { from: Vec3::ZERO, to: Vec3::X }).is_none());
}

#[test]
fn a_batch_answers_as_its_members_do_whatever_its_length() {
    let geometry = room(8, 0.4);
    let tracer = EmbreeTracer::new(&geometry).unwrap();
    let point =
        |i: u32| Vec3::new((i * 37 % 101) as f32, (i * 53 % 97) as f32, (i * 29 % 89) as f32) * 0.03 - 1.4;
    let segments: Vec<Segment> = (0..700).map(|i| Segment { from: point(i), to: point(i + 31) }).collect();
    let one_by_one: Vec<bool> = segments.iter().map(|s| tracer.blocker(s).is_some()).collect();
    assert!(one_by_one.contains(&true) && one_by_one.contains(&false));
    for length in [1, 7, 16, 17, 255, 256, 257, 700] {
        let mut blocked = vec![false; length];
        tracer.occluded_batch(&segments[..length], &mut blocked);
        assert_eq!(blocked, one_by_one[..length], "{length} segments");
    }
}

#[test]
fn a_batch_leaves_denormal_arithmetic_as_it_was() {
    let tracer = EmbreeTracer::new(&square_over_triangle()).unwrap();
    let segment = Segment { from: Vec3::Z, to: Vec3::NEG_Z };
    let mut blocked = [false; 32];
    tracer.occluded_batch(&[segment; 32], &mut blocked);
    tracer.closest(&down(0.0, 10.0));
    let half = std::hint::black_box(f32::MIN_POSITIVE) * 0.5;
    assert!(half > 0.0 && blocked == [true; 32]);
}

#[test]
fn embree_and_brute_force_differ_only_within_rounding() {
    for turn in [0.0, 0.4] {
        let geometry = room(22, turn);
        let (embree, truth) = (EmbreeTracer::new(&geometry).unwrap(), BruteForce::new(&geometry));
        let report = crosscheck(&geometry, &[&embree, &truth], 20_000, 3, &Silent);
        assert_eq!(report.errors, 0, "{:#?}", report.listed.first());
        // Rays within a surface's plane keep Embree's own distance, good to a few units in the last place.
        let rounding = END_ULPS * f64::from(f32::EPSILON) * geometry.radius;
        assert!(report.largest_t_difference_m < rounding, "{}", report.largest_t_difference_m);
    }
}

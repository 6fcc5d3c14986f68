//! Do the ray tracers find what brute force finds, also where such code is known to break?
//! One suite for all of them.

use crate::furnished_room::{block, geometry, quads, walls};
use glam::{DMat3, DVec3};
use luxgraph::geometry::{Cone, Disc, Hit, Patch, Ray, Shape, Sphere};
use luxgraph::scene::{Geometry, ObjectId};
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::judge::{Crossing, END_ULPS, crossing, judge, judge_closest};
use luxgraph::tracers::voxel::VoxelTracer;
use luxgraph::tracers::{EmbreeTracer, RayTracer, Segment, embree};
use proptest::prelude::*;

/// How closely a tracer must follow brute force.
#[derive(Clone, Copy, PartialEq)]
enum Agreement {
    /// The same surface at the same parameter, always.
    Exact,
    /// But for rays that graze: the exact judge can defend the answer within rounding.
    ButGrazing,
}

/// A small generator of numbers in [-1, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// One tracer beside brute force on one scene.
struct Bench<'a> {
    geometry: &'a Geometry,
    tracer: Box<dyn RayTracer + 'a>,
    brute: BruteForce<'a>,
    agreement: Agreement,
}

impl<'a> Bench<'a> {
    fn new(
        geometry: &'a Geometry,
        make: impl Fn(&'a Geometry) -> Box<dyn RayTracer + 'a>,
        a: Agreement,
    ) -> Self {
        let (tracer, brute) = (make(geometry), BruteForce::new(geometry));
        Bench { geometry, tracer, brute, agreement: a }
    }

    fn ray(&self, ray: &Ray) {
        let (found, expected) = (self.tracer.closest(ray), self.brute.closest(ray));
        if found == expected {
            return;
        }
        let name = self.tracer.name();
        assert!(self.agreement == Agreement::ButGrazing, "{ray:?}: {name} finds {found:?}, not {expected:?}");
        if let (Some(a), Some(b)) = (found, expected)
            && a.surface == b.surface
        {
            // The same surface: the points differ across its plane by rounding at most.
            let normal = self.geometry.surface(a.surface).normal_at(ray.at(b.t));
            let speed = normal.dot(ray.direction).abs();
            let reach = ray.at(b.t).abs().max(ray.origin.abs()).max_element().max(self.geometry.radius);
            let band = END_ULPS * f64::from(f32::EPSILON) * reach;
            let surface = self.geometry.surface(a.surface);
            if (a.t - b.t).abs() * speed <= band && a.side == b.side {
                return;
            }
            // Or the nearer of two places on a round surface is one where the ray grazes it.
            let between = ray.at(0.5 * (a.t + b.t));
            let nearer = crossing(surface, ray.origin, between, 0.0, 1.0);
            assert!(
                surface.round().is_some() && matches!(nearer, Crossing::Grazes { .. }),
                "{ray:?}: {found:?}, not {expected:?}: {nearer:?}"
            );
            return;
        }
        let truth = judge_closest(self.geometry, ray);
        assert!(truth.allows(found.map(|h| h.surface)), "{ray:?}: {found:?}, not {expected:?}; {truth:?}");
    }

    fn segment(&self, segment: &Segment) {
        let found = self.tracer.blocker(segment).is_some();
        if found != self.brute.blocker(segment).is_some() {
            let name = self.tracer.name();
            assert!(self.agreement == Agreement::ButGrazing, "{segment:?}: {name} says blocked = {found}");
            let verdict = judge(self.geometry, segment);
            assert!(!verdict.refutes(found), "{segment:?}: {name} says blocked = {found}, {verdict:?}");
        }
    }

    /// Segment and ray from `a` to `b`.
    fn both(&self, a: DVec3, b: DVec3) {
        self.segment(&Segment { from: a.as_vec3(), to: b.as_vec3() });
        self.ray(&Ray { origin: a, direction: b - a, t_min: 0.0, t_max: f64::INFINITY });
    }
}

type Make<'m> = &'m dyn for<'a> Fn(&'a Geometry) -> Box<dyn RayTracer + 'a>;

fn random_rays(make: Make, agreement: Agreement) {
    let geometry = geometry(&quads());
    let bench = Bench::new(&geometry, make, agreement);
    let half = geometry.bounds().max;
    let mut random = Random(1);
    for _ in 0..50_000 {
        bench.both(random.point() * half, random.point() * half);
    }
    for _ in 0..5_000 {
        // From outside the box, towards it and away.
        bench.both(20.0 * random.point() * half, random.point() * half);
        // From a surface's corner, or middle, to another's.
        let pick = |r: f64| &geometry.surfaces[((r.abs() * 134.0) as usize).min(133)];
        let (a, b) = (pick(random.next()), pick(random.next()));
        bench.both(a.point_at(0.5, 0.5), b.point_at(0.5, 0.5));
        bench.both(a.vertices()[0], b.vertices()[2]);
        bench.both(a.point_at(0.5, 0.5), b.point_at(0.0, 0.25));
    }
}

fn voxel_planes(make: Make, agreement: Agreement) {
    // A power of two across: the planes between voxels are round numbers, and quads lie in them.
    let mut all = walls([-4.0; 3], [4.0; 3]);
    all.extend(block([-2.0, -1.0, -4.0], [1.0, 2.0, 0.0], 0.0, &[1, 2, 3, 4, 5]));
    all.extend(block([2.0, -2.0, 1.0], [3.0, 2.0, 2.0], 0.0, &[0, 1, 2, 3, 4, 5]));
    all.push([[-4.0, -4.0, 2.0], [0.0, -4.0, 2.0], [0.0, 4.0, 2.0], [-4.0, 4.0, 2.0]].map(DVec3::from));
    let geometry = geometry(&all);
    let bench = Bench::new(&geometry, make, agreement);
    let steps: Vec<f64> = (-5..=4).map(f64::from).chain([0.5, 1.1]).collect();
    for &x in &steps {
        for &y in &steps {
            for &z in &steps {
                let origin = DVec3::new(x, y, z);
                for d in 0..27 {
                    let d = DVec3::new(f64::from(d % 3), f64::from(d / 3 % 3), f64::from(d / 9)) - 1.0;
                    if d != DVec3::ZERO {
                        bench.ray(&Ray { origin, direction: d, t_min: 0.0, t_max: f64::INFINITY });
                        bench.segment(&Segment { from: origin.as_vec3(), to: (origin + 3.0 * d).as_vec3() });
                    }
                }
            }
        }
    }
}

fn in_planes(make: Make, agreement: Agreement) {
    let geometry = geometry(&quads());
    let bench = Bench::new(&geometry, make, agreement);
    let mut random = Random(2);
    for surface in &geometry.surfaces {
        let v = surface.vertices();
        for i in 0..v.len() {
            let (a, b) = (v[i], v[(i + 1) % v.len()]);
            bench.both(a, b);
            bench.both(a - (b - a), b);
            bench.both(a.lerp(b, 0.3), v[(i + 2) % v.len()]);
        }
        for _ in 0..20 {
            let mut place = || surface.point_at(2.0 * random.next(), 2.0 * random.next());
            bench.both(place(), place());
        }
    }
}

/// A closed room, turned so that nothing is round, its walls cut into n by n quads.
fn turned_room(n: u32) -> Geometry {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let mut all = Vec::new();
    for q in walls([-2.5, -2.0, -1.4], [2.5, 2.0, 1.4]) {
        let at = |i: u32, j: u32| {
            let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            turn * q[0].lerp(q[1], u).lerp(q[3].lerp(q[2], u), v)
        };
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            all.push([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    geometry(&all)
}

fn no_leaks(make: Make, agreement: Agreement) {
    let geometry = turned_room(6);
    let bench = Bench::new(&geometry, make, agreement);
    let mut random = Random(3);
    let (mut leaks, mut cast) = (0, 0);
    for surface in &geometry.surfaces {
        let v = surface.vertices();
        for _ in 0..20 {
            let origin = 0.8 * random.point();
            let on_edge = v[0].lerp(v[1], 0.5 + 0.5 * random.next());
            let on_diagonal = v[1].lerp(v[3], 0.5 + 0.5 * random.next());
            for target in [v[0], on_edge, on_diagonal] {
                let ray = Ray { origin, direction: target - origin, t_min: 0.0, t_max: f64::INFINITY };
                cast += 1;
                leaks += usize::from(bench.tracer.closest(&ray).is_none());
                bench.ray(&ray);
            }
        }
    }
    let allowed = if agreement == Agreement::Exact { 0 } else { cast / 1000 };
    assert!(leaks <= allowed, "{leaks} of {cast} rays left a closed room");
}

fn sizes_and_places(make: Make, agreement: Agreement) {
    for (size, place) in [
        (1e-3, DVec3::ZERO),
        (1e6, DVec3::ZERO),
        (1.0, DVec3::new(1e4, -2e4, 3e3)),
        (1e-3, DVec3::splat(-50.0)),
    ] {
        let all: Vec<_> = quads().iter().map(|q| q.map(|v| size * v + place)).collect();
        let geometry = geometry(&all);
        let bench = Bench::new(&geometry, make, agreement);
        let half = geometry.bounds().max;
        let mut random = Random(4);
        for _ in 0..2_000 {
            bench.both(1.1 * random.point() * half, random.point() * half);
        }
    }
}

fn warped(make: Make, agreement: Agreement) {
    // Bent by a fifth of its width: only the split v0 v1 v3 and v2 v3 v1 tells what it is.
    let mut random = Random(5);
    let mut all = vec![];
    for _ in 0..60 {
        let (o, x, y) = (3.0 * random.point(), random.point(), random.point());
        let bend = 0.2 * random.point();
        all.push([o, o + x, o + x + y + bend, o + y]);
    }
    let geometry = geometry(&all);
    let bench = Bench::new(&geometry, make, agreement);
    for _ in 0..20_000 {
        bench.both(4.0 * random.point(), 4.0 * random.point());
    }
    // The fold bulges towards v1-v3, not v0-v2: a point between the two is on its known side.
    let bent = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 1.0), DVec3::Y];
    let single = Geometry::new(vec![(Shape::Quad(bent), false, 0, ObjectId(0))], vec!["bent".into()]);
    let tracer = make(&single);
    let down = Ray {
        origin: DVec3::new(0.5, 0.5, 2.0) - single.centre,
        direction: -DVec3::Z,
        t_min: 0.0,
        t_max: f64::INFINITY,
    };
    let hit = tracer.closest(&down).expect("over the middle of the quad");
    assert!((hit.t - 2.0).abs() < 1e-6, "the diagonal v1-v3 is at height 0, v0-v2 at 0.5: t = {}", hit.t);
}

/// A bent patch about `size` wide, one edge of it a point if its `bend` is upwards.
fn patch(centre: DVec3, size: f64, bend: DVec3) -> Shape {
    let at = |i: usize, j: usize| {
        let (u, v) = (i as f64 / 3.0 - 0.5, j as f64 / 3.0 - 0.5);
        let narrow = if bend.z > 0.0 { v + 0.5 } else { 1.0 };
        let hump = if !i.is_multiple_of(3) && !j.is_multiple_of(3) { 1.5 } else { 0.0 };
        centre + size * (DVec3::new(narrow * u, v, u * v) + hump * bend)
    };
    Patch::new(std::array::from_fn(|j| std::array::from_fn(|i| at(i, j)))).into()
}

/// A room with balls, discs, cylinders, cones and patches in it, one around it all and one around one of them; turned,
/// of any `size`, anywhere.
fn round_shapes(make: Make, agreement: Agreement, size: f64, place: DVec3) {
    let mut shapes: Vec<Shape> = walls([-2.5, -2.0, -1.4], [2.5, 2.0, 1.4])
        .iter()
        .map(|q| Shape::Quad(q.map(|v| size * v + place)))
        .collect();
    let mut random = Random(7);
    for k in 0..20 {
        let (centre, radius) = (size * random.point() + place, size * (0.15 + 0.1 * random.next().abs()));
        let (axis, inward) = (random.point(), k % 8 < 4);
        let cone = |top_radius: f64| {
            let half = 0.3 * size * axis;
            Shape::from(Cone { base: centre - half, top: centre + half, radius, top_radius, inward })
        };
        shapes.push(match k % 4 {
            0 => Shape::from(Sphere { centre, radius, inward }),
            1 => Shape::from(Disc { centre, normal: axis.normalize(), radius }),
            2 if k % 3 == 0 => patch(centre, 2.0 * radius, axis),
            2 => cone(radius),
            _ => cone(if inward { 0.0 } else { 0.4 * radius }),
        });
    }
    shapes.push(Shape::from(Sphere { centre: place, radius: 4.0 * size, inward: true }));
    let geometry = Geometry::new(
        shapes.into_iter().enumerate().map(|(i, s)| (s, false, i as u32, ObjectId(0))).collect(),
        vec!["round".into()],
    );
    let bench = Bench::new(&geometry, make, agreement);
    let mut random = Random(8);
    let mut met = vec![0; geometry.surfaces.len()];
    for _ in 0..6_000 {
        let (a, b) = (3.0 * size * random.point(), 2.0 * size * random.point());
        bench.both(a, b);
        let ray = Ray { origin: a, direction: b - a, t_min: 0.0, t_max: f64::INFINITY };
        let hit = bench.tracer.closest(&ray).expect("all lies within a sphere");
        met[hit.surface.index()] += 1;
    }
    assert!(met.iter().all(|&n| n > 0), "{met:?}");
    for _ in 0..6_000 {
        // From surface to surface, to rims and poles, along tangents, and from a surface through itself.
        let mut pick = || &geometry.surfaces[6 + (random.next().abs() * 21.0) as usize % 21];
        let (from, to) = (pick(), pick());
        let mut unit = || 0.5 + 0.5 * random.next();
        let p = from.point_at(unit(), unit());
        let q = to.point_at(unit(), if unit() < 0.5 { 1.0 } else { unit() });
        let tangent = from.normal_at(p).cross(q - p).normalize() * size;
        bench.both(p, q);
        bench.both(q, 2.0 * q - p);
        bench.both(p - tangent, p + tangent);
        bench.both(p, 2.0 * from.middle() - p);
    }
}

fn round(make: Make, agreement: Agreement) {
    round_shapes(make, agreement, 1.0, DVec3::ZERO);
}

fn small_round(make: Make, agreement: Agreement) {
    round_shapes(make, agreement, 1e-3, DVec3::splat(2.0));
}

fn large_round(make: Make, agreement: Agreement) {
    round_shapes(make, agreement, 1e6, DVec3::ZERO);
}

fn far_round(make: Make, agreement: Agreement) {
    round_shapes(make, agreement, 1.0, DVec3::X * 1e4);
}

fn nonsense(make: Make, _: Agreement) {
    let geometry = geometry(&quads());
    let tracer = make(&geometry);
    let good = Ray { origin: DVec3::ZERO, direction: DVec3::X, t_min: 0.0, t_max: f64::INFINITY };
    assert!(tracer.closest(&good).is_some());
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in DVec3::AXES {
            assert_eq!(tracer.closest(&Ray { origin: bad * axis, ..good }), None);
            assert_eq!(tracer.closest(&Ray { direction: axis + bad * DVec3::X, ..good }), None);
        }
        let (from, to) = (DVec3::ZERO.as_vec3(), (bad * DVec3::ONE).as_vec3());
        assert_eq!(tracer.blocker(&Segment { from, to }), None);
        assert_eq!(tracer.blocker(&Segment { from: to, to: from }), None);
    }
    assert_eq!(tracer.closest(&Ray { t_min: f64::NAN, ..good }), None);
    assert_eq!(tracer.closest(&Ray { t_max: f64::NAN, ..good }), None);
    assert_eq!(tracer.closest(&Ray { t_min: 2.0, t_max: 1.0, ..good }), None);
    assert_eq!(tracer.closest(&Ray { direction: DVec3::ZERO, ..good }), None);
    assert_eq!(tracer.closest(&Ray { direction: DVec3::splat(1e-310), ..good }), None);
    for p in [DVec3::ZERO, DVec3::splat(0.3), geometry.surfaces[0].vertices()[0]] {
        assert_eq!(tracer.blocker(&Segment { from: p.as_vec3(), to: p.as_vec3() }), None);
    }
    let nothing = Geometry::new(vec![], vec![]);
    assert_eq!(make(&nothing).closest(&good), None);
}

fn batches(make: Make, _: Agreement) {
    batches_in(make, &geometry(&quads()));
}

/// Where searches go on in turn.
fn large_batches(make: Make, _: Agreement) {
    let hall = luxgraph::report::bench::hall::hall(24, 24).geometry;
    assert!(VoxelTracer::new(&hall).voxels().len() > 10_000);
    batches_in(make, &hall);
}

/// Many rays at once are answered as each by itself.
fn batches_in(make: Make, geometry: &Geometry) {
    let tracer = make(geometry);
    let mut random = Random(6);
    let half = geometry.bounds().max;
    let segments: Vec<Segment> = (0..1000)
        .map(|_| Segment { from: (random.point() * half).as_vec3(), to: (random.point() * half).as_vec3() })
        .collect();
    let mut blocked = vec![false; segments.len()];
    tracer.occluded_batch(&segments, &mut blocked);
    let alone = segments.iter().map(|s| tracer.blocker(s).is_some());
    let differ = alone.zip(&blocked).filter(|(a, b)| a != *b).count();
    assert!(differ <= 1, "{differ} of 1000 segments differ between one and many");
    assert!(blocked.contains(&true) && blocked.contains(&false));

    let ray = |k: usize, segment: &Segment| {
        let (from, to) = (segment.from.as_dvec3(), segment.to.as_dvec3());
        // Some end early, some hit nothing, and some are none.
        let t_max = if k.is_multiple_of(3) { 0.3 } else { f64::INFINITY };
        let origin = if k.is_multiple_of(50) { from + 100.0 * half } else { from };
        let direction = if k.is_multiple_of(70) { DVec3::NAN } else { to - from };
        Ray { origin, direction, t_min: 0.0, t_max }
    };
    let rays: Vec<Ray> = segments.iter().enumerate().map(|(k, segment)| ray(k, segment)).collect();
    let mut hits = vec![None; rays.len()];
    tracer.closest_batch(&rays, &mut hits);
    let met = |hit: &Option<Hit>| hit.map(|hit| (hit.surface, hit.side, hit.t));
    let differ = rays.iter().zip(&hits).filter(|(ray, hit)| met(&tracer.closest(ray)) != met(hit)).count();
    assert!(differ <= 1, "{differ} of 1000 rays differ between one and many");
    assert!(hits.iter().any(Option::is_none) && hits.iter().filter(|hit| hit.is_some()).count() > 500);
}

fn voxel(check: fn(Make, Agreement)) {
    check(&|g| Box::new(VoxelTracer::new(g)), Agreement::Exact);
}

/// Checks Embree where it is built in.
fn embree(check: fn(Make, Agreement)) {
    if embree::available().is_some() {
        check(&|g| Box::new(EmbreeTracer::new(g).expect("Embree takes the scene")), Agreement::ButGrazing);
    }
}

/// A test for each of the functions above.
macro_rules! suite {
    ($name:ident, $tracer:ident: $($check:ident)*) => {
        mod $name {
            $(#[test]
            fn $check() {
                super::$tracer(super::$check);
            })*
        }
    };
}

suite!(voxel_tracer, voxel: random_rays voxel_planes in_planes no_leaks sizes_and_places warped
    round small_round large_round far_round nonsense batches large_batches);
suite!(embree_tracer, embree: random_rays voxel_planes in_planes no_leaks sizes_and_places warped
    round small_round large_round far_round nonsense batches large_batches);

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..Default::default() })]

    /// Random parallelograms, half of them on a coarse lattice so that planes, edges and vertices
    /// coincide with each other, with voxel planes and with the segments' ends.
    #[test]
    fn random_scenes(seed in any::<u64>(), count in 1usize..40, coarse in any::<bool>(), level in 0u8..12) {
        let mut random = Random(seed);
        let mut place = || {
            let p = random.point();
            if coarse { (4.0 * p).round() } else { 4.0 * p }
        };
        let mut all = vec![];
        while all.len() < count {
            let (o, x, y) = (place(), place(), place());
            if x.cross(y).length() > 1e-3 {
                all.push([o, o + x, o + x + y, o + y]);
            }
        }
        let geometry = geometry(&all);
        let settings = luxgraph::voxels::VoxelSettings { max_objects: 1, max_level: level };
        let make = |g| -> Box<dyn RayTracer> { Box::new(VoxelTracer::with_settings(g, &settings)) };
        let bench = Bench::new(&geometry, make, Agreement::Exact);
        for _ in 0..100 {
            bench.both(place(), place());
        }
    }
}

//! Do points that something covers or parts keep their dark to themselves, and real shadows stay?

use glam::DVec3;
use luxgraph::first_pass::DiffuseSolution;
use luxgraph::geometry::{Shape, Side, SurfaceId};
use luxgraph::points::{SamplePoints, Sampling, divide_by_area};
use luxgraph::scene::{Geometry, ObjectId};
use luxgraph::second_pass::Interpolator;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::brute_force::BruteForce;

/// The floor of a room of 4 x 4 x 3 m, its corner at the origin, and then the other five faces.
fn room() -> Vec<Shape> {
    body(DVec3::ZERO, DVec3::new(4.0, 4.0, 3.0), true, &[])
}

/// A box without the faces `without`: bottom, top, y low, y high, x low, x high.
fn body(low: DVec3, high: DVec3, inwards: bool, without: &[usize]) -> Vec<Shape> {
    let p = |i: usize| {
        let pick = |bit: usize, l: f64, h: f64| if i >> bit & 1 == 1 { h } else { l };
        DVec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
    };
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        .into_iter()
        .enumerate()
        .filter(|(face, _)| !without.contains(face))
        .map(|(_, mut corners)| {
            if inwards {
                corners.reverse();
            }
            Shape::Quad(corners.map(p))
        })
        .collect()
}

struct Scene {
    geometry: Geometry,
    points: SamplePoints,
    interpolator: Interpolator,
}

impl Scene {
    fn new(shapes: Vec<Shape>) -> Scene {
        let shapes = shapes.into_iter().enumerate().map(|(i, s)| (s, false, i as u32, ObjectId(0))).collect();
        let geometry = Geometry::new(shapes, vec!["scene".into()]);
        let elements = divide_by_area(&geometry, &Sampling::by_area(0.07));
        let points = SamplePoints::new(&geometry, &elements, 1, |_| 0);
        let interpolator = Interpolator::new(&geometry, &points, &BruteForce::new(&geometry));
        Scene { geometry, points, interpolator }
    }

    /// World places of the covered points of a surface.
    fn covered(&self, surface: u32) -> Vec<DVec3> {
        let of = |i: &usize| self.points.surface[*i].0 == surface;
        self.interpolator.covered().filter(of).map(|i| self.place(i)).collect()
    }

    fn place(&self, i: usize) -> DVec3 {
        self.points.position[i].as_dvec3() + self.geometry.centre
    }

    /// L^d at world places of a surface when every point has what `radiance` says.
    fn at(&self, surface: u32, places: &[DVec3], radiance: impl Fn(DVec3) -> f32) -> Vec<f32> {
        let wavelengths = Wavelengths::points(vec![550.0], vec![[1.0; 3]]);
        let radiance = (0..self.points.len()).map(|i| radiance(self.place(i))).collect();
        let solution = DiffuseSolution { wavelengths, parts: None, radiance, stats: Default::default() };
        let field = self.interpolator.field(&solution);
        let mut out = [f32::NAN];
        let look = |p: &DVec3| {
            field.radiance(SurfaceId(surface), Side::Front, *p - self.geometry.centre, &mut out);
            out[0]
        };
        places.iter().map(look).collect()
    }
}

/// Places on a plane, as `place(a, b)`, on a grid of 5 cm over 4 m x `high`.
fn grid(high: f64, place: impl Fn(f64, f64) -> DVec3) -> Vec<DVec3> {
    let steps = (high / 0.05) as usize;
    (0..=80 * (steps + 1)).map(|i| place(0.05 * (i % 81) as f64, 0.05 * (i / 81) as f64)).collect()
}

#[test]
fn the_wall_is_clean_up_to_the_picture() {
    // 2 cm before the wall y = 4, without a rear.
    let (low, high) = (DVec3::new(1.03, 3.98, 1.11), DVec3::new(2.31, 4.0, 2.27));
    for gap in [0.0, 0.01] {
        let out = DVec3::new(0.0, gap, 0.0);
        let mut shapes = room();
        shapes.extend(body(low - out, high - out, false, &[3]));
        let scene = Scene::new(shapes);
        let behind =
            |p: DVec3| p.y > 3.999 && p.cmpgt(low).x && p.cmplt(high).x && p.z > low.z && p.z < high.z;
        assert!(scene.covered(3).iter().all(|p| behind(*p)) && scene.covered(3).len() > 10);
        let seen: Vec<DVec3> =
            grid(3.0, |x, z| DVec3::new(x, 4.0, z)).into_iter().filter(|p| !behind(*p)).collect();
        let found = scene.at(3, &seen, |p| if behind(p) { 0.0 } else { 1.0 });
        let worst = found.iter().copied().fold(1.0, f32::min);
        assert!(worst > 0.999, "gap {gap}: {worst}");
        // A field that rises evenly stays so beside the picture but for half an element's worth.
        let found = scene.at(3, &seen, |p| if behind(p) { 0.0 } else { p.x as f32 });
        for (l, p) in found.iter().zip(&seen) {
            assert!((f64::from(*l) - p.x).abs() < 0.2, "{l} at {p}");
        }
    }
}

#[test]
fn the_floor_is_clean_at_the_foot_of_bodies_that_stand_on_it() {
    let (low, high) = (DVec3::new(1.03, 1.12, 0.0), DVec3::new(2.31, 2.21, 0.8));
    // A cupboard against the wall x = 0 by a hair's breadth, open at its rear, sees floor and wall.
    let (left, right) = (DVec3::new(0.001, 2.9, 0.0), DVec3::new(0.45, 3.8, 0.9));
    let mut shapes = room();
    shapes.extend(body(low, high, false, &[0]));
    shapes.extend(body(left, right, false, &[0, 4]));
    let scene = Scene::new(shapes);
    let within = |p: DVec3, a: DVec3, b: DVec3| p.cmpge(a - 0.002).all() && p.cmple(b).all();
    let under = |p: DVec3| within(p, low, high) || within(p, left, right);
    for (surface, seen) in
        [(0, grid(4.0, |x, y| DVec3::new(x, y, 0.0))), (4, grid(3.0, |y, z| DVec3::new(0.0, y, z)))]
    {
        assert!(scene.covered(surface).iter().all(|p| under(*p)));
        let seen: Vec<DVec3> = seen.into_iter().filter(|p| !under(*p)).collect();
        let found = scene.at(surface, &seen, |p| if under(p) { 0.0 } else { 1.0 });
        for (l, p) in found.iter().zip(&seen) {
            assert!(*l > 0.999, "surface {surface}: {l} at {p}");
        }
    }
}

#[test]
fn shadows_that_light_can_reach_stay() {
    let mut shapes = room();
    // A table top 0.7 m and a shelf 0.2 m above the floor, and a leg 10 cm thick from floor to table.
    shapes.extend(body(DVec3::new(0.5, 0.5, 0.7), DVec3::new(2.0, 2.0, 0.75), false, &[]));
    shapes.extend(body(DVec3::new(2.5, 2.5, 0.2), DVec3::new(3.5, 3.0, 0.25), false, &[]));
    let (low, high) = (DVec3::new(1.1, 1.1, 0.0), DVec3::new(1.2, 1.2, 0.7));
    shapes.extend(body(low, high, false, &[0, 1]));
    let scene = Scene::new(shapes);
    let under_leg = |p: DVec3| p.x > low.x && p.x < high.x && p.y > low.y && p.y < high.y;
    assert!(scene.covered(0).iter().all(|p| under_leg(*p)), "{:?}", scene.covered(0));
}

#[test]
fn an_empty_room_has_nothing_covered() {
    let scene = Scene::new(room());
    assert_eq!(scene.interpolator.covered().count(), 0);
}

/// A sheet that stands oblique to the rows of elements, and the side of it on which a place lies.
fn sheet() -> (Shape, impl Fn(DVec3) -> f64) {
    let (a, b) = (DVec3::new(0.73, 1.17, 0.0), DVec3::new(2.93, 2.41, 0.0));
    let across = DVec3::Z.cross(b - a).normalize();
    (Shape::Quad([a, b, b + DVec3::Z, a + DVec3::Z]), move |p: DVec3| across.dot(p - a))
}

#[test]
fn a_standing_sheet_parts_light_from_shade() {
    let (shape, side) = sheet();
    let scene = Scene::new([room(), vec![shape]].concat());
    let v =
        scene.geometry.surfaces[6].vertices().iter().map(|v| *v + scene.geometry.centre).collect::<Vec<_>>();
    let mut places = Vec::new();
    for i in 0..=100 {
        let foot = v[0].lerp(v[1], 0.2 + 0.006 * f64::from(i));
        let across = DVec3::Z.cross(v[1] - v[0]).normalize();
        places.extend([-0.2, -0.05, -0.001, 0.001, 0.05, 0.2].map(|d| foot + d * across));
    }
    for (l, p) in scene.at(0, &places, |p| if side(p) > 0.0 { 1.0 } else { 0.0 }).iter().zip(&places) {
        let expected = if side(*p) > 0.0 { 1.0 } else { 0.0 };
        assert!((l - expected).abs() < 1e-6, "{l} at {p}");
    }
}

#[test]
fn light_goes_evenly_into_shade_around_the_end_of_a_sheet() {
    let (shape, side) = sheet();
    let scene = Scene::new([room(), vec![shape]].concat());
    let end = scene.geometry.surfaces[6].vertices()[1] + scene.geometry.centre;
    let along = (end - scene.geometry.surfaces[6].vertices()[0] - scene.geometry.centre).normalize();
    // Around the end, from one side of the sheet to the other.
    for radius in [0.1, 0.2, 0.35, 0.6] {
        let steps = 4000;
        let ring = |k: i32| {
            let angle = std::f64::consts::PI * (2.0 * f64::from(k) / f64::from(steps) - 1.0) * 0.998;
            end + radius * (angle.cos() * along + angle.sin() * DVec3::Z.cross(along))
        };
        let places: Vec<DVec3> = (0..=steps).map(ring).collect();
        let found = scene.at(0, &places, |p| if side(p) > 0.0 { 1.0 } else { 0.0 });
        let jump = found.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f32::max);
        // An element is 0.25 m wide, a step at most 1 mm.
        assert!(jump < 0.01, "radius {radius}: {jump}");
        // Closer to the end the two sides mix.
        if radius > 0.15 {
            let (shade, light) = (found[0], found[steps as usize]);
            assert!(shade < 1e-3 && light > 0.999, "radius {radius}: {shade} {light}");
        }
    }
}

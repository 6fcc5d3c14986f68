//! Is the radiance between sample points what sampling theory promises?

use glam::{DVec2, DVec3};
use luxgraph::first_pass::DiffuseSolution;
use luxgraph::geometry::{Shape, Side, SurfaceId};
use luxgraph::points::{Cell, Element, SamplePoints};
use luxgraph::scene::{Geometry, ObjectId};
use luxgraph::second_pass::{DiffuseField, Interpolator};
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::brute_force::BruteForce;

fn wavelengths(n: usize) -> Wavelengths {
    let nm: Vec<f64> = (0..n).map(|i| 450.0 + 50.0 * i as f64).collect();
    Wavelengths::points(nm, vec![[1.0; 3]; n])
}

fn geometry(shapes: &[(Shape, bool, u32)]) -> Geometry {
    let shapes =
        shapes.iter().map(|(shape, two_sided, patch)| (shape.clone(), *two_sided, *patch, ObjectId(0)));
    Geometry::new(shapes.collect(), vec!["object".into()])
}

/// Cells refined towards one place, so that neighbours differ by several levels, and elsewhere
/// by chance.
fn uneven(surface: u32, shape: &Shape, deepest: u8) -> Vec<Element> {
    let mut open = vec![Cell::ROOT];
    let mut elements = Vec::new();
    let mut chance = 12345u32.wrapping_add(surface);
    while let Some(cell) = open.pop() {
        let corners = cell.corners_uv(shape);
        let (low, high) = corners.iter().fold((DVec2::ONE, DVec2::ZERO), |(l, h), c| (l.min(*c), h.max(*c)));
        let focus = DVec2::new(0.37, 0.31);
        chance = chance.wrapping_mul(1664525).wrapping_add(1013904223);
        let holds_focus = low.cmple(focus).all() && focus.cmple(high).all();
        let divide = cell.level < 2 || (cell.level < deepest && (holds_focus || chance >> 30 == 0));
        if divide {
            open.extend((0..4).map(|c| cell.child(c)));
        } else {
            elements.push((SurfaceId(surface), cell));
        }
    }
    elements
}

fn even(surface: u32, level: u8) -> Vec<Element> {
    let mut cells = vec![Cell::ROOT];
    for _ in 0..level {
        cells = cells.iter().flat_map(|c| (0..4).map(|k| c.child(k))).collect();
    }
    cells.into_iter().map(|c| (SurfaceId(surface), c)).collect()
}

fn points(geometry: &Geometry, elements: &[Element]) -> SamplePoints {
    SamplePoints::new(geometry, elements, 1, |_| 0)
}

fn interpolator(geometry: &Geometry, points: &SamplePoints) -> Interpolator {
    Interpolator::new(geometry, points, &BruteForce::new(geometry))
}

fn solution(points: &SamplePoints, radiance: impl Fn(usize) -> [f32; 2]) -> DiffuseSolution {
    let radiance = (0..points.len()).flat_map(radiance).collect();
    DiffuseSolution { wavelengths: wavelengths(2), parts: None, radiance, stats: Default::default() }
}

fn at(field: &DiffuseField, surface: u32, side: Side, p: DVec3) -> [f32; 2] {
    let mut out = [f32::NAN; 2];
    field.radiance(SurfaceId(surface), side, p, &mut out);
    out
}

/// Places all over a shape, corners and edges included.
fn places(shape: &Shape, n: u32) -> Vec<DVec2> {
    let mut places = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            let uv = DVec2::new(f64::from(i), f64::from(j)) / f64::from(n);
            if matches!(shape, Shape::Quad(_)) || uv.x + uv.y <= 1.0 {
                places.push(uv);
            }
        }
    }
    places
}

const QUAD: Shape = Shape::Quad([
    DVec3::new(0.0, 0.0, 1.0),
    DVec3::new(3.0, -0.5, 1.0),
    DVec3::new(2.0, 2.0, 1.0),
    DVec3::new(-0.3, 1.4, 1.0),
]);
const RECTANGLE: Shape = Shape::Quad([
    DVec3::new(0.0, 0.0, 0.0),
    DVec3::new(0.0, 3.0, 0.0),
    DVec3::new(0.0, 3.0, 1.0),
    DVec3::new(0.0, 0.0, 1.0),
]);
const TRIANGLE: Shape =
    Shape::Triangle([DVec3::new(0.0, 0.0, 0.0), DVec3::new(2.0, 0.3, 0.0), DVec3::new(0.4, 1.5, 0.2)]);

#[test]
fn linear_fields_and_constants_are_exact_even_where_refinement_is_uneven() {
    for shape in [QUAD, RECTANGLE, TRIANGLE] {
        for deepest in [2, 4, 7] {
            let geometry = geometry(&[(shape.clone(), false, 0)]);
            let points = points(&geometry, &uneven(0, &shape, deepest));
            let linear = |p: DVec3| 20.0 + DVec3::new(1.3, -2.1, 0.7).dot(p);
            let surface = &geometry.surfaces[0];
            let solution = solution(&points, |i| {
                let uv = points.cell[i].centre_uv(&shape);
                [linear(surface.point_at(uv.x, uv.y)) as f32, 5.0]
            });
            let interpolator = interpolator(&geometry, &points);
            let field = interpolator.field(&solution);
            for uv in places(&shape, 97) {
                let p = surface.point_at(uv.x, uv.y);
                let [l, constant] = at(&field, 0, Side::Front, p);
                assert!((f64::from(l) - linear(p)).abs() < 2e-5, "{shape:?} {deepest} {uv}: {l}");
                assert!((constant - 5.0).abs() < 2e-6);
            }
        }
    }
}

#[test]
fn fields_are_continuous_across_hanging_nodes() {
    for shape in [QUAD, RECTANGLE, TRIANGLE] {
        let geometry = geometry(&[(shape.clone(), false, 0)]);
        let points = points(&geometry, &uneven(0, &shape, 7));
        // Rough on purpose: every point its own value.
        let solution = solution(&points, |i| [(i * 2654435761 % 1000) as f32 / 1000.0, 1.0]);
        let interpolator = interpolator(&geometry, &points);
        let field = interpolator.field(&solution);
        let surface = &geometry.surfaces[0];
        let step = 1e-7;
        // Across every element's edges, at places where nothing is special but the edge.
        for i in 0..points.len() {
            let corners = points.cell[i].corners_uv(&shape);
            let centre = points.cell[i].centre_uv(&shape);
            for k in 0..4 {
                for s in [0.013, 0.24, 0.26, 0.5, 0.61, 0.987] {
                    let on_edge = corners[k].lerp(corners[(k + 1) % 4], s);
                    let outward = (on_edge - centre).normalize_or_zero();
                    let side = |d: f64| {
                        let uv = on_edge + d * outward;
                        at(&field, 0, Side::Front, surface.point_at(uv.x, uv.y))[0]
                    };
                    let jump = (side(step) - side(-step)).abs();
                    assert!(jump < 1e-4, "{shape:?} element {i} edge {k} at {s}: {jump}");
                }
            }
        }
    }
}

#[test]
fn equal_cells_are_bilinear_between_the_four_closest_points() {
    let shape = RECTANGLE;
    let geometry = geometry(&[(shape.clone(), false, 0)]);
    let points = points(&geometry, &even(0, 3));
    let value = |i: usize| (i * 2654435761 % 1000) as f32;
    let solution = solution(&points, |i| [value(i), 0.0]);
    let interpolator = interpolator(&geometry, &points);
    let field = interpolator.field(&solution);
    let of_cell = |a: usize, b: usize| {
        let centre = DVec2::new(a as f64 + 0.5, b as f64 + 0.5) / 8.0;
        let found = (0..points.len()).find(|&i| (points.cell[i].centre_uv(&shape) - centre).length() < 1e-9);
        value(found.expect("every cell has a point"))
    };
    for a in 0..7 {
        for b in 0..7 {
            for (s, t) in [(0.1, 0.2), (0.5, 0.5), (0.7, 0.1), (0.9, 0.95)] {
                let uv = DVec2::new(a as f64 + 0.5 + s, b as f64 + 0.5 + t) / 8.0;
                let found = at(&field, 0, Side::Front, geometry.surfaces[0].point_at(uv.x, uv.y))[0];
                let (s, t) = (s as f32, t as f32);
                let expected = (1.0 - t) * ((1.0 - s) * of_cell(a, b) + s * of_cell(a + 1, b))
                    + t * ((1.0 - s) * of_cell(a, b + 1) + s * of_cell(a + 1, b + 1));
                assert!((found - expected).abs() < 0.01, "{uv}: {found} for {expected}");
            }
        }
    }
}

#[test]
fn borders_are_extrapolated_but_never_negative_nor_wild() {
    let shape = RECTANGLE;
    let geometry = geometry(&[(shape.clone(), false, 0)]);
    let points = points(&geometry, &even(0, 3));
    // A sharp shadow along the border: straight extrapolation would go to -0.5 and to 1.5.
    let solution = solution(&points, |i| {
        let column = (points.cell[i].centre_uv(&shape).x * 8.0) as i32;
        [if column == 0 { 0.0 } else { 1.0 }, if column == 0 { 1.0 } else { 0.0 }]
    });
    let interpolator = interpolator(&geometry, &points);
    let field = interpolator.field(&solution);
    for uv in places(&shape, 64) {
        let l = at(&field, 0, Side::Front, geometry.surfaces[0].point_at(uv.x, uv.y));
        assert!(l.iter().all(|x| (0.0..=2.0).contains(x)), "{uv}: {l:?}");
    }
}

#[test]
fn sides_and_surfaces_do_not_bleed_and_missing_sides_are_black() {
    let (left, right) = (
        Shape::Quad([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]),
        Shape::Quad([DVec3::X, 2.0 * DVec3::X, DVec3::new(2.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 0.0)]),
    );
    let geometry = geometry(&[(left.clone(), true, 0), (right.clone(), false, 1)]);
    let points = points(&geometry, &[even(0, 2), even(1, 3)].concat());
    let solution = solution(&points, |i| match (points.surface[i].0, points.side[i]) {
        (0, Side::Front) => [1.0, 0.0],
        (0, Side::Back) => [2.0, 0.0],
        _ => [4.0, 0.0],
    });
    let interpolator = interpolator(&geometry, &points);
    let field = interpolator.field(&solution);
    for uv in places(&left, 33) {
        let (p, q) = (geometry.surfaces[0].point_at(uv.x, uv.y), geometry.surfaces[1].point_at(uv.x, uv.y));
        assert!((at(&field, 0, Side::Front, p)[0] - 1.0).abs() < 1e-6);
        assert!((at(&field, 0, Side::Back, p)[0] - 2.0).abs() < 1e-6);
        assert!((at(&field, 1, Side::Front, q)[0] - 4.0).abs() < 1e-6);
        assert_eq!(at(&field, 1, Side::Back, q), [0.0, 0.0]);
    }
}

#[test]
fn two_triangles_of_one_patch_show_no_seam() {
    // A warped quad, split on v1 v3.
    let v = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.1), DVec3::Y];
    let triangles = [Shape::Triangle([v[0], v[1], v[3]]), Shape::Triangle([v[2], v[3], v[1]])];
    for (patches, joined) in [([0, 0], true), ([0, 1], false)] {
        let geometry =
            geometry(&[(triangles[0].clone(), false, patches[0]), (triangles[1].clone(), false, patches[1])]);
        let points = points(&geometry, &[even(0, 2), uneven(1, &triangles[1], 5)].concat());
        let solution = solution(&points, |i| [(i * 2654435761 % 1000) as f32 / 1000.0, 1.0]);
        let interpolator = interpolator(&geometry, &points);
        let field = interpolator.field(&solution);
        let mut widest = 0.0f32;
        for k in 0..=100 {
            let p = geometry.surfaces[0].vertices()[1]
                .lerp(geometry.surfaces[0].vertices()[2], f64::from(k) / 100.0);
            let jump = at(&field, 0, Side::Front, p)[0] - at(&field, 1, Side::Front, p)[0];
            widest = widest.max(jump.abs());
        }
        assert_eq!(widest < 1e-4, joined, "largest jump {widest}");
    }
}

#[test]
fn the_coarsest_surfaces_work() {
    for shape in [QUAD, TRIANGLE] {
        let geometry = geometry(&[(shape.clone(), false, 0)]);
        let points = points(&geometry, &even(0, 0));
        let solution = solution(&points, |_| [3.0, 0.0]);
        let interpolator = interpolator(&geometry, &points);
        let field = interpolator.field(&solution);
        for uv in places(&shape, 8) {
            let l = at(&field, 0, Side::Front, geometry.surfaces[0].point_at(uv.x, uv.y));
            assert!((l[0] - 3.0).abs() < 1e-6);
        }
    }
}

//! Furnished rooms for tests, and sample points in a regular grid of voxels.
#![allow(dead_code, reason = "each group of tests uses its share")]

use glam::{DMat3, DVec3};
use luxgraph::geometry::Shape;
use luxgraph::points::{Element, SamplePoints, Sampling, divide_by_area};
use luxgraph::scene::{Geometry, ObjectId};

/// Collects quadrilaterals.
#[derive(Default)]
pub struct Furniture {
    shapes: Vec<(Shape, bool, u32, ObjectId)>,
}

impl Furniture {
    pub fn quad(&mut self, v: [DVec3; 4], two_sided: bool) {
        let patch = self.shapes.len() as u32;
        self.shapes.push((Shape::Quad(v), two_sided, patch, ObjectId(0)));
    }

    pub fn triangle(&mut self, v: [DVec3; 3], two_sided: bool) {
        let patch = self.shapes.len() as u32;
        self.shapes.push((Shape::Triangle(v), two_sided, patch, ObjectId(0)));
    }

    /// Triangles that are one smooth surface.
    pub fn smooth(&mut self, triangles: impl IntoIterator<Item = [DVec3; 3]>) {
        let patch = self.shapes.len() as u32;
        let shapes = triangles.into_iter().map(|t| (Shape::Triangle(t), false, patch, ObjectId(0)));
        self.shapes.extend(shapes);
    }

    /// A box of half extents `half` about `centre`, turned by `turn`; its faces look outwards, or
    /// inwards for a room.
    pub fn block(&mut self, centre: DVec3, half: DVec3, turn: DMat3, inwards: bool) {
        let at = |x: f64, y: f64, z: f64| centre + turn * (half * DVec3::new(x, y, z));
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let corner = |u: f64, v: f64| {
                    let mut p = [0.0; 3];
                    p[axis] = sign;
                    p[(axis + 1) % 3] = u;
                    p[(axis + 2) % 3] = v;
                    at(p[0], p[1], p[2])
                };
                let mut v = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                if (sign > 0.0) == inwards {
                    v.reverse();
                }
                self.quad(v, false);
            }
        }
    }

    /// A table top or a seat on four legs, its middle on the floor at `(x, y)`.
    pub fn table(&mut self, [x, y]: [f64; 2], size: DVec3, turn_deg: f64) {
        let turn = DMat3::from_rotation_z(turn_deg.to_radians());
        let foot = DVec3::new(x, y, 0.0);
        let (half, leg) = (0.5 * size, 0.03);
        let top = DVec3::new(0.0, 0.0, size.z - 0.02);
        self.block(foot + top, DVec3::new(half.x, half.y, 0.02), turn, false);
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let height = 0.5 * (size.z - 0.04);
            let place = DVec3::new(sx * (half.x - leg), sy * (half.y - leg), height);
            self.block(foot + turn * place, DVec3::new(leg, leg, height), turn, false);
        }
    }

    pub fn geometry(self) -> Geometry {
        Geometry::new(self.shapes, vec!["room".into()])
    }
}

/// A ball of 8 x 4^`level` triangles, seen from outside.
pub fn ball(centre: DVec3, radius: f64, level: u32) -> Vec<[DVec3; 3]> {
    let sign = |bit: u32, i: u32| if i >> bit & 1 == 1 { -1.0 } else { 1.0 };
    let eighth = |i: u32| {
        let (x, y, z) = (sign(0, i) * DVec3::X, sign(1, i) * DVec3::Y, sign(2, i) * DVec3::Z);
        if i.count_ones().is_multiple_of(2) { [x, y, z] } else { [y, x, z] }
    };
    let mut triangles: Vec<[DVec3; 3]> = (0..8).map(eighth).collect();
    for _ in 0..level {
        let quarters = |[a, b, c]: [DVec3; 3]| {
            let [p, q, r] = [(a, b), (b, c), (c, a)].map(|(a, b)| (a + b).normalize());
            [[a, p, r], [p, b, q], [r, q, c], [p, q, r]]
        };
        triangles = triangles.into_iter().flat_map(quarters).collect();
    }
    triangles.into_iter().map(|t| t.map(|v| centre + radius * v)).collect()
}

/// A room of 5 x 4 x 2.8 m with a table, boxes square and turned, and a two-sided pane: 62 quads;
/// or, `rich`, with two chairs and more boxes too: 134.
pub fn furnished_room(rich: bool) -> Geometry {
    let straight = DMat3::IDENTITY;
    let turned = |deg: f64| DMat3::from_rotation_z(deg.to_radians());
    let mut room = Furniture::default();
    room.block(DVec3::new(2.5, 2.0, 1.4), DVec3::new(2.5, 2.0, 1.4), straight, true);
    room.table([2.6, 2.1], DVec3::new(1.6, 0.9, 0.74), 12.0);
    room.block(DVec3::new(0.35, 0.5, 0.9), DVec3::new(0.3, 0.5, 0.9), straight, false);
    room.block(DVec3::new(4.2, 3.4, 0.4), DVec3::new(0.4, 0.3, 0.4), turned(35.0), false);
    room.block(DVec3::new(2.4, 2.0, 0.84), DVec3::new(0.1, 0.15, 0.1), turned(-20.0), false);
    // A luminaire under the ceiling, tilted.
    let tilt = DMat3::from_rotation_x(0.3);
    room.block(DVec3::new(3.0, 1.0, 2.4), DVec3::new(0.6, 0.1, 0.05), tilt, false);
    let pane = [(1.3, 2.6), (1.9, 3.6)];
    let at = |(x, y): (f64, f64), z: f64| DVec3::new(x, y, z);
    room.quad([at(pane[0], 0.3), at(pane[1], 0.3), at(pane[1], 2.0), at(pane[0], 2.0)], true);
    // A picture that hangs on the wall.
    let (left, right) = ((2.0, 0.002), (1.0, 0.002));
    room.quad([at(left, 1.2), at(right, 1.2), at(right, 1.9), at(left, 1.9)], false);
    if rich {
        room.table([1.9, 1.2], DVec3::new(0.42, 0.42, 0.46), 75.0);
        room.table([3.3, 2.9], DVec3::new(0.42, 0.42, 0.46), -15.0);
        room.block(DVec3::new(4.8, 1.2, 1.1), DVec3::new(0.15, 0.6, 1.1), straight, false);
        room.block(DVec3::new(0.9, 3.7, 0.25), DVec3::new(0.3, 0.2, 0.25), turned(8.0), false);
    }
    room.geometry()
}

/// Points on elements no larger than `max_area`, in `n` x `n` x `n` voxels.
pub fn sample(geometry: &Geometry, max_area: f64, n: usize) -> SamplePoints {
    points(geometry, &divide_by_area(geometry, &Sampling::by_area(max_area)), n)
}

/// Points on `elements` in `n` x `n` x `n` voxels.
pub fn points(geometry: &Geometry, elements: &[Element], n: usize) -> SamplePoints {
    let bounds = geometry.bounds();
    SamplePoints::new(geometry, elements, n * n * n, |p| {
        let cell =
            ((p - bounds.min) / bounds.size() * n as f64).clamp(DVec3::ZERO, DVec3::splat(n as f64 - 0.5));
        (cell.x as usize * n + cell.y as usize) * n + cell.z as usize
    })
}

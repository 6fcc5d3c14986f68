//! Which points face each other: the one definition that every stage uses.
//!
//! Two points face each other when they lie on different surfaces and each is in front of the
//! other's plane by more than [`Geometry::plane_tolerance`]. Points of one surface, of coplanar
//! surfaces, and a point and its twin therefore never do.

use super::SamplePoints;
use crate::geometry::{Side, SurfaceId};
use crate::scene::Geometry;
use glam::DVec3;

/// The plane of one side of a surface; in front is where that side looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SidePlane {
    /// Unit normal of the side.
    pub normal: DVec3,
    /// `normal · x = offset` on the plane, m.
    pub offset: f64,
}

impl SidePlane {
    /// The plane of `side` of `surface`.
    pub fn new(geometry: &Geometry, surface: SurfaceId, side: Side) -> Self {
        let s = geometry.surface(surface);
        match side {
            Side::Front => SidePlane { normal: s.normal, offset: s.offset },
            Side::Back => SidePlane { normal: -s.normal, offset: -s.offset },
        }
    }

    /// Signed distance of `p` from the plane, positive in front, m.
    #[inline]
    pub fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }
}

/// Whether points `i` and `j` face each other. Nothing is said of what stands between them.
pub fn face_each_other(geometry: &Geometry, points: &SamplePoints, i: usize, j: usize) -> bool {
    let tolerance = geometry.plane_tolerance();
    let above = |i: usize, j: usize| {
        SidePlane::new(geometry, points.surface[i], points.side[i]).height(points.position[j].as_dvec3())
            > tolerance
    };
    points.surface[i] != points.surface[j] && above(i, j) && above(j, i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::points::{NO_POINT, Sampling, divide_by_area};
    use crate::scene::ObjectId;

    /// A square of side 1 in the plane z = `z`, looking up or down.
    fn square(x: f64, z: f64, up: bool) -> Shape {
        let at = |u: f64, v: f64| DVec3::new(x + u, v, z);
        if up {
            Shape::Quad([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)])
        } else {
            Shape::Quad([at(0.0, 0.0), at(0.0, 1.0), at(1.0, 1.0), at(1.0, 0.0)])
        }
    }

    fn sampled(shapes: &[(Shape, bool)]) -> (Geometry, SamplePoints) {
        let shapes = shapes.iter().map(|&(s, two)| (s, two, 0, ObjectId(0))).collect();
        let geometry = Geometry::new(shapes, vec!["squares".into()]);
        let elements = divide_by_area(&geometry, &Sampling::by_area(0.3));
        let points = SamplePoints::new(&geometry, &elements, 1, |_| 0);
        (geometry, points)
    }

    #[test]
    fn opposite_squares_face_only_with_their_fronts() {
        for (up_below, up_above, expected) in
            [(true, false, true), (true, true, false), (false, false, false), (false, true, false)]
        {
            let (geometry, points) =
                sampled(&[(square(0.0, 0.0, up_below), false), (square(0.0, 1.0, up_above), false)]);
            for i in 0..points.len() {
                for j in 0..points.len() {
                    let apart = points.surface[i] != points.surface[j];
                    assert_eq!(face_each_other(&geometry, &points, i, j), expected && apart);
                }
            }
        }
    }

    #[test]
    fn coplanar_surfaces_and_twins_do_not_face() {
        let (geometry, points) = sampled(&[
            (square(0.0, 0.0, true), true),
            (square(1.0, 0.0, true), false),
            (square(2.0, 0.0, false), true),
        ]);
        assert!(points.twin.iter().any(|&t| t != NO_POINT));
        for i in 0..points.len() {
            for j in 0..points.len() {
                assert!(!face_each_other(&geometry, &points, i, j));
            }
        }
    }
}

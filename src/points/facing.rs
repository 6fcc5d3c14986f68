//! Which points face each other: the one definition that every stage uses.
//!
//! Two points face each other when each is in front of the plane that touches the other's surface there by more than
//! [`Geometry::plane_tolerance`], and they do not lie on the same planar surface. Points of one planar surface, of coplanar
//! surfaces, and a point and its twin therefore never do; points on the inside of one sphere do.

use super::SamplePoints;
use crate::geometry::{Plane, Side, SurfaceId};
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
    /// The plane of `side` of `surface`, if it is planar.
    pub fn new(geometry: &Geometry, surface: SurfaceId, side: Side) -> Option<Self> {
        let Plane { normal, offset } = geometry.surface(surface).plane()?;
        Some(match side {
            Side::Front => SidePlane { normal, offset },
            Side::Back => SidePlane { normal: -normal, offset: -offset },
        })
    }

    /// The plane of the surface of point `i` on its side, or where that is curved the one that touches it there.
    pub fn at(geometry: &Geometry, points: &SamplePoints, i: usize) -> Self {
        SidePlane::new(geometry, points.surface[i], points.side[i])
            .unwrap_or_else(|| SidePlane::touching(points, i))
    }

    /// The plane through point `i` at right angles to its normal.
    pub fn touching(points: &SamplePoints, i: usize) -> Self {
        let normal = points.normal[i].as_dvec3();
        SidePlane { normal, offset: normal.dot(points.position[i].as_dvec3()) }
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
        SidePlane::at(geometry, points, i).height(points.position[j].as_dvec3()) > tolerance
    };
    let same = points.surface[i] == points.surface[j] && geometry.surface(points.surface[i]).is_planar();
    !same && above(i, j) && above(j, i)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Shape, Sphere};
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
        let shapes = shapes.iter().map(|(s, two)| (s.clone(), *two, 0, ObjectId(0))).collect();
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
    fn points_of_a_sphere_face_on_the_inside_alone() {
        for inward in [false, true] {
            let centre = DVec3::new(1.0, -2.0, 0.5);
            let (geometry, points) = sampled(&[(Shape::from(Sphere { centre, radius: 1.3, inward }), true)]);
            let sides = |i: usize| (points.side[i] == Side::Front) == inward;
            for i in 0..points.len() {
                for j in 0..points.len() {
                    let expected = i != j && sides(i) && sides(j);
                    assert_eq!(face_each_other(&geometry, &points, i, j), expected, "{inward} {i} {j}");
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

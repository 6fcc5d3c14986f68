//! Convex planar surfaces: the quadrilaterals of the paper, and triangles.

use super::Aabb;
use glam::DVec3;

/// A quadrilateral further out of plane than this fraction of its longest diagonal is treated as
/// its two triangles (scene loaders split it, on Embree's diagonal v1-v3).
pub const PLANARITY_TOLERANCE: f64 = 1e-6;

/// The kinds of surface. `v` counts counter-clockwise as seen from the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A convex quadrilateral, `(u, v)` bilinear: v0 (0,0), v1 (1,0), v2 (1,1), v3 (0,1).
    Quad([DVec3; 4]),
    /// A triangle; `(u, v)` are the barycentric weights of v1 and v2.
    Triangle([DVec3; 3]),
}

/// A shape with its plane and area, ready to use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Vertices, relative to the scene's centre, on the `f32` lattice.
    pub shape: Shape,
    /// Unit normal of the (mean) plane.
    pub normal: DVec3,
    /// `normal · x = offset` on the (mean) plane, m.
    pub offset: f64,
    /// Area, m².
    pub area: f64,
}

impl Surface {
    /// Computes plane and area. Degenerate shapes give a zero or NaN normal: loaders refuse them.
    pub fn new(shape: Shape) -> Self {
        let (cross, middle) = match &shape {
            Shape::Quad(v) => ((v[2] - v[0]).cross(v[3] - v[1]), 0.25 * (v[0] + v[1] + v[2] + v[3])),
            Shape::Triangle(v) => ((v[1] - v[0]).cross(v[2] - v[0]), (v[0] + v[1] + v[2]) / 3.0),
        };
        let normal = cross.normalize_or_zero();
        Surface { shape, normal, offset: normal.dot(middle), area: 0.5 * cross.length() }
    }

    /// The corners, counter-clockwise from the front.
    pub fn vertices(&self) -> &[DVec3] {
        match &self.shape {
            Shape::Quad(v) => v,
            Shape::Triangle(v) => v,
        }
    }

    /// The triangles that stand for the surface in every ray tracer, and how many: a quad is
    /// v0 v1 v3 and v2 v3 v1, Embree's split.
    pub fn triangles(&self) -> ([[DVec3; 3]; 2], usize) {
        match self.shape {
            Shape::Quad([a, b, c, d]) => ([[a, b, d], [c, d, b]], 2),
            Shape::Triangle(t) => ([t, t], 1),
        }
    }

    /// The smallest box around the surface.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.vertices().iter().copied())
    }

    /// Signed distance of `p` from the plane, positive in front, m.
    pub fn distance(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }

    /// The point at parameters `(u, v)`.
    pub fn point_at(&self, u: f64, v: f64) -> DVec3 {
        match &self.shape {
            Shape::Quad(q) => q[0].lerp(q[1], u).lerp(q[3].lerp(q[2], u), v),
            Shape::Triangle(t) => (1.0 - u - v) * t[0] + u * t[1] + v * t[2],
        }
    }
}

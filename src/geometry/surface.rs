//! Surfaces: the convex quadrilaterals of the paper, triangles, and what is no polygon.

use super::{Aabb, Cone, Disc, Patch, Round, Sphere};
use glam::{DVec2, DVec3};

/// A quadrilateral further out of plane than this fraction of its longest diagonal is treated as
/// its two triangles (scene loaders split it, on Embree's diagonal v1-v3).
pub const PLANARITY_TOLERANCE: f64 = 1e-6;

/// The kinds of surface. `v` counts counter-clockwise as seen from the front.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A convex quadrilateral, `(u, v)` bilinear: v0 (0,0), v1 (1,0), v2 (1,1), v3 (0,1).
    Quad([DVec3; 4]),
    /// A triangle; `(u, v)` are the barycentric weights of v1 and v2.
    Triangle([DVec3; 3]),
    /// No polygon; `(u, v)` as [`Round`] says.
    Round(Round),
}

impl Shape {
    /// The shape, if it is no polygon.
    #[inline]
    pub fn round(&self) -> Option<&Round> {
        match self {
            Shape::Round(round) => Some(round),
            Shape::Quad(_) | Shape::Triangle(_) => None,
        }
    }

    /// The corners, counter-clockwise from the front; what is no polygon has none.
    pub fn vertices(&self) -> &[DVec3] {
        match self {
            Shape::Quad(v) => v,
            Shape::Triangle(v) => v,
            Shape::Round(_) => &[],
        }
    }

    /// The smallest box around it.
    pub fn bounds(&self) -> Aabb {
        match self {
            Shape::Round(round) => round.bounds(),
            _ => Aabb::around(self.vertices().iter().copied()),
        }
    }

    /// The shape with its vertices and places moved by `local`, its radii as the `f32` lattice holds them.
    pub fn placed(&self, local: impl Fn(DVec3) -> DVec3) -> Shape {
        match self {
            Shape::Quad(v) => Shape::Quad(v.map(local)),
            Shape::Triangle(v) => Shape::Triangle(v.map(local)),
            Shape::Round(round) => Shape::Round(round.placed(local)),
        }
    }
}

impl From<Round> for Shape {
    fn from(round: Round) -> Shape {
        Shape::Round(round)
    }
}

impl From<Disc> for Shape {
    fn from(disc: Disc) -> Shape {
        Shape::Round(disc.into())
    }
}

impl From<Sphere> for Shape {
    fn from(sphere: Sphere) -> Shape {
        Shape::Round(sphere.into())
    }
}

impl From<Patch> for Shape {
    fn from(patch: Patch) -> Shape {
        Shape::Round(patch.into())
    }
}

impl From<Cone> for Shape {
    fn from(cone: Cone) -> Shape {
        Shape::Round(cone.into())
    }
}

/// A plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal.
    pub normal: DVec3,
    /// `normal · x = offset` on the plane, m.
    pub offset: f64,
}

impl Plane {
    /// Signed distance of `p`, positive in front, m.
    #[inline]
    pub fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }
}

/// A shape with its plane and area, ready to use.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Vertices or centre, relative to the scene's centre, on the `f32` lattice.
    pub shape: Shape,
    /// The (mean) plane, if it has one.
    plane: Option<Plane>,
    /// Area, m².
    pub area: f64,
}

impl Surface {
    /// Computes plane and area. Degenerate shapes give a zero or NaN normal: loaders refuse them.
    pub fn new(shape: Shape) -> Self {
        let (cross, middle) = match &shape {
            Shape::Quad(v) => ((v[2] - v[0]).cross(v[3] - v[1]), 0.25 * (v[0] + v[1] + v[2] + v[3])),
            Shape::Triangle(v) => ((v[1] - v[0]).cross(v[2] - v[0]), (v[0] + v[1] + v[2]) / 3.0),
            Shape::Round(round) => {
                let plane = match round {
                    Round::Disc(Disc { centre, normal, .. }) => {
                        Some(Plane { normal: *normal, offset: normal.dot(*centre) })
                    }
                    _ => None,
                };
                let area = round.area();
                return Surface { shape, plane, area };
            }
        };
        let normal = cross.normalize_or_zero();
        let plane = Some(Plane { normal, offset: normal.dot(middle) });
        Surface { shape, plane, area: 0.5 * cross.length() }
    }

    /// The (mean) plane of a quadrilateral, a triangle or a disc.
    #[inline]
    pub fn plane(&self) -> Option<Plane> {
        self.plane
    }

    /// The shape, if it is no polygon.
    #[inline]
    pub fn round(&self) -> Option<&Round> {
        self.shape.round()
    }

    /// Whether it lies in a plane: points of one planar surface do not see each other.
    pub fn is_planar(&self) -> bool {
        self.plane.is_some()
    }

    /// The corners, counter-clockwise from the front; what is no polygon has none.
    pub fn vertices(&self) -> &[DVec3] {
        self.shape.vertices()
    }

    /// The triangles that stand for a polygon in every ray tracer, and how many: a quad is
    /// v0 v1 v3 and v2 v3 v1, Embree's split; what is no polygon has none.
    pub fn triangles(&self) -> ([[DVec3; 3]; 2], usize) {
        match self.shape {
            Shape::Quad([a, b, c, d]) => ([[a, b, d], [c, d, b]], 2),
            Shape::Triangle(t) => ([t, t], 1),
            Shape::Round(_) => ([[DVec3::ZERO; 3]; 2], 0),
        }
    }

    /// The smallest box around the surface.
    pub fn bounds(&self) -> Aabb {
        self.shape.bounds()
    }

    /// Unit normal, on the front, at the point of the surface nearest to `p`; for a polygon that of its (mean) plane.
    #[inline]
    pub fn normal_at(&self, p: DVec3) -> DVec3 {
        match (self.plane, self.round()) {
            (None, Some(round)) => round.normal_at(p),
            (plane, _) => plane.map_or(DVec3::ZERO, |plane| plane.normal),
        }
    }

    /// Signed distance of `p` from the plane or the curved surface, positive in front, m.
    #[inline]
    pub fn distance(&self, p: DVec3) -> f64 {
        match (self.plane, self.round()) {
            (None, Some(round)) => round.distance(p),
            (plane, _) => plane.map_or(0.0, |plane| plane.height(p)),
        }
    }

    /// The nearest point of the plane or the curved surface, m.
    #[inline]
    pub fn project(&self, p: DVec3) -> DVec3 {
        p - self.distance(p) * self.normal_at(p)
    }

    /// How far the surface strays from its plane, m: 0 but for quadrilaterals that are not quite flat.
    pub fn warp(&self) -> f64 {
        self.vertices().iter().map(|v| self.distance(*v).abs()).fold(0.0, f64::max)
    }

    /// The point at parameters `(u, v)`.
    pub fn point_at(&self, u: f64, v: f64) -> DVec3 {
        match &self.shape {
            Shape::Quad(q) => q[0].lerp(q[1], u).lerp(q[3].lerp(q[2], u), v),
            Shape::Triangle(t) => (1.0 - u - v) * t[0] + u * t[1] + v * t[2],
            Shape::Round(round) => round.point_at(u, v),
        }
    }

    /// The middle of `(u, v)`.
    pub fn middle(&self) -> DVec3 {
        let at = if matches!(self.shape, Shape::Triangle(_)) {
            DVec2::splat(1.0 / 3.0)
        } else {
            DVec2::splat(0.5)
        };
        self.round().map_or_else(|| self.point_at(at.x, at.y), |round| round.centre())
    }
}

//! Shapes and rays, in `f64` and in coordinates relative to the scene's centre.

mod aabb;
mod convexity;
mod round;
mod surface;

pub use aabb::Aabb;
pub use convexity::{CONVEXITY_TOLERANCE, QuadKind, classify_quad, is_triangle};
pub use round::{Cone, Disc, Patch, Round, Sphere};
pub(crate) use round::{Profile, net, turns_one_way};
pub use surface::{PLANARITY_TOLERANCE, Plane, Shape, Surface};

use glam::DVec3;

/// Index of a surface in [`crate::scene::Geometry::surfaces`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SurfaceId(pub u32);

impl SurfaceId {
    /// As an index.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// The side of a surface: [`Side::Front`] is where its normal points.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Side {
    /// Where the normal points.
    Front,
    /// The other one.
    Back,
}

/// A ray `origin + t direction` for `t` in `(t_min, t_max)`; the direction need not be unit.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, relative to the scene's centre, m.
    pub origin: DVec3,
    /// Direction, any finite non-zero length.
    pub direction: DVec3,
    /// Hits at or before this parameter do not count.
    pub t_min: f64,
    /// Hits at or beyond this parameter do not count.
    pub t_max: f64,
}

impl Ray {
    /// The point at parameter `t`.
    #[inline]
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// Where a ray meets a surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The surface met.
    pub surface: SurfaceId,
    /// Ray parameter.
    pub t: f64,
    /// The side met.
    pub side: Side,
}

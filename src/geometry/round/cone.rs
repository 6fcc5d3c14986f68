//! The sides of cylinders and cones, whole or cut off: no caps.
//!
//! u runs around the axis, v from the base to the top in equal areas: r² is linear in v. The square's first and last
//! edge are one line.

use crate::geometry::{Aabb, Ray};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The side of a cone that is cut off at both ends; of a cylinder where both radii are the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Middle of the base, m.
    pub base: DVec3,
    /// Middle of the top, m.
    pub top: DVec3,
    /// Radius at the base, m.
    pub radius: f64,
    /// Radius at the top, m; one of both may be 0.
    pub top_radius: f64,
    /// Whether the front is the inside.
    pub inward: bool,
}

/// The side reaches so far beyond its ends, as a share of its size: no ray slips between it and a cap.
const RIM: f64 = 1e-12;

/// A place beside the axis.
#[derive(Clone, Copy)]
pub(crate) struct Profile {
    /// Distance from the axis, m.
    pub out: f64,
    /// Height over the base, m.
    pub up: f64,
    /// Unit, from the axis to the place.
    pub across: DVec3,
}

impl Cone {
    /// Unit direction from the base to the top.
    pub fn axis(&self) -> DVec3 {
        (self.top - self.base).normalize_or_zero()
    }

    /// From base to top, m.
    pub fn height(&self) -> f64 {
        self.top.distance(self.base)
    }

    /// From rim to rim along the side, m.
    pub fn slant(&self) -> f64 {
        self.height().hypot(self.top_radius - self.radius)
    }

    /// What the radius grows by along the axis.
    pub(crate) fn growth(&self) -> f64 {
        (self.top_radius - self.radius) / self.height()
    }

    /// Two unit directions that make a right-handed frame with the axis.
    pub fn axes(&self) -> (DVec3, DVec3) {
        let axis = self.axis();
        let x = axis.any_orthonormal_vector();
        (x, axis.cross(x))
    }

    /// Area, m².
    pub(super) fn area(&self) -> f64 {
        PI * (self.radius + self.top_radius) * self.slant()
    }

    /// The larger radius, m.
    pub fn widest(&self) -> f64 {
        self.radius.max(self.top_radius)
    }

    /// Seen from within, left and right change places.
    pub(super) fn turn(&self) -> f64 {
        if self.inward { -1.0 } else { 1.0 }
    }

    pub(crate) fn profile(&self, p: DVec3) -> Profile {
        let (axis, from) = (self.axis(), p - self.base);
        let up = axis.dot(from);
        let away = from - up * axis;
        let out = away.length();
        let across = if out > 0.0 { away / out } else { axis.any_orthonormal_vector() };
        Profile { out, up, across }
    }

    pub(super) fn point_at(&self, u: f64, v: f64) -> DVec3 {
        let (r0, r1) = (self.radius, self.top_radius);
        let r = (r0 * r0 + v * (r1 - r0) * (r1 + r0)).max(0.0).sqrt();
        let along = if r0 + r > 0.0 { v * (r0 + r1) / (r0 + r) } else { 0.0 };
        let (x, y) = self.axes();
        let (sin, cos) = (self.turn() * TAU * u).sin_cos();
        self.base + along * (self.top - self.base) + r * (cos * x + sin * y)
    }

    pub(super) fn uv_of(&self, p: DVec3) -> DVec2 {
        let Profile { out, up, across } = self.profile(p);
        let (r0, r1, h) = (self.radius, self.top_radius, self.height());
        let along = ((out - r0) * (r1 - r0) + up * h) / (h * h + (r1 - r0).powi(2));
        let along = along.clamp(0.0, 1.0);
        let v = along * (2.0 * r0 + along * (r1 - r0)) / (r0 + r1);
        let (x, y) = self.axes();
        let u = self.turn() * across.dot(y).atan2(across.dot(x)) / TAU;
        DVec2::new(u.rem_euclid(1.0), v).clamp(DVec2::ZERO, DVec2::ONE)
    }

    /// Unit normal on the outside.
    pub(crate) fn outwards(&self, p: DVec3) -> DVec3 {
        let (h, shrink) = (self.height(), self.radius - self.top_radius);
        (h * self.profile(p).across + shrink * self.axis()).normalize_or(DVec3::Z)
    }

    /// Distance from the cone or cylinder that it is part of, positive outside, m.
    pub(crate) fn outside(&self, p: DVec3) -> f64 {
        let Profile { out, up, .. } = self.profile(p);
        (out - self.radius - up * self.growth()) * self.height() / self.slant()
    }

    pub(super) fn bounds(&self) -> Aabb {
        let axis = self.axis();
        let reach = (DVec3::ONE - axis * axis).max(DVec3::ZERO).map(f64::sqrt);
        let ring =
            |middle: DVec3, radius: f64| Aabb { min: middle - radius * reach, max: middle + radius * reach };
        ring(self.base, self.radius).union(ring(self.top, self.top_radius))
    }

    /// Both roots, taken from the place of the line that is nearest to the middle, where no digits are lost, with a
    /// discriminant whose two products are subtracted before they are rounded.
    pub(super) fn crossings(&self, ray: &Ray) -> [f64; 2] {
        let (axis, height, growth) = (self.axis(), self.height(), self.growth());
        let d = ray.direction;
        let middle = 0.5 * (self.base + self.top);
        let start = (middle - ray.origin).dot(d) / d.length_squared();
        let from = ray.at(start) - self.base;
        let (up, speed) = (axis.dot(from), axis.dot(d));
        let (away, across) = (from - up * axis, d - speed * axis);
        let radius = self.radius + growth * up;
        // out² = (radius + growth t speed)².
        let a = across.length_squared() - (growth * speed).powi(2);
        let b = away.dot(across) - growth * speed * radius;
        let out = away.length();
        let c = (out - radius) * (out + radius);
        let error = a * c;
        let below = b.mul_add(b, -error) - a.mul_add(c, -error);
        if below.is_nan() || below < 0.0 {
            return [f64::NAN; 2];
        }
        let q = -(b + below.sqrt().copysign(b));
        let slack = RIM * (height + self.radius + self.top_radius);
        let met = |t: f64| {
            let up = up + t * speed;
            if up >= -slack && up <= height + slack { start + t } else { f64::NAN }
        };
        let (s, t) = (met(q / a), met(c / q));
        if t < s || s.is_nan() { [t, s] } else { [s, t] }
    }
}

//! Whole spheres, by the octahedral map (P. Clarberg, *Fast Equal-Area Mapping of the (Hemi)Sphere Using SIMD*, 2008),
//! whose square folds onto itself along its border.

use super::unit_square;
use crate::geometry::Ray;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// A whole sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Middle, m.
    pub centre: DVec3,
    /// Radius, m.
    pub radius: f64,
    /// Whether the front is the inside.
    pub inward: bool,
}

impl Sphere {
    pub(super) fn point_at(&self, u: f64, v: f64) -> DVec3 {
        let (a, b) = (self.turn() * (2.0 * u - 1.0), 2.0 * v - 1.0);
        let d = 1.0 - a.abs() - b.abs();
        let r = 1.0 - d.abs();
        let angle = if r > 0.0 { FRAC_PI_4 * ((b.abs() - a.abs()) / r + 1.0) } else { 0.0 };
        let flat = r * (2.0 - r * r).max(0.0).sqrt();
        let (sin, cos) = angle.sin_cos();
        let z = (1.0 - r * r).copysign(d);
        let direction = DVec3::new((flat * cos).copysign(a), (flat * sin).copysign(b), z);
        self.centre + self.radius * direction
    }

    pub(super) fn uv_of(&self, p: DVec3) -> DVec2 {
        let d = (p - self.centre).normalize_or(DVec3::Z);
        let (x, y, z) = (d.x.abs(), d.y.abs(), d.z.abs());
        // sqrt(1 - z) that keeps its digits near the poles.
        let r = ((x * x + y * y) / (1.0 + z)).sqrt();
        let b = r * y.atan2(x) / FRAC_PI_2;
        let a = r - b;
        let (a, b) = if d.z < 0.0 { (1.0 - b, 1.0 - a) } else { (a, b) };
        unit_square(DVec2::new(self.turn() * a.copysign(d.x), b.copysign(d.y)))
    }

    /// Seen from within, left and right change places.
    pub(super) fn turn(&self) -> f64 {
        if self.inward { -1.0 } else { 1.0 }
    }

    /// Both roots, by a form that neither loses the digits of a small discriminant nor of a near root (E. Haines,
    /// J. Günther and T. Akenine-Möller, *Precision Improvements for Ray/Sphere Intersection*, Ray Tracing Gems, 2019).
    pub(crate) fn crossings(&self, ray: &Ray) -> [f64; 2] {
        let (from, d) = (ray.origin - self.centre, ray.direction);
        let (a, b) = (d.length_squared(), -from.dot(d));
        let nearest = from + (b / a) * d;
        let below = self.radius * self.radius - nearest.length_squared();
        if below.is_nan() || below < 0.0 {
            return [f64::NAN; 2];
        }
        let distance = from.length();
        let c = (distance - self.radius) * (distance + self.radius);
        let q = b + (a * below).sqrt().copysign(b);
        let (s, t) = (c / q, q / a);
        if s < t { [s, t] } else { [t, s] }
    }
}

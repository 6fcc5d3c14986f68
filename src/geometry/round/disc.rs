//! Flat discs, by the concentric map (P. Shirley and K. Chiu, *A Low Distortion Map Between Disk and Square*, 1997).

use super::unit_square;
use crate::geometry::{Aabb, Ray};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

/// A flat disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Middle, m.
    pub centre: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Radius, m.
    pub radius: f64,
}

/// A disc's place may stray from its plane by so much, as a share of the largest coordinate: rounding of a ray that
/// runs along the plane makes more, and proves nothing.
const IN_PLANE: f64 = 1e-7;

impl Disc {
    /// Two unit directions that make a right-handed frame with the normal.
    pub fn axes(&self) -> (DVec3, DVec3) {
        let x = self.normal.any_orthonormal_vector();
        (x, self.normal.cross(x))
    }

    pub(super) fn point_at(&self, u: f64, v: f64) -> DVec3 {
        let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let (r, angle) = if a.abs() > b.abs() {
            (a, FRAC_PI_4 * b / a)
        } else if b != 0.0 {
            (b, FRAC_PI_2 - FRAC_PI_4 * a / b)
        } else {
            (0.0, 0.0)
        };
        let (x, y) = self.axes();
        let (sin, cos) = angle.sin_cos();
        self.centre + self.radius * r * (cos * x + sin * y)
    }

    pub(super) fn uv_of(&self, p: DVec3) -> DVec2 {
        let (x, y) = self.axes();
        let d = (p - self.centre) / self.radius;
        let (x, y) = (x.dot(d), y.dot(d));
        let r = x.hypot(y).min(1.0);
        let at = if r == 0.0 || !r.is_finite() {
            DVec2::ZERO
        } else if x.abs() > y.abs() {
            let a = r.copysign(x);
            DVec2::new(a, a * (y / x).atan() / FRAC_PI_4)
        } else {
            let b = r.copysign(y);
            DVec2::new(b * (x / y).atan() / FRAC_PI_4, b)
        };
        unit_square(at)
    }

    pub(super) fn bounds(&self) -> Aabb {
        let reach = (DVec3::ONE - self.normal * self.normal).max(DVec3::ZERO).map(f64::sqrt) * self.radius;
        Aabb { min: self.centre - reach, max: self.centre + reach }
    }

    pub(super) fn crossings(&self, ray: &Ray) -> [f64; 2] {
        let t = self.normal.dot(self.centre - ray.origin) / self.normal.dot(ray.direction);
        let d = ray.at(t) - self.centre;
        let scale = ray.origin.abs().max(self.centre.abs()).max_element() + self.radius;
        let inside = d.length_squared() <= self.radius * self.radius;
        let flat = self.normal.dot(d).abs() <= IN_PLANE * scale;
        [if inside && flat { t } else { f64::NAN }, f64::NAN]
    }
}

//! Pinhole cameras.

use crate::geometry::Ray;
use glam::DVec3;

/// A pinhole camera in world coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Its name in the scene file.
    pub name: String,
    /// Where it stands, world, m.
    pub position: DVec3,
    /// What it looks at, world, m.
    pub target: DVec3,
    /// Which way is up.
    pub up: DVec3,
    /// Vertical angle of view, degrees, in (0, 180).
    pub fov_deg: f64,
    /// Width and height of the image, pixels.
    pub resolution: [u32; 2],
}

impl Camera {
    /// The ray through image position `(x, y)`: pixels, from the top left corner, in the local
    /// coordinates of a scene centred at `centre`. The direction is unit.
    pub fn ray(&self, x: f64, y: f64, centre: DVec3) -> Ray {
        let forward = (self.target - self.position).normalize();
        let right = forward.cross(self.up).normalize();
        let up = right.cross(forward);
        let [w, h] = self.resolution.map(f64::from);
        let half = (0.5 * self.fov_deg.to_radians()).tan();
        let sx = (2.0 * x / w - 1.0) * half * w / h;
        let sy = (1.0 - 2.0 * y / h) * half;
        let direction = (forward + sx * right + sy * up).normalize();
        Ray { origin: self.position - centre, direction, t_min: 0.0, t_max: f64::INFINITY }
    }
}

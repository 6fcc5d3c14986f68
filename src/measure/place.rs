//! Where a sensor looks from.

use crate::error::{Error, Result};
use crate::geometry::Ray;
use crate::scene::{Geometry, Sensor};
use crate::tracers::{RayTracer, Segment};
use glam::{DVec3, Vec3};

/// Closer to a surface than this share of the scene's radius a sensor lies on it.
const ON_SURFACE: f64 = 1e-4;

/// A sensor ready to look.
pub(crate) struct Place {
    /// Relative to the scene's centre, just above the surface that the sensor lies on, m.
    pub position: DVec3,
    /// Unit.
    pub normal: DVec3,
}

impl Place {
    /// Of `sensor`.
    pub fn new(geometry: &Geometry, tracer: &dyn RayTracer, sensor: &Sensor) -> Result<Place> {
        let refuse = |what: &str| Err(Error::Settings(format!("sensor \"{}\": {what}", sensor.name)));
        let Some(normal) = sensor.normal.try_normalize() else {
            return refuse("the normal is no direction; give it a finite length that is not zero");
        };
        if !sensor.position.is_finite() {
            return refuse("the position must be finite numbers");
        }
        let mut position = sensor.position - geometry.centre;
        let (near, above) = (ON_SURFACE * geometry.radius, 4.0 * geometry.plane_tolerance());
        let down =
            Ray { origin: position + near * normal, direction: -normal, t_min: 0.0, t_max: 2.0 * near };
        if let Some(hit) = tracer.closest(&down) {
            position = down.at(hit.t) + above * normal;
        }
        Ok(Place { position, normal })
    }

    /// From here to `p`.
    pub fn segment(&self, p: Vec3) -> Segment {
        Segment { from: self.position.as_vec3(), to: p }
    }

    /// How far `p` is in front, m.
    pub fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.position)
    }
}

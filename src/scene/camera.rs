//! Pinhole cameras.

use crate::error::{Error, Result};
use crate::geometry::Ray;
use glam::DVec3;

/// Most pixels of an image: beyond this a mistyped resolution is the likelier reason.
const MAX_PIXELS: u64 = 1 << 28;

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

/// A camera ready to give rays, in the local coordinates of a scene.
#[derive(Clone, Copy, Debug)]
pub struct View {
    origin: DVec3,
    /// Direction through the top left corner of the image.
    corner: DVec3,
    /// One pixel to the right.
    right: DVec3,
    /// One pixel down.
    down: DVec3,
}

impl Camera {
    /// Whether the camera can give rays: an [`Error::Settings`] that says what to change.
    pub fn check(&self) -> Result<()> {
        let refuse = |what: &str| Err(Error::Settings(format!("camera \"{}\": {what}", self.name)));
        let [w, h] = self.resolution.map(u64::from);
        if ![self.position, self.target, self.up].iter().all(|v| v.is_finite()) {
            return refuse("position, target and up must be finite numbers");
        }
        if (self.target - self.position).try_normalize().is_none() {
            return refuse("position and target are the same place; move one of them");
        }
        if !(self.fov_deg > 0.0 && self.fov_deg < 180.0) {
            return refuse("the vertical angle of view must lie between 0 and 180 degrees");
        }
        if w == 0 || h == 0 || w * h > MAX_PIXELS {
            return refuse("the image needs at least one pixel and at most 2^28 of them");
        }
        Ok(())
    }

    /// The camera in a scene centred at `centre`. An up that is zero or along the view is
    /// replaced by some direction across the view.
    pub fn view(&self, centre: DVec3) -> View {
        let forward = (self.target - self.position).normalize_or(DVec3::NEG_Z);
        let sideways = forward.cross(self.up.normalize_or_zero());
        let right =
            if sideways.length() > 1e-9 { sideways.normalize() } else { forward.any_orthonormal_vector() };
        let down = forward.cross(right);
        let [w, h] = self.resolution.map(f64::from);
        let pixel = 2.0 * (0.5 * self.fov_deg.to_radians()).tan() / h;
        View {
            origin: self.position - centre,
            corner: forward - 0.5 * pixel * (w * right + h * down),
            right: pixel * right,
            down: pixel * down,
        }
    }

    /// The ray through image position `(x, y)`: pixels, from the top left corner, in the local
    /// coordinates of a scene centred at `centre`. The direction is unit.
    pub fn ray(&self, x: f64, y: f64, centre: DVec3) -> Ray {
        self.view(centre).ray(x, y)
    }
}

impl View {
    /// The ray through image position `(x, y)`: pixels, from the top left corner. The direction
    /// is unit.
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let direction = (self.corner + x * self.right + y * self.down).normalize();
        Ray { origin: self.origin, direction, t_min: 0.0, t_max: f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera {
            name: "test".into(),
            position: DVec3::new(1.0, -4.0, 1.0),
            target: DVec3::new(1.0, 0.0, 1.0),
            up: DVec3::Z,
            fov_deg: 90.0,
            resolution: [200, 100],
        }
    }

    #[test]
    fn corners_and_middle_of_the_image() {
        let (camera, centre) = (camera(), DVec3::new(1.0, 0.0, 0.0));
        let middle = camera.ray(100.0, 50.0, centre);
        assert!((middle.direction - DVec3::Y).length() < 1e-12);
        assert_eq!(middle.origin, DVec3::new(0.0, -4.0, 1.0));
        let left_top = camera.ray(0.0, 0.0, centre).direction;
        assert!((left_top - DVec3::new(-2.0, 1.0, 1.0).normalize()).length() < 1e-12);
    }

    #[test]
    fn looking_straight_up_gives_rays() {
        let mut camera = camera();
        camera.target = camera.position + DVec3::Z;
        let ray = camera.ray(3.0, 4.0, DVec3::ZERO);
        assert!((ray.direction.length() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn useless_cameras_are_refused() {
        for spoil in [
            (|c: &mut Camera| c.target = c.position) as fn(&mut Camera),
            |c| c.fov_deg = 180.0,
            |c| c.fov_deg = f64::NAN,
            |c| c.resolution = [0, 4],
            |c| c.resolution = [u32::MAX, u32::MAX],
            |c| c.up.x = f64::INFINITY,
        ] {
            let mut camera = camera();
            assert!(camera.check().is_ok());
            spoil(&mut camera);
            assert!(camera.check().is_err());
        }
    }
}

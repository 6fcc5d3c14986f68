//! Rooms and spheres.

use crate::geometry::{Shape, Sphere};
use glam::DVec3;

/// Corners of the walls of a box as seen from within: -x, +x, -y, +y, -z, +z.
pub fn walls(low: [f64; 3], high: [f64; 3]) -> [[[f64; 3]; 4]; 6] {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
    [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
        .map(|f| f.map(corner))
}

/// A sphere of this centre and radius, seen from within or from without.
pub fn sphere(centre: [f64; 3], radius: f64, inward: bool) -> Shape {
    Shape::Sphere(Sphere { centre: DVec3::from_array(centre), radius, inward })
}

//! Rooms, spheres, and what is hollow.

use crate::geometry::{Cone, Disc, Shape, Sphere};
use glam::DVec3;

/// Corners of the walls of a box as seen from within: -x, +x, -y, +y, -z, +z.
pub fn walls(low: [f64; 3], high: [f64; 3]) -> [[[f64; 3]; 4]; 6] {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
    [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
        .map(|f| f.map(corner))
}

/// A sphere of this centre and radius, seen from within or from without.
pub fn sphere(centre: [f64; 3], radius: f64, inward: bool) -> Shape {
    Shape::from(Sphere { centre: DVec3::from_array(centre), radius, inward })
}

/// The inside of a cylinder or a cone about the z axis from z = 0 up, and its ends as seen from there: those that have
/// an area.
pub fn closed_cone(radius: f64, top_radius: f64, height: f64) -> Vec<Shape> {
    let (base, top) = (DVec3::ZERO, height * DVec3::Z);
    let side = Cone { base, top, radius, top_radius, inward: true }.into();
    let ends = [(base, DVec3::Z, radius), (top, DVec3::NEG_Z, top_radius)];
    let ends = ends.into_iter().filter(|end| end.2 > 0.0);
    let end = |(centre, normal, radius)| Shape::from(Disc { centre, normal, radius });
    std::iter::once(side).chain(ends.map(end)).collect()
}

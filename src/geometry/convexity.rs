//! Whether four corners make a surface that the rest of the program can rely on.

use super::{PLANARITY_TOLERANCE, Shape, Surface};
use glam::DVec3;

/// The sine of the turn at a corner of a quadrilateral must exceed this: a corner on the line
/// between its neighbours makes a triangle with a corner too many, and (u, v) is singular there.
pub const CONVEXITY_TOLERANCE: f64 = 1e-5;

/// What four corners make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QuadKind {
    /// A strictly convex, flat quadrilateral.
    Flat,
    /// Convex, but out of plane: stands for its triangles v0 v1 v3 and v2 v3 v1.
    Warped,
    /// A corner (its index) is re-entrant, straight or repeated.
    NotConvex(usize),
    /// No area.
    Degenerate,
}

/// Classifies the quadrilateral `v`.
pub fn classify_quad(v: &[DVec3; 4]) -> QuadKind {
    let surface = Surface::new(Shape::Quad(*v));
    let diagonal = (v[2] - v[0]).length().max((v[3] - v[1]).length());
    let normal = surface.normal_at(v[0]);
    if normal == DVec3::ZERO || !has_area(surface.area, diagonal) {
        return QuadKind::Degenerate;
    }
    for corner in 0..4 {
        let before = v[corner] - v[(corner + 3) % 4];
        let after = v[(corner + 1) % 4] - v[corner];
        let turn = normal.dot(before.cross(after));
        let longest = before.length() * after.length();
        if longest == 0.0 || turn <= CONVEXITY_TOLERANCE * longest {
            return QuadKind::NotConvex(corner);
        }
    }
    let out_of_plane = v.iter().map(|p| surface.distance(*p).abs()).fold(0.0, f64::max);
    if out_of_plane > PLANARITY_TOLERANCE * diagonal { QuadKind::Warped } else { QuadKind::Flat }
}

/// Whether the triangle `v` has an area.
pub fn is_triangle(v: &[DVec3; 3]) -> bool {
    let longest = (v[1] - v[0]).length().max((v[2] - v[1]).length()).max((v[0] - v[2]).length());
    has_area(Surface::new(Shape::Triangle(*v)).area, longest)
}

/// Below a ten-millionth of its length squared a surface is a line on the `f32` lattice.
fn has_area(area: f64, length: f64) -> bool {
    area > 1e-7 * length * length
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad(points: [[f64; 3]; 4]) -> QuadKind {
        classify_quad(&points.map(DVec3::from_array))
    }

    #[test]
    fn quads_are_told_apart() {
        let (o, x, xy, y) = ([0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]);
        assert_eq!(quad([o, x, xy, y]), QuadKind::Flat);
        assert_eq!(quad([o, x, [0.2, 0.2, 0.0], y]), QuadKind::NotConvex(2));
        assert_eq!(quad([o, x, [0.5, 0.5, 0.0], y]), QuadKind::NotConvex(2), "straight");
        assert_eq!(quad([o, x, x, y]), QuadKind::NotConvex(1), "repeated");
        assert_eq!(quad([o, x, y, xy]), QuadKind::Degenerate, "a bow tie encloses nothing");
        assert_eq!(quad([o, o, o, o]), QuadKind::Degenerate);
        assert_eq!(quad([o, x, [1.0, 1.0, 0.1], y]), QuadKind::Warped);
        assert_eq!(quad([o, x, [1.0, 1.0, 1e-6], y]), QuadKind::Flat);
    }

    #[test]
    fn scale_does_not_matter() {
        for scale in [1e-3, 1.0, 1e6] {
            let v = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 1e-3], [0.0, 1.0, 0.0]];
            assert_eq!(classify_quad(&v.map(|p| scale * DVec3::from_array(p))), QuadKind::Warped);
            let t = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-9, 0.0]];
            assert!(!is_triangle(&t.map(|p| scale * DVec3::from_array(p))));
        }
    }
}

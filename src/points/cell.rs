//! Cells of the quadtree over a surface.

use crate::geometry::{Shape, Surface};
use glam::{DVec2, DVec3};

/// A cell: the way from the whole surface to it, two bits a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Cell {
    /// Child taken at each level, the first in the most significant used bits.
    pub path: u32,
    /// Number of divisions.
    pub level: u8,
}

impl Cell {
    /// The whole surface.
    pub const ROOT: Cell = Cell { path: 0, level: 0 };

    /// Deepest level a path can hold.
    pub const MAX_LEVEL: u8 = 16;

    /// Whether the path is one that `level` divisions can give.
    pub fn is_valid(self) -> bool {
        self.level <= Cell::MAX_LEVEL && u64::from(self.path) < 1 << (2 * self.level)
    }

    /// The `child`th quarter, 0 to 3. In all but a triangle bit 0 is the upper half of u and bit 1 that of v;
    /// in a triangle 0, 1, 2 are the corners and 3 the middle. A cell at [`Cell::MAX_LEVEL`] has none.
    pub fn child(self, child: u32) -> Cell {
        Cell { path: self.path << 2 | child, level: self.level + 1 }
    }

    /// The children taken, the first first.
    fn steps(self) -> impl Iterator<Item = u32> {
        (0..self.level).rev().map(move |l| self.path >> (2 * l) & 3)
    }

    /// Lowest (u, v) and edge of the square that it is of all but a triangle.
    pub fn square(self) -> (DVec2, f64) {
        let (mut low, mut size) = (DVec2::ZERO, 1.0);
        for child in self.steps() {
            size *= 0.5;
            low += size * DVec2::new(f64::from(child & 1), f64::from(child >> 1));
        }
        (low, size)
    }

    /// Corners in the surface's (u, v), counter-clockwise; a triangle's last is repeated.
    pub fn corners_uv(self, shape: &Shape) -> [DVec2; 4] {
        match shape {
            Shape::Quad(_) | Shape::Round(_) => {
                let (lo, size) = self.square();
                [lo, lo + DVec2::new(size, 0.0), lo + DVec2::splat(size), lo + DVec2::new(0.0, size)]
            }
            Shape::Triangle(_) => {
                let mut t = [DVec2::ZERO, DVec2::X, DVec2::Y];
                for child in self.steps() {
                    let m = [0.5 * (t[1] + t[2]), 0.5 * (t[2] + t[0]), 0.5 * (t[0] + t[1])];
                    t = match child {
                        0 => [t[0], m[2], m[1]],
                        1 => [m[2], t[1], m[0]],
                        2 => [m[1], m[0], t[2]],
                        _ => m,
                    };
                }
                [t[0], t[1], t[2], t[2]]
            }
        }
    }

    /// Corners in space, relative to the scene's centre, m.
    pub fn corners(self, surface: &Surface) -> [DVec3; 4] {
        self.corners_uv(&surface.shape).map(|c| surface.point_at(c.x, c.y))
    }

    /// Centre in (u, v).
    pub fn centre_uv(self, shape: &Shape) -> DVec2 {
        let c = self.corners_uv(shape);
        match shape {
            Shape::Triangle(_) => (c[0] + c[1] + c[2]) / 3.0,
            _ => 0.5 * (c[0] + c[2]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_longer_than_its_level_is_not_valid() {
        let deepest = (0..Cell::MAX_LEVEL).fold(Cell::ROOT, |cell, _| cell.child(3));
        assert!(Cell::ROOT.is_valid() && deepest.is_valid());
        assert!(!Cell { path: 1, level: 0 }.is_valid() && !Cell { path: 4, level: 1 }.is_valid());
        assert!(!Cell { path: 0, level: Cell::MAX_LEVEL + 1 }.is_valid());
        assert!(!Cell { path: 0, level: u8::MAX }.is_valid());
    }

    #[test]
    fn children_tile_their_parent() {
        let quad =
            Surface::new(Shape::Quad([DVec3::ZERO, 2.0 * DVec3::X, DVec3::new(3.0, 2.0, 0.0), DVec3::Y]));
        let triangle = Surface::new(Shape::Triangle([DVec3::ZERO, DVec3::X, DVec3::Y]));
        for surface in [quad, triangle] {
            let mut total = 0.0;
            for a in 0..4 {
                for b in 0..4 {
                    let c = Cell::ROOT.child(a).child(b).corners(&surface);
                    let cross = (c[2] - c[0]).cross(c[3] - c[1]);
                    assert!(cross.dot(surface.normal_at(c[0])) > 0.0, "orientation is kept");
                    total += 0.5 * cross.length();
                }
            }
            assert!((total - surface.area).abs() < 1e-12 * surface.area);
        }
    }
}

//! The voxels that a ray pierces, in order, by Amanatides and Woo's steps over SI.

use super::Voxels;
use crate::geometry::Ray;

/// A voxel on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The voxel.
    pub voxel: usize,
    /// Ray parameter where the ray leaves it (infinite for a ray that never does).
    pub t_exit: f64,
}

/// An iterator over the voxels that a ray pierces. Whole voxels are jumped: the ray leaves through
/// the far plane it meets first, and SI gives the voxel beyond. Cell numbers only ever move along
/// the ray's direction, so the number of steps is bounded by the cells along the three axes
/// whatever rounding does.
#[derive(Clone, Debug)]
pub struct Walk<'a> {
    voxels: &'a Voxels,
    origin: [f64; 3],
    direction: [f64; 3],
    /// 1 / direction; 0 marks an axis the ray does not move along.
    inverse: [f64; 3],
    cell: [u32; 3],
    /// Where the ray enters the scene's box or begins.
    t_start: f64,
    /// Where it leaves the box or ends.
    t_end: f64,
    done: bool,
}

impl<'a> Walk<'a> {
    /// The walk of `ray` through `voxels`, or `None` if the ray misses the scene's box, goes
    /// nowhere, or is not finite (limits may be infinite).
    #[inline]
    pub fn new(voxels: &'a Voxels, ray: &Ray) -> Option<Self> {
        if !(ray.origin.is_finite() && ray.direction.is_finite()) {
            return None;
        }
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let mut inverse = [0.0; 3];
        let (mut t_start, mut t_end) = (ray.t_min, ray.t_max);
        let mut moves = false;
        for a in 0..3 {
            let planes = &voxels.planes[a];
            let (low, high) = (planes[0] - origin[a], planes[planes.len() - 1] - origin[a]);
            let inv = 1.0 / direction[a];
            if inv.is_finite() && inv != 0.0 {
                inverse[a] = inv;
                moves = true;
                let (t0, t1) = (low * inv, high * inv);
                t_start = t_start.max(t0.min(t1));
                t_end = t_end.min(t0.max(t1));
            } else if low > 0.0 || high < 0.0 {
                return None;
            }
        }
        // A limit that is NaN fails the comparisons below or was ignored above: refuse it.
        if !moves || ray.t_min.is_nan() || ray.t_max.is_nan() || t_start > t_end || t_start.is_nan() {
            return None;
        }
        let cell = [0, 1, 2].map(|a| voxels.cell_along(a, origin[a] + t_start * direction[a]));
        Some(Walk { voxels, origin, direction, inverse, cell, t_start, t_end, done: false })
    }

    /// The part of the ray inside the scene's box, as parameters: all hits lie within.
    #[inline]
    pub fn limits(&self) -> (f64, f64) {
        (self.t_start, self.t_end)
    }

    /// Moves on to the cell beyond `axis` at `t`, or ends the walk at the side of the box.
    #[inline]
    fn advance(&mut self, cells: &[[u32; 2]; 3], axis: usize, t: f64) {
        for (a, &[first, end]) in cells.iter().enumerate() {
            let forward = self.inverse[a] > 0.0;
            if a == axis {
                if if forward { end == self.voxels.cells_along(a) } else { first == 0 } {
                    self.done = true;
                    return;
                }
                self.cell[a] = if forward { end } else { first - 1 };
            } else if self.inverse[a] != 0.0 {
                let there = self.voxels.cell_along(a, self.origin[a] + t * self.direction[a]);
                let (low, high) = if forward { (self.cell[a], end - 1) } else { (first, self.cell[a]) };
                self.cell[a] = there.max(low).min(high);
            }
        }
    }
}

impl Iterator for Walk<'_> {
    type Item = Step;

    #[inline]
    fn next(&mut self) -> Option<Step> {
        if self.done {
            return None;
        }
        let voxel = self.voxels.voxel_at(self.cell);
        let cells = self.voxels.cells[voxel];
        let (mut t_exit, mut axis) = (f64::INFINITY, 0);
        for a in 0..3 {
            if self.inverse[a] != 0.0 {
                let far = cells[a][usize::from(self.inverse[a] > 0.0)] as usize;
                let t = (self.voxels.planes[a][far] - self.origin[a]) * self.inverse[a];
                if t < t_exit {
                    (t_exit, axis) = (t, a);
                }
            }
        }
        if t_exit < self.t_end {
            self.advance(&cells, axis, t_exit);
        } else {
            self.done = true;
        }
        Some(Step { voxel, t_exit })
    }
}

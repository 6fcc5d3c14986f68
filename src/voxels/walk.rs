//! The voxels that a ray pierces, in order, by Amanatides and Woo's steps over SI.

use super::Voxels;
use crate::geometry::Ray;

/// A voxel on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// The voxel.
    pub voxel: usize,
    /// Ray parameter where the ray enters it, or where the walk begins.
    pub t_enter: f64,
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
    axes: [Axis; 3],
    /// Where the ray enters the scene's box or begins.
    t_start: f64,
    /// Where it leaves the box or ends.
    t_end: f64,
    /// Where it enters the voxel of the next step.
    t: f64,
    done: bool,
}

/// The way along one axis, lengths in cells of SI.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    /// Coordinate at parameter 0; minus infinity for an axis the ray does not move along.
    origin: f64,
    direction: f64,
    /// 1 / direction; 1 for an axis the ray does not move along, whose planes are then infinitely far away.
    inverse: f64,
    /// The cell the ray is in.
    cell: u32,
    /// Cells along the axis.
    cells: u32,
    /// All bits if the ray moves up, or not at all; else none.
    upwards: u32,
}

impl Axis {
    /// The last cell, on the way, of a voxel of which `mask` cells follow each first one.
    #[inline(always)]
    fn last(&self, mask: u32) -> u32 {
        self.cell & !mask | self.upwards & mask
    }

    /// Where the ray leaves the cell `last`.
    #[inline(always)]
    fn exit(&self, last: u32) -> f64 {
        (f64::from(last + (self.upwards & 1)) - self.origin) * self.inverse
    }

    /// The cell at `t`, kept between the present one and `last`.
    #[inline(always)]
    fn at(&self, t: f64, last: u32) -> u32 {
        let there = cell(self.origin + t * self.direction, self.cells);
        if self.upwards != 0 { there.max(self.cell).min(last) } else { there.max(last).min(self.cell) }
    }

    /// The cell beyond `last`; past the end it is no cell.
    #[inline(always)]
    fn beyond(&self, last: u32) -> u32 {
        last.wrapping_add(self.upwards & 2).wrapping_sub(1)
    }
}

/// The cell that holds the coordinate `x`, or a neighbour where `x` is the plane between them, at most `cells`; 0 for
/// what is not a number. Rounds by adding a number so large that no digit after the point remains: cheaper than a cast.
#[inline(always)]
fn cell(x: f64, cells: u32) -> u32 {
    const WHOLE: f64 = (1u64 << 52) as f64;
    let x = if x > 0.5 { x - 0.5 } else { 0.0 };
    let top = f64::from(cells);
    let x = if x < top { x } else { top };
    (x + WHOLE).to_bits() as u32
}

impl<'a> Walk<'a> {
    /// The walk of `ray` through `voxels`, or `None` if the ray misses the scene's box, goes
    /// nowhere, or is not finite (limits may be infinite).
    #[inline(always)]
    pub fn new(voxels: &'a Voxels, ray: &Ray) -> Option<Self> {
        if !(ray.origin.is_finite() && ray.direction.is_finite()) {
            return None;
        }
        let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
        let (mut t_start, mut t_end) = (ray.t_min, ray.t_max);
        let (mut moving, mut inverses) = ([false; 3], [1.0; 3]);
        for a in 0..3 {
            let (low, high) = (voxels.min[a] - origin[a], voxels.max[a] - origin[a]);
            let inverse = 1.0 / direction[a];
            if inverse.is_finite() && inverse != 0.0 {
                (moving[a], inverses[a]) = (true, inverse);
                let (t0, t1) = (low * inverse, high * inverse);
                t_start = t_start.max(t0.min(t1));
                t_end = t_end.min(t0.max(t1));
            } else if low > 0.0 || high < 0.0 {
                return None;
            }
        }
        // A limit that is NaN fails the comparisons below or was ignored above: refuse it.
        if moving == [false; 3]
            || ray.t_min.is_nan()
            || ray.t_max.is_nan()
            || t_start > t_end
            || t_start.is_nan()
        {
            return None;
        }
        let mut axes = [Axis::default(); 3];
        for (a, axis) in axes.iter_mut().enumerate() {
            let (per, cells) = (voxels.cells_per_length[a], 1 << voxels.halvings[a]);
            let (start, speed) = ((origin[a] - voxels.min[a]) * per, direction[a] * per);
            let here = cell(start + t_start * speed, cells).min(cells - 1);
            *axis = if moving[a] {
                let upwards = if direction[a] > 0.0 { u32::MAX } else { 0 };
                let inverse = inverses[a] * voxels.cell_size[a];
                Axis { origin: start, direction: speed, inverse, cell: here, cells, upwards }
            } else {
                let origin = f64::NEG_INFINITY;
                Axis { origin, direction: 0.0, inverse: 1.0, cell: here, cells, upwards: u32::MAX }
            };
        }
        Some(Walk { voxels, axes, t_start, t_end, t: t_start, done: false })
    }

    /// The part of the ray inside the scene's box, as parameters: all hits lie within.
    #[inline]
    pub fn limits(&self) -> (f64, f64) {
        (self.t_start, self.t_end)
    }
}

impl Iterator for Walk<'_> {
    type Item = Step;

    #[inline(always)]
    fn next(&mut self) -> Option<Step> {
        if self.done {
            return None;
        }
        let [x, y, z] = &mut self.axes;
        let (voxel, masks) = self.voxels.entry([x.cell, y.cell, z.cell]);
        let [last_x, last_y, last_z] = [x.last(masks[0]), y.last(masks[1]), z.last(masks[2])];
        let [tx, ty, tz] = [x.exit(last_x), y.exit(last_y), z.exit(last_z)];
        let by_x = tx < ty && tx < tz;
        let by_y = !by_x && ty < tz;
        let t_exit = if by_x {
            tx
        } else if by_y {
            ty
        } else {
            tz
        };
        if t_exit < self.t_end {
            let next = |axis: &Axis, last: u32, through: bool| {
                if through { axis.beyond(last) } else { axis.at(t_exit, last) }
            };
            x.cell = next(x, last_x, by_x);
            y.cell = next(y, last_y, by_y);
            z.cell = next(z, last_z, !by_x && !by_y);
            self.done = x.cell >= x.cells || y.cell >= y.cells || z.cell >= z.cells;
            if !self.done {
                self.voxels.fetch([x.cell, y.cell, z.cell]);
            }
        } else {
            self.done = true;
        }
        let t_enter = std::mem::replace(&mut self.t, t_exit);
        Some(Step { voxel, t_enter, t_exit })
    }
}

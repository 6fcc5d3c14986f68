//! Spatial subdivision into unequal voxels and the spatial index SI (section 4.1).
//!
//! The box of the scene is halved, across its longest side, until few enough objects meet a voxel.
//! All voxels of one level have the same shape, so the finest level is a regular grid: the spatial
//! index SI[i, j, k] names, for each cell of that grid, the voxel that holds it.

mod build;
mod overlap;
mod walk;

pub(crate) use build::Part;
pub use walk::{Step, Walk};

use crate::geometry::{Aabb, SurfaceId};
use crate::points::SamplePoints;
use crate::simd::fetch;
use glam::DVec3;

/// No subdivision goes deeper: SI has at most `2^MAX_LEVEL` cells (8 MiB).
pub const MAX_LEVEL: u8 = 21;

/// A surface counts as meeting a voxel from this far away, as a fraction of the diagonal of the
/// scene's bounds. Rounding in a walk along a ray is some 10⁸ times smaller, so no walk can slip
/// past a surface that lies on the face of a voxel.
pub const PADDING: f64 = 1e-7;

/// Bits of an entry of SI that number the voxel; there are no more voxels than cells.
const VOXEL_BITS: u32 = 27;

/// When to stop halving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VoxelSettings {
    /// A voxel that more surfaces than this meet is halved.
    pub max_objects: usize,
    /// No halving below this depth; at most [`MAX_LEVEL`].
    pub max_level: u8,
}

impl Default for VoxelSettings {
    /// Chosen so that a furnished room of 134 quadrilaterals (92 voxels, 4 without sample points)
    /// comes near the paper's Table 1 (102 and 5).
    fn default() -> Self {
        VoxelSettings { max_objects: 5, max_level: 8 }
    }
}

/// The voxels of a scene, in depth-first order (neighbours in number are neighbours in space).
#[derive(Clone, Debug)]
pub struct Voxels {
    /// Lowest corner of the padded box of the scene, m.
    min: DVec3,
    /// Coordinates of the planes between cells of SI, for each axis: `[cells + 1]`, m.
    planes: [Vec<f64>; 3],
    /// The upper corner of the box, m.
    max: DVec3,
    /// Cells of SI in a metre, along each axis.
    cells_per_length: [f64; 3],
    /// Edge lengths of a cell of SI, m.
    cell_size: [f64; 3],
    /// Cells of SI along each axis, as powers of two.
    halvings: [u32; 3],
    /// By level: one less than the cells of SI that a voxel has along each axis, a power of two.
    masks: Vec<[u32; 3]>,
    /// SI: the voxel of each cell, and its level above [`VOXEL_BITS`]; x fastest.
    index: Vec<u32>,
    /// Per voxel: its cells of SI along each axis, first and one past the last.
    cells: Vec<[[u32; 2]; 3]>,
    /// Per voxel: first entry in `surfaces`; `[voxels + 1]`.
    starts: Vec<u32>,
    /// The surfaces that meet each voxel, by increasing number.
    surfaces: Vec<SurfaceId>,
    /// Depth of the finest voxel.
    level: u8,
}

/// Counters of a subdivision, as in the paper's Table 1.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct VoxelStats {
    /// Number of voxels.
    pub voxels: usize,
    /// Voxels without sample points.
    pub empty_of_points: usize,
    /// Voxels that no surface meets.
    pub empty_of_objects: usize,
    /// Depth of the finest voxel.
    pub level: u8,
    /// Cells of SI.
    pub index_cells: usize,
    /// Mean number of surfaces that meet a voxel.
    pub objects_per_voxel: f64,
}

impl Voxels {
    /// Number of voxels, at least 1.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Never: a scene without surfaces is one voxel.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// The voxel that holds `p` (local coordinates, m); a place outside the scene's box counts as
    /// the nearest inside.
    pub fn locate(&self, p: DVec3) -> usize {
        self.voxel_at(self.cell_of(p))
    }

    /// The box of voxel `v`, m.
    pub fn bounds(&self, v: usize) -> Aabb {
        let corner = |end: usize| {
            let [x, y, z] = [0, 1, 2].map(|a| self.planes[a][self.cells[v][a][end] as usize]);
            DVec3::new(x, y, z)
        };
        Aabb { min: corner(0), max: corner(1) }
    }

    /// The padded box of the scene, m: all voxels together.
    pub fn scene_bounds(&self) -> Aabb {
        Aabb { min: self.min, max: self.max }
    }

    /// The surfaces that meet voxel `v` or come within [`PADDING`] of it, by increasing number.
    pub fn surfaces_of(&self, v: usize) -> &[SurfaceId] {
        &self.surfaces[self.starts[v] as usize..self.starts[v + 1] as usize]
    }

    /// Counters, with those of `points` as sorted by these voxels.
    pub fn stats(&self, points: &SamplePoints) -> VoxelStats {
        let count = |f: &dyn Fn(usize) -> bool| (0..self.len()).filter(|&v| f(v)).count();
        VoxelStats {
            voxels: self.len(),
            empty_of_points: count(&|v| v >= points.voxels() || points.voxel(v).is_empty()),
            empty_of_objects: count(&|v| self.surfaces_of(v).is_empty()),
            level: self.level,
            index_cells: self.index.len(),
            objects_per_voxel: self.surfaces.len() as f64 / self.len() as f64,
        }
    }

    /// The cell along `axis` that holds coordinate `x`, kept within the box; 0 for NaN.
    fn cell_along(&self, axis: usize, x: f64) -> u32 {
        let n = 1u32 << self.halvings[axis];
        // The cast saturates, so what is not a number or far away is safe.
        (((x - self.min[axis]) * self.cells_per_length[axis]) as u32).min(n - 1)
    }

    /// The cell of SI that holds `p`.
    fn cell_of(&self, p: DVec3) -> [u32; 3] {
        [0, 1, 2].map(|a| self.cell_along(a, p[a]))
    }

    /// The voxel SI[i, j, k].
    fn voxel_at(&self, cell: [u32; 3]) -> usize {
        self.entry(cell).0
    }

    /// The place of SI[i, j, k].
    #[inline(always)]
    fn place(&self, [i, j, k]: [u32; 3]) -> usize {
        let [nx, ny, _] = self.halvings;
        (((k << ny | j) << nx) | i) as usize
    }

    /// Asks for SI[i, j, k] ahead of time.
    #[inline(always)]
    fn fetch(&self, cell: [u32; 3]) {
        fetch(&self.index[self.place(cell)]);
    }

    /// The voxel SI[i, j, k], and the mask of its level.
    #[inline(always)]
    fn entry(&self, cell: [u32; 3]) -> (usize, [u32; 3]) {
        let entry = self.index[self.place(cell)];
        ((entry & ((1 << VOXEL_BITS) - 1)) as usize, self.masks[(entry >> VOXEL_BITS) as usize])
    }
}

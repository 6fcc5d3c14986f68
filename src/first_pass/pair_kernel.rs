//! The plain kernel between the points of two patches, and what is kept of it from sweep to sweep.
//!
//! Between planar patches r cos θ is the distance of a point from the other's plane, so the plain kernel is
//! d_A(b) d_B(a) / r⁴, the same both ways but for the area of the element that sends. The distances are
//! found once for a point of a pair; what is left to a pair of points are the square of their distance, one division and
//! the bit, for [`LANES`] points at once.

use super::diffuse::{LANES, Lanes};
use super::layout::{Layout, MAX_PATCH, Patch};
use super::schedule::{Pair, row_bits};
use crate::simd::HotLoop;
use crate::visibility::{Tile, VisibilityGraph};
use std::f32::consts::PI;

/// Groups of lanes of a patch at most.
pub const GROUPS: usize = MAX_PATCH / LANES;

/// What patches see of each other.
#[derive(Clone, Copy)]
pub struct Sight<'a> {
    /// The points.
    pub layout: &'a Layout,
    /// What they see.
    pub graph: &'a VisibilityGraph,
    /// How far in front of each other points must be, in units of the layout.
    pub tolerance: f32,
}

/// A point of the first patch that faces the second.
#[derive(Clone, Copy, Default)]
struct Row {
    point: usize,
    position: [f32; 3],
    /// Distance from the plane of the second patch.
    height: f32,
    /// Which points of the second patch it sees.
    bits: u64,
}

/// The kernel of one pair of patches, rows one after the other; 0 where points do not see each other.
pub struct Scratch {
    rows: [Row; MAX_PATCH],
    /// The points of the first patch that may see any of the second.
    pub points: [u32; MAX_PATCH],
    /// Number of rows.
    pub count: usize,
    /// Distances of the second patch's points from the plane of the first.
    height: [Lanes; GROUPS],
    /// 1 where they face it, else 0.
    faces: [Lanes; GROUPS],
    /// Kernel towards the first patch.
    pub forth: [Lanes; MAX_PATCH * GROUPS],
    /// Kernel towards the second, where it is not the same.
    pub back: [Lanes; MAX_PATCH * GROUPS],
}

impl Scratch {
    /// Room for a pair.
    #[inline(always)]
    pub fn new() -> Self {
        Scratch {
            rows: [Row::default(); MAX_PATCH],
            points: [0; MAX_PATCH],
            count: 0,
            height: [[0.0; LANES]; GROUPS],
            faces: [[0.0; LANES]; GROUPS],
            forth: [[0.0; LANES]; MAX_PATCH * GROUPS],
            back: [[0.0; LANES]; MAX_PATCH * GROUPS],
        }
    }
}

impl Sight<'_> {
    /// The kernel of a pair.
    #[inline(always)]
    pub fn kernel(&self, pair: &Pair, scratch: &mut Scratch) {
        let (first, second) = (&self.layout.patches[pair.a as usize], &self.layout.patches[pair.b as usize]);
        self.rows(pair, [first, second], scratch);
        if pair.close {
            self.close(second, scratch);
        } else {
            self.distant(pair, second, scratch);
        }
    }

    /// The points of the first patch that may see any of the second, and the heights of both.
    #[inline(always)]
    fn rows(&self, pair: &Pair, [first, second]: [&Patch; 2], scratch: &mut Scratch) {
        let Layout { position, lane_position, .. } = self.layout;
        // Patches stand in the order of their voxels: no tile is turned.
        let mut unused = Vec::new();
        let tile = self.graph.tile(first.voxel, second.voxel, &mut unused);
        let tile = if pair.open { Tile::Visible } else { tile };
        let (row, column) = (self.graph.voxel(first.voxel).start, self.graph.voxel(second.voxel).start);
        scratch.count = 0;
        for i in first.points.clone() {
            let height = if pair.close { 1.0 } else { second.height(position[i]) as f32 };
            let bits = row_bits(&tile, i - row, second.points.start - column, second.points.len());
            if height > self.tolerance && bits != 0 {
                scratch.rows[scratch.count] =
                    Row { point: i, position: position[i].to_array(), height, bits };
                scratch.points[scratch.count] = i as u32;
                scratch.count += 1;
            }
        }
        let Some((normal, offset)) = first.plane.filter(|_| !pair.close) else {
            scratch.faces = [[1.0; LANES]; GROUPS];
            return;
        };
        let [x, y, z] = lane_position;
        for (at, g) in second.groups.clone().enumerate() {
            for lane in 0..LANES {
                let along = normal.x * f64::from(x[g][lane])
                    + normal.y * f64::from(y[g][lane])
                    + normal.z * f64::from(z[g][lane]);
                let height = (along - offset) as f32;
                scratch.height[at][lane] = height;
                scratch.faces[at][lane] = if height > self.tolerance { 1.0 } else { 0.0 };
            }
        }
    }

    /// The kernel between planar patches.
    #[inline(always)]
    fn distant(&self, pair: &Pair, second: &Patch, scratch: &mut Scratch) {
        let Layout { lane_position, lane_lift, lift, .. } = self.layout;
        let groups = second.groups.clone();
        let [x, y, z] = [0, 1, 2].map(|axis| &lane_position[axis][groups.clone()]);
        let lifted = &lane_lift[groups.clone()];
        // Nothing that faces is nearer.
        let least = self.tolerance * self.tolerance;
        let rows = scratch.rows[..scratch.count].iter().zip(scratch.forth.chunks_exact_mut(groups.len()));
        for (row, out) in rows {
            let [px, py, pz] = row.position;
            let own = lift[row.point];
            let columns =
                x.iter().zip(y).zip(z).zip(lifted).zip(&scratch.height).zip(&scratch.faces).zip(out);
            for (at, ((((((x, y), z), lift), height), faces), out)) in columns.enumerate() {
                let mut q = [0.0; LANES];
                for lane in 0..LANES {
                    let (dx, dy, dz) = (x[lane] - px, y[lane] - py, z[lane] - pz);
                    let r2 = dx * dx + dy * dy + dz * dz;
                    let r2 = if r2 > least { r2 } else { least };
                    // Rounding puts points off their planes; distances are between the points as they are.
                    q[lane] = (row.height - lift[lane]) * (height[lane] - own) / (r2 * r2) * faces[lane];
                }
                if !pair.open {
                    let bits = (row.bits >> (at * LANES)) as u32;
                    for (lane, q) in q.iter_mut().enumerate() {
                        *q = if bits & (1 << lane) != 0 { *q } else { 0.0 };
                    }
                }
                *out = q;
            }
        }
    }

    /// The kernels between any patches, both ways, each held to a form factor of 1.
    #[inline(always)]
    fn close(&self, second: &Patch, scratch: &mut Scratch) {
        let Layout { lane_position: [x, y, z], lane_normal: [nx, ny, nz], lane_area, area, normal, .. } =
            self.layout;
        let groups = second.groups.len();
        for (r, row) in scratch.rows[..scratch.count].iter().enumerate() {
            let [px, py, pz] = row.position;
            let n = normal[row.point];
            let most_back = PI / area[row.point];
            for (at, g) in second.groups.clone().enumerate() {
                let bits = (row.bits >> (at * LANES)) as u32;
                let (forth, back) = (&mut scratch.forth[r * groups + at], &mut scratch.back[r * groups + at]);
                for lane in 0..LANES {
                    let (dx, dy, dz) = (x[g][lane] - px, y[g][lane] - py, z[g][lane] - pz);
                    let here = n.x * dx + n.y * dy + n.z * dz;
                    let there = -(nx[g][lane] * dx + ny[g][lane] * dy + nz[g][lane] * dz);
                    let inverse = 1.0 / (dx * dx + dy * dy + dz * dz);
                    let plain = (here * inverse) * (there * inverse);
                    let seen = (here > self.tolerance) & (there > self.tolerance) & (bits & (1 << lane) != 0);
                    let most = PI / lane_area[g][lane];
                    let held = if plain < most { plain } else { most };
                    forth[lane] = if seen { held } else { 0.0 };
                    let held = if plain < most_back { plain } else { most_back };
                    back[lane] = if seen { held } else { 0.0 };
                }
            }
        }
    }
}

/// The kernels of the pairs of one task, kept.
#[derive(Default)]
pub struct Kept {
    /// Number of rows of each pair.
    pub counts: Vec<u8>,
    /// The points of the rows, pair by pair.
    pub points: Vec<u32>,
    /// The kernels towards the first patches, each followed by that towards the second where it is not the same.
    pub kernels: Vec<Lanes>,
}

/// Bytes that the kernel of a pair takes at most.
pub fn bytes(layout: &Layout, pair: &Pair) -> u64 {
    let (first, second) = (&layout.patches[pair.a as usize], &layout.patches[pair.b as usize]);
    let kernels = if pair.close { 2 } else { 1 };
    (first.points.len() * (second.groups.len() * kernels * size_of::<Lanes>() + size_of::<u32>())) as u64
}

/// Finds the kernels of some pairs.
pub struct Find<'a> {
    /// What patches see.
    pub sight: Sight<'a>,
    /// The pairs.
    pub pairs: &'a [Pair],
}

impl HotLoop for Find<'_> {
    type Output = Kept;

    #[inline(always)]
    fn run(self) -> Kept {
        let mut kept = Kept::default();
        let mut scratch = Scratch::new();
        for pair in self.pairs {
            self.sight.kernel(pair, &mut scratch);
            let size = scratch.count * self.sight.layout.patches[pair.b as usize].groups.len();
            kept.counts.push(scratch.count as u8);
            kept.points.extend_from_slice(&scratch.points[..scratch.count]);
            kept.kernels.extend_from_slice(&scratch.forth[..size]);
            if pair.close {
                kept.kernels.extend_from_slice(&scratch.back[..size]);
            }
        }
        kept.points.shrink_to_fit();
        kept.kernels.shrink_to_fit();
        kept
    }
}

//! The innermost loops of a sweep: what pairs of patches send each other.
//!
//! Between planar patches r cos θ is the distance of a point from the other's plane, so the plain kernel is
//! d_A(b) d_B(a) / r⁴, the same both ways but for the area of the element that sends. The distances are
//! found once for a point of a pair; what is left to a pair of points are the square of their distance, one division and
//! the bit, for [`LANES`] points at once, and two multiplications and additions a wavelength.

use super::diffuse::{LANES, Lanes};
use super::layout::{Layout, MAX_PATCH, Patch};
use super::lobe_table::{BAND, Band};
use super::schedule::{Pair, row_bits};
use crate::simd::HotLoop;
use crate::visibility::{Tile, VisibilityGraph};
use std::f32::consts::PI;

/// Groups of lanes of a patch at most.
const GROUPS: usize = MAX_PATCH / LANES;

/// A value of every wavelength of a band, for a group of lanes.
pub type BandLanes = [Lanes; BAND];

/// What the points send: area (in units of the layout) times radiance.
pub struct Power {
    /// Bands of wavelengths.
    pub bands: usize,
    /// By point, `[N][bands]`.
    pub by_point: Vec<Band>,
    /// By groups of lanes, `[groups][bands]`.
    pub by_lane: Vec<BandLanes>,
    /// Whether anything comes from a patch.
    pub sends: Vec<bool>,
    /// Whether it is asked what a patch receives.
    pub hears: Vec<bool>,
}

/// The exchanges of one task.
pub struct Exchange<'a> {
    /// The points.
    pub layout: &'a Layout,
    /// What they see.
    pub graph: &'a VisibilityGraph,
    /// How far in front of each other points must be, in units of the layout.
    pub tolerance: f32,
    /// Who exchanges light.
    pub pairs: &'a [Pair],
    /// What they send.
    pub power: &'a Power,
    /// First point of the first patches, and first group of lanes of the second.
    pub origin: (usize, usize),
    /// What the first patches receive, to be summed over the lanes: `[points][bands]`.
    pub first: &'a mut [BandLanes],
    /// What the second patches receive, `[groups][bands]`.
    pub second: &'a mut [BandLanes],
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

/// What a pair of patches needs in between, rows one after the other.
struct Scratch {
    rows: [Row; MAX_PATCH],
    count: usize,
    /// Distances of the second patch's points from the plane of the first.
    height: [Lanes; GROUPS],
    /// 1 where they face it, else 0.
    faces: [Lanes; GROUPS],
    /// Kernel towards the first patch.
    forth: [Lanes; MAX_PATCH * GROUPS],
    /// Kernel towards the second, where it is not the same.
    back: [Lanes; MAX_PATCH * GROUPS],
}

impl HotLoop for Exchange<'_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let mut scratch = Scratch {
            rows: [Row::default(); MAX_PATCH],
            count: 0,
            height: [[0.0; LANES]; GROUPS],
            faces: [[0.0; LANES]; GROUPS],
            forth: [[0.0; LANES]; MAX_PATCH * GROUPS],
            back: [[0.0; LANES]; MAX_PATCH * GROUPS],
        };
        for pair in self.pairs {
            self.exchange(pair, &mut scratch);
        }
    }
}

impl Exchange<'_> {
    #[inline(always)]
    fn exchange(&mut self, pair: &Pair, scratch: &mut Scratch) {
        let (a, b) = (pair.a as usize, pair.b as usize);
        let (first, second) = (&self.layout.patches[a], &self.layout.patches[b]);
        let Power { sends, hears, .. } = self.power;
        let forth = hears[a] && sends[b];
        // Within a curved patch every pair is met from both its ends.
        let back = hears[b] && sends[a] && a != b;
        if !forth && !back {
            return;
        }
        self.rows(pair, [first, second], scratch);
        if pair.close {
            self.close(second, scratch);
        } else {
            self.distant(pair, second, scratch);
        }
        let kernels = [&scratch.forth, if pair.close { &scratch.back } else { &scratch.forth }];
        if forth {
            self.receive(second, scratch, kernels[0]);
        }
        if back {
            self.send(second, scratch, kernels[1]);
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

    /// The kernel between planar patches, also where the second's points do not face the first.
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
            let columns = x.iter().zip(y).zip(z).zip(lifted).zip(&scratch.height).zip(out);
            for (at, (((((x, y), z), lift), height), out)) in columns.enumerate() {
                let mut q = [0.0; LANES];
                for lane in 0..LANES {
                    let (dx, dy, dz) = (x[lane] - px, y[lane] - py, z[lane] - pz);
                    let r2 = dx * dx + dy * dy + dz * dz;
                    let r2 = if r2 > least { r2 } else { least };
                    // Rounding puts points off their planes; distances are between the points as they are.
                    q[lane] = (row.height - lift[lane]) * (height[lane] - own) / (r2 * r2);
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

    /// What the first patch receives.
    #[inline(always)]
    fn receive(&mut self, second: &Patch, scratch: &Scratch, kernel: &[Lanes]) {
        let groups = second.groups.len();
        let bands = self.power.bands;
        for band in 0..bands {
            let mut light = [[[0.0; LANES]; BAND]; GROUPS];
            for (g, light) in second.groups.clone().zip(&mut light) {
                let (power, faces) =
                    (&self.power.by_lane[g * bands + band], &scratch.faces[g - second.groups.start]);
                for k in 0..BAND {
                    for lane in 0..LANES {
                        light[k][lane] = power[k][lane] * faces[lane];
                    }
                }
            }
            for (row, kernel) in scratch.rows[..scratch.count].iter().zip(kernel.chunks_exact(groups)) {
                let mut sum = self.first[(row.point - self.origin.0) * bands + band];
                for (q, light) in kernel.iter().zip(&light) {
                    for k in 0..BAND {
                        for lane in 0..LANES {
                            sum[k][lane] += q[lane] * light[k][lane];
                        }
                    }
                }
                self.first[(row.point - self.origin.0) * bands + band] = sum;
            }
        }
    }

    /// What the second patch receives.
    #[inline(always)]
    fn send(&mut self, second: &Patch, scratch: &Scratch, kernel: &[Lanes]) {
        let groups = second.groups.len();
        let bands = self.power.bands;
        for band in 0..bands {
            let mut light = [[0.0; BAND]; MAX_PATCH];
            for (row, light) in scratch.rows[..scratch.count].iter().zip(&mut light) {
                *light = self.power.by_point[row.point * bands + band];
            }
            for at in 0..groups {
                let mut sum = [[0.0; LANES]; BAND];
                for (kernel, light) in kernel.chunks_exact(groups).zip(&light[..scratch.count]) {
                    let q = &kernel[at];
                    for k in 0..BAND {
                        for lane in 0..LANES {
                            sum[k][lane] += q[lane] * light[k];
                        }
                    }
                }
                let faces = &scratch.faces[at];
                let out = &mut self.second[(second.groups.start + at - self.origin.1) * bands + band];
                for k in 0..BAND {
                    for lane in 0..LANES {
                        out[k][lane] += sum[k][lane] * faces[lane];
                    }
                }
            }
        }
    }
}

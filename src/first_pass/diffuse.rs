//! The diffuse operator D: irradiance of all points from the diffuse radiance of all points,
//! E_i = Σ_j h_ij π F_ij L_j, recomputed tile by tile from points and bits.

use super::form_factor::{plain, plane_distances};
use super::near::Corrections;
use super::settings::Kernel;
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::simd::{HotLoop, wide};
use crate::visibility::{Tile, VisibilityGraph};
use rayon::prelude::*;

/// Points handled side by side.
pub const LANES: usize = 8;
/// Receivers of one task.
const ROWS: usize = 128;

/// A value for each of them.
pub type Lanes = [f32; LANES];

/// Points as columns of the tiles: voxel by voxel, each padded to a multiple of [`LANES`] with
/// points that face nothing.
pub(super) struct Columns {
    position: [Vec<Lanes>; 3],
    normal: [Vec<Lanes>; 3],
    area: Vec<Lanes>,
    /// First group of lanes of each voxel, and the number of groups at the end.
    pub(super) starts: Vec<usize>,
}

/// D for one set of points and one graph.
pub struct DiffuseOperator<'a> {
    pub(super) points: &'a SamplePoints,
    pub(super) graph: &'a VisibilityGraph,
    pub(super) columns: Columns,
    pub(super) tolerance: f32,
    corrections: Corrections,
    row_sums: Vec<f32>,
    /// (voxel, first row, one past the last row), rows as point indices.
    pub(super) tasks: Vec<(usize, usize, usize)>,
}

impl Columns {
    fn new(points: &SamplePoints) -> Self {
        let mut columns = Columns {
            position: [const { Vec::new() }; 3],
            normal: [const { Vec::new() }; 3],
            area: Vec::new(),
            starts: vec![0],
        };
        for v in 0..points.voxels() {
            for group in points.voxel(v).collect::<Vec<_>>().chunks(LANES) {
                for axis in 0..3 {
                    let mut p = [points.position[group[0]][axis]; LANES];
                    let mut n = [0.0; LANES];
                    for (lane, &i) in group.iter().enumerate() {
                        p[lane] = points.position[i][axis];
                        n[lane] = points.normal[i][axis];
                    }
                    columns.position[axis].push(p);
                    columns.normal[axis].push(n);
                }
                let mut area = [0.0; LANES];
                for (lane, &i) in group.iter().enumerate() {
                    area[lane] = points.area[i];
                }
                columns.area.push(area);
            }
            columns.starts.push(columns.area.len());
        }
        columns
    }

    /// q of the elements of group `g` seen from point `i`, where `bits` lets it see them.
    #[inline(always)]
    pub(super) fn seen_from(
        &self,
        points: &SamplePoints,
        i: usize,
        g: usize,
        bits: u32,
        tolerance: f32,
    ) -> Lanes {
        let (p, n) = (points.position[i], points.normal[i]);
        let [x, y, z] = [&self.position[0][g], &self.position[1][g], &self.position[2][g]];
        let [nx, ny, nz] = [&self.normal[0][g], &self.normal[1][g], &self.normal[2][g]];
        let area = &self.area[g];
        let mut q = [0.0; LANES];
        for lane in 0..LANES {
            let (dx, dy, dz) = (x[lane] - p.x, y[lane] - p.y, z[lane] - p.z);
            let d_i = n.x * dx + n.y * dy + n.z * dz;
            let d_j = -(nx[lane] * dx + ny[lane] * dy + nz[lane] * dz);
            let value = plain(d_i, d_j, dx * dx + dy * dy + dz * dz, area[lane]);
            let seen = (d_i > tolerance) & (d_j > tolerance) & (bits & (1 << lane) != 0);
            q[lane] = if seen { value } else { 0.0 };
        }
        q
    }
}

/// The bits of row `r` for the `group`th group of columns.
#[inline(always)]
fn bits_of(tile: &Tile, r: usize, group: usize) -> u32 {
    match tile {
        Tile::Visible => 0xff,
        Tile::Hidden => 0,
        Tile::Bits { words, stride } => {
            let at = group * LANES;
            words[r * stride + at / 32] >> (at % 32) & 0xff
        }
    }
}

impl<'a> DiffuseOperator<'a> {
    /// Prepares the columns and, for [`Kernel::Analytic`], the corrections.
    pub fn new(
        geometry: &Geometry,
        points: &'a SamplePoints,
        graph: &'a VisibilityGraph,
        kernel: Kernel,
        observer: &dyn Observer,
    ) -> Self {
        let tasks = (0..points.voxels())
            .flat_map(|v| {
                let rows = points.voxel(v);
                let end = rows.end;
                rows.step_by(ROWS).map(move |first| (v, first, (first + ROWS).min(end)))
            })
            .collect();
        let mut operator = DiffuseOperator {
            points,
            graph,
            columns: Columns::new(points),
            tolerance: geometry.plane_tolerance() as f32,
            corrections: Corrections::default(),
            row_sums: Vec::new(),
            tasks,
        };
        if kernel == Kernel::Analytic {
            operator.corrections = Corrections::new(geometry, &operator, observer);
        }
        let ones = vec![1.0; points.len()];
        operator.row_sums = operator.irradiance(&ones, |_| true);
        operator.row_sums.iter_mut().for_each(|q| *q /= std::f32::consts::PI);
        operator
    }

    /// Σ_j h_ij F_ij of every point: 1 in a closed scene, less where light can escape.
    pub fn row_sums(&self) -> &[f32] {
        &self.row_sums
    }

    /// What the kernel adds to the plain one.
    pub fn corrections(&self) -> &Corrections {
        &self.corrections
    }

    /// q of element `j` seen from `i`, which see each other.
    pub fn factor(&self, i: usize, j: usize) -> f32 {
        let (d_i, d_j, r2) = plane_distances(self.points, i, j);
        plain(d_i, d_j, r2, self.points.area[j]) + self.corrections.get(i, j)
    }

    /// Calls `visit(row, column voxel's points, tile, row in tile)` for all receivers of a task.
    fn tiles(&self, task: (usize, usize, usize), mut visit: impl FnMut(usize, &Tile, usize)) {
        let (a, first, _) = task;
        let mut scratch = Vec::new();
        for b in 0..self.points.voxels() {
            if self.points.voxel(b).is_empty() {
                continue;
            }
            let tile = self.graph.tile(a, b, &mut scratch);
            if !matches!(tile, Tile::Hidden) {
                visit(b, &tile, first - self.points.voxel(a).start);
            }
        }
    }

    /// E of every point for which `wanted` holds (0 for the others), W m⁻² nm⁻¹, from the radiance of
    /// every point; both `[W][N]`. One sweep.
    pub fn irradiance(&self, radiance: &[f32], wanted: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
        let n = self.points.len();
        if n == 0 {
            return Vec::new();
        }
        let w = radiance.len() / n;
        let packed = self.pack(radiance, w);
        let blocks: Vec<Vec<f64>> = self
            .tasks
            .par_iter()
            .map(|&task| {
                let (_, first, end) = task;
                let mut sums = vec![0.0f64; (end - first) * w];
                self.tiles(task, |b, tile, r0| {
                    let (operator, sums, packed) = (self, &mut sums[..], &packed[..]);
                    wide(Sweep { operator, b, tile, r0, first, end, wanted: &wanted, packed, w, sums });
                });
                for i in (first..end).filter(|&i| wanted(i)) {
                    for (j, difference) in self.corrections.row(i) {
                        for k in 0..w {
                            sums[(i - first) * w + k] += f64::from(difference * radiance[k * n + j]);
                        }
                    }
                }
                sums
            })
            .collect();
        let mut irradiance = vec![0.0; n * w];
        for (&(_, first, end), sums) in self.tasks.iter().zip(&blocks) {
            for i in first..end {
                for k in 0..w {
                    irradiance[k * n + i] = sums[(i - first) * w + k] as f32;
                }
            }
        }
        irradiance
    }

    /// q of element `j` seen from every point that sees it, corrections left out: `visit(point, q)`.
    pub fn column(&self, j: usize, mut visit: impl FnMut(usize, f32)) {
        let voxels = self.points.voxels();
        let a = (0..voxels).find(|&v| self.points.voxel(v).contains(&j)).unwrap_or(voxels);
        let mut scratch = Vec::new();
        for b in 0..voxels {
            // A tile stored the other way round is not worth turning for one row.
            let tile = (a <= b).then(|| self.graph.tile(a, b, &mut scratch));
            for (c, i) in self.points.voxel(b).enumerate() {
                let (d_i, d_j, r2) = plane_distances(self.points, i, j);
                let facing = d_i > self.tolerance && d_j > self.tolerance;
                if facing
                    && match &tile {
                        Some(tile) => tile.get(j - self.points.voxel(a).start, c),
                        None => self.graph.unblocked(i, j),
                    }
                {
                    visit(i, plain(d_i, d_j, r2, self.points.area[j]));
                }
            }
        }
    }

    /// Radiance in the layout of the columns: `[W][groups]`.
    fn pack(&self, radiance: &[f32], w: usize) -> Vec<Lanes> {
        let n = self.points.len();
        let mut packed = Vec::with_capacity(w * self.columns.area.len());
        for k in 0..w {
            for v in 0..self.points.voxels() {
                for group in radiance[k * n..(k + 1) * n][self.points.voxel(v)].chunks(LANES) {
                    let mut lanes = [0.0; LANES];
                    lanes[..group.len()].copy_from_slice(group);
                    packed.push(lanes);
                }
            }
        }
        packed
    }
}

/// The receivers `first..end` of a task against the columns of voxel `b`.
struct Sweep<'a, F> {
    operator: &'a DiffuseOperator<'a>,
    b: usize,
    tile: &'a Tile<'a>,
    /// Row of the tile that `first` is.
    r0: usize,
    first: usize,
    end: usize,
    wanted: &'a F,
    /// Radiance, `[W][groups]`.
    packed: &'a [Lanes],
    w: usize,
    /// E of the receivers, `[end - first][W]`, to be added to.
    sums: &'a mut [f64],
}

impl<F: Fn(usize) -> bool> HotLoop for Sweep<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Sweep { operator, first, w, .. } = self;
        let columns = &operator.columns;
        let (start, end) = (columns.starts[self.b], columns.starts[self.b + 1]);
        let groups = columns.area.len();
        let mut q: Vec<Lanes> = Vec::with_capacity(end - start);
        for i in first..self.end {
            if !(self.wanted)(i) {
                continue;
            }
            q.clear();
            for g in start..end {
                let bits = bits_of(self.tile, self.r0 + i - first, g - start);
                q.push(columns.seen_from(operator.points, i, g, bits, operator.tolerance));
            }
            for k in 0..w {
                let x = &self.packed[k * groups + start..k * groups + end];
                self.sums[(i - first) * w + k] += f64::from(dot(&q, x));
            }
        }
    }
}

/// Σ a b, lane by lane, then across.
#[inline(always)]
fn dot(a: &[Lanes], b: &[Lanes]) -> f32 {
    let mut sum = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sum[lane] += a[lane] * b[lane];
        }
    }
    sum.iter().sum()
}

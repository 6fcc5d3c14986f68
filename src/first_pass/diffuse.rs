//! The diffuse operator D: irradiance of all points from the diffuse radiance of all points,
//! E_i = Σ_j h_ij π F_ij L_j, recomputed tile by tile from points and bits.

use super::corrections::Corrections;
use super::exchange::{BandLanes, Exchange, Power};
use super::form_factor::{plain, plane_distances};
use super::layout::Layout;
use super::lobe_table::BAND;
use super::pair_kernel::{Find, Kept, Sight, bytes};
use super::schedule::{Pair, Schedule};
use super::settings::{FirstPassSettings, Kernel};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::simd::wide;
use crate::visibility::VisibilityGraph;
use rayon::prelude::*;

/// Points handled side by side.
pub const LANES: usize = 8;
/// Receivers of one task.
const ROWS: usize = 128;
/// Runs of fewer points share a patch: pairs of tiny patches would cost more than the points in them.
const SHORT: usize = LANES;

/// A value for each of them.
pub type Lanes = [f32; LANES];

/// D for one set of points and one graph.
pub struct DiffuseOperator<'a> {
    pub(super) points: &'a SamplePoints,
    pub(super) graph: &'a VisibilityGraph,
    pub(super) tolerance: f32,
    layout: Layout,
    schedule: Schedule,
    /// By task, in the order of the rounds.
    kept: Vec<Option<Kept>>,
    corrections: Corrections,
    row_sums: Vec<f32>,
    /// (voxel, first row, one past the last row), rows as point indices.
    pub(super) tasks: Vec<(usize, usize, usize)>,
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
        let kept_bytes = FirstPassSettings::default().kept_bytes;
        Self::keeping(geometry, points, graph, (kernel, kept_bytes), observer)
    }

    /// The same, where about so many bytes are kept of the plain kernel.
    pub fn keeping(
        geometry: &Geometry,
        points: &'a SamplePoints,
        graph: &'a VisibilityGraph,
        (kernel, kept_bytes): (Kernel, u64),
        observer: &dyn Observer,
    ) -> Self {
        let tasks = (0..points.voxels())
            .flat_map(|v| {
                let rows = points.voxel(v);
                let end = rows.end;
                rows.step_by(ROWS).map(move |first| (v, first, (first + ROWS).min(end)))
            })
            .collect();
        let tolerance_m = geometry.plane_tolerance();
        let tolerance = tolerance_m as f32;
        let layout = |short| Layout::new(points, geometry.radius, 0.5 * tolerance_m, short);
        let runs = layout(1);
        let layout = layout(SHORT);
        let mut operator = DiffuseOperator {
            points,
            graph,
            tolerance,
            schedule: Schedule::new(&layout, graph, tolerance / layout.unit),
            layout,
            kept: Vec::new(),
            corrections: Corrections::default(),
            row_sums: Vec::new(),
            tasks,
        };
        if kernel == Kernel::Analytic {
            operator.corrections = Corrections::new(geometry, &operator, &runs, observer);
        }
        operator.keep_kernels(kept_bytes);
        let ones = vec![1.0; points.len()];
        operator.row_sums = operator.irradiance(&ones, |_| true);
        operator.row_sums.iter_mut().for_each(|q| *q /= std::f32::consts::PI);
        operator
    }

    /// What patches see.
    fn sight(&self) -> Sight<'_> {
        Sight { layout: &self.layout, graph: self.graph, tolerance: self.tolerance / self.layout.unit }
    }

    /// Keeps the plain kernel of as many tasks, in their order, as there is room for.
    fn keep_kernels(&mut self, most_bytes: u64) {
        let Schedule { rounds, pairs, .. } = &self.schedule;
        let mut left = most_bytes;
        let chosen: Vec<Option<&[Pair]>> = (rounds.iter().flatten())
            .map(|(_, _, of)| {
                let pairs = &pairs[of.clone()];
                let bytes = pairs.iter().map(|pair| bytes(&self.layout, pair)).sum::<u64>();
                left = left.saturating_sub(bytes);
                (left > 0).then_some(pairs)
            })
            .collect();
        let sight = self.sight();
        let find = |pairs: &Option<&[Pair]>| pairs.map(|pairs| wide(Find { sight, pairs }));
        self.kept = chosen.par_iter().map(find).collect();
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
        // What an element of the inside of a sphere sees of itself is a correction alone.
        let plain = if i == j { 0.0 } else { self.plain_factor(i, j) };
        plain + self.corrections.get(i, j)
    }

    /// The same by the plain kernel.
    pub fn plain_factor(&self, i: usize, j: usize) -> f32 {
        let (d_i, d_j, r2) = plane_distances(self.points, i, j);
        plain(d_i, d_j, r2, self.points.area[j])
    }

    /// E of every point for which `wanted` holds (0 for the others), W m⁻² nm⁻¹, from the radiance of
    /// every point; both `[W][N]`. One sweep.
    pub fn irradiance(&self, radiance: &[f32], wanted: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
        sweep(radiance, self.points.len(), &wanted, |by_point, bands| {
            let mut sums = self.exchange(&self.power(by_point, bands, &wanted));
            (sums.par_chunks_mut(ROWS * bands).enumerate())
                .for_each(|(part, sums)| self.corrections.add(part * ROWS, &wanted, by_point, bands, sums));
            sums
        })
    }

    /// What the points send, given their radiance `[N][bands]`.
    fn power(&self, by_point: &[[f32; BAND]], bands: usize, wanted: &impl Fn(usize) -> bool) -> Power {
        let Layout { patches, area, lane_area, .. } = &self.layout;
        let mut power = Power {
            bands,
            by_point: by_point.to_vec(),
            by_lane: vec![[[0.0; LANES]; BAND]; lane_area.len() * bands],
            sends: Vec::with_capacity(patches.len()),
            hears: Vec::with_capacity(patches.len()),
        };
        for (i, own) in power.by_point.chunks_mut(bands).enumerate() {
            own.iter_mut().flatten().for_each(|l| *l *= area[i]);
        }
        for patch in patches {
            let mut sends = false;
            for (at, i) in patch.points.clone().enumerate() {
                for band in 0..bands {
                    let own = power.by_point[i * bands + band];
                    let group = &mut power.by_lane[(patch.groups.start + at / LANES) * bands + band];
                    (0..BAND).for_each(|k| group[k][at % LANES] = own[k]);
                    sends |= own != [0.0; BAND];
                }
            }
            power.sends.push(sends);
            power.hears.push(patch.points.clone().any(wanted));
        }
        power
    }

    /// What every point receives by the plain kernel, `[N][bands]`.
    fn exchange(&self, power: &Power) -> Vec<[f64; BAND]> {
        let Layout { patches, .. } = &self.layout;
        let bands = power.bands;
        let points = |g: usize| {
            let group = &self.schedule.groups[g];
            patches[group.start].points.start..patches[group.end - 1].points.end
        };
        let lanes = |g: usize| {
            let group = &self.schedule.groups[g];
            patches[group.start].groups.start..patches[group.end - 1].groups.end
        };
        let mut sums: Vec<Vec<[f64; BAND]>> =
            (0..self.schedule.groups.len()).map(|g| vec![[0.0; BAND]; points(g).len() * bands]).collect();
        let mut kept = &self.kept[..];
        for round in &self.schedule.rounds {
            let (of_round, others) = kept.split_at(round.len());
            kept = others;
            // No group is in two tasks of a round, so each takes along the sums that it adds to.
            let mut tasks: Vec<_> = round
                .iter()
                .map(|(i, j, pairs)| {
                    let first = std::mem::take(&mut sums[*i]);
                    (*i, *j, pairs.clone(), first, std::mem::take(&mut sums[*j]))
                })
                .collect();
            tasks.par_iter_mut().zip(of_round).for_each(|((i, j, pairs, first, second), kept)| {
                let (rows, columns) = (points(*i), lanes(*j));
                let mut towards: Vec<BandLanes> = vec![[[0.0; LANES]; BAND]; rows.len() * bands];
                let mut back: Vec<BandLanes> = vec![[[0.0; LANES]; BAND]; columns.len() * bands];
                wide(Exchange {
                    sight: self.sight(),
                    pairs: &self.schedule.pairs[pairs.clone()],
                    kept: kept.as_ref(),
                    power,
                    origin: (rows.start, columns.start),
                    first: &mut towards,
                    second: &mut back,
                });
                for (sum, more) in first.iter_mut().zip(&towards) {
                    (0..BAND).for_each(|k| sum[k] += f64::from(more[k].iter().sum::<f32>()));
                }
                let second = if i == j { first } else { second };
                for patch in &patches[self.schedule.groups[*j].clone()] {
                    for (at, i) in patch.points.clone().enumerate() {
                        for band in 0..bands {
                            let group = patch.groups.start + at / LANES - columns.start;
                            let more = &back[group * bands + band];
                            let sum = &mut second[(i - points(*j).start) * bands + band];
                            (0..BAND).for_each(|k| sum[k] += f64::from(more[k][at % LANES]));
                        }
                    }
                }
            });
            for (i, j, _, first, second) in tasks {
                if i != j {
                    sums[j] = second;
                }
                sums[i] = first;
            }
        }
        sums.into_iter().flatten().collect()
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
}

/// E of the `n` points for which `wanted` holds (0 for the others) from the radiance of all, both `[W][N]`, given what
/// makes sums of products, `[N][bands]`, of radiance that is laid out so and near 1 at every wavelength.
pub(super) fn sweep(
    radiance: &[f32],
    n: usize,
    wanted: impl Fn(usize) -> bool,
    sums: impl FnOnce(&[[f32; BAND]], usize) -> Vec<[f64; BAND]>,
) -> Vec<f32> {
    if n == 0 {
        return Vec::new();
    }
    let w = radiance.len() / n;
    let bands = w.div_ceil(BAND);
    let scale: Vec<f32> = radiance.chunks(n).map(unit_of).collect();
    let sums = sums(&interleave(radiance, &scale, n), bands);
    let mut irradiance = vec![0.0; n * w];
    for (k, (irradiance, scale)) in irradiance.chunks_mut(n).zip(&scale).enumerate() {
        for (i, e) in irradiance.iter_mut().enumerate().filter(|(i, _)| wanted(*i)) {
            *e = (sums[i * bands + k / BAND][k % BAND] * f64::from(*scale)) as f32;
        }
    }
    irradiance
}

/// A power of two near the largest of some values, so that no product with them is lost to `f32`.
fn unit_of(values: &[f32]) -> f32 {
    let largest = values.iter().fold(0.0f32, |most, v| most.max(v.abs()));
    if largest > 0.0 && largest.is_finite() {
        2.0f32.powi((largest.log2().round() as i32).clamp(-126, 126))
    } else {
        1.0
    }
}

/// `[W][N]` over the unit of each wavelength as `[N][bands]`.
fn interleave(radiance: &[f32], unit: &[f32], n: usize) -> Vec<[f32; BAND]> {
    let bands = unit.len().div_ceil(BAND);
    let mut by_point = vec![[0.0; BAND]; n * bands];
    for (k, (plane, unit)) in radiance.chunks(n).zip(unit).enumerate() {
        for (i, l) in plane.iter().enumerate() {
            by_point[i * bands + k / BAND][k % BAND] = l / unit;
        }
    }
    by_point
}

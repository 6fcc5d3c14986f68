//! The diffuse operator over links: irradiance of all points from the radiance of clusters of points.

use super::diffuse::sweep;
use super::form_factor::{NEAR, exact, plain, plane_distances};
use super::lobe_table::BAND;
use super::near::DOUBT;
use super::round::{of_own, of_piece};
use super::settings::Kernel;
use crate::points::{Piece, SamplePoints};
use crate::visibility::Links;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Receivers of one task.
const ROWS: usize = 256;

/// Parts of a cell are not looked for below the horizon where all of it has no more than this projected solid angle, sr.
const NOTHING: f64 = 2e-4;

/// Cells of which extent² / r² is less are added up as one where only the size of a sum matters.
const SMALL: f32 = 0.1;

/// D over the links of a scene: E_i = Σ_c w_ic L_c, where L_c is the mean radiance of a cluster by area.
pub struct LinkedOperator<'a> {
    points: &'a SamplePoints,
    links: &'a Links,
    /// w of every link, sr.
    weight: Vec<f32>,
    row_sums: Vec<f32>,
}

impl<'a> LinkedOperator<'a> {
    /// Computes the form factors of all links.
    pub fn new(points: &'a SamplePoints, links: &'a Links, kernel: Kernel) -> Self {
        let mut operator = LinkedOperator { points, links, weight: Vec::new(), row_sums: Vec::new() };
        let mut weight = vec![0.0; links.cluster.len()];
        let mut rest = &mut weight[..];
        let mut tasks = Vec::new();
        for rows in links.order.chunks(ROWS) {
            let length = rows.iter().map(|&i| links.range(i as usize).len()).sum();
            let (own, others) = rest.split_at_mut(length);
            tasks.push((rows, own));
            rest = others;
        }
        tasks.into_par_iter().for_each(|(rows, weight)| {
            let mut rest = weight;
            for i in rows.iter().map(|&i| i as usize) {
                let (own, others) = rest.split_at_mut(links.range(i).len());
                rest = others;
                for (weight, (c, share)) in own.iter_mut().zip(links.row(i)) {
                    *weight = share * operator.unhidden(i, c, kernel);
                }
                if kernel == Kernel::Analytic {
                    operator.complete(i, own);
                }
            }
        });
        operator.weight = weight;
        let ones = vec![1.0; points.len()];
        operator.row_sums = operator.irradiance(&ones, |_| true);
        operator.row_sums.iter_mut().for_each(|q| *q /= PI);
        operator
    }

    /// Σ_c w_ic / π of every point: 1 in a closed scene, less where light can escape.
    pub fn row_sums(&self) -> &[f32] {
        &self.row_sums
    }

    /// Links of point `i`: (cluster, w), sr.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.links.range(i);
        self.links.cluster[range.clone()].iter().map(|&c| c as usize).zip(self.weight[range].iter().copied())
    }

    /// q of cluster `c` seen from `i` with nothing between.
    fn unhidden(&self, i: usize, c: usize, kernel: Kernel) -> f32 {
        let points = self.points;
        let hierarchy = &self.links.hierarchy;
        let cluster = &hierarchy.clusters[c];
        let Some((surface, side, cell)) = cluster.cell else { return self.of_several(i, c) };
        let way = cluster.position - points.position[i];
        let (here, there) = (points.normal[i].dot(way), -cluster.normal.dot(way));
        let r2 = way.length_squared();
        let of_plain = || plain(here.max(0.0), there.max(0.0), r2, cluster.area);
        if kernel == Kernel::Paper {
            return of_plain();
        }
        if let Some(round) = points.rounds.get(&surface) {
            let piece = Piece { round, side, cell };
            if points.surface[i] == surface {
                return points.round(i).map_or(0.0, |from| of_own(&from, &piece, &[])) as f32;
            }
            let near = cluster.area > NEAR * r2 || cluster.len() > 1;
            return if near {
                of_piece(points.position[i], points.normal[i], &piece, &[]) as f32
            } else {
                of_plain()
            };
        }
        let corners = &hierarchy.corners[c];
        let extent2 = self.extent2(c);
        if extent2 > NEAR * r2 || here * here < extent2 {
            exact(points.position[i], points.normal[i], corners) as f32
        } else {
            of_plain()
        }
    }

    /// Makes up for elements that the horizon of point `i` cuts and of which the middle is below it, so that they have no
    /// link: what is seen of the rest of their surface stands for them. `weight` is that of all links of `i`.
    fn complete(&self, i: usize, weight: &mut [f32]) {
        let hierarchy = &self.links.hierarchy;
        let whole_of = |c: u32| {
            let cluster = &hierarchy.clusters[c as usize];
            cluster
                .cell
                .filter(|(id, ..)| !self.points.rounds.contains_key(id))
                .map(|_| cluster.whole as usize)
        };
        // Links to one surface follow each other.
        let clusters = &self.links.cluster[self.links.range(i)];
        let mut rest = weight;
        for of_one in clusters.chunk_by(|&a, &b| whole_of(a) == whole_of(b)) {
            let (own, others) = rest.split_at_mut(of_one.len());
            rest = others;
            let Some(whole) = whole_of(of_one[0]) else { continue };
            let lacking = self.lacking(i, whole);
            if lacking > 0.0 && self.doubt(i, whole) >= DOUBT {
                let all = exact(self.points.position[i], self.points.normal[i], &hierarchy.corners[whole]);
                let factor = (all / (all - lacking).max(0.25 * all)) as f32;
                own.iter_mut().for_each(|weight| *weight *= factor);
            }
        }
    }

    /// q of the elements of cell `c` that the horizon of point `i` cuts and of which the middle is below it.
    fn lacking(&self, i: usize, c: usize) -> f64 {
        let hierarchy = &self.links.hierarchy;
        let (position, normal) = (self.points.position[i], self.points.normal[i]);
        let height = |p: Vec3| normal.dot(p - position);
        let corners = &hierarchy.corners[c];
        let above = |&v: &Vec3| height(v) > 0.0;
        if corners.iter().all(above) || !corners.iter().any(above) {
            return 0.0;
        }
        let q = exact(position, normal, corners);
        if q < NOTHING {
            return 0.0;
        }
        if hierarchy.clusters[c].len() == 1 {
            return if height(hierarchy.clusters[c].position) > 0.0 { 0.0 } else { q };
        }
        hierarchy.parts(c).map(|part| self.lacking(i, part)).sum()
    }

    /// Σ q extent² / r² over the far elements of cell `c`, hidden or not: what decides over all pairs of points whether
    /// a surface is summed up exactly.
    fn doubt(&self, i: usize, c: usize) -> f32 {
        let hierarchy = &self.links.hierarchy;
        let cluster = &hierarchy.clusters[c];
        let way = cluster.position - self.points.position[i];
        let (here, there) = (self.points.normal[i].dot(way), -cluster.normal.dot(way));
        let (r2, extent2) = (way.length_squared(), self.extent2(c));
        if cluster.len() > 1 && extent2 > SMALL * r2 {
            return hierarchy.parts(c).map(|part| self.doubt(i, part)).sum();
        }
        let ratio = extent2 / cluster.len() as f32 / r2;
        if ratio > NEAR { 0.0 } else { plain(here.max(0.0), there.max(0.0), r2, cluster.area) * ratio }
    }

    /// Half the sum of the squares from the middle of cell `c` to its corners, m².
    fn extent2(&self, c: usize) -> f32 {
        let hierarchy = &self.links.hierarchy;
        let middle = hierarchy.clusters[c].position;
        0.5 * hierarchy.corners[c].iter().map(|v| v.distance_squared(middle)).sum::<f32>()
    }

    /// The same of a cluster of several surfaces: by the points that were asked whether they are seen.
    fn of_several(&self, i: usize, c: usize) -> f32 {
        let (points, hierarchy) = (self.points, &self.links.hierarchy);
        let (mut q, mut area) = (0.0, 0.0);
        for j in hierarchy.spread(c, self.links.settings.segments, 0.5) {
            let (d_i, d_j, r2) = plane_distances(points, i, j);
            area += points.area[j];
            if d_i > 0.0 && d_j > 0.0 {
                q += plain(d_i, d_j, r2, points.area[j]);
            }
        }
        q * (hierarchy.clusters[c].area / area)
    }

    /// E of every point for which `wanted` holds (0 for the others), W m⁻² nm⁻¹, from the radiance of
    /// every point; both `[W][N]`. One sweep.
    pub fn irradiance(&self, radiance: &[f32], wanted: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
        let n = self.points.len();
        sweep(radiance, n, &wanted, |by_point, bands| {
            let clusters = self.of_clusters(by_point, bands);
            let mut sums = vec![[0.0f64; BAND]; n * bands];
            sums.par_chunks_mut(ROWS * bands).enumerate().for_each(|(task, sums)| {
                for (at, sums) in sums.chunks_mut(bands).enumerate() {
                    let i = task * ROWS + at;
                    if !wanted(i) {
                        continue;
                    }
                    for (c, q) in self.row(i) {
                        for (sum, light) in sums.iter_mut().zip(&clusters[c * bands..(c + 1) * bands]) {
                            (0..BAND).for_each(|k| sum[k] += f64::from(q * light[k]));
                        }
                    }
                }
            });
            sums
        })
    }

    /// Mean radiance of all clusters by area, `[clusters][bands]`, from that of the points, `[N][bands]`.
    fn of_clusters(&self, by_point: &[[f32; BAND]], bands: usize) -> Vec<[f32; BAND]> {
        let hierarchy = &self.links.hierarchy;
        let mut light = vec![[0.0f32; BAND]; hierarchy.clusters.len() * bands];
        // Parts come after what they are parts of.
        for c in (0..hierarchy.clusters.len()).rev() {
            if let [point] = hierarchy.points(c) {
                let own = *point as usize * bands;
                light[c * bands..(c + 1) * bands].copy_from_slice(&by_point[own..own + bands]);
                continue;
            }
            for band in 0..bands {
                let mut sum = [0.0f64; BAND];
                for part in hierarchy.parts(c) {
                    let area = f64::from(hierarchy.clusters[part].area);
                    let of = light[part * bands + band];
                    (0..BAND).for_each(|k| sum[k] += area * f64::from(of[k]));
                }
                let area = f64::from(hierarchy.clusters[c].area);
                light[c * bands + band] = sum.map(|sum| (sum / area) as f32);
            }
        }
        light
    }
}

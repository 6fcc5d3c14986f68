//! Links: what every sample point sees of clusters of points, in place of what it sees of every point.
//!
//! A cluster acts as one where the form factor from it to the point cannot be more than the tolerance: a bound by
//! area, distance and cosines alone, so links outlast every change of appearance. Segments to some of its points
//! then say how much of it is seen; where they do not agree, its parts are asked, down to a smaller tolerance.

use super::build::{Build, check};
use super::{GraphSettings, lights::LightSight};
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::{Hierarchy, SamplePoints};
use crate::scene::Geometry;
use crate::tracers::{RayTracer, Segment};
use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use std::f32::consts::PI;
use std::time::Instant;

/// How far clusters may stand for their points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkSettings {
    /// A cluster acts as one on a point if the form factor between them is surely no more than this.
    pub tolerance: f64,
    /// The same for a cluster of which only a part is seen, of `tolerance`.
    pub partial: f64,
    /// Segments to a cluster that say how much of it is seen.
    pub segments: usize,
}

impl Default for LinkSettings {
    fn default() -> Self {
        LinkSettings { tolerance: 0.01, partial: 0.25, segments: 8 }
    }
}

impl LinkSettings {
    /// Refuses what no run can use.
    pub fn validate(&self) -> Result<()> {
        if !(self.tolerance >= 1e-7 && self.tolerance <= 1.0) {
            let message =
                format!("the tolerance of links is {}: give a form factor from 1e-7 to 1", self.tolerance);
            return Err(Error::Settings(message));
        }
        if !(self.partial > 0.0 && self.partial <= 1.0 && (1..=64).contains(&self.segments)) {
            let message = "links need a share of the tolerance from 0 to 1 and 1 to 64 segments";
            return Err(Error::Settings(message.into()));
        }
        Ok(())
    }
}

/// What the links of a scene are and what they cost.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkStats {
    /// Links.
    pub links: u64,
    /// Those to clusters of more than one point.
    pub of_clusters: u64,
    /// Those to clusters of which a part is seen.
    pub partial: u64,
    /// Clusters in the hierarchy.
    pub clusters: u64,
    /// Segments that were traced.
    pub rays_cast: u64,
    /// Wall time, s.
    pub build_s: f64,
}

/// What all points see of each other, by clusters.
#[derive(Clone, Debug)]
pub struct Links {
    /// The clusters.
    pub hierarchy: Hierarchy,
    /// First link of each point, and at the end the number of links.
    pub starts: Vec<usize>,
    /// The cluster of each link, ascending for each point.
    pub cluster: Vec<u32>,
    /// How much of it is seen, of what faces the point; never 0.
    pub share: Vec<f32>,
    /// The settings they were made with.
    pub settings: LinkSettings,
    /// How they were made.
    pub stats: LinkStats,
    pub(super) key: [u8; 32],
    pub(super) lights: LightSight,
}

/// Points of one task.
const BLOCK: usize = 64;
/// Tasks between two joins of the threads.
const CHUNK: usize = 64;
/// Normals of a cluster that differ by no more are taken for one, rad.
const ONE_NORMAL: f32 = 1e-4;

/// The links of some points.
#[derive(Default)]
struct Rows {
    ends: Vec<usize>,
    links: Vec<(u32, f32)>,
    rays: u64,
}

impl Links {
    /// Finds what all `points` see of each other. The same bits result from any number of threads.
    ///
    /// # Errors
    /// [`Error::Settings`] when the points are not those of this geometry, a setting cannot be used, or memory does
    /// not hold the links.
    pub fn build(
        geometry: &Geometry,
        points: &SamplePoints,
        tracer: &dyn RayTracer,
        settings: &LinkSettings,
        observer: &dyn Observer,
    ) -> Result<Links> {
        let clock = Instant::now();
        settings.validate()?;
        check(geometry, points)?;
        let graph_settings = GraphSettings::default();
        let hierarchy = Hierarchy::new(geometry, points);
        let build = Build::new(geometry, points, tracer, &graph_settings);
        let mut leaf_of = vec![0; points.len()];
        for c in (0..hierarchy.clusters.len()).filter(|&c| hierarchy.clusters[c].len() == 1) {
            leaf_of[hierarchy.points(c)[0] as usize] = c as u32;
        }
        let tolerance = geometry.plane_tolerance() as f32;
        let search = Search { build: &build, hierarchy: &hierarchy, settings, tolerance, leaf_of };
        let n = points.len();
        let mut links = Links {
            starts: vec![0],
            cluster: Vec::new(),
            share: Vec::new(),
            settings: *settings,
            stats: LinkStats::default(),
            key: points.key,
            lights: LightSight::look(geometry, points, tracer),
            hierarchy: Hierarchy::default(),
        };
        observer.begin("links", n as u64);
        let mut firsts = (0..n).step_by(BLOCK);
        loop {
            let chunk: Vec<usize> = firsts.by_ref().take(CHUNK).collect();
            if chunk.is_empty() {
                break;
            }
            let found: Vec<Rows> =
                chunk.par_iter().map(|&first| search.rows(first..(first + BLOCK).min(n))).collect();
            for rows in found {
                let before = links.cluster.len();
                let more = rows.links.len();
                if links.cluster.try_reserve(more).is_err() || links.share.try_reserve(more).is_err() {
                    observer.end();
                    let message =
                        "not enough memory for the links: raise their tolerance, or sample more coarsely";
                    return Err(Error::Settings(message.into()));
                }
                links.starts.extend(rows.ends.iter().map(|end| before + end));
                links.cluster.extend(rows.links.iter().map(|l| l.0));
                links.share.extend(rows.links.iter().map(|l| l.1));
                links.stats.rays_cast += rows.rays;
            }
            observer.advance((chunk.len() * BLOCK) as u64);
        }
        observer.end();
        let of_clusters = |c: &&u32| hierarchy.clusters[**c as usize].len() > 1;
        links.stats.links = links.cluster.len() as u64;
        links.stats.of_clusters = links.cluster.iter().filter(of_clusters).count() as u64;
        links.stats.partial = links.share.iter().filter(|s| **s < 1.0).count() as u64;
        links.stats.clusters = hierarchy.clusters.len() as u64;
        links.hierarchy = hierarchy;
        links.stats.build_s = clock.elapsed().as_secs_f64();
        Ok(links)
    }

    /// The links of point `i`: clusters, and how much of them is seen.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.starts[i]..self.starts[i + 1];
        self.cluster[range.clone()].iter().map(|&c| c as usize).zip(self.share[range].iter().copied())
    }

    /// What the points see of the lights and the sky.
    pub fn lights(&self) -> &LightSight {
        &self.lights
    }

    /// Whether it is known what the lights of `geometry` reach.
    pub fn knows_lights(&self, geometry: &Geometry) -> bool {
        self.lights.knows(geometry)
    }

    /// The key of the sample points that the links were made for ([`SamplePoints::key`]).
    pub fn key(&self) -> &[u8; 32] {
        &self.key
    }

    /// Memory they take, bytes.
    pub fn memory_bytes(&self) -> u64 {
        (self.cluster.len() * 8 + self.starts.len() * 8) as u64
    }
}

/// Looking for links.
struct Search<'a> {
    build: &'a Build<'a>,
    hierarchy: &'a Hierarchy,
    settings: &'a LinkSettings,
    tolerance: f32,
    /// The cluster that is each point alone.
    leaf_of: Vec<u32>,
}

/// A cluster that may act as one, while segments to it are traced.
struct Candidate {
    cluster: u32,
    bound: f32,
    /// Its segments, and what each of them stands for.
    segments: std::ops::Range<usize>,
}

/// What one task uses again for every point.
#[derive(Default)]
struct Scratch {
    open: Vec<u32>,
    candidates: Vec<Candidate>,
    segments: Vec<Segment>,
    weights: Vec<f32>,
    blocked: Vec<bool>,
}

impl Search<'_> {
    fn rows(&self, points: std::ops::Range<usize>) -> Rows {
        let mut rows = Rows::default();
        let mut scratch = Scratch::default();
        for i in points {
            if !self.build.under[i] {
                let first = rows.links.len();
                self.row(i, &mut scratch, &mut rows);
                // An element of the inside of a sphere sees itself.
                if self.build.points.round(i).is_some_and(|piece| piece.faces_itself()) {
                    rows.links.push((self.leaf_of[i], 1.0));
                }
                rows.links[first..].sort_unstable_by_key(|l| l.0);
            }
            rows.ends.push(rows.links.len());
        }
        rows
    }

    /// Adds the links of point `i`: asks wave after wave of clusters, all segments of a wave together.
    fn row(&self, i: usize, scratch: &mut Scratch, rows: &mut Rows) {
        let Scratch { open, candidates, segments, weights, blocked } = scratch;
        let LinkSettings { tolerance, partial, .. } = *self.settings;
        let clusters = &self.hierarchy.clusters;
        let tolerances = [tolerance as f32, (tolerance * partial) as f32];
        open.clear();
        open.push(0);
        while !open.is_empty() {
            candidates.clear();
            segments.clear();
            weights.clear();
            while let Some(c) = open.pop() {
                let bound = self.bound(i, c as usize);
                if bound == 0.0 {
                    continue;
                }
                let single = clusters[c as usize].len() == 1;
                if bound > tolerances[0] && !single {
                    open.extend(self.hierarchy.parts(c as usize).map(|part| part as u32));
                    continue;
                }
                let first = segments.len();
                self.aim(i, c as usize, segments, weights);
                let segments = first..segments.len();
                if !segments.is_empty() {
                    candidates.push(Candidate { cluster: c, bound, segments });
                } else if bound > tolerances[1] {
                    open.extend(self.hierarchy.parts(c as usize).map(|part| part as u32));
                }
            }
            blocked.clear();
            blocked.resize(segments.len(), false);
            self.build.tracer.occluded_batch(segments, blocked);
            rows.rays += segments.len() as u64;
            for Candidate { cluster, bound, segments } in candidates.drain(..) {
                let (mut seen, mut all) = (0.0, 0.0);
                for at in segments {
                    all += weights[at];
                    seen += if blocked[at] { 0.0 } else { weights[at] };
                }
                if seen == 0.0 {
                    continue;
                }
                if seen < all && bound > tolerances[1] {
                    open.extend(self.hierarchy.parts(cluster as usize).map(|part| part as u32));
                } else {
                    rows.links.push((cluster, seen / all));
                }
            }
        }
    }

    /// No less than the form factor from point `i` to cluster `c`, whatever hides it; 0 if they do not face each other.
    fn bound(&self, i: usize, c: usize) -> f32 {
        let points = self.build.points;
        let cluster = &self.hierarchy.clusters[c];
        let (p, n) = (points.position[i], points.normal[i]);
        let middle = 0.5 * (cluster.low + cluster.high);
        let half = 0.5 * (cluster.high - cluster.low);
        let way = middle - p;
        let height = n.dot(way) + n.abs().dot(half);
        if height <= self.tolerance {
            return 0.0;
        }
        let least = (way.abs() - half).max(Vec3::ZERO).length();
        // The largest cosine at the cluster.
        let normal = cluster.normal.normalize_or_zero();
        let cosine = if cluster.spread <= ONE_NORMAL {
            let flat = if cluster.cell.is_some() { 0.0 } else { normal.abs().dot(half) };
            let from = if cluster.cell.is_some() { cluster.position } else { middle };
            let depth = normal.dot(p - from) + flat;
            if depth <= self.tolerance {
                return 0.0;
            }
            depth / least
        } else {
            let angle = normal.dot(-way / way.length()).clamp(-1.0, 1.0).acos();
            let around = (half.length() / way.length()).min(1.0).asin();
            let angle = angle - cluster.spread - around;
            if angle >= 0.5 * PI {
                return 0.0;
            }
            angle.max(0.0).cos()
        };
        let bound = cosine.min(1.0) * (height / least).min(1.0) * cluster.area / (PI * least * least);
        // Also where it is not a number.
        if bound < 1.0 { bound } else { 1.0 }
    }

    /// Segments from point `i` to some points of cluster `c` that face it, and how much each of them would bring.
    fn aim(&self, i: usize, c: usize, segments: &mut Vec<Segment>, weights: &mut Vec<f32>) {
        let points = self.build.points;
        let from = points.position[i];
        for j in self.hierarchy.spread(c, self.settings.segments, 0.5) {
            let way = points.position[j] - from;
            let (here, there) = (points.normal[i].dot(way), -points.normal[j].dot(way));
            let facing = here > self.tolerance && there > self.tolerance;
            if !facing || self.build.under[j] || points.share_plane(i, j) {
                continue;
            }
            let inverse = 1.0 / way.length_squared();
            segments.push(Segment { from, to: points.position[j] });
            weights.push((here * inverse) * (there * inverse) * points.area[j]);
        }
    }
}

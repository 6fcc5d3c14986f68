//! Links: what every sample point sees of clusters of points, in place of what it sees of every point.
//!
//! A cluster acts as one where the form factor from it to the point cannot be more than the tolerance: a bound by
//! area, distance and cosines alone, so links outlast every change of appearance. Segments to some of its points
//! then say how much of it is seen; where they do not agree, its parts are asked, down to a smaller tolerance.
//! Small faces that lie together ask for what is far away together.

use super::build::{Build, check};
use super::link_search::{Rows, Search};
use super::{GraphSettings, lights::LightSight};
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::{Group, Hierarchy, SamplePoints, Sampling, groups};
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;
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
    /// The sampling behind the points: whole faces that are smaller than it asks for and lie together on one smooth
    /// surface ask together for what is far away ([`groups`]). `None`: each point asks for itself.
    pub together: Option<Sampling>,
}

impl Default for LinkSettings {
    fn default() -> Self {
        LinkSettings { tolerance: 0.01, partial: 0.25, segments: 8, together: None }
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
    /// Groups of points that ask together, those of one point included.
    pub groups: u64,
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
    /// The points in the order of their links.
    pub order: Vec<u32>,
    /// First link of each of these, and at the end the number of links.
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
    /// By point: its place in `order`.
    rank: Vec<u32>,
}

/// Points of one task, but for the last group.
const BLOCK: usize = 64;
/// Tasks between two joins of the threads.
const CHUNK: usize = 64;

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
        let groups = groups(geometry, points, settings.together.as_ref());
        let tasks = tasks(&groups);
        let n = points.len();
        let order: Vec<u32> = groups.iter().flat_map(|group| group.points.iter().copied()).collect();
        let mut rank = vec![0; n];
        order.iter().enumerate().for_each(|(at, &i)| rank[i as usize] = at as u32);
        let mut links = Links {
            order,
            rank,
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
        for chunk in tasks.chunks(CHUNK) {
            let found: Vec<Rows> = chunk.par_iter().map(|groups| search.rows(groups)).collect();
            for rows in found {
                observer.advance(rows.ends.len() as u64);
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
        }
        observer.end();
        let of_clusters = |c: &&u32| hierarchy.clusters[**c as usize].len() > 1;
        links.stats.links = links.cluster.len() as u64;
        links.stats.of_clusters = links.cluster.iter().filter(of_clusters).count() as u64;
        links.stats.partial = links.share.iter().filter(|s| **s < 1.0).count() as u64;
        links.stats.clusters = hierarchy.clusters.len() as u64;
        links.stats.groups = groups.len() as u64;
        links.hierarchy = hierarchy;
        links.stats.build_s = clock.elapsed().as_secs_f64();
        Ok(links)
    }

    /// Which of the links are those of point `i`.
    pub fn range(&self, i: usize) -> Range<usize> {
        let at = self.rank[i] as usize;
        self.starts[at]..self.starts[at + 1]
    }

    /// The links of point `i`: clusters, and how much of them is seen.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.range(i);
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
        (self.cluster.len() * 8 + self.starts.len() * 16) as u64
    }
}

/// The groups of each task.
fn tasks(groups: &[Group]) -> Vec<&[Group]> {
    let mut tasks = Vec::new();
    let (mut first, mut points) = (0, 0);
    for (at, group) in groups.iter().enumerate() {
        points += group.points.len();
        if points >= BLOCK || at + 1 == groups.len() {
            tasks.push(&groups[first..=at]);
            (first, points) = (at + 1, 0);
        }
    }
    tasks
}

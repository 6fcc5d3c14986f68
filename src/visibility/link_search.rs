//! Looking for the links of points: from the cluster of all points down to those that may act as one.
//!
//! A group of points asks first, for what is far from all of it. What its segments agree on holds for each of its points.
//! Where they do not agree each point asks again, with half as many segments; what is near, and single points, it looks for
//! by itself. A group of one point asks once.

use super::build::Build;
use super::links::LinkSettings;
use crate::points::{Group, Hierarchy};
use crate::tracers::Segment;
use glam::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// Normals of a cluster that differ by no more are taken for one, rad.
const ONE_NORMAL: f32 = 1e-4;
/// What is no further from a group than so many times its own size, and no larger, is near.
const NEAR: f32 = 2.0;
/// Segment after segment begins at the point of a group that lies so much of it further on, round and round: the golden
/// ratio spreads any number of them.
const TURN: f32 = 0.618_034;

/// The links of some points.
#[derive(Default)]
pub struct Rows {
    /// Where those of each point end.
    pub ends: Vec<usize>,
    /// Clusters, and how much of them is seen.
    pub links: Vec<(u32, f32)>,
    /// Segments that were traced.
    pub rays: u64,
}

/// Looking for links.
pub struct Search<'a> {
    pub build: &'a Build<'a>,
    pub hierarchy: &'a Hierarchy,
    pub settings: &'a LinkSettings,
    /// Distances from a plane below this are no distance at all, m.
    pub tolerance: f32,
    /// The cluster that is each point alone.
    pub leaf_of: Vec<u32>,
}

/// Who asks: a point, or several of a group.
struct Receiver<'a> {
    points: &'a [u32],
    /// Of the box around them, m.
    middle: Vec3,
    /// Half its size.
    half: Vec3,
    normal: Vec3,
    /// The largest distance of a normal from `normal`.
    turn: f32,
}

/// A cluster that may act as one, while segments to it are traced.
struct Candidate {
    cluster: u32,
    bound: f32,
    /// Its segments, and what each of them stands for.
    segments: Range<usize>,
}

/// What a group leaves to its points.
#[derive(Default)]
struct Left {
    /// Clusters that are near, and single points.
    near: Vec<u32>,
    /// Clusters that may act as one, and of which the group sees a part.
    doubtful: Vec<u32>,
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
    /// The links of the points of `groups`.
    pub fn rows(&self, groups: &[Group]) -> Rows {
        let mut rows = Rows::default();
        let mut scratch = Scratch::default();
        let mut shared = Vec::new();
        let mut left = Left::default();
        for group in groups {
            shared.clear();
            left.doubtful.clear();
            left.near.clear();
            left.near.push(0);
            let seeing: Vec<u32> =
                group.points.iter().copied().filter(|&i| !self.build.under[i as usize]).collect();
            if seeing.len() > 1 {
                scratch.open.append(&mut left.near);
                let half = 0.5 * (group.high - group.low);
                let turn = 2.0 * (0.5 * group.spread).sin();
                let receiver =
                    Receiver { points: &seeing, middle: group.low + half, half, normal: group.normal, turn };
                rows.rays += self.ask(&receiver, &mut scratch, &mut shared, Some(&mut left));
            }
            for i in &group.points {
                let own = *i as usize;
                if !self.build.under[own] {
                    let first = rows.links.len();
                    rows.links.extend(&shared);
                    scratch.open.extend(&left.near);
                    let point = self.alone(i);
                    rows.rays += self.ask(&point, &mut scratch, &mut rows.links, None);
                    rows.rays += self.again(&point, &left.doubtful, &mut scratch, &mut rows.links);
                    // An element of the inside of a sphere sees itself.
                    if self.build.points.round(own).is_some_and(|piece| piece.faces_itself()) {
                        rows.links.push((self.leaf_of[own], 1.0));
                    }
                    rows.links[first..].sort_unstable_by_key(|l| l.0);
                }
                rows.ends.push(rows.links.len());
            }
        }
        rows
    }

    /// Point `i` by itself.
    fn alone<'p>(&self, i: &'p u32) -> Receiver<'p> {
        let points = self.build.points;
        let (middle, normal) = (points.position[*i as usize], points.normal[*i as usize]);
        Receiver { points: std::slice::from_ref(i), middle, half: Vec3::ZERO, normal, turn: 0.0 }
    }

    /// Adds the links of `receiver` to the open clusters: asks wave after wave of clusters, all segments of a wave
    /// together. A group leaves some to its points. Returns the number of segments.
    fn ask(
        &self,
        receiver: &Receiver,
        scratch: &mut Scratch,
        links: &mut Vec<(u32, f32)>,
        mut left: Option<&mut Left>,
    ) -> u64 {
        let Scratch { open, candidates, segments, weights, blocked } = scratch;
        let LinkSettings { tolerance, partial, .. } = *self.settings;
        let clusters = &self.hierarchy.clusters;
        let tolerances = [tolerance as f32, (tolerance * partial) as f32];
        let mut rays = 0;
        while !open.is_empty() {
            candidates.clear();
            segments.clear();
            weights.clear();
            while let Some(c) = open.pop() {
                let bound = self.bound(receiver, c as usize);
                if bound == 0.0 {
                    continue;
                }
                let single = clusters[c as usize].len() == 1;
                let large = bound > tolerances[0];
                if let Some(left) = left.as_mut()
                    && (single || large && self.near(receiver, c as usize))
                {
                    left.near.push(c);
                    continue;
                }
                if large && !single {
                    open.extend(self.hierarchy.parts(c as usize).map(|part| part as u32));
                    continue;
                }
                let first = segments.len();
                self.aim(receiver, c as usize, self.settings.segments, segments, weights);
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
            rays += segments.len() as u64;
            for Candidate { cluster, bound, segments } in candidates.drain(..) {
                let (seen, all) = seen(&weights[segments.clone()], &blocked[segments]);
                if seen == 0.0 {
                    continue;
                }
                let whole = seen == all;
                match &mut left {
                    Some(left) if !whole && bound <= tolerances[1] => left.doubtful.push(cluster),
                    _ if !whole && bound > tolerances[1] => {
                        open.extend(self.hierarchy.parts(cluster as usize).map(|part| part as u32));
                    }
                    _ => links.push((cluster, seen / all)),
                }
            }
        }
        rays
    }

    /// Adds the links of a point to those of the `doubtful` clusters that it sees. Returns the number of segments.
    fn again(
        &self,
        point: &Receiver,
        doubtful: &[u32],
        scratch: &mut Scratch,
        links: &mut Vec<(u32, f32)>,
    ) -> u64 {
        let Scratch { candidates, segments, weights, blocked, .. } = scratch;
        segments.clear();
        weights.clear();
        for &cluster in doubtful {
            let first = segments.len();
            self.aim(point, cluster as usize, self.settings.segments.div_ceil(2), segments, weights);
            candidates.push(Candidate { cluster, bound: 0.0, segments: first..segments.len() });
        }
        blocked.clear();
        blocked.resize(segments.len(), false);
        self.build.tracer.occluded_batch(segments, blocked);
        for Candidate { cluster, segments, .. } in candidates.drain(..) {
            let (seen, all) = seen(&weights[segments.clone()], &blocked[segments]);
            if seen > 0.0 {
                links.push((cluster, seen / all));
            }
        }
        segments.len() as u64
    }

    /// Whether cluster `c` is no further from a group than it is large, nor larger.
    fn near(&self, receiver: &Receiver, c: usize) -> bool {
        let cluster = &self.hierarchy.clusters[c];
        let half = 0.5 * (cluster.high - cluster.low);
        let way = 0.5 * (cluster.low + cluster.high) - receiver.middle;
        let size = NEAR * receiver.half.length();
        half.length() <= size && (way.abs() - half - receiver.half).max(Vec3::ZERO).length() <= size
    }

    /// No less than the form factor from any point of the receiver to cluster `c`, whatever hides it; 0 if they do not face
    /// each other.
    fn bound(&self, receiver: &Receiver, c: usize) -> f32 {
        let cluster = &self.hierarchy.clusters[c];
        let Receiver { middle: p, normal: n, .. } = *receiver;
        let middle = 0.5 * (cluster.low + cluster.high);
        let own = 0.5 * (cluster.high - cluster.low);
        let half = own + receiver.half;
        let way = middle - p;
        let height = n.dot(way) + n.abs().dot(half) + receiver.turn * (way.length() + half.length());
        if height <= self.tolerance {
            return 0.0;
        }
        let least = (way.abs() - half).max(Vec3::ZERO).length();
        // The largest cosine at the cluster.
        let normal = cluster.normal.normalize_or_zero();
        let cosine = if cluster.spread <= ONE_NORMAL {
            let flat = if cluster.cell.is_some() { 0.0 } else { normal.abs().dot(own) };
            let from = if cluster.cell.is_some() { cluster.position } else { middle };
            let depth = normal.dot(p - from) + flat + normal.abs().dot(receiver.half);
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

    /// Up to `most` segments from the receiver to points of cluster `c`, where they face each other, and how much each of
    /// them would bring. A group sends as many, from several of its points, to however few.
    fn aim(
        &self,
        receiver: &Receiver,
        c: usize,
        most: usize,
        segments: &mut Vec<Segment>,
        weights: &mut Vec<f32>,
    ) {
        let points = self.build.points;
        let (from, to) = (receiver.points, self.hierarchy.points(c));
        let count = if from.len() == 1 { most.min(to.len()) } else { most };
        for k in 0..count {
            let j = to[place(k as f32 + 0.5, count as f32, to.len())] as usize;
            let i = from[place((TURN * k as f32 + 0.5).fract(), 1.0, from.len())] as usize;
            let position = points.position[i];
            let way = points.position[j] - position;
            let (here, there) = (points.normal[i].dot(way), -points.normal[j].dot(way));
            let facing = here > self.tolerance && there > self.tolerance;
            if !facing || self.build.under[j] || points.share_plane(i, j) {
                continue;
            }
            let inverse = 1.0 / way.length_squared();
            segments.push(Segment { from: position, to: points.position[j] });
            weights.push((here * inverse) * (there * inverse) * points.area[j]);
        }
    }
}

/// How much is seen, and how much would be with nothing between.
fn seen(weights: &[f32], blocked: &[bool]) -> (f32, f32) {
    let (mut seen, mut all) = (0.0, 0.0);
    for (weight, blocked) in weights.iter().zip(blocked) {
        all += weight;
        seen += if *blocked { 0.0 } else { *weight };
    }
    (seen, all)
}

/// Which of `n` lies at `part` of `whole`.
fn place(part: f32, whole: f32, n: usize) -> usize {
    ((part * n as f32 / whole) as usize).min(n - 1)
}

//! Deciding the pairs of two voxels, tile by tile: a tile is the pairs of two patches.

use super::blocker::{Blocker, HIDDEN, Profile, Verdict};
use super::build::Build;
use super::cull::misses_shaft;
use super::graph::stride_of;
use super::patch::Patch;
use super::stats::GraphStats;
use crate::geometry::Aabb;
use crate::simd::{HotLoop, wide};
use crate::tracers::Segment;
use glam::DVec3;
use std::ops::Range;

/// Bit of a pair's state: a ray has answered it.
const ANSWERED: u64 = 4;

/// Segments are handed to the tracer in batches of about this many.
const BATCH: usize = 4096;

/// A tile with fewer pairs left than this is cast without asking for its blocker first.
const WORTH_A_PROBE: usize = 16;

/// What is known of two voxels when all their pairs are decided.
#[derive(Debug)]
pub(super) struct VoxelPair {
    /// The bits, rows from the first voxel: a facing pair's is set when nothing blocks it.
    pub words: Vec<u32>,
    /// Facing pairs.
    pub facing: u64,
    /// Facing pairs that see each other.
    pub seen: u64,
    /// How they were decided.
    pub stats: GraphStats,
}

/// One side of a tile: the points of a patch that are in front of the other's plane.
#[derive(Debug, Default)]
struct Flank {
    index: Vec<usize>,
    position: Vec<DVec3>,
}

/// Decides the pairs of two voxels.
pub(super) struct PairWork<'a> {
    build: &'a Build<'a>,
    rows: Range<usize>,
    columns: Range<usize>,
    result: VoxelPair,
    /// Surfaces that may block between the two voxels.
    candidates: Vec<u32>,
    /// Surfaces that may block in the tile at hand.
    open: Vec<u32>,
    /// The paper's buf-int.
    last_blocker: Option<u32>,
    from: Flank,
    to: Flank,
    profile: Profile,
    /// State of each pair of the tile at hand, row by row.
    states: Vec<u64>,
    segments: Vec<Segment>,
    targets: Vec<[u32; 2]>,
    blocked: Vec<bool>,
}

impl<'a> PairWork<'a> {
    /// Decides all pairs of the points of voxels `a <= b`.
    pub fn decide(build: &'a Build<'a>, a: usize, b: usize) -> VoxelPair {
        let (rows, columns) = (build.points.voxel(a), build.points.voxel(b));
        let words = vec![0; rows.len() * stride_of(columns.len())];
        let result = VoxelPair { words, facing: 0, seen: 0, stats: GraphStats::default() };
        let mut work = PairWork {
            build,
            rows,
            columns,
            result,
            candidates: Vec::new(),
            open: Vec::new(),
            last_blocker: None,
            from: Flank::default(),
            to: Flank::default(),
            profile: Profile::default(),
            states: Vec::new(),
            segments: Vec::new(),
            targets: Vec::new(),
            blocked: Vec::new(),
        };
        if work.rows.is_empty() || work.columns.is_empty() {
            return work.result;
        }
        if build.settings.proofs {
            build.tree.candidates(&build.blockers, &build.boxes[a], &build.boxes[b], &mut work.candidates);
        }
        let (first, second) = (&build.patches_of(a), &build.patches_of(b));
        for (k, from) in first.iter().enumerate() {
            for to in &second[if a == b { k } else { 0 }..] {
                work.tile(from, to);
            }
        }
        work.cast();
        work.result
    }

    /// Decides the pairs of two patches, or leaves them to the tracer.
    fn tile(&mut self, a: &Patch, b: &Patch) {
        let all = if a.points == b.points {
            a.points.len() * (a.points.len() - 1) / 2
        } else {
            a.points.len() * b.points.len()
        } as u64;
        self.result.stats.pairs += all;
        if a.surface == b.surface {
            self.result.stats.same_surface += all;
            return;
        }
        // A patch is planar: whether its points face another patch's is a matter of its plane.
        self.build.in_front(&mut self.from, a, b);
        self.build.in_front(&mut self.to, b, a);
        let facing = self.from.index.len() * self.to.index.len();
        self.result.stats.not_facing += all - facing as u64;
        if facing == 0 {
            return;
        }
        self.result.facing += facing as u64;
        self.states.clear();
        self.states.resize(facing, 0);

        let (hull_a, hull_b) = (a.rectangle(&self.from.position), b.rectangle(&self.to.position));
        let hull = Aabb::around(hull_a.iter().chain(&hull_b).copied());
        let length = hull.size().length();
        if self.build.settings.proofs {
            if self.prove(a, b, [&hull_a, &hull_b], &hull) {
                return;
            }
            if self.open.len() <= self.build.settings.direct_candidates {
                self.test_candidates(length);
                return;
            }
        }
        self.trace(a, b, length);
    }

    /// Finds the candidates of the tile; none, or one that covers all, decides it.
    fn prove(&mut self, a: &Patch, b: &Patch, [hull_a, hull_b]: [&[DVec3; 4]; 2], hull: &Aabb) -> bool {
        let build = self.build;
        let length = hull.size().length();
        self.open.clear();
        for &c in &self.candidates {
            let blocker = &build.blockers[c as usize];
            // A surface cannot hide what is in front of it, nor block from behind what faces away.
            let in_front = |of: &Patch| {
                c != of.surface.0
                    && blocker.vertices().iter().any(|v| of.plane.height(*v) > build.bands.apart)
            };
            if !in_front(a) || !in_front(b) {
                continue;
            }
            match blocker.judge(hull_a, hull_b, length) {
                Verdict::Clear => {}
                Verdict::Covers => {
                    self.result.stats.proved += self.states.len() as u64;
                    self.last_blocker = Some(c);
                    return true;
                }
                Verdict::Open if misses_shaft(blocker, hull_a, hull_b, hull) => {}
                Verdict::Open => self.open.push(c),
            }
        }
        let visible = self.open.is_empty();
        if visible {
            self.result.stats.proved += self.states.len() as u64;
            for k in 0..self.states.len() {
                self.see(k);
            }
        }
        visible
    }

    /// Tests every candidate of the tile, the last blocker first, and casts only the rays that
    /// pass one too close to call.
    fn test_candidates(&mut self, length: f64) {
        if let Some(k) = self.open.iter().position(|&c| Some(c) == self.last_blocker) {
            self.open.swap(0, k);
        }
        let mut left = self.states.len() as u64;
        for k in 0..self.open.len() {
            let c = self.open[k];
            let hidden = self.mark(c, length);
            if Some(c) == self.last_blocker {
                self.result.stats.last_blocker += hidden;
            } else {
                self.result.stats.direct += hidden;
            }
            if hidden > 0 {
                self.last_blocker = Some(c);
            }
            left -= hidden;
            if left == 0 {
                return;
            }
        }
        for k in 0..self.states.len() {
            match self.states[k] {
                0 => {
                    self.result.stats.direct += 1;
                    self.see(k);
                }
                state if state & HIDDEN != 0 => {}
                _ => self.push(k),
            }
        }
    }

    /// The paper's way: the last blocker, then the tracer. Where many pairs are left, one ray asks
    /// for a new last blocker first.
    fn trace(&mut self, a: &Patch, b: &Patch, length: f64) {
        let own = [Some(a.surface.0), Some(b.surface.0)];
        if let Some(c) = self.last_blocker.filter(|&c| !own.contains(&Some(c))) {
            self.result.stats.last_blocker += self.mark(c, length);
        }
        let left = self.states.iter().filter(|&&s| s & HIDDEN == 0).count();
        if left >= WORTH_A_PROBE {
            self.probe(left / 2, own, length);
        }
        for k in 0..self.states.len() {
            if self.states[k] & (HIDDEN | ANSWERED) == 0 {
                self.push(k);
            }
        }
    }

    /// Casts the `nth` undecided pair of the tile alone, to learn what blocks it.
    fn probe(&mut self, nth: usize, own: [Option<u32>; 2], length: f64) {
        let mut undecided = (0..self.states.len()).filter(|&k| self.states[k] & HIDDEN == 0);
        let Some(k) = undecided.nth(nth) else { return };
        self.result.stats.rays_cast += 1;
        self.states[k] |= ANSWERED;
        match self.build.tracer.blocker(&self.segment(k)) {
            None => self.see(k),
            Some(surface) => {
                self.states[k] |= HIDDEN;
                let found = Some(surface.0);
                if found != self.last_blocker && !own.contains(&found) {
                    self.last_blocker = found;
                    self.result.stats.last_blocker += self.mark(surface.0, length);
                }
            }
        }
    }

    /// Tests all pairs of the tile against surface `c`; returns how many it is the first to hide.
    fn mark(&mut self, c: u32, length: f64) -> u64 {
        let Some(blocker) = self.build.blockers.get(c as usize) else { return 0 };
        blocker.profile(&self.to.position, &mut self.profile);
        let (from, to, states) = (&self.from.position[..], &self.profile, &mut self.states[..]);
        wide(Mark { blocker, from, to, width: self.to.position.len(), length, states })
    }

    /// The points of pair `k` of the tile.
    fn pair(&self, k: usize) -> (usize, usize) {
        let width = self.to.index.len();
        (self.from.index[k / width], self.to.index[k % width])
    }

    fn segment(&self, k: usize) -> Segment {
        let (i, j) = self.pair(k);
        let position = &self.build.points.position;
        Segment { from: position[i], to: position[j] }
    }

    /// Pair `k` of the tile is visible.
    fn see(&mut self, k: usize) {
        let (i, j) = self.pair(k);
        self.see_points(i, j);
    }

    fn see_points(&mut self, i: usize, j: usize) {
        self.result.seen += 1;
        let stride = stride_of(self.columns.len());
        let mut set = |i: usize, j: usize| {
            let (r, c) = (i - self.rows.start, j - self.columns.start);
            self.result.words[r * stride + c / 32] |= 1 << (c % 32);
        };
        set(i, j);
        if self.rows == self.columns {
            set(j, i);
        }
    }

    /// Leaves pair `k` of the tile to the tracer.
    fn push(&mut self, k: usize) {
        let (i, j) = self.pair(k);
        self.segments.push(self.segment(k));
        self.targets.push([i as u32, j as u32]);
        if self.segments.len() >= BATCH {
            self.cast();
        }
    }

    /// Casts what has been left to the tracer.
    fn cast(&mut self) {
        if self.segments.is_empty() {
            return;
        }
        self.blocked.clear();
        self.blocked.resize(self.segments.len(), true);
        self.build.tracer.occluded_batch(&self.segments, &mut self.blocked);
        self.result.stats.rays_cast += self.segments.len() as u64;
        for k in 0..self.targets.len() {
            if !self.blocked[k] {
                let [i, j] = self.targets[k];
                self.see_points(i as usize, j as usize);
            }
        }
        self.segments.clear();
        self.targets.clear();
    }
}

impl Build<'_> {
    /// The points of patch `of` that lie in front of the plane of `other`.
    fn in_front(&self, flank: &mut Flank, of: &Patch, other: &Patch) {
        flank.index.clear();
        flank.position.clear();
        for i in of.points.clone() {
            let p = self.points.position[i].as_dvec3();
            if other.plane.height(p) > self.bands.apart {
                flank.index.push(i);
                flank.position.push(p);
            }
        }
    }
}

/// Tests the segments from each point of `from` to all of a tile's other points against a surface.
struct Mark<'a> {
    blocker: &'a Blocker,
    from: &'a [DVec3],
    to: &'a Profile,
    /// How many points `to` describes.
    width: usize,
    length: f64,
    /// `[from][to]`
    states: &'a mut [u64],
}

impl HotLoop for Mark<'_> {
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let mut hidden = 0;
        for (&p, states) in self.from.iter().zip(self.states.chunks_exact_mut(self.width)) {
            hidden += self.blocker.mark(&self.blocker.distances(p), self.to, self.length, states);
        }
        hidden
    }
}

//! Deciding the pairs of a tile one by one: by its candidates, or the paper's way.

use super::blocker::{Blocker, HIDDEN, Profile};
use super::tile::{PairWork, Tile};
use crate::geometry::SurfaceId;
use crate::simd::{HotLoop, wide};
use crate::tracers::Segment;
use glam::DVec3;

/// Bit of a pair's state: a ray has answered it.
const ANSWERED: u64 = 4;

/// Segments are handed to the tracer in batches of about this many.
const BATCH: usize = 4096;

/// A tile with fewer pairs left than this is cast without asking for its blocker first.
const WORTH_A_PROBE: usize = 16;

impl PairWork<'_> {
    /// Makes `tile` the one at hand; nothing is known of its pairs.
    fn begin(&mut self, tile: Tile) {
        self.states.clear();
        self.states.resize(tile.pairs(), 0);
        self.tile = tile;
    }

    /// Tests every candidate of the tile, the last blocker first, and casts only the rays that
    /// pass one too close to call.
    pub fn test_candidates(&mut self, tile: Tile) {
        self.begin(tile);
        let candidates = self.tile.candidates.clone();
        if let Some(k) = candidates.clone().find(|&k| Some(self.open[k]) == self.last_blocker) {
            self.open.swap(candidates.start, k);
        }
        let mut left = self.states.len() as u64;
        for k in candidates {
            let c = self.open[k];
            let hidden = self.mark(c);
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
        let tile = self.tile.candidates.clone();
        let round = self.open[tile].iter().any(|&c| self.build.blockers[c as usize].round().is_some());
        for k in 0..self.states.len() {
            match self.states[k] {
                // Past the polygons, but a disc or a sphere may be in the way.
                0 if round => self.push(k),
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
    pub fn trace(&mut self, own: [SurfaceId; 2], tile: Tile) {
        self.begin(tile);
        if let Some(c) = self.last_blocker.filter(|&c| !own.contains(&SurfaceId(c))) {
            self.result.stats.last_blocker += self.mark(c);
        }
        let left = self.states.iter().filter(|&&s| s & HIDDEN == 0).count();
        if left >= WORTH_A_PROBE {
            self.probe(left / 2, own);
        }
        for k in 0..self.states.len() {
            if self.states[k] & (HIDDEN | ANSWERED) == 0 {
                self.push(k);
            }
        }
    }

    /// Casts the `nth` undecided pair of the tile alone, to learn what blocks it.
    fn probe(&mut self, nth: usize, own: [SurfaceId; 2]) {
        let mut undecided = (0..self.states.len()).filter(|&k| self.states[k] & HIDDEN == 0);
        let Some(k) = undecided.nth(nth) else { return };
        self.result.stats.rays_cast += 1;
        self.states[k] |= ANSWERED;
        match self.build.tracer.blocker(&self.segment(k)) {
            None => self.see(k),
            Some(surface) => {
                self.states[k] |= HIDDEN;
                if Some(surface.0) != self.last_blocker && !own.contains(&surface) {
                    self.last_blocker = Some(surface.0);
                    self.result.stats.last_blocker += self.mark(surface.0);
                }
            }
        }
    }

    /// Tests all pairs of the tile against surface `c`; returns how many it is the first to hide.
    fn mark(&mut self, c: u32) -> u64 {
        let polygon = self.build.blockers.get(c as usize).filter(|blocker| blocker.round().is_none());
        let Some(blocker) = polygon else { return 0 };
        let Tile { rows, columns, length, .. } = self.tile.clone();
        let width = columns.len();
        blocker.profile(&self.to.position[columns], &mut self.profile);
        let from = &self.from.position[rows];
        wide(Mark { blocker, from, to: &self.profile, width, length, states: &mut self.states })
    }

    /// The points of pair `k` of the tile.
    fn pair(&self, k: usize) -> (usize, usize) {
        let Tile { rows, columns, .. } = &self.tile;
        let (row, column) = (rows.start + k / columns.len(), columns.start + k % columns.len());
        (self.from.index[row], self.to.index[column])
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

    /// Leaves pair `k` of the tile to the tracer.
    fn push(&mut self, k: usize) {
        let (i, j) = self.pair(k);
        self.push_points(i, j);
    }

    /// Leaves points `i` and `j` to the tracer.
    pub fn push_points(&mut self, i: usize, j: usize) {
        let position = &self.build.points.position;
        self.segments.push(Segment { from: position[i], to: position[j] });
        self.targets.push([i as u32, j as u32]);
        if self.segments.len() >= BATCH {
            self.cast();
        }
    }

    /// Casts what has been left to the tracer.
    pub fn cast(&mut self) {
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

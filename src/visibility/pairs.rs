//! The pairs of a tile, or of a block of two voxels, that no proof decides as a whole: tested against their
//! candidates, or the paper's way.

use super::against::span;
use super::block::{Bits, Hidden, SIDE, WORDS, count};
use super::blocker::Blocker;
use super::build::Build;
use super::patch::Patch;
use super::tile::{Flank, Tile};
use super::voxel_pair::{PairWork, pays};
use crate::geometry::{Aabb, SurfaceId};
use crate::tracers::Segment;
use crate::tracers::brute_force::{intersect_surface, segment_ray};
use std::ops::Range;

/// Segments are handed to the tracer in batches of about this many.
const BATCH: usize = 4096;

/// A tile with fewer pairs left than this is cast without asking for its blocker first.
const WORTH_A_PROBE: usize = 16;

/// Segments lower over their ends' surfaces than this, as a fraction of their length, may meet these for a tracer: its
/// rounding, some 1e-7 of the radius, lifts them by as much within their margin of 3.8e-6.
const FLAT: f32 = 0.03;

/// All points of a side.
const ALL: Bits = [u32::MAX; WORDS];

impl Build<'_> {
    /// The patches with points in `side`, and which of its points these are.
    pub fn members(&self, side: &Range<usize>) -> Vec<(Bits, &Patch)> {
        let within = |of: &Patch| {
            let part = of.points.start.max(side.start)..of.points.end.min(side.end);
            span(part.start - side.start, part.end - side.start)
        };
        self.patches_between(side).iter().map(|patch| (within(patch), patch)).collect()
    }

    /// The points of a side that surface number `c` may hide anything from: it hides nothing from what it is not in
    /// front of.
    pub fn reach(&self, blocker: &Blocker, c: u32, side: &[(Bits, &Patch)]) -> Bits {
        let before = |patch: &Patch| c != patch.surface.0 && self.has_before(blocker, patch);
        side.iter()
            .filter(|(_, patch)| before(patch))
            .fold([0; WORDS], |bits, (members, _)| std::array::from_fn(|w| bits[w] | members[w]))
    }

    fn segment(&self, i: usize, j: usize) -> Segment {
        let position = &self.points.position;
        Segment { from: position[i], to: position[j] }
    }

    /// Whether one of `surfaces` hides facing points `i` and `j` from each other, in `f64`: the answer that tests and
    /// tracers come to wherever it is not too close to call.
    pub fn hides(&self, surfaces: &[u32], i: usize, j: usize) -> bool {
        let ray = segment_ray(&self.segment(i, j));
        let own = [self.points.surface[i], self.points.surface[j]];
        let ends = [i, j].map(|i| self.points.position[i].as_dvec3());
        surfaces.iter().any(|&c| {
            let (surface, blocker) = (&self.surfaces[c as usize], &self.blockers[c as usize]);
            let harmless = surface.is_planar() && own.contains(&SurfaceId(c));
            let ([(normal, offset), ..], slack) = (blocker.planes(), blocker.bands().slack);
            let [a, b] = ends.map(|p| normal.dot(p) - offset);
            let aside = blocker.round().is_none() && (a.min(b) > slack || a.max(b) < -slack);
            !harmless && !aside && intersect_surface(&ray, surface).is_some()
        })
    }
}

impl PairWork<'_> {
    /// Makes the pairs of `rows` and `columns` those of the block; none is open. `columns` begin with a word.
    fn begin(&mut self, rows: Range<usize>, columns: Range<usize>) {
        self.block.begin(&rows, &columns, &self.build.points.position);
        self.place = [rows.start, columns.start];
    }

    /// Makes the pairs of `tile` the open ones of the block. Returns which points its rows and columns are.
    fn begin_tile(&mut self, tile: &Tile) -> [Range<usize>; 2] {
        let ends = |of: &Flank, part: &Range<usize>| {
            let index = &of.index[part.clone()];
            index.first().copied().unwrap_or(0)..index.last().map_or(0, |last| last + 1)
        };
        let (rows, mut columns) = (ends(&self.from, &tile.rows), ends(&self.to, &tile.columns));
        let first = columns.start - self.columns.start;
        columns.start -= first % 32;
        self.begin(rows.clone(), columns.clone());
        let [row, column] = self.place;
        let mut members = [0; WORDS];
        for &j in &self.to.index[tile.columns.clone()] {
            members[(j - column) / 32] |= 1 << ((j - column) % 32);
        }
        for &i in &self.from.index[tile.rows.clone()] {
            self.block.open[i - row] = members;
        }
        [rows, columns]
    }

    /// Tests every candidate of the tile, the last blocker first.
    pub fn test_tile(&mut self, tile: Tile) {
        let [first, second] = self.begin_tile(&tile).map(|side| self.build.members(&side));
        self.test_open(tile.candidates, tile.length, &first, &second);
    }

    /// Decides the pairs of a block of two voxels: by testing their `candidates` where they are few, else by rays. No
    /// segment is longer than `length`.
    pub fn decide_block(
        &mut self,
        rows: Range<usize>,
        columns: Range<usize>,
        candidates: Range<usize>,
        length: f64,
    ) {
        let (first, second) = (self.build.members(&rows), self.build.members(&columns));
        self.open_facing(rows, columns, &first, &second);
        let open = self.block.count_open();
        if pays(candidates.len(), self.block.points(), open) {
            self.test_open(candidates, length, &first, &second);
        } else {
            self.push_open();
        }
    }

    /// Decides the open pairs of the block one by one.
    pub fn settle_open(&mut self, candidates: Range<usize>) {
        let [row, column] = self.place;
        for r in 0..self.block.rows.count {
            for c in set(&self.block.open[r]) {
                self.settle(candidates.clone(), row + r, column + c);
            }
        }
    }

    /// Decides whether points `i` and `j` see each other past the `candidates`.
    fn settle(&mut self, candidates: Range<usize>, i: usize, j: usize) {
        self.result.stats.direct += 1;
        if !self.build.hides(&self.open[candidates], i, j) {
            self.see_points(i, j);
        }
    }

    /// Makes the pairs of `rows` and `columns` that face each other the open ones of the block, given the patches on
    /// either side and their points, and counts the others.
    pub fn open_facing(
        &mut self,
        rows: Range<usize>,
        columns: Range<usize>,
        first: &[(Bits, &Patch)],
        second: &[(Bits, &Patch)],
    ) {
        let build = self.build;
        self.begin(rows.clone(), columns.clone());
        let under = |side: &Range<usize>| {
            let mut bits = [0; WORDS];
            for (k, i) in side.clone().enumerate() {
                bits[k / 32] |= u32::from(build.under[i]) << (k % 32);
            }
            bits
        };
        let (hidden_rows, hidden_columns) = (under(&rows), under(&columns));
        let apart = build.bands.apart;
        let diagonal = rows == columns;
        let (mut facing, mut same_surface) = (0, 0);
        // A patch is planar: whether its points face another patch's is a matter of its plane.
        for (members, b) in second {
            let front = self.block.rows.above(b.plane.normal, b.plane.offset, apart);
            for i in set(&front) {
                self.block.open[i].iter_mut().zip(members).for_each(|(open, members)| *open |= members);
            }
        }
        for (members, a) in first {
            let front = self.block.columns.above(a.plane.normal, a.plane.offset, apart);
            let mut own = [0; WORDS];
            for (of_b, _) in second.iter().filter(|(_, b)| b.surface == a.surface) {
                own = std::array::from_fn(|w| own[w] | of_b[w]);
            }
            let front: Bits = std::array::from_fn(|w| front[w] & !own[w]);
            for i in set(members) {
                let later = if diagonal { span(i + 1, SIDE) } else { ALL };
                let open = std::array::from_fn(|w| self.block.open[i][w] & front[w] & later[w]);
                facing += count(&open);
                same_surface += count(&std::array::from_fn(|w| own[w] & later[w]));
                let buried = hidden_rows[i / 32] >> (i % 32) & 1 == 1;
                self.block.open[i] =
                    std::array::from_fn(|w| if buried { 0 } else { open[w] & !hidden_columns[w] });
            }
        }
        let all =
            if diagonal { rows.len() * (rows.len() - 1) / 2 } else { rows.len() * columns.len() } as u64;
        let open = self.block.count_open();
        let stats = &mut self.result.stats;
        stats.pairs += all;
        stats.same_surface += same_surface;
        stats.not_facing += all - same_surface - facing;
        stats.proved += facing - open;
        self.result.facing += facing;
    }

    /// Leaves the open pairs of the block to the tracer.
    pub fn push_open(&mut self) {
        let [row, column] = self.place;
        for r in 0..self.block.rows.count {
            for c in set(&self.block.open[r]) {
                self.push(row + r, column + c);
            }
        }
    }

    /// Tests the `candidates` on the open pairs of the block, the last blocker first, given the patches on either side
    /// and their points.
    pub fn test_open(
        &mut self,
        candidates: Range<usize>,
        length: f64,
        first: &[(Bits, &Patch)],
        second: &[(Bits, &Patch)],
    ) {
        let build = self.build;
        if let Some(k) = candidates.clone().find(|&k| Some(self.open[k]) == self.last_blocker) {
            self.open.swap(candidates.start, k);
        }
        let is_round = |c: u32| build.blockers[c as usize].round().is_some();
        let round = self.open[candidates.clone()].iter().any(|&c| is_round(c));
        let mut left = self.block.count_open();
        let (rows, columns) = self.block.open_sides();
        for k in candidates.clone() {
            let c = self.open[k];
            if is_round(c) {
                continue;
            }
            let blocker = &build.blockers[c as usize];
            let reach = |side: usize| build.reach(blocker, c, [first, second][side]);
            let Hidden { proved, tested } =
                self.block.test_known((blocker, c), length, [&rows, &columns], reach);
            self.result.stats.proved += proved;
            if Some(c) == self.last_blocker {
                self.result.stats.last_blocker += tested;
            } else {
                self.result.stats.direct += tested;
            }
            if proved + tested > 0 {
                self.last_blocker = Some(c);
            }
            left -= proved + tested;
            if left == 0 {
                return;
            }
        }
        let [row, column] = self.place;
        for r in 0..self.block.rows.count {
            let (open, unsure, tested) = (self.block.open[r], self.block.unsure[r], self.block.tested[r]);
            // Too close to call for all at once.
            for c in set(&std::array::from_fn(|w| open[w] & unsure[w])) {
                self.settle(candidates.clone(), row + r, column + c);
            }
            let past: Bits = std::array::from_fn(|w| open[w] & !unsure[w]);
            if round {
                // Past the polygons, but a disc or a sphere may be in the way.
                set(&past).for_each(|c| self.push(row + r, column + c));
                continue;
            }
            let direct = (0..WORDS).map(|w| u64::from((past[w] & tested[w]).count_ones())).sum::<u64>();
            self.result.stats.direct += direct;
            self.result.stats.proved += count(&past) - direct;
            self.see_words(row + r, column, &past);
        }
    }

    /// The paper's way: the last blocker, then the tracer. Where many pairs are left, one ray asks
    /// for a new last blocker first.
    pub fn trace(&mut self, own: [SurfaceId; 2], tile: Tile) {
        self.begin_tile(&tile);
        if let Some(c) = self.last_blocker.filter(|&c| !own.contains(&SurfaceId(c))) {
            self.mark(c, tile.length);
        }
        let left = self.block.count_open() as usize;
        if left >= WORTH_A_PROBE {
            self.probe(left / 2, own, tile.length);
        }
        self.push_open();
    }

    /// Casts the `nth` open pair of the block alone, to learn what blocks it.
    fn probe(&mut self, nth: usize, own: [SurfaceId; 2], length: f64) {
        let open = &self.block.open[..self.block.rows.count];
        let mut undecided = open.iter().enumerate().flat_map(|(r, bits)| set(bits).map(move |c| (r, c)));
        let Some((r, c)) = undecided.nth(nth) else { return };
        self.result.stats.rays_cast += 1;
        self.block.open[r][c / 32] &= !(1 << (c % 32));
        let (i, j) = (self.place[0] + r, self.place[1] + c);
        match self.build.tracer.blocker(&self.segment(i, j)) {
            None => self.see_points(i, j),
            Some(surface) => {
                if Some(surface.0) != self.last_blocker && !own.contains(&surface) {
                    self.last_blocker = Some(surface.0);
                    self.mark(surface.0, length);
                }
            }
        }
    }

    /// Closes the open pairs that surface `c` certainly hides.
    fn mark(&mut self, c: u32, length: f64) {
        let polygon = self.build.blockers.get(c as usize).filter(|blocker| blocker.round().is_none());
        let Some(blocker) = polygon else { return };
        let hidden = self.block.test(blocker, length);
        self.result.stats.last_blocker += hidden.proved + hidden.tested;
    }

    fn segment(&self, i: usize, j: usize) -> Segment {
        self.build.segment(i, j)
    }

    /// Whether nothing but the planar surface that one of two facing points lies on hides them from each other for the
    /// tracer, which rounding may make it do beyond the margin where the segment is flat on that surface.
    fn is_flat_on_its_own(&self, i: usize, j: usize) -> bool {
        let points = self.build.points;
        let along = points.position[j] - points.position[i];
        let height = points.normal[i].dot(along).min(-points.normal[j].dot(along));
        if height > FLAT * along.length() {
            return false;
        }
        match self.build.tracer.blocker(&self.segment(i, j)) {
            None => true,
            Some(c) if c != points.surface[i] && c != points.surface[j] => false,
            Some(_) => {
                let at = |i: usize| Aabb::around([points.position[i].as_dvec3()]);
                let mut near = Vec::new();
                self.build.tree.candidates(&self.build.blockers, &at(i), &at(j), &mut near);
                !self.build.hides(&near, i, j)
            }
        }
    }

    /// Leaves points `i` and `j` to the tracer.
    pub fn push(&mut self, i: usize, j: usize) {
        self.segments.push(self.segment(i, j));
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
            let [i, j] = self.targets[k].map(|p| p as usize);
            if !self.blocked[k] || self.is_flat_on_its_own(i, j) {
                self.see_points(i, j);
            }
        }
        self.segments.clear();
        self.targets.clear();
    }
}

/// The numbers of the bits that are set.
pub(super) fn set(bits: &Bits) -> impl Iterator<Item = usize> + use<> {
    let bits = *bits;
    bits.into_iter().enumerate().flat_map(|(w, mut left)| {
        std::iter::from_fn(move || {
            let bit = (left != 0).then(|| left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some(32 * w + bit)
        })
    })
}

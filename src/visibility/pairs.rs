//! The pairs of a tile, or of a block of two voxels, that no proof decides as a whole: tested against their
//! candidates, or the paper's way.

use super::block::{Bits, Hidden, SIDE, WORDS, count, span};
use super::patch::Patch;
use super::tile::{Flank, PairWork, Tile, pays};
use crate::geometry::SurfaceId;
use crate::tracers::Segment;
use std::ops::Range;

/// Segments are handed to the tracer in batches of about this many.
const BATCH: usize = 4096;

/// A tile with fewer pairs left than this is cast without asking for its blocker first.
const WORTH_A_PROBE: usize = 16;

/// All points of a side.
const ALL: Bits = [u32::MAX; WORDS];

impl PairWork<'_> {
    /// Makes the pairs of `rows` and `columns` those of the block; none is open. `columns` begin with a word.
    fn begin(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let places = |of: &Range<usize>| {
            let position = &self.build.points.position;
            of.clone().map(move |i| position[i].as_dvec3())
        };
        self.block.rows.set(places(&rows));
        self.block.columns.set(places(&columns));
        self.block.clear();
        self.place = [rows.start, columns.start];
    }

    /// Makes the pairs of `tile` the open ones of the block.
    fn begin_tile(&mut self, tile: &Tile) {
        let ends = |of: &Flank, part: &Range<usize>| {
            let index = &of.index[part.clone()];
            index.first().copied().unwrap_or(0)..index.last().map_or(0, |last| last + 1)
        };
        let (rows, mut columns) = (ends(&self.from, &tile.rows), ends(&self.to, &tile.columns));
        let first = columns.start - self.columns.start;
        columns.start -= first % 32;
        self.begin(rows, columns);
        let [row, column] = self.place;
        let mut members = [0; WORDS];
        for &j in &self.to.index[tile.columns.clone()] {
            members[(j - column) / 32] |= 1 << ((j - column) % 32);
        }
        for &i in &self.from.index[tile.rows.clone()] {
            self.block.open[i - row] = members;
        }
    }

    /// Tests every candidate of the tile, the last blocker first, and casts only the rays that
    /// pass one too close to call.
    pub fn test_tile(&mut self, tile: Tile) {
        self.begin_tile(&tile);
        let all = tile.pairs() as u64;
        self.test_candidates(tile.candidates, tile.length, all, |_| Some((ALL, ALL)));
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
        let build = self.build;
        let members = |side: &Range<usize>| -> Vec<(Bits, &Patch)> {
            let within = |of: &Patch| {
                let part = of.points.start.max(side.start)..of.points.end.min(side.end);
                span(part.start - side.start, part.end - side.start)
            };
            build.patches_between(side).iter().map(|patch| (within(patch), patch)).collect()
        };
        let (first, second) = (members(&rows), members(&columns));
        let points = rows.len() + columns.len();
        let open = self.open_facing(rows, columns, &first, &second);
        if open == 0 {
            return;
        }
        if !pays(candidates.len(), points, open) {
            return self.push_open();
        }
        // A surface cannot hide what is in front of it, nor block from behind what faces away.
        let reached = |c: u32, patches: &[(Bits, &Patch)]| {
            let mut bits = [0; WORDS];
            for (members, _) in patches.iter().filter(|(_, patch)| build.is_in_front(c, patch)) {
                bits = std::array::from_fn(|w| bits[w] | members[w]);
            }
            (bits != [0; WORDS]).then_some(bits)
        };
        self.test_candidates(candidates, length, open, |c| Some((reached(c, &first)?, reached(c, &second)?)));
    }

    /// Makes the pairs of `rows` and `columns` that face each other the open ones of the block, given the patches on
    /// either side and their points, and counts the others. Returns how many are open.
    fn open_facing(
        &mut self,
        rows: Range<usize>,
        columns: Range<usize>,
        first: &[(Bits, &Patch)],
        second: &[(Bits, &Patch)],
    ) -> u64 {
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
        open
    }

    /// Leaves the open pairs of the block to the tracer.
    fn push_open(&mut self) {
        let [row, column] = self.place;
        for r in 0..self.block.rows.count {
            for c in set(&self.block.open[r]) {
                self.push(row + r, column + c);
            }
        }
    }

    /// Tests the `candidates` on the open pairs of the block, the last blocker first; `reach` gives the rows and columns
    /// that each may block between.
    fn test_candidates(
        &mut self,
        candidates: Range<usize>,
        length: f64,
        open: u64,
        reach: impl Fn(u32) -> Option<(Bits, Bits)>,
    ) {
        if let Some(k) = candidates.clone().find(|&k| Some(self.open[k]) == self.last_blocker) {
            self.open.swap(candidates.start, k);
        }
        let is_round = |c: u32| self.build.blockers[c as usize].round().is_some();
        let round = self.open[candidates.clone()].iter().any(|&c| is_round(c));
        let mut left = open;
        for k in candidates {
            let c = self.open[k];
            if is_round(c) {
                continue;
            }
            let Some((rows, columns)) = reach(c) else { continue };
            let Hidden { proved, tested } =
                self.block.test(&self.build.blockers[c as usize], length, &rows, &columns);
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
            // Past the polygons, but a disc or a sphere may be in the way.
            let (open, unsure) = (self.block.open[r], if round { ALL } else { self.block.unsure[r] });
            let tested = self.block.tested[r];
            let seen: Bits = std::array::from_fn(|w| open[w] & !unsure[w]);
            let direct = (0..WORDS).map(|w| u64::from((seen[w] & tested[w]).count_ones())).sum::<u64>();
            self.result.stats.direct += direct;
            self.result.stats.proved += count(&seen) - direct;
            self.see_words(row + r, column, &seen);
            for c in set(&std::array::from_fn(|w| open[w] & unsure[w])) {
                self.push(row + r, column + c);
            }
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
        let hidden = self.block.test(blocker, length, &ALL, &ALL);
        self.result.stats.last_blocker += hidden.proved + hidden.tested;
    }

    fn segment(&self, i: usize, j: usize) -> Segment {
        let position = &self.build.points.position;
        Segment { from: position[i], to: position[j] }
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
            if !self.blocked[k] {
                let [i, j] = self.targets[k];
                self.see_points(i as usize, j as usize);
            }
        }
        self.segments.clear();
        self.targets.clear();
    }
}

/// The numbers of the bits that are set.
fn set(bits: &Bits) -> impl Iterator<Item = usize> + use<> {
    let bits = *bits;
    bits.into_iter().enumerate().flat_map(|(w, mut left)| {
        std::iter::from_fn(move || {
            let bit = (left != 0).then(|| left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some(32 * w + bit)
        })
    })
}

//! Deciding pairs patch by patch: on curved surfaces, and where only rays are asked for.
//!
//! A tile is the pairs of some points of one patch with some of another. It begins as the facing pairs of two whole
//! patches and is cut in four, along the quadtrees of the surfaces, as long as proofs may still decide a part of it; what is
//! left is decided pair by pair.

use super::blocker::Verdict;
use super::build::{Build, GraphSettings};
use super::cull::misses_shaft;
use super::patch::Patch;
use super::voxel_pair::{PairWork, pays};
use crate::geometry::Aabb;
use glam::DVec3;
use std::ops::Range;

/// Where candidates are tested one by one, tiles of no more pairs are not cut further: proofs would
/// cost more than the tests they save.
const SMALL_FOR_TESTS: usize = 256;

/// Where rays are cast, tiles of no more pairs are not cut further.
const SMALL_FOR_RAYS: usize = 16;

/// One side of a tile: the points of a patch that are in front of the other's plane.
#[derive(Debug, Default)]
pub(super) struct Flank {
    /// Their numbers.
    pub index: Vec<usize>,
    /// Their places.
    pub position: Vec<DVec3>,
}

/// A tile of the pairs of two flanks.
#[derive(Clone, Debug, Default)]
pub(super) struct Tile {
    /// A range of the first flank.
    pub rows: Range<usize>,
    /// A range of the second.
    pub columns: Range<usize>,
    /// The surfaces that may block in it: a range of [`PairWork::open`].
    pub candidates: Range<usize>,
    /// No segment is longer, m.
    pub length: f64,
}

impl Tile {
    /// The number of its pairs.
    pub fn pairs(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// The tile cut in two both ways; what is one point wide stays whole.
    fn quarters(&self) -> impl Iterator<Item = Tile> {
        let halves = |of: &Range<usize>| {
            let middle = of.start + of.len().div_ceil(2);
            [of.start..middle, middle..of.end]
        };
        let [left, right] = halves(&self.columns);
        halves(&self.rows)
            .into_iter()
            .flat_map(move |rows| [(rows.clone(), left.clone()), (rows, right.clone())])
            .map(|(rows, columns)| Tile { rows, columns, ..self.clone() })
            .filter(|tile| tile.pairs() > 0)
    }
}

impl PairWork<'_> {
    /// Decides the pairs of some points of either voxel, patch by patch.
    pub fn patch_by_patch(&mut self, rows: &Range<usize>, columns: &Range<usize>, candidates: Range<usize>) {
        let build = self.build;
        for from in build.patches_between(rows) {
            for to in build.patches_between(columns) {
                let (from, to) = (from.within(rows), to.within(columns));
                if from.points.start <= to.points.start {
                    self.patches(&from, &to, candidates.clone());
                }
            }
        }
    }

    /// Decides the pairs of two patches.
    fn patches(&mut self, a: &Patch, b: &Patch, candidates: Range<usize>) {
        let all = if a.points == b.points {
            a.points.len() * (a.points.len() - 1) / 2
        } else {
            a.points.len() * b.points.len()
        } as u64;
        self.result.stats.pairs += all;
        if a.curved || b.curved {
            return self.curved_patches(a, b);
        }
        if a.surface == b.surface {
            self.result.stats.same_surface += all;
            return;
        }
        // A patch is planar: whether its points face another patch's is a matter of its plane.
        let facing = self.build.in_front(&mut self.from, a, b) * self.build.in_front(&mut self.to, b, a);
        let (rows, columns) = (0..self.from.index.len(), 0..self.to.index.len());
        let open = (rows.len() * columns.len()) as u64;
        self.result.stats.not_facing += all - facing;
        self.result.stats.proved += facing - open;
        self.result.facing += facing;
        if open == 0 {
            return;
        }
        let between = self.open.len();
        for k in candidates {
            let c = self.open[k];
            if self.build.is_in_front(c, a) && self.build.is_in_front(c, b) {
                self.open.push(c);
            }
        }
        let candidates = between..self.open.len();
        self.decide_tile(a, b, Tile { rows, columns, candidates, length: 0.0 });
        self.open.truncate(between);
    }

    /// Decides a tile by proof, in quarters, or pair by pair.
    fn decide_tile(&mut self, a: &Patch, b: &Patch, mut tile: Tile) {
        let hull_a = a.rectangle(&self.from.position[tile.rows.clone()]);
        let hull_b = b.rectangle(&self.to.position[tile.columns.clone()]);
        let hull = Aabb::around(hull_a.iter().chain(&hull_b).copied());
        tile.length = hull.size().length();
        let GraphSettings { proofs, tests } = *self.build.settings;
        let surfaces = [a.surface, b.surface];
        if !proofs {
            return self.trace(surfaces, tile);
        }
        let first = self.open.len();
        if !self.prove(&tile, [&hull_a, &hull_b], &hull) {
            tile.candidates = first..self.open.len();
            let points = tile.rows.len() + tile.columns.len();
            let few = tests && pays(tile.candidates.len(), points, tile.pairs() as u64);
            if tile.pairs() > if few { SMALL_FOR_TESTS } else { SMALL_FOR_RAYS } {
                tile.quarters().for_each(|quarter| self.decide_tile(a, b, quarter));
            } else if few {
                self.test_tile(tile);
            } else {
                self.trace(surfaces, tile);
            }
        }
        self.open.truncate(first);
    }

    /// Leaves on `open` what may block in `tile`. Nothing, or one surface that covers all, decides it.
    fn prove(&mut self, tile: &Tile, [hull_a, hull_b]: [&[DVec3; 4]; 2], hull: &Aabb) -> bool {
        let build = self.build;
        let first = self.open.len();
        for k in tile.candidates.clone() {
            let c = self.open[k];
            let blocker = &build.blockers[c as usize];
            match blocker.judge(hull_a, hull_b, tile.length) {
                Verdict::Clear => {}
                Verdict::Covers => {
                    self.result.stats.proved += tile.pairs() as u64;
                    self.last_blocker = Some(c);
                    return true;
                }
                Verdict::Open if misses_shaft(blocker, hull_a, hull_b, hull) => {}
                Verdict::Open => self.open.push(c),
            }
        }
        let visible = self.open.len() == first;
        if visible {
            self.result.stats.proved += tile.pairs() as u64;
            for i in tile.rows.clone() {
                for j in tile.columns.clone() {
                    self.see_points(self.from.index[i], self.to.index[j]);
                }
            }
        }
        visible
    }
}

impl Build<'_> {
    /// The points of patch `of` that lie in front of the plane of `other`, but for those that something lies
    /// flat upon. Returns how many there are with those.
    fn in_front(&self, flank: &mut Flank, of: &Patch, other: &Patch) -> u64 {
        let mut facing = 0;
        flank.index.clear();
        flank.position.clear();
        for i in of.points.clone() {
            let p = self.points.position[i].as_dvec3();
            if other.plane.height(p) > self.bands.apart {
                facing += 1;
                if !self.under[i] {
                    flank.index.push(i);
                    flank.position.push(p);
                }
            }
        }
        facing
    }
}

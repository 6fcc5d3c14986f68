//! Deciding the pairs of two voxels.
//!
//! A block of up to 128 x 128 pairs of the voxels' points, whatever they lie on, is tested at once against the surfaces
//! that can block, where these are few, and left to the tracer where they are many. On curved surfaces, and where only
//! rays are asked for, patch meets patch, tile by tile ([`super::tile`]).

use super::block::{Bits, Block, SIDE, WORDS, count};
use super::blocker::Blocker;
use super::build::Build;
use super::cull::BoxShaft;
use super::graph::{Edge, stride_of};
use super::patch::Patch;
use super::stats::GraphStats;
use super::tile::Flank;
use super::transpose::transpose;
use crate::geometry::{Aabb, SurfaceId};
use crate::tracers::Segment;
use glam::DVec3;
use std::ops::Range;

/// In the time that a ray takes, this many points are held against a candidate (measured: 5 to 15 do alike).
const POINTS_FOR_A_RAY: u64 = 15;

/// What is known of two voxels when all their pairs are decided.
#[derive(Debug, Default)]
pub(super) struct VoxelPair {
    /// The bits, rows from the first voxel: a facing pair's is set when nothing blocks it. Empty when none is.
    pub words: Vec<u32>,
    /// Whether memory was too short for the bits.
    pub out_of_memory: bool,
    /// Facing pairs.
    pub facing: u64,
    /// Facing pairs that see each other.
    pub seen: u64,
    /// How they were decided.
    pub stats: GraphStats,
    /// The edge, if it was copied with its bits from another graph, and whether rays had been cast for it there. How many
    /// facing pairs there are was not asked.
    pub copied: Option<(Edge, bool)>,
}

/// Decides the pairs of two voxels.
pub(super) struct PairWork<'a> {
    /// What all threads share.
    pub build: &'a Build<'a>,
    /// Points of the first voxel.
    pub rows: Range<usize>,
    /// Points of the second voxel.
    pub columns: Range<usize>,
    /// What is known so far.
    pub result: VoxelPair,
    /// A stack: surfaces that may block between the two voxels, of these the ones that may between
    /// two patches, of these the ones that may in a tile, in a quarter of it, and so on.
    pub open: Vec<u32>,
    /// The paper's buf-int.
    pub last_blocker: Option<u32>,
    /// Points of the patch at hand of the first voxel,
    pub from: Flank,
    /// and of the second.
    pub to: Flank,
    /// The pairs that are decided one by one, or many at once,
    pub block: &'a mut Block,
    /// and the points of its first row and column.
    pub place: [usize; 2],
    /// Left to the tracer,
    pub segments: Vec<Segment>,
    /// with the points they join,
    pub targets: Vec<[u32; 2]>,
    /// and its answers.
    pub blocked: Vec<bool>,
}

impl<'a> PairWork<'a> {
    /// Nothing is known yet of the points of voxels `a <= b`.
    pub fn new(build: &'a Build<'a>, block: &'a mut Block, a: usize, b: usize) -> Self {
        PairWork {
            build,
            rows: build.points.voxel(a),
            columns: build.points.voxel(b),
            result: VoxelPair::default(),
            open: Vec::new(),
            last_blocker: None,
            from: Flank::default(),
            to: Flank::default(),
            block,
            place: [0; 2],
            segments: Vec::new(),
            targets: Vec::new(),
            blocked: Vec::new(),
        }
    }

    /// Decides all pairs of the points of voxels `a <= b`.
    pub fn decide(build: &'a Build<'a>, block: &'a mut Block, a: usize, b: usize) -> VoxelPair {
        let mut work = PairWork::new(build, block, a, b);
        if work.rows.is_empty() || work.columns.is_empty() {
            return work.result;
        }
        if build.nothing_faces(&work.rows, &work.columns) {
            work.pass_over();
            return work.result;
        }
        if build.settings.proofs {
            build.tree.candidates(&build.blockers, &build.boxes[a], &build.boxes[b], &mut work.open);
        }
        let (rows, columns) = (work.rows.clone(), work.columns.clone());
        if build.settings.proofs && build.settings.tests {
            for first in blocks(&rows) {
                for second in blocks(&columns).filter(|second| a != b || second.start >= first.start) {
                    work.block(first.clone(), second);
                }
            }
        } else {
            work.patch_by_patch(&rows, &columns, 0..work.open.len());
        }
        work.cast();
        if a == b {
            work.mirror();
        }
        work.result
    }

    /// Counts the pairs of two voxels that do not face each other.
    pub fn pass_over(&mut self) {
        let on = |points: &Range<usize>| {
            let mut counts: Vec<(SurfaceId, u64)> = Vec::new();
            for patch in self.build.patches_between(points) {
                match counts.last_mut() {
                    Some((surface, count)) if *surface == patch.surface => {
                        *count += patch.points.len() as u64
                    }
                    _ => counts.push((patch.surface, patch.points.len() as u64)),
                }
            }
            counts
        };
        let (first, second) = (on(&self.rows), on(&self.columns));
        let diagonal = self.rows == self.columns;
        let pairs = |a: u64, b: u64| if diagonal { a * (a - 1) / 2 } else { a * b };
        // Points stand in the order of their surfaces.
        let its =
            |surface: SurfaceId| second.binary_search_by_key(&surface, |s| s.0).map_or(0, |k| second[k].1);
        let same: u64 = first.iter().map(|&(s, n)| if its(s) > 0 { pairs(n, its(s)) } else { 0 }).sum();
        let all = pairs(self.rows.len() as u64, self.columns.len() as u64);
        self.result.stats.pairs += all;
        self.result.stats.same_surface += same;
        self.result.stats.not_facing += all - same;
    }

    /// Decides the pairs of some points of either voxel.
    pub fn block(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let build = self.build;
        let all = self.open.len();
        let (a, b) = (build.around(&rows), build.around(&columns));
        let flat = build.is_flat(&rows) && build.is_flat(&columns);
        let candidates = self.open_candidates(&rows, &columns, [&a, &b], flat);
        if flat {
            self.decide_block(rows, columns, candidates, a.union(b).size().length());
        } else {
            self.patch_by_patch(&rows, &columns, candidates);
        }
        self.open.truncate(all);
    }

    /// Adds to the stack those of its surfaces that may block between some points of either voxel, given the boxes around
    /// them; where the pairs are `flat`, no more than pay. Returns where they are.
    pub fn open_candidates(
        &mut self,
        rows: &Range<usize>,
        columns: &Range<usize>,
        [a, b]: [&Aabb; 2],
        flat: bool,
    ) -> Range<usize> {
        let all = self.open.len();
        // Between all points of both voxels it is known already.
        if *rows == self.rows && *columns == self.columns {
            return 0..all;
        }
        let (points, pairs) = (rows.len() + columns.len(), (rows.len() * columns.len()) as u64);
        // More than this are too many to be tested, whichever they are.
        let most = if flat { POINTS_FOR_A_RAY * pairs / points as u64 } else { u64::MAX };
        self.open_between([a, b], most as usize);
        all..self.open.len()
    }

    /// Adds to the stack those of its surfaces that may block between two boxes, until there are more than `most`.
    pub fn open_between(&mut self, [a, b]: [&Aabb; 2], most: usize) {
        let build = self.build;
        let shaft = BoxShaft::new(a, b);
        let all = self.open.len();
        for k in 0..all {
            let c = self.open[k];
            let blocker = &build.blockers[c as usize];
            if blocker.may_separate(a, b) && !shaft.misses(blocker) {
                self.open.push(c);
                if self.open.len() - all > most {
                    break;
                }
            }
        }
    }

    /// Points `i < j` see each other.
    pub fn see_points(&mut self, i: usize, j: usize) {
        let first = j - (j - self.columns.start) % 32;
        let mut bits = [0; WORDS];
        bits[0] = 1 << (j - first);
        self.see_words(i, first, &bits);
    }

    /// Point `i` sees those of the second voxel, from `first` on, whose bits are set. `first` begins a word.
    pub fn see_words(&mut self, i: usize, first: usize, bits: &Bits) {
        let seen = count(bits);
        if seen == 0 {
            return;
        }
        let stride = stride_of(self.columns.len());
        // Voxels that see nothing of each other need no bits, however many points they hold.
        if self.result.seen == 0 {
            let size = self.rows.len() * stride;
            // Asked first, because an allocation that fails would end the process.
            self.result.out_of_memory = Vec::<u32>::new().try_reserve_exact(size).is_err();
            self.result.words = vec![0; if self.result.out_of_memory { 0 } else { size }];
        }
        self.result.seen += seen;
        if self.result.out_of_memory {
            return;
        }
        let word = (first - self.columns.start) / 32;
        let row = (i - self.rows.start) * stride;
        for (to, bits) in self.result.words[row + word..row + stride].iter_mut().zip(bits) {
            *to |= bits;
        }
    }

    /// Sight is mutual: what the rows of a voxel with itself say of their columns, the columns say of the rows.
    pub fn mirror(&mut self) {
        let mut turned = Vec::new();
        let n = if self.result.words.is_empty() { 0 } else { self.rows.len() };
        transpose(&self.result.words, n, n, &mut turned);
        self.result.words.iter_mut().zip(turned).for_each(|(word, other)| *word |= other);
    }
}

impl Build<'_> {
    /// The box around some points.
    pub fn around(&self, points: &Range<usize>) -> Aabb {
        Aabb::around(self.points.position[points.clone()].iter().map(|p| p.as_dvec3()))
    }

    /// Whether none of some points of one voxel lies on a curved surface.
    pub fn is_flat(&self, points: &Range<usize>) -> bool {
        !self.patches_between(points).iter().any(|patch| patch.curved)
    }

    /// Whether no point of one voxel among `rows` can face any of another among `columns`: all of one lie
    /// under every plane of the other. Half the band, so that rounding cannot deny what a single pair would show.
    pub fn nothing_faces(&self, rows: &Range<usize>, columns: &Range<usize>) -> bool {
        let blind = |of: &Range<usize>, to: &Range<usize>| {
            let bounds = self.around(to);
            let mut last = None;
            self.patches_between(of).iter().all(|patch| {
                let sheet = (patch.surface, patch.plane.normal);
                let known = last == Some(sheet);
                last = Some(sheet);
                let highest =
                    patch.plane.height(bounds.centre()) + 0.5 * patch.plane.normal.abs().dot(bounds.size());
                known || !patch.curved && highest <= 0.5 * self.bands.apart
            })
        };
        blind(rows, columns) || blind(columns, rows)
    }

    /// The patches with points in `range`, which lies in one voxel.
    pub fn patches_between(&self, range: &Range<usize>) -> &[Patch] {
        let first = self.patches.partition_point(|p| p.points.end <= range.start);
        let end = self.patches.partition_point(|p| p.points.start < range.end);
        &self.patches[first..end.max(first)]
    }

    /// Whether surface `c` has anything in front of patch `of`, so that it can hide something from it.
    pub fn is_in_front(&self, c: u32, of: &Patch) -> bool {
        c != of.surface.0 && self.has_before(&self.blockers[c as usize], of)
    }

    /// The same of any surface but the patch's own.
    pub fn has_before(&self, blocker: &Blocker, of: &Patch) -> bool {
        let in_front = |v: &DVec3| of.plane.height(*v) > self.bands.apart;
        blocker.round().is_some() || blocker.vertices().iter().any(in_front)
    }
}

/// Whether testing each of the `candidates` on all of the `points` of a block or tile costs less than casting a ray for
/// each of its open `pairs`.
pub(super) fn pays(candidates: usize, points: usize, pairs: u64) -> bool {
    (candidates * points) as u64 <= POINTS_FOR_A_RAY * pairs
}

/// A voxel's points cut into parts of the same number of words, none of more than [`SIDE`] points.
pub(super) fn blocks(points: &Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
    let parts = points.len().div_ceil(SIDE).max(1);
    let size = points.len().div_ceil(parts).next_multiple_of(32).max(32);
    let end = points.end;
    points.clone().step_by(size).map(move |first| first..(first + size).min(end))
}

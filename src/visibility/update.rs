//! The graph of a scene in which some surfaces moved, came or went: the "rapid incremental method" that the paper
//! leaves open.
//!
//! What two points see of each other changes only by surfaces that came or went between them. So the bits between two
//! voxels that no such surface can come between are copied. Elsewhere a pair of points that both stayed and saw each
//! other is tested against what came, and one that did not against what went; only the pairs that something gone
//! hid, and those with a new point, are decided anew. [`Block::test`] gives the same answer wherever it is asked, so the
//! graph has the bits of one that is built from nothing.

use super::block::{Against, Bits, Block, Places, SIDE, WORDS, count};
use super::blocker::Blocker;
use super::build::{Build, GraphSettings, check};
use super::cull::BoxShaft;
use super::graph::{Edge, VisibilityGraph, stride_of};
use super::kept::{Kept, Run};
use super::pairs::set;
use super::patch::Patch;
use super::tile::{PairWork, VoxelPair, blocks, pays};
use crate::error::Result;
use crate::geometry::Aabb;
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

/// Where fewer of the points than this stayed the graph is built from nothing: to look up the rest would not pay.
const LEAST_KEPT: f64 = 0.5;

/// So few pairs of a block are decided one by one.
const FEW: u64 = 64;

/// What an update shares between all threads.
struct Update<'a> {
    build: &'a Build<'a>,
    graph: &'a VisibilityGraph,
    kept: &'a Kept,
    /// All blocks' sides, in the order of their points,
    sides: Vec<Side>,
    /// and the first of each voxel; one more at the end.
    first_side: Vec<usize>,
    /// Surfaces that are no longer there,
    gone: Changed,
    /// and those that were not.
    come: Changed,
}

/// Points of a voxel that are one side of a block.
struct Side {
    points: Range<usize>,
    bounds: Aabb,
    /// Whether all its surfaces are planar.
    flat: bool,
    /// The points that stayed,
    stayed: Bits,
    /// and where their bits are.
    runs: Vec<Run>,
}

/// Surfaces that came or went.
struct Changed {
    blockers: Vec<Blocker>,
    /// One is no polygon.
    round: bool,
    /// The box around them.
    bounds: Aabb,
    /// How the points of each side lie against each of them.
    known: Vec<Against>,
}

impl Changed {
    /// `own` gives the surface of the present scene that each is, if it is one.
    fn new(
        build: &Build,
        sides: &[Side],
        blockers: Vec<Blocker>,
        own: impl Fn(usize) -> Option<u32> + Sync,
    ) -> Self {
        let against = |side: &Side| {
            let mut places = Places::NONE;
            places.set(side.points.clone().map(|i| build.points.position[i].as_dvec3()));
            let members = build.members(&side.points);
            let mut found = Vec::with_capacity(blockers.len());
            for (k, blocker) in blockers.iter().enumerate() {
                let mut usable = [0; WORDS];
                for (bits, patch) in &members {
                    if own(k) != Some(patch.surface.0) && build.has_before(blocker, patch) {
                        usable = std::array::from_fn(|w| usable[w] | bits[w]);
                    }
                }
                found.push(Against::new(&places, &usable, blocker));
            }
            found
        };
        let known = sides.par_iter().flat_map_iter(against).collect();
        let bounds = blockers.iter().fold(Aabb::EMPTY, |all, blocker| all.union(*blocker.bounds()));
        let round = blockers.iter().any(|blocker| blocker.round().is_some());
        Changed { blockers, round, bounds, known }
    }

    /// Whether one may come between two boxes.
    fn touches(&self, shaft: &BoxShaft) -> bool {
        let slack = self.blockers.iter().map(|b| b.bands().slack).fold(0.0, f64::max);
        !self.blockers.is_empty() && shaft.meets(&self.bounds, slack)
    }

    /// Closes the open pairs of a block, between two sides, that one of them hides, and marks those too close to call.
    fn close(&self, block: &mut Block, sides: &[Side], [a, b]: [usize; 2], shaft: &BoxShaft, length: f64) {
        let n = self.blockers.len();
        for (k, blocker) in self.blockers.iter().enumerate() {
            let known = [&self.known[a * n + k], &self.known[b * n + k]];
            if known[0].is_parted_from(known[1])
                && blocker.may_separate(&sides[a].bounds, &sides[b].bounds)
                && !shaft.misses(blocker)
            {
                block.test_known(blocker, length, known);
            }
        }
    }
}

impl VisibilityGraph {
    /// The graph of `points` of `geometry`, given that this is the graph of the points of another geometry `before`:
    /// what did not change is copied, and the bits are those of [`VisibilityGraph::build`]. It takes the less time the
    /// less has changed. Where too little is left as it was, or the scene's centre or radius is another, the graph is
    /// built from nothing.
    ///
    /// # Errors
    /// Those of [`VisibilityGraph::build`].
    pub fn update(
        &self,
        before: (&Geometry, &SamplePoints),
        (geometry, points): (&Geometry, &SamplePoints),
        tracer: &dyn RayTracer,
        observer: &dyn Observer,
    ) -> Result<VisibilityGraph> {
        let start = Instant::now();
        check(geometry, points)?;
        check(before.0, before.1)?;
        let same_lattice = before.0.centre == geometry.centre && before.0.radius == geometry.radius;
        if !same_lattice || self.key != before.1.key {
            return VisibilityGraph::build(geometry, points, tracer, observer);
        }
        let kept = Kept::between(before, (geometry, points));
        if (kept.count() as f64) < LEAST_KEPT * points.len() as f64 {
            return VisibilityGraph::build(geometry, points, tracer, observer);
        }
        let settings = GraphSettings::default();
        let build = Build::new(geometry, points, tracer, &settings);
        let update = Update::new(&build, self, &kept, before.0);
        let n = points.len() as u64;
        observer.begin("visibility graph", n * n.saturating_sub(1) / 2);
        let graph = build.edges(observer, |block, a, b| update.edge(block, a, b));
        observer.end();
        let mut graph = graph?;
        graph.look_at_lights(geometry, points, tracer);
        graph.stats.build_s = start.elapsed().as_secs_f64();
        Ok(graph)
    }
}

/// The patches on one side of a block, each with the points of the side that lie on it.
type Members<'a> = &'a [(Bits, &'a Patch)];

impl<'a> Update<'a> {
    fn new(build: &'a Build<'a>, graph: &'a VisibilityGraph, kept: &'a Kept, before: &Geometry) -> Self {
        let (mut sides, mut first_side) = (Vec::new(), vec![0]);
        for v in 0..build.points.voxels() {
            for points in blocks(&build.points.voxel(v)) {
                let (runs, stayed) = kept.runs(graph, &points);
                let (bounds, flat) = (build.around(&points), build.is_flat(&points));
                sides.push(Side { points, bounds, flat, stayed, runs });
            }
            first_side.push(sides.len());
        }
        let blockers =
            kept.gone.iter().map(|&s| Blocker::new(&before.surfaces[s as usize], &build.bands)).collect();
        let gone = Changed::new(build, &sides, blockers, |_| None);
        let blockers = kept.come.iter().map(|&s| build.blockers[s as usize].clone()).collect();
        let come = Changed::new(build, &sides, blockers, |k| Some(kept.come[k]));
        Update { build, graph, kept, sides, first_side, gone, come }
    }

    /// What voxels `a <= b` see of each other.
    fn edge(&self, block: &mut Block, a: usize, b: usize) -> VoxelPair {
        let build = self.build;
        let mut work = PairWork::new(build, block, a, b);
        if work.rows.is_empty() || work.columns.is_empty() {
            return work.result;
        }
        let shaft = BoxShaft::new(&build.boxes[a], &build.boxes[b]);
        let untouched = !self.gone.touches(&shaft) && !self.come.touches(&shaft);
        let same = [a, b].map(|v| self.same_voxel(v));
        if let [Some(was_a), Some(was_b)] = same
            && untouched
            && was_a <= was_b
        {
            return self.copy(was_a, was_b);
        }
        if build.nothing_faces(&work.rows, &work.columns) {
            work.pass_over();
            return work.result;
        }
        build.tree.candidates(&build.blockers, &build.boxes[a], &build.boxes[b], &mut work.open);
        let round = |&c: &u32| build.blockers[c as usize].round().is_some();
        // Which pairs are left to the tracer for a disc or a sphere depends on what else is in their voxels.
        let regroup = same.contains(&None) && work.open.iter().any(round);
        for first in self.first_side[a]..self.first_side[a + 1] {
            for second in self.first_side[b]..self.first_side[b + 1] {
                if a == b && second < first {
                    continue;
                }
                if regroup {
                    work.block(self.sides[first].points.clone(), self.sides[second].points.clone());
                } else {
                    self.renew(&mut work, [first, second]);
                }
            }
        }
        work.cast();
        if a == b {
            work.mirror();
        }
        work.result
    }

    /// The voxel of the graph before that held the same points as voxel `v` does, and no other.
    fn same_voxel(&self, v: usize) -> Option<usize> {
        let points = self.build.points.voxel(v);
        let first = self.kept.before(points.start)?;
        let was = self.graph.voxel_of(first);
        let same = self.graph.voxel(was) == (first..first + points.len())
            && points.enumerate().all(|(k, i)| self.kept.before(i) == Some(first + k));
        same.then_some(was)
    }

    /// The edge as it was between two voxels.
    fn copy(&self, a: usize, b: usize) -> VoxelPair {
        let (rows, columns) = (self.graph.voxel(a).len(), self.graph.voxel(b).len());
        let edge = self.graph.edge(a, b);
        let mut pair = VoxelPair { copied: Some(edge), ..VoxelPair::default() };
        let all = if a == b { rows * (rows - 1) / 2 } else { rows * columns } as u64;
        (pair.stats.pairs, pair.stats.copied) = (all, all);
        if let Edge::Partial(first) = edge {
            let words = &self.graph.words[first as usize..first as usize + rows * stride_of(columns)];
            pair.out_of_memory = pair.words.try_reserve_exact(words.len()).is_err();
            if !pair.out_of_memory {
                pair.words.extend_from_slice(words);
            }
        }
        pair
    }

    /// Decides the pairs of a block, by what was known of them where that is of use.
    fn renew(&self, work: &mut PairWork, [first, second]: [usize; 2]) {
        let (a, b) = (&self.sides[first], &self.sides[second]);
        let shaft = BoxShaft::new(&a.bounds, &b.bounds);
        let [gone, come] = [&self.gone, &self.come].map(|changed| changed.touches(&shaft));
        if !a.flat || !b.flat || gone && self.gone.round || come && self.come.round {
            return work.block(a.points.clone(), b.points.clone());
        }
        let (on_a, on_b) = (self.build.members(&a.points), self.build.members(&b.points));
        work.open_facing(a.points.clone(), b.points.clone(), &on_a, &on_b);
        let facing = work.block.count_open();
        let length = a.bounds.union(b.bounds).size().length();
        let rows = a.points.len();
        // Of the facing pairs: those that saw each other, those that did not, and those to be decided anew.
        let (mut seen, mut hidden, mut anew) = ([[0; WORDS]; SIDE], [[0; WORDS]; SIDE], [[0; WORDS]; SIDE]);
        let mut any = [0; 3];
        for r in 0..rows {
            let facing = work.block.open[r];
            let before = self.kept.before(a.points.start + r).map(|i| self.kept.row(self.graph, i, &b.runs));
            for w in 0..WORDS {
                let stayed = if before.is_some() { b.stayed[w] } else { 0 };
                let saw = before.map_or(0, |bits| bits[w]);
                seen[r][w] = facing[w] & stayed & saw;
                hidden[r][w] = facing[w] & stayed & !saw;
                anew[r][w] = facing[w] & !stayed;
                any = [any[0] | seen[r][w], any[1] | hidden[r][w], any[2] | anew[r][w]];
            }
        }
        let total = |bits: &[Bits]| bits.iter().map(count).sum::<u64>();
        let stayed = total(&seen[..rows]) + total(&hidden[..rows]);
        let mut reopened = [[0; WORDS]; SIDE];
        if gone && any[1] != 0 {
            work.reopen(&hidden, rows);
            self.gone.close(work.block, &self.sides, [first, second], &shaft, length);
            for r in 0..rows {
                let (open, unsure) = (work.block.open[r], work.block.unsure[r]);
                reopened[r] = std::array::from_fn(|w| hidden[r][w] & (!open[w] | unsure[w]));
            }
        }
        if any[0] != 0 {
            work.reopen(&seen, rows);
            if come {
                self.come.close(work.block, &self.sides, [first, second], &shaft, length);
            }
            for r in 0..rows {
                let (open, unsure) = (work.block.open[r], work.block.unsure[r]);
                work.see_words(
                    a.points.start + r,
                    b.points.start,
                    &std::array::from_fn(|w| open[w] & !unsure[w]),
                );
                for c in set(&std::array::from_fn(|w| open[w] & unsure[w])) {
                    let (i, j) = (a.points.start + r, b.points.start + c);
                    if !self.build.hides(&self.kept.come, i, j) {
                        work.see_points(i, j);
                    }
                }
            }
        }
        let settled = stayed - total(&reopened[..rows]);
        if gone || come {
            work.result.stats.retested += settled;
        } else {
            work.result.stats.copied += settled;
        }
        // What is too close to call must not depend on the way: rays where a build from nothing would cast them.
        let by_rays =
            (any[2] != 0 || settled < stayed) && !pays(work.open.len(), work.block.points(), facing) && {
                let all = work.open.len();
                work.open_candidates(&a.points, &b.points, [&a.bounds, &b.bounds], true);
                let candidates = work.open.len() - all;
                work.open.truncate(all);
                !pays(candidates, work.block.points(), facing)
            };
        // New points are few and close together: so are the surfaces that can block between them and all others.
        let is_new = |r: usize| a.stayed[r / 32] >> (r % 32) & 1 == 0;
        for part in 0..3 {
            let mut open = [[0; WORDS]; SIDE];
            for r in 0..rows {
                open[r] = match part {
                    0 if is_new(r) => anew[r],
                    1 if !is_new(r) => anew[r],
                    2 => reopened[r],
                    _ => [0; WORDS],
                };
            }
            work.reopen(&open, rows);
            if by_rays {
                work.push_open();
            } else if open[..rows].iter().any(|bits| *bits != [0; WORDS]) {
                self.decide(work, [a, b], (&on_a, &on_b));
            }
        }
    }

    /// Decides the open pairs of a block by what can block between the points that they join.
    fn decide(&self, work: &mut PairWork, sides: [&Side; 2], on: (Members, Members)) {
        let (rows, columns) = work.block.open_sides();
        let around = |side: &Side, bits: &Bits| {
            let place = |k: usize| self.build.points.position[side.points.start + k].as_dvec3();
            Aabb::around(set(bits).map(place))
        };
        let bounds = [around(sides[0], &rows), around(sides[1], &columns)];
        let all = work.open.len();
        work.open_between([&bounds[0], &bounds[1]], usize::MAX);
        let candidates = all..work.open.len();
        if work.block.count_open() <= FEW {
            work.settle_open(candidates);
        } else {
            let length = bounds[0].union(bounds[1]).size().length();
            work.test_open(candidates, length, on.0, on.1);
        }
        work.open.truncate(all);
    }
}

//! The graph of a scene in which some surfaces moved, came or went: the "rapid incremental method" that the paper
//! leaves open.
//!
//! What two points that stayed see of each other changes only by surfaces that came or went between them: if they saw
//! each other, only what came can change that; if they did not, only what went. So their bit is copied wherever no such
//! surface can come between the boxes around some points each, or the segment passes by the boxes around such surfaces. All
//! others are decided anew, by what came alone where all of a block saw each other.
//! [`Block::test_known`] and what settles its doubts give the same answer wherever they are asked, but rays do not
//! where a segment grazes something: where rays were cast, or are to be cast, nothing is copied but whole edges that
//! nothing came near. So the graph has the bits of one that is built from nothing.

use super::against::span;
use super::block::{Bits, Block, SIDE, WORDS, count};
use super::build::{Build, GraphSettings, check};
use super::cull::BoxShaft;
use super::graph::{Edge, VisibilityGraph, stride_of};
use super::kept::{Kept, Run};
use super::pairs::set;
use super::passing::Passing;
use super::patch::Patch;
use super::voxel_pair::{PairWork, VoxelPair, blocks, pays};
use crate::error::Result;
use crate::geometry::Aabb;
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, ObjectId};
use crate::tracers::RayTracer;
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Instant;

/// Where fewer of the points than this stayed the graph is built from nothing: to look up the rest would not pay.
const LEAST_KEPT: f64 = 0.5;

/// So few pairs of a block are decided one by one.
const FEW: u64 = 64;

/// The points of a group, of which the box around them tells whether something can come before them.
const GROUP: usize = 16;

/// What an update shares between all threads.
struct Update<'a> {
    build: &'a Build<'a>,
    graph: &'a VisibilityGraph,
    kept: &'a Kept,
    /// All blocks' sides, in the order of their points,
    sides: Vec<Side>,
    /// and the first of each voxel; one more at the end.
    first_side: Vec<usize>,
    /// For each voxel the one of the graph before that held the same points and no other.
    same: Vec<Option<usize>>,
    /// Surfaces that are no longer there,
    gone: Changed,
    /// and those that were not.
    come: Changed,
}

/// Points of a voxel that are one side of a block.
struct Side {
    points: Range<usize>,
    bounds: Aabb,
    /// Around [`GROUP`] of them after another.
    groups: Vec<Aabb>,
    /// Whether all its surfaces are planar.
    flat: bool,
    /// The points that stayed,
    stayed: Bits,
    /// and where their bits are.
    runs: Vec<Run>,
}

/// Surfaces that came or went.
struct Changed {
    /// The boxes around those of each object.
    bounds: Vec<Aabb>,
    /// How far rounding may carry them, m.
    slack: f64,
    /// One is no polygon.
    round: bool,
    /// The boxes, for many segments at once.
    passing: Vec<Passing>,
}

impl Changed {
    /// The surfaces `which` of a scene; `slack` is how far rounding may carry them, m.
    fn new(of: &Geometry, which: &[u32], slack: f64) -> Self {
        let mut boxes: BTreeMap<ObjectId, Aabb> = BTreeMap::new();
        let mut round = false;
        for &s in which {
            let surface = &of.surfaces[s as usize];
            let bounds = boxes.entry(of.object[s as usize]).or_insert(Aabb::EMPTY);
            *bounds = bounds.union(surface.bounds());
            round |= surface.round().is_some();
        }
        let bounds: Vec<Aabb> = boxes.into_values().collect();
        let passing = bounds.iter().map(|b| Passing::new(b, slack, of.radius)).collect();
        Changed { bounds, slack, round, passing }
    }

    /// Which of some `pairs` of a block one may come between.
    fn between(&self, block: &Block, pairs: &[Bits; SIDE]) -> [Bits; SIDE] {
        let mut found = [[0; WORDS]; SIDE];
        if pairs[..block.rows.count].iter().any(|row| *row != [0; WORDS]) {
            for passing in &self.passing {
                passing.find([&block.rows, &block.columns], pairs, &mut found);
            }
        }
        found
    }

    /// Whether one may come between two boxes.
    fn touches(&self, shaft: &BoxShaft) -> bool {
        self.bounds.iter().any(|bounds| shaft.meets(bounds, self.slack))
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
        let update = Update::new(&build, self, &kept, before.0, geometry);
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

/// The voxel of `graph` that held the same `points` of a voxel, and no other.
fn same_voxel(points: Range<usize>, graph: &VisibilityGraph, kept: &Kept) -> Option<usize> {
    if points.is_empty() {
        return None;
    }
    let first = kept.before(points.start)?;
    let was = graph.voxel_of(first);
    let same = graph.voxel(was) == (first..first + points.len())
        && points.enumerate().all(|(k, i)| kept.before(i) == Some(first + k));
    same.then_some(was)
}

/// The patches on one side of a block, each with the points of the side that lie on it.
type Members<'a> = &'a [(Bits, &'a Patch)];

impl<'a> Update<'a> {
    fn new(
        build: &'a Build<'a>,
        graph: &'a VisibilityGraph,
        kept: &'a Kept,
        before: &Geometry,
        now: &Geometry,
    ) -> Self {
        let (mut sides, mut first_side) = (Vec::new(), vec![0]);
        for v in 0..build.points.voxels() {
            for points in blocks(&build.points.voxel(v)) {
                let (runs, stayed) = kept.runs(graph, &points);
                let group = |first: usize| build.around(&(first..(first + GROUP).min(points.end)));
                let groups = points.clone().step_by(GROUP).map(group).collect();
                let (bounds, flat) = (build.around(&points), build.is_flat(&points));
                sides.push(Side { points, bounds, groups, flat, stayed, runs });
            }
            first_side.push(sides.len());
        }
        let slack = build.blockers.iter().map(|b| b.bands().slack).fold(0.0, f64::max);
        let (gone, come) = (Changed::new(before, &kept.gone, slack), Changed::new(now, &kept.come, slack));
        let same =
            (0..build.points.voxels()).map(|v| same_voxel(build.points.voxel(v), graph, kept)).collect();
        Update { build, graph, kept, sides, first_side, same, gone, come }
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
        let same = [self.same[a], self.same[b]];
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

    /// The edge as it was between two voxels.
    fn copy(&self, a: usize, b: usize) -> VoxelPair {
        let (rows, columns) = (self.graph.voxel(a).len(), self.graph.voxel(b).len());
        let edge = self.graph.edge(a, b);
        let copied = Some((edge, self.graph.was_cast(a, b)));
        let mut pair = VoxelPair { copied, ..VoxelPair::default() };
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
        if facing == 0 {
            return;
        }
        // What is too close to call must not depend on the way: rays where a build from nothing would cast them.
        let all = work.open.len();
        if !pays(all, work.block.points(), facing) {
            let candidates = work.open_candidates(&a.points, &b.points, [&a.bounds, &b.bounds], true);
            work.open.truncate(all);
            if !pays(candidates.len(), work.block.points(), facing) {
                return work.push_open();
            }
        }
        let clear_of = |changed: &Changed, near: bool| match near {
            true => clear_of(changed, a, b),
            false => [[u32::MAX; WORDS]; SIDE / GROUP],
        };
        let clear = [clear_of(&self.come, come), clear_of(&self.gone, gone)];
        let saw = self.recall(work, [a, b], clear);
        if work.block.open_sides().0 != [0; WORDS] {
            self.decide(work, [a, b], (&on_a, &on_b), saw);
        }
    }

    /// Closes the open pairs of a block that see of each other what they saw: those that did where nothing came
    /// between, those that did not where nothing went. `clear` says so of columns, for each group of rows. Returns
    /// whether those that are left all saw each other.
    fn recall(&self, work: &mut PairWork, [a, b]: [&Side; 2], clear: [[Bits; SIDE / GROUP]; 2]) -> bool {
        let rows = a.points.len();
        // First those that saw each other, then those that did not; the first may still turn out to be clear of what
        // came, the second of what went.
        let mut asked = [[[0; WORDS]; SIDE]; 2];
        let close = |work: &mut PairWork, r: usize, settled: [Bits; 2]| {
            let open = &mut work.block.open[r];
            *open = std::array::from_fn(|w| open[w] & !settled[0][w] & !settled[1][w]);
            work.result.stats.copied += count(&settled[0]) + count(&settled[1]);
            work.see_words(a.points.start + r, b.points.start, &settled[0]);
        };
        for r in 0..rows {
            let Some(before) = self.kept.before(a.points.start + r) else { continue };
            let (bits, known) = self.kept.row(self.graph, before, &b.runs);
            let open = work.block.open[r];
            let stayed: Bits = std::array::from_fn(|w| open[w] & known[w] & b.stayed[w]);
            let were: [Bits; 2] =
                [std::array::from_fn(|w| stayed[w] & bits[w]), std::array::from_fn(|w| stayed[w] & !bits[w])];
            let clear = [clear[0][r / GROUP], clear[1][r / GROUP]];
            for k in 0..2 {
                asked[k][r] = std::array::from_fn(|w| were[k][w] & !clear[k][w]);
            }
            close(work, r, [0, 1].map(|k| std::array::from_fn(|w| were[k][w] & clear[k][w])));
        }
        let near = [self.come.between(work.block, &asked[0]), self.gone.between(work.block, &asked[1])];
        for r in 0..rows {
            close(work, r, [0, 1].map(|k| std::array::from_fn(|w| asked[k][r][w] & !near[k][r][w])));
        }
        work.block.open[..rows] == near[0][..rows]
    }

    /// The box around some points of a side.
    fn around(&self, side: &Side, of: &Bits) -> Aabb {
        let place = |k: usize| self.build.points.position[side.points.start + k].as_dvec3();
        Aabb::around(set(of).map(place))
    }

    /// Decides the open pairs of a block by what can block between the points that they join: if they `saw` each
    /// other, only what came.
    fn decide(&self, work: &mut PairWork, sides: [&Side; 2], on: (Members, Members), saw: bool) {
        let (rows, columns) = work.block.open_sides();
        let bounds = [self.around(sides[0], &rows), self.around(sides[1], &columns)];
        let all = work.open.len();
        work.open_between([&bounds[0], &bounds[1]], usize::MAX);
        if saw {
            let mut at = 0..;
            work.open.retain(|c| at.next() < Some(all) || self.kept.come.binary_search(c).is_ok());
        }
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

/// For each group of rows the columns that nothing `changed` can come between.
fn clear_of(changed: &Changed, a: &Side, b: &Side) -> [Bits; SIDE / GROUP] {
    let mut clear = [[0; WORDS]; SIDE / GROUP];
    for (from, clear) in a.groups.iter().zip(&mut clear) {
        for (k, to) in b.groups.iter().enumerate() {
            if !changed.touches(&BoxShaft::new(from, to)) {
                let columns = span(GROUP * k, GROUP * (k + 1));
                *clear = std::array::from_fn(|w| clear[w] | columns[w]);
            }
        }
    }
    clear
}

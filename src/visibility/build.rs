//! Building the graph: all pairs of voxels, in parallel.

use super::block::Block;
use super::blocker::{Bands, Blocker};
use super::cull::BlockerTree;
use super::flat::lies_under;
use super::graph::{Edge, VisibilityGraph, edge_index};
use super::patch::Patch;
use super::stats::GraphStats;
use super::voxel_pair::{PairWork, VoxelPair};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Surface};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// How to decide the pairs. The graph is the same for any settings but for pairs whose segment
/// grazes an edge within rounding; they exist to check one way against another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraphSettings {
    /// Decide whole tiles by proofs.
    pub proofs: bool,
    /// Where few enough surfaces can block, test them one by one instead of casting rays; if not, all is left to the
    /// tracer, as in the paper. Needs `proofs`.
    pub tests: bool,
}

impl Default for GraphSettings {
    fn default() -> Self {
        GraphSettings { proofs: true, tests: true }
    }
}

/// Edges decided between two joins of the threads: enough to share, few enough to hold.
const CHUNK: usize = 4096;

/// Edges between so many voxels and so many others are decided one after the other: how their points lie against surfaces
/// is found once for all of them.
const NEAR: [usize; 2] = [4, 8];

/// Each thread takes edges from a chunk about so many times, so that none waits long for the last,
const TURNS: usize = 8;

/// but no fewer and no more of them at a time: what is known of their points is found anew each time.
const TASK: [usize; 2] = [32, 256];

/// What all threads share while a graph is built.
pub(super) struct Build<'a> {
    pub points: &'a SamplePoints,
    pub tracer: &'a dyn RayTracer,
    pub settings: &'a GraphSettings,
    pub bands: Bands,
    pub surfaces: &'a [Surface],
    /// By surface.
    pub blockers: Vec<Blocker>,
    pub tree: BlockerTree,
    /// Around the points of each voxel.
    pub boxes: Vec<Aabb>,
    /// By point: whether a surface lies flat upon it, so that it sees nothing.
    pub under: Vec<bool>,
    /// In the order of their points.
    pub patches: Vec<Patch>,
}

impl VisibilityGraph {
    /// Decides for all pairs of `points` whether they see each other (section 4.2.1).
    ///
    /// The same bits result from any number of threads. Progress is told in pairs of points.
    ///
    /// # Errors
    /// [`Error::Settings`] when the points are not those of this geometry, or when there are so
    /// many that memory does not hold the graph (N²/16 bytes, a little more for small voxels).
    pub fn build(
        geometry: &Geometry,
        points: &SamplePoints,
        tracer: &dyn RayTracer,
        observer: &dyn Observer,
    ) -> Result<VisibilityGraph> {
        Self::build_with(geometry, points, tracer, &GraphSettings::default(), observer)
    }

    /// [`VisibilityGraph::build`] with other than the usual settings.
    ///
    /// # Errors
    /// As [`VisibilityGraph::build`].
    pub fn build_with(
        geometry: &Geometry,
        points: &SamplePoints,
        tracer: &dyn RayTracer,
        settings: &GraphSettings,
        observer: &dyn Observer,
    ) -> Result<VisibilityGraph> {
        let start = Instant::now();
        check(geometry, points)?;
        let build = Build::new(geometry, points, tracer, settings);
        let n = points.len() as u64;
        observer.begin("visibility graph", n * n.saturating_sub(1) / 2);
        let graph = build.edges(observer, |block, a, b| PairWork::decide(&build, block, a, b));
        observer.end();
        let mut graph = graph?;
        graph.look_at_lights(geometry, points, tracer);
        graph.stats.build_s = start.elapsed().as_secs_f64();
        Ok(graph)
    }
}

impl<'a> Build<'a> {
    /// Prepares what all threads share.
    pub fn new(
        geometry: &'a Geometry,
        points: &'a SamplePoints,
        tracer: &'a dyn RayTracer,
        settings: &'a GraphSettings,
    ) -> Self {
        let bands = Bands::new(geometry);
        let blockers: Vec<Blocker> = geometry.surfaces.iter().map(|s| Blocker::new(s, &bands)).collect();
        let patches = Patch::all(geometry, points);
        let around = |v| Aabb::around(points.voxel(v).map(|i| points.position[i].as_dvec3()));
        let mut build = Build {
            points,
            tracer,
            settings,
            bands,
            surfaces: &geometry.surfaces,
            tree: BlockerTree::new(&blockers),
            blockers,
            boxes: (0..points.voxels()).map(around).collect(),
            under: Vec::new(),
            patches,
        };

        build.under = lies_under(&build, &geometry.surfaces, &geometry.two_sided, geometry.radius);
        build
    }

    /// Decides all edges, in their order, a chunk at a time; `decide` does the one between two voxels `a <= b`.
    pub fn edges(
        &self,
        observer: &dyn Observer,
        decide: impl Fn(&mut Block, usize, usize) -> VoxelPair + Sync,
    ) -> Result<VisibilityGraph> {
        let voxels = self.points.voxels();
        let mut graph = VisibilityGraph {
            starts: self.points.voxel_starts.clone(),
            edges: Vec::new(),
            cast: Vec::new(),
            words: Vec::new(),
            key: self.points.key,
            lights: Default::default(),
            stats: GraphStats::default(),
        };
        let count = edge_index(0, voxels);
        graph.edges.try_reserve_exact(count).map_err(|_| too_large(self.points))?;
        graph.cast.try_reserve_exact(count).map_err(|_| too_large(self.points))?;
        // Blocks keep what they know from task to task.
        let blocks: Mutex<Vec<Box<Block>>> = Mutex::default();
        let pool = || blocks.lock().unwrap_or_else(PoisonError::into_inner);
        let mut edges = (0..voxels).flat_map(|b| (0..=b).map(move |a| (a, b)));
        loop {
            let chunk: Vec<(usize, usize)> = edges.by_ref().take(CHUNK).collect();
            if chunk.is_empty() {
                break;
            }
            let mut order: Vec<usize> = (0..chunk.len()).collect();
            order.sort_unstable_by_key(|&k| {
                let (a, b) = chunk[k];
                (b / NEAR[1], a / NEAR[0], b, a)
            });
            let size = chunk.len() / (TURNS * rayon::current_num_threads());
            let size = size.clamp(TASK[0], TASK[1]);
            let task = |task: &[usize]| {
                let mut block = pool().pop().unwrap_or_default();
                let decide = |&k: &usize| {
                    let (a, b) = chunk[k];
                    let pair = decide(&mut block, a, b);
                    observer.advance(pair.stats.pairs);
                    (k, pair)
                };
                let decided: Vec<(usize, VoxelPair)> = task.iter().map(decide).collect();
                pool().push(block);
                decided
            };
            let decided: Vec<_> = order.par_chunks(size).with_max_len(1).map(task).collect();
            let mut decided: Vec<(usize, VoxelPair)> = decided.into_iter().flatten().collect();
            decided.sort_unstable_by_key(|(k, _)| *k);
            for (_, pair) in decided {
                graph.push(pair).map_err(|()| too_large(self.points))?;
            }
        }
        graph.words.shrink_to_fit();
        Ok(graph)
    }
}

impl VisibilityGraph {
    /// Adds the next edge; fails when memory is short.
    fn push(&mut self, pair: VoxelPair) -> std::result::Result<(), ()> {
        if pair.out_of_memory {
            return Err(());
        }
        self.stats.add_pairs(&pair.stats);
        self.stats.seen += pair.seen;
        let by_rays = pair.stats.rays_cast > 0;
        let (mut edge, cast) = match pair.copied {
            Some(copied) => copied,
            None if pair.seen == 0 => (Edge::Hidden, by_rays),
            None if pair.seen == pair.facing => (Edge::Visible, by_rays),
            None => (Edge::Partial(0), by_rays),
        };
        self.cast.push(cast);
        match &mut edge {
            Edge::Hidden => self.stats.hidden_edges += 1,
            Edge::Visible => self.stats.visible_edges += 1,
            Edge::Partial(first) => {
                self.stats.partial_edges += 1;
                self.stats.pairs_stored += pair.stats.pairs;
                self.words.try_reserve(pair.words.len()).map_err(|_| ())?;
                *first = self.words.len() as u64;
                self.words.extend_from_slice(&pair.words);
            }
        }
        self.edges.push(edge);
        Ok(())
    }
}

/// Refuses points that cannot have been sampled from `geometry`.
pub(super) fn check(geometry: &Geometry, points: &SamplePoints) -> Result<()> {
    let n = points.len();
    let ends = [points.voxel_starts.first(), points.voxel_starts.last()];
    let same_geometry = points.surface.len() == n
        && points.side.len() == n
        && points.surface.iter().all(|s| s.index() < geometry.surfaces.len());
    let ordered = points.voxel_starts.windows(2).all(|w| w[0] <= w[1])
        && (ends == [Some(&0), Some(&(n as u32))] || (n == 0 && ends == [None, None]));
    if same_geometry && ordered {
        Ok(())
    } else {
        Err(Error::Settings(
            "the sample points do not belong to this geometry: sample it again before building the graph"
                .into(),
        ))
    }
}

fn too_large(points: &SamplePoints) -> Error {
    let n = points.len() as f64;
    Error::Settings(format!(
        "not enough memory for the visibility graph of {n} sample points (about {:.1} GB): \
         sample the scene more coarsely",
        n * n / 16.0 / 1e9
    ))
}

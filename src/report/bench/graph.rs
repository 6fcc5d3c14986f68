//! The visibility graph beside its ceiling: a plain loop that traces every facing pair and keeps only a count.

use crate::error::Result;
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::points::facing::SidePlane;
use crate::scene::Geometry;
use crate::tracers::{EmbreeTracer, RayTracer, Segment, embree};
use crate::visibility::VisibilityGraph;
use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;
use std::time::Instant;

/// How often graph and ceiling are timed, turn by turn; the least time of each counts.
const TURNS: usize = 3;

/// What one graph costs against the plain loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GraphBench {
    /// Number of sample points.
    pub points: u64,
    /// Unordered pairs of points that face each other, points of one surface left out: the segments of the ceiling.
    pub facing_pairs: u64,
    /// What the ceiling is: Embree's packets without our wrapper, or the tracer in use where there is no Embree.
    pub ceiling: String,
    /// Wall time of the plain loop, s.
    pub ceiling_s: f64,
    /// Segments that it traced a second.
    pub ceiling_segments_per_s: f64,
    /// Wall time of the graph, s.
    pub graph_s: f64,
    /// `graph_s` over `ceiling_s`.
    pub ratio: f64,
    /// Facing pairs that nothing blocks, by the plain loop,
    pub ceiling_seen: u64,
    /// and by the graph. They differ by pairs that graze an edge within rounding, and by points that a surface lies
    /// flat upon, which the graph takes out.
    pub graph_seen: u64,
    /// Unordered pairs that the graph decided because they lie on one surface,
    pub same_surface: u64,
    /// because one or both face away,
    pub not_facing: u64,
    /// by a proof for many at once,
    pub proved: u64,
    /// by the candidates of their tile,
    pub direct: u64,
    /// by the last blocker,
    pub last_blocker: u64,
    /// and by a ray.
    pub rays_cast: u64,
    /// Memory of the graph, bytes.
    pub memory_bytes: u64,
}

/// Builds the graph of `points` with `tracer`, and traces all its facing pairs without it, several times in turn on
/// all threads.
///
/// # Errors
/// Those of [`VisibilityGraph::build`]; [`crate::error::Error::Tracer`] when Embree refuses the scene.
pub fn graph(
    geometry: &Geometry,
    points: &SamplePoints,
    tracer: &dyn RayTracer,
    observer: &dyn Observer,
) -> Result<GraphBench> {
    let bare = embree::available().map(|_| EmbreeTracer::bare(geometry)).transpose()?;
    let ceiling = match &bare {
        Some(bare) => format!("{}, packets of 16", bare.name()),
        None => format!("no Embree in this build: {}, batches", tracer.name()),
    };
    let (mut graph_s, mut ceiling_s) = (f64::INFINITY, f64::INFINITY);
    let mut seen = (0, 0);
    let mut graph = VisibilityGraph::build(geometry, points, tracer, observer)?;
    for _ in 0..TURNS {
        let started = Instant::now();
        seen = match &bare {
            Some(bare) => plain_loop(geometry, points, |fans| bare.count_free(fans)),
            None => plain_loop(geometry, points, |fans| count_free(tracer, fans)),
        };
        ceiling_s = ceiling_s.min(started.elapsed().as_secs_f64());
        let started = Instant::now();
        graph = VisibilityGraph::build(geometry, points, tracer, observer)?;
        graph_s = graph_s.min(started.elapsed().as_secs_f64());
    }
    let (facing_pairs, ceiling_seen) = seen;
    let stats = &graph.stats;
    Ok(GraphBench {
        points: points.len() as u64,
        facing_pairs,
        ceiling,
        ceiling_s,
        ceiling_segments_per_s: facing_pairs as f64 / ceiling_s,
        graph_s,
        ratio: graph_s / ceiling_s,
        ceiling_seen,
        graph_seen: stats.seen,
        same_surface: stats.same_surface,
        not_facing: stats.not_facing,
        proved: stats.proved,
        direct: stats.direct,
        last_blocker: stats.last_blocker,
        rays_cast: stats.rays_cast,
        memory_bytes: graph.memory_bytes(),
    })
}

/// A run of points of one side of one planar surface in one voxel, or one point of a curved surface.
struct Run {
    points: Range<usize>,
    plane: SidePlane,
}

/// The points of one run in front of another's plane.
fn in_front(points: &SamplePoints, of: &Run, other: &Run, tolerance: f64, found: &mut Vec<Vec3>) {
    found.clear();
    let places = &points.position[of.points.clone()];
    found.extend(places.iter().filter(|p| other.plane.height(p.as_dvec3()) > tolerance));
}

/// Hands every facing pair of points to `count` as a fan from one point to the points of another run, and returns
/// how many there are and how many of them nothing blocks.
fn plain_loop(
    geometry: &Geometry,
    points: &SamplePoints,
    count: impl Fn(&mut dyn Iterator<Item = (Vec3, &[Vec3])>) -> u64 + Sync,
) -> (u64, u64) {
    let runs = runs(geometry, points);
    let tolerance = geometry.plane_tolerance();
    let of_run = |b: usize| {
        let (mut from, mut to) = (Vec::new(), Vec::new());
        let (mut facing, mut free) = (0, 0);
        for a in 0..b {
            if points.share_plane(runs[a].points.start, runs[b].points.start) {
                continue;
            }
            in_front(points, &runs[a], &runs[b], tolerance, &mut from);
            in_front(points, &runs[b], &runs[a], tolerance, &mut to);
            facing += (from.len() * to.len()) as u64;
            free += count(&mut from.iter().map(|&p| (p, to.as_slice())));
        }
        (facing, free)
    };
    // The last have the most partners: they go first, so that no thread is left with one of them at the end.
    (0..runs.len())
        .into_par_iter()
        .rev()
        .with_max_len(1)
        .map(of_run)
        .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1))
}

fn runs(geometry: &Geometry, points: &SamplePoints) -> Vec<Run> {
    let mut runs = Vec::new();
    for v in 0..points.voxels() {
        let mut first = points.voxel(v).start;
        for next in points.voxel(v).map(|i| i + 1) {
            let (surface, side) = (points.surface[first], points.side[first]);
            let curved = !geometry.surface(surface).is_planar();
            let ends = next == points.voxel(v).end;
            if ends || curved || (points.surface[next], points.side[next]) != (surface, side) {
                runs.push(Run { points: first..next, plane: SidePlane::at(geometry, points, first) });
                first = next;
            }
        }
    }
    runs
}

/// [`EmbreeTracer::count_free`] for any tracer.
fn count_free(tracer: &dyn RayTracer, fans: &mut dyn Iterator<Item = (Vec3, &[Vec3])>) -> u64 {
    let segments: Vec<Segment> =
        fans.flat_map(|(from, to)| to.iter().map(move |&to| Segment { from, to })).collect();
    let mut blocked = vec![false; segments.len()];
    tracer.occluded_batch(&segments, &mut blocked);
    blocked.iter().filter(|&&b| !b).count() as u64
}

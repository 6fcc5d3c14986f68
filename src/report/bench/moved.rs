//! The graph after objects moved, came or went: updated, beside built anew.

use crate::error::Result;
use crate::observer::Observer;
use crate::pipeline::Prepared;
use crate::points::{SamplePoints, Sampling, sample};
use crate::scene::{Geometry, Scene};
use crate::settings::Settings;
use crate::tracers;
use crate::visibility::VisibilityGraph;
use crate::voxels::Voxels;
use serde::Serialize;
use std::time::Instant;

/// How often either is timed, turn by turn; the least time of each counts.
const TURNS: usize = 5;

/// What an update costs against a graph from nothing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MovedBench {
    /// Sample points after the changes.
    pub points: u64,
    /// Wall time of the update, s,
    pub update_s: f64,
    /// and of a new graph.
    pub build_s: f64,
    /// `update_s` over `build_s`.
    pub ratio: f64,
    /// Share of the pairs of points whose answer was copied.
    pub copied_share: f64,
    /// Ordered pairs of points on which the two graphs disagree: none.
    pub different_pairs: u64,
}

/// Updates the graph of `before`, which was prepared without refinement, to the scene `changed`, and builds it anew,
/// in turn on all threads.
///
/// # Errors
/// Those of [`sample`] and of [`VisibilityGraph::build`].
pub fn moved(
    (before, prepared): (&Geometry, &Prepared),
    changed: &Scene,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<MovedBench> {
    let geometry = &changed.geometry;
    let tracer = tracers::choose(settings.tracer, geometry)?;
    let tracer = tracer.as_ref();
    let voxels = Voxels::build(geometry, &settings.voxels);
    let sampling = Sampling { area_factor: settings.area_factor, ..changed.sampling };
    let points = sample(geometry, &sampling, &voxels)?;
    let update = || prepared.graph.update((before, &prepared.points), (geometry, &points), tracer, observer);
    let build = || VisibilityGraph::build(geometry, &points, tracer, observer);
    let (mut updated, mut built) = (update()?, build()?);
    let (mut update_s, mut build_s) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..TURNS {
        let started = Instant::now();
        updated = update()?;
        update_s = update_s.min(started.elapsed().as_secs_f64());
        let started = Instant::now();
        built = build()?;
        build_s = build_s.min(started.elapsed().as_secs_f64());
    }
    Ok(MovedBench {
        points: points.len() as u64,
        update_s,
        build_s,
        ratio: update_s / build_s,
        copied_share: updated.stats.copied as f64 / updated.stats.pairs.max(1) as f64,
        different_pairs: different(&points, &updated, &built),
    })
}

fn different(points: &SamplePoints, a: &VisibilityGraph, b: &VisibilityGraph) -> u64 {
    let n = points.len();
    let differ = |i: usize| (0..n).filter(|&j| a.unblocked(i, j) != b.unblocked(i, j)).count() as u64;
    (0..n).map(differ).sum()
}

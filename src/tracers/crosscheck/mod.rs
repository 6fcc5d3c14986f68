//! Tracers against one another and against the exact judge, on random and on adversarial rays.
//!
//! Each ray is asked twice: as the segment between two points (is it blocked?) and as the ray from
//! the first through the second (what is met first, and where?). A question on which the tracers differ,
//! or on which they agree but are certainly wrong, is a [`Disagreement`] and carries the judge's verdict.

mod probes;
mod report;

pub use probes::ProbeClass;
pub use report::{ClassCounts, CrosscheckReport, Disagreement, MAX_LISTED, Question};

use super::judge::{Crossing, Verdict, crossing, judge, judge_closest};
use super::{RayTracer, Segment};
use crate::geometry::{Hit, Ray, Surface};
use crate::observer::Observer;
use crate::scene::Geometry;
use probes::Probe;
use rayon::prelude::*;
use report::Tally;
use std::ops::Range;

/// Rays per task: one row of the work, whatever the number of threads.
const CHUNK: u64 = 1024;

/// Chunks between two additions to the total, which keeps the lists of disagreements bounded.
const ROUND: u64 = 256;

/// Asks all `tracers` about `rays` rays in `geometry`. The same `seed` gives the same report, whatever the
/// number of threads. The judge rules on all disagreements and on one in 32 of the rest.
pub fn crosscheck(
    geometry: &Geometry,
    tracers: &[&dyn RayTracer],
    rays: u64,
    seed: u64,
    observer: &dyn Observer,
) -> CrosscheckReport {
    observer.begin("crosscheck", rays);
    let rays = if geometry.surfaces.is_empty() || tracers.is_empty() { 0 } else { rays };
    let check = |chunk: u64| {
        let first = chunk * CHUNK;
        let tally = check_chunk(geometry, tracers, first..(first + CHUNK).min(rays), seed);
        observer.advance(CHUNK.min(rays - first));
        tally
    };
    let chunks = rays.div_ceil(CHUNK);
    let mut total = Tally::new(tracers.len());
    for round in (0..chunks).step_by(ROUND as usize) {
        let tallies: Vec<Tally> = (round..(round + ROUND).min(chunks)).into_par_iter().map(check).collect();
        for tally in tallies {
            total.add(tally);
        }
    }
    observer.end();
    CrosscheckReport::new(tracers.iter().map(|t| t.name()).collect(), seed, total)
}

fn check_chunk(geometry: &Geometry, tracers: &[&dyn RayTracer], range: Range<u64>, seed: u64) -> Tally {
    let probes: Vec<Probe> = range.map(|i| Probe::new(geometry, seed, i)).collect();
    let segments: Vec<Segment> = probes.iter().map(|p| p.segment).collect();
    let rays: Vec<Ray> = probes.iter().map(Probe::ray).collect();
    let mut blocked = vec![vec![false; probes.len()]; tracers.len()];
    let mut hits = vec![vec![None; probes.len()]; tracers.len()];
    for (tracer, (blocked, hits)) in tracers.iter().zip(blocked.iter_mut().zip(&mut hits)) {
        tracer.occluded_batch(&segments, blocked);
        tracer.closest_batch(&rays, hits);
    }
    let mut tally = Tally::new(tracers.len());
    for (k, probe) in probes.iter().enumerate() {
        tally.count_ray(probe.class);
        let answers: Vec<bool> = blocked.iter().map(|b| b[k]).collect();
        check_blocked(geometry, &mut tally, probe, &answers);
        let answers: Vec<Option<Hit>> = hits.iter().map(|h| h[k]).collect();
        check_closest(geometry, &mut tally, probe, &rays[k], &answers);
    }
    tally
}

fn check_blocked(geometry: &Geometry, tally: &mut Tally, probe: &Probe, answers: &[bool]) {
    let agree = answers.iter().all(|&a| a == answers[0]);
    if agree && !probe.is_spot_check() {
        return;
    }
    let verdict = judge(geometry, &probe.segment);
    let wrong: Vec<bool> = answers.iter().map(|&answer| verdict.refutes(answer)).collect();
    if agree && !wrong.contains(&true) {
        return;
    }
    let (blocked_by, clearance_m) = match verdict {
        Verdict::Blocked { surface } => (Some(surface), None),
        Verdict::Free => (None, None),
        Verdict::Grazing { blocked_by, clearance } => (blocked_by, Some(clearance)),
    };
    tally.count_disagreement(Disagreement {
        answers: answers.iter().map(|a| if *a { "blocked" } else { "free" }.into()).collect(),
        wrong,
        judged: blocked_by.into_iter().map(|s| s.0).collect(),
        clearance_m,
        ..Disagreement::about(probe, Question::Blocked)
    });
}

/// Whether a ray grazes the surface that all meet before the furthest of the places where they do.
fn grazes_before(surface: &Surface, ray: &Ray, answers: &[Option<Hit>]) -> bool {
    let t = || answers.iter().flatten().map(|hit| hit.t);
    let (nearest, furthest) = (t().fold(f64::INFINITY, f64::min), t().fold(f64::NEG_INFINITY, f64::max));
    let between = ray.at(0.5 * (nearest + furthest));
    furthest > nearest && matches!(crossing(surface, ray.origin, between, 0.0, 1.0), Crossing::Grazes { .. })
}

fn check_closest(geometry: &Geometry, tally: &mut Tally, probe: &Probe, ray: &Ray, answers: &[Option<Hit>]) {
    let surfaces: Vec<_> = answers.iter().map(|a| a.map(|h| h.surface)).collect();
    let agree = surfaces.iter().all(|&s| s == surfaces[0]);
    if let (true, Some(hit)) = (agree, answers[0]) {
        let surface = geometry.surface(hit.surface);
        let normal = surface.normal_at(ray.at(hit.t));
        // What grazes a curved surface may meet it twice, or once.
        if surface.is_planar() || !grazes_before(surface, ray, answers) {
            tally.measure_t(answers, normal.dot(ray.direction).abs());
        }
    }
    if agree && !probe.is_spot_check() {
        return;
    }
    let truth = judge_closest(geometry, ray);
    let wrong: Vec<bool> = surfaces.iter().map(|&s| !truth.allows(s)).collect();
    if agree && !wrong.contains(&true) {
        return;
    }
    let says = |hit: &Option<Hit>| {
        hit.map_or("nothing".into(), |h| format!("surface {} at t = {:.9}", h.surface.0, h.t))
    };
    tally.count_disagreement(Disagreement {
        answers: answers.iter().map(says).collect(),
        wrong,
        judged: truth.surfaces.iter().map(|s| s.0).collect(),
        ..Disagreement::about(probe, Question::Closest)
    });
}

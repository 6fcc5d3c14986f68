//! The paper's Tables 1 and 2 beside ours.

use crate::geometry::SurfaceId;
use crate::points::SamplePoints;
use crate::points::facing::face_each_other;
use crate::scene::Geometry;
use crate::tracers::{RayTracer, Segment};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;
use std::time::Instant;

/// What the paper printed (section 5, Tables 1 and 2).
pub const PAPER: PaperTables = PaperTables {
    surfaces: 134,
    points: 4010,
    specular_points: 196,
    voxels: 102,
    empty_voxels: 5,
    ordered_pairs: 16_076_090,
    visible_edges: 100,
    hidden_edges: 1009,
    partial_edges: 4042,
    pairs_stored: 5_889_008,
    graph_s: 39.0 * 60.0 + 49.0,
    rays_cast: 1_394_017,
    eff_with_graph_s: 48.0 * 60.0 + 33.0,
    eff_without_graph_s: 3.0 * 3600.0 + 24.0 * 60.0 + 12.0,
    calls_with_graph: 8_038_045,
    calls_without_graph: 42_433_940,
};

/// The figures of Tables 1 and 2 and of the text around them.
#[derive(Clone, Debug, Serialize)]
pub struct PaperTables {
    /// Polygons.
    pub surfaces: u64,
    /// Sample points.
    pub points: u64,
    /// Those on specular surfaces.
    pub specular_points: u64,
    /// Voxels.
    pub voxels: u64,
    /// Voxels without sample points.
    pub empty_voxels: u64,
    /// N (N - 1).
    pub ordered_pairs: u64,
    /// Edges between voxels of which all facing points see each other.
    pub visible_edges: u64,
    /// Edges between voxels that see nothing of each other.
    pub hidden_edges: u64,
    /// Edges between voxels that see each other in part.
    pub partial_edges: u64,
    /// Pairs of points that the partial edges hold.
    pub pairs_stored: u64,
    /// Time of the graph, s.
    pub graph_s: f64,
    /// Rays really cast for the graph.
    pub rays_cast: u64,
    /// Extended form factors (and for ours the solution as well) with the graph, s.
    pub eff_with_graph_s: f64,
    /// The same without it, s.
    pub eff_without_graph_s: f64,
    /// Calls of the visibility function with the graph: one for each unordered pair.
    pub calls_with_graph: u64,
    /// Calls without it.
    pub calls_without_graph: u64,
}

impl PaperTables {
    /// Rays really cast as a share of the unordered pairs.
    pub fn ray_share(&self) -> f64 {
        self.rays_cast as f64 / (0.5 * self.ordered_pairs as f64).max(1.0)
    }

    /// Visibility calls without the graph, for each one with it.
    pub fn call_ratio(&self) -> f64 {
        self.calls_without_graph as f64 / self.calls_with_graph.max(1) as f64
    }
}

/// The two sets of figures side by side.
pub struct SideBySide<'a>(pub &'a PaperTables);

impl fmt::Display for SideBySide<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (p, o) = (&PAPER, self.0);
        let mut row =
            |what: &str, paper: String, ours: String| writeln!(f, "{what:<52} {paper:>14} {ours:>14}");
        let n = |x: u64| group(x);
        row("", "paper (1992)".into(), "luxgraph".into())?;
        row("polygons", n(p.surfaces), n(o.surfaces))?;
        row("sample points", n(p.points), n(o.points))?;
        row("  on specular surfaces", n(p.specular_points), n(o.specular_points))?;
        row("Table 1: the visibility graph", String::new(), String::new())?;
        row("  voxels", n(p.voxels), n(o.voxels))?;
        row("  empty voxels", n(p.empty_voxels), n(o.empty_voxels))?;
        row("  pairs of points (ordered)", n(p.ordered_pairs), n(o.ordered_pairs))?;
        row("  pairs of visible voxels", n(p.visible_edges), n(o.visible_edges))?;
        row("  pairs of hidden voxels", n(p.hidden_edges), n(o.hidden_edges))?;
        row("  pairs of partially hidden voxels", n(p.partial_edges), n(o.partial_edges))?;
        row("  pairs of points stored", n(p.pairs_stored), n(o.pairs_stored))?;
        row("  graph computation time", duration(p.graph_s), duration(o.graph_s))?;
        row("  rays really cast", n(p.rays_cast), n(o.rays_cast))?;
        let share = |t: &PaperTables| format!("{:.2} %", 100.0 * t.ray_share());
        row("  as a share of the unordered pairs", share(p), share(o))?;
        row("Table 2: the extended form factors", String::new(), String::new())?;
        row(
            "  time with the graph (ours: with the solution)",
            duration(p.eff_with_graph_s),
            duration(o.eff_with_graph_s),
        )?;
        row("  time without it", duration(p.eff_without_graph_s), duration(o.eff_without_graph_s))?;
        row("  visibility calls with the graph", n(p.calls_with_graph), n(o.calls_with_graph))?;
        row("  visibility calls without it", n(p.calls_without_graph), n(o.calls_without_graph))?;
        let ratio = |t: &PaperTables| format!("{:.2}", t.call_ratio());
        row("  calls without it for each one with it", ratio(p), ratio(o))
    }
}

/// 1234567 as 1,234,567.
pub fn group(x: u64) -> String {
    let digits = x.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

/// Seconds, or minutes and hours where there are many.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..100 => format!("{seconds:.3} s"),
        100..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

/// Makes `calls` calls of the visibility function h the way a program without a graph has to,
/// each from a point of `sources` to each point in turn: same surface, facing, then a ray.
/// Returns the wall time, s, and the number of rays.
pub fn time_visibility_calls(
    geometry: &Geometry,
    points: &SamplePoints,
    tracer: &dyn RayTracer,
    sources: &[usize],
    calls: u64,
) -> (f64, u64) {
    let n = points.len() as u64;
    if sources.is_empty() || n == 0 {
        return (0.0, 0);
    }
    let started = Instant::now();
    let rows = calls.div_ceil(n);
    let rays = (0..rows)
        .into_par_iter()
        .map(|row| {
            let i = sources[row as usize % sources.len()];
            let targets = (calls - row * n).min(n) as usize;
            let segments: Vec<Segment> = (0..targets)
                .filter(|&j| face_each_other(geometry, points, i, j))
                .map(|j| Segment { from: points.position[i], to: points.position[j] })
                .collect();
            let mut blocked = vec![false; segments.len()];
            tracer.occluded_batch(&segments, &mut blocked);
            segments.len() as u64
        })
        .sum();
    (started.elapsed().as_secs_f64(), rays)
}

/// The points on surfaces for which `specular` holds.
pub fn specular_points(points: &SamplePoints, specular: impl Fn(SurfaceId) -> bool) -> Vec<usize> {
    (0..points.len()).filter(|&i| specular(points.surface[i])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_own_figures_agree_with_each_other() {
        assert_eq!(PAPER.ordered_pairs, PAPER.points * (PAPER.points - 1));
        assert_eq!(PAPER.calls_with_graph * 2, PAPER.ordered_pairs);
        let edges = PAPER.visible_edges + PAPER.hidden_edges + PAPER.partial_edges;
        assert_eq!(edges, PAPER.voxels * (PAPER.voxels - 1) / 2);
        assert!((PAPER.ray_share() - 0.173).abs() < 5e-4);
        assert!((PAPER.call_ratio() - 5.28).abs() < 0.01);
    }

    #[test]
    fn numbers_read_well() {
        assert_eq!(group(16_076_090), "16,076,090");
        assert_eq!(group(5), "5");
        assert_eq!(duration(PAPER.graph_s), "39 min 49 s");
        assert_eq!(duration(0.25), "0.250 s");
    }
}

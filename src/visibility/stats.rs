//! What a build counts, and the paper's Table 1.

use super::VisibilityGraph;
use serde::{Deserialize, Serialize};

/// Counters of one build, as in the paper's Tables 1 and 2. Pairs are unordered, and each is
/// counted in exactly one of `same_surface`, `not_facing`, `proved`, `last_blocker`, `direct` and
/// `rays_cast`, which add up to `pairs`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GraphStats {
    /// Edges of each kind.
    pub visible_edges: u64,
    /// Edges of each kind.
    pub hidden_edges: u64,
    /// Edges of each kind.
    pub partial_edges: u64,
    /// Pairs of points that the partial edges hold a bit for.
    pub pairs_stored: u64,
    /// All unordered pairs of points: the visibility calls the graph answers.
    pub pairs: u64,
    /// Pairs decided because they lie on the same surface.
    pub same_surface: u64,
    /// Pairs decided because one or both face away.
    pub not_facing: u64,
    /// Facing pairs decided by a proof for all of a tile at once.
    pub proved: u64,
    /// Facing pairs found hidden by the last blocker (buf-int).
    pub last_blocker: u64,
    /// Facing pairs decided by testing each of the few surfaces that can block them.
    pub direct: u64,
    /// Facing pairs for which a ray was cast.
    pub rays_cast: u64,
    /// Wall time of the build, s.
    pub build_s: f64,
}

impl GraphStats {
    /// Adds the pairs of another part of the same build; edges and time are left alone.
    pub(super) fn add_pairs(&mut self, other: &GraphStats) {
        self.pairs += other.pairs;
        self.same_surface += other.same_surface;
        self.not_facing += other.not_facing;
        self.proved += other.proved;
        self.last_blocker += other.last_blocker;
        self.direct += other.direct;
        self.rays_cast += other.rays_cast;
    }
}

/// The numbers of the paper's Table 1, and what they rest on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tables {
    /// Sample points, N.
    pub points: u64,
    /// Voxels.
    pub voxels: u64,
    /// Voxels without sample points.
    pub empty_voxels: u64,
    /// Ordered pairs of points, N (N - 1).
    pub ordered_pairs: u64,
    /// Pairs of voxels of which all facing points see each other.
    pub visible_edges: u64,
    /// Pairs of voxels that see nothing of each other.
    pub hidden_edges: u64,
    /// Pairs of voxels that see each other in part.
    pub partial_edges: u64,
    /// Pairs of points stored.
    pub pairs_stored: u64,
    /// Rays cast over unordered pairs: the paper's 1,394,017 of 8,038,045 are 0.173.
    pub ray_fraction: f64,
    /// Memory of the graph, bytes.
    pub graph_bytes: u64,
    /// Time to build it, s.
    pub graph_s: f64,
}

impl Tables {
    /// The numbers of `graph`.
    pub fn new(graph: &VisibilityGraph) -> Self {
        let points = u64::from(graph.starts.last().copied().unwrap_or(0));
        let stats = &graph.stats;
        Tables {
            points,
            voxels: graph.voxels() as u64,
            empty_voxels: graph.starts.windows(2).filter(|w| w[0] == w[1]).count() as u64,
            ordered_pairs: points * points.saturating_sub(1),
            visible_edges: stats.visible_edges,
            hidden_edges: stats.hidden_edges,
            partial_edges: stats.partial_edges,
            pairs_stored: stats.pairs_stored,
            ray_fraction: stats.rays_cast as f64 / stats.pairs.max(1) as f64,
            graph_bytes: graph.memory_bytes(),
            graph_s: stats.build_s,
        }
    }
}

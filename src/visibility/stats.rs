//! What a build counts.

use serde::{Deserialize, Serialize};

/// Counters of one build, as in the paper's Tables 1 and 2. Pairs are unordered, and each is
/// counted in exactly one of `same_surface`, `not_facing`, `proved`, `last_blocker`, `direct` and
/// `rays_cast`, which add up to `pairs`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GraphStats {
    /// Edges between voxels of which all facing points see each other, pairs of a voxel with itself
    /// included (as in the next two).
    pub visible_edges: u64,
    /// Edges between voxels of which no two facing points see each other.
    pub hidden_edges: u64,
    /// Edges between voxels that see each other in part.
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
    /// Facing pairs that see each other, but in an update those of edges that were copied whole.
    pub seen: u64,
    /// In an update: pairs whose answer was copied, all of those in edges that were copied whole included.
    pub copied: u64,
    /// Wall time of the build, s.
    pub build_s: f64,
}

impl GraphStats {
    /// Rays cast over unordered pairs: the paper's 1,394,017 of 8,038,045 are 0.173.
    pub fn ray_fraction(&self) -> f64 {
        self.rays_cast as f64 / self.pairs.max(1) as f64
    }

    /// Adds the pairs of another part of the same build; edges, sight and time are left alone.
    pub(super) fn add_pairs(&mut self, other: &GraphStats) {
        self.pairs += other.pairs;
        self.same_surface += other.same_surface;
        self.not_facing += other.not_facing;
        self.proved += other.proved;
        self.last_blocker += other.last_blocker;
        self.direct += other.direct;
        self.rays_cast += other.rays_cast;
        self.copied += other.copied;
    }
}

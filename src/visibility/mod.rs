//! The visibility graph (section 4.2): voxels are nodes, edges are pairs of voxels.
//!
//! [`VisibilityGraph::build`] decides every pair of sample points, most of them without a ray:
//! points of one surface and points that face away first, then whole tiles of two planar patches
//! by proofs, then the last blocker (the paper's buf-int) and the few surfaces that can block,
//! and only what is left by the ray tracer. [`mod@file`] keeps a graph for other runs. [`Links`] are what points see
//! of clusters of points, for scenes with too many points for all pairs.

mod against;
mod block;
mod blocker;
mod build;
mod cull;
pub mod file;
mod flat;
mod graph;
mod kept;
mod known;
mod lights;
mod link_search;
mod links;
mod pairs;
mod passing;
mod patch;
mod patches;
mod round;
mod sky;
mod stats;
mod through;
mod tile;
mod transpose;
mod update;
mod voxel_pair;

pub use build::GraphSettings;
pub use graph::{Edge, Tile, VisibilityGraph};
pub use lights::LightSight;
pub use links::{LinkSettings, LinkStats, Links};
pub use patches::Patches;
pub use sky::{SkyGaze, SkyPart, SkySight};
pub use stats::GraphStats;
pub use through::Passages;

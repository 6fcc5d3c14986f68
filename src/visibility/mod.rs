//! The visibility graph (section 4.2): voxels are nodes, edges are pairs of voxels.

mod graph;

pub use graph::{Edge, GraphStats, Tile, VisibilityGraph};

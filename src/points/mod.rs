//! Sample points (section 3.1.2): every surface is divided in four, recursively, and a point with
//! the area of its element stands at the centre of each.

mod by_light;
mod cell;
mod density;
pub mod facing;
mod groups;
mod hierarchy;
mod neighbours;
mod piece;
mod refine;
mod subdivide;

pub use by_light::{LightRefinement, LightRefiner};
pub use cell::Cell;
pub use density::area_factor_for;
pub use groups::{Group, groups};
pub use hierarchy::{Cluster, Hierarchy};
pub use neighbours::MAX_EXTRA_LEVELS;
pub use piece::{Middle, Piece};
pub use refine::{MAX_POINTS, refine, request_key, sample};
pub use subdivide::{Element, divide_by_area, element_area};

use crate::geometry::{Round, Side, SurfaceId};
use glam::Vec3;
use std::collections::BTreeMap;

/// When to stop dividing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// An element larger than this is divided, m².
    pub max_area: f64,
    /// Factor on every threshold of area, also on those that a scene sets for single objects: 4
    /// gives about a quarter of the points.
    pub area_factor: f64,
    /// The paper's second threshold: an element that a facing point could see under more than
    /// this solid angle is divided, sr.
    pub max_solid_angle: Option<f64>,
    /// Graph-driven refinement (4.2.2): the same, but only between points that see each other, sr.
    pub refine_solid_angle: Option<f64>,
    /// Cells at this depth are not divided; at most [`Cell::MAX_LEVEL`] counts.
    pub max_level: u8,
}

impl Sampling {
    /// Division by area alone.
    pub fn by_area(max_area: f64) -> Self {
        Sampling {
            max_area,
            area_factor: 1.0,
            max_solid_angle: None,
            refine_solid_angle: None,
            max_level: 12,
        }
    }
}

/// Index of a point that is not there.
pub const NO_POINT: u32 = u32::MAX;

/// All sample points, structure of arrays, sorted by voxel, then surface, side and cell.
#[derive(Clone, Debug, Default)]
pub struct SamplePoints {
    /// P_i, relative to the scene's centre, m. Never behind its own surface: where rounding would put
    /// it there it is lifted off by a unit in the last place.
    pub position: Vec<Vec3>,
    /// Unit normal on the point's own side.
    pub normal: Vec<Vec3>,
    /// δS_i, m².
    pub area: Vec<f32>,
    /// Corners of the element, counter-clockwise as seen from the point's own side; the last is
    /// repeated for a triangle. An element of what is no polygon is more than they tell: see
    /// [`SamplePoints::round`].
    pub corners: Vec<[Vec3; 4]>,
    /// The surface it lies on.
    pub surface: Vec<SurfaceId>,
    /// The side of the surface it lies on.
    pub side: Vec<Side>,
    /// The point at the same place (but for that lift) on the other side, or [`NO_POINT`].
    pub twin: Vec<u32>,
    /// The element, as a cell of the surface's quadtree.
    pub cell: Vec<Cell>,
    /// Those of the surfaces of the points that are no polygons.
    pub rounds: BTreeMap<SurfaceId, Round>,
    /// First point of each voxel, and at the end the number of points: `[voxels + 1]`.
    pub voxel_starts: Vec<u32>,
    /// Hash of the geometry and of the element and voxel of every point: a graph belongs to one key.
    pub key: [u8; 32],
}

impl SamplePoints {
    /// N.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Number of voxels, empty ones included.
    pub fn voxels(&self) -> usize {
        self.voxel_starts.len().saturating_sub(1)
    }

    /// The element of point `i`, if it is no polygon.
    #[inline]
    pub fn round(&self, i: usize) -> Option<Piece<'_>> {
        // Most scenes have none, and need not be asked about each point.
        if self.rounds.is_empty() {
            return None;
        }
        let round = self.rounds.get(&self.surface[i])?;
        Some(Piece { round, side: self.side[i], cell: self.cell[i] })
    }

    /// Whether points `i` and `j` lie on the same planar surface, and so cannot face each other.
    #[inline]
    pub fn share_plane(&self, i: usize, j: usize) -> bool {
        self.surface[i] == self.surface[j] && self.rounds.get(&self.surface[i]).is_none_or(Round::is_planar)
    }

    /// The points of voxel `v`.
    pub fn voxel(&self, v: usize) -> std::ops::Range<usize> {
        self.voxel_starts[v] as usize..self.voxel_starts[v + 1] as usize
    }
}

//! Which ray tracer a run uses.

use super::RayTracer;
use super::embree::{self, EmbreeTracer};
use super::voxel::VoxelTracer;
use crate::error::Result;
use crate::scene::Geometry;

/// The user's choice of tracer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TracerChoice {
    /// Embree where it is built in, else the voxel tracer.
    #[default]
    Auto,
    /// Intel Embree; an error where it is not built in.
    Embree,
    /// The paper's voxel walk.
    Voxel,
}

/// The chosen tracer over `geometry`.
///
/// # Errors
/// [`Error::Tracer`](crate::error::Error::Tracer) when Embree is chosen and not built in, or refuses the scene.
pub fn choose(choice: TracerChoice, geometry: &Geometry) -> Result<Box<dyn RayTracer + '_>> {
    let embree = match choice {
        TracerChoice::Auto => embree::available().is_some(),
        TracerChoice::Embree => true,
        TracerChoice::Voxel => false,
    };
    Ok(if embree { Box::new(EmbreeTracer::new(geometry)?) } else { Box::new(VoxelTracer::new(geometry)) })
}

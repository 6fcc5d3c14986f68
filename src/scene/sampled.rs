//! An appearance at the wavelengths of a run.

use super::MaterialId;
use crate::geometry::SurfaceId;
use crate::material::SampledMaterial;
use crate::spectrum::Wavelengths;

/// All materials as a run sees them.
#[derive(Clone, Debug)]
pub struct SampledAppearance {
    /// What everything is sampled at.
    pub wavelengths: Wavelengths,
    /// By [`MaterialId`].
    pub materials: Vec<SampledMaterial>,
    /// Per surface: its material.
    pub surface_material: Vec<MaterialId>,
}

impl SampledAppearance {
    /// The material of surface `id`.
    #[inline]
    pub fn of(&self, id: SurfaceId) -> &SampledMaterial {
        &self.materials[self.surface_material[id.index()].0 as usize]
    }
}

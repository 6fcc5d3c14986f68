//! An appearance at the wavelengths of a run.

use super::{Appearance, Geometry, MaterialId};
use crate::geometry::SurfaceId;
use crate::material::SampledMaterial;
use crate::spectrum::{Spectrum, Wavelengths};
use std::f64::consts::PI;

/// All materials as a run sees them.
#[derive(Clone, Debug)]
pub struct SampledAppearance {
    /// What everything is sampled at.
    pub wavelengths: Wavelengths,
    /// By [`MaterialId`].
    pub materials: Vec<SampledMaterial>,
    /// Per surface: its material.
    pub surface_material: Vec<MaterialId>,
    /// Spectral amount of each of [`Geometry::lights`] ([`LightSource::factor`](super::LightSource::factor)): `[W]` each.
    pub lights: Vec<Vec<f32>>,
}

impl SampledAppearance {
    /// The material of surface `id`.
    #[inline]
    pub fn of(&self, id: SurfaceId) -> &SampledMaterial {
        &self.materials[self.surface_material[id.index()].0 as usize]
    }
}

impl Appearance {
    /// All materials at `wavelengths` under the scene's own light ([`Wavelengths::under`]), with
    /// `fresnel_entries` angles in their tables (see [`DEFAULT_ENTRIES`](crate::material::DEFAULT_ENTRIES)). The
    /// luminous flux of a material is shared by all surfaces of `geometry` that wear it, both sides of
    /// those that are two-sided.
    pub fn sample(
        &self,
        geometry: &Geometry,
        wavelengths: &Wavelengths,
        fresnel_entries: usize,
    ) -> SampledAppearance {
        let areas = self.emitting_areas(geometry);
        let wavelengths = wavelengths.under(&self.light(geometry, &areas));
        SampledAppearance {
            materials: (self.materials.iter().zip(areas))
                .map(|(material, area)| material.sample(&wavelengths, fresnel_entries, area))
                .collect(),
            surface_material: self.surface_material.clone(),
            lights: (self.lights.iter().zip(&geometry.lights))
                .map(|(source, light)| source.sample(light, &wavelengths))
                .collect(),
            wavelengths,
        }
    }

    /// By material: the area of all surfaces that wear it, m², both sides of those that are two-sided.
    pub fn emitting_areas(&self, geometry: &Geometry) -> Vec<f64> {
        let mut areas = vec![0.0; self.materials.len()];
        for ((surface, two_sided), material) in
            geometry.surfaces.iter().zip(&geometry.two_sided).zip(&self.surface_material)
        {
            if let Some(area) = areas.get_mut(material.0 as usize) {
                *area += if *two_sided { 2.0 * surface.area } else { surface.area };
            }
        }
        areas
    }

    /// The flux of all that emits, W nm⁻¹, at 380, 381, ... 780 nm.
    fn light(&self, geometry: &Geometry, areas: &[f64]) -> Spectrum {
        let surfaces = self.materials.iter().zip(areas).filter_map(|(material, &area)| {
            let emission = material.emission.as_ref().filter(|_| area > 0.0)?;
            Some((&emission.spectrum, PI * area * emission.factor(area)))
        });
        let lights = self.lights.iter().zip(&geometry.lights);
        let lights =
            lights.map(|(source, light)| (&source.spectrum, light.flux_share() * source.factor(light)));
        Spectrum::sum(surfaces.chain(lights))
    }
}

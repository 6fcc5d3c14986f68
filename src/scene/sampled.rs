//! An appearance at the wavelengths of a run.

use super::{Appearance, Geometry, LightKind, MaterialId, SampledSky};
use crate::geometry::SurfaceId;
use crate::material::{SampledMaterial, Transmission};
use crate::spectrum::{Spectrum, Wavelengths};
use glam::DVec3;
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
    /// What the sky gives, if there is one.
    pub sky: Option<SampledSky>,
}

impl SampledAppearance {
    /// The material of surface `id`.
    #[inline]
    pub fn of(&self, id: SurfaceId) -> &SampledMaterial {
        &self.materials[self.surface_material[id.index()].0 as usize]
    }

    /// What light along `d` (unit) keeps on its straight way through `surfaces`, `[W]`; `None` if one is no pane.
    pub fn through(&self, geometry: &Geometry, surfaces: &[SurfaceId], d: DVec3) -> Option<Vec<f32>> {
        let w = self.wavelengths.len();
        let (mut through, mut share) = (vec![1.0; w], vec![0.0; w]);
        for &surface in surfaces {
            let Some(Transmission::Pane { transmit }) = &self.of(surface).transmission else { return None };
            let normal = geometry.surface(surface).plane()?.normal;
            transmit.eval(normal.dot(d).abs() as f32, &mut share);
            through.iter_mut().zip(&share).for_each(|(t, s)| *t *= s);
        }
        Some(through)
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
        let lights: Vec<Vec<f32>> = (self.lights.iter().zip(&geometry.lights))
            .map(|(source, light)| source.sample(light, &wavelengths))
            .collect();
        let sky = self.sky.as_ref().map(|sky| {
            let beams = geometry.lights.iter().zip(&lights).filter_map(|(light, amount)| match light.kind {
                LightKind::Directional { from, .. } => Some((from, &amount[..])),
                LightKind::Point { .. } => None,
            });
            sky.sample(&wavelengths, &beams.collect::<Vec<_>>())
        });
        SampledAppearance {
            materials: (self.materials.iter().zip(areas))
                .map(|(material, area)| material.sample(&wavelengths, fresnel_entries, area))
                .collect(),
            surface_material: self.surface_material.clone(),
            lights,
            sky,
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
        // What comes in from the sky is as much as fell on a disc as wide as the scene.
        let disc = PI * geometry.radius * geometry.radius;
        let sky = self.sky.iter().map(|sky| (&sky.spectrum, disc * sky.shape.horizontal() * sky.factor()));
        Spectrum::sum(surfaces.chain(lights).chain(sky))
    }
}

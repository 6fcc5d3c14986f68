//! Scenes with so many specular points that their lobes, which grow with the square of what each sees, are out of
//! reach.

use super::{DiffuseSolution, FirstPass};
use crate::error::Result;
use crate::material::{FresnelTable, SampledMaterial};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::SampledAppearance;

/// A first pass that, where more than `most_specular` points are specular, takes them as diffuse ones that reflect as
/// much: the light between surfaces keeps its amount but for the shadowing of rough facets, and loses its direction. Glass
/// reflects so too and lets nothing through. The solution is of diffuse light, as ever, and views show mirrors and
/// glass as they are.
pub struct Evenly<'a> {
    /// What computes the light.
    pub first_pass: Box<dyn FirstPass + 'a>,
    /// The sample points of the scene.
    pub points: &'a SamplePoints,
    /// With no more specular points than this nothing is changed.
    pub most_specular: usize,
}

/// How many of `points` are specular.
pub fn specular_points(points: &SamplePoints, appearance: &SampledAppearance) -> usize {
    points.surface.iter().filter(|&&s| appearance.of(s).is_specular()).count()
}

impl FirstPass for Evenly<'_> {
    fn light(&mut self, appearance: &SampledAppearance, observer: &dyn Observer) -> Result<DiffuseSolution> {
        let whole = appearance.surface_material.iter().all(|m| (m.0 as usize) < appearance.materials.len())
            && self.points.surface.iter().all(|s| s.index() < appearance.surface_material.len());
        if !whole || specular_points(self.points, appearance) <= self.most_specular {
            return self.first_pass.light(appearance, observer);
        }
        let materials = appearance.materials.iter().map(even).collect();
        let even = SampledAppearance { materials, ..appearance.clone() };
        let mut solution = self.first_pass.light(&even, observer)?;
        let w = solution.wavelengths.len();
        for (i, &surface) in self.points.surface.iter().enumerate() {
            let (real, taken) = (appearance.of(surface), even.of(surface));
            if !real.is_specular() {
                continue;
            }
            for k in 0..w {
                let share = if taken.diffuse[k] > 0.0 { real.diffuse[k] / taken.diffuse[k] } else { 0.0 };
                let at = i * w + k;
                let emitted = real.emission[k];
                solution.radiance[at] = emitted + share * (solution.radiance[at] - emitted).max(0.0);
                if let Some(parts) = &mut solution.parts {
                    parts.direct[at] *= share;
                }
            }
        }
        Ok(solution)
    }
}

/// A diffuse material that reflects as much.
fn even(material: &SampledMaterial) -> SampledMaterial {
    if !material.is_specular() {
        return material.clone();
    }
    let specular = hemispherical(&material.reflect, material.diffuse.len());
    let diffuse = material.diffuse.iter().zip(specular);
    let diffuse = diffuse.map(|(d, r)| (d + material.s as f32 * r).clamp(0.0, 1.0)).collect();
    SampledMaterial { diffuse, s: 0.0, transmission: None, ..material.clone() }
}

/// 2 ∫ F cos θ d cos θ: `[W]`.
fn hemispherical(table: &FresnelTable, w: usize) -> Vec<f32> {
    const STEPS: usize = 32;
    let (mut sum, mut at) = (vec![0.0; w], vec![0.0; w]);
    for k in 0..STEPS {
        let cos = (k as f32 + 0.5) / STEPS as f32;
        table.eval(cos, &mut at);
        sum.iter_mut().zip(&at).for_each(|(s, f)| *s += 2.0 * cos * f / STEPS as f32);
    }
    sum
}

//! Scenes with so many specular points that their lobes, which grow with the square of what each sees, are out of
//! reach.

use super::{DiffuseSolution, FirstPass};
use crate::error::Result;
use crate::geometry::Side;
use crate::material::{FresnelTable, SampledMaterial, Spread, Transmission};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::SampledAppearance;
use glam::DVec3;

/// A first pass that, where more than `most_specular` points are specular, takes them as diffuse ones that reflect and
/// transmit as much: the light between surfaces keeps its amount but for the shadowing of rough facets, and loses its
/// direction. So sunlight through glass falls in as skylight would, and a solid absorbs as much as over its mean chord each
/// time that light crosses it. The solution is of diffuse light, as ever, and views show mirrors and glass as they are.
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
        let chords = mean_chords(self.points, appearance);
        let materials = appearance.materials.iter().zip(chords).map(|(m, chord)| even(m, chord)).collect();
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
                    parts.specular[at] *= share;
                }
            }
        }
        Ok(solution)
    }
}

/// A diffuse material that reflects and transmits as much; the mean chord of the bodies that wear it is in m.
fn even(material: &SampledMaterial, mean_chord: f64) -> SampledMaterial {
    if !material.is_specular() {
        return material.clone();
    }
    let w = material.diffuse.len();
    let reflected = hemispherical(&material.reflect, w);
    let diffuse = material.diffuse.iter().zip(&reflected);
    let diffuse = diffuse.map(|(d, r)| (d + material.s as f32 * r).clamp(0.0, 1.0)).collect();
    let spread = material.transmission.as_ref().map(|glass| match glass {
        Transmission::Pane { transmit } => {
            let through = hemispherical(transmit, w);
            Spread { inwards: through.clone(), outwards: through, inside: reflected.clone() }
        }
        Transmission::Solid { n, absorption, .. } => {
            let inwards: Vec<f32> = reflected.iter().map(|r| 1.0 - r).collect();
            // The flux of even light that gets out is that which gets in, over n².
            let out = |k: usize| f64::from(inwards[k]) / (n * n);
            let left = |k: usize| (-f64::from(absorption[k]) * mean_chord).exp();
            Spread {
                outwards: (0..w).map(|k| (left(k) * out(k)) as f32).collect(),
                inside: (0..w).map(|k| (left(k) * (1.0 - out(k))) as f32).collect(),
                inwards,
            }
        }
    });
    SampledMaterial { diffuse, s: 0.0, transmission: None, spread, ..material.clone() }
}

/// 4 V/S (Cauchy) of what each material encloses, m; 0 where it encloses nothing.
fn mean_chords(points: &SamplePoints, appearance: &SampledAppearance) -> Vec<f64> {
    let mut chords = Vec::with_capacity(appearance.materials.len());
    let mut sums = vec![(DVec3::ZERO, 0.0, 0.0); appearance.materials.len()];
    for i in (0..points.len()).filter(|&i| points.side[i] == Side::Front) {
        let (facing, volume, area) =
            &mut sums[appearance.surface_material[points.surface[i].index()].0 as usize];
        let vector = f64::from(points.area[i]) * points.normal[i].as_dvec3();
        *facing += vector;
        *volume += vector.dot(points.position[i].as_dvec3()) / 3.0;
        *area += f64::from(points.area[i]);
    }
    for (facing, volume, area) in sums {
        // The fronts of a closed surface face all ways alike.
        let closed = facing.length() < 1e-2 * area && volume > 0.0;
        chords.push(if closed { 4.0 * volume / area } else { 0.0 });
    }
    chords
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

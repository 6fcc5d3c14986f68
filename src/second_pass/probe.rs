//! Specular light along rays that no camera sent.

use super::film::Film;
use super::interpolate::DiffuseField;
use super::ladder::Ladder;
use super::render::LitScene;
use super::scatter::Scatterer;
use super::settings::{Passes, Rung, SecondPassSettings};
use super::wave::{NO_MEDIUM, Path, Wave};
use crate::geometry::Ray;
use crate::tracers::RayTracer;

/// A path that would carry less than a thousandth of a mean ray ends by Russian roulette.
const SETTINGS: SecondPassSettings = SecondPassSettings {
    noise: None,
    passes: Passes::Both,
    rung: Rung::Interpolate,
    lamp_samples: 1,
    gather_samples: 1,
    samples: 1,
    lobe_samples: 8,
    max_depth: SecondPassSettings::MAX_DEPTH,
    tolerance: 1e-3,
    clamp: f64::INFINITY,
    seed: 0,
};

/// Rays of one Sobol' sequence, each with its lobe samples.
const SEQUENCE: u32 = (1 << 16) / SETTINGS.lobe_samples;

/// Follows rays as the pixels of an image do.
pub(crate) struct Probe<'a> {
    scatterer: Scatterer<'a>,
}

impl<'a> Probe<'a> {
    /// `field` is that of the scene.
    pub fn new(scene: &LitScene<'a>, field: &'a DiffuseField<'a>) -> Self {
        let ladder = Ladder { near: field, far: None, lamps_apart: false, direct: None };
        let scatterer =
            Scatterer::new(scene.geometry, scene.appearance, ladder, |_| 0.0, &SETTINGS, f32::INFINITY);
        Probe { scatterer }
    }

    /// Σ weight × specular radiance along `rays` (unit), `[W]`: what the surface that a ray meets first
    /// reflects or lets through specularly, not what it sends diffusely. Weights are of the order of
    /// 1. Every call draws the same numbers.
    pub fn specular(&self, tracer: &dyn RayTracer, rays: &[Ray], weights: &[f32]) -> Vec<f64> {
        let w = self.scatterer.appearance.wavelengths.len();
        let mut film = Film::new(vec![SETTINGS.seed], w);
        let (mut wave, mut next, mut hits) = (Wave::default(), Wave::default(), Vec::new());
        for (index, (ray, &weight)) in rays.iter().zip(weights).enumerate() {
            let path = Path {
                start: ray.origin,
                pixel: 0,
                index: index as u32 % SEQUENCE,
                depth: 0,
                splits: 0,
                glossy: false,
                bounces: 0,
                medium: NO_MEDIUM,
                density: f32::INFINITY,
                by_chance: false,
            };
            wave.push(*ray, path, std::iter::repeat_n(weight, w));
        }
        let mut first = true;
        while !wave.rays.is_empty() {
            hits.clear();
            hits.resize(wave.rays.len(), None);
            tracer.closest_batch(&wave.rays, &mut hits);
            self.scatterer.meet(&mut wave, &hits, &mut film, &mut next);
            if std::mem::take(&mut first) {
                film.radiance.fill(0.0);
            }
            std::mem::swap(&mut wave, &mut next);
        }
        film.radiance
    }
}

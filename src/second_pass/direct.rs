//! The rung `direct`: light straight from lamps, asked for at every place that a path meets.

use super::lamps::{Lamps, Source};
use super::scatter::{Film, Scatterer};
use super::sequence::draw;
use super::wave::Wave;
use crate::geometry::{Hit, Side};
use crate::scene::{Geometry, SampledAppearance};
use crate::tracers::{RayTracer, Segment};

/// Sets these numbers apart from those that choose a path.
const OTHER_SEED: u32 = 0x9e37_79b9;

/// Asks lamps for their light.
pub(super) struct Direct<'a> {
    geometry: &'a Geometry,
    appearance: &'a SampledAppearance,
    tracer: &'a dyn RayTracer,
    lamps: Lamps,
    /// Lamps asked at every place.
    samples: u32,
}

/// Segments to lamps, and the light that may come along them.
#[derive(Default)]
pub(super) struct Shadows {
    segments: Vec<Segment>,
    pixels: Vec<u32>,
    /// `[segments][W]`.
    light: Vec<f32>,
    blocked: Vec<bool>,
    chances: Vec<f64>,
}

impl<'a> Direct<'a> {
    /// Of a scene; `bright` tells how bright a spectrum is.
    pub fn new(
        geometry: &'a Geometry,
        appearance: &'a SampledAppearance,
        tracer: &'a dyn RayTracer,
        samples: u32,
        bright: impl Fn(&[f32]) -> f64,
    ) -> Self {
        Direct { geometry, appearance, tracer, lamps: Lamps::new(geometry, appearance, bright), samples }
    }

    /// Adds to the film what the lit places among those that the paths of `wave` meet reflect diffusely of the light of lamps.
    pub fn add(&self, scatterer: &Scatterer, wave: &Wave, hits: &[Option<Hit>], film: &mut Film) {
        if self.lamps.is_empty() {
            return;
        }
        let mut shadows = std::mem::take(&mut film.shadows);
        shadows.segments.clear();
        shadows.pixels.clear();
        shadows.light.clear();
        for k in film.lit.iter().map(|&k| k as usize) {
            if let Some(hit) = &hits[k] {
                self.ask(scatterer, (wave, k), hit, film, &mut shadows);
            }
        }
        let Shadows { segments, pixels, light, blocked, .. } = &mut shadows;
        film.stats.shadow_rays += segments.len() as u64;
        blocked.clear();
        blocked.resize(segments.len(), true);
        self.tracer.occluded_batch(segments, blocked);
        let w = self.appearance.wavelengths.len();
        for ((pixel, light), _) in
            pixels.iter().zip(light.chunks_exact(w)).zip(blocked).filter(|(_, blocked)| !**blocked)
        {
            let sum = &mut film.radiance[*pixel as usize * w..][..w];
            sum.iter_mut().zip(light).for_each(|(sum, l)| *sum += f64::from(*l));
        }
        film.shadows = shadows;
    }

    fn ask(
        &self,
        scatterer: &Scatterer,
        (wave, k): (&Wave, usize),
        hit: &Hit,
        film: &Film,
        shadows: &mut Shadows,
    ) {
        let (path, ray) = (&wave.paths[k], &wave.rays[k]);
        let material = self.appearance.of(hit.surface);
        let w = self.appearance.wavelengths.len();
        let throughput = &wave.throughput[k * w..][..w];
        let surface = self.geometry.surface(hit.surface);
        let met = ray.at(hit.t);
        let normal = surface.normal_at(met);
        let n = if hit.side == Side::Back { -normal } else { normal };
        let position = surface.project(met);
        let x = position + scatterer.start(hit.surface, position, n);
        for sample in 0..self.samples {
            let seed = film.seeds[path.pixel as usize] ^ OTHER_SEED;
            let index = path.index * self.samples + sample;
            let [u, v, t, _] = draw(index, path.depth + path.bounces, seed).map(f64::from);
            let Some(ask) = self.lamps.ask(self.geometry, (x, n), [u, v, t], &mut shadows.chances) else {
                continue;
            };
            let emission = match ask.source {
                Source::Surface(id) => &self.appearance.of(id).emission,
                Source::Light(k) => &self.appearance.lights[k],
            };
            // Of the irradiance a diffuse surface makes the radiance ρ/π E.
            let factor = (ask.weight / (std::f64::consts::PI * f64::from(self.samples))) as f32;
            let light = throughput.iter().zip(&material.diffuse).zip(emission);
            shadows.light.extend(light.map(|((t, rho), l)| factor * t * rho * l));
            shadows.pixels.push(path.pixel);
            shadows.segments.push(Segment { from: x.as_vec3(), to: ask.to.as_vec3() });
        }
    }
}

//! The rung `direct`: light straight from lamps, asked for at every place that a path meets.

use super::lamps::{Lamps, Source};
use super::scatter::{Film, Scatterer};
use super::sequence::draw;
use super::wave::Wave;
use crate::geometry::{Hit, Side};
use crate::scene::{Geometry, LightKind, SampledAppearance};
use crate::tracers::{RayTracer, Segment};
use crate::visibility::Passages;
use glam::DVec3;

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
    /// Whether there are surfaces with two sides, which may be panes.
    glazed: bool,
}

/// Segments to lamps, and the light that may come along them.
#[derive(Default)]
pub(super) struct Shadows {
    segments: Vec<Segment>,
    pixels: Vec<u32>,
    /// `[segments][W]`.
    light: Vec<f32>,
    /// Segments along directional light, their number and both ends: panes may let it through.
    beams: Vec<(usize, DVec3, DVec3)>,
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
        let lamps = Lamps::new(geometry, appearance, bright);
        Direct { geometry, appearance, tracer, lamps, samples, glazed: geometry.two_sided.contains(&true) }
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
        shadows.beams.clear();
        for k in film.lit.iter().map(|&k| k as usize) {
            if let Some(hit) = &hits[k] {
                self.ask(scatterer, (wave, k), hit, film, &mut shadows);
            }
        }
        let Shadows { segments, pixels, light, beams, blocked, .. } = &mut shadows;
        film.stats.shadow_rays += segments.len() as u64;
        blocked.clear();
        blocked.resize(segments.len(), true);
        self.tracer.occluded_batch(segments, blocked);
        let w = self.appearance.wavelengths.len();
        for &(k, from, to) in &*beams {
            if blocked[k]
                && let Some(through) = self.through(from, to)
            {
                light[k * w..][..w].iter_mut().zip(through).for_each(|(l, t)| *l *= t);
                blocked[k] = false;
            }
        }
        for ((pixel, light), _) in
            pixels.iter().zip(light.chunks_exact(w)).zip(blocked).filter(|(_, blocked)| !**blocked)
        {
            let sum = &mut film.radiance[*pixel as usize * w..][..w];
            sum.iter_mut().zip(light).for_each(|(sum, l)| *sum += f64::from(*l));
        }
        film.shadows = shadows;
    }

    /// What panes let through of directional light; `None` where anything else is in the way.
    fn through(&self, from: DVec3, to: DVec3) -> Option<Vec<f32>> {
        let list = Passages::walk(self.geometry, self.tracer, from, to)?;
        self.appearance.through(self.geometry, &list, (to - from).normalize())
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
            if let Source::Light(light) = ask.source
                && self.glazed
                && matches!(self.geometry.lights[light].kind, LightKind::Directional { .. })
            {
                shadows.beams.push((shadows.segments.len(), x, ask.to));
            }
            shadows.pixels.push(path.pixel);
            shadows.segments.push(Segment { from: x.as_vec3(), to: ask.to.as_vec3() });
        }
    }
}

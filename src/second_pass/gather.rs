//! The rung `gather`: light from diffuse surfaces, gathered over the hemisphere.

use super::film::Film;
use super::ladder::NEAR_BOUNCES;
use super::scatter::Scatterer;
use super::sequence::draw;
use super::wave::{Path, Wave};
use crate::geometry::{Hit, Ray, Side};
use std::f64::consts::TAU;

/// Sets these numbers apart from those that choose a path, and a lamp.
const OTHER_SEED: u32 = 0x85eb_ca6b;

impl Scatterer<'_> {
    /// Sends rays over the hemispheres of the places that ask for light.
    pub(super) fn gather(&self, wave: &Wave, hits: &[Option<Hit>], film: &mut Film, next: &mut Wave) {
        let gathering = std::mem::take(&mut film.gathering);
        for k in gathering.iter().map(|&k| k as usize) {
            if let Some(hit) = &hits[k] {
                self.send_over_hemisphere(wave, k, hit, film, next);
            }
        }
        film.gathering = gathering;
    }

    fn send_over_hemisphere(&self, wave: &Wave, k: usize, hit: &Hit, film: &mut Film, next: &mut Wave) {
        let (path, ray) = (&wave.paths[k], &wave.rays[k]);
        let w = self.appearance.wavelengths.len();
        let throughput = &wave.throughput[k * w..][..w];
        let material = self.appearance.of(hit.surface);
        let surface = self.geometry.surface(hit.surface);
        let met = ray.at(hit.t);
        let normal = surface.normal_at(met);
        let n = if hit.side == Side::Back { -normal } else { normal };
        let position = surface.project(met);
        // Later ones are as many as there are paths already.
        let rays = if path.bounces == 0 { self.settings.gather_samples } else { 1 };
        let (t, b) = n.any_orthonormal_pair();
        for ray in 0..rays {
            let index = path.index * rays + ray;
            let seed = film.seeds[path.pixel as usize] ^ OTHER_SEED;
            let [u, v, chance, _] = draw(index, path.depth + path.bounces, seed).map(f64::from);
            // In proportion to the cosine, so that all bring the same share of the irradiance.
            let (sin, cos) = (TAU * u).sin_cos();
            let direction = v.sqrt() * (cos * t + sin * b) + (1.0 - v).sqrt() * n;
            let share = 1.0 / rays as f32;
            let bright: f32 = self.bright_of(throughput, &material.diffuse) * share;
            if bright <= 0.0 {
                continue;
            }
            let survival =
                (f64::from(bright) / self.settings.tolerance.max(f64::MIN_POSITIVE)).min(1.0) as f32;
            if chance >= f64::from(survival) {
                film.stats.paths_ended += 1;
                continue;
            }
            let origin = position + self.start(hit.surface, position, n);
            let (bounces, density) = (path.bounces + 1, f32::INFINITY);
            let onward = Path { start: position, index, bounces, density, ..*path };
            let ray = Ray { origin, direction: direction.normalize(), t_min: 0.0, t_max: f64::INFINITY };
            next.push(
                ray,
                onward,
                throughput.iter().zip(&material.diffuse).map(|(t, d)| t * d * share / survival),
            );
            film.stats.gather_rays += 1;
        }
    }

    /// Whether a path that has left diffuse surfaces so often takes what the first pass has where it ends.
    #[inline(always)]
    pub(super) fn is_far(&self, bounces: u32, hit: &Hit) -> bool {
        bounces > NEAR_BOUNCES || hit.t > self.nearby(hit.surface)
    }
}

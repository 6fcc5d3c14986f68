//! What becomes of a wave of paths where they meet surfaces.

use super::direct::Direct;
use super::film::Film;
use super::ladder::{Ladder, NEARBY};
use super::settings::{Passes, SecondPassSettings};
use super::shading::Shading;
use super::take::{Manner, Take};
use super::wave::{Wave, inset, ray_offset};
use crate::geometry::{Hit, SurfaceId};
use crate::material::Transmission;
use crate::scene::{Geometry, SampledAppearance};
use crate::simd::widest;
use glam::DVec3;

/// A lobe of less slope than this asks no lamps: its own rays meet what it shows.
pub const ROUGH: f64 = 0.01;

/// The parts of a render that all tiles share.
pub(super) struct Scatterer<'a> {
    pub geometry: &'a Geometry,
    pub appearance: &'a SampledAppearance,
    pub ladder: Ladder<'a>,
    pub settings: &'a SecondPassSettings,
    /// By surface.
    pub manners: Vec<Manner>,
    /// Smooth normals of what is specular.
    pub shading: Shading,
    /// Hemisphere rays that end on a surface after no more than this end nearby, by surface, m.
    nearby: Vec<f64>,
    /// How far above a surface rays start, by surface, m.
    pub offset: Vec<f64>,
    /// Towards which place rays start aside, and by which share of the way, by surface: what is met just beyond an
    /// edge would else begin on the wrong side of the surface that joins there.
    pub inset: Vec<(DVec3, f64)>,
    /// Share of each wavelength in the brightness by which paths are chosen, sum 1.
    brightness: Vec<f32>,
    /// [`limit`](super::clamp::limit).
    limit: f32,
}

impl<'a> Scatterer<'a> {
    pub fn new(
        geometry: &'a Geometry,
        appearance: &'a SampledAppearance,
        ladder: Ladder<'a>,
        spacing: impl Fn(SurfaceId) -> f64,
        settings: &'a SecondPassSettings,
        limit: f32,
    ) -> Self {
        let surfaces = || (0..geometry.surfaces.len()).map(|s| SurfaceId(s as u32));
        let offset: Vec<f64> = surfaces().map(|s| ray_offset(geometry, s)).collect();
        let inset = surfaces().zip(&offset).map(|(s, offset)| inset(geometry, s, *offset)).collect();
        let asks = ladder.direct.is_some();
        let manners = surfaces().map(|s| {
            let material = appearance.of(s);
            let glass = &material.transmission;
            let diffuse = material.diffuse.iter().any(|&d| d > 0.0);
            Manner {
                black_behind: glass.is_none() && !geometry.two_sided[s.index()],
                solid: matches!(glass, Some(Transmission::Solid { .. })),
                goes_on: settings.passes == Passes::Both && material.is_specular(),
                asks: asks && ladder.lamps_apart && diffuse,
                gathers: ladder.far.is_some() && diffuse,
                gloss: asks
                    && settings.passes == Passes::Both
                    && glass.is_none()
                    && material.is_specular()
                    && material.m >= ROUGH,
                glows: material.emission.iter().any(|&l| l > 0.0),
                glows_apart: ladder.lamps_apart,
            }
        });
        let manners: Vec<Manner> = manners.collect();
        Scatterer {
            shading: Shading::new(geometry, |s| manners[s.index()].goes_on),
            manners,
            geometry,
            appearance,
            nearby: surfaces().map(|s| NEARBY * spacing(s)).collect(),
            ladder,
            settings,
            offset,
            inset,
            brightness: brightness(&appearance.wavelengths.xyz_weights),
            limit,
        }
    }

    /// Adds what the paths of `wave` see at `hits` to the film, and fills `next` with what they send on. Rays are
    /// unit; throughputs are spent.
    pub fn meet(&self, wave: &mut Wave, hits: &[Option<Hit>], film: &mut Film, next: &mut Wave) {
        next.clear();
        film.going_on.clear();
        film.lit.clear();
        film.gathering.clear();
        film.glowing.clear();
        film.missed.clear();
        widest(Take { scatterer: self, wave, hits, film });
        let w = film.value.len();
        self.see_sky(wave, film);
        if let Some(direct) = &self.ladder.direct {
            self.glow(direct, wave, hits, film);
            direct.add(self, wave, hits, film);
        }
        if self.ladder.far.is_some() {
            wave.spell_out(w);
            self.gather(wave, hits, film, next);
        }
        let going_on = std::mem::take(&mut film.going_on);
        let whole = vec![1.0; w];
        for k in going_on.iter().map(|&k| k as usize) {
            let throughput = wave.throughput.get(k * w..(k + 1) * w).unwrap_or(&whole);
            if let Some(hit) = &hits[k] {
                self.go_on(&wave.rays[k], hit, wave.path(k), throughput, film, next);
            }
        }
        film.going_on = going_on;
    }

    /// Adds to the film what paths see that leave the scene.
    fn see_sky(&self, wave: &Wave, film: &mut Film) {
        let Some(sky) = &self.appearance.sky else { return };
        let w = film.value.len();
        for k in film.missed.iter().map(|&k| k as usize) {
            let sums = film.radiance[wave.pixel(k) * w..][..w].iter_mut();
            let seen = sums.zip(sky.radiance(wave.rays[k].direction));
            match wave.throughput.get(k * w..(k + 1) * w) {
                None => seen.for_each(|(sum, l)| *sum += f64::from(l)),
                Some(t) => seen.zip(t).for_each(|((sum, l), t)| *sum += f64::from(t * l)),
            }
        }
    }

    /// Adds to the film what the places emit that paths meet, as far as it is to be found so and not there yet.
    fn glow(&self, direct: &Direct, wave: &Wave, hits: &[Option<Hit>], film: &mut Film) {
        let w = film.value.len();
        for k in film.glowing.iter().map(|&k| k as usize) {
            let Some(hit) = &hits[k] else { continue };
            let met = (&wave.rays[k], wave.density(k));
            let mut by_ray = direct.share_by_ray(met, hit, &mut film.shadows.chances);
            let emission = &self.appearance.of(hit.surface).emission;
            if wave.by_chance(k) {
                let brought = self.bright_of(&wave.throughput[k * w..][..w], emission);
                by_ray = (self.limit / brought).min(1.0);
                film.stats.by_chance_share += f64::from(brought);
                film.stats.clamped_share += f64::from((1.0 - by_ray) * brought);
            }
            let share = if self.ladder.lamps_apart { by_ray } else { by_ray - 1.0 };
            let sums = film.radiance[wave.pixel(k) * w..][..w].iter_mut().zip(emission);
            match wave.throughput.get(k * w..(k + 1) * w) {
                None => sums.for_each(|(sum, l)| *sum += f64::from(share * l)),
                Some(t) => sums.zip(t).for_each(|((sum, l), t)| *sum += f64::from(share * t * l)),
            }
        }
    }

    /// [`Scatterer::bright`] of what a path in a medium would carry outside it.
    pub fn importance(&self, throughput: &[f32], medium: u32) -> f32 {
        let solid = self.appearance.materials.get(medium as usize).and_then(|m| m.transmission.as_ref());
        let n2 = match solid {
            Some(Transmission::Solid { n, .. }) => (n * n) as f32,
            _ => 1.0,
        };
        n2 * self.bright(throughput)
    }

    fn bright(&self, throughput: &[f32]) -> f32 {
        throughput.iter().zip(&self.brightness).map(|(t, b)| t * b).sum()
    }

    /// [`Scatterer::bright`] of what is left of a throughput where this share is reflected.
    pub fn bright_of(&self, throughput: &[f32], share: &[f32]) -> f32 {
        throughput.iter().zip(share).zip(&self.brightness).map(|((t, s), b)| t * s * b).sum()
    }

    /// By how much a ray starts beside a place on a surface, on the side of `n`.
    pub fn start(&self, surface: SurfaceId, position: DVec3, n: DVec3) -> DVec3 {
        let (centre, share) = self.inset[surface.index()];
        share * (centre - position) + self.offset[surface.index()] * n
    }

    /// No longer hemisphere ray that ends on a surface ends nearby, m.
    #[inline(always)]
    pub fn nearby(&self, surface: SurfaceId) -> f64 {
        self.nearby[surface.index()]
    }
}

/// Weights by which the brightness of a throughput is judged: how much each wavelength matters to
/// X, Y and Z together, and for none nothing, so that no light can be dropped.
pub(super) fn brightness(xyz: &[[f64; 3]]) -> Vec<f32> {
    let matter: Vec<f64> = xyz.iter().map(|w| w.iter().map(|x| x.abs()).sum()).collect();
    let total: f64 = matter.iter().sum();
    let even = 1.0 / matter.len() as f64;
    let share = |m: f64| if total > 0.0 { m / total } else { even };
    matter.into_iter().map(|m| (0.9 * share(m) + 0.1 * even) as f32).collect()
}

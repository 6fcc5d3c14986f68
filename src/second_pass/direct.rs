//! Light straight from lamps, asked for at the places that paths meet: what these reflect diffusely, from the rung
//! `direct` on, and what rough lobes reflect, on every rung.
//!
//! A lamp in a lobe is found in two ways, by the rays that the lobe sends and by asking it. Neither is good alone: few
//! rays of a broad lobe meet a small lamp, few places on a large lamp lie in a narrow lobe. Each counts by the power
//! heuristic (E. Veach and L. Guibas, *Optimally Combining Sampling Techniques for Monte Carlo Rendering*, 1995).

use super::film::Film;
use super::lamps::{Ask, Lamps, Source};
use super::lobe::{lobe_density, lobe_weight};
use super::scatter::Scatterer;
use super::sequence::draw;
use super::wave::{NO_MEDIUM, Wave};
use crate::geometry::{Hit, Ray, Side};
use crate::material::SampledMaterial;
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
    /// Whether for what is reflected diffusely.
    diffuse: bool,
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
    pub chances: Vec<f64>,
}

impl<'a> Direct<'a> {
    /// Of a scene; `bright` tells how bright a spectrum is. `None` where nothing emits.
    pub fn new(
        (geometry, appearance): (&'a Geometry, &'a SampledAppearance),
        tracer: &'a dyn RayTracer,
        (samples, diffuse): (u32, bool),
        bright: impl Fn(&[f32]) -> f64,
    ) -> Option<Self> {
        let lamps = Lamps::new(geometry, appearance, bright);
        let glazed = geometry.two_sided.contains(&true);
        let direct = Direct { geometry, appearance, tracer, lamps, samples, diffuse, glazed };
        (!direct.lamps.is_empty()).then_some(direct)
    }

    /// How much of the emission counts that a path meets at the end of `ray`, which left a rough lobe so densely,
    /// 1/sr: the rest comes by asking.
    pub fn share_by_ray(&self, (ray, density): (&Ray, f32), hit: &Hit, chances: &mut Vec<f64>) -> f32 {
        if density.is_infinite() {
            return 1.0;
        }
        let place = self.geometry.surface(hit.surface).project(ray.at(hit.t));
        let asked = self.lamps.density(self.geometry, ray.origin, (hit.surface, hit.side, place), chances);
        power_heuristic(f64::from(density), f64::from(self.samples) * asked) as f32
    }

    /// Adds to the film what the lit places among those that the paths of `wave` meet reflect of the light of lamps.
    pub fn add(&self, scatterer: &Scatterer, wave: &Wave, hits: &[Option<Hit>], film: &mut Film) {
        if film.lit.is_empty() {
            return;
        }
        let mut shadows = std::mem::take(&mut film.shadows);
        shadows.segments.clear();
        shadows.pixels.clear();
        shadows.light.clear();
        shadows.beams.clear();
        let lit = std::mem::take(&mut film.lit);
        for k in lit.iter().map(|&k| k as usize) {
            if let Some(hit) = &hits[k] {
                self.ask(scatterer, (wave, k), hit, film, &mut shadows);
            }
        }
        film.lit = lit;
        let Shadows { segments, pixels, light, beams, blocked, .. } = &mut shadows;
        film.stats.shadow_rays += segments.len() as u64;
        blocked.clear();
        blocked.resize(segments.len(), true);
        self.tracer.occluded_batch(segments, blocked);
        let w = self.appearance.wavelengths.len();
        for &(k, from, to) in &*beams {
            if blocked[k]
                && let Some(through) = Passages::light(self.geometry, self.appearance, self.tracer, from, to)
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

    fn ask(
        &self,
        scatterer: &Scatterer,
        (wave, k): (&Wave, usize),
        hit: &Hit,
        film: &mut Film,
        shadows: &mut Shadows,
    ) {
        let (path, ray) = (wave.path(k), &wave.rays[k]);
        let material = self.appearance.of(hit.surface);
        let w = self.appearance.wavelengths.len();
        let surface = self.geometry.surface(hit.surface);
        let met = ray.at(hit.t);
        let normal = surface.normal_at(met);
        let n = if hit.side == Side::Back { -normal } else { normal };
        let position = surface.project(met);
        let x = position + scatterer.start(hit.surface, position, n);
        let lobe =
            (path.bounces == 0 && scatterer.manners[hit.surface.index()].gloss && path.medium == NO_MEDIUM)
                .then(|| Lobe {
                    material,
                    i: -ray.direction,
                    n: scatterer.smooth(hit, position, n, -ray.direction),
                    rays: f64::from(scatterer.lobe_rays(&path)),
                });
        if !self.diffuse && lobe.is_none() {
            return;
        }
        for sample in 0..self.samples {
            let seed = film.seeds[path.pixel as usize] ^ OTHER_SEED;
            let index = path.index * self.samples + sample;
            let [u, v, t, _] = draw(index, path.depth + path.bounces, seed).map(f64::from);
            // By which normal a lamp was chosen has to be known again where a ray of the lobe meets one.
            let towards = if lobe.is_some() { None } else { Some(n) };
            let Some(ask) = self.lamps.ask(self.geometry, (x, towards), [u, v, t], &mut shadows.chances)
            else {
                continue;
            };
            let cosine = n.dot(ask.direction);
            if cosine.is_nan() || cosine <= 0.0 {
                continue;
            }
            let emission = match ask.source {
                Source::Surface(id) => &self.appearance.of(id).emission,
                Source::Light(k) => &self.appearance.lights[k],
            };
            let share = ask.share / f64::from(self.samples);
            let specular = match &lobe {
                Some(lobe) => share * lobe.over_fresnel(&ask, f64::from(self.samples), &mut film.value),
                None => 0.0,
            } as f32;
            // Of the irradiance a diffuse surface makes the radiance ρ/π E.
            let diffuse = if self.diffuse { cosine * share / std::f64::consts::PI } else { 0.0 } as f32;
            if diffuse == 0.0 && specular == 0.0 {
                continue;
            }
            let reflected = material.diffuse.iter().zip(&film.value).zip(emission);
            let reflected = reflected.map(|((rho, f), l)| {
                let lobe = if specular > 0.0 { specular * f } else { 0.0 };
                (diffuse * rho + lobe) * l
            });
            match wave.throughput.get(k * w..(k + 1) * w) {
                None => shadows.light.extend(reflected),
                Some(throughput) => shadows.light.extend(reflected.zip(throughput).map(|(l, t)| l * t)),
            }
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

/// A rough lobe as lamps are asked for its light.
struct Lobe<'a> {
    material: &'a SampledMaterial,
    /// Towards where the path comes from, unit.
    i: DVec3,
    /// The normal about which the lobe's rays are drawn.
    n: DVec3,
    /// How many these are.
    rays: f64,
}

impl Lobe<'_> {
    /// R^s cos θ_r over F, 1/sr, of what was asked, as far as it counts beside the lobe's own rays when it is one of
    /// so many; F goes into `fresnel`.
    fn over_fresnel(&self, ask: &Ask, samples: f64, fresnel: &mut [f32]) -> f64 {
        let Lobe { material, i, n, rays } = self;
        let h = (*i + ask.direction).normalize_or_zero();
        let own = lobe_density(*i, h, *n, material.m);
        let value = material.s * lobe_weight(*i, ask.direction, h, *n) * own;
        if value.is_nan() || value <= 0.0 {
            return 0.0;
        }
        material.reflect.eval(i.dot(h) as f32, fresnel);
        value * power_heuristic(samples * ask.density, rays * own)
    }
}

/// What the density for which rays of a lobe count is, as paths carry it: that of all its rays.
pub(super) fn carried(i: DVec3, h: DVec3, n: DVec3, m: f64, rays: u32) -> f32 {
    (f64::from(rays) * lobe_density(i, h, n, m)) as f32
}

/// Share of the first of two ways to find light, by their densities: the power heuristic.
pub fn power_heuristic(own: f64, other: f64) -> f64 {
    if own.is_infinite() {
        return 1.0;
    }
    let ratio = other / own;
    if ratio.is_nan() { 0.0 } else { 1.0 / (1.0 + ratio * ratio) }
}

//! Paths of one replicate, traced together: all of some pixels, one event after the other.

use super::asks::Asks;
use super::bsdf::Opaque;
use super::emitters::Emitters;
use super::events::Room;
use crate::geometry::{Hit, Ray, SurfaceId};
use crate::material::{SampledMaterial, Transmission};
use crate::scene::{Camera, Geometry, SampledAppearance, View};
use crate::second_pass::{NO_MEDIUM, inset, mix, ray_offset};
use crate::spectrum::LUMENS_PER_WATT;
use crate::tracers::RayTracer;
use glam::DVec3;
use std::ops::Range;

/// A surface nearer to the eye is the one it stands on, as a fraction of the scene's radius.
const NEAR: f64 = 1e-12;

/// Sets of four Sobol' dimensions that an event takes.
const SETS: u32 = 3;

/// What all paths share.
pub struct Tracing<'a> {
    pub geometry: &'a Geometry,
    pub appearance: &'a SampledAppearance,
    pub tracer: &'a dyn RayTracer,
    pub emitters: &'a Emitters,
    pub seed: u32,
    /// How far above a surface rays start, by surface, m.
    pub offset: Vec<f64>,
    /// Towards which place rays start aside, and by which share of the way, by surface.
    pub inset: Vec<(DVec3, f64)>,
    /// cd m⁻² per W m⁻² sr⁻¹ nm⁻¹ of each wavelength.
    pub luminance: Vec<f64>,
    /// Share of each wavelength where a path chooses, sum 1.
    pub brightness: Vec<f64>,
}

/// Where the paths of an image begin.
pub struct Eye {
    view: View,
    width: usize,
}

impl Eye {
    /// Of a camera.
    pub fn new(geometry: &Geometry, camera: &Camera) -> Self {
        Eye { view: camera.view(geometry.centre), width: camera.resolution[0] as usize }
    }
}

/// One image of independent randomness, as far as some pixels go.
pub struct Replicate {
    /// `[pixels][W]`.
    pub radiance: Vec<f64>,
    /// Rays that looked for the next surface.
    pub rays: u64,
    /// Rays that looked for a light.
    pub shadow_rays: u64,
    /// Longest path, events.
    pub longest: u32,
}

/// A path but for its ray and throughput.
#[derive(Clone, Copy)]
pub struct Path {
    /// Pixel among those at hand.
    pub pixel: u32,
    /// Which point of the sequence it follows, and by which seed.
    pub index: u32,
    pub seed: u32,
    /// Where the segment leaves its surface, m.
    pub start: DVec3,
    /// Events so far.
    pub depth: u32,
    /// Material of the solid it is in, or [`NO_MEDIUM`].
    pub medium: u32,
    /// Density of its direction, 1/sr; infinite where no light could have been asked.
    pub density: f64,
}

/// Rays under way, and the light that may reach them.
#[derive(Default)]
pub struct Wave {
    pub rays: Vec<Ray>,
    pub paths: Vec<Path>,
    pub throughput: Vec<f64>,
    pub asks: Asks,
}

impl Wave {
    pub fn clear(&mut self) {
        self.rays.clear();
        self.paths.clear();
        self.throughput.clear();
    }
}

impl<'a> Tracing<'a> {
    /// Of one scene.
    pub fn new(
        geometry: &'a Geometry,
        appearance: &'a SampledAppearance,
        tracer: &'a dyn RayTracer,
        emitters: &'a Emitters,
        seed: u32,
    ) -> Self {
        let surfaces = || (0..geometry.surfaces.len()).map(|s| SurfaceId(s as u32));
        let offset: Vec<f64> = surfaces().map(|s| ray_offset(geometry, s)).collect();
        let xyz = &appearance.wavelengths.xyz_weights;
        let even = 1.0 / xyz.len() as f64;
        let matter: Vec<f64> = xyz.iter().map(|w| w.iter().map(|x| x.abs()).sum()).collect();
        let total: f64 = matter.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        Tracing {
            geometry,
            appearance,
            tracer,
            emitters,
            seed,
            inset: surfaces().zip(&offset).map(|(s, offset)| inset(geometry, s, *offset)).collect(),
            offset,
            luminance: xyz.iter().map(|w| LUMENS_PER_WATT * w[1]).collect(),
            brightness: matter.iter().map(|m| 0.9 * m / total + 0.1 * even).collect(),
        }
    }

    /// W.
    pub fn wavelengths(&self) -> usize {
        self.luminance.len()
    }

    /// cd m⁻².
    pub fn luminance(&self, radiance: &[f64]) -> f64 {
        radiance.iter().zip(&self.luminance).map(|(l, y)| l * y).sum()
    }

    pub fn bright(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.brightness).map(|(v, b)| v * b).sum()
    }

    /// The material of the solid around a path.
    pub fn solid(&self, medium: u32) -> Option<&SampledMaterial> {
        self.appearance.materials.get(medium as usize)
    }

    /// n² of what is around a path: radiance over it stays the same on the way through glass.
    pub fn n2(&self, medium: u32) -> f64 {
        match self.solid(medium).and_then(|m| m.transmission.as_ref()) {
            Some(Transmission::Solid { n, .. }) => n * n,
            _ => 1.0,
        }
    }

    /// Beer-Lambert over `length`, m.
    pub fn absorb(&self, solid: Option<&SampledMaterial>, length: f64, values: &mut [f64]) {
        if let Some(Transmission::Solid { absorption, .. }) = solid.and_then(|m| m.transmission.as_ref()) {
            for (value, a) in values.iter_mut().zip(absorption) {
                *value *= (-f64::from(*a) * length).exp();
            }
        }
    }
}

/// Four uniform numbers of a path's event.
pub fn uniform(path: &Path, set: u32) -> [f64; 4] {
    let set = path.depth * SETS + set + 1;
    // Beyond the dimensions there are, the same ones under another seed.
    let turn = set / sobol_burley::NUM_DIMENSION_SETS_4D;
    let seed = if turn == 0 { path.seed } else { mix(path.seed ^ mix(turn)) };
    sobol_burley::sample_4d(path.index, set % sobol_burley::NUM_DIMENSION_SETS_4D, seed).map(f64::from)
}

/// The seed of a pixel's or a sensor's paths in one replicate.
pub fn seed_of(tracing: &Tracing, pixel: usize, number: u32) -> u32 {
    mix(pixel as u32 ^ mix(tracing.seed.wrapping_add(mix(number + 1))))
}

impl Replicate {
    /// Of nothing yet, for so many pixels.
    pub fn dark(tracing: &Tracing, pixels: usize) -> Replicate {
        Replicate { radiance: vec![0.0; pixels * tracing.wavelengths()], rays: 0, shadow_rays: 0, longest: 0 }
    }

    /// Traces `samples` paths of each of `pixels`.
    pub fn trace(tracing: &Tracing, eye: &Eye, pixels: Range<usize>, number: u32, samples: u32) -> Replicate {
        let w = tracing.wavelengths();
        let mut replicate = Replicate::dark(tracing, pixels.len());
        let (mut wave, mut next) = (Wave::default(), Wave::default());
        for index in 0..samples {
            wave.clear();
            for (k, pixel) in pixels.clone().enumerate() {
                let seed = seed_of(tracing, pixel, number);
                let [dx, dy, ..] = sobol_burley::sample_4d(index, 0, seed).map(f64::from);
                let (x, y) = (pixel % eye.width, pixel / eye.width);
                let ray = eye.view.ray(x as f64 + dx, y as f64 + dy);
                wave.rays.push(Ray { t_min: NEAR * tracing.geometry.radius, ..ray });
                wave.paths.push(Path {
                    pixel: k as u32,
                    index,
                    seed,
                    start: ray.origin,
                    depth: 0,
                    medium: NO_MEDIUM,
                    density: f64::INFINITY,
                });
            }
            wave.throughput.resize(wave.rays.len() * w, 1.0);
            replicate.follow(tracing, &mut wave, &mut next);
        }
        replicate.radiance.iter_mut().for_each(|l| *l /= f64::from(samples));
        replicate
    }

    /// Follows all paths of `wave` to their ends.
    pub fn follow(&mut self, tracing: &Tracing, wave: &mut Wave, next: &mut Wave) {
        while !wave.rays.is_empty() {
            self.advance(tracing, wave, next);
            std::mem::swap(wave, next);
        }
    }

    /// Traces all rays of `wave`, gathers what they find, and fills `next` with those that follow.
    fn advance(&mut self, tracing: &Tracing, wave: &mut Wave, next: &mut Wave) {
        let w = tracing.wavelengths();
        next.clear();
        let mut hits: Vec<Option<Hit>> = vec![None; wave.rays.len()];
        tracing.tracer.closest_batch(&wave.rays, &mut hits);
        self.rays += wave.rays.len() as u64;
        wave.asks.clear();
        let mut room = Room { value: vec![0.0; w], fresnel: vec![0.0; w], other: vec![0.0; w] };
        let throughputs = wave.throughput.chunks_exact_mut(w);
        for (((ray, path), hit), throughput) in wave.rays.iter().zip(&wave.paths).zip(&hits).zip(throughputs)
        {
            let Some(hit) = hit else {
                if let Some(sky) = &tracing.appearance.sky {
                    let sum = &mut self.radiance[path.pixel as usize * w..][..w];
                    for ((sum, t), l) in sum.iter_mut().zip(&*throughput).zip(sky.radiance(ray.direction)) {
                        *sum += t * f64::from(l);
                    }
                }
                continue;
            };
            let Some(met) = tracing.meet(ray, hit, path, throughput) else { continue };
            self.longest = self.longest.max(path.depth + 1);
            let sum = &mut self.radiance[path.pixel as usize * w..][..w];
            tracing.gather(&met, ray, hit, throughput, sum);
            match &met.material.transmission {
                Some(glass) => tracing.glass(&met, glass, throughput, &mut room, next),
                None => {
                    let n = met.n;
                    let specular = tracing.specular_chance(&met, &mut room);
                    let at = Opaque { material: met.material, i: met.i, n, specular };
                    if at.scatters() {
                        tracing.ask(&met, &at, throughput, &mut room, &mut wave.asks);
                    }
                    if let Some(drawn) = at.draw(uniform(path, 1), &mut room.value, &mut room.fresnel) {
                        room.value.iter_mut().zip(&*throughput).for_each(|(v, t)| *v *= t);
                        let path = Path { density: drawn.density, ..met.path };
                        tracing.send(&met, path, drawn.direction, 1.0, &room.value, next);
                    }
                }
            }
        }
        self.shadow_rays += wave.asks.arrive(tracing, &mut self.radiance);
    }
}

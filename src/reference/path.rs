//! Paths of one replicate, traced together: all of some pixels, one event after the other.

use super::bsdf::Opaque;
use super::emitters::{Emitters, Origin};
use crate::geometry::{Hit, Ray, Side, SurfaceId};
use crate::material::{SampledMaterial, Transmission};
use crate::scene::{Camera, Geometry, SampledAppearance, View};
use crate::second_pass::{NO_MEDIUM, inset, ray_offset, reflect, refract};
use crate::spectrum::LUMENS_PER_WATT;
use crate::tracers::{RayTracer, Segment};
use glam::DVec3;
use std::ops::Range;

/// Events before roulette begins.
const SURE: u32 = 3;

/// No path goes on with a greater chance once roulette has begun: between perfect mirrors it would never end.
const MOST: f64 = 0.97;

/// A surface nearer to the eye is the one it stands on, as a fraction of the scene's radius.
const NEAR: f64 = 1e-12;

/// Sets of four Sobol' dimensions that an event takes.
const SETS: u32 = 3;

/// What all paths share.
pub struct Tracing<'a> {
    geometry: &'a Geometry,
    appearance: &'a SampledAppearance,
    tracer: &'a dyn RayTracer,
    emitters: &'a Emitters,
    view: View,
    width: usize,
    seed: u32,
    /// How far above a surface rays start, by surface, m.
    offset: Vec<f64>,
    /// Towards which place rays start aside, and by which share of the way, by surface.
    inset: Vec<(DVec3, f64)>,
    /// cd m⁻² per W m⁻² sr⁻¹ nm⁻¹ of each wavelength.
    luminance: Vec<f64>,
    /// Share of each wavelength where a path chooses, sum 1.
    brightness: Vec<f64>,
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
struct Path {
    /// Pixel among those at hand.
    pixel: u32,
    /// Which point of the sequence it follows, and by which seed.
    index: u32,
    seed: u32,
    /// Where the segment leaves its surface, m.
    start: DVec3,
    /// Events so far.
    depth: u32,
    /// Material of the solid it is in, or [`NO_MEDIUM`].
    medium: u32,
    /// Density of its direction, 1/sr; infinite where no light could have been asked.
    density: f64,
}

/// Rays under way, and the light that may reach them.
#[derive(Default)]
struct Wave {
    rays: Vec<Ray>,
    paths: Vec<Path>,
    throughput: Vec<f64>,
    segments: Vec<Segment>,
    targets: Vec<u32>,
    light: Vec<f64>,
}

impl Wave {
    fn clear(&mut self) {
        self.rays.clear();
        self.paths.clear();
        self.throughput.clear();
    }
}

/// Where a path meets a surface.
struct Meeting<'a> {
    surface: SurfaceId,
    material: &'a SampledMaterial,
    position: DVec3,
    i: DVec3,
    n: DVec3,
    side: Side,
    path: Path,
}

impl<'a> Tracing<'a> {
    /// For one camera.
    pub fn new(
        geometry: &'a Geometry,
        appearance: &'a SampledAppearance,
        camera: &Camera,
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
            view: camera.view(geometry.centre),
            width: camera.resolution[0] as usize,
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

    fn bright(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.brightness).map(|(v, b)| v * b).sum()
    }

    /// The material of the solid around a path.
    fn solid(&self, medium: u32) -> Option<&SampledMaterial> {
        self.appearance.materials.get(medium as usize)
    }

    /// n² of what is around a path: radiance over it stays the same on the way through glass.
    fn n2(&self, medium: u32) -> f64 {
        match self.solid(medium).and_then(|m| m.transmission.as_ref()) {
            Some(Transmission::Solid { n, .. }) => n * n,
            _ => 1.0,
        }
    }

    /// Beer-Lambert over `length`, m.
    fn absorb(&self, solid: Option<&SampledMaterial>, length: f64, values: &mut [f64]) {
        if let Some(Transmission::Solid { absorption, .. }) = solid.and_then(|m| m.transmission.as_ref()) {
            for (value, a) in values.iter_mut().zip(absorption) {
                *value *= (-f64::from(*a) * length).exp();
            }
        }
    }
}

/// Four uniform numbers of a path's event.
fn uniform(path: &Path, set: u32) -> [f64; 4] {
    let set = path.depth * SETS + set + 1;
    // Beyond the dimensions there are, the same ones under another seed.
    let turn = set / sobol_burley::NUM_DIMENSION_SETS_4D;
    let seed = if turn == 0 { path.seed } else { mix(path.seed ^ mix(turn)) };
    sobol_burley::sample_4d(path.index, set % sobol_burley::NUM_DIMENSION_SETS_4D, seed).map(f64::from)
}

/// Scatters the bits of a number (the finaliser of MurmurHash3).
fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x85eb_ca6b);
    x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
    x ^ x >> 16
}

impl Replicate {
    /// Traces `samples` paths of each of `pixels`.
    pub fn trace(tracing: &Tracing, pixels: Range<usize>, number: u32, samples: u32) -> Replicate {
        let w = tracing.wavelengths();
        let mut replicate =
            Replicate { radiance: vec![0.0; pixels.len() * w], rays: 0, shadow_rays: 0, longest: 0 };
        let seed = |pixel: usize| mix(pixel as u32 ^ mix(tracing.seed.wrapping_add(mix(number + 1))));
        let (mut wave, mut next) = (Wave::default(), Wave::default());
        for index in 0..samples {
            wave.clear();
            for (k, pixel) in pixels.clone().enumerate() {
                let seed = seed(pixel);
                let [dx, dy, ..] = sobol_burley::sample_4d(index, 0, seed).map(f64::from);
                let (x, y) = (pixel % tracing.width, pixel / tracing.width);
                let ray = tracing.view.ray(x as f64 + dx, y as f64 + dy);
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
            while !wave.rays.is_empty() {
                replicate.advance(tracing, &mut wave, &mut next);
                std::mem::swap(&mut wave, &mut next);
            }
        }
        replicate.radiance.iter_mut().for_each(|l| *l /= f64::from(samples));
        replicate
    }

    /// Traces all rays of `wave`, gathers what they find, and fills `next` with those that follow.
    fn advance(&mut self, tracing: &Tracing, wave: &mut Wave, next: &mut Wave) {
        let w = tracing.wavelengths();
        next.clear();
        let mut hits: Vec<Option<Hit>> = vec![None; wave.rays.len()];
        tracing.tracer.closest_batch(&wave.rays, &mut hits);
        self.rays += wave.rays.len() as u64;
        let (segments, targets, light) = (&mut wave.segments, &mut wave.targets, &mut wave.light);
        segments.clear();
        targets.clear();
        light.clear();
        let mut room = Room { value: vec![0.0; w], fresnel: vec![0.0; w], other: vec![0.0; w] };
        let throughputs = wave.throughput.chunks_exact_mut(w);
        for (((ray, path), hit), throughput) in wave.rays.iter().zip(&wave.paths).zip(&hits).zip(throughputs)
        {
            let Some(hit) = hit else { continue };
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
                    if at.scatters() && !tracing.emitters.is_empty() {
                        tracing.ask(&met, &at, throughput, &mut room, (segments, targets, light));
                    }
                    if let Some(drawn) = at.draw(uniform(path, 1), &mut room.value, &mut room.fresnel) {
                        room.value.iter_mut().zip(&*throughput).for_each(|(v, t)| *v *= t);
                        let path = Path { density: drawn.density, ..met.path };
                        tracing.send(&met, path, drawn.direction, 1.0, &room.value, next);
                    }
                }
            }
        }
        self.shadow_rays += segments.len() as u64;
        let mut blocked = vec![false; segments.len()];
        tracing.tracer.occluded_batch(segments, &mut blocked);
        for ((pixel, light), _) in
            targets.iter().zip(light.chunks_exact(w)).zip(&blocked).filter(|(_, b)| !**b)
        {
            let sum = &mut self.radiance[*pixel as usize * w..][..w];
            sum.iter_mut().zip(light).for_each(|(sum, l)| *sum += l);
        }
    }
}

/// Room to work in, `[W]` each.
struct Room {
    value: Vec<f64>,
    other: Vec<f64>,
    fresnel: Vec<f32>,
}

impl Tracing<'_> {
    /// The place that a ray meets; `None` where it ends. What the way absorbs is taken off `throughput`.
    fn meet(&self, ray: &Ray, hit: &Hit, path: &Path, throughput: &mut [f64]) -> Option<Meeting<'_>> {
        let surface = self.geometry.surface(hit.surface);
        let material = self.appearance.of(hit.surface);
        let met = ray.at(hit.t);
        let normal = surface.normal_at(met);
        let position = met - surface.distance(met) * normal;
        // A path that began inside a solid has not entered it.
        let solid = self.solid(path.medium).or_else(|| (hit.side == Side::Back).then_some(material));
        self.absorb(solid, path.start.distance(position), throughput);
        let back = hit.side == Side::Back;
        if back && material.transmission.is_none() && !self.geometry.two_sided[hit.surface.index()] {
            return None;
        }
        Some(Meeting {
            surface: hit.surface,
            material,
            position,
            i: -ray.direction,
            n: if back { -normal } else { normal },
            side: hit.side,
            path: *path,
        })
    }

    /// Adds what the place emits, weighed against having been asked for.
    fn gather(&self, met: &Meeting, ray: &Ray, hit: &Hit, throughput: &[f64], sum: &mut [f64]) {
        let emission = &met.material.emission;
        let shows = hit.side == Side::Front || self.geometry.two_sided[met.surface.index()];
        if !shows || emission.iter().all(|&l| l == 0.0) {
            return;
        }
        let weight = if met.path.density.is_finite() {
            let cosine = met.n.dot(met.i).max(0.0);
            let distance2 = met.path.start.distance_squared(ray.at(hit.t));
            let asked = self.emitters.density(self.geometry, met.surface, met.side) * distance2 / cosine;
            power(met.path.density, asked)
        } else {
            1.0
        };
        for ((sum, t), l) in sum.iter_mut().zip(throughput).zip(emission) {
            *sum += weight * t * f64::from(*l);
        }
    }

    /// Chance with which a direction is drawn from the specular part: its share of what the place reflects.
    fn specular_chance(&self, met: &Meeting, room: &mut Room) -> f64 {
        let material = met.material;
        if material.s <= 0.0 {
            return 0.0;
        }
        material.reflect.eval(met.n.dot(met.i) as f32, &mut room.fresnel);
        room.value.iter_mut().zip(&room.fresnel).for_each(|(v, f)| *v = material.s * f64::from(*f));
        let specular = self.bright(&room.value);
        room.value.iter_mut().zip(&material.diffuse).for_each(|(v, d)| *v = f64::from(*d));
        let diffuse = self.bright(&room.value);
        if diffuse <= 0.0 { 1.0 } else { (specular / (specular + diffuse)).clamp(0.1, 0.9) }
    }

    /// Asks one emitter for its light.
    fn ask(
        &self,
        met: &Meeting,
        at: &Opaque,
        throughput: &[f64],
        room: &mut Room,
        (segments, targets, light): (&mut Vec<Segment>, &mut Vec<u32>, &mut Vec<f64>),
    ) {
        let u = uniform(&met.path, 0);
        let source = self.emitters.draw(self.geometry, [u[0], u[1], u[2]]);
        let way = source.position - met.position;
        let distance2 = way.length_squared();
        let distance = distance2.sqrt();
        let r = way / distance;
        if distance <= 0.0 || met.n.dot(r) <= 0.0 {
            return;
        }
        let density = at.eval(r, &mut room.value, &mut room.fresnel);
        let (emission, factor) = match (source.origin, source.normal) {
            (Origin::Surface(id), Some(normal)) => {
                let cosine = -normal.dot(r);
                if cosine <= 0.0 {
                    return;
                }
                let asked = source.density * distance2 / cosine;
                (&self.appearance.of(id).emission, power(asked, density) / asked)
            }
            (Origin::Light(k), _) => {
                let towards = self.geometry.lights[k].distribution.towards(-r);
                (&self.appearance.lights[k], towards / (distance2 * source.density))
            }
            (Origin::Surface(_), None) => return,
        };
        let first = light.len();
        for ((value, t), l) in room.value.iter().zip(throughput).zip(emission) {
            light.push(factor * value * t * f64::from(*l));
        }
        self.absorb(self.solid(met.path.medium), distance, &mut light[first..]);
        if light[first..].iter().all(|&l| l == 0.0) {
            light.truncate(first);
            return;
        }
        let from = met.position + self.offset[met.surface.index()] * met.n;
        segments.push(Segment { from: from.as_vec3(), to: source.position.as_vec3() });
        targets.push(met.path.pixel);
    }

    /// Reflection or transmission at glass, chosen by brightness.
    fn glass(
        &self,
        met: &Meeting,
        glass: &Transmission,
        throughput: &[f64],
        room: &mut Room,
        next: &mut Wave,
    ) {
        let cos = met.n.dot(met.i).clamp(0.0, 1.0);
        let mut beyond = Path { density: f64::INFINITY, ..met.path };
        let path = beyond;
        let onward = match glass {
            Transmission::Pane { transmit } => {
                transmit.eval(cos as f32, &mut room.fresnel);
                room.other.iter_mut().zip(&room.fresnel).for_each(|(o, t)| *o = f64::from(*t));
                met.material.reflect.eval(cos as f32, &mut room.fresnel);
                Some(-met.i)
            }
            Transmission::Solid { n: index, .. } => {
                let entering = met.side == Side::Front;
                let eta = if entering { 1.0 / index } else { *index };
                let onward = refract(met.i, met.n, eta);
                // The factor is the same both ways; against the cosine outside it is smooth.
                match if entering { Some(cos) } else { onward.map(|d| -met.n.dot(d)) } {
                    Some(cos) => met.material.reflect.eval(cos as f32, &mut room.fresnel),
                    None => room.fresnel.fill(1.0),
                }
                for (other, r) in room.other.iter_mut().zip(&room.fresnel) {
                    *other = eta * eta * (1.0 - f64::from(*r)).max(0.0);
                }
                let own = self.appearance.surface_material[met.surface.index()].0;
                beyond.medium = if entering { own } else { NO_MEDIUM };
                onward
            }
        };
        for (((value, other), f), t) in
            room.value.iter_mut().zip(&mut room.other).zip(&room.fresnel).zip(throughput)
        {
            *value = f64::from(*f) * t;
            *other *= t;
        }
        let reflected = self.bright(&room.value) * self.n2(path.medium);
        let through = if onward.is_some() { self.bright(&room.other) * self.n2(beyond.medium) } else { 0.0 };
        let chance = reflected / (reflected + through);
        if uniform(&met.path, 1)[0] < chance {
            room.value.iter_mut().for_each(|v| *v /= chance);
            self.send(met, path, reflect(met.i, met.n), 1.0, &room.value, next);
        } else if let Some(onward) = onward {
            room.other.iter_mut().for_each(|v| *v /= 1.0 - chance);
            self.send(met, beyond, onward, -1.0, &room.other, next);
        }
    }

    /// Sends a path on, on the side it came from (`side` 1) or the other (-1), unless roulette ends it.
    fn send(
        &self,
        met: &Meeting,
        path: Path,
        direction: DVec3,
        side: f64,
        throughput: &[f64],
        next: &mut Wave,
    ) {
        let bright = self.bright(throughput) * self.n2(path.medium);
        if bright.is_nan() || bright <= 0.0 {
            return;
        }
        let survival = if path.depth < SURE { 1.0 } else { bright.min(MOST) };
        if survival < 1.0 && uniform(&met.path, 2)[0] >= survival {
            return;
        }
        let (centre, share) = self.inset[met.surface.index()];
        let aside = share * (centre - met.position);
        let origin = met.position + aside + side * self.offset[met.surface.index()] * met.n;
        next.rays.push(Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY });
        next.paths.push(Path { start: met.position, depth: path.depth + 1, ..path });
        next.throughput.extend(throughput.iter().map(|t| t / survival));
    }
}

/// Weight of the first of two ways to find a path, by their densities (power heuristic).
fn power(own: f64, other: f64) -> f64 {
    let ratio = other / own;
    // Where the other way is infinitely denser nothing is left.
    1.0 / (1.0 + ratio * ratio)
}

//! What becomes of a path where it meets a surface.

use super::asks::Asks;
use super::bsdf::Opaque;
use super::path::{Path, Tracing, Wave, uniform};
use crate::geometry::{Hit, Ray, Side, SurfaceId};
use crate::material::{SampledMaterial, Transmission};
use crate::second_pass::{NO_MEDIUM, power_heuristic, reflect, refract};
use glam::DVec3;

/// Events before roulette begins.
const SURE: u32 = 3;

/// No path goes on with a greater chance once roulette has begun: between perfect mirrors it would never end.
const MOST: f64 = 0.97;

/// Where a path meets a surface.
pub struct Meeting<'a> {
    pub surface: SurfaceId,
    pub material: &'a SampledMaterial,
    pub position: DVec3,
    pub i: DVec3,
    pub n: DVec3,
    pub side: Side,
    pub path: Path,
}

/// Room to work in, `[W]` each.
pub struct Room {
    pub value: Vec<f64>,
    pub other: Vec<f64>,
    pub fresnel: Vec<f32>,
}

impl Tracing<'_> {
    /// The place that a ray meets; `None` where it ends. What the way absorbs is taken off `throughput`.
    pub fn meet(&self, ray: &Ray, hit: &Hit, path: &Path, throughput: &mut [f64]) -> Option<Meeting<'_>> {
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
    pub fn gather(&self, met: &Meeting, ray: &Ray, hit: &Hit, throughput: &[f64], sum: &mut [f64]) {
        let emission = &met.material.emission;
        let shows = hit.side == Side::Front || self.geometry.two_sided[met.surface.index()];
        if !shows || emission.iter().all(|&l| l == 0.0) {
            return;
        }
        let weight = if met.path.density.is_finite() {
            let cosine = met.n.dot(met.i).max(0.0);
            let distance2 = met.path.start.distance_squared(ray.at(hit.t));
            let asked = self.emitters.density(self.geometry, met.surface, met.side, met.position) * distance2
                / cosine;
            power_heuristic(met.path.density, asked)
        } else {
            1.0
        };
        for ((sum, t), l) in sum.iter_mut().zip(throughput).zip(emission) {
            *sum += weight * t * f64::from(*l);
        }
    }

    /// Chance with which a direction is drawn from the specular part: its share of what the place reflects.
    pub fn specular_chance(&self, met: &Meeting, room: &mut Room) -> f64 {
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
    pub fn ask(&self, met: &Meeting, at: &Opaque, throughput: &[f64], room: &mut Room, asks: &mut Asks) {
        let Some(ask) = self.draw(met.position, met.n, uniform(&met.path, 0)) else { return };
        let density = at.eval(ask.direction, &mut room.value, &mut room.fresnel);
        let factor = ask.factor(density);
        let first = asks.light.len();
        for ((value, t), l) in room.value.iter().zip(throughput).zip(ask.emission) {
            asks.light.push(factor * value * t * f64::from(*l));
        }
        let distance = ask.end.distance(met.position);
        self.absorb(self.solid(met.path.medium), distance, &mut asks.light[first..]);
        if asks.light[first..].iter().all(|&l| l == 0.0) {
            asks.light.truncate(first);
            return;
        }
        asks.push(met.position + self.offset[met.surface.index()] * met.n, &ask, met.path.pixel);
    }

    /// Reflection or transmission at glass, chosen by brightness.
    pub fn glass(
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
    pub fn send(
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

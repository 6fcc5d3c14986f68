//! Lights without a body as a sensor sees them in one specular surface, and straight through panes.

use super::cell::{Cell, sides};
use super::place::Place;
use crate::geometry::{Ray, Side, Surface, SurfaceId};
use crate::material::{SampledMaterial, Transmission, microfacet};
use crate::scene::Light;
use crate::second_pass::LitScene;
use crate::tracers::RayTracer;
use glam::DVec3;

/// Smoother than this a surface shows lights as a perfect mirror does.
const MIRROR: f64 = 0.01;
/// More panes in a row are taken as opaque.
const MOST_PANES: usize = 64;

/// The specular surfaces of a scene with point lights.
pub(super) struct Mirrored<'a> {
    scene: &'a LitScene<'a>,
    tracer: &'a dyn RayTracer,
    /// Sides of planar surfaces that mirror lights.
    mirrors: Vec<(SurfaceId, Side)>,
    /// How far above a surface rays start, m.
    above: f64,
}

impl<'a> Mirrored<'a> {
    /// Finds the mirrors.
    pub fn new(scene: &'a LitScene<'a>, tracer: &'a dyn RayTracer) -> Self {
        let mirrors = |material: &SampledMaterial| material.is_specular() && material.m < MIRROR;
        let mirrors = (0..scene.geometry.surfaces.len() as u32)
            .map(SurfaceId)
            .filter(|&s| mirrors(scene.appearance.of(s)) && scene.geometry.surface(s).is_planar())
            .flat_map(|s| sides(scene.geometry, s).map(move |side| (s, side)))
            // The inside of a solid shows its lights to nobody outside.
            .filter(|(s, side)| *side == Side::Front || !is_solid(scene.appearance.of(*s)))
            .collect();
        Mirrored { scene, tracer, mirrors, above: 4.0 * scene.geometry.plane_tolerance() }
    }

    /// Adds their light to `irradiance`, `[W]`. `aims` are the pieces of specular surfaces that the sensor
    /// sees, with rays to them and their projected solid angles.
    pub fn add(&self, place: &Place, aims: &[(Cell, Ray, f64)], irradiance: &mut [f64]) {
        let lights = self.scene.geometry.lights.iter().zip(&self.scene.appearance.lights);
        for (light, intensity) in lights {
            let add = |irradiance: &mut [f64], share: f64, through: &[f32]| {
                for ((e, i), t) in irradiance.iter_mut().zip(intensity).zip(through) {
                    *e += share * f64::from(i * t);
                }
            };
            let way = light.seen_from(place.position);
            let cosine = place.normal.dot(way.direction);
            if cosine > 0.0
                && let Some((through, 1..)) = self.through(place.position, way.end)
            {
                add(irradiance, way.share * cosine, &through);
            }
            for &(surface, side) in &self.mirrors {
                if let Some((share, through)) = self.image(place, light, surface, side) {
                    add(irradiance, share, &through);
                }
            }
            for (cell, ray, factor) in aims {
                if let Some((share, through)) = self.gloss(light, cell, ray) {
                    add(irradiance, factor * share, &through);
                }
            }
        }
    }

    /// A light in a mirror, by its image behind it: irradiance over intensity but for the second
    /// factor, which depends on wavelength.
    fn image(&self, place: &Place, light: &Light, surface: SurfaceId, side: Side) -> Option<(f64, Vec<f32>)> {
        let mirror = self.scene.geometry.surface(surface);
        let turn = if side == Side::Front { 1.0 } else { -1.0 };
        let normal = turn * mirror.plane()?.normal;
        let foot = place.position - turn * mirror.distance(place.position) * normal;
        let (ours, its) = (normal.dot(place.position - foot), light.height(foot, normal));
        if ours <= self.above || its <= self.above {
            return None;
        }
        let way = light.mirrored(foot, normal).seen_from(place.position);
        let slope = -normal.dot(way.direction);
        let met = place.position + ours / slope * way.direction;
        let cosine = place.normal.dot(way.direction);
        if slope <= 0.0 || cosine <= 0.0 || !contains(mirror, normal * turn, met) {
            return None;
        }
        let above = met + self.above * normal;
        let (near, _) = self.through(place.position, above)?;
        let (far, _) = self.through(above, light.seen_from(above).end)?;
        let material = self.scene.appearance.of(surface);
        let mut through = vec![0.0; near.len()];
        material.reflect.eval(slope as f32, &mut through);
        for ((t, near), far) in through.iter_mut().zip(near).zip(far) {
            *t *= near * far;
        }
        Some((material.s * way.share * cosine, through))
    }

    /// Radiance over intensity that a rough piece of surface sends along `ray` of a light.
    fn gloss(&self, light: &Light, cell: &Cell, ray: &Ray) -> Option<(f64, Vec<f32>)> {
        let material = self.scene.appearance.of(cell.surface);
        if material.m < MIRROR {
            return None;
        }
        let surface = self.scene.geometry.surface(cell.surface);
        let o = -ray.direction;
        let (met, normal) = match surface.plane() {
            Some(plane) => {
                let height = plane.normal.dot(ray.origin - surface.point_at(0.0, 0.0));
                (ray.at(height / plane.normal.dot(o)), plane.normal)
            }
            None => {
                let met = ray.at(surface.round()?.intersect(ray)?);
                (met, surface.normal_at(met))
            }
        };
        let n = if cell.side == Side::Front { normal } else { -normal };
        let way = light.seen_from(met);
        let i = way.direction;
        let (ni, nr) = (n.dot(i), n.dot(o));
        let h = (i + o).normalize_or_zero();
        let lobe = microfacet::rs_over_f(ni, nr, n.dot(h), i.dot(h), material.m);
        if lobe.is_nan() || lobe <= 0.0 {
            return None;
        }
        let (mut through, _) = self.through(met + self.above * n, way.end)?;
        let mut fresnel = vec![0.0; through.len()];
        material.reflect.eval(i.dot(h) as f32, &mut fresnel);
        through.iter_mut().zip(&fresnel).for_each(|(t, f)| *t *= f);
        Some((material.s * lobe * way.share * ni, through))
    }

    /// What panes let through on the straight way between two places, `[W]`, and how many there are;
    /// `None` where something else is in the way.
    fn through(&self, from: DVec3, to: DVec3) -> Option<(Vec<f32>, usize)> {
        let w = self.scene.appearance.wavelengths.len();
        let (mut through, mut share) = (vec![1.0; w], vec![0.0; w]);
        let way = to - from;
        let skip = self.above / way.length().max(f64::MIN_POSITIVE);
        // A light may lie on a surface.
        let mut ray = Ray { origin: from, direction: way, t_min: 0.0, t_max: 1.0 - skip };
        for panes in 0..MOST_PANES {
            let Some(hit) = self.tracer.closest(&ray) else { return Some((through, panes)) };
            let Some(Transmission::Pane { transmit }) = &self.scene.appearance.of(hit.surface).transmission
            else {
                return None;
            };
            let normal = self.scene.geometry.surface(hit.surface).normal_at(ray.at(hit.t));
            let cosine = normal.dot(way.normalize_or_zero()).abs();
            transmit.eval(cosine as f32, &mut share);
            through.iter_mut().zip(&share).for_each(|(t, s)| *t *= s);
            ray.t_min = hit.t + skip;
        }
        None
    }
}

fn is_solid(material: &SampledMaterial) -> bool {
    matches!(material.transmission, Some(Transmission::Solid { .. }))
}

/// Whether `p`, in the plane of a surface, is in it.
fn contains(surface: &Surface, normal: DVec3, p: DVec3) -> bool {
    if let Some(round) = surface.round() {
        return p.distance(round.centre()) <= round.radius();
    }
    let vertices = surface.vertices();
    (0..vertices.len()).all(|k| {
        let (a, b) = (vertices[k], vertices[(k + 1) % vertices.len()]);
        normal.dot((b - a).cross(p - a)) >= 0.0
    })
}

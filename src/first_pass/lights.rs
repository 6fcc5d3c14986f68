//! Point lights: what they bring to sample points, and what specular points make of it.

use super::bounce::reflectance;
use super::directions::{Direction, Directions, LANES};
use super::form_factor::exact;
use super::lobe_table::{BAND, Band};
use super::member::{Frame, outside};
use super::scatter::{Lobe, Scatter};
use super::specular::SpecularSet;
use crate::points::{Piece, SamplePoints};
use crate::scene::{Distribution, Geometry, PointLight, SampledAppearance};
use crate::simd::wide;
use crate::visibility::VisibilityGraph;
use glam::{DVec3, Vec3};

/// The light of all point lights where it falls.
#[derive(Clone, Debug, Default)]
pub struct PointLighting {
    /// E of every point, the mean over its element, W m⁻² nm⁻¹: `[W][N]`; empty without lights.
    pub irradiance: Vec<f32>,
    /// What all lights give, W nm⁻¹: `[W]`.
    pub flux: Vec<f64>,
    /// By specular point.
    incoming: Vec<Vec<Incoming>>,
}

/// One light at one specular point.
#[derive(Clone, Debug)]
struct Incoming {
    direction: Direction,
    /// E after absorption on the way, `[bands]`.
    irradiance: Vec<Band>,
    /// E lost on the way, `[bands]`.
    absorbed: Vec<Band>,
}

impl PointLighting {
    /// Of the lights of `geometry`, with the intensities of `appearance`, where `graph` says that
    /// they reach.
    pub fn new(
        geometry: &Geometry,
        points: &SamplePoints,
        graph: &VisibilityGraph,
        appearance: &SampledAppearance,
        set: &SpecularSet,
    ) -> Self {
        let (n, w, bands) = (points.len(), set.wavelengths, set.bands());
        if geometry.lights.is_empty() {
            return PointLighting { flux: vec![0.0; w], ..Default::default() };
        }
        let mut lighting = PointLighting {
            irradiance: vec![0.0; n * w],
            flux: vec![0.0; w],
            incoming: vec![Vec::new(); set.points.len()],
        };
        let mut specular_at = vec![None; n];
        set.points.iter().enumerate().for_each(|(s, p)| specular_at[p.point as usize] = Some(s));
        for (l, (light, intensity)) in geometry.lights.iter().zip(&appearance.lights).enumerate() {
            for (flux, i) in lighting.flux.iter_mut().zip(intensity) {
                *flux += light.distribution.solid_angle() * f64::from(*i);
            }
            for i in (0..n).filter(|&i| graph.lit(l, i)) {
                let share = share(light, points, i);
                for (k, intensity) in intensity.iter().enumerate() {
                    lighting.irradiance[k * n + i] += share * intensity;
                }
                let Some(s) = specular_at[i].filter(|_| share > 0.0) else { continue };
                let (direction, distance) = Frame::new(points, i).place(points, i, light.position.as_vec3());
                let absorption = set.material(&set.points[s]).filter(|_| set.points[s].inside);
                let mut incoming = Incoming {
                    direction,
                    irradiance: vec![[0.0; BAND]; bands],
                    absorbed: vec![[0.0; BAND]; bands],
                };
                for (k, intensity) in intensity.iter().enumerate() {
                    let a = absorption.map_or(0.0, |m| m.absorption[k]);
                    let through = (-a * distance).exp();
                    incoming.irradiance[k / BAND][k % BAND] = share * intensity * through;
                    incoming.absorbed[k / BAND][k % BAND] = share * intensity * (1.0 - through);
                }
                lighting.incoming[s].push(incoming);
            }
        }
        lighting
    }

    /// Whether no light reaches a specular point.
    pub fn misses_specular_points(&self) -> bool {
        self.incoming.iter().all(Vec::is_empty)
    }

    /// E on specular point `s`, and what was absorbed on the way: the sums over the lights, `[W]`.
    pub fn on(&self, s: usize, w: usize) -> (Vec<f64>, Vec<f64>) {
        let sum = |of: &dyn Fn(&Incoming) -> &Vec<Band>, k: usize| {
            self.incoming[s].iter().map(|i| f64::from(of(i)[k / BAND][k % BAND])).sum()
        };
        let each = |of: &dyn Fn(&Incoming) -> &Vec<Band>| (0..w).map(|k| sum(of, k)).collect();
        (each(&|i| &i.irradiance), each(&|i| &i.absorbed))
    }

    /// Adds what specular point `s` of `set` sends of the light of the lights to the members in its first
    /// `groups`: reflected from its own side, transmitted from its twin's. `radiance` is `[members][bands]`.
    pub fn scatter(&self, set: &SpecularSet, s: usize, groups: usize, radiance: &mut [Band]) {
        let point = &set.points[s];
        let Some(material) = set.material(point) else { return };
        let bands = set.bands();
        let list: Vec<Direction> = self.incoming[s].iter().map(|i| i.direction).collect();
        let mut from = Directions::new(point.reflection.origin, &list);
        scale(&mut from, &point.reflection, |z| material.albedo.eval(z));
        let lobe = Lobe { table: reflectance(point, material), bands };
        self.send(s, &from, &point.reflection, groups, lobe, radiance);
        if let (Some(twin), Some(table), Some(to)) = (point.twin, &material.transmit, &point.transmission)
            && let Some(Directions { origin, .. }) = set.points[twin as usize].transmission
        {
            let twin = twin as usize;
            let list: Vec<Direction> = self.incoming[twin].iter().map(|i| i.direction).collect();
            let mut from = if set.points[twin].inside {
                outside(origin, &list, material.n2)
            } else {
                Directions::new(origin, &list)
            };
            scale(&mut from, to, |_| 1.0);
            let mut through = vec![[0.0; BAND]; radiance.len()];
            self.send(twin, &from, to, groups, Lobe { table, bands }, &mut through);
            let n2 = if point.inside { material.n2 } else { 1.0 };
            for (out, through) in radiance.iter_mut().zip(&through) {
                (0..BAND).for_each(|lane| out[lane] += n2 * through[lane]);
            }
        }
    }

    /// Scatters the light of the lights at specular point `s`, which are the directions `from`.
    fn send(
        &self,
        s: usize,
        from: &Directions,
        to: &Directions,
        groups: usize,
        lobe: Lobe,
        radiance: &mut [Band],
    ) {
        let members: Vec<u32> = (0..from.len as u32).collect();
        let light: Vec<Band> = self.incoming[s].iter().flat_map(|i| i.irradiance.iter().copied()).collect();
        if !members.is_empty() {
            wide(Scatter { from, sources: (&members, &light), to, groups, lobe, radiance });
        }
    }
}

/// Scales every direction so that its lobe over the members `to` returns the directional albedo. Lobes
/// along straight lines need none: the elements of a mirror add up to it together.
fn scale(from: &mut Directions, to: &Directions, albedo: impl Fn(f32) -> f32) {
    if to.origin.m2 == 0.0 && to.origin.straight {
        return;
    }
    for l in 0..from.len {
        let a = from.get(l);
        let mut sum = 0.0;
        for g in to.reach(a, 0..to.groups()) {
            if let Some((b, _)) = to.lobe(&a, g) {
                sum += (0..LANES).map(|k| b[k] * to.weight[g][k] * to.scale[g][k]).sum::<f32>();
            }
        }
        let scale = albedo(a.to[2]) / sum;
        from.scale[l / LANES][l % LANES] = if scale.is_finite() { scale } else { 0.0 };
    }
}

/// Irradiance of point `i`, the mean over its element, over the largest intensity of a light that reaches it, sr m⁻².
pub(super) fn share(light: &PointLight, points: &SamplePoints, i: usize) -> f32 {
    let into = match points.round(i) {
        Some(piece) => into_piece(light, &piece),
        None => into(light, &points.corners[i]),
    };
    (into / f64::from(points.area[i])) as f32
}

/// Flux into an element over the largest intensity, sr: exact, so that the elements around a light
/// receive all of it.
fn into(light: &PointLight, corners: &[Vec3; 4]) -> f64 {
    match light.distribution {
        Distribution::Isotropic => {
            let [a, b, c, d] = corners.map(|v| v.as_dvec3() - light.position);
            solid_angle(a, b, c) + solid_angle(a, c, d)
        }
        Distribution::Lambertian { axis } => exact(light.position.as_vec3(), axis.as_vec3(), corners),
    }
}

/// The same for a piece of a disc or a sphere: by pieces that subtend little.
fn into_piece(light: &PointLight, piece: &Piece) -> f64 {
    const SMALL: f64 = 2.5e-3;
    const DEEPEST: u8 = 8;
    let fine = |place: DVec3, area: f64| area <= SMALL * place.distance_squared(light.position);
    piece.sum(DEEPEST, fine, |place, normal, area| {
        let way = place - light.position;
        let distance = way.length();
        let solid_angle = area * (-normal.dot(way)).max(0.0) / distance.powi(3);
        let share = solid_angle * light.distribution.towards(way / distance);
        if share.is_finite() { share } else { 0.0 }
    })
}

/// The solid angle of a triangle seen from the origin (A. van Oosterom and J. Strackee, 1983), sr.
fn solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).abs().atan2(below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn the_faces_of_a_box_share_all_directions() {
        let face = |z: f32| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]: [f32; 2]| Vec3::new(x, y, z))
        };
        let light = |distribution| PointLight { name: String::new(), position: DVec3::ZERO, distribution };
        let isotropic = light(Distribution::Isotropic);
        assert!((6.0 * into(&isotropic, &face(1.0)) - 4.0 * PI).abs() < 1e-9);
        let lambertian = light(Distribution::Lambertian { axis: DVec3::Z });
        // Four quarters, each sqrt(1/2) atan sqrt(1/2) / pi (a rectangle's corner over a point).
        let root = 0.5f64.sqrt();
        assert!((into(&lambertian, &face(1.0)) - 4.0 * root * root.atan()).abs() < 1e-9);
        assert!(into(&lambertian, &face(-1.0)).abs() < 1e-12);
    }
}

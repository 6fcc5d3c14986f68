//! Lights without a body: what they bring to sample points, and what specular points make of it.

use super::bounce::reflectance;
use super::directions::{Direction, Directions, LANES};
use super::form_factor::exact;
use super::lobe_table::{BAND, Band};
use super::member::{Frame, outside};
use super::scatter::{Lobe, Scatter};
use super::sky;
use super::specular::SpecularSet;
use crate::material::Transmission;
use crate::points::{Piece, SamplePoints};
use crate::scene::{Distribution, Geometry, Light, LightKind, SampledAppearance};
use crate::simd::wide;
use crate::visibility::LightSight;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// The light of all lights without a body, and of the sky, where it falls.
#[derive(Clone, Debug, Default)]
pub struct PointLighting {
    /// E of every point, the mean over its element, W m⁻² nm⁻¹: `[W][N]`; empty without lights.
    pub irradiance: Vec<f32>,
    /// That of the sky alone; empty without.
    pub sky: Vec<f32>,
    /// What all lights give, W nm⁻¹: `[W]`; those from infinity as much as is used of it.
    pub flux: Vec<f64>,
    /// What the scene catches of it.
    pub caught: Vec<f64>,
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
    /// What goes straight on through a pane and is found where it falls, by no chain, `[bands]`; `None` if chains carry it.
    straight: Option<Vec<Band>>,
}

impl PointLighting {
    /// Of the lights of `geometry`, with the intensities of `appearance`, where `sight` says that
    /// they reach.
    pub fn new(
        geometry: &Geometry,
        points: &SamplePoints,
        sight: &LightSight,
        appearance: &SampledAppearance,
        set: &SpecularSet,
    ) -> Self {
        let (n, w) = (points.len(), set.wavelengths);
        let mut lighting = PointLighting { flux: vec![0.0; w], caught: vec![0.0; w], ..Default::default() };
        if geometry.lights.is_empty() && geometry.zenith.is_none() {
            return lighting;
        }
        lighting.irradiance = vec![0.0; n * w];
        lighting.incoming = vec![Vec::new(); set.points.len()];
        let mut specular_at = vec![None; n];
        set.points.iter().enumerate().for_each(|(s, p)| specular_at[p.point as usize] = Some(s));
        for (l, (light, amount)) in geometry.lights.iter().zip(&appearance.lights).enumerate() {
            let shares = shares(light, points, |i| sight.lit(l, i));
            let mut caught = vec![0.0; w];
            let mut falls = |i: usize, irradiance: &[f32]| {
                let mut straight = None;
                if let Some(s) = specular_at[i] {
                    let incoming = Incoming::new(light, points, irradiance, (set, s), appearance);
                    straight = incoming.straight.clone();
                    lighting.incoming[s].push(incoming);
                }
                for (k, &e) in irradiance.iter().enumerate() {
                    let on = straight.as_ref().map_or(0.0, |bands| bands[k / BAND][k % BAND]);
                    lighting.irradiance[k * n + i] += e;
                    caught[k] += f64::from(points.area[i] * (e - on));
                }
            };
            let mut irradiance = vec![0.0; w];
            for (i, &share) in shares.iter().enumerate().filter(|(_, share)| **share > 0.0) {
                irradiance.iter_mut().zip(amount).for_each(|(e, a)| *e = share * a);
                falls(i, &irradiance);
            }
            for (i, through) in passing(geometry, light, sight, l, appearance) {
                let share = share(light, points, i);
                irradiance.iter_mut().zip(amount).zip(&through).for_each(|((e, a), t)| *e = share * a * t);
                falls(i, &irradiance);
            }
            for k in 0..w {
                lighting.caught[k] += caught[k];
                lighting.flux[k] += match light.kind {
                    LightKind::Point { .. } => light.flux_share() * f64::from(amount[k]),
                    LightKind::Directional { .. } => caught[k],
                };
            }
        }
        if let Some(sky) = sky::irradiance(geometry, points, &sight.sky, appearance) {
            for (k, of_sky) in sky.chunks_exact(n.max(1)).enumerate() {
                for (i, &e) in of_sky.iter().enumerate() {
                    // What falls on specular points and is not reflected diffusely is left out.
                    let diffuse = appearance.of(points.surface[i]).diffuse[k];
                    let used = if specular_at[i].is_some() { e * diffuse } else { e };
                    lighting.irradiance[k * n + i] += e;
                    lighting.caught[k] += f64::from(points.area[i] * used);
                    lighting.flux[k] += f64::from(points.area[i] * used);
                }
            }
            lighting.sky = sky;
        }
        lighting
    }

    /// Whether no light reaches a specular point.
    pub fn misses_specular_points(&self) -> bool {
        self.incoming.iter().all(Vec::is_empty)
    }

    /// E on specular point `s` as far as chains carry it on or it stays there, and what was absorbed on the way: the
    /// sums over the lights, `[W]`.
    pub fn on(&self, s: usize, w: usize) -> (Vec<f64>, Vec<f64>) {
        let (mut falls, mut absorbed) = (vec![0.0; w], vec![0.0; w]);
        for incoming in &self.incoming[s] {
            for k in 0..w {
                let of = |bands: &[Band]| f64::from(bands[k / BAND][k % BAND]);
                falls[k] += of(&incoming.irradiance) - incoming.straight.as_deref().map_or(0.0, of);
                absorbed[k] += of(&incoming.absorbed);
            }
        }
        (falls, absorbed)
    }

    /// Adds what specular point `s` of `set` sends of the light of the lights to the members in its first
    /// `groups`: reflected from its own side, transmitted from its twin's. `radiance` is `[members][bands]`.
    pub fn scatter(&self, set: &SpecularSet, s: usize, groups: usize, radiance: &mut [Band]) {
        let point = &set.points[s];
        let Some(material) = set.material(point) else { return };
        let bands = set.bands();
        let all: Vec<&Incoming> = self.incoming[s].iter().collect();
        let list: Vec<Direction> = all.iter().map(|i| i.direction).collect();
        let mut from = Directions::new(point.reflection.origin, &list);
        scale(&mut from, &point.reflection, |z| material.albedo.eval(z));
        let lobe = Lobe { table: reflectance(point, material), bands };
        send(&all, &from, &point.reflection, groups, lobe, radiance);
        if let (Some(twin), Some(table), Some(to)) = (point.twin, &material.transmit, &point.transmission)
            && let Some(Directions { origin, .. }) = set.points[twin as usize].transmission
        {
            let twin = twin as usize;
            let onward: Vec<&Incoming> =
                self.incoming[twin].iter().filter(|i| i.straight.is_none()).collect();
            let list: Vec<Direction> = onward.iter().map(|i| i.direction).collect();
            let mut from = if set.points[twin].inside {
                outside(origin, &list, material.n2)
            } else {
                Directions::new(origin, &list)
            };
            scale(&mut from, to, |_| 1.0);
            let mut through = vec![[0.0; BAND]; radiance.len()];
            send(&onward, &from, to, groups, Lobe { table, bands }, &mut through);
            let n2 = if point.inside { material.n2 } else { 1.0 };
            for (out, through) in radiance.iter_mut().zip(&through) {
                (0..BAND).for_each(|lane| out[lane] += n2 * through[lane]);
            }
        }
    }
}

impl Incoming {
    /// What comes from `light` to a specular point and makes this irradiance there.
    fn new(
        light: &Light,
        points: &SamplePoints,
        irradiance: &[f32],
        (set, s): (&SpecularSet, usize),
        appearance: &SampledAppearance,
    ) -> Self {
        let (point, bands) = (&set.points[s], set.bands());
        let i = point.point as usize;
        let (direction, distance) = Frame::new(points, i).place(points, i, light.place().as_vec3());
        let absorption = set.material(point).filter(|_| point.inside);
        let mut incoming = Incoming {
            direction,
            irradiance: vec![[0.0; BAND]; bands],
            absorbed: vec![[0.0; BAND]; bands],
            straight: None,
        };
        for (k, &e) in irradiance.iter().enumerate() {
            let through = (-absorption.map_or(0.0, |m| m.absorption[k]) * distance).exp();
            incoming.irradiance[k / BAND][k % BAND] = e * through;
            incoming.absorbed[k / BAND][k % BAND] = e * (1.0 - through);
        }
        if let (LightKind::Directional { .. }, Some(Transmission::Pane { transmit })) =
            (&light.kind, &appearance.of(points.surface[i]).transmission)
            && points.round(i).is_none()
        {
            let mut on = vec![0.0; irradiance.len()];
            transmit.eval(direction.to[2], &mut on);
            let mut straight = vec![[0.0; BAND]; bands];
            on.iter()
                .zip(irradiance)
                .enumerate()
                .for_each(|(k, (t, e))| straight[k / BAND][k % BAND] = t * e);
            incoming.straight = Some(straight);
        }
        incoming
    }
}

/// Scatters the light of lights that come from the directions `from`.
fn send(
    lights: &[&Incoming],
    from: &Directions,
    to: &Directions,
    groups: usize,
    lobe: Lobe,
    radiance: &mut [Band],
) {
    let members: Vec<u32> = (0..from.len as u32).collect();
    let light: Vec<Band> = lights.iter().flat_map(|i| i.irradiance.iter().copied()).collect();
    if !members.is_empty() {
        wide(Scatter { from, sources: (&members, &light), to, groups, lobe, radiance });
    }
}

/// The points that directional light `l` reaches through panes, and what these let through, `[W]`.
fn passing<'a>(
    geometry: &'a Geometry,
    light: &Light,
    sight: &'a LightSight,
    l: usize,
    appearance: &SampledAppearance,
) -> impl Iterator<Item = (usize, Vec<f32>)> + 'a {
    let lists: Vec<Option<Vec<f32>>> = match light.kind {
        LightKind::Point { .. } => Vec::new(),
        LightKind::Directional { from, .. } => {
            sight.passages.lists().iter().map(|list| appearance.through(geometry, list, from)).collect()
        }
    };
    let through = move |number: u16| lists.get(usize::from(number)).cloned().flatten();
    sight.passing(l).iter().filter_map(move |&(i, number)| Some((i as usize, through(number)?)))
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

/// Irradiance of all points, the mean over the element of each, over the amount of a light that reaches those that are
/// `lit`; 0 for the others.
fn shares(light: &Light, points: &SamplePoints, lit: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
    let of = |i: usize| if lit(i) { share(light, points, i) } else { 0.0 };
    (0..points.len()).into_par_iter().map(of).collect()
}

fn share(light: &Light, points: &SamplePoints, i: usize) -> f32 {
    let area = f64::from(points.area[i]);
    let share = match (&light.kind, points.round(i)) {
        (LightKind::Point { position, distribution }, None) => {
            into(*position, distribution, &points.corners[i]) / area
        }
        (LightKind::Directional { from, .. }, None) => from.dot(points.normal[i].as_dvec3()).max(0.0),
        (_, Some(piece)) => into_piece(light, &piece) / area,
    };
    share as f32
}

/// Flux into an element from a point over the largest intensity, sr: exact, so that the elements around a light
/// receive all of it, or for what is measured as good as that.
fn into(position: DVec3, distribution: &Distribution, corners: &[Vec3; 4]) -> f64 {
    match distribution {
        Distribution::Isotropic => {
            let [a, b, c, d] = corners.map(|v| v.as_dvec3() - position);
            solid_angle(a, b, c) + solid_angle(a, c, d)
        }
        Distribution::Lambertian { axis } => exact(position.as_vec3(), axis.as_vec3(), corners),
        Distribution::Spot { .. } | Distribution::Web { .. } => {
            into_pieces(distribution, corners.map(|v| v.as_dvec3() - position), DEEPEST)
        }
    }
}

/// No element is divided more often.
const DEEPEST: u8 = 8;

/// The same with the light in the origin: by pieces over which the intensity is all but linear.
fn into_pieces(distribution: &Distribution, corners: [DVec3; 4], depth: u8) -> f64 {
    // Pieces are divided until they subtend less than the first whatever they receive, and until they subtend less
    // than the last as long as the intensity over them differs.
    const SMALL: f64 = 4e-3;
    const SMALLEST: f64 = 2e-5;
    const EVEN: f64 = 0.02;
    let [a, b, c, d] = corners;
    let solid_angle = solid_angle(a, b, c) + solid_angle(a, c, d);
    let towards = |v: DVec3| distribution.towards(v.normalize_or(DVec3::Z));
    let at = corners.map(towards);
    let middle = 0.25 * (a + b + c + d);
    let centre = towards(middle);
    let (low, high) = at.iter().fold((centre, centre), |(l, h), x| (l.min(*x), h.max(*x)));
    let even = solid_angle < SMALLEST || high - low <= EVEN * high.max(0.05);
    if depth == 0 || solid_angle < SMALL && even {
        // The middle and the corners miss a curved intensity by opposite amounts, as one to two.
        let mean = (0.25 * at.iter().sum::<f64>() + 2.0 * centre) / 3.0;
        return solid_angle * mean;
    }
    let [ab, bc, cd, da] = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + d), 0.5 * (d + a)];
    [[a, ab, middle, da], [ab, b, bc, middle], [middle, bc, c, cd], [da, middle, cd, d]]
        .into_iter()
        .map(|quarter| into_pieces(distribution, quarter, depth - 1))
        .sum()
}

/// Flux into a piece of a disc or a sphere over the amount of a light, sr or m²: by pieces that subtend little.
fn into_piece(light: &Light, piece: &Piece) -> f64 {
    const SMALL: f64 = 2.5e-3;
    let fine = |place: DVec3, area: f64| area <= SMALL * place.distance_squared(light.place());
    piece.sum(&[], DEEPEST, fine, |place, normal, area| {
        let way = light.seen_from(place);
        let share = area * normal.dot(way.direction).max(0.0) * way.share;
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
        fn face(z: f32) -> [Vec3; 4] {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]: [f32; 2]| Vec3::new(x, y, z))
        }
        fn at_origin(distribution: &Distribution, z: f32) -> f64 {
            into(DVec3::ZERO, distribution, &face(z))
        }
        assert!((6.0 * at_origin(&Distribution::Isotropic, 1.0) - 4.0 * PI).abs() < 1e-9);
        let lambertian = Distribution::Lambertian { axis: DVec3::Z };
        // Four quarters, each sqrt(1/2) atan sqrt(1/2) / pi (a rectangle's corner over a point).
        let root = 0.5f64.sqrt();
        assert!((at_origin(&lambertian, 1.0) - 4.0 * root * root.atan()).abs() < 1e-9);
        assert!(at_origin(&lambertian, -1.0).abs() < 1e-12);
        let spot = |inner: f64, outer: f64| Distribution::Spot {
            axis: DVec3::Z,
            inner: inner.to_radians().cos(),
            outer: outer.to_radians().cos(),
        };
        for (inner, outer) in [(0.0, 40.0), (20.0, 30.0), (30.0, 30.0), (2.0, 5.0)] {
            let spot = spot(inner, outer);
            let found = at_origin(&spot, 1.0);
            assert!((found / spot.solid_angle() - 1.0).abs() < 3e-3, "{inner} {outer}: {found}");
            assert_eq!(at_origin(&spot, -1.0), 0.0);
        }
    }
}

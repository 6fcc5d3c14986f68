//! One bounce of the specular chains at one specular point: what comes in, and what goes out to whom.

use super::directions::{Directions, LANES, Lanes};
use super::lights::PointLighting;
use super::lobe_table::{BAND, LobeTable};
use super::nodes::Nodes;
use super::rows::{Pass, Rows, sum_of};
use super::scatter::spread;
use super::specular::{SpecularMaterial, SpecularPoint, SpecularSet};
use crate::points::{NO_POINT, SamplePoints};
use crate::simd::wide;

/// Radiance on its way from specular point to specular point: per point, `[links][W]`.
pub type State = Vec<Vec<f32>>;

/// What one specular point receives in one bounce.
struct Incoming {
    /// q L of its members, with absorption on the way, `[groups][W]`, of as many groups as send any.
    light: Vec<Lanes>,
    /// Flux, W nm⁻¹: `[W]`.
    entered: Vec<f64>,
    /// Flux absorbed on the way, W nm⁻¹: `[W]`.
    medium: Vec<f64>,
}

/// What one specular point sends out in one bounce.
pub struct Outgoing {
    /// Radiance towards each member, `[groups][W]`.
    pub radiance: Vec<Lanes>,
    /// Flux that came in, after absorption on the way, W nm⁻¹: `[W]`.
    pub entered: Vec<f64>,
    /// Flux absorbed on the way, W nm⁻¹: `[W]`.
    pub medium: Vec<f64>,
    /// In the first bounce the irradiance that came in, parts that are negative taken as positive, W m⁻² nm⁻¹: `[W]`.
    pub strength: Vec<f64>,
}

/// The sources of one bounce: diffuse radiance or point lights in the first, radiance under way in the others, both to
/// deliver.
pub struct Bounce<'a> {
    /// All specular points.
    pub set: &'a SpecularSet,
    /// All sample points.
    pub points: &'a SamplePoints,
    /// Diffuse radiance of all points, and of none: `[N + 1][W]`.
    pub radiance: Option<&'a [f32]>,
    /// What point lights bring.
    pub lights: Option<&'a PointLighting>,
    /// Radiance under way.
    pub state: Option<&'a State>,
}

impl Bounce<'_> {
    /// What comes in at specular point `s` from its members.
    fn incoming(&self, s: usize) -> Incoming {
        let w = self.set.wavelengths;
        let point = &self.set.points[s];
        let area = f64::from(self.points.area[point.point as usize]);
        // Specular points stand first.
        let groups = if self.radiance.is_some() { point.reflection.groups() } else { point.link_groups };
        let mut light = vec![[0.0; LANES]; groups * w];
        if let Some(radiance) = self.radiance {
            let none = radiance.len() / w - 1;
            for (light, members) in light.chunks_exact_mut(w).zip(point.members.chunks(LANES)) {
                let mut rows = [none * w; LANES];
                for (row, &member) in rows.iter_mut().zip(members) {
                    *row = if member == NO_POINT { none } else { member as usize } * w;
                }
                for (k, light) in light.iter_mut().enumerate() {
                    *light = rows.map(|row| radiance[row + k]);
                }
            }
        }
        for (link, l) in point.links.iter().zip(self.state.map_or(&[][..], |state| &state[s]).chunks(w)) {
            let member = link.member as usize;
            let group = &mut light[member / LANES * w..(member / LANES + 1) * w];
            group.iter_mut().zip(l).for_each(|(light, l)| light[member % LANES] += *l);
        }
        for (light, q) in light.chunks_exact_mut(w).zip(&point.reflection.weight) {
            light.iter_mut().for_each(|light| (0..LANES).for_each(|lane| light[lane] *= q[lane]));
        }
        let (mut entered, mut medium) = (vec![0.0; w], vec![0.0; w]);
        for (member, _) in point.distance.iter().enumerate().take(groups * LANES) {
            for c in 0..w {
                let light = &mut light[member / LANES * w + c][member % LANES];
                let through = self.set.through(point, member, c);
                medium[c] += area * f64::from(*light * (1.0 - through));
                *light *= through;
            }
        }
        for light in light.chunks_exact(w) {
            for (entered, light) in entered.iter_mut().zip(light) {
                *entered += area * f64::from(sum_of(light));
            }
        }
        Incoming { light, entered, medium }
    }

    /// Flux that comes in at specular point `s`, W nm⁻¹: `[W]`.
    pub fn entering(&self, s: usize) -> Vec<f64> {
        self.incoming(s).entered
    }

    /// What `s` sends to the members in its first `groups`: reflected from its own side, transmitted from its
    /// twin's.
    pub fn outgoing(&self, s: usize, groups: usize) -> Outgoing {
        let w = self.set.wavelengths;
        let point = &self.set.points[s];
        let mut radiance = vec![[0.0; LANES]; groups * w];
        if groups == 0 && self.state.is_some() {
            return Outgoing { radiance, entered: Vec::new(), medium: Vec::new(), strength: Vec::new() };
        }
        let Incoming { mut light, mut entered, mut medium } = self.incoming(s);
        let mut strength = self.lights.map_or_else(|| vec![0.0; w], |lights| lights.on(s, w).0);
        if self.state.is_none() {
            for light in light.chunks_exact(w) {
                for (strength, light) in strength.iter_mut().zip(light) {
                    *strength += f64::from(sum_of(&light.map(f32::abs)));
                }
            }
        }
        if groups == 0 {
            return Outgoing { radiance, entered, medium, strength };
        }
        if let Some(material) = self.set.material(point) {
            let (lobe, table) = (&point.reflection, reflectance(point, material));
            spread(lobe, table, w, &light, &mut radiance);
            scale(lobe, w, &mut light);
            let out = reflect((point.nodes.as_ref(), &point.rows, table), lobe, w, &light, groups);
            rescale(lobe, w, 1.0, &out, &mut radiance);
            if let (Some(twin), Some(table), Some(to)) = (point.twin, &material.transmit, &point.transmission)
                && let twin = twin as usize
                && let (Some(from), Some(rows)) =
                    (&self.set.points[twin].transmission, &self.set.points[twin].through)
            {
                let mut light = self.incoming(twin).light;
                scale(from, w, &mut light);
                let mut out = vec![[0.0; LANES]; groups * w];
                wide(Pass {
                    rows,
                    table,
                    from,
                    to,
                    count: light.len() / w,
                    groups,
                    w,
                    light: &light,
                    out: &mut out,
                });
                // Radiance over n² is what stays the same across the boundary; inside elements
                // already weigh n² in the normalisation.
                let n2 = if point.inside { material.n2 } else { 1.0 };
                rescale(to, w, n2, &out, &mut radiance);
            }
        }
        if let Some(lights) = self.lights {
            let area = f64::from(self.points.area[point.point as usize]);
            let (irradiance, absorbed) = lights.on(s, w);
            for c in 0..w {
                entered[c] += area * irradiance[c];
                medium[c] += area * absorbed[c];
            }
            let bands = self.set.bands();
            let mut more = vec![[0.0; BAND]; groups * LANES * bands];
            lights.scatter(self.set, s, groups, &mut more);
            for (k, more) in more.chunks_exact(bands).enumerate() {
                for c in 0..w {
                    radiance[k / LANES * w + c][k % LANES] += more[c / BAND][c % BAND];
                }
            }
        }
        Outgoing { radiance, entered, medium, strength }
    }
}

/// What a lobe of reflection, with its nodes if it has any and its rows, makes of `light`, towards the first `groups` of
/// `ends` at least.
pub(super) fn reflect(
    (nodes, rows, table): (Option<&Nodes>, &Rows, &LobeTable),
    ends: &Directions,
    w: usize,
    light: &[Lanes],
    groups: usize,
) -> Vec<Lanes> {
    if let Some(nodes) = nodes {
        let light = nodes.gather(w, light);
        let out = reflect((None, rows, table), &nodes.directions, w, &light, nodes.groups(groups));
        return nodes.scatter(w, groups, &out);
    }
    let known = light.len() / w;
    let all = groups.max(known);
    let mut out = vec![[0.0; LANES]; all * w];
    let count = groups.min(known);
    wide(Pass { rows, table, from: ends, to: ends, count, groups: all, w, light, out: &mut out });
    out
}

/// Multiplies light by the scale factors of where it comes from.
fn scale(from: &Directions, w: usize, light: &mut [Lanes]) {
    for (light, u) in light.chunks_exact_mut(w).zip(&from.scale) {
        for light in light {
            (0..LANES).for_each(|lane| light[lane] *= from.gain * u[lane]);
        }
    }
}

/// Adds what came through a lobe, times the scale factors of where it goes and times `factor`.
fn rescale(to: &Directions, w: usize, factor: f32, out: &[Lanes], radiance: &mut [Lanes]) {
    for ((radiance, out), u) in radiance.chunks_exact_mut(w).zip(out.chunks_exact(w)).zip(&to.scale) {
        for (radiance, out) in radiance.iter_mut().zip(out) {
            (0..LANES).for_each(|lane| radiance[lane] += factor * u[lane] * out[lane]);
        }
    }
}

/// The reflection lobe's factor on the side where `point` is.
pub fn reflectance<'a>(point: &SpecularPoint, material: &'a SpecularMaterial) -> &'a LobeTable {
    match &material.reflect_inside {
        Some(inside) if point.inside => inside,
        _ => &material.reflect,
    }
}

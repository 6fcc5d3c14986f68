//! One bounce of the specular chains at one specular point: what comes in, and what goes out to whom.

use super::directions::LANES;
use super::lights::PointLighting;
use super::lobe_table::{BAND, Band, LobeTable};
use super::scatter::{Lobe, Scatter, reflect};
use super::specular::{SpecularMaterial, SpecularPoint, SpecularSet};
use crate::points::{NO_POINT, SamplePoints};
use crate::simd::wide;
use rayon::prelude::*;

/// Radiance on its way from specular point to specular point: per point and link, `[bands]`.
pub type State = Vec<Vec<Band>>;

/// What one specular point sends out in one bounce.
pub struct Outgoing {
    /// Radiance towards each member, `[members][bands]`.
    pub radiance: Vec<Band>,
    /// Flux that came in, after absorption on the way, W nm⁻¹: `[W]`.
    pub entered: Vec<f64>,
    /// Flux absorbed on the way, W nm⁻¹: `[W]`.
    pub medium: Vec<f64>,
}

/// The sources of one bounce: diffuse radiance or point lights in the first, radiance under way in the others, both to deliver.
pub struct Bounce<'a> {
    /// All specular points.
    pub set: &'a SpecularSet,
    /// All sample points.
    pub points: &'a SamplePoints,
    /// Diffuse radiance of all points, `[N][bands]`.
    pub radiance: Option<&'a [Band]>,
    /// What point lights bring.
    pub lights: Option<&'a PointLighting>,
    /// Radiance under way.
    pub state: Option<&'a State>,
}

impl Bounce<'_> {
    /// Source terms of specular point `s`: (member, q L with absorption on the way), and the flux
    /// absorbed on the way.
    fn sources(&self, s: usize) -> (Vec<u32>, Vec<Band>, Vec<f64>) {
        let (w, bands) = (self.set.wavelengths, self.set.bands());
        let point = &self.set.points[s];
        let area = f64::from(self.points.area[point.point as usize]);
        let (mut members, mut values, mut medium) = (Vec::new(), Vec::new(), vec![0.0; w]);
        let mut push = |member: usize, l: &[Band]| {
            if l.iter().flatten().all(|&l| l == 0.0) {
                return;
            }
            members.push(member as u32);
            let q = point.q_in[member];
            for (band, l) in l.iter().enumerate() {
                let mut value = l.map(|l| q * l);
                if !point.distance.is_empty() {
                    for c in band * BAND..w.min((band + 1) * BAND) {
                        let through = self.set.through(point, member, c);
                        medium[c] += area * f64::from(value[c % BAND] * (1.0 - through));
                        value[c % BAND] *= through;
                    }
                }
                values.push(value);
            }
        };
        let links = || point.links.iter().zip(self.state.map_or(&[][..], |state| &state[s]).chunks(bands));
        if let Some(radiance) = self.radiance {
            // Specular points stand first.
            let linked = point.links.iter().map(|l| l.member as usize + 1).max().unwrap_or(0);
            let mut light = vec![[0.0; BAND]; linked * bands];
            for (link, l) in links() {
                light[link.member as usize * bands..][..bands].copy_from_slice(l);
            }
            for (member, &i) in point.members.iter().enumerate().filter(|(_, i)| **i != NO_POINT) {
                let own = &radiance[i as usize * bands..(i as usize + 1) * bands];
                if member < linked {
                    let light = &mut light[member * bands..(member + 1) * bands];
                    for (light, own) in light.iter_mut().zip(own) {
                        (0..BAND).for_each(|lane| light[lane] += own[lane]);
                    }
                    push(member, light);
                } else {
                    push(member, own);
                }
            }
        } else {
            for (link, l) in links() {
                push(link.member as usize, l);
            }
        }
        (members, values, medium)
    }

    /// What `s` sends to the members in its first `groups`: reflected from its own side, transmitted from its
    /// twin's.
    pub fn outgoing(&self, s: usize, groups: usize) -> Outgoing {
        let bands = self.set.bands();
        let point = &self.set.points[s];
        let mut radiance = vec![[0.0; BAND]; groups * LANES * bands];
        if groups == 0 {
            return Outgoing { radiance, entered: Vec::new(), medium: Vec::new() };
        }
        let (members, values, mut medium) = self.sources(s);
        let area = f64::from(self.points.area[point.point as usize]);
        let mut entered = vec![0.0; self.set.wavelengths];
        for value in values.chunks(bands) {
            for (c, e) in entered.iter_mut().enumerate() {
                *e += area * f64::from(value[c / BAND][c % BAND]);
            }
        }
        if let Some(lights) = self.lights {
            let (irradiance, absorbed) = lights.on(s, self.set.wavelengths);
            for c in 0..self.set.wavelengths {
                entered[c] += area * irradiance[c];
                medium[c] += area * absorbed[c];
            }
            lights.scatter(self.set, s, groups, &mut radiance);
        }
        if let Some(material) = self.set.material(point) {
            let table = reflectance(point, material);
            let (lobe, sources) = (Lobe { table, bands }, (&members[..], &values[..]));
            reflect(&point.reflection, sources, groups, lobe, &mut radiance);
            if let (Some(twin), Some(transmit), Some(to)) =
                (point.twin, &material.transmit, &point.transmission)
                && let Some(from) = &self.set.points[twin as usize].transmission
            {
                let (members, values, _) = self.sources(twin as usize);
                let mut through = vec![[0.0; BAND]; radiance.len()];
                let lobe = Lobe { table: transmit, bands };
                let sources = (&members[..], &values[..]);
                wide(Scatter { from, sources, to, groups, lobe, radiance: &mut through });
                // Radiance over n² is what stays the same across the boundary; inside elements
                // already weigh n² in the normalisation.
                let n2 = if point.inside { material.n2 } else { 1.0 };
                for (out, through) in radiance.iter_mut().zip(&through) {
                    for lane in 0..BAND {
                        out[lane] += n2 * through[lane];
                    }
                }
            }
        }
        Outgoing { radiance, entered, medium }
    }

    /// Flux and largest irradiance that the first bounce starts from.
    pub fn strength(&self) -> (Vec<f64>, f64) {
        let (w, bands) = (self.set.wavelengths, self.set.bands());
        let per_point: Vec<Vec<f64>> = (0..self.set.points.len())
            .into_par_iter()
            .map(|s| {
                let mut irradiance = self.lights.map_or_else(|| vec![0.0; w], |l| l.on(s, w).0);
                for value in self.sources(s).1.chunks(bands) {
                    for (c, e) in irradiance.iter_mut().enumerate() {
                        *e += f64::from(value[c / BAND][c % BAND]).abs();
                    }
                }
                irradiance
            })
            .collect();
        let (mut flux, mut largest) = (vec![0.0; w], 0.0f64);
        for (point, irradiance) in self.set.points.iter().zip(&per_point) {
            let area = f64::from(self.points.area[point.point as usize]);
            for c in 0..w {
                flux[c] += area * irradiance[c];
                largest = largest.max(irradiance[c]);
            }
        }
        (flux, largest)
    }
}

/// The reflection lobe's factor on the side where `point` is.
pub fn reflectance<'a>(point: &SpecularPoint, material: &'a SpecularMaterial) -> &'a LobeTable {
    match &material.reflect_inside {
        Some(inside) if point.inside => inside,
        _ => &material.reflect,
    }
}

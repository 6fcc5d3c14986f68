//! The specular chains D(S...)D: what diffuse radiance becomes after one or more specular
//! reflections or transmissions in a row (the global specular operator of section 3.3).

use super::directions::LANES;
use super::flow::ChainFlow;
use super::lights::PointLighting;
use super::lobe_table::{BAND, Band, LobeTable};
use super::scatter::{Lobe, Scatter, reflect};
use super::settings::ChainLimits;
use super::specular::{SpecularMaterial, SpecularPoint, SpecularSet};
use crate::points::{NO_POINT, SamplePoints};
use crate::simd::wide;
use rayon::prelude::*;

/// Specular points whose outgoing radiances are held at a time.
const BLOCK: usize = 64;
/// More reflections than this are never followed: perfect mirrors in a closed box never end.
const LONGEST: u32 = 2000;

/// Radiance on its way from specular point to specular point: per point and link, `[bands]`.
type State = Vec<Vec<Band>>;

/// What one specular point sends out in one bounce.
struct Outgoing {
    /// Radiance towards each member, `[members][bands]`.
    radiance: Vec<Band>,
    /// Flux that came in, after absorption on the way, and absorbed on the way.
    entered: Vec<f64>,
    medium: Vec<f64>,
}

impl SpecularSet {
    /// The irradiance of all points by specular chains that start with the diffuse `radiance`
    /// (`[W][N]`) of all points. Same bits for any number of threads.
    pub fn apply(&self, points: &SamplePoints, radiance: &[f32], limits: &ChainLimits) -> ChainFlow {
        let by_point = interleave(radiance, points.len(), self.wavelengths, self.bands());
        self.chains(
            &Bounce { set: self, points, radiance: Some(&by_point), lights: None, state: None },
            limits,
        )
    }

    /// The same by the chains that start with what point lights bring to specular points.
    pub fn apply_to_lights(
        &self,
        points: &SamplePoints,
        lights: &PointLighting,
        limits: &ChainLimits,
    ) -> ChainFlow {
        self.chains(&Bounce { set: self, points, radiance: None, lights: Some(lights), state: None }, limits)
    }

    /// The chains that begin with the `first` bounce.
    fn chains(&self, first: &Bounce, limits: &ChainLimits) -> ChainFlow {
        let points = first.points;
        let (n, w, bands) = (points.len(), self.wavelengths, self.bands());
        let zeros = || vec![0.0f64; w];
        let mut flow = ChainFlow {
            irradiance: vec![0.0; n * w],
            entered: zeros(),
            left: zeros(),
            escaped: zeros(),
            medium: zeros(),
            cut_off: zeros(),
            bounces: 0,
        };
        let longest = limits.lg_max.unwrap_or(LONGEST).min(LONGEST);
        if self.points.is_empty() || longest == 0 {
            return flow;
        }
        let mut all: State = self.points.iter().map(|p| vec![[0.0; BAND]; p.links.len() * bands]).collect();
        let mut state: Option<State> = None;
        let mut start = (zeros(), 0.0f64);
        loop {
            let under_way = state.as_ref();
            let onward = Bounce { set: self, points, radiance: None, lights: None, state: under_way };
            let next = self.bounce(if state.is_none() { first } else { &onward });
            flow.bounces += 1;
            let pending = self.pending(points, &next);
            if flow.bounces == 1 {
                start = first.strength();
            }
            let worst = relative(&pending.flux, &start.0);
            if flow.bounces >= longest || worst <= limits.tolerance {
                add(&mut flow.cut_off, &pending.signed);
                break;
            }
            let next = self.prune(points, next, limits.eff_min * start.1, &mut flow.cut_off);
            for (all, next) in all.iter_mut().flatten().zip(next.iter().flatten()) {
                (0..BAND).for_each(|lane| all[lane] += next[lane]);
            }
            state = Some(next);
        }
        let mut sums = vec![0.0f64; n * w];
        let arrived = Bounce { state: Some(&all), ..*first };
        self.deliver(&arrived, &mut sums, &mut flow);
        for i in 0..n {
            for k in 0..w {
                flow.irradiance[k * n + i] = sums[i * w + k] as f32;
            }
        }
        flow
    }

    /// One bounce of all points, as far as specular points see it.
    fn bounce(&self, bounce: &Bounce) -> State {
        let bands = self.bands();
        let mut next: State = self.points.iter().map(|p| vec![[0.0; BAND]; p.links.len() * bands]).collect();
        for first in (0..self.points.len()).step_by(BLOCK) {
            let block = first..(first + BLOCK).min(self.points.len());
            let towards = |s: usize| bounce.outgoing(s, self.points[s].link_groups).radiance;
            let outgoing: Vec<Vec<Band>> = block.clone().into_par_iter().map(towards).collect();
            for (s, radiance) in block.zip(&outgoing) {
                for link in self.points[s].links.iter().filter(|l| l.back != NO_POINT) {
                    let (from, to) = (link.member as usize * bands, link.back as usize * bands);
                    next[link.point as usize][to..to + bands].copy_from_slice(&radiance[from..from + bands]);
                }
            }
        }
        next
    }

    /// What all the light that ever arrived at specular points becomes: irradiance and flows. Specular points take
    /// part in every bounce, all others in this one only.
    fn deliver(&self, bounce: &Bounce, sums: &mut [f64], flow: &mut ChainFlow) {
        let (w, bands) = (self.wavelengths, self.bands());
        for first in (0..self.points.len()).step_by(BLOCK) {
            let block = first..(first + BLOCK).min(self.points.len());
            let all = |s: usize| bounce.outgoing(s, self.points[s].reflection.groups());
            let outgoing: Vec<Outgoing> = block.clone().into_par_iter().map(all).collect();
            for (s, out) in block.zip(&outgoing) {
                let point = &self.points[s];
                let area = f64::from(bounce.points.area[point.point as usize]);
                add(&mut flow.entered, &out.entered);
                add(&mut flow.medium, &out.medium);
                for (k, &member) in point.members.iter().enumerate() {
                    let towards = &out.radiance[k * bands..(k + 1) * bands];
                    if towards.iter().flatten().all(|&l| l == 0.0) {
                        continue;
                    }
                    for c in 0..w {
                        let l = f64::from(towards[c / BAND][c % BAND]);
                        let flux = area * f64::from(point.q_in[k]) * l;
                        flow.left[c] += flux;
                        if member == NO_POINT {
                            flow.escaped[c] += flux;
                        } else {
                            let through = f64::from(self.through(point, k, c));
                            sums[member as usize * w + c] += f64::from(point.q_out[k]) * l * through;
                        }
                    }
                }
                // What a diffuse member inside a solid gets is less than what was sent.
                if !point.distance.is_empty() {
                    for (k, &member) in point.members.iter().enumerate() {
                        if member != NO_POINT && !self.is_linked(point, k) {
                            for c in 0..w {
                                let l = f64::from(out.radiance[k * bands + c / BAND][c % BAND]);
                                let lost = 1.0 - f64::from(self.through(point, k, c));
                                flow.medium[c] += area * f64::from(point.q_in[k]) * l * lost;
                            }
                        }
                    }
                }
            }
        }
    }

    /// Whether member `k` is a specular point.
    fn is_linked(&self, point: &SpecularPoint, k: usize) -> bool {
        self.points.binary_search_by_key(&point.members[k], |p| p.point).is_ok()
    }

    /// Share of light of wavelength `c` that survives the way to member `k` (Beer-Lambert).
    pub fn through(&self, point: &SpecularPoint, k: usize, c: usize) -> f32 {
        let Some(&distance) = point.distance.get(k) else { return 1.0 };
        let absorption = |p: &SpecularPoint| {
            self.material(p).filter(|_| p.inside).and_then(|m| m.absorption.get(c)).copied()
        };
        let other = || {
            let at = self.points.binary_search_by_key(&point.members[k], |p| p.point).ok()?;
            absorption(&self.points[at])
        };
        absorption(point).or_else(other).map_or(1.0, |a| (-a * distance).exp())
    }

    /// Flux on its way to specular points.
    fn pending(&self, points: &SamplePoints, state: &State) -> Pending {
        let w = self.wavelengths;
        let mut pending = Pending { flux: vec![0.0; w], signed: vec![0.0; w] };
        for (s, point) in self.points.iter().enumerate() {
            let area = f64::from(points.area[point.point as usize]);
            for (link, l) in point.links.iter().zip(state[s].chunks(self.bands())) {
                let q = area * f64::from(point.q_in[link.member as usize]);
                for c in 0..w {
                    let flux = q * f64::from(l[c / BAND][c % BAND]);
                    pending.flux[c] += flux.abs();
                    pending.signed[c] += flux;
                }
            }
        }
        pending
    }

    /// Forgets what reaches points with less than `least` irradiance, and counts it as cut off.
    fn prune(&self, points: &SamplePoints, mut state: State, least: f64, cut_off: &mut [f64]) -> State {
        if least <= 0.0 {
            return state;
        }
        let (w, bands) = (self.wavelengths, self.bands());
        for (point, state) in self.points.iter().zip(&mut state) {
            let mut signed = vec![0.0; w];
            let mut strength = vec![0.0; w];
            for (link, l) in point.links.iter().zip(state.chunks(bands)) {
                let q = f64::from(point.q_in[link.member as usize]);
                for c in 0..w {
                    signed[c] += q * f64::from(l[c / BAND][c % BAND]);
                    strength[c] += q * f64::from(l[c / BAND][c % BAND]).abs();
                }
            }
            if strength.iter().all(|&e| e < least) {
                let area = f64::from(points.area[point.point as usize]);
                for c in 0..w {
                    cut_off[c] += area * signed[c];
                }
                state.fill([0.0; BAND]);
            }
        }
        state
    }
}

/// Flux in the chains: its size and its sum.
struct Pending {
    flux: Vec<f64>,
    signed: Vec<f64>,
}

/// The sources of one bounce: diffuse radiance or point lights in the first, radiance under way in the others, both to deliver.
struct Bounce<'a> {
    set: &'a SpecularSet,
    points: &'a SamplePoints,
    /// Diffuse radiance of all points, `[N][bands]`.
    radiance: Option<&'a [Band]>,
    /// What point lights bring.
    lights: Option<&'a PointLighting>,
    /// Radiance under way.
    state: Option<&'a State>,
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
    fn outgoing(&self, s: usize, groups: usize) -> Outgoing {
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
    fn strength(&self) -> (Vec<f64>, f64) {
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

/// `[W][N]` to `[N][bands]`.
fn interleave(radiance: &[f32], n: usize, w: usize, bands: usize) -> Vec<Band> {
    let mut by_point = vec![[0.0; BAND]; n * bands];
    for k in 0..w {
        for i in 0..n {
            by_point[i * bands + k / BAND][k % BAND] = radiance[k * n + i];
        }
    }
    by_point
}

/// Largest of `part / whole` over the wavelengths; 0 where the whole is.
fn relative(part: &[f64], whole: &[f64]) -> f64 {
    part.iter().zip(whole).map(|(p, w)| if *w > 0.0 { p / w } else { 0.0 }).fold(0.0, f64::max)
}

/// Element-wise sum.
fn add(sum: &mut [f64], more: &[f64]) {
    sum.iter_mut().zip(more).for_each(|(s, m)| *s += m);
}

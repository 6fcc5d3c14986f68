//! The specular chains D(S...)D: what diffuse radiance becomes after one or more specular
//! reflections or transmissions in a row (the global specular operator of section 3.3).

use super::bounce::{Bounce, Outgoing, State};
use super::directions::LANES;
use super::flow::ChainFlow;
use super::lights::PointLighting;
use super::settings::ChainLimits;
use super::specular::{SpecularMaterial, SpecularPoint, SpecularSet};
use crate::points::{NO_POINT, SamplePoints};
use rayon::prelude::*;

/// Specular points whose outgoing radiances are held at a time.
const BLOCK: usize = 64;
/// Parts of what is delivered that are summed up apart.
const PARTS: usize = 16;
/// More reflections than this are never followed: perfect mirrors in a closed box never end.
const LONGEST: u32 = 2000;

impl SpecularSet {
    /// The irradiance of all points by specular chains that start with the diffuse `radiance`
    /// (`[W][N]`) of all points. Same bits for any number of threads.
    pub fn apply(&self, points: &SamplePoints, radiance: &[f32], limits: &ChainLimits) -> ChainFlow {
        let by_point = interleave(radiance, points.len(), self.wavelengths);
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

    /// How much of the radiance of each sample point falls on specular points, m² sr: `[N]`.
    pub(super) fn importance(&self, points: &SamplePoints) -> Vec<f32> {
        let mut importance = vec![0.0; points.len()];
        for point in &self.points {
            let area = points.area[point.point as usize];
            for (&member, q_in) in point.members.iter().zip(&point.q_in).filter(|(m, _)| **m != NO_POINT) {
                importance[member as usize] += area * q_in;
            }
        }
        importance
    }

    /// Flux that the diffuse `radiance` (`[W][N]`) of all points brings to specular points, W nm⁻¹: `[W]`.
    pub(super) fn entering(&self, points: &SamplePoints, radiance: &[f32]) -> Vec<f64> {
        let by_point = interleave(radiance, points.len(), self.wavelengths);
        let bounce = Bounce { set: self, points, radiance: Some(&by_point), lights: None, state: None };
        let entered: Vec<Vec<f64>> =
            (0..self.points.len()).into_par_iter().map(|s| bounce.entering(s)).collect();
        entered.iter().fold(vec![0.0; self.wavelengths], |mut sum, more| {
            add(&mut sum, more);
            sum
        })
    }

    /// The largest share of light of wavelength `k` that any point reflects or lets through.
    pub(super) fn most(&self, k: usize) -> f64 {
        let of = |m: &SpecularMaterial| {
            if m.transmit.is_some() { 1.0 } else { f64::from(m.reflect.most(k)).min(1.0) }
        };
        self.points.iter().filter_map(|p| self.material(p)).map(of).fold(0.0, f64::max)
    }

    /// The chains that begin with the `first` bounce.
    fn chains(&self, first: &Bounce, limits: &ChainLimits) -> ChainFlow {
        let points = first.points;
        let (n, w) = (points.len(), self.wavelengths);
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
        let mut all: State = self.points.iter().map(|p| vec![0.0; p.links.len() * w]).collect();
        let mut state: Option<State> = None;
        let mut start = (zeros(), 0.0f64);
        loop {
            let under_way = state.as_ref();
            let onward = Bounce { set: self, points, radiance: None, lights: None, state: under_way };
            let (next, strength) = self.bounce(if state.is_none() { first } else { &onward });
            flow.bounces += 1;
            let pending = self.pending(points, &next);
            if flow.bounces == 1 {
                start = self.start(points, &strength);
            }
            let worst = relative(&pending.flux, &start.0);
            if flow.bounces >= longest || worst <= limits.tolerance {
                add(&mut flow.cut_off, &pending.signed);
                break;
            }
            let next = self.prune(points, next, limits.eff_min * start.1, &mut flow.cut_off);
            for (all, next) in all.iter_mut().flatten().zip(next.iter().flatten()) {
                *all += next;
            }
            state = Some(next);
        }
        self.deliver(&Bounce { state: Some(&all), ..*first }, &mut flow);
        flow
    }

    /// One bounce of all points, as far as specular points see it; also [`Outgoing::strength`] of each.
    fn bounce(&self, bounce: &Bounce) -> (State, Vec<Vec<f64>>) {
        let w = self.wavelengths;
        let mut strength = Vec::with_capacity(self.points.len());
        let mut next: State = self.points.iter().map(|p| vec![0.0; p.links.len() * w]).collect();
        for first in (0..self.points.len()).step_by(BLOCK) {
            let block = first..(first + BLOCK).min(self.points.len());
            let towards = |s: usize| bounce.outgoing(s, self.points[s].link_groups);
            let outgoing: Vec<Outgoing> = block.clone().into_par_iter().map(towards).collect();
            for (s, Outgoing { radiance, strength: own, .. }) in block.zip(outgoing) {
                strength.push(own);
                for link in self.points[s].links.iter().filter(|l| l.back != NO_POINT) {
                    let (group, lane) = (link.member as usize / LANES * w, link.member as usize % LANES);
                    let next = &mut next[link.point as usize][link.back as usize * w..][..w];
                    next.iter_mut().zip(&radiance[group..]).for_each(|(next, l)| *next = l[lane]);
                }
            }
        }
        (next, strength)
    }

    /// Flux and largest irradiance that the first bounce starts from.
    fn start(&self, points: &SamplePoints, strength: &[Vec<f64>]) -> (Vec<f64>, f64) {
        let (mut flux, mut largest) = (vec![0.0; self.wavelengths], 0.0f64);
        for (point, irradiance) in self.points.iter().zip(strength) {
            let area = f64::from(points.area[point.point as usize]);
            for (flux, irradiance) in flux.iter_mut().zip(irradiance) {
                *flux += area * irradiance;
                largest = largest.max(*irradiance);
            }
        }
        (flux, largest)
    }

    /// What all the light that ever arrived at specular points becomes: irradiance and flows. Specular points take
    /// part in every bounce, all others in this one only.
    fn deliver(&self, bounce: &Bounce, flow: &mut ChainFlow) {
        let (n, w) = (bounce.points.len(), self.wavelengths);
        let length = self.points.len().div_ceil(PARTS);
        let part = |part: usize| {
            let mut delivered = Delivered { sums: vec![0.0; n * w], ..Default::default() };
            for total in delivered.flows() {
                total.resize(w, 0.0);
            }
            for s in part * length..((part + 1) * length).min(self.points.len()) {
                self.deliver_from(bounce, s, &mut delivered);
            }
            delivered
        };
        let mut parts: Vec<Delivered> = (0..PARTS).into_par_iter().map(part).collect();
        for part in &mut parts {
            let totals = [&mut flow.entered, &mut flow.left, &mut flow.escaped, &mut flow.medium];
            totals.into_iter().zip(part.flows()).for_each(|(total, part)| add(total, part));
        }
        flow.irradiance.par_chunks_mut(n).enumerate().for_each(|(k, irradiance)| {
            for (i, e) in irradiance.iter_mut().enumerate() {
                *e = parts.iter().map(|part| part.sums[i * w + k]).sum::<f64>() as f32;
            }
        });
    }

    /// Adds what specular point `s` delivers.
    fn deliver_from(&self, bounce: &Bounce, s: usize, delivered: &mut Delivered) {
        let w = self.wavelengths;
        let point = &self.points[s];
        let out = bounce.outgoing(s, point.reflection.groups());
        let area = f64::from(bounce.points.area[point.point as usize]);
        add(&mut delivered.entered, &out.entered);
        add(&mut delivered.medium, &out.medium);
        let absorbs = !point.distance.is_empty();
        for (k, &member) in point.members.iter().enumerate() {
            let (q_in, q_out) = (area * f64::from(point.q_in[k]), f64::from(point.q_out[k]));
            // What a diffuse member inside a solid gets is less than what was sent.
            let ends = absorbs && member != NO_POINT && !self.is_linked(point, k);
            for (c, towards) in out.radiance[k / LANES * w..][..w].iter().enumerate() {
                let l = f64::from(towards[k % LANES]);
                delivered.left[c] += q_in * l;
                if member == NO_POINT {
                    delivered.escaped[c] += q_in * l;
                    continue;
                }
                let through = if absorbs { f64::from(self.through(point, k, c)) } else { 1.0 };
                delivered.sums[member as usize * w + c] += q_out * l * through;
                if ends {
                    delivered.medium[c] += q_in * l * (1.0 - through);
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
            for (link, l) in point.links.iter().zip(state[s].chunks(w)) {
                let q = area * f64::from(point.q_in[link.member as usize]);
                for (c, &l) in l.iter().enumerate() {
                    let flux = q * f64::from(l);
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
        let w = self.wavelengths;
        for (point, state) in self.points.iter().zip(&mut state) {
            let mut signed = vec![0.0; w];
            let mut strength = vec![0.0; w];
            for (link, l) in point.links.iter().zip(state.chunks(w)) {
                let q = f64::from(point.q_in[link.member as usize]);
                for (c, &l) in l.iter().enumerate() {
                    signed[c] += q * f64::from(l);
                    strength[c] += q * f64::from(l).abs();
                }
            }
            if strength.iter().all(|&e| e < least) {
                let area = f64::from(points.area[point.point as usize]);
                for c in 0..w {
                    cut_off[c] += area * signed[c];
                }
                state.fill(0.0);
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

/// What some specular points deliver.
#[derive(Default)]
struct Delivered {
    /// Irradiance, `[N][W]`.
    sums: Vec<f64>,
    entered: Vec<f64>,
    left: Vec<f64>,
    escaped: Vec<f64>,
    medium: Vec<f64>,
}

impl Delivered {
    /// What entered and left specular points, escaped, and was absorbed on the way.
    fn flows(&mut self) -> [&mut Vec<f64>; 4] {
        [&mut self.entered, &mut self.left, &mut self.escaped, &mut self.medium]
    }
}

/// `[W][N]` to `[N + 1][W]`, the last 0.
fn interleave(radiance: &[f32], n: usize, w: usize) -> Vec<f32> {
    let known = (0..n * w).map(|at| radiance[at % w * n + at / w]);
    known.chain(std::iter::repeat_n(0.0, w)).collect()
}

/// Largest of `part / whole` over the wavelengths; 0 where the whole is.
fn relative(part: &[f64], whole: &[f64]) -> f64 {
    part.iter().zip(whole).map(|(p, w)| if *w > 0.0 { p / w } else { 0.0 }).fold(0.0, f64::max)
}

/// Element-wise sum.
fn add(sum: &mut [f64], more: &[f64]) {
    sum.iter_mut().zip(more).for_each(|(s, m)| *s += m);
}

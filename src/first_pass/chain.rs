//! The specular chains D(S...)D: what diffuse radiance becomes after one or more specular
//! reflections or transmissions in a row (the global specular operator of section 3.3).

use super::bounce::{Bounce, Outgoing, State};
use super::flow::ChainFlow;
use super::lights::PointLighting;
use super::lobe_table::{BAND, Band};
use super::settings::ChainLimits;
use super::specular::{SpecularPoint, SpecularSet};
use crate::points::{NO_POINT, SamplePoints};
use rayon::prelude::*;

/// Specular points whose outgoing radiances are held at a time.
const BLOCK: usize = 64;
/// More reflections than this are never followed: perfect mirrors in a closed box never end.
const LONGEST: u32 = 2000;

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

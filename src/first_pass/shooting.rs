//! Progressive shooting (section 3.3.2; Cohen et al. 1988): the point with most unshot power first.

use super::corrections::Corrections;
use super::settings::FirstPassSettings;
use super::system::{Solved, System, unfinished};
use crate::error::{Error, Result};
use std::f64::consts::PI;

/// Shoots until the unshot flux is below the tolerance. The chains are followed for all that was
/// shot since the last time, whenever the diffuse part is done.
pub fn solve(system: &System, settings: &FirstPassSettings, mut progress: impl FnMut(f64)) -> Result<Solved> {
    let (n, w) = (system.points.len(), system.wavelengths());
    let by_source = system.diffuse.corrections().transposed();
    let emitted = system.emitted();
    let sources = system.sources();
    let mut state =
        Shooting { system, by_source, radiance: sources.clone(), unshot: sources, shot: vec![0.0; n * w] };
    let mut flow = system.light_chains.clone();
    let (mut shots, mut rounds) = (0usize, 0);
    let limit = n.saturating_mul(settings.max_sweeps as usize);
    let chains = !system.specular.points.is_empty();
    // Half of the tolerance for the diffuse part leaves half for the chains.
    let goal = if chains { 0.5 * settings.tolerance } else { settings.tolerance };
    loop {
        loop {
            let unshot = worst(&system.flux(&state.unshot), &emitted);
            if unshot <= goal {
                break;
            }
            progress(unshot / goal);
            // The flux is summed once in so many shots: the sum costs as much as a shot.
            for _ in 0..(n / 16).max(1) {
                if let Some(j) = state.brightest() {
                    state.shoot(j);
                    shots += 1;
                }
            }
            if !state.radiance.iter().all(|l| l.is_finite()) {
                return Err(diverged());
            }
            if shots > limit {
                return Err(unfinished(settings));
            }
        }
        if !chains || worst(&system.flux(&state.shot), &emitted) <= goal {
            break;
        }
        let step = system.specular.apply(system.points, &state.shot, &settings.chain);
        rounds += 1;
        if rounds > settings.max_sweeps {
            return Err(unfinished(settings));
        }
        flow.add_scaled(&step, &vec![1.0; w]);
        state.shot.fill(0.0);
        for (i, l) in system.reflected(&step.irradiance).into_iter().enumerate() {
            state.radiance[i] += l;
            state.unshot[i] += l;
        }
    }
    let sweeps = shots as f64 / n.max(1) as f64;
    Ok(Solved { radiance: state.radiance, flow, sweeps, rounds })
}

/// The error of a system that gains energy.
pub fn diverged() -> Error {
    Error::Numerical(
        "the light grows without end: in a closed scene something must absorb, so lower the highest reflectances; \
         with the paper's kernel, use the analytic one or sample more finely"
            .into(),
    )
}

/// Largest of `part / whole`.
fn worst(part: &[f64], whole: &[f64]) -> f64 {
    part.iter().zip(whole).map(|(p, w)| if *w > 0.0 { p / w } else { 0.0 }).fold(0.0, f64::max)
}

struct Shooting<'a> {
    system: &'a System<'a>,
    by_source: Corrections,
    radiance: Vec<f32>,
    unshot: Vec<f32>,
    /// Shot since the chains were last followed.
    shot: Vec<f32>,
}

impl Shooting<'_> {
    /// The point with the most unshot flux over all wavelengths.
    fn brightest(&self) -> Option<usize> {
        let n = self.system.points.len();
        let power = |i: usize| {
            let sum: f32 = (0..self.system.wavelengths()).map(|k| self.unshot[k * n + i].abs()).sum();
            PI * f64::from(sum * self.system.points.area[i])
        };
        (0..n)
            .map(|i| (i, power(i)))
            .fold(
                None,
                |best: Option<(usize, f64)>, (i, p)| {
                    if p > best.map_or(0.0, |b| b.1) { Some((i, p)) } else { best }
                },
            )
            .map(|(i, _)| i)
    }

    /// Sends the unshot radiance of `j` to all points that see it.
    fn shoot(&mut self, j: usize) {
        let n = self.system.points.len();
        let w = self.system.wavelengths();
        let sent: Vec<f32> = (0..w).map(|k| self.unshot[k * n + j]).collect();
        for (k, &l) in sent.iter().enumerate() {
            self.unshot[k * n + j] = 0.0;
            self.shot[k * n + j] += l;
        }
        let system = self.system;
        let mut receive = |i: usize, q: f32| {
            for (k, &l) in sent.iter().enumerate() {
                let mut send = |i: usize, share: f32| {
                    let more = share * std::f32::consts::FRAC_1_PI * q * l;
                    self.radiance[k * n + i] += more;
                    self.unshot[k * n + i] += more;
                };
                send(i, system.response.reflectance[k * n + i]);
                if let Some((twin, share)) = system.response.passed(k, i) {
                    send(twin, share);
                }
            }
        };
        system.diffuse.column(j, &mut receive);
        for (i, difference) in self.by_source.row(j) {
            receive(i, difference);
        }
    }
}

//! The complete iterative solution of a [`System`]. Where nothing is specular it is GMRES; else generalized conjugate
//! residuals on the whole of it, with its diffuse part, and what is known of chains, solved as preconditioner, since a sweep
//! costs less than a round of specular chains.

use super::flow::ChainFlow;
use super::gmres::{self, Outcome};
use super::known::{Known, Vectors};
use super::recalled::{Basis, Direction, Recalled};
use super::rooms::weights;
use super::settings::FirstPassSettings;
use super::system::{Solved, System, unfinished};
use crate::error::Result;
use std::f64::consts::PI;

/// How much of the residual a step may leave at first.
const LOOSE: f64 = 0.3;
/// No more lamps than these are each solved for, where that is to be recalled.
const MOST_LAMPS: usize = 4;
/// How much of what may be left is aimed at.
const ENOUGH: f64 = 0.8;
/// The least of the goal that is ever left to a step: to less it would go on and on.
const ROOM: f64 = 0.1;
/// How many times the goal the flux may be that is not followed.
const MOST_CUT: f64 = 2.0;

impl System<'_> {
    /// Solves the system. It goes on from what is `recalled`, and adds to it. `progress` hears how many times its goal
    /// the residual is.
    ///
    /// # Errors
    /// [`Error::Numerical`](crate::error::Error::Numerical) when the tolerance is not reached.
    pub fn solve_iteratively(
        &self,
        settings: &FirstPassSettings,
        recalled: &mut Recalled,
        progress: impl FnMut(f64),
    ) -> Result<Solved> {
        let mut residual = self.sources();
        let weights = weights(self.points, &self.rooms.room, &residual);
        let reflected = |e: &[f32]| self.reflected(e);
        let apply = |x: &[f32]| self.specular.apply(self.points, x, &settings.chain);
        let seen = self.specular.importance(self.points);
        let norms = [&weights[..], &seen];
        let renewed = recalled.renew(&residual, norms, reflected, apply);
        let basis = recalled.basis(norms, reflected);
        let (mut x, mut chains) = (vec![0.0; residual.len()], ChainFlow::default());
        basis.take(&mut residual, 1.0, &mut x, &mut chains);

        let goals = self.goals(settings.tolerance);
        let mut search =
            Search { system: self, settings, norms, basis, goals, x, chains, residual, sweeps: 0 };
        let (mut rounds, mut end) = (0, None);
        if self.specular.points.is_empty() {
            search.without_chains(progress)?;
        } else {
            let known = recalled.diffuse().map(|(x, diffuse)| (x.to_vec(), diffuse.to_vec())).collect();
            (rounds, end) = search.with_chains(known, progress)?;
            rounds += u32::from(renewed);
        }

        let Search { x, chains, sweeps, basis, .. } = search;
        let found = basis.found();
        if settings.recall {
            found.into_iter().for_each(|direction| recalled.add(direction));
            end.into_iter().for_each(|end| recalled.add_end(end.x, end.diffuse));
        }
        let mut flow = self.light_chains.clone();
        flow.add_scaled(&chains, &vec![1.0; self.wavelengths()]);
        Ok(Solved { radiance: x, flow, sweeps: sweeps as f64, rounds })
    }
}

/// A solution on the way.
struct Search<'s, 'a> {
    system: &'s System<'a>,
    settings: &'s FirstPassSettings,
    /// How points count in residuals, and how much of their light falls on specular points.
    norms: [&'s [f32]; 2],
    /// Directions x with A x, of earlier appearances and of this one.
    basis: Basis<'s>,
    /// How much of the residual may be left, by wavelength.
    goals: Vec<f64>,
    x: Vec<f32>,
    /// C x.
    chains: ChainFlow,
    /// b - A x.
    residual: Vec<f32>,
    sweeps: usize,
}

impl Search<'_, '_> {
    /// Whether what is `left`, by wavelength, is little enough.
    fn is_enough(&self, left: impl IntoIterator<Item = f64>) -> bool {
        left.into_iter().zip(&self.goals).all(|(left, goal)| left <= *goal)
    }

    /// Solves a system without chains.
    fn without_chains(&mut self, mut progress: impl FnMut(f64)) -> Result<()> {
        let Search { system, settings, norms, basis, goals, sweeps, .. } = self;
        let measure = (&system.points.area[..], norms[0]);
        let mut directions = Vec::new();
        let solved =
            gmres::solve(&self.residual, measure, goals, settings.max_sweeps as usize, |v, excess| {
                progress(excess);
                let diffuse = system.diffuse.irradiance(v, |i| settings.recall || system.response.active[i]);
                *sweeps += 1;
                let (mut x, mut image) = (v.to_vec(), system.absorbed(v, &diffuse));
                basis.take(&mut image, -1.0, &mut x, &mut ChainFlow::default());
                if settings.recall {
                    directions.push(Direction {
                        radiance: v.to_vec(),
                        diffuse,
                        chains: ChainFlow::default(),
                    });
                }
                Ok((x, image))
            });
        let Outcome { x, left, .. } = solved?;
        self.x.iter_mut().zip(&x).for_each(|(x, more)| *x += more);
        directions.into_iter().for_each(|direction| self.basis.keep(direction));
        if self.is_enough(left) { Ok(()) } else { Err(unfinished(self.settings)) }
    }

    /// Solves a system with chains, given D x of some x. Returns the rounds of chains, and the last step where it cost none.
    fn with_chains(
        &mut self,
        recalled: Vec<(Vec<f32>, Vec<f32>)>,
        mut progress: impl FnMut(f64),
    ) -> Result<(u32, Option<Vectors>)> {
        let Search { system, settings, .. } = *self;
        let mut known = self.known(recalled);
        let turned = self.turned();
        let mut before = 0;
        // Light of single lamps is known to later appearances from the first on.
        let lamps = if settings.recall && self.basis.is_empty() { system.lamps() } else { Vec::new() };
        if (2..=MOST_LAMPS).contains(&lamps.len()) {
            for lamp in lamps {
                let all = std::mem::replace(&mut self.residual, lamp);
                let (step, _) = self.step(&mut known, &turned);
                self.residual = all;
                known = self.follow(step, known);
                before += 1;
            }
            self.basis.take(&mut self.residual, 1.0, &mut self.x, &mut self.chains);
        }
        for round in before..settings.max_sweeps {
            let left = self.sizes(&self.residual);
            if self.is_enough(left.iter().copied()) {
                return Ok((round, None));
            }
            let excess = left.iter().zip(&self.goals).map(|(left, goal)| left / goal).fold(1.0, f64::max);
            if !left.iter().all(|left| left.is_finite()) || self.sweeps >= settings.max_sweeps as usize {
                break;
            }
            progress(excess);
            let (step, ends) = self.step(&mut known, &turned);
            if ends {
                self.end(&step);
                return Ok((round, Some(step)));
            }
            known = self.follow(step, known);
            self.basis.take(&mut self.residual, 1.0, &mut self.x, &mut self.chains);
        }
        Err(unfinished(settings))
    }

    /// Follows what chains make of a step, which becomes a direction of the basis. What was `known` then is of another C.
    fn follow(&mut self, step: Vectors, known: Known) -> Known {
        let (system, limits) = (self.system, &self.settings.chain);
        let chains = system.specular.apply(system.points, &step.x, limits);
        let direction = Direction { radiance: step.x, diffuse: step.diffuse, chains };
        let image = system.absorbed(&direction.radiance, &direction.irradiance());
        self.basis.add(direction, image);
        self.known(known.into_vectors())
    }

    /// The size of a residual, by wavelength.
    fn sizes(&self, residual: &[f32]) -> Vec<f64> {
        gmres::sizes((&self.system.points.area, self.norms[0]), self.goals.len(), residual)
    }

    /// (1 - ρ/π (D + C)) x, given D x, with what is known of C.
    fn image(&self, x: &[f32], diffuse: &[f32]) -> Vec<f32> {
        let mut irradiance = diffuse.to_vec();
        self.basis.follow(x).irradiance(&self.basis, &mut irradiance);
        self.system.absorbed(x, &irradiance)
    }

    /// Directions x, of which D x is known, for [`Search::diffuse_step`].
    fn known(&self, vectors: impl IntoIterator<Item = (Vec<f32>, Vec<f32>)>) -> Known {
        let mut known = Known::default();
        for (x, diffuse) in vectors {
            let image = self.image(&x, &diffuse);
            known.add(Vectors { x, diffuse, image }, self.norms[0]);
        }
        known
    }

    /// An x that leaves no more of the residual than a share of `goal` by what is known of chains, as far as the sweeps that
    /// are left allow.
    fn diffuse_step(&mut self, known: &mut Known, goal: f64) -> Vectors {
        let (system, all) = (self.system, self.settings.recall);
        let most = (self.settings.max_sweeps as usize).saturating_sub(self.sweeps);
        let mut sweeps = 0;
        let step = known.solve(&self.residual, self.norms[0], goal, most, |v| {
            sweeps += 1;
            let diffuse = system.diffuse.irradiance(v, |i| all || system.response.active[i]);
            let image = self.image(v, &diffuse);
            (diffuse, image)
        });
        self.sweeps += sweeps;
        step
    }

    /// A step that leaves no more of the residual than the chains that are not known may, and whether these need not be
    /// known: it may be so little that is not followed that all that can come of it may be left. `turned` is the share
    /// that comes of it at most.
    fn step(&mut self, known: &mut Known, turned: &[f64]) -> (Vectors, bool) {
        let (mut goal, mut before) = (LOOSE, vec![f64::INFINITY; self.goals.len()]);
        loop {
            let step = self.diffuse_step(known, goal);
            let (left, unfollowed) = (self.sizes(&step.image), self.unfollowed(&step.x));
            let more: Vec<f64> = unfollowed.iter().zip(turned).map(|(flux, turned)| turned * flux).collect();
            let ends = self.is_enough(unfollowed.iter().map(|flux| flux / MOST_CUT))
                && self.is_enough(more.iter().map(|more| more / (1.0 - ROOM)));
            let most = |(more, goal): (&f64, &f64)| if ends { goal - more } else { more.max(ROOM * goal) };
            let most: Vec<f64> = more.iter().zip(&self.goals).map(most).collect();
            if ends && left.iter().zip(&most).all(|(left, most)| left <= most) {
                return (step, true);
            }
            let stuck = left.iter().zip(&before).all(|(left, before)| left >= before);
            goal = self.share(&step, &most);
            if goal >= 1.0 || stuck || self.sweeps >= self.settings.max_sweeps as usize {
                return (step, false);
            }
            before = left;
        }
    }

    /// How much of the light of x falls on specular points and is not known to go on, by wavelength; as the size of a residual
    /// that it could become.
    fn unfollowed(&self, x: &[f32]) -> Vec<f64> {
        let Search { system, norms: [weights, seen], .. } = *self;
        // The measure of a residual counts areas more in weaker rooms.
        let heaviest =
            weights.iter().zip(&system.points.area).map(|(w, a)| (w / a).sqrt()).fold(1.0, f32::max);
        let rest = self.basis.follow(x).left(&self.basis, x);
        let flux = |rest: &[f32]| rest.iter().zip(seen).map(|(l, h)| f64::from(l.abs() * h)).sum::<f64>();
        rest.chunks(seen.len()).map(|rest| f64::from(heaviest) * flux(rest) / PI).collect()
    }

    /// The share of the residual, in its mean square, that a step should leave for the size of what it leaves to come
    /// within `most`; 1 where it has.
    fn share(&self, step: &Vectors, most: &[f64]) -> f64 {
        let n = self.system.points.len();
        let norm = |v: &[f32], k: usize| {
            let plane = &v[k * n..(k + 1) * n];
            gmres::inner(self.norms[0], plane, plane).sqrt()
        };
        let share = |(k, (left, most)): (usize, (f64, &f64))| {
            let share = norm(&step.image, k) / norm(&self.residual, k);
            if left > *most { ENOUGH * share * most / left } else { 1.0 }
        };
        self.sizes(&step.image).into_iter().zip(most).enumerate().map(share).fold(1.0, f64::min)
    }

    /// The largest share of what falls on specular points that is ever reflected diffusely after its first reflection, by
    /// wavelength.
    fn turned(&self) -> Vec<f64> {
        let System { response, specular, points, .. } = self.system;
        let most = |k: usize| (0..points.len()).map(|i| response.turned(k, i)).fold(0.0, f64::max);
        (0..self.goals.len()).map(|k| most(k) * specular.most(k)).collect()
    }

    /// Takes a last step, of which no more is followed than is known.
    fn end(&mut self, step: &Vectors) {
        self.x.iter_mut().zip(&step.x).for_each(|(x, more)| *x += more);
        let followed = self.basis.follow(&step.x);
        followed.chains(&self.basis, &mut self.chains);
        let rest = followed.left(&self.basis, &step.x);
        let flux = self.system.specular.entering(self.system.points, &rest);
        for total in [&mut self.chains.entered, &mut self.chains.cut_off] {
            total.resize(flux.len(), 0.0);
            total.iter_mut().zip(&flux).for_each(|(total, flux)| *total += flux);
        }
    }
}

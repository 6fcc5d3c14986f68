//! The complete iterative solution of a [`System`]: GMRES on the whole of it, with its diffuse part solved as
//! preconditioner, since a sweep costs less than a round of specular chains.

use super::flow::ChainFlow;
use super::gmres::{self, Outcome};
use super::known::Known;
use super::recalled::{Basis, Direction, Recalled};
use super::rooms::weights;
use super::settings::FirstPassSettings;
use super::system::{Solved, System, unfinished};
use crate::error::Result;
use std::f64::consts::PI;

/// From so many times the goal on it is tried to end without another round of chains.
const NEAR: f64 = 4.0;
/// How much of the goal the residual then should be in its mean square, which its size may exceed, with room for what
/// is not followed.
const ENOUGH: f64 = 0.2;

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
        mut progress: impl FnMut(f64),
    ) -> Result<Solved> {
        let mut residual = self.sources();
        let weights = weights(self.points, &self.rooms.room, &residual);
        let reflected = |e: &[f32]| self.reflected(e);
        let apply = |x: &[f32]| self.specular.apply(self.points, x, &settings.chain);
        let renewed = recalled.renew(&residual, &weights, reflected, apply);
        let basis = recalled.basis(&weights, reflected);
        let (mut x, mut chains) = (vec![0.0; residual.len()], ChainFlow::default());
        basis.take(&mut residual, 1.0, &mut x, &mut chains);

        let with_chains = !self.specular.points.is_empty();
        let mut known = Known::default();
        for (x, diffuse) in recalled.diffuse().filter(|_| with_chains) {
            known.add(x.to_vec(), self.absorbed(x, diffuse), &weights);
        }
        let goals = self.goals(settings.tolerance);
        let near: Vec<f64> = goals.iter().map(|goal| if with_chains { NEAR * goal } else { *goal }).collect();
        let mut search = Search {
            system: self,
            settings,
            weights: &weights,
            basis: &basis,
            goals: &goals,
            x,
            chains,
            residual,
            left: Vec::new(),
            known,
            sweeps: 0,
            directions: Vec::new(),
        };
        search.advance(&near, &mut progress)?;
        if with_chains && !search.reached() && !search.ends_without_chains() {
            search.advance(&goals, &mut progress)?;
        }
        if !search.reached() {
            return Err(unfinished(settings));
        }

        let Search { x, chains, mut sweeps, directions, .. } = search;
        let rounds = if with_chains { directions.len() + usize::from(renewed) } else { 0 };
        for mut direction in directions.into_iter().filter(|_| settings.recall) {
            if direction.diffuse.is_empty() {
                sweeps += 1;
                direction.diffuse = self.diffuse.irradiance(&direction.radiance, |_| true);
            }
            recalled.add(direction);
        }
        let mut flow = self.light_chains.clone();
        flow.add_scaled(&chains, &vec![1.0; self.wavelengths()]);
        Ok(Solved { radiance: x, flow, sweeps: sweeps as f64, rounds: rounds as u32 })
    }
}

/// A solution on the way.
struct Search<'s, 'a> {
    system: &'s System<'a>,
    settings: &'s FirstPassSettings,
    /// Of the points, in the norm of residuals.
    weights: &'s [f32],
    /// What was found for earlier appearances.
    basis: &'s Basis<'s>,
    /// How much of the residual may be left, by wavelength.
    goals: &'s [f64],
    x: Vec<f32>,
    /// C x.
    chains: ChainFlow,
    /// b - A x.
    residual: Vec<f32>,
    /// Its size by wavelength.
    left: Vec<f64>,
    /// What is known of 1 - ρ/π D alone.
    known: Known,
    sweeps: usize,
    /// By step. Only what is to be recalled has its radiance, and D of it only where that costs nothing.
    directions: Vec<Direction>,
}

impl Search<'_, '_> {
    fn reached(&self) -> bool {
        self.left.iter().zip(self.goals).all(|(left, goal)| left <= goal)
    }

    /// Goes on until `goals` are reached or the sweeps are used up.
    fn advance(&mut self, goals: &[f64], progress: &mut impl FnMut(f64)) -> Result<()> {
        let (residual, first) = (std::mem::take(&mut self.residual), self.directions.len());
        let measure = (&self.system.points.area[..], self.weights);
        let limit = self.settings.max_sweeps as usize;
        let Outcome { x, residual, left, shares, .. } =
            gmres::solve(&residual, measure, goals, limit, |v, excess| {
                progress(excess);
                if self.system.specular.points.is_empty() {
                    Ok(self.diffuse_step(v))
                } else {
                    self.chained_step(v, excess)
                }
            })?;
        for (direction, share) in self.directions[first..].iter().zip(&shares) {
            self.chains.add_scaled(&direction.chains, share);
        }
        self.x.iter_mut().zip(&x).for_each(|(x, more)| *x += more);
        (self.residual, self.left) = (residual, left);
        Ok(())
    }

    /// (x, A x) for x = v, where there are no chains, but for what is known already.
    fn diffuse_step(&mut self, v: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let Search { system, settings, .. } = self;
        let diffuse = system.diffuse.irradiance(v, |i| settings.recall || system.response.active[i]);
        self.sweeps += 1;
        let (mut x, mut image) = (v.to_vec(), system.absorbed(v, &diffuse));
        if settings.recall {
            self.directions.push(Direction { radiance: v.to_vec(), diffuse, chains: ChainFlow::default() });
        }
        self.basis.take(&mut image, -1.0, &mut x, &mut ChainFlow::default());
        (x, image)
    }

    /// (x, A x) for an x that is nearly v less all diffuse reflection, but for what is known already.
    fn chained_step(&mut self, v: &[f32], excess: f64) -> Result<(Vec<f32>, Vec<f32>)> {
        // Half of the way, in powers, and near the goal no more than that asks for. It decides how fast the
        // outer solve comes to its tolerance, not where that ends.
        let (mut x, residual) = self.preconditioned(v, self.settings.tolerance.sqrt().max(0.5 / excess));
        if self.sweeps >= self.settings.max_sweeps as usize {
            return Err(unfinished(self.settings));
        }
        let Search { system, settings, .. } = self;
        let mut chains = system.specular.apply(system.points, &x, &settings.chain);
        let back = system.reflected(&chains.irradiance);
        let mut image: Vec<f32> = v.iter().zip(&residual).zip(&back).map(|((v, r), b)| v - r - b).collect();
        self.basis.take(&mut image, -1.0, &mut x, &mut chains);
        let radiance = if settings.recall { x.clone() } else { Vec::new() };
        self.directions.push(Direction { radiance, diffuse: Vec::new(), chains });
        Ok((x, image))
    }

    /// x and v - (1 - ρ/π D) x, which is a share of v of at most `goal`, as far as the sweeps that are left allow.
    fn preconditioned(&mut self, v: &[f32], goal: f64) -> (Vec<f32>, Vec<f32>) {
        let Search { system, settings, weights, known, sweeps, .. } = self;
        let most = (settings.max_sweeps as usize).saturating_sub(*sweeps);
        known.solve(v, weights, goal, most, |v| {
            *sweeps += 1;
            system.absorbed(v, &system.diffuse.irradiance(v, |i| system.response.active[i]))
        })
    }

    /// Tries to reach the goals by diffuse light alone: what it brings to specular points is not followed but counts
    /// as left, all of it, for no more than that is ever reflected diffusely again. Whether that is enough.
    fn ends_without_chains(&mut self) -> bool {
        let excess = self.left.iter().zip(self.goals).map(|(left, goal)| left / goal).fold(1.0, f64::max);
        let residual = std::mem::take(&mut self.residual);
        let (more, rest) = self.preconditioned(&residual, ENOUGH / excess);
        self.residual = residual;
        let points = self.system.points;
        // The measure of a residual counts areas more in weaker rooms.
        let heaviest = self.weights.iter().zip(&points.area).map(|(w, a)| (w / a).sqrt()).fold(1.0, f32::max);
        let (flux, size) = self.system.specular.entering(points, &more);
        let sizes = gmres::sizes((&points.area, self.weights), self.goals.len(), &rest);
        let unfollowed = size.iter().map(|flux| f64::from(heaviest) * flux / PI);
        let left: Vec<f64> = sizes.iter().zip(unfollowed).map(|(left, more)| left + more).collect();
        if !left.iter().zip(self.goals).all(|(left, goal)| left <= goal) {
            return false;
        }
        self.x.iter_mut().zip(&more).for_each(|(x, more)| *x += more);
        for total in [&mut self.chains.entered, &mut self.chains.cut_off] {
            total.resize(flux.len(), 0.0);
            total.iter_mut().zip(&flux).for_each(|(total, flux)| *total += flux);
        }
        (self.residual, self.left) = (rest, left);
        true
    }
}

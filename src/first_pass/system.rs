//! Equation (7) as a system: L = L^E + ρ/π (E_diffuse + E_chains), all wavelengths at once.

use super::diffuse::DiffuseOperator;
use super::flow::ChainFlow;
use super::known::Known;
use super::lights::PointLighting;
use super::recalled::{Recalled, Start};
use super::rooms::{Rooms, weights};
use super::settings::FirstPassSettings;
use super::specular::SpecularSet;
use super::stats::over_area;
use super::{gmres, shooting};
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance};
use std::f64::consts::PI;

/// How much of the tolerance the solution is stopped at: recurrences in `f32` drift.
pub(super) const MARGIN: f64 = 0.95;

/// The operators of a scene and its appearance, ready to be applied.
pub struct System<'a> {
    /// The sample points.
    pub points: &'a SamplePoints,
    /// D.
    pub diffuse: &'a DiffuseOperator<'a>,
    /// S.
    pub specular: SpecularSet,
    /// L^E, `[W][N]`.
    pub emission: Vec<f32>,
    /// What point lights bring.
    pub lights: PointLighting,
    /// The chains that start with it.
    pub light_chains: ChainFlow,
    /// ρ = d π R^d, `[W][N]`.
    pub reflectance: Vec<f32>,
    /// Whether a point reflects diffusely at any wavelength.
    pub reflects: Vec<bool>,
    /// The rooms of the scene.
    pub(super) rooms: Rooms,
}

/// What the next appearance may use again.
#[derive(Default)]
pub(super) struct Kept {
    rooms: Option<Rooms>,
    specular: Option<SpecularSet>,
}

/// A solution on the way: radiance, and what the chains contribute to it.
pub struct Solved {
    /// L^d, `[W][N]`.
    pub radiance: Vec<f32>,
    /// What the chains that start with it and with point lights bring.
    pub flow: ChainFlow,
    /// The part of it that starts with the radiance.
    pub chains: ChainFlow,
    /// Sweeps done.
    pub sweeps: f64,
    /// Applications of the specular operator.
    pub rounds: u32,
}

impl<'a> System<'a> {
    /// Prepares what depends on the appearance.
    pub fn new(
        geometry: &Geometry,
        diffuse: &'a DiffuseOperator<'a>,
        appearance: &SampledAppearance,
        settings: &FirstPassSettings,
        observer: &dyn Observer,
    ) -> Self {
        Self::with(geometry, diffuse, appearance, settings, Kept::default(), observer)
    }

    /// The same, using again what is `kept` of another appearance wherever it is the same.
    pub(super) fn with(
        geometry: &Geometry,
        diffuse: &'a DiffuseOperator<'a>,
        appearance: &SampledAppearance,
        settings: &FirstPassSettings,
        kept: Kept,
        observer: &dyn Observer,
    ) -> Self {
        let (points, graph) = (diffuse.points, diffuse.graph);
        let tolerance = geometry.plane_tolerance() as f32;
        let (n, w) = (points.len(), appearance.wavelengths.len());
        let (mut emission, mut reflectance) = (vec![0.0; n * w], vec![0.0; n * w]);
        for i in 0..n {
            let material = appearance.of(points.surface[i]);
            // A one-sided emitter has no points on its back, a two-sided one emits from both.
            for k in 0..w {
                emission[k * n + i] = material.emission[k];
                reflectance[k * n + i] = material.diffuse[k];
            }
        }
        let specular = SpecularSet::new(
            points,
            graph,
            appearance,
            (settings.kernel, tolerance, settings.lobe_tolerance as f32, settings.kept_bytes),
            kept.specular,
            observer,
        );
        let lights = PointLighting::new(geometry, points, graph.lights(), appearance, &specular);
        let light_chains = if lights.misses_specular_points() {
            ChainFlow::default()
        } else {
            specular.apply_to_lights(points, &lights, &settings.chain)
        };
        let passes = |i: usize| appearance.of(points.surface[i]).transmission.is_some();
        let rooms = Rooms::new(points, graph, tolerance, passes, kept.rooms);
        let reflects = (0..n).map(|i| (0..w).any(|k| reflectance[k * n + i] > 0.0)).collect();
        System { points, diffuse, specular, emission, lights, light_chains, reflectance, reflects, rooms }
    }

    /// What the next appearance may use again.
    pub(super) fn keep(self) -> Kept {
        Kept { rooms: Some(self.rooms), specular: Some(self.specular) }
    }

    /// W.
    pub fn wavelengths(&self) -> usize {
        self.specular.wavelengths
    }

    /// ρ/π E, `[W][N]`.
    pub fn reflected(&self, irradiance: &[f32]) -> Vec<f32> {
        let scale = |(e, rho): (&f32, &f32)| e * rho * std::f32::consts::FRAC_1_PI;
        irradiance.iter().zip(&self.reflectance).map(scale).collect()
    }

    /// π Σ A |x| of each wavelength.
    pub fn flux(&self, x: &[f32]) -> Vec<f64> {
        let n = self.points.len();
        let of = |k: usize| PI * over_area(self.points, |i| f64::from(x[k * n + i]).abs());
        (0..self.wavelengths()).map(of).collect()
    }

    /// What the exchange between points starts from, `[W][N]`: L^E, and what points reflect of the light
    /// of point lights, straight and by chains.
    pub fn sources(&self) -> Vec<f32> {
        let mut sources = self.emission.clone();
        for irradiance in [&self.lights.irradiance, &self.light_chains.irradiance] {
            sources.iter_mut().zip(self.reflected(irradiance)).for_each(|(l, r)| *l += r);
        }
        sources
    }

    /// Flux of surfaces and lights together, W nm⁻¹: `[W]`.
    pub fn emitted(&self) -> Vec<f64> {
        self.flux(&self.emission).iter().zip(&self.lights.flux).map(|(e, l)| e + l).collect()
    }

    /// (1 - ρ/π D) x.
    fn diffuse_step(&self, x: &[f32]) -> Vec<f32> {
        let back = self.reflected(&self.diffuse.irradiance(x, |i| self.reflects[i]));
        x.iter().zip(&back).map(|(x, b)| x - b).collect()
    }

    /// Σ A |residual| that keeps the flux under `tolerance` of what is emitted, W nm⁻¹ sr⁻¹.
    fn goals(&self, tolerance: f64) -> Vec<f64> {
        self.emitted().iter().map(|f| MARGIN * tolerance * f / PI).collect()
    }

    /// The complete iterative solution: GMRES on the whole system, with its diffuse part solved as
    /// preconditioner, since a sweep costs less than a round of specular chains. It goes on from what `recalled` solutions
    /// leave over. `progress` hears how many times its goal the residual is.
    pub fn solve_iteratively(
        &self,
        settings: &FirstPassSettings,
        recalled: &Recalled,
        mut progress: impl FnMut(f64),
    ) -> Result<Solved> {
        let max_sweeps = settings.max_sweeps as usize;
        let mut sweeps = 0usize;
        let mut flows: Vec<ChainFlow> = Vec::new();
        let goals = self.goals(settings.tolerance);
        let sources = self.sources();
        let weights = weights(self.points, &self.rooms.room, &sources);
        let measure = (&self.points.area[..], &weights[..]);
        let Start { radiance: mut x, mut chains, residual: sources } =
            recalled.start(&sources, &weights, |e| self.reflected(e));
        let outcome = if self.specular.points.is_empty() {
            gmres::solve(&sources, measure, &goals, max_sweeps, |v, excess| {
                sweeps += 1;
                progress(excess);
                Ok((v.to_vec(), self.diffuse_step(v)))
            })?
        } else {
            let mut known = Known::default();
            gmres::solve(&sources, measure, &goals, max_sweeps, |v, excess| {
                progress(excess);
                let left = max_sweeps.saturating_sub(sweeps);
                // Half of the way, in powers, and near the goal no more than that asks for. It decides how fast the
                // outer solve comes to its tolerance, not where that ends.
                let inner = settings.tolerance.sqrt().max(0.5 / excess);
                let (x, residual) = known.solve(v, &weights, inner, left, |v| {
                    sweeps += 1;
                    self.diffuse_step(v)
                });
                if sweeps >= max_sweeps {
                    return Err(unfinished(settings));
                }
                let flow = self.specular.apply(self.points, &x, &settings.chain);
                let back = self.reflected(&flow.irradiance);
                flows.push(flow);
                let image = v.iter().zip(&residual).zip(&back).map(|((v, r), b)| v - r - b).collect();
                Ok((x, image))
            })?
        };
        if outcome.left.iter().zip(&goals).any(|(left, goal)| left > goal || !left.is_finite()) {
            return Err(unfinished(settings));
        }
        for (step, share) in flows.iter().zip(&outcome.shares) {
            chains.add_scaled(step, share);
        }
        let mut flow = self.light_chains.clone();
        flow.add_scaled(&chains, &vec![1.0; self.wavelengths()]);
        x.iter_mut().zip(&outcome.x).for_each(|(x, more)| *x += more);
        Ok(Solved { radiance: x, flow, chains, sweeps: sweeps as f64, rounds: flows.len() as u32 })
    }

    /// Progressive shooting. `progress` hears how many times its goal the unshot flux is.
    pub fn solve_by_shooting(
        &self,
        settings: &FirstPassSettings,
        progress: impl FnMut(f64),
    ) -> Result<Solved> {
        shooting::solve(self, settings, progress)
    }
}

/// The error of a run that did not reach its tolerance.
pub fn unfinished(settings: &FirstPassSettings) -> Error {
    Error::Numerical(format!(
        "the first pass did not come under a tolerance of {} in {} sweeps: raise max_sweeps or the tolerance, \
         use the iterative solver, or, with the paper's kernel, sample more finely",
        settings.tolerance, settings.max_sweeps
    ))
}

//! Equation (7) as a system: L = L^E + ρ/π (E_diffuse + E_chains), all wavelengths at once.

use super::diffuse::DiffuseOperator;
use super::flow::ChainFlow;
use super::lights::PointLighting;
use super::response::Response;
use super::rooms::Rooms;
use super::settings::FirstPassSettings;
use super::shooting;
use super::specular::SpecularSet;
use super::stats::over_area;
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance};
use std::collections::BTreeSet;
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
    /// The material of each point.
    material: Vec<u32>,
    /// What point lights bring.
    pub lights: PointLighting,
    /// The chains that start with it.
    pub light_chains: ChainFlow,
    /// What points reflect diffusely, ρ = d π R^d.
    pub response: Response,
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
        let mut emission = vec![0.0; n * w];
        for i in 0..n {
            // A one-sided emitter has no points on its back, a two-sided one emits from both.
            let emitted = &appearance.of(points.surface[i]).emission;
            emitted.iter().enumerate().for_each(|(k, l)| emission[k * n + i] = *l);
        }
        let response = Response::new(points, appearance);
        let specular =
            SpecularSet::new(points, graph, appearance, (settings, tolerance), kept.specular, observer);
        let lights = PointLighting::new(geometry, points, graph.lights(), appearance, &specular);
        let light_chains = if lights.misses_specular_points() {
            ChainFlow::default()
        } else {
            specular.apply_to_lights(points, &lights, &settings.chain)
        };
        let passes = |i: usize| appearance.of(points.surface[i]).lets_through();
        let rooms = Rooms::new(points, graph, tolerance, passes, kept.rooms);
        let material = points.surface.iter().map(|s| appearance.surface_material[s.index()].0).collect();
        System { points, diffuse, specular, emission, material, lights, light_chains, response, rooms }
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
        self.response.leaving(irradiance)
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

    /// L^E of each material that emits, by itself.
    pub(super) fn lamps(&self) -> Vec<Vec<f32>> {
        let n = self.points.len();
        let emits = |i: usize| self.emission.iter().skip(i).step_by(n).any(|l| *l > 0.0);
        let lamps: BTreeSet<u32> = (0..n).filter(|&i| emits(i)).map(|i| self.material[i]).collect();
        let only = |lamp: u32| {
            let of = |(at, l): (usize, &f32)| if self.material[at % n] == lamp { *l } else { 0.0 };
            self.emission.iter().enumerate().map(of).collect()
        };
        lamps.into_iter().map(only).collect()
    }

    /// Flux of surfaces and lights together, W nm⁻¹: `[W]`.
    pub fn emitted(&self) -> Vec<f64> {
        self.flux(&self.emission).iter().zip(&self.lights.flux).map(|(e, l)| e + l).collect()
    }

    /// (1 - ρ/π D) x, given D x.
    pub(super) fn absorbed(&self, x: &[f32], diffuse: &[f32]) -> Vec<f32> {
        let back = self.reflected(diffuse);
        x.iter().zip(&back).map(|(x, b)| x - b).collect()
    }

    /// Σ A |residual| that keeps the flux under `tolerance` of what is emitted, W nm⁻¹ sr⁻¹.
    pub(super) fn goals(&self, tolerance: f64) -> Vec<f64> {
        self.emitted().iter().map(|f| MARGIN * tolerance * f / PI).collect()
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

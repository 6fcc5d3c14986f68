//! One scene under one appearance after another.

use super::diffuse::DiffuseOperator;
use super::recalled::Recalled;
use super::settings::{FirstPassSettings, Solver};
use super::stats::{self, FirstPassStats, Range};
use super::system::{Kept, Solved, System};
use super::{DiffuseSolution, Parts, STEPS, check_appearance, descent, refuse_endless, visibility_calls};
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance};
use crate::visibility::VisibilityGraph;
use std::time::Instant;

/// A solution, one sweep further.
struct Found {
    solved: Solved,
    /// Of all points, `[W][N]`, and so on.
    irradiance: Vec<f32>,
    radiance: Vec<f32>,
    /// The true residual.
    difference: Vec<f32>,
}

/// The first pass of a scene. It keeps what the next appearance can use again: the form factors always, rooms as long
/// as light passes the same surfaces, and the lobes of specular points where neither they nor what they
/// see has got another roughness or has become or ceased to be specular; those of solids if nothing at all changes
/// that lobes depend on. The
/// solution is the same, to the bit, as if nothing had been kept.
pub struct Relighter<'a> {
    geometry: &'a Geometry,
    points: &'a SamplePoints,
    graph: &'a VisibilityGraph,
    settings: FirstPassSettings,
    diffuse: DiffuseOperator<'a>,
    /// [`stats::reciprocity_error`].
    reciprocity: (f64, f64),
    kept: Kept,
    /// Of earlier appearances.
    recalled: Recalled,
    /// Time spent on what is kept and not yet reported, s.
    pending_s: f64,
    /// How often light has been found.
    runs: usize,
}

impl<'a> Relighter<'a> {
    /// Prepares the form factors.
    ///
    /// # Errors
    /// [`Error::Settings`] when graph and points do not belong together or a setting cannot be used.
    pub fn new(
        geometry: &'a Geometry,
        points: &'a SamplePoints,
        graph: &'a VisibilityGraph,
        settings: &FirstPassSettings,
        observer: &dyn Observer,
    ) -> Result<Self> {
        settings.validate()?;
        if graph.key() != &points.key {
            let message = "the visibility graph was built for other sample points: build it again";
            return Err(Error::Settings(message.into()));
        }
        let clock = Instant::now();
        let diffuse = DiffuseOperator::keeping(
            geometry,
            points,
            graph,
            (settings.kernel, settings.kept_bytes),
            observer,
        );
        Ok(Relighter {
            geometry,
            points,
            graph,
            settings: *settings,
            reciprocity: stats::reciprocity_error(points, &diffuse),
            diffuse,
            kept: Kept::default(),
            recalled: Recalled::default(),
            pending_s: clock.elapsed().as_secs_f64(),
            runs: 0,
        })
    }

    /// Solves for the global diffuse radiance under `appearance`. No ray is cast.
    ///
    /// # Errors
    /// [`Error::Settings`] when the appearance does not belong to the scene; [`Error::Numerical`] when the
    /// tolerance is not reached or the light grows without end.
    pub fn light(
        &mut self,
        appearance: &SampledAppearance,
        observer: &dyn Observer,
    ) -> Result<DiffuseSolution> {
        let (geometry, points, settings) = (self.geometry, self.points, &self.settings);
        check_appearance(geometry, self.graph.knows_lights(geometry), appearance)?;
        let clock = Instant::now();
        let kept = std::mem::take(&mut self.kept);
        let system = System::with(geometry, &self.diffuse, appearance, settings, kept, observer);
        let setup_s = clock.elapsed().as_secs_f64() + std::mem::take(&mut self.pending_s);
        let clock = Instant::now();
        let mut recalled = std::mem::take(&mut self.recalled).serving(appearance);
        let fresh = recalled.is_empty();
        observer.begin("first pass", STEPS);
        let mut found = self.solve(&system, &mut recalled, observer);
        // What is recalled was rounded again and again: where that shows, it is forgotten.
        let shows = |found: &Found| {
            let left = system.flux(&found.difference);
            left.iter().zip(system.emitted()).any(|(left, emitted)| *left > settings.tolerance * emitted)
        };
        if !fresh && found.as_ref().map_or(true, shows) {
            recalled = Recalled::default().serving(appearance);
            found = self.solve(&system, &mut recalled, observer);
        }
        observer.end();
        let Found { solved, irradiance, radiance, difference } = found?;
        let emitted = system.emitted();
        self.recalled = recalled;

        // What only the report asks for is not part of the solution's time.
        let solve_s = clock.elapsed().as_secs_f64();
        let share = |part: Vec<f64>| {
            let ratio = |(p, e): (&f64, &f64)| if *e > 0.0 { p.abs() / e } else { 0.0 };
            part.iter().zip(&emitted).map(ratio).fold(0.0, f64::max)
        };
        let diffuse = &self.diffuse;
        let (closure_error_mean, closure_error_max) = stats::closure_error(diffuse.row_sums(), &points.area);
        let stats = FirstPassStats {
            points: points.len() as u64,
            specular_points: system.specular.points.len() as u64,
            specular_points_reused: system.specular.reused,
            form_factors_reused: self.runs > 0,
            near_pairs: diffuse.corrections().near_pairs,
            summed_surfaces: diffuse.corrections().summed_surfaces,
            links: 0,
            row_sum: Range::of(diffuse.row_sums(), &points.area),
            closure_error_mean,
            closure_error_max,
            reciprocity_error_mean: self.reciprocity.0,
            reciprocity_error_max: self.reciprocity.1,
            lobe_error_mean: system.specular.closure_error.0,
            lobe_error_max: system.specular.closure_error.1,
            opening_cells: system.specular.cells,
            sweeps: solved.sweeps + 1.0,
            rounds: solved.rounds,
            longest_chain: solved.flow.bounces,
            residual: share(system.flux(&difference)),
            cut_off: share(solved.flow.cut_off.clone()),
            flux: stats::balance(
                points,
                diffuse,
                &system.specular,
                &system.response,
                [&system.emission, &solved.radiance, &irradiance],
                &solved.flow,
                &system.lights,
            ),
            rays_cast: 0,
            visibility_calls_without_graph: settings.count_visibility_calls.then(|| {
                let tolerance = geometry.plane_tolerance() as f32;
                visibility_calls::count(points, &system.specular, tolerance, solved.flow.bounces)
            }),
            setup_s,
            solve_s,
        };
        let (n, w) = (points.len(), system.wavelengths());
        let by_point = |radiance: &[f32]| (0..n * w).map(|at| radiance[at % w * n + at / w]).collect();
        let parts = settings.parts.then(|| {
            let mut direct = self.diffuse.irradiance(&system.emission, |_| true);
            direct.iter_mut().zip(&system.lights.irradiance).for_each(|(e, more)| *e += more);
            direct.iter_mut().zip(&system.lights.sky).for_each(|(e, sky)| *e -= sky);
            // Where nothing is specular there are no chains, and no room for them.
            let mut specular = solved.flow.irradiance.clone();
            specular.resize(n * w, 0.0);
            specular.iter_mut().zip(&system.lights.sky).for_each(|(e, sky)| *e += sky);
            Parts {
                emission: by_point(&system.emission),
                direct: by_point(&system.reflected(&direct)),
                specular: by_point(&system.reflected(&specular)),
            }
        });
        self.runs += 1;
        let (wavelengths, radiance) = (appearance.wavelengths.clone(), by_point(&radiance));
        self.kept = system.keep();
        Ok(DiffuseSolution { wavelengths, radiance, parts, stats })
    }

    /// Solves a system, going on from what is `recalled`.
    fn solve(&self, system: &System, recalled: &mut Recalled, observer: &dyn Observer) -> Result<Found> {
        let settings = &self.settings;
        let solved = match settings.solver {
            Solver::Iterative => system.solve_iteratively(settings, recalled, descent(observer)),
            Solver::Shooting => system.solve_by_shooting(settings, descent(observer)),
        }?;
        // One more sweep gives the true residual and a solution that is no worse.
        let mut irradiance = self.diffuse.irradiance(&solved.radiance, |_| true);
        for more in [&solved.flow.irradiance, &system.lights.irradiance] {
            irradiance.iter_mut().zip(more).for_each(|(e, more)| *e += more);
        }
        let reflected = system.reflected(&irradiance);
        let mut radiance: Vec<f32> = system.emission.iter().zip(&reflected).map(|(e, r)| e + r).collect();
        let difference: Vec<f32> = radiance.iter().zip(&solved.radiance).map(|(a, b)| a - b).collect();
        refuse_endless(&mut radiance, &system.emitted(), |l| system.flux(l), settings)?;
        Ok(Found { solved, irradiance, radiance, difference })
    }

    /// One sweep: the irradiance of all points from the radiance of all points by diffuse exchange alone, both
    /// `[W][N]`.
    pub fn sweep(&self, radiance: &[f32]) -> Vec<f32> {
        self.diffuse.irradiance(radiance, |_| true)
    }
}

//! The first pass over links: one scene under one appearance after another.

use super::lights::PointLighting;
use super::linked::LinkedOperator;
use super::response::Response;
use super::rooms::{joined, linked_rooms, weights};
use super::settings::{FirstPassSettings, Solver};
use super::specular::SpecularSet;
use super::stats::{self, FirstPassStats, FluxBalance, Range, over_area};
use super::system::{MARGIN, unfinished};
use super::{
    DiffuseSolution, Parts, STEPS, check_appearance, descent, gmres, refuse_endless, specular_points,
};
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance};
use crate::visibility::Links;
use std::f64::consts::PI;
use std::time::Instant;

/// The first pass of a scene over links. Its form factors are geometry alone and serve every appearance; no ray is
/// cast. Links carry diffuse light: a scene with specular points is refused.
pub struct LinkedRelighter<'a> {
    geometry: &'a Geometry,
    points: &'a SamplePoints,
    links: &'a Links,
    settings: FirstPassSettings,
    diffuse: LinkedOperator<'a>,
    /// The room of each point.
    room: Vec<u32>,
    /// Time spent on the form factors and not yet reported, s.
    pending_s: f64,
    runs: usize,
}

/// What an appearance brings; planes are `[W][N]`.
struct Light {
    emission: Vec<f32>,
    response: Response,
    /// Irradiance by lights without a body and the sky; empty without.
    lights: Vec<f32>,
    /// Irradiance by the sky alone; empty without.
    sky: Vec<f32>,
    /// Flux emitted by surfaces and lights, W nm⁻¹: `[W]`.
    emitted: Vec<f64>,
    /// Flux of lights without a body alone.
    of_lights: Vec<f64>,
}

/// Refuses a scene with so many specular points if it has any: links carry no specular light.
fn refuse_specular(points: usize) -> Result<()> {
    if points == 0 {
        return Ok(());
    }
    Err(Error::Settings(format!(
        "links carry diffuse light only, but {points} sample points are specular: compute without links, over all pairs \
         of points"
    )))
}

impl<'a> LinkedRelighter<'a> {
    /// Prepares the form factors.
    ///
    /// # Errors
    /// [`Error::Settings`] when links and points do not belong together or a setting cannot be used.
    pub fn new(
        geometry: &'a Geometry,
        points: &'a SamplePoints,
        links: &'a Links,
        settings: &FirstPassSettings,
    ) -> Result<Self> {
        settings.validate()?;
        if links.key() != &points.key {
            return Err(Error::Settings(
                "the links were made for other sample points: make them again".into(),
            ));
        }
        if settings.solver == Solver::Shooting {
            let message = "light cannot be shot over links: use the iterative solver, or no links";
            return Err(Error::Settings(message.into()));
        }
        let clock = Instant::now();
        let diffuse = LinkedOperator::new(points, links, settings.kernel);
        let room = linked_rooms(links);
        let pending_s = clock.elapsed().as_secs_f64();
        Ok(LinkedRelighter {
            geometry,
            points,
            links,
            settings: *settings,
            diffuse,
            room,
            pending_s,
            runs: 0,
        })
    }

    /// D.
    pub fn operator(&self) -> &LinkedOperator<'a> {
        &self.diffuse
    }

    /// Solves for the global diffuse radiance under `appearance`.
    ///
    /// # Errors
    /// [`Error::Settings`] when the appearance does not belong to the scene or is specular; [`Error::Numerical`] when
    /// the tolerance is not reached or the light grows without end.
    pub fn light(
        &mut self,
        appearance: &SampledAppearance,
        observer: &dyn Observer,
    ) -> Result<DiffuseSolution> {
        let (points, settings) = (self.points, &self.settings);
        check_appearance(self.geometry, self.links.knows_lights(self.geometry), appearance)?;
        refuse_specular(specular_points(points, appearance))?;
        let clock = Instant::now();
        let light = self.sources(appearance);
        let (n, w) = (points.len(), appearance.wavelengths.len());
        let setup_s = clock.elapsed().as_secs_f64() + std::mem::take(&mut self.pending_s);
        let clock = Instant::now();
        observer.begin("first pass", STEPS);
        let solved = self.solve(&light, descent(observer));
        observer.end();
        let (solved, sweeps) = solved?;

        // One more sweep gives the true residual and a solution that is no worse.
        let mut irradiance = self.diffuse.irradiance(&solved, |_| true);
        irradiance.iter_mut().zip(&light.lights).for_each(|(e, more)| *e += more);
        let mut radiance = light.emission.clone();
        radiance.iter_mut().zip(light.response.leaving(&irradiance)).for_each(|(l, r)| *l += r);
        let difference: Vec<f32> = radiance.iter().zip(&solved).map(|(a, b)| a - b).collect();
        refuse_endless(&mut radiance, &light.emitted, |l| flux(points, l, w), settings)?;
        let solve_s = clock.elapsed().as_secs_f64();

        let residual = flux(points, &difference, w);
        let share = |(r, e): (&f64, &f64)| if *e > 0.0 { r / e } else { 0.0 };
        let (closure_error_mean, closure_error_max) =
            stats::closure_error(self.diffuse.row_sums(), &points.area);
        let stats = FirstPassStats {
            points: n as u64,
            form_factors_reused: self.runs > 0,
            links: self.links.stats.links,
            row_sum: Range::of(self.diffuse.row_sums(), &points.area),
            closure_error_mean,
            closure_error_max,
            sweeps: sweeps + 1.0,
            residual: residual.iter().zip(&light.emitted).map(share).fold(0.0, f64::max),
            flux: self.balance(&light, &solved, &irradiance),
            setup_s,
            solve_s,
            ..Default::default()
        };
        self.runs += 1;
        let by_point = |plane: &[f32]| (0..n * w).map(|at| plane[at % w * n + at / w]).collect();
        let parts = settings.parts.then(|| {
            let mut direct = self.diffuse.irradiance(&light.emission, |_| true);
            direct.iter_mut().zip(&light.lights).for_each(|(e, more)| *e += more);
            direct.iter_mut().zip(&light.sky).for_each(|(e, sky)| *e -= sky);
            let mut sky = light.sky.clone();
            sky.resize(n * w, 0.0);
            let (sky, direct) = (light.response.leaving(&sky), light.response.leaving(&direct));
            Parts { emission: by_point(&light.emission), direct: by_point(&direct), specular: by_point(&sky) }
        });
        let (wavelengths, radiance) = (appearance.wavelengths.clone(), by_point(&radiance));
        Ok(DiffuseSolution { wavelengths, radiance, parts, stats })
    }

    fn sources(&self, appearance: &SampledAppearance) -> Light {
        let (geometry, points) = (self.geometry, self.points);
        let (n, w) = (points.len(), appearance.wavelengths.len());
        let mut light = Light {
            emission: vec![0.0; n * w],
            response: Response::new(points, appearance),
            lights: Vec::new(),
            sky: Vec::new(),
            emitted: Vec::new(),
            of_lights: vec![0.0; w],
        };
        for i in 0..n {
            let emitted = &appearance.of(points.surface[i]).emission;
            emitted.iter().enumerate().for_each(|(k, l)| light.emission[k * n + i] = *l);
        }
        // Nothing is specular here.
        let set = SpecularSet { wavelengths: w, ..Default::default() };
        let falls = PointLighting::new(geometry, points, self.links.lights(), appearance, &set);
        light.lights = falls.irradiance;
        light.sky = falls.sky;
        light.of_lights = falls.flux;
        let emitted = flux(points, &light.emission, w);
        light.emitted = emitted.iter().zip(&light.of_lights).map(|(e, l)| e + l).collect();
        light
    }

    /// The radiance of all points and how many sweeps it took.
    fn solve(&self, light: &Light, mut progress: impl FnMut(f64)) -> Result<(Vec<f32>, f64)> {
        let (points, settings) = (self.points, &self.settings);
        let w = light.emitted.len();
        let mut sources = light.emission.clone();
        sources.iter_mut().zip(light.response.leaving(&light.lights)).for_each(|(l, r)| *l += r);
        let goals: Vec<f64> = light.emitted.iter().map(|f| MARGIN * settings.tolerance * f / PI).collect();
        let passes = |i: usize| (0..w).any(|k| light.response.passed(k, i).is_some());
        let room = joined(&self.room, points, passes);
        let weights = weights(points, &room, &sources);
        let measure = (&points.area[..], &weights[..]);
        let mut sweeps = 0.0;
        let outcome = gmres::solve(&sources, measure, &goals, settings.max_sweeps as usize, |v, excess| {
            sweeps += 1.0;
            progress(excess);
            let irradiance = self.diffuse.irradiance(v, |i| light.response.active[i]);
            let back = light.response.leaving(&irradiance);
            Ok((v.to_vec(), v.iter().zip(back).map(|(v, b)| v - b).collect()))
        })?;
        if outcome.left.iter().zip(&goals).any(|(left, goal)| left > goal || !left.is_finite()) {
            return Err(unfinished(settings));
        }
        Ok((outcome.x, sweeps))
    }

    /// Where the flux went, given the radiance it was computed from.
    fn balance(&self, light: &Light, radiance: &[f32], irradiance: &[f32]) -> FluxBalance {
        let points = self.points;
        let n = points.len();
        let mut balance = FluxBalance::default();
        for (k, &emitted) in light.emitted.iter().enumerate() {
            let at = |plane: &[f32], i: usize| plane.get(k * n + i).map_or(0.0, |&x| f64::from(x));
            let absorbed = over_area(points, |i| at(irradiance, i) * (1.0 - light.response.turned(k, i)));
            let escaped = PI
                * over_area(points, |i| at(radiance, i) * (1.0 - f64::from(self.diffuse.row_sums()[i])))
                + light.of_lights[k]
                - over_area(points, |i| at(&light.lights, i));
            balance.emitted.push(emitted);
            balance.absorbed.push(absorbed);
            balance.escaped.push(escaped);
            balance.cut_off.push(0.0);
            balance.error.push(if emitted > 0.0 { (emitted - absorbed - escaped) / emitted } else { 0.0 });
        }
        balance
    }
}

/// π Σ A |x| of each of `w` wavelengths.
fn flux(points: &SamplePoints, x: &[f32], w: usize) -> Vec<f64> {
    let n = points.len();
    (0..w).map(|k| PI * over_area(points, |i| f64::from(x[k * n + i]).abs())).collect()
}

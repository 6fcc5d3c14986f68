//! The first pass (section 3.3): the global diffuse radiance of every sample point.
//!
//! Diffuse light goes from point to point by form factors ([`form_factor`], [`diffuse`]); specular
//! points pass radiance on in chains ([`specular`], [`chain`]); both together are the extended form
//! factors of equation (7), which [`system`] solves without ever storing them.

mod balance;
mod bounce;
pub mod chain;
pub mod diffuse;
pub mod directions;
pub mod flow;
pub mod form_factor;
mod gmres;
pub mod ideal;
pub mod lights;
pub mod lobe;
pub mod lobe_table;
pub mod member;
pub mod near;
mod normalise;
mod openings;
pub mod reference;
mod rooms;
pub(crate) mod round;
mod scaling;
mod scatter;
mod settings;
mod shooting;
pub mod specular;
mod stats;
pub mod system;
pub mod visibility_calls;

pub use settings::{ChainLimits, FirstPassSettings, Kernel, Solver};
pub use stats::{FirstPassStats, FluxBalance, Range};

use crate::error::{Error, Result};
use crate::material::{FresnelTable, SampledMaterial, Transmission};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance};
use crate::spectrum::Wavelengths;
use crate::visibility::VisibilityGraph;
use std::time::Instant;
use system::System;

/// Steps of the solution as progress is told.
const STEPS: u64 = 100;

/// L^d of every sample point.
#[derive(Clone, Debug)]
pub struct DiffuseSolution {
    /// What the radiances are sampled at.
    pub wavelengths: Wavelengths,
    /// L^d_i, the emitted radiance included, W m⁻² sr⁻¹ nm⁻¹: `[N][W]`.
    pub radiance: Vec<f32>,
    /// How it was found.
    pub stats: FirstPassStats,
}

impl DiffuseSolution {
    /// L^d of point `i`, `[W]`.
    pub fn of(&self, i: usize) -> &[f32] {
        let w = self.wavelengths.len();
        &self.radiance[i * w..(i + 1) * w]
    }
}

/// Solves for the global diffuse radiance of all sample points. No ray is cast, so a new appearance
/// under the same graph costs this call and nothing else.
///
/// # Errors
/// [`Error::Settings`] when graph, points and appearance do not belong together or a setting cannot
/// be used; [`Error::Numerical`] when the tolerance is not reached or the light grows without end.
pub fn solve(
    geometry: &Geometry,
    points: &SamplePoints,
    graph: &VisibilityGraph,
    appearance: &SampledAppearance,
    settings: &FirstPassSettings,
    observer: &dyn Observer,
) -> Result<DiffuseSolution> {
    settings.validate()?;
    check_inputs(geometry, points, graph, appearance)?;
    let clock = Instant::now();
    let system = System::new(geometry, points, graph, appearance, settings, observer);
    let setup_s = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    observer.begin("first pass", STEPS);
    let solved = match settings.solver {
        Solver::Iterative => system.solve_iteratively(settings, descent(observer)),
        Solver::Shooting => system.solve_by_shooting(settings, descent(observer)),
    };
    observer.end();
    let solved = solved?;

    // One more sweep gives the true residual and a solution that is no worse.
    let mut irradiance = system.diffuse.irradiance(&solved.radiance, |_| true);
    for more in [&solved.flow.irradiance, &system.lights.irradiance] {
        irradiance.iter_mut().zip(more).for_each(|(e, more)| *e += more);
    }
    let reflected = system.reflected(&irradiance);
    let mut radiance: Vec<f32> = system.emission.iter().zip(&reflected).map(|(e, r)| e + r).collect();
    let difference: Vec<f32> = radiance.iter().zip(&solved.radiance).map(|(a, b)| a - b).collect();
    let emitted = system.emitted();
    refuse_endless(&mut radiance, &system, settings)?;

    // What only the report asks for is not part of the solution's time.
    let solve_s = clock.elapsed().as_secs_f64();
    let share = |part: Vec<f64>| {
        let ratio = |(p, e): (&f64, &f64)| if *e > 0.0 { p.abs() / e } else { 0.0 };
        part.iter().zip(&emitted).map(ratio).fold(0.0, f64::max)
    };
    let diffuse = &system.diffuse;
    let (closure_error_mean, closure_error_max) = stats::closure_error(diffuse.row_sums(), &points.area);
    let (reciprocity_error_mean, reciprocity_error_max) = stats::reciprocity_error(points, diffuse);
    let stats = FirstPassStats {
        points: points.len() as u64,
        specular_points: system.specular.points.len() as u64,
        near_pairs: diffuse.corrections().near_pairs,
        summed_surfaces: diffuse.corrections().summed_surfaces,
        row_sum: Range::of(diffuse.row_sums(), &points.area),
        closure_error_mean,
        closure_error_max,
        reciprocity_error_mean,
        reciprocity_error_max,
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
            &system.diffuse,
            &system.specular,
            [&system.emission, &system.reflectance, &solved.radiance, &irradiance],
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
    let by_point = (0..n * w).map(|at| radiance[at % w * n + at / w]).collect();
    Ok(DiffuseSolution { wavelengths: appearance.wavelengths.clone(), radiance: by_point, stats })
}

/// Tells `observer` how far a residual has come down, given how many times its goal it is: equal steps
/// are equal factors, for that is how residuals fall.
fn descent(observer: &dyn Observer) -> impl FnMut(f64) + '_ {
    let (mut first, mut done) = (None, 0);
    move |excess: f64| {
        let first: f64 = *first.get_or_insert(excess.max(1.0));
        let share = if first > 1.0 { 1.0 - excess.max(1.0).ln() / first.ln() } else { 1.0 };
        let steps = (STEPS as f64 * share) as u64;
        observer.advance(steps.saturating_sub(done));
        done = done.max(steps);
    }
}

/// Whether the parts belong together and hold nothing that is not a number.
fn check_inputs(
    geometry: &Geometry,
    points: &SamplePoints,
    graph: &VisibilityGraph,
    appearance: &SampledAppearance,
) -> Result<()> {
    let refuse = |message: &str| Err(Error::Settings(message.into()));
    if graph.key() != &points.key {
        return refuse("the visibility graph was built for other sample points: build it again");
    }
    if appearance.surface_material.len() != geometry.surfaces.len() {
        return refuse("the appearance does not name a material for every surface of the geometry");
    }
    let w = appearance.wavelengths.len();
    let known = |id: &crate::scene::MaterialId| (id.0 as usize) < appearance.materials.len();
    if !appearance.surface_material.iter().all(known) {
        return refuse("a surface wears a material that the appearance does not have");
    }
    if w == 0 {
        return refuse("a run needs at least one wavelength");
    }
    if !graph.knows_lights(geometry) {
        return refuse("it is not known what the point lights reach: let the graph look at them");
    }
    let sane = |l: &Vec<f32>| l.len() == w && l.iter().all(|i| (0.0..=f32::MAX).contains(i));
    if appearance.lights.len() != geometry.lights.len() || !appearance.lights.iter().all(sane) {
        return refuse("the appearance does not say what each point light gives at every wavelength");
    }
    appearance.materials.iter().try_for_each(|m| check_material(m, w))
}

/// Whether a material is sampled at `w` wavelengths and creates no light.
fn check_material(material: &SampledMaterial, w: usize) -> Result<()> {
    let mut tables = vec![&material.reflect];
    let mut sampled = vec![(&material.emission, f32::MAX), (&material.diffuse, 1.0)];
    match &material.transmission {
        None => {}
        Some(Transmission::Pane { transmit }) => tables.push(transmit),
        Some(Transmission::Solid { n, inside, absorption }) => {
            tables.push(inside);
            sampled.push((absorption, f32::MAX));
            if !(1.0..100.0).contains(n) {
                return Err(Error::Settings(format!(
                    "a solid's refractive index is {n}: it must be 1 or more"
                )));
            }
        }
    }
    // Interpolated tables may stand a rounding above 1.
    let sane = |v: &[f32], most: f32| v.iter().all(|&x| (0.0..=most).contains(&x));
    let table = |t: &&FresnelTable| {
        t.wavelengths == w
            && t.values.len() >= 2 * w
            && t.values.len().is_multiple_of(w)
            && sane(&t.values, 1.0001)
    };
    if !sampled.iter().all(|(v, _)| v.len() == w) || material.is_specular() && !tables.iter().all(table) {
        return Err(Error::Settings("a material is not sampled at the wavelengths of the run".into()));
    }
    if !sampled.iter().all(|(v, most)| sane(v, *most))
        || !(0.0..=1.0).contains(&material.s)
        || !(0.0..=10.0).contains(&material.m)
    {
        return Err(Error::Settings("a material emits, reflects or scatters what no material can".into()));
    }
    Ok(())
}

/// More flux than this times what is emitted says more of rounding than of the scene: an error of 1e-6 in
/// the form factors, which `f32` sums may have, is then a tenth of the answer.
const MOST_GAIN: f64 = 1e5;

/// A system that gains energy has a solution, but not a positive one (Perron and Frobenius), and one that
/// neither gains nor loses any has none: refuses both. Negative radiance within the tolerance is rounding
/// and becomes 0.
fn refuse_endless(radiance: &mut [f32], system: &System, settings: &FirstPassSettings) -> Result<()> {
    let n = system.points.len().max(1);
    let negative: Vec<f32> = radiance.iter().map(|l| l.min(0.0)).collect();
    let emitted = system.emitted();
    let whole = system.flux(radiance);
    for (k, negative) in system.flux(&negative).into_iter().enumerate() {
        let rounding = (10.0 * settings.tolerance).min(0.1) * emitted[k].max(whole[k]);
        let endless = whole[k] > MOST_GAIN * emitted[k];
        if !whole[k].is_finite() || endless || negative > rounding {
            return Err(shooting::diverged());
        }
        radiance[k * n..(k + 1) * n].iter_mut().for_each(|l| *l = l.max(0.0));
    }
    Ok(())
}

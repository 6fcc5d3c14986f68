//! How the exchange over links grows with the number of sample points, and how far it is from that over all pairs.

use super::scale::{Cost, exponent, timed};
use crate::error::Result;
use crate::first_pass::{self, DiffuseSolution, LinkedRelighter};
use crate::observer::Observer;
use crate::points::{self, SamplePoints, area_factor_for};
use crate::scene::{SampledAppearance, Scene};
use crate::settings::Settings;
use crate::tracers::{self, RayTracer};
use crate::visibility::{LinkSettings, LinkStats, Links, VisibilityGraph};
use crate::voxels::Voxels;
use serde::Serialize;
use std::f64::consts::PI;

/// What is timed: the sample points, the links with what hides them, form factors and sources, and the solution.
pub const STAGES: [&str; 4] = ["points", "links", "set-up", "solve"];

/// One number of points.
#[derive(Clone, Debug, Serialize)]
pub struct LinkedSize {
    /// Sample points.
    pub points: usize,
    /// What the links are.
    pub links: LinkStats,
    /// Memory of the links, bytes.
    pub links_memory_bytes: u64,
    /// Sweeps of the first pass.
    pub sweeps: f64,
    /// Flux not yet absorbed, of the flux emitted.
    pub residual: f64,
    /// Stages in the order of [`STAGES`].
    pub stages: [Cost; STAGES.len()],
    /// The same over all pairs, where asked for.
    pub full: Option<Full>,
}

/// The solution over all pairs of points.
#[derive(Clone, Debug, Serialize)]
pub struct Full {
    /// Graph and first pass.
    pub cost: Cost,
    /// How far the solution over links is from it.
    pub error: Difference,
}

/// How far apart two solutions are.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Difference {
    /// Root of the mean square difference of irradiance by area, of the root of the mean square irradiance, at the
    /// worst wavelength.
    pub irradiance: f64,
    /// The same of radiance, emitted radiance included.
    pub radiance: f64,
    /// The total irradiance over that of the other solution, less 1, at the worst wavelength.
    pub bias: f64,
    /// Largest difference of the irradiance of a point, of the mean.
    pub largest: f64,
}

/// All sizes and what they say together.
#[derive(Clone, Debug, Serialize)]
pub struct LinkedGrowth {
    /// Surfaces of the scene.
    pub surfaces: usize,
    /// Name of the ray tracer.
    pub tracer: String,
    /// Largest form factor of a link to a cluster.
    pub tolerance: f64,
    /// In the order asked for.
    pub sizes: Vec<LinkedSize>,
    /// Exponent of N in the wall time from links to solution, by least squares of logarithms.
    pub exponent: f64,
    /// The same in the time of all processors together.
    pub exponent_of_cpu: f64,
}

impl LinkedSize {
    /// Links, set-up and solution together.
    pub fn light(&self) -> Cost {
        self.stages[1..].iter().fold(Cost::default(), |sum, more| Cost {
            s: sum.s + more.s,
            cpu_s: sum.cpu_s + more.cpu_s,
            peak_memory_bytes: sum.peak_memory_bytes.max(more.peak_memory_bytes),
        })
    }
}

/// Solves over links at about each number of `points`, and over all pairs up to `full`; `tell` is told each size as soon as
/// it is measured.
///
/// # Errors
/// Those of the stages; [`crate::error::Error::Settings`] when a number of points is too small for the scene.
pub fn linked_growth(
    scene: &Scene,
    settings: &Settings,
    links: &LinkSettings,
    (points, full): (&[usize], usize),
    tell: &mut dyn FnMut(&LinkedSize),
    observer: &dyn Observer,
) -> Result<LinkedGrowth> {
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let mut sizes = Vec::new();
    for &wanted in points {
        let size = size(scene, settings, links, wanted, wanted <= full, tracer.as_ref(), observer)?;
        tell(&size);
        sizes.push(size);
    }
    let of = |cost: &dyn Fn(&LinkedSize) -> f64| {
        exponent(&sizes.iter().map(|s| (s.points as f64, cost(s))).collect::<Vec<_>>())
    };
    Ok(LinkedGrowth {
        surfaces: scene.geometry.surfaces.len(),
        tracer: tracer.name(),
        tolerance: links.tolerance,
        exponent: of(&|s| s.light().s),
        exponent_of_cpu: of(&|s| s.light().cpu_s),
        sizes,
    })
}

fn size(
    scene: &Scene,
    settings: &Settings,
    link_settings: &LinkSettings,
    wanted: usize,
    full: bool,
    tracer: &dyn RayTracer,
    observer: &dyn Observer,
) -> Result<LinkedSize> {
    let geometry = &scene.geometry;
    let factor = area_factor_for(geometry, &scene.sampling, wanted)?;
    let sampling = points::Sampling { area_factor: factor, ..scene.sampling };
    let mut stages = [Cost::default(); STAGES.len()];
    let [sampled, linked, set_up, solved] = &mut stages;
    let link_settings = &LinkSettings { together: Some(sampling), ..*link_settings };
    let points = timed(sampled, || {
        let voxels = Voxels::build(geometry, &settings.voxels);
        points::sample(geometry, &sampling, &voxels)
    })?;
    let links = timed(linked, || Links::build(geometry, &points, tracer, link_settings, observer))?;
    let appearance = scene.appearance.sample(geometry, &settings.wavelengths, settings.fresnel_entries);
    let mut relighter =
        timed(set_up, || LinkedRelighter::new(geometry, &points, &links, &settings.first_pass))?;
    let solution = timed(solved, || relighter.light(&appearance, observer))?;
    let full = if full {
        let mut cost = Cost::default();
        let solve = || {
            let graph = VisibilityGraph::build(geometry, &points, tracer, observer)?;
            first_pass::solve(geometry, &points, &graph, &appearance, &settings.first_pass, observer)
        };
        let all = timed(&mut cost, solve)?;
        Some(Full { cost, error: difference(&points, &appearance, &all, &solution) })
    } else {
        None
    };
    Ok(LinkedSize {
        points: points.len(),
        links: links.stats.clone(),
        links_memory_bytes: links.memory_bytes(),
        sweeps: solution.stats.sweeps,
        residual: solution.stats.residual,
        stages,
        full,
    })
}

/// How far `other` is from what counts as `true_one`.
pub fn difference(
    points: &SamplePoints,
    appearance: &SampledAppearance,
    true_one: &DiffuseSolution,
    other: &DiffuseSolution,
) -> Difference {
    let w = appearance.wavelengths.len();
    let mut worst = Difference::default();
    for k in 0..w {
        let irradiance = |solution: &DiffuseSolution, i: usize| {
            let material = appearance.of(points.surface[i]);
            let (emitted, rho) = (f64::from(material.emission[k]), f64::from(material.diffuse[k]));
            if rho > 0.0 { PI * (f64::from(solution.of(i)[k]) - emitted) / rho } else { 0.0 }
        };
        let radiance = |solution: &DiffuseSolution, i: usize| f64::from(solution.of(i)[k]);
        let rms = |of: &dyn Fn(usize) -> f64| {
            (0..points.len()).map(|i| f64::from(points.area[i]) * of(i).powi(2)).sum::<f64>().sqrt()
        };
        let sum = |of: &dyn Fn(usize) -> f64| {
            (0..points.len()).map(|i| f64::from(points.area[i]) * of(i)).sum::<f64>()
        };
        let apart = |i: usize| irradiance(other, i) - irradiance(true_one, i);
        let total = sum(&|i| irradiance(true_one, i));
        let mean = total / sum(&|_| 1.0);
        let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
        let largest = (0..points.len()).map(|i| apart(i).abs()).fold(0.0, f64::max);
        let of_radiance = |i: usize| radiance(other, i) - radiance(true_one, i);
        worst.irradiance = worst.irradiance.max(share(rms(&apart), rms(&|i| irradiance(true_one, i))));
        worst.radiance = worst.radiance.max(share(rms(&of_radiance), rms(&|i| radiance(true_one, i))));
        worst.largest = worst.largest.max(share(largest, mean));
        let bias = share(sum(&apart), total);
        worst.bias = if bias.abs() > worst.bias.abs() { bias } else { worst.bias };
    }
    worst
}

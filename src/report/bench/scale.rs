//! How time and memory of each stage grow with the number of sample points.

use crate::error::{Error, Result};
use crate::first_pass;
use crate::observer::Observer;
use crate::points::{self, area_factor_for};
use crate::report::{peak_memory_bytes, processor_s, reset_peak_memory};
use crate::scene::Scene;
use crate::second_pass::{self, Interpolator, LitScene};
use crate::settings::Settings;
use crate::tracers;
use crate::visibility::VisibilityGraph;
use crate::voxels::Voxels;
use serde::Serialize;
use std::time::Instant;

/// Time and memory of a stage.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Cost {
    /// Wall time, s.
    pub s: f64,
    /// Time of all processors together, s; unlike wall time no matter of what else they do.
    pub cpu_s: f64,
    /// Largest memory of the process during it, bytes.
    pub peak_memory_bytes: u64,
}

/// One number of points.
#[derive(Clone, Debug, Serialize)]
pub struct Size {
    /// Sample points.
    pub points: usize,
    /// Memory of the graph, bytes.
    pub graph_memory_bytes: u64,
    /// Rays cast for the graph.
    pub rays_cast: u64,
    /// Sweeps of the first pass.
    pub sweeps: f64,
    /// Flux not yet absorbed, of the flux emitted.
    pub residual: f64,
    /// Stages in the order of [`STAGES`].
    pub stages: [Cost; STAGES.len()],
}

/// What is timed: the sample points, the graph, preparing the first pass and solving it, what the second pass
/// prepares once a scene, and a view of 320 x 240 with 4 samples a pixel.
pub const STAGES: [&str; 6] = ["points", "graph", "set-up", "solve", "interpolator", "view"];

/// All sizes and what they say together.
#[derive(Clone, Debug, Serialize)]
pub struct Growth {
    /// Surfaces of the scene.
    pub surfaces: usize,
    /// Name of the ray tracer.
    pub tracer: String,
    /// In the order asked for.
    pub sizes: Vec<Size>,
    /// Exponent of N in the time of each stage, by least squares of logarithms over all sizes.
    pub exponents: [f64; STAGES.len()],
    /// The same of the graph and the first pass together.
    pub exponent_of_light: f64,
}

/// Runs every stage at about each number of `points`; `tell` is told each size as soon as it is measured.
///
/// # Errors
/// Those of the stages; [`Error::Settings`] when a number of points is too small for the scene.
pub fn growth(
    scene: &Scene,
    settings: &Settings,
    points: &[usize],
    tell: &mut dyn FnMut(&Size),
    observer: &dyn Observer,
) -> Result<Growth> {
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let mut sizes = Vec::new();
    for &wanted in points {
        let size = size(scene, settings, wanted, tracer.as_ref(), observer)?;
        tell(&size);
        sizes.push(size);
    }
    let of = |cost: &dyn Fn(&Size) -> f64| {
        exponent(&sizes.iter().map(|s| (s.points as f64, cost(s))).collect::<Vec<_>>())
    };
    let exponents = std::array::from_fn(|stage| of(&|s| s.stages[stage].s));
    let exponent_of_light = of(&|s| s.light_s());
    Ok(Growth {
        surfaces: scene.geometry.surfaces.len(),
        tracer: tracer.name(),
        exponents,
        exponent_of_light,
        sizes,
    })
}

impl Size {
    /// Time of the graph and the first pass together, s.
    pub fn light_s(&self) -> f64 {
        self.stages[1..4].iter().map(|c| c.s).sum()
    }
}

/// Runs `stage` and notes what it cost.
pub(in crate::report) fn timed<T>(cost: &mut Cost, stage: impl FnOnce() -> T) -> T {
    reset_peak_memory();
    let (clock, cpu_s) = (Instant::now(), processor_s());
    let product = stage();
    *cost = Cost {
        s: clock.elapsed().as_secs_f64(),
        cpu_s: processor_s() - cpu_s,
        peak_memory_bytes: peak_memory_bytes(),
    };
    product
}

fn size(
    scene: &Scene,
    settings: &Settings,
    wanted: usize,
    tracer: &dyn tracers::RayTracer,
    observer: &dyn Observer,
) -> Result<Size> {
    let geometry = &scene.geometry;
    let factor = area_factor_for(geometry, &scene.sampling, wanted)?;
    let sampling = points::Sampling { area_factor: factor, ..scene.sampling };
    let mut stages = [Cost::default(); STAGES.len()];
    let [sampled, graphed, set_up, solved, prepared, viewed] = &mut stages;
    let points = timed(sampled, || {
        let voxels = Voxels::build(geometry, &settings.voxels);
        points::sample(geometry, &sampling, &voxels)
    })?;
    let graph = timed(graphed, || VisibilityGraph::build(geometry, &points, tracer, observer))?;
    let appearance = scene.appearance.sample(geometry, &settings.wavelengths, settings.fresnel_entries);
    let solution = timed(solved, || {
        first_pass::solve(geometry, &points, &graph, &appearance, &settings.first_pass, observer)
    })?;
    // Set-up and solution are one call, which times them itself; the peak is that of both.
    (solved.s, set_up.s) = (solution.stats.solve_s, solution.stats.setup_s);
    set_up.peak_memory_bytes = solved.peak_memory_bytes;
    let interpolator = timed(prepared, || Interpolator::new(geometry, &points, tracer));
    let mut camera =
        scene.cameras.first().cloned().ok_or_else(|| Error::Settings("the scene has no camera".into()))?;
    camera.resolution = [320, 240];
    let lit =
        LitScene { geometry, interpolator: &interpolator, appearance: &appearance, solution: &solution };
    let view = second_pass::SecondPassSettings { samples: 4, ..settings.second_pass };
    timed(viewed, || second_pass::render(&lit, &camera, tracer, &view, observer))?;
    Ok(Size {
        points: points.len(),
        graph_memory_bytes: graph.memory_bytes(),
        rays_cast: graph.stats.rays_cast,
        sweeps: solution.stats.sweeps,
        residual: solution.stats.residual,
        stages,
    })
}

/// The slope of ln y over ln x by least squares; NaN for fewer than two sizes.
pub(super) fn exponent(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len() as f64;
    let logs = || pairs.iter().map(|(x, y)| (x.ln(), y.max(1e-9).ln()));
    let (mx, my) = (logs().map(|l| l.0).sum::<f64>() / n, logs().map(|l| l.1).sum::<f64>() / n);
    let (mut xy, mut xx) = (0.0, 0.0);
    for (x, y) in logs() {
        xy += (x - mx) * (y - my);
        xx += (x - mx) * (x - mx);
    }
    xy / xx
}

#[cfg(test)]
mod tests {
    use super::super::hall::hall;
    use super::*;
    use crate::observer::Silent;

    #[test]
    fn exponents_are_those_of_powers() {
        let power = |p: f64| [1e3, 4e3, 1.6e4].map(|n: f64| (n, 3e-9 * n.powf(p)));
        for p in [1.0, 1.5, 2.0] {
            assert!((exponent(&power(p)) - p).abs() < 1e-12);
        }
    }

    #[test]
    fn a_hall_grows_as_asked() {
        let scene = hall(2, 2);
        let settings = Settings::default();
        let mut told = Vec::new();
        let mut tell = |size: &Size| told.push(size.points);
        let growth = growth(&scene, &settings, &[600, 2400], &mut tell, &Silent).unwrap();
        assert_eq!(told, growth.sizes.iter().map(|size| size.points).collect::<Vec<_>>());
        for (size, wanted) in growth.sizes.iter().zip([600.0, 2400.0]) {
            assert!((size.points as f64 / wanted - 1.0).abs() < 0.25, "{}", size.points);
            assert!(size.residual < 1e-4 && size.stages.iter().all(|c| c.peak_memory_bytes > 0));
        }
        let few = super::growth(&scene, &settings, &[10], &mut |_| (), &Silent);
        assert!(few.is_err(), "fewer points than surfaces");
    }
}

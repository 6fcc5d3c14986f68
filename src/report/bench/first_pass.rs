//! The first pass beside its ceiling: a sweep beside the product of a stored matrix, and new appearances beside
//! the first.

use crate::error::Result;
use crate::first_pass::{DiffuseSolution, FirstPassStats, Relighter};
use crate::material::{Body, Fresnel, Level, Material};
use crate::observer::Observer;
use crate::pipeline::{self, Prepared};
use crate::scene::{Appearance, Scene};
use crate::settings::Settings;
use ndarray::linalg::general_mat_mul;
use ndarray::{Array2, Axis};
use rayon::prelude::*;
use serde::Serialize;
use std::time::Instant;

/// Rows of the matrix that one thread multiplies at a time: a few hundred kilobytes of a product that has
/// few columns, so that all threads have work.
const ROWS: usize = 128;

/// The first pass and all new appearances after it are timed so often.
const TURNS: usize = 3;

/// Timings of the first pass of one scene: medians of three turns. The sweep and the product take turns as well.
#[derive(Clone, Debug, Serialize)]
pub struct FirstPassBench {
    /// N.
    pub points: u64,
    /// W.
    pub wavelengths: u64,
    /// A dense single-precision product, N x N by N x W, of a matrix that is stored; `None` where it would take
    /// more memory than allowed, s.
    pub ceiling_s: Option<f64>,
    /// What the stored matrix takes, bytes.
    pub ceiling_memory_bytes: u64,
    /// One sweep of the diffuse operator over the same vectors, s.
    pub sweep_s: f64,
    /// `sweep_s / ceiling_s`.
    pub ratio: Option<f64>,
    /// Sweeps to the tolerance.
    pub sweeps: f64,
    /// Applications of the specular operator.
    pub rounds: u32,
    /// The tolerance, of the emitted flux.
    pub tolerance: f64,
    /// Points that carry directional radiance.
    pub specular_points: u64,
    /// The visibility graph, as its own statistics have it, s.
    pub graph_s: f64,
    /// Form factors: what the geometry alone decides, s.
    pub form_factors_s: f64,
    /// All of the set-up, form factors and lobes, s.
    pub setup_s: f64,
    /// The solution, s.
    pub solve_s: f64,
    /// New appearances, one after the other.
    pub relights: Vec<RelightBench>,
}

/// Timings of one new appearance.
#[derive(Clone, Debug, Serialize)]
pub struct RelightBench {
    /// What changed since the one before.
    pub change: String,
    /// Spectra and Fresnel tables at the wavelengths of the run, s.
    pub sample_s: f64,
    /// What could not be used again, s.
    pub setup_s: f64,
    /// The solution, s.
    pub solve_s: f64,
    /// All of it, s.
    pub total_s: f64,
    /// `total_s` over the time of the graph and the first appearance together.
    pub share_of_full: f64,
    /// Sweeps to the tolerance.
    pub sweeps: f64,
    /// Applications of the specular operator.
    pub rounds: u32,
    /// Lobes that were used again.
    pub specular_points_reused: u64,
}

/// Times the first pass of a `prepared` scene under its own appearance, then under each of `changes`, in turn.
/// The product is left out where its matrix would take more than `most_bytes`.
///
/// # Errors
/// Those of [`pipeline::relighter`] and [`pipeline::relight`].
pub fn measure(
    scene: &Scene,
    prepared: &Prepared,
    settings: &Settings,
    changes: &[(String, Appearance)],
    most_bytes: u64,
    repeats: usize,
    observer: &dyn Observer,
) -> Result<FirstPassBench> {
    let mut settings = settings.clone();
    settings.first_pass.recall = true;
    let settings = &settings;
    let mut turns = Vec::new();
    for _ in 1..TURNS {
        turns.push(Turn::take(scene, prepared, settings, changes, observer)?.0);
    }
    let (turn, relighter) = Turn::take(scene, prepared, settings, changes, observer)?;
    turns.push(turn);
    let of = |time: &dyn Fn(&Turn) -> f64| median(turns.iter().map(time).collect());
    let (first, graph_s) = (&turns[0].first.0, prepared.graph.stats.build_s);
    let full_s = graph_s + of(&|turn| turn.first.1);
    let relight = |(k, (change, _)): (usize, &(String, Appearance))| {
        let total_s = of(&|turn| turn.relights[k].1);
        let (setup_s, solve_s) =
            (of(&|turn| turn.relights[k].0.setup_s), of(&|turn| turn.relights[k].0.solve_s));
        let stats = &turns[0].relights[k].0;
        RelightBench {
            change: change.clone(),
            sample_s: (total_s - setup_s - solve_s).max(0.0),
            setup_s,
            solve_s,
            total_s,
            share_of_full: total_s / full_s,
            sweeps: stats.sweeps,
            rounds: stats.rounds,
            specular_points_reused: stats.specular_points_reused,
        }
    };
    let relights = changes.iter().enumerate().map(relight).collect();
    let (n, w) = (prepared.points.len(), turns[0].wavelengths);
    let bytes = 4 * (n * n) as u64;
    let (ceiling_s, sweep_s) = take_turns(&relighter, n, w, bytes <= most_bytes, repeats);
    Ok(FirstPassBench {
        points: n as u64,
        wavelengths: w as u64,
        ceiling_s,
        ceiling_memory_bytes: bytes,
        sweep_s,
        ratio: ceiling_s.map(|ceiling| sweep_s / ceiling),
        sweeps: first.sweeps,
        rounds: first.rounds,
        tolerance: settings.first_pass.tolerance,
        specular_points: first.specular_points,
        graph_s,
        form_factors_s: of(&|turn| turn.form_factors_s),
        setup_s: of(&|turn| turn.first.0.setup_s),
        solve_s: of(&|turn| turn.first.0.solve_s),
        relights,
    })
}

/// A first pass and all new appearances after it.
struct Turn {
    /// W.
    wavelengths: usize,
    /// Form factors, s.
    form_factors_s: f64,
    /// The first appearance, and all of its time, s.
    first: (FirstPassStats, f64),
    /// The others, likewise.
    relights: Vec<(FirstPassStats, f64)>,
}

impl Turn {
    fn take<'a>(
        scene: &'a Scene,
        prepared: &'a Prepared,
        settings: &Settings,
        changes: &[(String, Appearance)],
        observer: &dyn Observer,
    ) -> Result<(Turn, Relighter<'a>)> {
        let geometry = &scene.geometry;
        let clock = Instant::now();
        let mut relighter = pipeline::relighter(geometry, prepared, settings, observer)?;
        let form_factors_s = clock.elapsed().as_secs_f64();
        let mut light = |appearance: &Appearance| -> Result<(DiffuseSolution, f64)> {
            let clock = Instant::now();
            let (_, solution) = pipeline::relight(geometry, &mut relighter, appearance, settings, observer)?;
            Ok((solution, clock.elapsed().as_secs_f64()))
        };
        let (first, first_s) = light(&scene.appearance)?;
        let relights = changes.iter().map(|(_, appearance)| {
            let (solution, total_s) = light(appearance)?;
            Ok((solution.stats, total_s))
        });
        let relights = relights.collect::<Result<_>>()?;
        let wavelengths = first.wavelengths.len();
        let first = (first.stats, form_factors_s + first_s);
        Ok((Turn { wavelengths, form_factors_s, first, relights }, relighter))
    }
}

/// Medians of the times of the product, if `stored`, and of a sweep.
fn take_turns(relighter: &Relighter, n: usize, w: usize, stored: bool, repeats: usize) -> (Option<f64>, f64) {
    let radiance: Vec<f32> = (0..n * w).map(|i| 1.0 + (i % 7) as f32).collect();
    // Its time does not depend on the values, as long as they are ordinary numbers.
    let matrix = stored.then(|| Array2::from_shape_fn((n, n), |(i, j)| ((i + j) % 13) as f32 * 1e-4));
    let columns = Array2::from_shape_fn((n, w), |(i, k)| radiance[k * n + i]);
    let mut product = Array2::<f32>::zeros((n, w));
    let (mut ceilings, mut sweeps) = (Vec::new(), Vec::new());
    for _ in 0..repeats.max(1) {
        if let Some(matrix) = &matrix {
            let clock = Instant::now();
            (product.axis_chunks_iter_mut(Axis(0), ROWS).collect::<Vec<_>>().into_par_iter())
                .zip(matrix.axis_chunks_iter(Axis(0), ROWS).collect::<Vec<_>>())
                .for_each(|(mut product, rows)| general_mat_mul(1.0, &rows, &columns, 0.0, &mut product));
            ceilings.push(clock.elapsed().as_secs_f64());
        }
        let clock = Instant::now();
        std::hint::black_box(relighter.sweep(&radiance));
        sweeps.push(clock.elapsed().as_secs_f64());
    }
    std::hint::black_box(&product);
    (stored.then(|| median(ceilings)), median(sweeps))
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or_default()
}

/// Changes that every scene can undergo, each from the `appearance` given: nothing, twice the emission, the
/// diffuse reflectance of one material, that of all, another metal, the roughness of one metal, that of all.
pub fn usual_changes(appearance: &Appearance) -> Vec<(String, Appearance)> {
    let changed = |change: &str, edit: &dyn Fn(usize, &mut Material)| {
        let mut appearance = appearance.clone();
        appearance.materials.iter_mut().enumerate().for_each(|(i, material)| edit(i, material));
        (change.to_owned(), appearance)
    };
    let darker = |material: &mut Material| {
        if let Body::Opaque { diffuse: Some(spectrum), .. } = &mut material.body {
            *spectrum = spectrum.times(|_| 0.9);
        }
    };
    fn amount(level: &mut Level) -> &mut f64 {
        let (Level::Radiance(x) | Level::Luminance(x) | Level::LuminousFlux(x) | Level::LuminousIntensity(x)) =
            level;
        x
    }
    let first_lamp = appearance.materials.iter().position(|m| m.emission.is_some());
    let first_diffuse = appearance
        .materials
        .iter()
        .position(|m| matches!(&m.body, Body::Opaque { s, diffuse: Some(_), .. } if *s == 0.0));
    let first_rough = appearance
        .materials
        .iter()
        .position(|m| matches!(&m.body, Body::Opaque { s, m, .. } if *s > 0.0 && *m > 0.0));
    vec![
        changed("nothing", &|_, _| ()),
        changed("emission doubled", &|_, material| {
            if let Some(emission) = &mut material.emission {
                *amount(&mut emission.level) *= 2.0;
            }
        }),
        changed("one lamp halved", &|i, material| {
            if Some(i) == first_lamp
                && let Some(emission) = &mut material.emission
            {
                *amount(&mut emission.level) *= 0.5;
            }
        }),
        changed("one reflectance", &|i, material| {
            if Some(i) == first_diffuse {
                darker(material);
            }
        }),
        changed("all reflectances", &|_, material| darker(material)),
        changed("Fresnel factors", &|_, material| {
            if let Body::Opaque {
                fresnel: Fresnel::Index { n, .. } | Fresnel::Scaled { normal: n, .. },
                ..
            } = &mut material.body
            {
                *n = n.times(|_| 0.9);
            }
        }),
        changed("one roughness", &|i, material| {
            if let Body::Opaque { m, .. } = &mut material.body
                && Some(i) == first_rough
            {
                *m *= 1.25;
            }
        }),
        changed("roughness", &|_, material| {
            if let Body::Opaque { m, .. } = &mut material.body {
                *m *= 1.25;
            }
        }),
    ]
}

//! The judge of sensors: irradiance by paths that begin where a sensor lies.

use super::asks::Asks;
use super::emitters::Emitters;
use super::path::{Path, Replicate, Tracing, Wave, seed_of};
use super::{REPLICATES, ReferenceSettings, check};
use crate::error::Result;
use crate::geometry::Ray;
use crate::measure::Place;
use crate::observer::Observer;
use crate::scene::{Geometry, SampledAppearance, Sensor};
use crate::second_pass::{NO_MEDIUM, mix};
use crate::tracers::RayTracer;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Paths of one wave.
const BATCH: u32 = 512;

/// What a sensor receives.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorReference {
    /// Irradiance, W m⁻² nm⁻¹, `[W]`.
    pub irradiance: Vec<f64>,
    /// Illuminance, lx.
    pub illuminance_lx: f64,
    /// Its standard error, lx; `None` for a single sample.
    pub noise_lx: Option<f64>,
}

/// Irradiance of `sensors`, as unbiased as [`super::render`] is; `settings.samples` counts the paths of a sensor. The
/// same bits for any number of threads.
///
/// # Errors
/// [`Error::Settings`](crate::error::Error::Settings) for settings, a sensor or an appearance that cannot be used.
pub fn irradiance(
    geometry: &Geometry,
    appearance: &SampledAppearance,
    sensors: &[Sensor],
    tracer: &dyn RayTracer,
    settings: &ReferenceSettings,
    observer: &dyn Observer,
) -> Result<Vec<SensorReference>> {
    check(geometry, appearance, settings)?;
    let places: Vec<Place> =
        sensors.iter().map(|s| Place::new(geometry, tracer, s)).collect::<Result<_>>()?;
    let replicates = settings.samples.min(REPLICATES);
    let each = settings.samples.div_ceil(replicates);
    let emitters = Emitters::new(geometry, appearance);
    let tracing = Tracing::new(geometry, appearance, tracer, &emitters, settings.seed);
    observer.begin("reference of sensors", places.len() as u64);
    let found = places
        .par_iter()
        .enumerate()
        .map(|(k, place)| {
            let parts: Vec<Vec<f64>> = (0..replicates)
                .into_par_iter()
                .map(|number| replicate(&tracing, place, seed_of(&tracing, k, number), each))
                .collect();
            observer.advance(1);
            mean(&tracing, &parts)
        })
        .collect();
    observer.end();
    Ok(found)
}

/// Mean of the replicates, and what it is uncertain by.
fn mean(tracing: &Tracing, parts: &[Vec<f64>]) -> SensorReference {
    let n = parts.len() as f64;
    let mut irradiance = vec![0.0; tracing.wavelengths()];
    for part in parts {
        irradiance.iter_mut().zip(part).for_each(|(sum, e)| *sum += e / n);
    }
    let illuminance_lx = tracing.luminance(&irradiance);
    let squares: f64 = parts.iter().map(|p| (tracing.luminance(p) - illuminance_lx).powi(2)).sum();
    let noise_lx = (parts.len() > 1).then(|| (squares / (n * (n - 1.0))).sqrt());
    SensorReference { irradiance, illuminance_lx, noise_lx }
}

/// One estimate of a sensor's irradiance from `samples` paths.
fn replicate(tracing: &Tracing, place: &Place, seed: u32, samples: u32) -> Vec<f64> {
    let w = tracing.wavelengths();
    let mut sum = Replicate::dark(tracing, 1);
    let (mut wave, mut next) = (Wave::default(), Wave::default());
    let (a, b) = place.normal.any_orthonormal_pair();
    for first in (0..samples).step_by(BATCH as usize) {
        wave.clear();
        let mut asks = Asks::default();
        for index in first..samples.min(first + BATCH) {
            let [u, v, ..] = sobol_burley::sample_4d(index, 0, seed).map(f64::from);
            let (radius, angle) = (u.sqrt(), TAU * v);
            let cosine = (1.0 - u).max(0.0).sqrt();
            let direction = radius * (angle.cos() * a + angle.sin() * b) + cosine * place.normal;
            wave.rays.push(Ray { origin: place.position, direction, t_min: 0.0, t_max: f64::INFINITY });
            wave.paths.push(Path {
                pixel: 0,
                index,
                seed,
                start: place.position,
                depth: 0,
                medium: NO_MEDIUM,
                density: cosine / PI,
            });
            ask(tracing, place, sobol_burley::sample_4d(index, 0, mix(!seed)).map(f64::from), &mut asks);
        }
        wave.throughput.resize(wave.rays.len() * w, PI);
        asks.arrive(tracing, &mut sum.radiance);
        sum.follow(tracing, &mut wave, &mut next);
    }
    sum.radiance.iter().map(|e| e / f64::from(samples)).collect()
}

/// Asks one emitter for its light, weighed against having been met by the ray of a density of cos / π.
fn ask(tracing: &Tracing, place: &Place, u: [f64; 4], asks: &mut Asks) {
    let Some(ask) = tracing.draw(place.position, place.normal, u) else { return };
    let height = place.normal.dot(ask.direction);
    let factor = height * ask.factor(height / PI);
    asks.light.extend(ask.emission.iter().map(|l| factor * f64::from(*l)));
    asks.push(place.position, &ask, 0);
}

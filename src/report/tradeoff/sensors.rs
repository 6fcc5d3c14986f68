//! Sensors as paths find them, and how far readings are from that.

use super::judge::JudgeSettings;
use crate::error::Result;
use crate::measure::Illuminance;
use crate::observer::Observer;
use crate::reference::{self, ReferenceSettings};
use crate::scene::{SampledAppearance, Scene, Sensor};
use crate::spectrum::Wavelengths;
use crate::tracers::RayTracer;
use serde::{Deserialize, Serialize};

/// A darker sensor's error is relative to this share of the mean of all.
const DARK: f64 = 0.1;

/// A sensor as the judge reads it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorJudge {
    /// Number among all sensors of the scene, single ones first.
    pub number: usize,
    /// Its name, or its grid's.
    pub name: String,
    /// Illuminance, lx.
    pub illuminance_lx: f64,
    /// Standard error of that, lx.
    pub noise_lx: f64,
}

/// The sensor that is most wrong.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Worst {
    /// Which.
    pub name: String,
    /// Reading less the judge's, over the judge's or a tenth of the mean of all sensors, whichever is more.
    pub error: f64,
    /// The judge's own standard error there, relative to the same.
    pub judge_noise: f64,
}

/// All sensors of a scene, single ones first.
pub fn all(scene: &Scene) -> Vec<Sensor> {
    scene.sensors.iter().cloned().chain(scene.grids.iter().flat_map(|grid| grid.sensors())).collect()
}

/// Judges the sensors of a scene, or some of them taken evenly.
pub fn judge(
    scene: &Scene,
    appearance: &SampledAppearance,
    tracer: &dyn RayTracer,
    settings: &JudgeSettings,
    observer: &dyn Observer,
) -> Result<Vec<SensorJudge>> {
    let all = all(scene);
    let count = all.len().min(settings.sensors);
    let numbers: Vec<usize> = (0..count).map(|k| k * all.len() / count).collect();
    let chosen: Vec<Sensor> = numbers.iter().map(|&k| all[k].clone()).collect();
    let paths = ReferenceSettings { samples: settings.sensor_samples, seed: 0 };
    let found = reference::irradiance(&scene.geometry, appearance, &chosen, tracer, &paths, observer)?;
    Ok(numbers
        .into_iter()
        .zip(chosen)
        .zip(found)
        .map(|((number, sensor), found)| SensorJudge {
            number,
            name: sensor.name,
            illuminance_lx: found.illuminance_lx,
            noise_lx: found.noise_lx.unwrap_or(0.0),
        })
        .collect())
}

/// The worst of `readings`, spectral irradiances of the sensors that were judged.
pub fn worst<'a>(
    judges: &[SensorJudge],
    readings: impl Iterator<Item = &'a [f64]>,
    wavelengths: &Wavelengths,
) -> Option<Worst> {
    let mean = judges.iter().map(|j| j.illuminance_lx).sum::<f64>() / judges.len().max(1) as f64;
    let off = |judge: &SensorJudge, reading: &[f64]| {
        let whole = judge.illuminance_lx.max(DARK * mean).max(f64::MIN_POSITIVE);
        Worst {
            name: judge.name.clone(),
            error: (Illuminance::of(reading, wavelengths).illuminance_lx - judge.illuminance_lx) / whole,
            judge_noise: judge.noise_lx / whole,
        }
    };
    judges
        .iter()
        .zip(readings)
        .map(|(judge, reading)| off(judge, reading))
        .max_by(|a, b| a.error.abs().total_cmp(&b.error.abs()))
}

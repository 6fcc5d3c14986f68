//! The judge of a scene and a camera, made once and kept.

use super::error::Judged;
use super::sensors::{self, SensorJudge};
use crate::error::{Error, Result};
use crate::geometry::{Hit, Ray};
use crate::observer::Observer;
use crate::output::LinearImage;
use crate::output::exr::{self, ExrOptions};
use crate::reference::{self, ReferenceSettings};
use crate::report::write_json;
use crate::scene::{Camera, Scene};
use crate::settings::Settings;
use crate::spectrum::Wavelengths;
use crate::tracers::RayTracer;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Bands of wavelengths of a judge: twice as many change colours by less than 0.1 CIEDE2000 (docs/accuracy.md).
pub const BANDS: usize = 32;

/// How much is asked of a judge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JudgeSettings {
    /// Paths a pixel.
    pub samples: u32,
    /// Paths a sensor.
    pub sensor_samples: u32,
    /// Most sensors that are judged; of more, so many are taken evenly.
    pub sensors: usize,
}

/// What images and sensors are held against.
#[derive(Clone, Debug)]
pub struct Judge {
    /// The image.
    pub judged: Judged,
    /// The sensors.
    pub sensors: Vec<SensorJudge>,
    /// Tells this judge from others.
    pub key: String,
    /// Whether it was there from an earlier run.
    pub kept: bool,
}

/// What is kept beside the image.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// Of the scene, the camera and the settings.
    key: String,
    /// Of the image's file.
    image: String,
    sensors: Vec<SensorJudge>,
}

impl Judge {
    /// Reads the judge in `directory` where it is one of this scene, this camera and these settings, and makes and keeps it
    /// there otherwise, as `judge.exr` and `judge.json`. An image from elsewhere may be given with `image`; its
    /// channel `noise.Y` is its noise.
    ///
    /// # Errors
    /// Those of [`reference::render`], [`reference::irradiance`] and of reading and writing files;
    /// [`Error::Settings`] for an image of another size.
    pub fn of(
        directory: &Path,
        image: Option<&Path>,
        (scene, camera): (&Scene, &Camera),
        tracer: &dyn RayTracer,
        settings: &JudgeSettings,
        observer: &dyn Observer,
    ) -> Result<Judge> {
        let own = directory.join("judge.exr");
        let path = image.unwrap_or(&own);
        let list = directory.join("judge.json");
        let key = key_of(scene, camera, settings, image)?;
        if let Some(kept) = kept(&list, &key, path) {
            let (image, noise) = exr::read_with_noise(path)?;
            let judged = judged((image, noise), (scene, camera), tracer, path)?;
            return Ok(Judge { judged, sensors: kept.sensors, key: kept.key + &kept.image, kept: true });
        }
        let appearance = scene.appearance.sample(
            &scene.geometry,
            &Wavelengths::of_bands(BANDS),
            Settings::default().fresnel_entries,
        );
        if image.is_none() {
            let reference = ReferenceSettings { samples: settings.samples, seed: 0 };
            let found =
                reference::render(&scene.geometry, &appearance, camera, tracer, &reference, observer)?;
            exr::write_with(&own, &found.image, &ExrOptions::default(), &[(exr::NOISE, &found.noise)])?;
        }
        let (image, noise) = exr::read_with_noise(path)?;
        let judged = judged((image, noise), (scene, camera), tracer, path)?;
        let sensors = sensors::judge(scene, &appearance, tracer, settings, observer)?;
        let kept = Kept { key, image: hash_of(path)?, sensors };
        write_json(&list, &kept)?;
        Ok(Judge { judged, sensors: kept.sensors, key: kept.key + &kept.image, kept: false })
    }
}

/// What `list` keeps, if it belongs to `key` and to the image at `path`.
fn kept(list: &Path, key: &str, path: &Path) -> Option<Kept> {
    let kept: Kept = serde_json::from_str(&std::fs::read_to_string(list).ok()?).ok()?;
    (kept.key == key && kept.image == hash_of(path).ok()?).then_some(kept)
}

fn hash_of(path: &Path) -> Result<String> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, crate::atomic_file::explain(&e)))?;
    Ok(blake3::hash(&bytes).to_hex().to_string())
}

/// A hash of all that the judge depends on. What is not large goes in as its text, which tells every number apart.
fn key_of(scene: &Scene, camera: &Camera, settings: &JudgeSettings, image: Option<&Path>) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
    let (geometry, appearance) = (&scene.geometry, &scene.appearance);
    hasher.update(&geometry.hash());
    hasher.update(format!("{:?} {:?} {appearance:?} ", geometry.centre, geometry.lights).as_bytes());
    hasher.update(format!("{:?} {:?} {camera:?} ", scene.sensors, scene.grids).as_bytes());
    hasher.update(format!("{settings:?} {BANDS} ").as_bytes());
    if let Some(path) = image {
        hasher.update(hash_of(path)?.as_bytes());
    }
    Ok(hasher.finalize().to_hex().to_string())
}

fn judged(
    (image, noise): (LinearImage, Option<Vec<f32>>),
    (scene, camera): (&Scene, &Camera),
    tracer: &dyn RayTracer,
    path: &Path,
) -> Result<Judged> {
    if [image.width, image.height] != camera.resolution {
        let ([w, h], path) = (camera.resolution, path.display());
        return Err(Error::Settings(format!(
            "{path}: an image of {} x {} pixels cannot judge one of {w} x {h}; give --size {}x{}",
            image.width, image.height, image.width, image.height
        )));
    }
    let finite = |values: &[f32]| values.iter().all(|x| x.is_finite());
    if !finite(&image.rgb) || noise.as_ref().is_some_and(|n| !finite(n)) {
        return Err(Error::io(path, "the image holds values that are not finite numbers, and cannot judge"));
    }
    let noise = noise.unwrap_or_else(|| vec![0.0; image.pixels()]);
    let counts = shows_lamp(scene, camera, tracer).into_iter().map(|lamp| !lamp).collect();
    Ok(Judged { image, noise, counts })
}

/// Rays along either side of a pixel that look for lamps.
const RAYS: usize = 4;

/// Whether each pixel of a camera, from the top left, shows a surface that emits or touches a pixel that does: a lamp may
/// reach into it between the rays.
pub fn shows_lamp(scene: &Scene, camera: &Camera, tracer: &dyn RayTracer) -> Vec<bool> {
    let view = camera.view(scene.geometry.centre);
    let [width, height] = camera.resolution.map(|side| side as usize);
    let emits = |id| scene.appearance.material(id).emission.is_some();
    let lamp = |hit: &Option<Hit>| hit.is_some_and(|hit| emits(hit.surface));
    let row = |y: usize| {
        let at = |k: usize| (k as f64 + 0.5) / RAYS as f64;
        let rays: Vec<Ray> = (0..width)
            .flat_map(|x| (0..RAYS * RAYS).map(move |k| (x, k)))
            .map(|(x, k)| view.ray(x as f64 + at(k % RAYS), y as f64 + at(k / RAYS)))
            .collect();
        let mut hits = vec![None; rays.len()];
        tracer.closest_batch(&rays, &mut hits);
        hits.chunks(RAYS * RAYS).map(|hits| hits.iter().any(lamp)).collect::<Vec<_>>()
    };
    let shows: Vec<bool> = (0..height).into_par_iter().flat_map_iter(row).collect();
    let about = |k: usize, end: usize| k.saturating_sub(1)..(k + 2).min(end);
    let near =
        |p: usize| about(p / width, height).any(|y| about(p % width, width).any(|x| shows[y * width + x]));
    (0..shows.len()).map(near).collect()
}

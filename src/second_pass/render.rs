//! The view.

use super::SpectralImage;
use super::bands::{self, Bands};
use super::checkpoint::Checkpoint;
use super::clamp;
use super::interpolate::Interpolator;
use super::ladder::Fields;
use super::noise::{NoiseTarget, PixelNoise, REPLICATES, Tally};
use super::scatter::{Scatterer, brightness};
use super::settings::{SecondPassSettings, SecondPassStats};
use super::tile::{Room, Tiler};
use crate::error::{Error, Result};
use crate::first_pass::DiffuseSolution;
use crate::observer::Observer;
use crate::scene::{Camera, Geometry, SampledAppearance};
use crate::spectrum::LUMENS_PER_WATT;
use crate::tracers::RayTracer;
use std::collections::BTreeMap;
use std::time::Instant;

/// Rounding of the distance from an eye to the surface it stands on, as a fraction of the scene's radius.
const NEAR: f64 = 1e-12;

/// Stages that sampling to a noise target may take: samples double from each to the next.
const STAGES: usize = 32;

/// A scene whose diffuse light is known.
#[derive(Clone, Copy)]
pub struct LitScene<'a> {
    /// Its shapes.
    pub geometry: &'a Geometry,
    /// Its sample points, ready for interpolation; serves every appearance and camera.
    pub interpolator: &'a Interpolator,
    /// Its materials.
    pub appearance: &'a SampledAppearance,
    /// L^d of its sample points.
    pub solution: &'a DiffuseSolution,
}

/// What a camera sees.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Radiance.
    pub image: SpectralImage,
    /// What it took.
    pub stats: SecondPassStats,
    /// How each pixel was sampled, where [`SecondPassSettings::noise`] asks for a noise.
    pub noise: Option<PixelNoise>,
}

/// Renders what `camera` sees by distributed ray tracing (section 3.4).
///
/// At every hit the radiance is L^d, interpolated, plus the specular light that the path goes on
/// to find. No ray is sent towards lights: L^d has their light already. Rays that meet nothing
/// bring none. Surfaces seen from a side that has no sample points are black and block, but for glass.
///
/// The image has the same bits for any number of threads. Errors: [`Error::Settings`] for settings
/// or a camera that cannot be used, [`Error::Numerical`] for a solution that is not finite or does
/// not fit the sample points or the appearance.
pub fn render(
    scene: &LitScene,
    camera: &Camera,
    tracer: &dyn RayTracer,
    settings: &SecondPassSettings,
    observer: &dyn Observer,
) -> Result<(SpectralImage, SecondPassStats)> {
    let rendered = render_with_checkpoint(scene, camera, tracer, settings, None, observer)?;
    Ok((rendered.image, rendered.stats))
}

/// [`render`] that keeps finished bands of rows in the file of `checkpoint` and uses those that an
/// earlier run left there. The image has the same bits whether it was interrupted or not, and so
/// have the counts. The file stays: see [`Checkpoint::finish`].
///
/// Errors, besides those of [`render`]: [`Error::Settings`] for a file that belongs to another image,
/// [`Error::Io`] for one that cannot be read or written.
pub fn render_with_checkpoint(
    scene: &LitScene,
    camera: &Camera,
    tracer: &dyn RayTracer,
    settings: &SecondPassSettings,
    checkpoint: Option<&Checkpoint>,
    observer: &dyn Observer,
) -> Result<Rendered> {
    let start = Instant::now();
    settings.check()?;
    camera.check()?;
    check_solution(scene)?;

    let weights = brightness(&scene.appearance.wavelengths.xyz_weights);
    let bright = |l: &[f32]| l.iter().zip(&weights).map(|(l, b)| f64::from(l * b)).sum();
    let fields = Fields::new(scene, settings.rung)?;
    let ladder = fields.ladder(scene, tracer, settings, bright);
    let spacing = |surface| scene.interpolator.spacing(surface);
    let limit = clamp::limit(scene, settings, bright);
    let scatterer = Scatterer::new(scene.geometry, scene.appearance, ladder, spacing, settings, limit);
    let w = scene.solution.wavelengths.len();
    let size = camera.resolution.map(|x| x as usize);
    let (view, near) = (camera.view(scene.geometry.centre), NEAR * scene.geometry.radius);
    let tiler = Tiler { scatterer, tracer, view, near, width: size[0], w };
    let (layers, stages) = if settings.noise.is_some() { (w + REPLICATES, STAGES) } else { (w, 1) };
    let floats = |number| bands::floats(size, layers, stages, number);
    let (kept, writer) = match checkpoint {
        Some(checkpoint) => {
            let (kept, writer) = checkpoint.open(&key(scene, &fields, camera, tracer, settings), floats)?;
            (kept, Some(writer))
        }
        None => Default::default(),
    };
    let mut bands = Bands { size, layers, kept, writer, observer };
    let (radiance, noise, mut stats) = match settings.noise {
        None => {
            let (radiance, stats) = bands.stage(0, |places, room| evenly(&tiler, places, room))?;
            (radiance, None, stats)
        }
        Some(target) => {
            let xyz = &scene.appearance.wavelengths.xyz_weights;
            let luminance: Vec<f64> = xyz.iter().map(|xyz| LUMENS_PER_WATT * xyz[1]).collect();
            let (radiance, noise, stats) = to_target(&tiler, &luminance, target, &mut bands)?;
            (radiance, Some(noise), stats)
        }
    };
    stats.cut_share /= stats.camera_rays.max(1) as f64;
    let shown: f64 = radiance.chunks_exact(w).map(bright).sum();
    let samples = stats.camera_rays as f64 / (radiance.len() / w) as f64;
    let whole = (samples * shown + stats.clamped_share).max(f64::MIN_POSITIVE);
    stats.by_chance_share /= whole;
    stats.clamped_share /= whole;
    stats.second_pass_s = start.elapsed().as_secs_f64();
    let [width, height] = camera.resolution;
    let image = SpectralImage { width, height, wavelengths: scene.solution.wavelengths.clone(), radiance };
    Ok(Rendered { image, stats, noise })
}

/// The mean radiance of the samples that the settings ask for.
fn evenly(tiler: &Tiler, places: &[[u32; 2]], room: &mut Room) -> (Vec<f64>, SecondPassStats) {
    let samples = tiler.scatterer.settings.samples;
    let mut film = tiler.trace(places, 0, 0..samples, room);
    film.radiance.iter_mut().for_each(|sum| *sum /= f64::from(samples));
    (film.radiance, film.stats)
}

/// Stage by stage more samples where they are worth most, until the image is as little noisy as `target` asks or the
/// samples have run out. `luminance` is that of a radiance of 1 at each wavelength.
fn to_target(
    tiler: &Tiler,
    luminance: &[f64],
    target: NoiseTarget,
    bands: &mut Bands,
) -> Result<(Vec<f32>, PixelNoise, SecondPassStats)> {
    let (w, layers, width) = (tiler.w, bands.layers, tiler.width);
    let mut tally = Tally::new(bands.size, w, target);
    let mut total = SecondPassStats::default();
    let mut next = Some(tally.first(tiler.scatterer.settings.samples));
    for stage in 0.. {
        let Some(wanted) = next else { break };
        let (sums, stats) = bands.stage(stage, |places, room| {
            let mut sums = vec![0.0; places.len() * layers];
            let mut stats = SecondPassStats::default();
            // Pixels that go the same way are traced together.
            let mut alike: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
            for (k, &[x, y]) in places.iter().enumerate() {
                let pixel = y as usize * width + x as usize;
                let way = (tally.points(pixel), wanted[pixel]);
                if way.0 < way.1 {
                    alike.entry(way).or_default().push(k);
                }
            }
            for ((from, to), pixels) in alike {
                let there: Vec<[u32; 2]> = pixels.iter().map(|&k| places[k]).collect();
                for replicate in 0..REPLICATES {
                    let film = tiler.trace(&there, replicate as u32, from..to, room);
                    for (&k, found) in pixels.iter().zip(film.radiance.chunks_exact(w)) {
                        let of = &mut sums[k * layers..][..layers];
                        of.iter_mut().zip(found).for_each(|(sum, l)| *sum += l);
                        of[w + replicate] = found.iter().zip(luminance).map(|(l, y)| l * y).sum();
                    }
                    stats.add(&film.stats);
                }
            }
            (sums, stats)
        })?;
        tally.add(&sums, wanted);
        total.add(&stats);
        next = tally.next();
    }
    let (radiance, noise, stats) = tally.finish();
    total.noise = Some(stats);
    Ok((radiance, noise, total))
}

/// A hash of all that the image depends on. What is small goes in as its text, which tells every field
/// and every number apart.
fn key(
    scene: &LitScene,
    fields: &Fields,
    camera: &Camera,
    tracer: &dyn RayTracer,
    settings: &SecondPassSettings,
) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
    hasher.update(format!("{camera:?} {settings:?} {} ", tracer.name()).as_bytes());
    hasher.update(&scene.geometry.hash());
    hasher.update(format!("{:?} {:?} ", scene.geometry.centre, scene.geometry.patch).as_bytes());
    hasher.update(format!("{:?} {:?} ", scene.appearance, scene.geometry.lights).as_bytes());
    fields.hash(&mut hasher);
    *hasher.finalize().as_bytes()
}

fn check_solution(scene: &LitScene) -> Result<()> {
    let refuse = |what: &str| Err(Error::Numerical(format!("second pass: {what}")));
    let (solution, appearance) = (scene.solution, scene.appearance);
    if solution.wavelengths.is_empty() || solution.wavelengths != appearance.wavelengths {
        return refuse("the solution and the appearance are not sampled at the same wavelengths");
    }
    if solution.radiance.len() != scene.interpolator.len() * solution.wavelengths.len() {
        return refuse("the solution does not belong to these sample points");
    }
    if appearance.surface_material.len() != scene.geometry.surfaces.len() {
        return refuse("the appearance does not belong to this geometry");
    }
    if !solution.radiance.iter().all(|l| l.is_finite()) {
        return refuse("the solution of the first pass is not finite");
    }
    Ok(())
}

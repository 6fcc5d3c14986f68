//! The judge: an unbiased spectral path tracer over the same scene.
//!
//! It shares with the two passes the scene, the tracers and what a surface does with light, but none of their
//! integrators: no sample points, no graph, no interpolation. At every event emitters are asked by shadow rays and found
//! by chance, weighed by the power heuristic (E. Veach, *Robust Monte Carlo Methods for Light Transport Simulation*, 1997,
//! chapter 9); paths end by Russian roulette alone. The image says how noisy it is, pixel by pixel.
//!
//! Paths that leave the scene see the sky. Not found: light of lights without a body by way of mirrors and solid glass, for
//! nothing can hit a point by chance; what comes straight through panes is.

mod asks;
mod bsdf;
mod emitters;
mod events;
mod irradiance;
mod path;

pub use irradiance::{SensorReference, irradiance};

use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::scene::{Camera, Geometry, SampledAppearance};
use crate::second_pass::SpectralImage;
use crate::tracers::RayTracer;
use emitters::Emitters;
use path::{Eye, Replicate, Tracing};
use rayon::prelude::*;
use serde::Serialize;
use std::time::Instant;

/// Images of independent randomness that a reference is the mean of: what they differ by is its noise.
const REPLICATES: u32 = 16;

/// Pixels of one task.
const PIXELS: usize = 256;

/// How a reference is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceSettings {
    /// Paths a pixel; more than 16 are rounded up to a multiple of 16.
    pub samples: u32,
    /// Another seed gives another noise.
    pub seed: u32,
}

/// What a reference took, and how noisy it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReferenceStats {
    /// Paths a pixel.
    pub samples: u32,
    /// Rays that looked for the next surface.
    pub rays: u64,
    /// Rays that looked for a light.
    pub shadow_rays: u64,
    /// Longest path, events.
    pub longest: u32,
    /// Standard error of luminance, root mean square over the pixels, over the mean luminance of the image; `None` for
    /// a single sample.
    pub relative_noise: Option<f64>,
    /// Wall time, s.
    pub reference_s: f64,
}

/// A reference image.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Radiance.
    pub image: SpectralImage,
    /// Standard error of each pixel's luminance, cd m⁻², from the top left; empty for a single sample.
    pub noise: Vec<f32>,
    /// What it took.
    pub stats: ReferenceStats,
}

/// Renders what `camera` sees. The same bits for any number of threads.
///
/// # Errors
/// [`Error::Settings`] for settings, a camera or an appearance that cannot be used.
pub fn render(
    geometry: &Geometry,
    appearance: &SampledAppearance,
    camera: &Camera,
    tracer: &dyn RayTracer,
    settings: &ReferenceSettings,
    observer: &dyn Observer,
) -> Result<Reference> {
    let start = Instant::now();
    camera.check()?;
    check(geometry, appearance, settings)?;
    let replicates = settings.samples.min(REPLICATES);
    let each = settings.samples.div_ceil(replicates);
    let emitters = Emitters::new(geometry, appearance);
    let tracing = Tracing::new(geometry, appearance, tracer, &emitters, settings.seed);
    let eye = Eye::new(geometry, camera);
    let [width, height] = camera.resolution;
    let pixels = width as usize * height as usize;
    let w = appearance.wavelengths.len();

    observer.begin("reference", pixels.div_ceil(PIXELS) as u64);
    let parts: Vec<Part> = (0..pixels.div_ceil(PIXELS))
        .into_par_iter()
        .map(|task| {
            let first = task * PIXELS;
            let part = part(&tracing, &eye, first..pixels.min(first + PIXELS), replicates, each);
            observer.advance(1);
            part
        })
        .collect();
    observer.end();

    let mut radiance = Vec::with_capacity(pixels * w);
    let mut noise = Vec::new();
    let mut stats = ReferenceStats {
        samples: replicates * each,
        rays: 0,
        shadow_rays: 0,
        longest: 0,
        relative_noise: None,
        reference_s: 0.0,
    };
    for part in parts {
        radiance.extend(part.radiance);
        noise.extend(part.noise);
        stats.rays += part.rays;
        stats.shadow_rays += part.shadow_rays;
        stats.longest = stats.longest.max(part.longest);
    }
    let image = SpectralImage { width, height, wavelengths: appearance.wavelengths.clone(), radiance };
    if replicates > 1 {
        let mean = (0..pixels).map(|p| image.xyz(p)[1]).sum::<f64>() / pixels as f64;
        let square = noise.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / pixels as f64;
        stats.relative_noise = Some(if mean > 0.0 { square.sqrt() / mean } else { 0.0 });
    }
    stats.reference_s = start.elapsed().as_secs_f64();
    Ok(Reference { image, noise, stats })
}

/// Whether the parts belong together and can be used.
fn check(geometry: &Geometry, appearance: &SampledAppearance, settings: &ReferenceSettings) -> Result<()> {
    if settings.samples == 0 || settings.samples > 1 << 20 {
        return Err(Error::Settings(format!(
            "samples a pixel ({}) must lie between 1 and {}",
            settings.samples,
            1 << 20
        )));
    }
    if appearance.surface_material.len() != geometry.surfaces.len() {
        return Err(Error::Settings("the appearance does not belong to this geometry".into()));
    }
    Ok(())
}

/// Some pixels of the image.
struct Part {
    radiance: Vec<f32>,
    noise: Vec<f32>,
    rays: u64,
    shadow_rays: u64,
    longest: u32,
}

/// Renders some pixels, one replicate after the other.
fn part(tracing: &Tracing, eye: &Eye, pixels: std::ops::Range<usize>, replicates: u32, each: u32) -> Part {
    let w = tracing.wavelengths();
    let count = pixels.len();
    let mut sums = vec![0.0; count * w];
    let (mut mean, mut squares) = (vec![0.0; count], vec![0.0; count]);
    let mut part = Part { radiance: Vec::new(), noise: Vec::new(), rays: 0, shadow_rays: 0, longest: 0 };
    for number in 0..replicates {
        let replicate = Replicate::trace(tracing, eye, pixels.clone(), number, each);
        part.rays += replicate.rays;
        part.shadow_rays += replicate.shadow_rays;
        part.longest = part.longest.max(replicate.longest);
        sums.iter_mut().zip(&replicate.radiance).for_each(|(sum, l)| *sum += l / f64::from(replicates));
        // Running mean and squares of the deviations from it (Welford).
        for pixel in 0..count {
            let y = tracing.luminance(&replicate.radiance[pixel * w..(pixel + 1) * w]);
            let off = y - mean[pixel];
            mean[pixel] += off / f64::from(number + 1);
            squares[pixel] += off * (y - mean[pixel]);
        }
    }
    part.radiance = sums.into_iter().map(|l| l as f32).collect();
    if replicates > 1 {
        let n = f64::from(replicates);
        part.noise = squares.iter().map(|s| (s / (n * (n - 1.0))).sqrt() as f32).collect();
    }
    part
}

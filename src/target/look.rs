//! Small images of a view that levels are compared by.

use crate::error::Result;
use crate::first_pass::DiffuseSolution;
use crate::observer::Silent;
use crate::pipeline::{self, Prepared};
use crate::report::tradeoff::judge::shows_lamp;
use crate::scene::{Camera, SampledAppearance, Scene};
use crate::second_pass::{Rung, SecondPassSettings, SpectralImage};
use crate::tracers::RayTracer;
use std::time::Instant;

/// Pixels of a small image, about.
const PIXELS: f64 = 8000.0;

/// Samples a pixel of each of its two halves.
pub const SAMPLES: u32 = 4;

/// A view in small, and which of its pixels count.
pub struct Finder<'a> {
    scene: &'a Scene,
    camera: Camera,
    tracer: &'a dyn RayTracer,
    counts: Vec<bool>,
    settings: SecondPassSettings,
}

/// Luminance under two seeds, and what it took.
#[derive(Clone)]
pub struct Look {
    halves: [Vec<f64>; 2],
    /// Wall time a pixel and sample, s.
    pub s: f64,
}

impl<'a> Finder<'a> {
    /// Of what `camera` sees.
    pub fn new(
        scene: &'a Scene,
        camera: &Camera,
        tracer: &'a dyn RayTracer,
        settings: &SecondPassSettings,
    ) -> Self {
        let mut camera = camera.clone();
        let [w, h] = camera.resolution.map(f64::from);
        let scale = (PIXELS / (w * h)).sqrt().min(1.0);
        camera.resolution = [w, h].map(|side| ((side * scale).round() as u32).max(1));
        let counts = counted(scene, &camera, tracer);
        let settings = SecondPassSettings { samples: SAMPLES, ..*settings };
        Finder { scene, camera, tracer, counts, settings }
    }

    /// Looks at a solution on a rung.
    pub fn look(
        &self,
        prepared: &Prepared,
        light: &(SampledAppearance, DiffuseSolution),
        rung: Rung,
    ) -> Result<Look> {
        let clock = Instant::now();
        let half = |seed: u32| -> Result<Vec<f64>> {
            let settings = SecondPassSettings { rung, seed, ..self.settings };
            let geometry = &self.scene.geometry;
            let (image, _) =
                pipeline::view(geometry, prepared, light, &self.camera, self.tracer, &settings, &Silent)?;
            Ok(luminances(&image))
        };
        let halves = [half(self.settings.seed)?, half(self.settings.seed.wrapping_add(1))?];
        let samples = (2 * SAMPLES) as f64 * self.counts.len() as f64;
        Ok(Look { halves, s: clock.elapsed().as_secs_f64() / samples })
    }

    /// Root mean square difference of two looks, of the mean luminance: the part that no seed changes.
    pub fn change(&self, before: &Look, after: &Look) -> f64 {
        let both = |p: usize| {
            (after.halves[0][p] - before.halves[0][p]) * (after.halves[1][p] - before.halves[1][p])
        };
        relative(&self.counts, both, &after.halves)
    }

    /// Noise of an image of one sample a pixel, of the mean luminance, as if it fell with the root of their number.
    pub fn noise(&self, look: &Look) -> f64 {
        noise_of(&self.counts, &look.halves) * f64::from(2 * SAMPLES).sqrt()
    }
}

/// Luminance of each pixel, cd m⁻².
pub fn luminances(image: &SpectralImage) -> Vec<f64> {
    (0..image.pixels()).map(|p| image.xyz(p)[1]).collect()
}

/// Which pixels of a camera count: those that show no lamp, or all.
pub fn counted(scene: &Scene, camera: &Camera, tracer: &dyn RayTracer) -> Vec<bool> {
    let shows = shows_lamp(scene, camera, tracer);
    let some = shows.contains(&false);
    shows.into_iter().map(|lamp| !lamp || !some).collect()
}

/// Noise of the mean of two images of different seeds, of the mean luminance.
pub fn noise_of(counts: &[bool], halves: &[Vec<f64>; 2]) -> f64 {
    relative(counts, |p| 0.25 * (halves[0][p] - halves[1][p]).powi(2), halves)
}

/// Root of the mean of `square` over the pixels that count, of their mean luminance.
fn relative(counts: &[bool], square: impl Fn(usize) -> f64, halves: &[Vec<f64>; 2]) -> f64 {
    let (mut sum, mut luminance, mut n) = (0.0, 0.0, 0.0);
    for p in (0..counts.len()).filter(|&p| counts[p]) {
        sum += square(p);
        luminance += 0.5 * (halves[0][p] + halves[1][p]);
        n += 1.0;
    }
    if luminance > 0.0 { (sum / n).max(0.0).sqrt() / (luminance / n) } else { 0.0 }
}

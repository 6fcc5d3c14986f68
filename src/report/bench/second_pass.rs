//! The second pass beside a bare loop over the rays that it casts, by number of threads.

use crate::error::{Error, Result};
use crate::geometry::{Hit, Ray, SurfaceId};
use crate::observer::Silent;
use crate::scene::Camera;
use crate::second_pass::{LitScene, SecondPassSettings, render};
use crate::tracers::{EmbreeTracer, RayTracer, Segment, embree};
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Rounds of which the fastest counts: the others were disturbed.
const ROUNDS: usize = 5;

/// The second pass of one view, and the ceiling of its rate.
#[derive(Clone, Debug, Serialize)]
pub struct SecondPassRates {
    /// Name of the tracer.
    pub tracer: String,
    /// Width and height of the image, pixels.
    pub resolution: [u32; 2],
    /// Samples a pixel.
    pub samples: u32,
    /// Wavelengths.
    pub wavelengths: usize,
    /// Rays cast, of all kinds.
    pub rays: usize,
    /// By number of threads: 1, 2 and so on up to all.
    pub by_threads: Vec<SecondPassRate>,
}

/// The rates on so many threads.
#[derive(Clone, Debug, Serialize)]
pub struct SecondPassRate {
    /// Threads.
    pub threads: usize,
    /// The second pass, s.
    pub second_pass_s: f64,
    /// Its rays a second.
    pub rays_per_s: f64,
    /// Its rate over that on one thread.
    pub speedup: f64,
    /// Rays a second of a loop that traces the same rays in Embree's packets of 16 and keeps parameter and surface
    /// alone; `None` in a build without Embree.
    pub bare_rays_per_s: Option<f64>,
    /// Rate over bare rate.
    pub ratio: Option<f64>,
}

/// Renders what `camera` sees and traces the same rays in a bare loop, in turn.
///
/// # Errors
/// Those of [`render`]; [`Error::Tracer`] where Embree is built in and does not take the scene, or where no threads
/// can be had.
pub fn second_pass_rates(
    scene: &LitScene,
    camera: &Camera,
    tracer: &dyn RayTracer,
    settings: &SecondPassSettings,
) -> Result<SecondPassRates> {
    let record = Record { tracer, rays: Mutex::default() };
    pool(1)?.install(|| render(scene, camera, &record, settings, &Silent))?;
    let rays = record.rays.into_inner().unwrap_or_else(PoisonError::into_inner);
    let embree = embree::available().map(|_| EmbreeTracer::new(scene.geometry)).transpose()?;
    let mut bare = embree.as_ref().map(|tracer| tracer.bare_loop(&rays));
    let count = rays.len();
    drop(rays);
    let mut by_threads: Vec<SecondPassRate> = Vec::new();
    for threads in 1..=rayon::current_num_threads() {
        let pool = pool(threads)?;
        let (mut best, mut best_bare) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..ROUNDS {
            let (_, stats) = pool.install(|| render(scene, camera, tracer, settings, &Silent))?;
            best = best.min(stats.second_pass_s);
            if let Some(bare) = &mut bare {
                let start = Instant::now();
                pool.install(|| bare.run());
                best_bare = best_bare.min(start.elapsed().as_secs_f64());
            }
        }
        by_threads.push(SecondPassRate {
            threads,
            second_pass_s: best,
            rays_per_s: count as f64 / best,
            speedup: by_threads.first().map_or(1.0, |one| one.second_pass_s / best),
            bare_rays_per_s: bare.as_ref().map(|_| count as f64 / best_bare),
            ratio: bare.as_ref().map(|_| best_bare / best),
        });
    }
    Ok(SecondPassRates {
        tracer: tracer.name(),
        resolution: camera.resolution,
        samples: settings.samples,
        wavelengths: scene.solution.wavelengths.len(),
        rays: count,
        by_threads,
    })
}

fn pool(threads: usize) -> Result<rayon::ThreadPool> {
    let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    built.map_err(|e| Error::Tracer(format!("{threads} threads could not be started: {e}")))
}

/// A tracer that keeps the rays of all batches in the order in which they came.
struct Record<'a> {
    tracer: &'a dyn RayTracer,
    rays: Mutex<Vec<Ray>>,
}

impl RayTracer for Record<'_> {
    fn name(&self) -> String {
        self.tracer.name()
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.tracer.closest(ray)
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.rays.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(rays);
        self.tracer.closest_batch(rays, hits);
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        self.tracer.blocker(segment)
    }
}

//! The view: tiles of pixels, each the work of one task.

use super::SpectralImage;
use super::checkpoint::{Checkpoint, Writer};
use super::eye::Look;
use super::interpolate::Interpolator;
use super::ladder::Fields;
use super::scatter::{Film, Scatterer, brightness};
use super::sequence::mix;
use super::settings::{SecondPassSettings, SecondPassStats};
use super::wave::{Fresh, Wave};
use crate::error::{Error, Result};
use crate::first_pass::DiffuseSolution;
use crate::geometry::Hit;
use crate::observer::Observer;
use crate::scene::{Camera, Geometry, SampledAppearance, View};
use crate::simd::wide;
use crate::tracers::RayTracer;
use rayon::prelude::*;
use std::time::Instant;

/// Pixels along the edge of a tile.
const TILE: usize = 16;

/// Pixel samples of a tile that are traced together, at most: enough to feed a tracer with
/// packets, few enough for their rays, hits and throughputs to stay in a core's own cache.
const BATCH: usize = 1024;

/// Rounding of the distance from an eye to the surface it stands on, as a fraction of the scene's radius.
const NEAR: f64 = 1e-12;

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
    render_with_checkpoint(scene, camera, tracer, settings, None, observer)
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
) -> Result<(SpectralImage, SecondPassStats)> {
    let start = Instant::now();
    settings.check()?;
    camera.check()?;
    check_solution(scene)?;

    let weights = brightness(&scene.appearance.wavelengths.xyz_weights);
    let bright = |l: &[f32]| l.iter().zip(&weights).map(|(l, b)| f64::from(l * b)).sum();
    let fields = Fields::new(scene, settings.rung)?;
    let ladder = fields.ladder(scene, tracer, settings, bright);
    let spacing = |surface| scene.interpolator.spacing(surface);
    let scatterer = Scatterer::new(scene.geometry, scene.appearance, ladder, spacing, settings);
    let w = scene.solution.wavelengths.len();
    let [width, height] = camera.resolution.map(|x| x as usize);
    let (view, near) = (camera.view(scene.geometry.centre), NEAR * scene.geometry.radius);
    let job = Job { scatterer, tracer, view, near, width, height, w };
    let columns = width.div_ceil(TILE);
    let bands = height.div_ceil(TILE);
    let floats = |band: u32| {
        let first = band as usize * TILE;
        (first < height).then(|| TILE.min(height - first) * width * w)
    };
    let (mut kept, writer) = match checkpoint {
        Some(checkpoint) => {
            let (kept, writer) = checkpoint.open(&key(scene, &fields, camera, tracer, settings), floats)?;
            (kept, Some(writer))
        }
        None => Default::default(),
    };
    observer.begin("second pass", (columns * bands) as u64);
    let mut radiance = vec![0.0f32; width * height * w];
    let rows: Vec<_> = radiance
        .chunks_mut(TILE * width * w)
        .enumerate()
        .map(|(number, rows)| (number, rows, kept.remove(&(number as u32))))
        .collect();
    let stats: Result<Vec<SecondPassStats>> = rows
        .into_par_iter()
        .map(|(number, rows, kept)| match kept {
            Some(band) => {
                rows.copy_from_slice(&band.radiance);
                observer.advance(columns as u64);
                Ok(band.stats)
            }
            None => job.band(number, rows, writer.as_ref(), observer),
        })
        .collect();
    observer.end();

    let mut total = SecondPassStats::default();
    stats?.iter().for_each(|band| total.add(band));
    total.cut_share /= total.camera_rays.max(1) as f64;
    total.second_pass_s = start.elapsed().as_secs_f64();
    let [width, height] = camera.resolution;
    Ok((SpectralImage { width, height, wavelengths: scene.solution.wavelengths.clone(), radiance }, total))
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

/// Room for the waves of a tile, to be used again for the next.
#[derive(Default)]
struct Room {
    wave: Wave,
    next: Wave,
    hits: Vec<Option<Hit>>,
}

/// What every tile needs to know.
struct Job<'a> {
    scatterer: Scatterer<'a>,
    tracer: &'a dyn RayTracer,
    view: View,
    /// A surface nearer to the eye is the one it stands on, and not seen, m.
    near: f64,
    width: usize,
    height: usize,
    w: usize,
}

impl Job<'_> {
    /// First column and row of a tile, and how many there are of each.
    fn extent(&self, column: usize, band: usize) -> ([usize; 2], [usize; 2]) {
        let low = [column * TILE, band * TILE];
        (low, [TILE.min(self.width - low[0]), TILE.min(self.height - low[1])])
    }

    /// Renders the rows of a band and keeps them.
    fn band(
        &self,
        number: usize,
        rows: &mut [f32],
        writer: Option<&Writer>,
        observer: &dyn Observer,
    ) -> Result<SecondPassStats> {
        let tiles: Vec<Film> = (0..self.width.div_ceil(TILE))
            .into_par_iter()
            .map_init(Room::default, |room, column| {
                let film = self.tile(column, number, room);
                observer.advance(1);
                film
            })
            .collect();
        let mut stats = SecondPassStats::default();
        for (column, film) in tiles.iter().enumerate() {
            self.copy(film, column, rows);
            stats.add(&film.stats);
        }
        if let Some(writer) = writer {
            writer.add(number as u32, rows, &stats)?;
        }
        Ok(stats)
    }

    /// Renders one tile.
    fn tile(&self, column: usize, band: usize, Room { wave, next, hits }: &mut Room) -> Film {
        let (low, [columns, rows]) = self.extent(column, band);
        let settings = self.scatterer.settings;
        let pixels = columns * rows;
        let place = |pixel: usize| (low[0] + pixel % columns, low[1] + pixel / columns);
        let seeds = (0..pixels)
            .map(|p| {
                let (x, y) = place(p);
                mix((y * self.width + x) as u32 ^ mix(settings.seed))
            })
            .collect();
        let mut film = Film::new(seeds, self.w);
        let samples = (BATCH / pixels).max(1) as u32;
        for first in (0..settings.samples).step_by(samples as usize) {
            let count = samples.min(settings.samples - first);
            wave.clear();
            let (view, seeds, rays) = (&self.view, &film.seeds, &mut wave.rays);
            wide(Look { view, near: self.near, low, columns, seeds, first, count, rays });
            wave.fresh = Some(Fresh { first, count });
            film.stats.camera_rays += wave.rays.len() as u64;
            // Every wave is one specular event deeper, so this ends at the depth limit.
            while !wave.rays.is_empty() {
                hits.resize(wave.rays.len(), None);
                self.tracer.closest_batch(&wave.rays, hits);
                self.scatterer.meet(wave, hits, &mut film, next);
                std::mem::swap(wave, next);
            }
        }
        for sum in &mut film.radiance {
            *sum /= f64::from(settings.samples);
        }
        film
    }

    /// Copies a tile into the rows of its band.
    fn copy(&self, film: &Film, column: usize, band: &mut [f32]) {
        let start = column * TILE;
        let columns = TILE.min(self.width - start);
        for (row, pixels) in film.radiance.chunks_exact(columns * self.w).enumerate() {
            let to = (row * self.width + start) * self.w;
            for (out, sum) in band[to..to + pixels.len()].iter_mut().zip(pixels) {
                *out = *sum as f32;
            }
        }
    }
}

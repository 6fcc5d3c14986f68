//! Pixels that are traced together, the work of one task.

use super::eye::Look;
use super::film::Film;
use super::scatter::Scatterer;
use super::sequence::mix;
use super::wave::{Fresh, Wave};
use crate::geometry::Hit;
use crate::scene::View;
use crate::simd::widest;
use crate::tracers::RayTracer;
use std::ops::Range;

/// Pixel samples that are traced together, at most: enough to feed a tracer with packets, few enough for their rays,
/// hits and throughputs to stay in a core's own cache.
const BATCH: usize = 1024;

/// Room for the waves of a tile, to be used again for the next.
#[derive(Default)]
pub(super) struct Room {
    wave: Wave,
    next: Wave,
    hits: Vec<Option<Hit>>,
}

/// What every tile needs to know.
pub(super) struct Tiler<'a> {
    pub scatterer: Scatterer<'a>,
    pub tracer: &'a dyn RayTracer,
    pub view: View,
    /// A surface nearer to the eye is the one it stands on, and not seen, m.
    pub near: f64,
    /// Pixels in a row of the image.
    pub width: usize,
    /// Wavelengths.
    pub w: usize,
}

impl Tiler<'_> {
    /// What these points of the sequences of the pixels at `places` (column and row) find, summed. Each `replicate`
    /// has its own randomness.
    pub fn trace(&self, places: &[[u32; 2]], replicate: u32, points: Range<u32>, room: &mut Room) -> Film {
        let seed = mix(self.scatterer.settings.seed);
        let seed = if replicate == 0 { seed } else { mix(seed.wrapping_add(replicate)) };
        let seeds = places.iter().map(|&[x, y]| mix((y as usize * self.width + x as usize) as u32 ^ seed));
        let mut film = Film::new(seeds.collect(), self.w);
        let Room { wave, next, hits } = room;
        // All points of a pixel together, for they go the same way, and then as many pixels as there is room for.
        let most = points.len().clamp(1, BATCH);
        let pixels = BATCH / most;
        for (number, places) in places.chunks(pixels).enumerate() {
            let pixel = number * pixels;
            for first in points.clone().step_by(most) {
                let count = (points.end - first).min(most as u32);
                wave.clear();
                let (view, seeds) = (&self.view, &film.seeds[pixel..]);
                widest(Look { view, near: self.near, places, seeds, first, count, rays: &mut wave.rays });
                wave.fresh = Some(Fresh { pixel: pixel as u32, first, count });
                film.stats.camera_rays += wave.rays.len() as u64;
                // Every wave is one specular event deeper, so this ends at the depth limit.
                while !wave.rays.is_empty() {
                    hits.resize(wave.rays.len(), None);
                    self.tracer.closest_batch(&wave.rays, hits);
                    self.scatterer.meet(wave, hits, &mut film, next);
                    std::mem::swap(wave, next);
                }
            }
        }
        film
    }
}

//! Paths that are traced together: all of a tile, one event after the other.

use crate::geometry::{Ray, SurfaceId};
use crate::scene::Geometry;
use glam::DVec3;

/// No solid around a path.
pub const NO_MEDIUM: u32 = u32::MAX;

/// A path but for its ray and throughput.
#[derive(Clone, Copy, Debug)]
pub struct Path {
    /// Where the segment leaves its surface; the ray itself starts a little above, m.
    pub start: DVec3,
    /// Pixel within the tile.
    pub pixel: u32,
    /// Which point of the pixel's Sobol' sequence it follows.
    pub index: u32,
    /// Specular events so far.
    pub depth: u32,
    /// Times both branches at glass were followed.
    pub splits: u32,
    /// Whether it has left a rough specular surface.
    pub glossy: bool,
    /// How often it has left a diffuse surface to gather what falls on it.
    pub bounces: u32,
    /// Material of the solid it is in, or [`NO_MEDIUM`].
    pub medium: u32,
    /// How densely directions like its own leave the lobe that it comes from, 1/sr, where lamps were asked for that
    /// lobe's light; else infinite.
    pub density: f32,
    /// Whether it came from such a lobe over mirrors or glass: no lamp that it meets there could be asked.
    pub by_chance: bool,
}

/// Paths that begin at the eye: `count` in each pixel, all of one pixel after the other.
#[derive(Clone, Copy)]
pub struct Fresh {
    /// The first of the pixels within the tile.
    pub pixel: u32,
    /// Which point of the pixels' Sobol' sequences comes first.
    pub first: u32,
    /// Points in each pixel.
    pub count: u32,
}

/// Rays under way, structure of arrays: a batch for the tracer.
#[derive(Default)]
pub struct Wave {
    /// Next segment of each path.
    pub rays: Vec<Ray>,
    /// The rest of it; nothing where all are fresh.
    pub paths: Vec<Path>,
    /// What share of the radiance met reaches the pixel sample: `[paths][W]`; nothing where all are fresh, which bring
    /// all of it.
    pub throughput: Vec<f32>,
    /// Whether all paths begin here.
    pub fresh: Option<Fresh>,
}

impl Wave {
    /// Adds a path.
    pub fn push(&mut self, ray: Ray, path: Path, throughput: impl IntoIterator<Item = f32>) {
        self.rays.push(ray);
        self.paths.push(path);
        self.throughput.extend(throughput);
    }

    /// Path `k`.
    pub fn path(&self, k: usize) -> Path {
        match self.fresh {
            None => self.paths[k],
            Some(Fresh { pixel, first, count }) => Path {
                start: self.rays[k].origin,
                pixel: pixel + k as u32 / count,
                index: first + k as u32 % count,
                depth: 0,
                splits: 0,
                glossy: false,
                bounces: 0,
                medium: NO_MEDIUM,
                density: f32::INFINITY,
                by_chance: false,
            },
        }
    }

    /// The pixel of path `k`.
    pub fn pixel(&self, k: usize) -> usize {
        let of = |Fresh { pixel, count, .. }: Fresh| (pixel + k as u32 / count) as usize;
        self.fresh.map_or_else(|| self.paths[k].pixel as usize, of)
    }

    /// [`Path::density`] of path `k`.
    #[inline(always)]
    pub fn density(&self, k: usize) -> f32 {
        if self.fresh.is_some() { f32::INFINITY } else { self.paths[k].density }
    }

    /// [`Path::by_chance`] of path `k`.
    #[inline(always)]
    pub fn by_chance(&self, k: usize) -> bool {
        self.fresh.is_none() && self.paths[k].by_chance
    }

    /// Writes down what fresh paths leave out, for `w` wavelengths.
    pub fn spell_out(&mut self, w: usize) {
        if self.fresh.is_some() {
            self.paths = (0..self.rays.len()).map(|k| self.path(k)).collect();
            self.throughput = vec![1.0; self.rays.len() * w];
            self.fresh = None;
        }
    }

    /// Forgets all paths and keeps the memory.
    pub fn clear(&mut self) {
        self.fresh = None;
        self.rays.clear();
        self.paths.clear();
        self.throughput.clear();
    }
}

/// How far above a surface rays must start so as not to meet it again: a few steps of the f32
/// lattice, and what a quad that is not quite flat strays from its plane, m.
pub fn ray_offset(geometry: &Geometry, surface: SurfaceId) -> f64 {
    4.0 * geometry.plane_tolerance() + geometry.surface(surface).warp()
}

/// The middle of a surface, and the share of the way there that moves a place on its edge by about `offset` off
/// the edge, a thousandth at most; what has no corners needs none.
pub fn inset(geometry: &Geometry, surface: SurfaceId, offset: f64) -> (DVec3, f64) {
    let corners = geometry.surface(surface).vertices();
    if corners.is_empty() {
        return (DVec3::ZERO, 0.0);
    }
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let edge = |(i, a): (usize, &DVec3)| {
        let along = (corners[(i + 1) % corners.len()] - *a).normalize_or_zero();
        (middle - *a).reject_from_normalized(along).length()
    };
    let reach = corners.iter().enumerate().map(edge).fold(f64::INFINITY, f64::min);
    (middle, if reach > 0.0 { (offset / reach).min(1e-3) } else { 0.0 })
}

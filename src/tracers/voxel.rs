//! The paper's ray tracer: voxels stepped through in the order of the ray (section 4.1).
//!
//! All in `f64`, and with the very edge functions of [`super::brute_force`]: it finds what brute
//! force finds, to the bit, only sooner.

use super::brute_force::{segment_ray, side_met};
use super::cull::{Blocks, LANES, Line, OrientedBox, Stretch};
use super::edges::RayFrame;
use super::facet::Facet;
use super::{RayTracer, Segment};
use crate::geometry::{Hit, Ray, Round, Surface, SurfaceId};
use crate::scene::Geometry;
use crate::simd::{HotLoop, wide};
use crate::voxels::{MAX_LEVEL, Part, Step, VoxelSettings, Voxels, Walk};

/// Casts rays through voxels of its own, finer than those of the visibility graph.
#[derive(Clone, Debug)]
pub struct VoxelTracer {
    voxels: Voxels,
    surfaces: Vec<Surface>,
    facets: Vec<Facet>,
    /// First block of each voxel: `[voxels + 1]`.
    starts: Vec<u32>,
    /// Boxes around the facets of each voxel, voxel by voxel.
    blocks: Blocks,
    /// Distance of the furthest corner of the voxels from the local origin, m.
    reach: f64,
}

/// How many facets a surface is.
fn parts_of(surface: &Surface) -> usize {
    surface.round().map_or(1, Round::parts)
}

impl VoxelTracer {
    /// A tracer over `geometry`, its voxels as fine as measurement showed best.
    pub fn new(geometry: &Geometry) -> Self {
        let parts = geometry.surfaces.iter().map(parts_of).sum();
        Self::with_settings(geometry, &Self::settings(parts))
    }

    /// A tracer with voxels of a given fineness.
    pub fn with_settings(geometry: &Geometry, settings: &VoxelSettings) -> Self {
        let mut facets = Vec::with_capacity(geometry.surfaces.len());
        let (mut parts, mut boxes) = (Vec::new(), Vec::new());
        for (i, surface) in geometry.surfaces.iter().enumerate() {
            let id = SurfaceId(i as u32);
            let count = parts_of(surface);
            for k in 0..count {
                let bounds = surface.round().map_or_else(|| surface.bounds(), |round| round.part_bounds(k));
                facets.push(Facet::new(id, surface, k));
                parts.push(Part { surface: id, bounds, is_whole: count == 1 });
                boxes.push(OrientedBox::around(surface, k));
            }
        }
        let voxels = Voxels::of_parts(geometry, &parts, settings);
        let (mut starts, mut blocks) = (vec![0], Blocks::default());
        for v in 0..voxels.len() {
            for ids in voxels.surfaces_of(v).chunks(LANES) {
                blocks.push(ids.iter().map(|id| (id.0, parts[id.index()].bounds, boxes[id.index()])));
            }
            starts.push(blocks.count() as u32);
        }
        let bounds = voxels.scene_bounds();
        VoxelTracer {
            surfaces: geometry.surfaces.clone(),
            facets,
            starts,
            blocks,
            reach: bounds.min.abs().max(bounds.max.abs()).length(),
            voxels,
        }
    }

    /// Settings for so many surfaces, or parts of them.
    fn settings(parts: usize) -> VoxelSettings {
        let level = 3 + parts.max(1).ilog2() as u8;
        VoxelSettings { max_objects: LANES, max_level: level.min(MAX_LEVEL) }
    }

    /// Where `ray`, whose frame this is, meets a facet first.
    #[inline(always)]
    fn meet(&self, facet: &Facet, ray: &Ray, frame: &RayFrame) -> Option<f64> {
        if facet.is_round {
            return self.surfaces[facet.surface.index()].round()?.intersect_part(facet.part as usize, ray);
        }
        facet.intersect(ray, frame)
    }

    /// The voxels it steps through.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }

    /// A search along `ray`; `None` where that meets no voxel.
    #[inline(always)]
    fn search<const ANY: bool>(&self, ray: &Ray) -> Option<Search<'_, ANY>> {
        let mut walk = Walk::new(&self.voxels, ray)?;
        let frame = RayFrame::new(ray);
        // The line's largest component has speed 1.
        let speed = ray.direction.abs().max_element();
        let line = Line::new(frame.inverse_speed() * ray.direction, ray.origin, self.reach);
        let step = walk.next()?;
        self.fetch(step.voxel);
        Some(Search { ray: *ray, frame, line, speed, walk, step, found: NOTHING })
    }

    /// What a search along `ray` finds.
    #[inline(always)]
    fn find<const ANY: bool>(&self, ray: &Ray) -> Found {
        let Some(mut search) = self.search::<ANY>(ray) else { return NOTHING };
        while search.goes_on(self) {}
        search.found
    }

    /// What searches along `count` rays find: `ray` gives the ray of a number, `found` hears of it. Where voxels are more than
    /// the caches hold some go on in turn, so that what one waits for comes from memory while others go on.
    #[inline(always)]
    fn find_many<const ANY: bool>(
        &self,
        count: usize,
        ray: impl Fn(usize) -> Ray,
        mut found: impl FnMut(usize, &Ray, Found),
    ) {
        if self.blocks.count() < MANY {
            for k in 0..count {
                let ray = ray(k);
                found(k, &ray, self.find::<ANY>(&ray));
            }
            return;
        }
        let mut abreast: Vec<(usize, Search<ANY>)> = Vec::with_capacity(ABREAST);
        let (mut next, mut turn) = (0, 0);
        while next < count || !abreast.is_empty() {
            if abreast.len() < ABREAST && next < count {
                let ray = ray(next);
                match self.search(&ray) {
                    Some(search) => abreast.push((next, search)),
                    None => found(next, &ray, NOTHING),
                }
                next += 1;
                continue;
            }
            turn = if turn + 1 < abreast.len() { turn + 1 } else { 0 };
            let (nth, search) = &mut abreast[turn];
            if !search.goes_on(self) {
                found(*nth, &search.ray, search.found);
                abreast.swap_remove(turn);
            }
        }
    }

    /// Asks for the boxes of a voxel ahead of time.
    #[inline(always)]
    fn fetch(&self, voxel: usize) {
        let first = self.starts[voxel] as usize;
        if first < self.blocks.count() {
            self.blocks.fetch(first);
        }
    }

    /// What a ray hits first, given what a search for it found.
    #[inline(always)]
    fn hit(&self, ray: &Ray, (t, surface): Found) -> Option<Hit> {
        let surface_met = self.surfaces.get(surface.index())?;
        // Where parts of a surface meet, each finds the crossing to its own rounding. The whole is asked, as brute force asks
        // it, so that it does not matter which of them had a voxel in common with the ray.
        let t = match surface_met.round() {
            Some(round) if round.parts() > 1 => round.intersect(ray).unwrap_or(t),
            _ => t,
        };
        Some(Hit { surface, t, side: side_met(surface_met, ray, t) })
    }
}

/// So many searches go on in turn (measured: 16 do alike),
const ABREAST: usize = 8;

/// where there are no fewer blocks than this, 2 MB (measured between 6,000 and 24,000 surfaces).
const MANY: usize = 8192;

/// Where a ray meets which surface.
type Found = (f64, SurfaceId);

/// Nowhere.
const NOTHING: Found = (f64::INFINITY, SurfaceId(u32::MAX));

/// A search for what a ray meets first, or for `ANY` surface that it meets, voxel by voxel.
struct Search<'a, const ANY: bool> {
    ray: Ray,
    frame: RayFrame,
    line: Line,
    /// Of the ray along the line.
    speed: f64,
    walk: Walk<'a>,
    /// The voxel to be looked at.
    step: Step,
    found: Found,
}

impl<const ANY: bool> Search<'_, ANY> {
    /// Looks at a voxel. Whether there is more to look at.
    #[inline(always)]
    fn goes_on(&mut self, tracer: &VoxelTracer) -> bool {
        let Step { voxel, t_enter, t_exit } = self.step;
        let t_end = t_exit.min(self.walk.limits().1);
        let stretch =
            Stretch::new(self.ray.at(0.5 * (t_enter + t_end)), 0.5 * (t_end - t_enter) * self.speed);
        for block in tracer.starts[voxel] as usize..tracer.starts[voxel + 1] as usize {
            let (mut candidates, ids) = tracer.blocks.candidates(block, &self.line, &stretch);
            while candidates != 0 {
                let id = ids[candidates.trailing_zeros() as usize / 8];
                candidates &= candidates - 1;
                let facet = &tracer.facets[id as usize];
                let Some(t) = tracer.meet(facet, &self.ray, &self.frame) else { continue };
                // Of surfaces met at once the first counts, in whatever order they are tried.
                if t < self.found.0 || t == self.found.0 && facet.surface < self.found.1 {
                    self.found = (t, facet.surface);
                }
                if ANY {
                    return false;
                }
            }
        }
        // A hit beyond this voxel may have a nearer one before it in the voxels between.
        if self.found.0 <= t_exit {
            return false;
        }
        let Some(step) = self.walk.next() else { return false };
        self.step = step;
        tracer.fetch(step.voxel);
        true
    }
}

/// [`RayTracer::closest`] compiled for wide registers, and so on.
struct Nearest<'a>(&'a VoxelTracer, &'a Ray);

impl HotLoop for Nearest<'_> {
    type Output = Option<Hit>;

    #[inline(always)]
    fn run(self) -> Option<Hit> {
        self.0.hit(self.1, self.0.find::<false>(self.1))
    }
}

struct NearestOfMany<'a>(&'a VoxelTracer, &'a [Ray], &'a mut [Option<Hit>]);

impl HotLoop for NearestOfMany<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let NearestOfMany(tracer, rays, hits) = self;
        let count = rays.len().min(hits.len());
        tracer.find_many::<false>(count, |k| rays[k], |k, ray, found| hits[k] = tracer.hit(ray, found));
    }
}

struct Any<'a>(&'a VoxelTracer, &'a Segment);

impl HotLoop for Any<'_> {
    type Output = Option<SurfaceId>;

    #[inline(always)]
    fn run(self) -> Option<SurfaceId> {
        let (t, surface) = self.0.find::<true>(&segment_ray(self.1));
        t.is_finite().then_some(surface)
    }
}

struct AnyOfMany<'a>(&'a VoxelTracer, &'a [Segment], &'a mut [bool]);

impl HotLoop for AnyOfMany<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let AnyOfMany(tracer, segments, blocked) = self;
        let count = segments.len().min(blocked.len());
        let ray = |k: usize| segment_ray(&segments[k]);
        tracer.find_many::<true>(count, ray, |k, _, found| blocked[k] = found.0.is_finite());
    }
}

impl RayTracer for VoxelTracer {
    fn name(&self) -> String {
        "voxel".into()
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        wide(Nearest(self, ray))
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        wide(NearestOfMany(self, rays, hits));
    }

    fn occluded_batch(&self, segments: &[Segment], blocked: &mut [bool]) {
        wide(AnyOfMany(self, segments, blocked));
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        wide(Any(self, segment))
    }
}

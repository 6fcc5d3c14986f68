//! The paper's ray tracer: voxels stepped through in the order of the ray (section 4.1).
//!
//! All in `f64`, and with the very edge functions of [`super::brute_force`]: it finds what brute
//! force finds, to the bit, only sooner.

use super::brute_force::{segment_ray, side_met};
use super::cull::{Blocks, LANES, Line, OrientedBox, Stretch};
use super::edges::{RayFrame, crossing, edge, is_in_box};
use super::{RayTracer, Segment};
use crate::geometry::{Hit, Ray, Round, Surface, SurfaceId};
use crate::scene::Geometry;
use crate::simd::{HotLoop, wide};
use crate::voxels::{MAX_LEVEL, Part, VoxelSettings, Voxels, Walk};
use glam::DVec3;
use std::cell::Cell;

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

/// A surface, or a part of one, made ready to be hit, no larger than the inner loop needs.
#[derive(Clone, Debug)]
struct Facet {
    surface: SurfaceId,
    part: u32,
    /// Corners as in [`Surface::triangles`], v0 v1 v3 and v2 v3 v1, coordinate by coordinate. A triangle v0 v1 v2 is
    /// stored as v0 v1 (v0) v2.
    corners: [[f64; 4]; 3],
    is_triangle: bool,
    /// No polygon: the surface itself is asked.
    is_round: bool,
}

impl Facet {
    fn new(id: SurfaceId, surface: &Surface, part: usize) -> Self {
        let (triangles, count) = surface.triangles();
        let [a, b, d] = triangles[0];
        let c = if count == 2 { triangles[1][0] } else { a };
        Facet {
            surface: id,
            part: part as u32,
            corners: [0, 1, 2].map(|k| [a[k], b[k], c[k], d[k]]),
            is_triangle: count == 1,
            is_round: count == 0,
        }
    }

    /// [`super::brute_force::intersect_surface`], what the two triangles share computed once: the
    /// same bits.
    #[inline(always)]
    fn intersect(&self, ray: &Ray, frame: &RayFrame) -> Option<f64> {
        let [x, y, z] = frame.project_four(&self.corners);
        let at = |v: usize| DVec3::new(x[v], y[v], z[v]);
        let [a, b, c, d] = [at(0), at(1), at(2), at(3)];
        let diagonal = edge(d, b);
        let counts = |t: f64, corners: [usize; 3]| {
            let corner = |v: usize| DVec3::new(self.corners[0][v], self.corners[1][v], self.corners[2][v]);
            t > ray.t_min && t < ray.t_max && is_in_box(ray, t, corners.map(corner))
        };
        let first = crossing([diagonal, edge(a, d), edge(b, a)], [a.z, b.z, d.z]);
        let first = first.filter(|&t| counts(t, [0, 1, 3]));
        if self.is_triangle {
            return first;
        }
        let second = crossing([-diagonal, edge(c, b), edge(d, c)], [c.z, d.z, b.z]);
        let second = second.filter(|&t| counts(t, [2, 3, 1]));
        match (first, second) {
            (Some(s), Some(t)) => Some(s.min(t)),
            (s, t) => s.or(t),
        }
    }
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

    /// Calls `meet` with what the ray meets, voxel by voxel and in no order within a voxel, until it says that
    /// no more is wanted: it is also told where the voxel ends. A surface may come several times.
    #[inline(always)]
    fn walk(
        &self,
        ray: &Ray,
        mut meet: impl FnMut(f64, SurfaceId) -> bool,
        mut goes_on: impl FnMut(f64) -> bool,
    ) {
        let Some(walk) = Walk::new(&self.voxels, ray) else { return };
        let (_, end) = walk.limits();
        let frame = RayFrame::new(ray);
        // The line's largest component has speed 1.
        let speed = ray.direction.abs().max_element();
        let line = Line::new(frame.inverse_speed() * ray.direction, ray.origin, self.reach);
        for step in walk {
            let (t0, t1) = (step.t_enter, step.t_exit.min(end));
            let stretch = Stretch::new(ray.at(0.5 * (t0 + t1)), 0.5 * (t1 - t0) * speed);
            for block in self.starts[step.voxel] as usize..self.starts[step.voxel + 1] as usize {
                let (mut candidates, ids) = self.blocks.candidates(block, &line, &stretch);
                while candidates != 0 {
                    let id = ids[candidates.trailing_zeros() as usize / 8];
                    candidates &= candidates - 1;
                    let facet = &self.facets[id as usize];
                    if let Some(t) = self.meet(facet, ray, &frame)
                        && !meet(t, facet.surface)
                    {
                        return;
                    }
                }
            }
            if !goes_on(step.t_exit) {
                return;
            }
        }
    }

    #[inline(always)]
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let best = Cell::new((f64::INFINITY, SurfaceId(u32::MAX)));
        let meet = |t: f64, id: SurfaceId| {
            let (s, other) = best.get();
            // Of surfaces met at once the first counts, in whatever order they are tried.
            if t < s || t == s && id < other {
                best.set((t, id));
            }
            true
        };
        // A hit beyond this voxel may have a nearer one before it in the voxels between.
        self.walk(ray, meet, |t_exit| best.get().0 > t_exit);
        let (t, surface) = best.get();
        let surface_met = self.surfaces.get(surface.index())?;
        // Where parts of a surface meet, each finds the crossing to its own rounding. The whole is asked, as brute force asks
        // it, so that it does not matter which of them had a voxel in common with the ray.
        let t = match surface_met.round() {
            Some(round) if round.parts() > 1 => round.intersect(ray).unwrap_or(t),
            _ => t,
        };
        Some(Hit { surface, t, side: side_met(surface_met, ray, t) })
    }

    #[inline(always)]
    fn any(&self, segment: &Segment) -> Option<SurfaceId> {
        let mut blocker = None;
        let meet = |_, id| {
            blocker = Some(id);
            false
        };
        self.walk(&segment_ray(segment), meet, |_| true);
        blocker
    }
}

/// [`RayTracer::closest`] compiled for wide registers, and so on.
struct Nearest<'a>(&'a VoxelTracer, &'a Ray);

impl HotLoop for Nearest<'_> {
    type Output = Option<Hit>;

    #[inline(always)]
    fn run(self) -> Option<Hit> {
        self.0.nearest(self.1)
    }
}

struct NearestOfMany<'a>(&'a VoxelTracer, &'a [Ray], &'a mut [Option<Hit>]);

impl HotLoop for NearestOfMany<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (ray, hit) in self.1.iter().zip(self.2) {
            *hit = self.0.nearest(ray);
        }
    }
}

struct Any<'a>(&'a VoxelTracer, &'a Segment);

impl HotLoop for Any<'_> {
    type Output = Option<SurfaceId>;

    #[inline(always)]
    fn run(self) -> Option<SurfaceId> {
        self.0.any(self.1)
    }
}

struct AnyOfMany<'a>(&'a VoxelTracer, &'a [Segment], &'a mut [bool]);

impl HotLoop for AnyOfMany<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (segment, blocked) in self.1.iter().zip(self.2) {
            *blocked = self.0.any(segment).is_some();
        }
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

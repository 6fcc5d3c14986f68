//! The paper's ray tracer: voxels stepped through in the order of the ray (section 4.1).
//!
//! All in `f64`, and with the very edge functions of [`super::brute_force`]: it finds what brute
//! force finds, to the bit, only sooner.

use super::brute_force::{segment_ray, side_met};
use super::edges::{RayFrame, crossing, edge, is_in_box};
use super::{RayTracer, Segment};
use crate::geometry::{Hit, Plane, Ray, Surface, SurfaceId};
use crate::scene::Geometry;
use crate::voxels::{MAX_LEVEL, VoxelSettings, Voxels, Walk};
use glam::DVec3;

/// Casts rays through voxels of its own, finer than those of the visibility graph.
#[derive(Clone, Debug)]
pub struct VoxelTracer {
    voxels: Voxels,
    surfaces: Vec<Surface>,
    facets: Vec<Facet>,
}

/// A surface made ready to be hit, no larger than the inner loop needs.
#[derive(Clone, Debug)]
struct Facet {
    /// The mean plane, as in [`Surface`].
    normal: DVec3,
    offset: f64,
    /// All of the surface lies this close to its mean plane, rounding included, m.
    slack: f64,
    /// Corners as in [`Surface::triangles`]: v0 v1 v3 and v2 v3 v1. A triangle v0 v1 v2 is
    /// stored as v0 v1 (v0) v2.
    corners: [DVec3; 4],
    is_triangle: bool,
    /// No polygon: the surface itself is asked.
    is_round: bool,
}

/// Surfaces already tried by one ray: a surface often meets several voxels on the way. Places are
/// shared, and what falls out is merely tried again.
struct Mailbox([u32; Mailbox::PLACES]);

impl Mailbox {
    const PLACES: usize = 64;

    fn new() -> Self {
        Mailbox([u32::MAX; Mailbox::PLACES])
    }

    /// Whether `id` is new.
    #[inline]
    fn post(&mut self, id: SurfaceId) -> bool {
        let place = &mut self.0[id.index() % Mailbox::PLACES];
        let new = *place != id.0;
        *place = id.0;
        new
    }
}

impl Facet {
    fn new(surface: &Surface, radius: f64) -> Self {
        let (triangles, count) = surface.triangles();
        let [a, b, d] = triangles[0];
        let c = if count == 2 { triangles[1][0] } else { a };
        // Nothing keeps to one side of a plane without normal.
        let plane = surface.plane().unwrap_or(Plane { normal: DVec3::ZERO, offset: 0.0 });
        Facet {
            normal: plane.normal,
            offset: plane.offset,
            slack: surface.warp() + 1e-9 * radius,
            corners: [a, b, c, d],
            is_triangle: count == 1,
            is_round: count == 0,
        }
    }

    /// Whether the part of the ray between the parameters keeps to one side of the surface.
    #[inline]
    fn keeps_off(&self, ray: &Ray, (t0, t1): (f64, f64)) -> bool {
        let start = self.normal.dot(ray.origin) - self.offset;
        let slope = self.normal.dot(ray.direction);
        let (a, b) = (start + t0 * slope, start + t1 * slope);
        a.min(b) > self.slack || a.max(b) < -self.slack
    }

    /// [`super::brute_force::intersect_surface`], what the two triangles share computed once: the
    /// same bits.
    #[inline]
    fn intersect(&self, ray: &Ray, frame: &RayFrame) -> Option<f64> {
        let [a, b, c, d] = self.corners.map(|v| frame.project(v));
        let [v0, v1, v2, v3] = self.corners;
        let diagonal = edge(d, b);
        let counts = |t: f64, corners| t > ray.t_min && t < ray.t_max && is_in_box(ray, t, corners);
        let first = crossing([diagonal, edge(a, d), edge(b, a)], [a.z, b.z, d.z]);
        let first = first.filter(|&t| counts(t, [v0, v1, v3]));
        if self.is_triangle {
            return first;
        }
        let second = crossing([-diagonal, edge(c, b), edge(d, c)], [c.z, d.z, b.z]);
        let second = second.filter(|&t| counts(t, [v2, v3, v1]));
        match (first, second) {
            (Some(s), Some(t)) => Some(s.min(t)),
            (s, t) => s.or(t),
        }
    }
}

impl VoxelTracer {
    /// A tracer over `geometry`, its voxels as fine as measurement showed best.
    pub fn new(geometry: &Geometry) -> Self {
        Self::with_settings(geometry, &Self::settings(geometry.surfaces.len()))
    }

    /// A tracer with voxels of a given fineness.
    pub fn with_settings(geometry: &Geometry, settings: &VoxelSettings) -> Self {
        VoxelTracer {
            voxels: Voxels::build(geometry, settings),
            surfaces: geometry.surfaces.clone(),
            facets: geometry.surfaces.iter().map(|s| Facet::new(s, geometry.radius)).collect(),
        }
    }

    /// Settings for `surfaces` surfaces.
    fn settings(surfaces: usize) -> VoxelSettings {
        let level = 5 + surfaces.max(1).ilog2() as u8;
        VoxelSettings { max_objects: 3, max_level: level.min(MAX_LEVEL) }
    }

    /// Where `ray`, whose frame this is, meets surface `id` first.
    #[inline]
    fn meet(&self, id: SurfaceId, ray: &Ray, frame: &RayFrame) -> Option<f64> {
        let facet = &self.facets[id.index()];
        if facet.is_round {
            return self.surfaces[id.index()].round()?.intersect(ray);
        }
        facet.intersect(ray, frame)
    }

    /// The voxels it steps through.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }
}

impl RayTracer for VoxelTracer {
    fn name(&self) -> String {
        "voxel".into()
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let walk = Walk::new(&self.voxels, ray)?;
        let (limits, frame) = (walk.limits(), RayFrame::new(ray));
        let mut mailbox = Mailbox::new();
        let mut best: Option<(f64, SurfaceId)> = None;
        for step in walk {
            for &id in self.voxels.surfaces_of(step.voxel) {
                let facet = &self.facets[id.index()];
                if !mailbox.post(id) || facet.keeps_off(ray, limits) {
                    continue;
                }
                if let Some(t) = self.meet(id, ray, &frame) {
                    // Of surfaces met at once the first counts, in whatever order they are tried.
                    if best.is_none_or(|(s, other)| t < s || t == s && id < other) {
                        best = Some((t, id));
                    }
                }
            }
            // A hit beyond this voxel may have a nearer one before it in the voxels between.
            if best.is_some_and(|(t, _)| t <= step.t_exit) {
                break;
            }
        }
        best.map(|(t, surface)| {
            let side = side_met(&self.surfaces[surface.index()], ray, t);
            Hit { surface, t, side }
        })
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        let ray = segment_ray(segment);
        let walk = Walk::new(&self.voxels, &ray)?;
        let (limits, frame) = (walk.limits(), RayFrame::new(&ray));
        let mut mailbox = Mailbox::new();
        for step in walk {
            for &id in self.voxels.surfaces_of(step.voxel) {
                let facet = &self.facets[id.index()];
                if mailbox.post(id) && !facet.keeps_off(&ray, limits) && self.meet(id, &ray, &frame).is_some()
                {
                    return Some(id);
                }
            }
        }
        None
    }
}

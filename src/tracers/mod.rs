//! Ray tracing: one small seam, several implementations.
//!
//! All tracers see the same surfaces (vertices on the `f32` lattice, quads as Embree splits them, the others as they
//! are) and must agree but for rays that graze within rounding: [`judge`] says which those are.

pub mod brute_force;
mod choose;
pub mod crosscheck;
mod cull;
pub mod edges;
pub mod embree;
mod facet;
pub mod judge;
mod judge_cone;
mod judge_patch;
mod judge_round;
pub mod voxel;

pub use choose::{TracerChoice, choose};
pub use embree::EmbreeTracer;
pub use voxel::VoxelTracer;

use crate::geometry::{Hit, Ray, SurfaceId};
use glam::Vec3;

/// What the rest of the program asks of a ray tracer. Batches may be called from many threads.
pub trait RayTracer: Sync {
    /// Short name for reports: "embree 3.13.5", "voxel".
    fn name(&self) -> String;

    /// The closest hit within the ray's limits. A ray of which origin or direction is not finite, or a limit
    /// is NaN, hits nothing; limits may be infinite.
    fn closest(&self, ray: &Ray) -> Option<Hit>;

    /// [`RayTracer::closest`] for each ray; `hits` is as long as `rays`.
    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest(ray);
        }
    }

    /// Whether something blocks each segment; `blocked` is as long as `segments`.
    fn occluded_batch(&self, segments: &[Segment], blocked: &mut [bool]) {
        for (segment, blocked) in segments.iter().zip(blocked) {
            *blocked = self.blocker(segment).is_some();
        }
    }

    /// Some surface that blocks the segment, or `None`: the paper's buf-int.
    fn blocker(&self, segment: &Segment) -> Option<SurfaceId>;
}

/// The open segment between two sample points, shortened at both ends by the fraction
/// [`Segment::margin`] so that the surfaces it starts and ends on do not block it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// A, relative to the scene's centre, m.
    pub from: Vec3,
    /// B.
    pub to: Vec3,
}

impl Segment {
    /// The fraction of the length left out at either end: 32 units in the last place of the
    /// largest coordinate, seen against the length, and never under 1e-6 nor over 1e-2.
    #[inline]
    pub fn margin(&self) -> f32 {
        let largest = self.from.abs().max(self.to.abs()).max_element();
        let length = (self.to - self.from).length();
        let fraction = 32.0 * f32::EPSILON * largest / length;
        // A segment of no length at the origin has no fraction at all.
        if fraction.is_nan() { 1e-2 } else { fraction.clamp(1e-6, 1e-2) }
    }
}

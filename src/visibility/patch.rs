//! Patches: runs of sample points of one side of one surface in one voxel.

use crate::geometry::{Plane, SurfaceId};
use crate::points::SamplePoints;
use crate::points::facing::SidePlane;
use crate::scene::Geometry;
use glam::{DVec2, DVec3};
use std::ops::Range;

/// Longer runs are cut: a tile of two patches stays in the cache, and what is compact is proved
/// more often. A run follows the surface's quadtree, so a power of 4 cuts along its cells.
const MAX_PATCH: usize = 64;

/// A run of points of one side of one surface in one voxel.
#[derive(Clone, Debug)]
pub(super) struct Patch {
    /// Its points.
    pub points: Range<usize>,
    /// The surface they lie on.
    pub surface: SurfaceId,
    /// The plane of the side they lie on.
    pub plane: SidePlane,
    /// Whether there is no such plane.
    pub curved: bool,
    /// A point of the plane and two unit directions in it, the first along the first edge.
    frame: [DVec3; 3],
}

impl Patch {
    /// The patches of all voxels in the order of the points.
    pub fn all(geometry: &Geometry, points: &SamplePoints) -> Vec<Patch> {
        let mut patches = Vec::new();
        for v in 0..points.voxels() {
            let voxel = points.voxel(v);
            let mut first = voxel.start;
            for i in voxel.clone() {
                let same = |j: usize| {
                    points.surface[j] == points.surface[first] && points.side[j] == points.side[first]
                };
                let next = i + 1;
                if next == voxel.end || !same(next) || next - first == MAX_PATCH {
                    patches.push(Patch::new(geometry, points, first..next));
                    first = next;
                }
            }
        }
        patches
    }

    fn new(geometry: &Geometry, points: &SamplePoints, run: Range<usize>) -> Patch {
        let (id, side) = (points.surface[run.start], points.side[run.start]);
        let surface = geometry.surface(id);
        let Some(Plane { normal, offset }) = surface.plane() else {
            // Nothing is in front of a plane without normal.
            let plane = SidePlane { normal: DVec3::ZERO, offset: 0.0 };
            return Patch { points: run, surface: id, plane, curved: true, frame: [DVec3::ZERO; 3] };
        };
        let along = if let &[a, b, ..] = surface.vertices() { b - a } else { DVec3::ZERO };
        let u = (along - along.dot(normal) * normal)
            .try_normalize()
            .unwrap_or_else(|| normal.any_orthonormal_vector());
        let frame = [normal * offset, u, normal.cross(u)];
        let plane = SidePlane::new(geometry, id, side).unwrap_or(SidePlane { normal, offset });
        Patch { points: run, surface: id, plane, curved: false, frame }
    }

    /// The part of the patch in `range`.
    pub fn within(&self, range: &Range<usize>) -> Patch {
        let points = self.points.start.max(range.start)..self.points.end.min(range.end);
        Patch { points, ..self.clone() }
    }

    /// The corners of the smallest rectangle along the first edge that holds `positions`, which
    /// lie on this patch's plane, in turn.
    pub fn rectangle(&self, positions: &[DVec3]) -> [DVec3; 4] {
        let [origin, u, v] = self.frame;
        let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for &p in positions {
            let uv = DVec2::new(u.dot(p - origin), v.dot(p - origin));
            (lo, hi) = (lo.min(uv), hi.max(uv));
        }
        let at = |x: f64, y: f64| origin + x * u + y * v;
        [at(lo.x, lo.y), at(hi.x, lo.y), at(hi.x, hi.y), at(lo.x, hi.y)]
    }
}

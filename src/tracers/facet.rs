//! Surfaces, and parts of them, as the voxel tracer keeps them.

use super::edges::{RayFrame, crossing, edge, is_in_box};
use crate::geometry::{Ray, Surface, SurfaceId};
use glam::DVec3;

/// A surface, or a part of one, made ready to be hit, no larger than the inner loop needs.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    /// The surface,
    pub surface: SurfaceId,
    /// and which part of it, 0 where it has no other.
    pub part: u32,
    /// Corners as in [`Surface::triangles`], v0 v1 v3 and v2 v3 v1, coordinate by coordinate. A triangle v0 v1 v2 is
    /// stored as v0 v1 (v0) v2.
    corners: [[f64; 4]; 3],
    is_triangle: bool,
    /// No polygon: the surface itself is asked.
    pub is_round: bool,
}

impl Facet {
    /// Part number `part` of `surface`, whose number is `id`.
    pub fn new(id: SurfaceId, surface: &Surface, part: usize) -> Self {
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

    /// Where `ray`, whose frame this is, meets it first within its limits, as the ray's parameter:
    /// [`intersect_surface`](super::brute_force::intersect_surface), what the two triangles share computed once: the same bits.
    #[inline(always)]
    pub fn intersect(&self, ray: &Ray, frame: &RayFrame) -> Option<f64> {
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

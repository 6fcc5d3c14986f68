//! Points that another surface lies flat upon: a rug drawn into the plane of the floor, two panes in one place.
//!
//! Nothing closer than [`Bands::apart`](super::blocker::Bands) blocks a point, so without this the floor under such a
//! rug would see the room as the rug does, and both would send its light back. Of two surfaces this close
//! the one in front is seen; of two that coincide and look the same way, the first in the scene's order, as in
//! the ray tracers. Surfaces back to back, such as the two faces of a sheet, do not cover each other.

use super::build::Build;
use crate::geometry::{Side, Surface};
use glam::DVec3;
use rayon::prelude::*;

/// The cosine between the normals of surfaces that lie flat upon each other is this near to 1.
const PARALLEL: f64 = 1e-6;

/// Coincident planes differ by some units in the last place (`f32`) of the coordinates; as a share of the
/// radius.
const COINCIDENT: f64 = 5e-7;

/// For each point whether something lies flat upon it.
pub(super) fn lies_under(build: &Build, surfaces: &[Surface], two_sided: &[bool], radius: f64) -> Vec<bool> {
    let points = build.points;
    let in_voxel = |v: usize| {
        let mut near = Vec::new();
        if !points.voxel(v).is_empty() {
            build.tree.touching(&build.blockers, &build.boxes[v], build.bands.apart, &mut near);
        }
        let under = |i: usize| {
            let (own, side) = (points.surface[i], points.side[i]);
            let p = points.position[i].as_dvec3();
            near.iter().any(|&other| {
                let (below, above) = (&surfaces[own.index()], &surfaces[other as usize]);
                let (Some(own_plane), Some(its_plane)) = (below.plane(), above.plane()) else { return false };
                let cosine = own_plane.normal.dot(its_plane.normal);
                if other == own.0
                    || cosine.abs() < 1.0 - PARALLEL
                    || above.distance(p).abs() > build.bands.apart
                    || !holds(above, p)
                {
                    return false;
                }
                let up = if side == Side::Front { 1.0 } else { -1.0 };
                let height = up * height(below, above, cosine.signum());
                let looks_alike = two_sided[other as usize] || up * cosine > 0.0;
                if looks_alike {
                    height > 0.0 || height == 0.0 && other < own.0
                } else {
                    height > COINCIDENT * radius
                }
            })
        };
        points.voxel(v).map(under).collect::<Vec<bool>>()
    };
    (0..points.voxels()).into_par_iter().flat_map_iter(in_voxel).collect()
}

/// How far `above` lies in front of `below`, twice over, m; exactly the opposite seen from the other.
fn height(below: &Surface, above: &Surface, sign: f64) -> f64 {
    let mean = |of: &Surface, from: &Surface| {
        let v = of.vertices();
        if v.is_empty() {
            return from.distance(of.middle());
        }
        v.iter().map(|&p| from.distance(p)).sum::<f64>() / v.len() as f64
    };
    mean(above, below) - sign * mean(below, above)
}

/// Whether the foot of the perpendicular from `p` lies on the surface.
fn holds(surface: &Surface, p: DVec3) -> bool {
    if let Some(round) = surface.round() {
        return surface.is_planar() && p.distance(round.centre()) <= round.radius();
    }
    let (triangles, count) = surface.triangles();
    let normal = surface.normal_at(p);
    triangles[..count].iter().any(|t| {
        (0..3).all(|k| {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            (b - a).cross(p - a).dot(normal) >= 0.0
        })
    })
}

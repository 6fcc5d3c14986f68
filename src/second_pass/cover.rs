//! Sample points that something covers, and what stands in for them.
//!
//! A point behind a picture that hangs 2 cm before the wall, or under a box that stands on the floor,
//! is dark, and rightly so; but between points radiance is interpolated over the width of an element,
//! and the dark would smear over the wall beside the picture. Such points are found from
//! the geometry alone, once, and the elements around them speak for them. A shadow that light
//! could reach, be it under a table or beside a leg, is no such case and stays.

use super::lattice::Lattice;
use super::wave::ray_offset;
use crate::geometry::{Hit, Ray, Side, SurfaceId};
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use glam::DVec3;
use rayon::prelude::*;

/// Directions tried from every point; equal shares of its irradiance.
const DIRECTIONS: usize = 32;

/// A point is covered when so many of them are closed.
const CLOSED: usize = DIRECTIONS * 3 / 4;

/// A surface closer than this share of the element's width closes a direction whatever it is: what
/// light gets in between changes over less than the elements can tell.
const CLOSE: f64 = 0.25;

/// Points that may still prove covered when what they see does.
struct Doubtful {
    point: usize,
    closed: usize,
    /// The elements that its open directions meet.
    meets: Vec<u32>,
}

/// Which points are covered. `element_at` finds the element at a place of a surface's side.
///
/// A direction is closed that meets a back without points (the inside of a body), anything much closer
/// than the element is wide, or a covered element. The last makes a closed body without floor or rear
/// dark as a whole, though from its floor one sees the wall behind.
pub(super) fn covered(
    geometry: &Geometry,
    points: &SamplePoints,
    tracer: &dyn RayTracer,
    element_at: impl Fn(SurfaceId, Side, DVec3) -> Option<u32> + Sync,
) -> Vec<bool> {
    let look = |point: usize| {
        let rays = rays(geometry, points, point);
        let mut hits: [Option<Hit>; DIRECTIONS] = [None; DIRECTIONS];
        tracer.closest_batch(&rays, &mut hits);
        let close = CLOSE * f64::from(points.area[point]).sqrt();
        let mut found = Doubtful { point, closed: 0, meets: Vec::new() };
        for (ray, hit) in rays.iter().zip(hits) {
            let Some(hit) = hit else { continue };
            let black = hit.side == Side::Back && !geometry.two_sided[hit.surface.index()];
            if black || hit.t < close {
                found.closed += 1;
            } else {
                found.meets.extend(element_at(hit.surface, hit.side, ray.at(hit.t)));
            }
        }
        (found.closed >= DIRECTIONS / 4).then_some(found)
    };
    let mut doubtful: Vec<Doubtful> = (0..points.len()).into_par_iter().filter_map(look).collect();
    let mut covered = vec![false; points.len()];
    loop {
        let before = doubtful.len();
        doubtful.retain(|d| {
            let behind = d.meets.iter().filter(|&&e| covered[e as usize]).count();
            covered[d.point] = d.closed + behind >= CLOSED;
            !covered[d.point]
        });
        if doubtful.len() == before {
            return covered;
        }
    }
}

/// Rays from just above a point into its hemisphere, density cos θ / π.
fn rays(geometry: &Geometry, points: &SamplePoints, point: usize) -> [Ray; DIRECTIONS] {
    let surface = geometry.surface(points.surface[point]);
    let uv = points.cell[point].centre_uv(&surface.shape);
    let centre = surface.point_at(uv.x, uv.y);
    let normal = surface.normal_at(centre);
    let n = if points.side[point] == Side::Front { normal } else { -normal };
    let (x, y) = n.any_orthonormal_pair();
    let origin = centre + ray_offset(geometry, points.surface[point]) * n;
    std::array::from_fn(|k| {
        // A spiral of equal shares that turns by the golden angle.
        let sin2 = (k as f64 + 0.5) / DIRECTIONS as f64;
        let (sin_phi, cos_phi) = (k as f64 * 2.399_963_229_728_653).sin_cos();
        let direction = sin2.sqrt() * (cos_phi * x + sin_phi * y) + (1.0 - sin2).sqrt() * n;
        Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY }
    })
}

/// Weights on other elements that stand in for a covered one.
pub(super) struct StandIn {
    /// The covered element.
    pub element: u32,
    /// (element, weight), sum 1: uncovered, or stood in for earlier in the list.
    pub from: Vec<(u32, f64)>,
}

/// Stand-ins in the order in which they must be worked out, ring by ring from the uncovered elements
/// inwards. A covered element that no ring reaches is left as it is.
pub(super) fn stand_ins(lattice: &Lattice, centre: &[DVec3], covered: &[bool]) -> Vec<StandIn> {
    let mut known: Vec<bool> = covered.iter().map(|c| !c).collect();
    let mut left: Vec<u32> = (0..covered.len() as u32).filter(|&e| covered[e as usize]).collect();
    let mut found = Vec::new();
    loop {
        let ring = found.len();
        left.retain(|&element| {
            let at = centre[element as usize];
            let mut around = lattice.around(element as usize);
            around.retain(|&e| known[e as usize]);
            // Near elements know more than far ones.
            let trust = |e: u32| 1.0 / centre[e as usize].distance_squared(at).max(f64::MIN_POSITIVE);
            let total: f64 = around.iter().map(|&e| trust(e)).sum();
            let from: Vec<_> = around.into_iter().map(|e| (e, trust(e) / total)).collect();
            let alone = from.is_empty();
            if !alone {
                found.push(StandIn { element, from });
            }
            alone
        });
        if found.len() == ring {
            return found;
        }
        for stand_in in &found[ring..] {
            known[stand_in.element as usize] = true;
        }
    }
}

//! Every surface against every ray in `f64`: slow, simple, the baseline of the others' tests.

use super::edges::{RayFrame, crossing, edge, is_in_box};
use super::{RayTracer, Segment};
use crate::geometry::{Hit, Ray, Side, Surface, SurfaceId};
use crate::scene::Geometry;
use glam::DVec3;

/// Tests all surfaces in turn.
pub struct BruteForce<'a> {
    surfaces: &'a [Surface],
}

impl<'a> BruteForce<'a> {
    /// A tracer over `geometry`.
    pub fn new(geometry: &'a Geometry) -> Self {
        BruteForce::over(&geometry.surfaces)
    }

    /// A tracer over `surfaces`, numbered from 0.
    pub(super) fn over(surfaces: &'a [Surface]) -> Self {
        BruteForce { surfaces }
    }
}

/// The ray parameter at which `ray` crosses the triangle, edges included: see [`super::edges`].
pub fn intersect_triangle(ray: &Ray, triangle: &[DVec3; 3]) -> Option<f64> {
    cross_triangle(ray, &RayFrame::new(ray), triangle)
}

fn cross_triangle(ray: &Ray, frame: &RayFrame, triangle: &[DVec3; 3]) -> Option<f64> {
    let [a, b, c] = triangle.map(|v| frame.project(v));
    let t = crossing([edge(c, b), edge(a, c), edge(b, a)], [a.z, b.z, c.z])?;
    (t > ray.t_min && t < ray.t_max && is_in_box(ray, t, *triangle)).then_some(t)
}

/// The nearest crossing of a surface within the ray's limits.
pub fn intersect_surface(ray: &Ray, surface: &Surface) -> Option<f64> {
    cross_surface(ray, &RayFrame::new(ray), surface)
}

fn cross_surface(ray: &Ray, frame: &RayFrame, surface: &Surface) -> Option<f64> {
    if let Some(round) = surface.round() {
        return round.intersect(ray);
    }
    let (triangles, count) = surface.triangles();
    triangles[..count].iter().filter_map(|t| cross_triangle(ray, frame, t)).min_by(f64::total_cmp)
}

/// The side of `surface` that `ray` meets at `t`.
pub fn side_met(surface: &Surface, ray: &Ray, t: f64) -> Side {
    let against = match surface.plane() {
        Some(plane) => plane.normal.dot(ray.direction),
        None => surface.normal_at(ray.at(t)).dot(ray.direction),
    };
    if against <= 0.0 { Side::Front } else { Side::Back }
}

/// The ray along a segment, with the segment's margins as limits.
pub fn segment_ray(segment: &Segment) -> Ray {
    let origin = segment.from.as_dvec3();
    let margin = f64::from(segment.margin());
    Ray { origin, direction: segment.to.as_dvec3() - origin, t_min: margin, t_max: 1.0 - margin }
}

impl RayTracer for BruteForce<'_> {
    fn name(&self) -> String {
        "brute force".into()
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let mut limited = *ray;
        let frame = RayFrame::new(ray);
        let mut best = None;
        for (i, surface) in self.surfaces.iter().enumerate() {
            if let Some(t) = cross_surface(&limited, &frame, surface) {
                limited.t_max = t;
                let side = side_met(surface, ray, t);
                best = Some(Hit { surface: SurfaceId(i as u32), t, side });
            }
        }
        best
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        let ray = segment_ray(segment);
        let frame = RayFrame::new(&ray);
        let blocks = |s: &Surface| cross_surface(&ray, &frame, s).is_some();
        self.surfaces.iter().position(blocks).map(|i| SurfaceId(i as u32))
    }
}

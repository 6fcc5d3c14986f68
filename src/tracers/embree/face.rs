//! What tells in `f64` where a ray meets a surface that Embree found.

use super::query::{Frame, LIMIT_ULPS, Span, length_bound};
use super::raw::lux_hit;
use crate::geometry::{Aabb, Hit, Ray, Round, Side, Surface, SurfaceId};
use crate::tracers::brute_force::side_met;
use glam::DVec3;

/// What confirming a hit needs to know of a surface.
pub struct Face {
    /// A corner and the normal, of any length, of the triangles v0 v1 v3 and v2 v3 v1.
    planes: [[DVec3; 2]; 2],
    /// Of the surface's (mean) plane, if it has one.
    normal: DVec3,
    /// The box around it, and a little more, m.
    bounds: Aabb,
    /// What is no polygon.
    round: Option<Surface>,
}

impl Face {
    /// For `surface` in a scene of `radius`, m.
    pub fn new(surface: &Surface, radius: f64) -> Self {
        let plane = |[a, b, c]: [DVec3; 3]| [a, (b - a).cross(c - a)];
        let (triangles, _) = surface.triangles();
        let slack = 2.0 * LIMIT_ULPS * f64::from(f32::EPSILON) * radius;
        let Aabb { min, max } = surface.bounds();
        Face {
            planes: triangles.map(plane),
            normal: surface.plane().map_or(DVec3::ZERO, |plane| plane.normal),
            bounds: Aabb { min: min - slack, max: max + slack },
            round: surface.round().map(|_| surface.clone()),
        }
    }

    /// The `f64` parameter of what Embree found, if it counts but for the far limit: not at or before the ray's start, and
    /// in the surface's box as far as `f32` can tell.
    #[inline(always)]
    pub fn confirm(&self, ray: &Ray, span: &Span, found: lux_hit, frame: &Frame) -> Option<f64> {
        let rough = span.parameter(found.t, frame);
        let exact = self.parameter(ray, found.part, rough, 1e-3 * frame.radius * span.shrink);
        let t = if (exact - rough).abs() <= 1e-3 * frame.radius * span.shrink { exact } else { rough };
        let at = ray.at(t);
        let slack = 8.0 * f64::EPSILON * length_bound(ray.origin);
        let Aabb { min, max } = self.bounds;
        let near = at.cmpge(min - slack) & at.cmple(max + slack);
        ((t > ray.t_min) & near.all()).then_some(t)
    }

    /// Where `ray` crosses the plane of the triangle met, or what is no polygon within `reach` of `rough`, by the same
    /// formula as the brute force tracer; not finite if it runs along it.
    #[inline(always)]
    fn parameter(&self, ray: &Ray, part: u32, rough: f64, reach: f64) -> f64 {
        match &self.round {
            Some(surface) => {
                let limits = Ray { t_min: ray.t_min.max(rough - reach), t_max: rough + reach, ..*ray };
                // Close to its border another part may be met instead.
                let met = |round: &Round| {
                    round.intersect_part(part as usize, &limits).or_else(|| round.intersect(&limits))
                };
                surface.round().and_then(met).unwrap_or(f64::NAN)
            }
            None => {
                let [a, normal] = self.planes[usize::from(part == 1)];
                normal.dot(a - ray.origin) / normal.dot(ray.direction)
            }
        }
    }

    /// The hit at parameter `t` of surface `id`.
    #[inline(always)]
    pub fn hit(&self, ray: &Ray, t: f64, id: u32) -> Option<Hit> {
        let side = match &self.round {
            Some(surface) => side_met(surface, ray, t),
            None if self.normal.dot(ray.direction) <= 0.0 => Side::Front,
            None => Side::Back,
        };
        (t < ray.t_max).then_some(Hit { surface: SurfaceId(id), t, side })
    }
}

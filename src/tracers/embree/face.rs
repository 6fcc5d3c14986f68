//! What tells in `f64` where a ray meets a surface that Embree found.

use super::query::{Frame, LIMIT_ULPS, Span, length_bound};
use super::raw::{LUX_EDGE_ULPS, LUX_GRAZING2, lux_hit};
use crate::geometry::{Aabb, Hit, Ray, Round, Side, Surface, SurfaceId};
use crate::tracers::brute_force::side_met;
use glam::DVec3;

/// What confirming a hit needs to know of a surface.
pub struct Face {
    /// A corner and the normal, of any length, of the triangles v0 v1 v3 and v2 v3 v1.
    planes: [[DVec3; 2]; 2],
    /// Corners, the last one twice for a triangle.
    outline: [DVec3; 4],
    /// Of the surface's (mean) plane, if it has one.
    normal: DVec3,
    /// The box around it, and a little more, m.
    bounds: Aabb,
    /// What is no polygon.
    round: Option<Box<Surface>>,
}

/// How far what Embree says may lie from the truth, as a share of the scene's radius, for the truth to be taken instead.
pub const REACH: f64 = 1e-3;

#[inline(always)]
fn dot([a, b, c]: [f64; 3], [x, y, z]: [f64; 3]) -> f64 {
    a * x + b * y + c * z
}

/// Where a ray (origin, direction) crosses a plane (a place on it, its normal of any length).
#[inline(always)]
pub fn crossing([o, d]: [[f64; 3]; 2], [a, normal]: [[f64; 3]; 2]) -> f64 {
    dot(normal, [a[0] - o[0], a[1] - o[1], a[2] - o[2]]) / dot(normal, d)
}

/// Whether a ray, the square of the length of whose direction is given, runs so flat along a plane (its normal of any
/// length) that Embree may meet what lies beside the ray.
#[inline(always)]
pub fn grazes(normal: [f64; 3], direction: [f64; 3], length2: f64) -> bool {
    let speed = dot(normal, direction);
    // A speed of nothing grazes too.
    speed * speed <= LUX_GRAZING2 * dot(normal, normal) * length2
}

/// Whether a ray faces the side that a normal points to.
#[inline(always)]
pub fn meets_front(normal: [f64; 3], direction: [f64; 3]) -> bool {
    dot(normal, direction) <= 0.0
}

/// The parameter of what a ray (origin, direction) meets, and whether it counts: beyond `t_min`, and in the box of
/// which `low` and `high` are corners. It is `exact` unless that is further from `rough`, Embree's, than `reach`.
#[inline(always)]
pub fn confirmed(
    [o, d]: [[f64; 3]; 2],
    t_min: f64,
    [rough, exact, reach]: [f64; 3],
    [low, high]: [[f64; 3]; 2],
) -> (f64, bool) {
    let t = if (exact - rough).abs() <= reach { exact } else { rough };
    let slack = 8.0 * f64::EPSILON * length_bound(o);
    let mut counts = t > t_min;
    for k in 0..3 {
        let at = o[k] + t * d[k];
        counts &= (at >= low[k] - slack) & (at <= high[k] + slack);
    }
    (t, counts)
}

impl Face {
    /// For `surface` in a scene of `radius`, m.
    pub fn new(surface: &Surface, radius: f64) -> Self {
        let plane = |[a, b, c]: [DVec3; 3]| [a, (b - a).cross(c - a)];
        let (triangles, _) = surface.triangles();
        let outline = match surface.vertices() {
            [a, b, c, d] => [*a, *b, *c, *d],
            [a, b, c] => [*a, *b, *c, *c],
            _ => [DVec3::ZERO; 4],
        };
        let slack = 2.0 * LIMIT_ULPS * f64::from(f32::EPSILON) * radius;
        let Aabb { min, max } = surface.bounds();
        Face {
            planes: triangles.map(plane),
            outline,
            normal: surface.plane().map_or(DVec3::ZERO, |plane| plane.normal),
            bounds: Aabb { min: min - slack, max: max + slack },
            round: surface.round().map(|_| Box::new(surface.clone())),
        }
    }

    /// The `f64` parameter of what Embree found, if it counts but for the far limit: not at or before the ray's start, and
    /// in the surface's box as far as `f32` can tell.
    #[inline(always)]
    pub fn confirm(&self, ray: &Ray, span: &Span, found: lux_hit, frame: &Frame) -> Option<f64> {
        let (rough, reach) = (span.parameter(found.t, frame), REACH * frame.radius * span.shrink);
        let exact = self.parameter(ray, found.part, rough, reach);
        let (from, along) = (ray.origin.to_array(), ray.direction.to_array());
        let (t, counts) = confirmed([from, along], ray.t_min, [rough, exact, reach], self.corners());
        counts.then_some(t)
    }

    /// Whether `ray` runs flat along the triangle `part` and crosses its plane beside the surface, by more than Embree
    /// may shift an edge, or nowhere.
    pub fn is_beside(&self, ray: &Ray, part: u32) -> bool {
        let [corner, normal] = self.planes[usize::from(part == 1)];
        let (across, along) = (normal.to_array(), ray.direction.to_array());
        if self.round.is_some() || !grazes(across, along, ray.direction.length_squared()) {
            return false;
        }
        let met = ray.at(crossing([ray.origin.to_array(), along], [corner.to_array(), across]));
        let furthest = |p: DVec3| p.abs().max_element();
        let largest = self.outline.iter().fold(furthest(ray.origin), |most, p| most.max(furthest(*p)));
        let band = LUX_EDGE_ULPS * f64::from(f32::EPSILON) * largest * normal.length();
        let inside = |k: usize| {
            let (from, to) = (self.outline[k], self.outline[(k + 1) % 4]);
            normal.dot((to - from).cross(met - from)) >= -band * (to - from).length()
        };
        !met.is_finite() || !(0..4).all(inside)
    }

    /// The corners of the box around it.
    #[inline(always)]
    pub fn corners(&self) -> [[f64; 3]; 2] {
        [self.bounds.min.to_array(), self.bounds.max.to_array()]
    }

    /// A corner and the normal of the triangle `part`, and the normal of the surface's (mean) plane; `None` for what is no
    /// polygon.
    #[inline(always)]
    pub fn plane(&self, part: u32) -> Option<[[f64; 3]; 3]> {
        let [corner, across] = self.planes[usize::from(part == 1)];
        self.round.is_none().then(|| [corner, across, self.normal].map(|v| v.to_array()))
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
                crossing([ray.origin, ray.direction].map(|v| v.to_array()), [a, normal].map(|v| v.to_array()))
            }
        }
    }

    /// The hit at parameter `t` of surface `id`.
    #[inline(always)]
    pub fn hit(&self, ray: &Ray, t: f64, id: u32) -> Option<Hit> {
        let side = match &self.round {
            Some(surface) => side_met(surface, ray, t),
            None if meets_front(self.normal.to_array(), ray.direction.to_array()) => Side::Front,
            None => Side::Back,
        };
        (t < ray.t_max).then_some(Hit { surface: SurfaceId(id), t, side })
    }
}

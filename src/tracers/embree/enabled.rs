//! The tracer over Embree: `f32` traversal, `f64` ray limits and hit distances.

use super::packet::Filling;
use super::raw::{self, EMPTY_RAY, LANES, LARGEST, NO_HIT, lux_hit, lux_ray};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Hit, Ray, Shape, Surface, SurfaceId};
use crate::scene::Geometry;
use crate::tracers::brute_force::{self, BruteForce, side_met};
use crate::tracers::{RayTracer, Segment};
use glam::{DVec3, Vec3};

/// Rays per call: what fits the first-level cache with its answers.
const BATCH: usize = 256;

/// Units in the last place (`f32`) of the scene's size by which Embree's distances are taken to be
/// uncertain, so that the limits of a ray can be decided in `f64`.
const LIMIT_ULPS: f64 = 32.0;

/// How often Embree is asked for what lies beyond a hit that does not count, before all surfaces are
/// tested in `f64` instead.
const TURNS: usize = 16;

/// The version of the Embree that is loaded, "3.13.5", or `None` if it refuses to start.
pub fn available() -> Option<String> {
    raw::version().map(|v| format!("{}.{}.{}", v / 10000, v / 100 % 100, v % 100))
}

/// Embree over one scene's surfaces: a single mesh of quads, robust mode.
///
/// Surfaces are found in `f32`. The limits of a ray are then decided, and its hit parameter computed,
/// in `f64` on the plane of the surface met: a ray that starts on a surface with `t_min` 0 meets that
/// surface exactly if its `f64` origin lies on the near side, so callers should give a `t_min` or
/// move the origin. Of surfaces nearer to one another than about 1e-6 of the scene's size either may be
/// reported as the closest.
///
/// Embree gets the scene, and the rays, at a size of about 1: a power of two takes them there, so that no
/// digit is lost, and neither tiny nor vast scenes leave the range of `f32` inside Embree.
pub struct EmbreeTracer {
    scene: raw::Scene,
    surfaces: Vec<Surface>,
    /// Distance of the furthest corner from the local origin, m.
    radius: f64,
    /// Lengths in Embree's scene over lengths in ours.
    scale: f32,
    version: String,
}

impl EmbreeTracer {
    /// Builds Embree's hierarchy over `geometry`.
    ///
    /// # Errors
    /// [`Error::Tracer`] if a vertex is not finite or beyond 1.8e18 m, if there are too many
    /// surfaces for 32-bit indices, or with Embree's own message.
    pub fn new(geometry: &Geometry) -> Result<Self> {
        Self::with(geometry, true)
    }

    /// Embree as it comes, without our check in `f64` of what blocks a ray: the ceiling that others are
    /// measured against, and wrong for some rays that run in the plane of a surface.
    ///
    /// # Errors
    /// As [`EmbreeTracer::new`].
    pub fn bare(geometry: &Geometry) -> Result<Self> {
        Self::with(geometry, false)
    }

    fn with(geometry: &Geometry, confirm: bool) -> Result<Self> {
        let too_many =
            || Error::Tracer(format!("{} surfaces are too many for Embree", geometry.surfaces.len()));
        let vertex_count = u32::try_from(4 * geometry.surfaces.len()).map_err(|_| too_many())?;
        let radius = corner_radius(&geometry.surfaces);
        let scale = unit_scale(radius);
        let mut vertices = Vec::with_capacity(vertex_count as usize);
        let mut quads = Vec::with_capacity(geometry.surfaces.len());
        for (i, surface) in geometry.surfaces.iter().enumerate() {
            let first = vertices.len() as u32;
            let corners = surface.vertices();
            for v in corners.iter().map(|v| v.as_vec3()) {
                if v.is_nan() || v.abs().max_element() > LARGEST {
                    return Err(Error::Tracer(format!("surface {i} has a vertex that is no position: {v}")));
                }
                vertices.push((scale * v).to_array());
            }
            let last = first + corners.len() as u32 - 1;
            quads.push([first, first + 1, first + 2, last]);
        }
        let scene = raw::Scene::new(&vertices, &quads, confirm).map_err(Error::Tracer)?;
        let version = available().unwrap_or_default();
        Ok(EmbreeTracer { scene, surfaces: geometry.surfaces.clone(), radius, scale, version })
    }

    /// The `f64` hit behind Embree's answer to `query`, looking further along the ray while what Embree
    /// met turns out to lie at or before the ray's start, or beside the surface: all of Embree's tests are noise for
    /// a triangle in whose plane the ray runs.
    fn decide(&self, ray: &Ray, query: &Query, mut found: lux_hit) -> Option<Hit> {
        for _ in 0..TURNS {
            let surface = self.surfaces.get(found.quad as usize)?;
            let rough = query.parameter(found.t);
            let t = plane_parameter(ray, surface, found.half)
                .filter(|t| (t - rough).abs() * query.length <= 1e-3 * self.radius)
                .unwrap_or(rough);
            if t > ray.t_min && self.is_near(surface, ray, t) {
                let side = side_met(surface, ray.direction);
                return (t < ray.t_max).then_some(Hit { surface: SurfaceId(found.quad), t, side });
            }
            // A denormal would not move on: Embree runs with denormals taken as zero.
            let beyond = found.t.max(f32::MIN_POSITIVE).next_up();
            let mut rest = [lux_ray { t_min: beyond, ..query.ray }];
            let mut next = [NO_HIT];
            self.scene.closest(&mut rest, &mut next);
            if next[0].t < beyond {
                return None;
            }
            found = next[0];
        }
        // A triangle in whose plane the ray runs may be met again and again, a step of f32 further each time.
        BruteForce::over(&self.surfaces).closest(ray)
    }

    /// Whether the point at `t` lies in the surface's box, as far as `f32` can tell.
    fn is_near(&self, surface: &Surface, ray: &Ray, t: f64) -> bool {
        let slack = 2.0 * LIMIT_ULPS * f64::from(f32::EPSILON) * self.radius
            + 8.0 * f64::EPSILON * ray.origin.length();
        let bounds = surface.bounds();
        Aabb { min: bounds.min - slack, max: bounds.max + slack }.contains(ray.at(t))
    }

    /// How many of the segments from `from` to each of `to`, for all `(from, to)` in turn, nothing blocks. Packets
    /// are filled across the borders of the fans.
    pub fn count_free<'p>(&self, fans: impl IntoIterator<Item = (Vec3, &'p [Vec3])>) -> u64 {
        let mut filling = Filling::new();
        let mut free = 0;
        for (from, to) in fans {
            for &to in to {
                if filling.push(from, to) {
                    free += LANES as u64 - u64::from(self.occluded_packet(&mut filling).count_ones());
                }
            }
        }
        let rest = filling.count() as u64;
        if rest > 0 {
            free += rest - u64::from(self.occluded_packet(&mut filling).count_ones());
        }
        free
    }

    /// Which of the segments in `filling` are blocked; empties it.
    #[inline]
    fn occluded_packet(&self, filling: &mut Filling) -> u16 {
        let mut blocked = [0];
        self.scene.occluded_packets(filling.rays(self.scale), &mut blocked);
        blocked[0]
    }

    fn occluded_few(&self, segments: &[Segment], blocked: &mut [bool]) {
        let mut rays = [EMPTY_RAY; LANES];
        let mut answers = [0u8; LANES];
        for (ray, segment) in rays.iter_mut().zip(segments) {
            *ray = segment_ray(segment, self.scale);
        }
        self.scene.occluded(&mut rays[..segments.len()], &mut answers);
        for (blocked, answer) in blocked.iter_mut().zip(answers) {
            *blocked = answer != 0;
        }
    }

    fn closest_chunk(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        let mut queries = [EMPTY_RAY; BATCH];
        let mut found = [NO_HIT; BATCH];
        for (query, ray) in queries.iter_mut().zip(rays) {
            *query = Query::new(ray, self.radius, self.scale).ray;
        }
        self.scene.closest(&mut queries[..rays.len()], &mut found);
        for ((hit, ray), found) in hits.iter_mut().zip(rays).zip(found) {
            *hit = match found.quad {
                raw::LUX_MISS => None,
                _ => self.decide(ray, &Query::new(ray, self.radius, self.scale), found),
            };
        }
    }
}

impl RayTracer for EmbreeTracer {
    fn name(&self) -> String {
        format!("embree {}", self.version)
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let query = Query::new(ray, self.radius, self.scale);
        let mut found = [NO_HIT];
        self.scene.closest(&mut [query.ray], &mut found);
        self.decide(ray, &query, found[0])
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        for (rays, hits) in rays.chunks(BATCH).zip(hits.chunks_mut(BATCH)) {
            self.closest_chunk(rays, hits);
        }
    }

    fn occluded_batch(&self, segments: &[Segment], blocked: &mut [bool]) {
        let mut filling = Filling::new();
        for (segments, blocked) in segments.chunks(LANES).zip(blocked.chunks_mut(LANES)) {
            if segments.len() < LANES {
                self.occluded_few(segments, blocked);
                continue;
            }
            for segment in segments {
                filling.push(segment.from, segment.to);
            }
            let bits = self.occluded_packet(&mut filling);
            for (lane, blocked) in blocked.iter_mut().enumerate() {
                *blocked = bits >> lane & 1 == 1;
            }
        }
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        self.closest(&brute_force::segment_ray(segment)).map(|hit| hit.surface)
    }
}

/// A ray as Embree sees it: unit direction, so that its parameter is a length, and an origin that is
/// moved up to the scene if it lies far before it, so that rounding it to `f32` costs nothing.
struct Query {
    ray: lux_ray,
    /// Length of the caller's direction.
    length: f64,
    /// How far the origin was moved, m.
    moved: f64,
    /// See [`EmbreeTracer`].
    scale: f64,
}

impl Query {
    fn new(ray: &Ray, radius: f64, scale: f32) -> Self {
        let scale = f64::from(scale);
        let length = ray.direction.length();
        let unit = ray.direction / length;
        let (start, end) = (ray.t_min * length, ray.t_max * length);
        // No surface lies before the tangent plane of the sphere around the scene.
        let entry = -ray.origin.dot(unit) - 1.01 * radius;
        let moved = if entry > 0.0 || start < 0.0 { start.max(entry) } else { 0.0 };
        let origin = ray.origin + moved * unit;
        let slack = LIMIT_ULPS * f64::from(f32::EPSILON) * (radius + origin.length());
        let limited = lux_ray {
            origin: (scale * origin).as_vec3().to_array(),
            t_min: (scale * (start - moved - slack)).max(0.0) as f32,
            direction: unit.as_vec3().to_array(),
            t_max: (scale * (end - moved + slack)) as f32,
        };
        // Limits that are no limits (NaN), or that exclude one another, hit nothing.
        let ray = if ray.t_min < ray.t_max { limited } else { EMPTY_RAY };
        Query { ray, length, moved, scale }
    }

    /// The caller's ray parameter at Embree's.
    fn parameter(&self, t: f32) -> f64 {
        (self.moved + f64::from(t) / self.scale) / self.length
    }
}

/// The ray from one end of a segment to the other, less its margins. A segment that is not finite
/// becomes a ray that is not, and so hits nothing.
fn segment_ray(segment: &Segment, scale: f32) -> lux_ray {
    let margin = segment.margin();
    lux_ray {
        origin: (scale * segment.from).to_array(),
        t_min: margin,
        direction: (scale * (segment.to - segment.from)).to_array(),
        t_max: 1.0 - margin,
    }
}

/// Where `ray` crosses the plane of the triangle met, by the same formula as the brute force tracer;
/// `None` if it runs along it.
fn plane_parameter(ray: &Ray, surface: &Surface, half: u32) -> Option<f64> {
    let [a, b, c] = match (surface.shape, half) {
        (Shape::Quad([_, v1, v2, v3]), 1) => [v2, v3, v1],
        (Shape::Quad([v0, v1, _, v3]), _) => [v0, v1, v3],
        (Shape::Triangle(t), _) => t,
    };
    let normal = (b - a).cross(c - a);
    let t = normal.dot(a - ray.origin) / normal.dot(ray.direction);
    t.is_finite().then_some(t)
}

/// Distance of the furthest corner from the local origin, m.
fn corner_radius(surfaces: &[Surface]) -> f64 {
    surfaces.iter().flat_map(|s| s.vertices()).fold(0.0, |r, v: &DVec3| r.max(v.length()))
}

/// The power of two that makes a length of `radius` one between 0.5 and 2; 1 where there is none.
fn unit_scale(radius: f64) -> f32 {
    let exponent = radius.log2().floor();
    if exponent.is_finite() { (-exponent).clamp(-120.0, 120.0).exp2() as f32 } else { 1.0 }
}

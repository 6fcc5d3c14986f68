//! The tracer over Embree: `f32` traversal, `f64` ray limits and hit distances.

use super::packet::Filling;
use super::raw::{self, EMPTY_RAY, LANES, LARGEST, NO_HIT, lux_hit, lux_ray, lux_round};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Hit, Ray, Round, Surface, SurfaceId};
use crate::scene::Geometry;
use crate::tracers::brute_force::{self, BruteForce, side_met};
use crate::tracers::{RayTracer, Segment};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

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

/// Embree over one scene's surfaces: a single mesh of quads, robust mode, and discs and spheres as they are, met in
/// double precision.
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
    faces: Vec<Face>,
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
        let (mut ids, mut rounds) = (Vec::with_capacity(geometry.surfaces.len()), Vec::new());
        for (i, surface) in geometry.surfaces.iter().enumerate() {
            if let Some(round) = surface.round() {
                let bounds = round.bounds();
                let reach = bounds.min.abs().max(bounds.max.abs()).max_element();
                if reach.is_nan() || reach > f64::from(LARGEST) {
                    return Err(Error::Tracer(format!("surface {i} is no place: {round:?}")));
                }
                rounds.push(in_unit_scene(&round, i as u32, f64::from(scale)));
                continue;
            }
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
            ids.push(i as u32);
        }
        let scene = raw::Scene::new(&vertices, &quads, &ids, &rounds, confirm).map_err(Error::Tracer)?;
        let version = available().unwrap_or_default();
        Ok(EmbreeTracer {
            scene,
            surfaces: geometry.surfaces.clone(),
            faces: geometry.surfaces.iter().map(Face::new).collect(),
            radius,
            scale,
            version,
        })
    }

    /// Rays made ready to be traced again and again with as little around Embree as can be: the ceiling
    /// of everything that casts them.
    pub fn bare_loop(&self, rays: &[Ray]) -> BareLoop<'_> {
        let rays: Vec<_> = rays.iter().map(|ray| Query::new(ray, self.radius, self.scale).ray).collect();
        let found = vec![NO_HIT; rays.len()];
        BareLoop { scene: &self.scene, rays, found }
    }

    /// The `f64` hit behind Embree's answer to `query`, looking further along the ray while what Embree
    /// met turns out to lie at or before the ray's start, or beside the surface: all of Embree's tests are noise for
    /// a triangle in whose plane the ray runs.
    #[inline]
    fn decide(&self, ray: &Ray, query: &Query, found: lux_hit) -> Option<Hit> {
        let face = self.faces.get(found.surface as usize)?;
        match self.confirm(ray, query, face, found) {
            Some(t) => self.within(ray, found.surface, t),
            None => self.look_beyond(ray, query, found),
        }
    }

    /// The `f64` parameter of what Embree met, if it counts but for the far limit.
    #[inline]
    fn confirm(&self, ray: &Ray, query: &Query, face: &Face, found: lux_hit) -> Option<f64> {
        let rough = query.parameter(found.t);
        let t = face
            .parameter(ray, found.half)
            .filter(|t| (t - rough).abs() * query.length <= 1e-3 * self.radius)
            .unwrap_or(rough);
        (t > ray.t_min && self.is_near(face, ray, t)).then_some(t)
    }

    #[inline]
    fn within(&self, ray: &Ray, surface: u32, t: f64) -> Option<Hit> {
        let side = side_met(&self.surfaces[surface as usize], ray, t);
        (t < ray.t_max).then_some(Hit { surface: SurfaceId(surface), t, side })
    }

    /// What lies beyond a hit that does not count.
    #[cold]
    fn look_beyond(&self, ray: &Ray, query: &Query, mut found: lux_hit) -> Option<Hit> {
        for _ in 1..TURNS {
            // A denormal would not move on: Embree runs with denormals taken as zero.
            let beyond = found.t.max(f32::MIN_POSITIVE).next_up();
            let mut rest = [lux_ray { t_min: beyond, ..query.ray }];
            let mut next = [NO_HIT];
            self.scene.closest(&mut rest, &mut next);
            if next[0].t < beyond {
                return None;
            }
            found = next[0];
            let face = self.faces.get(found.surface as usize)?;
            if let Some(t) = self.confirm(ray, query, face, found) {
                return self.within(ray, found.surface, t);
            }
        }
        // A triangle in whose plane the ray runs may be met again and again, a step of f32 further each time.
        BruteForce::over(&self.surfaces).closest(ray)
    }

    /// Whether the point at `t` lies in the surface's box, as far as `f32` can tell.
    #[inline]
    fn is_near(&self, face: &Face, ray: &Ray, t: f64) -> bool {
        let slack = 2.0 * LIMIT_ULPS * f64::from(f32::EPSILON) * self.radius
            + 8.0 * f64::EPSILON * length_bound(ray.origin);
        Aabb { min: face.bounds.min - slack, max: face.bounds.max + slack }.contains(ray.at(t))
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
        let mut queries = [Query { ray: EMPTY_RAY, length: 0.0, moved: 0.0, scale: 1.0 }; BATCH];
        let (mut asked, mut found) = ([EMPTY_RAY; BATCH], [NO_HIT; BATCH]);
        for ((query, asked), ray) in queries.iter_mut().zip(&mut asked).zip(rays) {
            *query = Query::new(ray, self.radius, self.scale);
            *asked = query.ray;
        }
        self.scene.closest(&mut asked[..rays.len()], &mut found);
        for (((hit, ray), query), found) in hits.iter_mut().zip(rays).zip(&queries).zip(found) {
            *hit = match found.surface {
                raw::LUX_MISS => None,
                _ => self.decide(ray, query, found),
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

/// See [`EmbreeTracer::bare_loop`].
pub struct BareLoop<'a> {
    scene: &'a raw::Scene,
    rays: Vec<lux_ray>,
    found: Vec<lux_hit>,
}

impl BareLoop<'_> {
    /// Traces all rays in packets of 16, on all threads of the current pool, and keeps parameter and surface.
    /// Returns how many hit something.
    pub fn run(&mut self) -> usize {
        let scene = self.scene;
        let (rays, found) = (self.rays.par_chunks_mut(1 << 12), self.found.par_chunks_mut(1 << 12));
        rays.zip(found).for_each(|(rays, found)| scene.closest(rays, found));
        self.hits()
    }

    /// [`BareLoop::run`] on this thread alone.
    pub fn run_here(&mut self) -> usize {
        self.scene.closest(&mut self.rays, &mut self.found);
        self.hits()
    }

    fn hits(&self) -> usize {
        self.found.iter().filter(|hit| hit.surface != raw::LUX_MISS).count()
    }
}

/// A ray as Embree sees it: unit direction, so that its parameter is a length, and an origin that is
/// moved up to the scene if it lies far before it, so that rounding it to `f32` costs nothing.
#[derive(Clone, Copy)]
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
    #[inline]
    fn new(ray: &Ray, radius: f64, scale: f32) -> Self {
        let scale = f64::from(scale);
        let length = ray.direction.length();
        let unit = ray.direction / length;
        let (start, end) = (ray.t_min * length, ray.t_max * length);
        // No surface lies before the tangent plane of the sphere around the scene.
        let entry = -ray.origin.dot(unit) - 1.01 * radius;
        let moved = if entry > 0.0 || start < 0.0 { start.max(entry) } else { 0.0 };
        let origin = ray.origin + moved * unit;
        let slack = LIMIT_ULPS * f64::from(f32::EPSILON) * (radius + length_bound(origin));
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
    #[inline]
    fn parameter(&self, t: f32) -> f64 {
        (self.moved + f64::from(t) / self.scale) / self.length
    }
}

/// No less than the length of `v`, and no more than √3 times it: without a root.
#[inline]
fn length_bound(v: DVec3) -> f64 {
    v.x.abs() + v.y.abs() + v.z.abs()
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

/// What confirming a hit needs to know of a surface.
struct Face {
    /// A corner and the normal, of any length, of the triangles v0 v1 v3 and v2 v3 v1.
    planes: [[DVec3; 2]; 2],
    round: Option<Round>,
    bounds: Aabb,
}

impl Face {
    fn new(surface: &Surface) -> Self {
        let plane = |[a, b, c]: [DVec3; 3]| [a, (b - a).cross(c - a)];
        let (triangles, _) = surface.triangles();
        Face { planes: triangles.map(plane), round: surface.round(), bounds: surface.bounds() }
    }

    /// Where `ray` crosses the plane of the triangle met, or the disc or sphere, by the same formula as the brute
    /// force tracer; `None` if it runs along it.
    #[inline]
    fn parameter(&self, ray: &Ray, half: u32) -> Option<f64> {
        let t = match &self.round {
            Some(round) => round.crossings(ray)[half.min(1) as usize],
            None => {
                let [a, normal] = self.planes[usize::from(half == 1)];
                normal.dot(a - ray.origin) / normal.dot(ray.direction)
            }
        };
        t.is_finite().then_some(t)
    }
}

/// A disc or sphere as Embree's scene has it.
fn in_unit_scene(round: &Round, surface: u32, scale: f64) -> lux_round {
    let (disc, axis) = match round {
        Round::Disc(disc) => (1, disc.normal),
        Round::Sphere(_) => (0, DVec3::ZERO),
    };
    lux_round {
        centre: (scale * round.centre()).to_array(),
        radius: scale * round.radius(),
        axis: axis.to_array(),
        disc,
        surface,
    }
}

/// No corner, and no point of a disc or sphere, lies further from the local origin, m.
fn corner_radius(surfaces: &[Surface]) -> f64 {
    let reach = |s: &Surface| match s.round() {
        Some(round) => round.centre().length() + round.radius(),
        None => s.vertices().iter().fold(0.0, |r: f64, v: &DVec3| r.max(v.length())),
    };
    surfaces.iter().map(reach).fold(0.0, f64::max)
}

/// The power of two that makes a length of `radius` one between 0.5 and 2; 1 where there is none.
fn unit_scale(radius: f64) -> f32 {
    let exponent = radius.log2().floor();
    if exponent.is_finite() { (-exponent).clamp(-120.0, 120.0).exp2() as f32 } else { 1.0 }
}

//! The tracer over Embree: `f32` traversal, `f64` ray limits and hit distances.

use super::decide::Decide;
use super::face::Face;
use super::packet::Filling;
use super::query::{Columns, Frame, Pack, Span, single};
use super::raw::{self, EMPTY_RAY, LANES, LARGEST, NO_HIT, NO_HITS, Query, Rounds};
use super::raw::{lux_hit, lux_hits, lux_ray, lux_round};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Hit, Ray, Surface, SurfaceId};
use crate::scene::Geometry;
use crate::simd::widest;
use crate::tracers::brute_force::{self, BruteForce};
use crate::tracers::{RayTracer, Segment};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Packets per call: what fits the first-level cache with its answers.
const PACKETS: usize = 8;

/// Rays per call.
const BATCH: usize = PACKETS * LANES;

/// A segment with an end further out than so many times the scene's radius is not Embree's: its boxes are met or missed
/// by rounding in units of that end (measured: beyond 8, some of 1e6 segments at the borders of boxes slip between two).
const FAR: f64 = 4.0;

/// How often Embree is asked for what lies beyond a hit that does not count, before all surfaces are
/// tested in `f64` instead.
const TURNS: usize = 16;

/// The version of the Embree that is loaded, "3.13.5", or `None` if it refuses to start.
pub fn available() -> Option<String> {
    raw::version().map(|v| format!("{}.{}.{}", v / 10000, v / 100 % 100, v % 100))
}

/// Embree over one scene's surfaces: a single mesh of quads, robust mode, and what is no polygon as it is, met by
/// [`Round::intersect`](crate::geometry::Round::intersect).
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
    frame: Frame,
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
        let mut ids = Vec::with_capacity(geometry.surfaces.len());
        let (mut rounds, mut shapes) = (Vec::new(), Vec::new());
        for (i, surface) in geometry.surfaces.iter().enumerate() {
            if let Some(round) = surface.round() {
                let bounds = round.bounds();
                let reach = bounds.min.abs().max(bounds.max.abs()).max_element();
                if reach.is_nan() || reach > f64::from(LARGEST) {
                    return Err(Error::Tracer(format!("surface {i} is no place: {round:?}")));
                }
                let in_unit_scene = |corner: DVec3| (f64::from(scale) * corner).to_array();
                for part in 0..round.parts() {
                    let Aabb { min, max } = round.part_bounds(part);
                    let (low, high) = (in_unit_scene(min), in_unit_scene(max));
                    rounds.push(lux_round { low, high, surface: i as u32, part: part as u32 });
                    shapes.push((round.clone(), part));
                }
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
        let rounds = (rounds.as_slice(), Rounds { shapes, scale: f64::from(scale) });
        let scene = raw::Scene::new(&vertices, &quads, &ids, rounds, confirm).map_err(Error::Tracer)?;
        let version = available().unwrap_or_default();
        Ok(EmbreeTracer {
            scene,
            surfaces: geometry.surfaces.clone(),
            faces: geometry.surfaces.iter().map(|surface| Face::new(surface, radius)).collect(),
            frame: Frame { radius, scale: f64::from(scale) },
            version,
        })
    }

    /// Rays made ready to be traced again and again with as little around Embree as can be: the ceiling
    /// of everything that casts them.
    pub fn bare_loop(&self, rays: &[Ray]) -> BareLoop<'_> {
        let rays: Vec<_> = rays.iter().map(|ray| single(ray, &self.frame).0).collect();
        let found = vec![NO_HIT; rays.len()];
        BareLoop { scene: &self.scene, rays, found }
    }

    /// The `f64` hit behind Embree's answer to a ray, looking further along it while what Embree
    /// met turns out to lie at or before the ray's start, or beside the surface: all of Embree's tests are noise for
    /// a triangle in whose plane the ray runs.
    #[inline(always)]
    fn decide(&self, ray: &Ray, span: &Span, found: lux_hit) -> Option<Hit> {
        let face = self.faces.get(found.surface as usize)?;
        if face.is_beside(ray, found.part) {
            return BruteForce::over(&self.surfaces).closest(ray);
        }
        match face.confirm(ray, span, found, &self.frame) {
            Some(t) => face.hit(ray, t, found.surface),
            None => self.look_beyond(ray, found),
        }
    }

    /// What lies beyond a hit that does not count.
    #[cold]
    fn look_beyond(&self, ray: &Ray, mut found: lux_hit) -> Option<Hit> {
        let (query, span) = single(ray, &self.frame);
        for _ in 1..TURNS {
            // A denormal would not move on: Embree runs with denormals taken as zero.
            let beyond = found.t.max(f32::MIN_POSITIVE).next_up();
            let mut rest = [lux_ray { t_min: beyond, ..query }];
            let mut next = [NO_HIT];
            self.scene.closest(&mut rest, &mut next);
            if next[0].t < beyond {
                return None;
            }
            found = next[0];
            let face = self.faces.get(found.surface as usize)?;
            if face.is_beside(ray, found.part) {
                break;
            }
            if let Some(t) = face.confirm(ray, &span, found, &self.frame) {
                return face.hit(ray, t, found.surface);
            }
        }
        // A triangle in whose plane the ray runs may be met again and again, a step of f32 further each time.
        BruteForce::over(&self.surfaces).closest(ray)
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
        self.scene.occluded_packets(filling.rays(self.frame.scale as f32), &mut blocked);
        blocked[0]
    }

    /// Whether an end lies so far out that the ray has to be moved up to the scene, as [`RayTracer::closest`] does.
    #[inline]
    fn is_far(&self, segment: &Segment) -> bool {
        let furthest = segment.from.abs().max(segment.to.abs()).max_element();
        f64::from(furthest) > FAR * self.frame.radius
    }

    fn occluded_few(&self, segments: &[Segment], blocked: &mut [bool]) {
        let mut rays = [EMPTY_RAY; LANES];
        let mut answers = [0u8; LANES];
        for (ray, segment) in rays.iter_mut().zip(segments) {
            *ray = segment_ray(segment, self.frame.scale as f32);
        }
        self.scene.occluded(&mut rays[..segments.len()], &mut answers);
        for (blocked, answer) in blocked.iter_mut().zip(answers) {
            *blocked = answer != 0;
        }
    }

    /// The closest hits of up to [`BATCH`] rays, in packets whose last lanes may stay empty.
    fn closest_few(&self, rays: &[Ray], hits: &mut [Option<Hit>], room: &mut Room) {
        let Room { packets, columns, found, left } = room;
        let used = rays.len().div_ceil(LANES);
        let frame = &self.frame;
        widest(Pack { rays, frame, packets, columns });
        self.scene.closest_packets(&mut packets[..used], found);
        let (faces, columns) = (&self.faces[..], &columns[..used]);
        widest(Decide { faces, frame, rays: columns, found, hits, left });
        for (packet, left) in left[..used].iter().enumerate().filter(|(_, left)| **left != 0) {
            let first = packet * LANES;
            for (lane, (ray, hit)) in rays[first..].iter().zip(&mut hits[first..]).enumerate().take(LANES) {
                if left >> lane & 1 == 1 {
                    let lux_hits { t, surface, part } = &found[packet];
                    let found = lux_hit { t: t[lane], surface: surface[lane], part: part[lane] };
                    *hit = self.decide(ray, &columns[packet].span(lane), found);
                }
            }
        }
    }
}

/// Room for the rays of a call and for what becomes of them.
struct Room {
    packets: [Query; PACKETS],
    columns: [Columns; PACKETS],
    found: [lux_hits; PACKETS],
    left: [u16; PACKETS],
}

impl RayTracer for EmbreeTracer {
    fn name(&self) -> String {
        format!("embree {}", self.version)
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        let (query, span) = single(ray, &self.frame);
        let mut found = [NO_HIT];
        self.scene.closest(&mut [query], &mut found);
        self.decide(ray, &span, found[0])
    }

    fn closest_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        let mut room = Room {
            packets: [Query::EMPTY; PACKETS],
            columns: [Columns::EMPTY; PACKETS],
            found: [NO_HITS; PACKETS],
            left: [0; PACKETS],
        };
        for (rays, hits) in rays.chunks(BATCH).zip(hits.chunks_mut(BATCH)) {
            self.closest_few(rays, hits, &mut room);
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
        for (segment, blocked) in segments.iter().zip(blocked) {
            if self.is_far(segment) {
                *blocked = self.blocker(segment).is_some();
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

/// No corner, and no point of what is no polygon, lies further from the local origin, m.
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

//! Rates of the ray tracers on one thread, ray by ray and in packets.

use crate::geometry::Ray;
use crate::scene::Geometry;
use crate::tracers::embree::BareLoop;
use crate::tracers::{EmbreeTracer, RayTracer, Segment, VoxelTracer, embree};
use glam::{DVec3, Vec3};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Rounds of which the fastest counts: the others were disturbed.
const ROUNDS: usize = 5;

/// Rays a call, where calls take many.
const CHUNK: usize = 1 << 12;

/// Rays a second on one thread, all tracers on the same rays in turn.
#[derive(Clone, Debug, Serialize)]
pub struct TracerRates {
    /// Surfaces of the scene.
    pub surfaces: usize,
    /// Rays, and segments, that each rate is taken from.
    pub rays: usize,
    /// Time to build the voxel tracer, s.
    pub voxel_build_s: f64,
    /// Closest hits by the voxel tracer, 1/s.
    pub voxel_closest_per_s: f64,
    /// Occlusion of segments by the voxel tracer, 1/s.
    pub voxel_occluded_per_s: f64,
    /// The ceilings; `None` in a build without Embree.
    pub embree: Option<EmbreeRates>,
}

/// What Embree reaches on the same rays.
#[derive(Clone, Debug, Serialize)]
pub struct EmbreeRates {
    /// Its version.
    pub version: String,
    /// Time to build the tracer, s.
    pub build_s: f64,
    /// Closest hits, one ray a call, 1/s.
    pub closest_per_s: f64,
    /// Closest hits in packets of 16 with nothing around them, 1/s.
    pub closest_packets_per_s: f64,
    /// Occlusion, one segment a call, 1/s.
    pub occluded_per_s: f64,
    /// Occlusion in packets of 16, 1/s.
    pub occluded_packets_per_s: f64,
    /// The voxel tracer's closest hits over Embree's of single rays.
    pub voxel_closest_ratio: f64,
    /// The voxel tracer's occlusion over Embree's in packets.
    pub voxel_occluded_ratio: f64,
}

/// Times the tracers on `count` rays from random points of random surfaces in random directions, and as many segments
/// between such points.
///
/// # Errors
/// [`Error::Tracer`](crate::error::Error::Tracer) where Embree is built in and does not take the scene.
pub fn tracer_rates(geometry: &Geometry, count: usize) -> crate::error::Result<TracerRates> {
    let mut random = Random(1);
    let segments: Vec<Segment> = if geometry.surfaces.is_empty() {
        Vec::new()
    } else {
        (0..count).map(|_| Segment { from: random.place(geometry), to: random.place(geometry) }).collect()
    };
    let rays: Vec<Ray> = segments.iter().map(|segment| random.ray(segment, geometry.radius)).collect();
    let (voxel, voxel_build_s) = timed(|| VoxelTracer::new(geometry));
    let embree = match embree::available() {
        Some(version) => {
            let (tracer, build_s) = timed(|| EmbreeTracer::new(geometry));
            Some((version, tracer?, build_s))
        }
        None => None,
    };
    let tracer = embree.as_ref().map(|(_, tracer, _)| tracer);
    let mut bare: Option<BareLoop> = tracer.map(|t| t.bare_loop(&rays));
    let mut blocked = vec![false; CHUNK];
    let mut best = [f64::INFINITY; 6];
    for _ in 0..ROUNDS {
        let mut round = vec![singly(&voxel, &rays), many(&voxel, &segments, &mut blocked)];
        if let (Some(tracer), Some(bare)) = (tracer, &mut bare) {
            round.push(singly(tracer, &rays));
            round.push(timed(|| bare.run_here()).1);
            round.push(alone(tracer, &segments));
            round.push(many(tracer, &segments, &mut blocked));
        }
        for (best, seconds) in best.iter_mut().zip(round) {
            *best = best.min(seconds);
        }
    }
    let [voxel_closest, voxel_occluded, closest, packets, occluded, occluded_packets] =
        best.map(|seconds| segments.len() as f64 / seconds);
    Ok(TracerRates {
        surfaces: geometry.surfaces.len(),
        rays: segments.len(),
        voxel_build_s,
        voxel_closest_per_s: voxel_closest,
        voxel_occluded_per_s: voxel_occluded,
        embree: embree.as_ref().map(|(version, _, build_s)| EmbreeRates {
            version: version.clone(),
            build_s: *build_s,
            closest_per_s: closest,
            closest_packets_per_s: packets,
            occluded_per_s: occluded,
            occluded_packets_per_s: occluded_packets,
            voxel_closest_ratio: voxel_closest / closest,
            voxel_occluded_ratio: voxel_occluded / occluded_packets,
        }),
    })
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let made = work();
    (made, start.elapsed().as_secs_f64())
}

/// Seconds for the closest hits of all rays, one a call.
fn singly(tracer: &dyn RayTracer, rays: &[Ray]) -> f64 {
    timed(|| {
        for ray in rays {
            black_box(tracer.closest(ray));
        }
    })
    .1
}

/// Seconds for the occlusion of all segments, one a call.
fn alone(tracer: &dyn RayTracer, segments: &[Segment]) -> f64 {
    let mut blocked = [false];
    timed(|| segments.iter().for_each(|&s| tracer.occluded_batch(&[s], black_box(&mut blocked)))).1
}

/// Seconds for the occlusion of all segments, many a call.
fn many(tracer: &dyn RayTracer, segments: &[Segment], blocked: &mut [bool]) -> f64 {
    timed(|| {
        for segments in segments.chunks(CHUNK) {
            tracer.occluded_batch(segments, black_box(&mut blocked[..segments.len()]));
        }
    })
    .1
}

/// A small generator, the same rays in every run (Knuth's linear congruential one).
struct Random(u64);

impl Random {
    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// On a random surface of a geometry that has some.
    fn place(&mut self, geometry: &Geometry) -> Vec3 {
        let surfaces = &geometry.surfaces;
        let surface = &surfaces[(self.unit() * surfaces.len() as f64) as usize % surfaces.len()];
        let (u, v) = (self.unit(), self.unit());
        let folded = surface.vertices().len() == 3 && u + v > 1.0;
        let (u, v) = if folded { (1.0 - u, 1.0 - v) } else { (u, v) };
        surface.point_at(u, v).as_vec3()
    }

    /// From the start of a segment to all sides, from a little away.
    fn ray(&mut self, segment: &Segment, radius: f64) -> Ray {
        let direction = loop {
            let d = DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0;
            let length = d.length();
            if length > 0.01 && length <= 1.0 {
                break d / length;
            }
        };
        Ray { origin: segment.from.as_dvec3(), direction, t_min: 1e-6 * radius, t_max: f64::INFINITY }
    }
}

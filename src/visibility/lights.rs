//! What the lights of a scene without a body reach: a bit for every light and sample point.
//!
//! That is geometry and costs one ray a pair, so it is found out with the graph, whether the graph is
//! built or read from a file, and no graph file keeps it.

use super::graph::{VisibilityGraph, stride_of};
use crate::points::SamplePoints;
use crate::scene::{Geometry, Light};
use crate::tracers::{RayTracer, Segment};
use glam::DVec3;
use rayon::prelude::*;

/// Words of one task, 32 points each.
const CHUNK: usize = 128;

/// Which sample points each light reaches.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LightSight {
    /// Where the lights stood.
    places: Vec<DVec3>,
    /// A row for each light: point `i` is bit `i % 32` of word `i / 32`.
    words: Vec<u32>,
    /// Words of a row.
    stride: usize,
}

impl LightSight {
    /// Finds out which of `points` the lights of `geometry` reach: in front of the point, and nothing between.
    pub fn look(geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) -> Self {
        let tolerance = geometry.plane_tolerance();
        let stride = stride_of(points.len());
        let mut words = vec![0u32; stride * geometry.lights.len()];
        for (light, row) in geometry.lights.iter().zip(words.chunks_mut(stride.max(1))) {
            row.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, words)| {
                let first = 32 * CHUNK * chunk;
                let facing = |&i: &usize| {
                    light.height(points.position[i].as_dvec3(), points.normal[i].as_dvec3()) > tolerance
                };
                let facing: Vec<usize> =
                    (first..(first + 32 * words.len()).min(points.len())).filter(facing).collect();
                let segment = |&i: &usize| {
                    let to = light.seen_from(points.position[i].as_dvec3()).end.as_vec3();
                    Segment { from: points.position[i], to }
                };
                let segments: Vec<Segment> = facing.iter().map(segment).collect();
                let mut blocked = vec![false; segments.len()];
                tracer.occluded_batch(&segments, &mut blocked);
                for (i, blocked) in facing.into_iter().zip(blocked) {
                    words[(i - first) / 32] |= u32::from(!blocked) << (i % 32);
                }
            });
        }
        LightSight { places: places(geometry).collect(), words, stride }
    }

    /// Whether light `light` reaches point `i`.
    pub fn lit(&self, light: usize, i: usize) -> bool {
        let LightSight { words, stride, .. } = self;
        i / 32 < *stride && words.get(light * stride + i / 32).is_some_and(|w| w >> (i % 32) & 1 == 1)
    }

    /// Whether it is known what the lights of `geometry` reach.
    pub fn knows(&self, geometry: &Geometry) -> bool {
        places(geometry).eq(self.places.iter().copied())
    }
}

fn places(geometry: &Geometry) -> impl Iterator<Item = DVec3> {
    geometry.lights.iter().map(Light::place)
}

impl VisibilityGraph {
    /// Finds out which of `points`, those of the graph, the lights of `geometry` reach: in front of the
    /// point, and nothing between.
    pub fn look_at_lights(&mut self, geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) {
        self.lights = LightSight::look(geometry, points, tracer);
    }

    /// Whether light `light` reaches point `i`.
    pub fn lit(&self, light: usize, i: usize) -> bool {
        self.lights.lit(light, i)
    }

    /// Whether it is known what the lights of `geometry` reach.
    pub fn knows_lights(&self, geometry: &Geometry) -> bool {
        self.lights.knows(geometry)
    }
}

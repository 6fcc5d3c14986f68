//! What the lights of a scene without a body reach: a bit for every light and sample point; and through which panes
//! those from infinity do.
//!
//! That is geometry and costs one ray a pair, so it is found out with the graph, whether the graph is
//! built or read from a file, and no graph file keeps it.

use super::graph::{VisibilityGraph, stride_of};
use super::sky::SkySight;
use super::through::Passages;
use crate::geometry::SurfaceId;
use crate::points::SamplePoints;
use crate::scene::{Geometry, Light, LightKind};
use crate::tracers::{RayTracer, Segment};
use glam::DVec3;
use rayon::prelude::*;

/// Words of one task, 32 points each.
const CHUNK: usize = 128;

/// What sample points see of the lights of a scene and of its sky.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSight {
    /// Where the lights stood.
    places: Vec<DVec3>,
    /// A row for each light: point `i` is bit `i % 32` of word `i / 32`.
    words: Vec<u32>,
    /// Words of a row.
    stride: usize,
    /// By light: which points its light reaches through what [`Self::passages`] says; only of directional ones.
    passing: Vec<Vec<(u32, u16)>>,
    /// What the light of directional lights passes.
    pub passages: Passages,
    /// What points see of the sky.
    pub sky: SkySight,
}

impl LightSight {
    /// Finds out which of `points` the lights of `geometry` reach, in front of the point and nothing between, and what they
    /// see of the sky.
    pub fn look(geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) -> Self {
        let stride = stride_of(points.len());
        let mut sight = LightSight {
            places: places(geometry).collect(),
            words: vec![0u32; stride * geometry.lights.len()],
            stride,
            passing: Vec::new(),
            passages: Passages::default(),
            sky: SkySight::look(geometry, points, tracer),
        };
        let passes = geometry.pane.iter().any(|p| *p);
        for (light, row) in geometry.lights.iter().zip(sight.words.chunks_mut(stride.max(1))) {
            let directional = matches!(light.kind, LightKind::Directional { .. });
            let seen: Vec<Vec<(u32, Vec<SurfaceId>)>> = row
                .par_chunks_mut(CHUNK)
                .enumerate()
                .map(|(chunk, words)| {
                    look_at(
                        geometry,
                        light,
                        points,
                        tracer,
                        (32 * CHUNK * chunk, words),
                        passes && directional,
                    )
                })
                .collect();
            let numbered = seen.into_iter().flatten();
            let numbered = numbered.filter_map(|(i, list)| Some((i, sight.passages.number(&list)?)));
            sight.passing.push(numbered.collect());
        }
        sight
    }

    /// The points that light of directional light `light` reaches straight through surfaces, and the number of the list of
    /// these among [`Self::passages`].
    pub fn passing(&self, light: usize) -> &[(u32, u16)] {
        self.passing.get(light).map_or(&[], |passing| passing)
    }

    /// Whether light `light` reaches point `i`.
    pub fn lit(&self, light: usize, i: usize) -> bool {
        let LightSight { words, stride, .. } = self;
        i / 32 < *stride && words.get(light * stride + i / 32).is_some_and(|w| w >> (i % 32) & 1 == 1)
    }

    /// Ways through panes that count as blocked, because there are too many rows of panes to tell apart.
    pub fn lost(&self) -> u64 {
        self.passages.lost + self.sky.passages.lost
    }

    /// Whether it is known what the lights of `geometry` reach.
    pub fn knows(&self, geometry: &Geometry) -> bool {
        places(geometry).eq(self.places.iter().copied()) && self.sky.knows(geometry)
    }
}

/// Sets a bit in `words` for every point from `first` on that `light` reaches. Where that is asked for it returns
/// those that it reaches through surfaces, and these.
fn look_at(
    geometry: &Geometry,
    light: &Light,
    points: &SamplePoints,
    tracer: &dyn RayTracer,
    (first, words): (usize, &mut [u32]),
    passes: bool,
) -> Vec<(u32, Vec<SurfaceId>)> {
    let tolerance = geometry.plane_tolerance();
    let facing =
        |&i: &usize| light.height(points.position[i].as_dvec3(), points.normal[i].as_dvec3()) > tolerance;
    let facing: Vec<usize> = (first..(first + 32 * words.len()).min(points.len())).filter(facing).collect();
    let end = |i: usize| light.seen_from(points.position[i].as_dvec3()).end;
    let segment = |&i: &usize| Segment { from: points.position[i], to: end(i).as_vec3() };
    let segments: Vec<Segment> = facing.iter().map(segment).collect();
    let mut blocked = vec![false; segments.len()];
    tracer.occluded_batch(&segments, &mut blocked);
    let mut passing = Vec::new();
    for (i, blocked) in facing.into_iter().zip(blocked) {
        words[(i - first) / 32] |= u32::from(!blocked) << (i % 32);
        if blocked && passes {
            let walk = Passages::walk(geometry, tracer, points.position[i].as_dvec3(), end(i));
            passing.extend(walk.filter(|list| !list.is_empty()).map(|list| (i as u32, list)));
        }
    }
    passing
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

    /// What its points see of the lights and the sky.
    pub fn lights(&self) -> &LightSight {
        &self.lights
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

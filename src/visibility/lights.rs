//! What the point lights of a scene reach: a bit for every light and sample point.
//!
//! That is geometry and costs one ray a pair, so it is found out with the graph, whether the graph is
//! built or read from a file, and no graph file keeps it.

use super::graph::VisibilityGraph;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::{RayTracer, Segment};
use glam::DVec3;
use rayon::prelude::*;

/// Segments of one task.
const CHUNK: usize = 4096;

/// Which sample points each light reaches.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LightSight {
    /// Where the lights stood.
    positions: Vec<DVec3>,
    /// By light, then point.
    reached: Vec<bool>,
}

impl VisibilityGraph {
    /// Finds out which of `points`, those of the graph, the lights of `geometry` reach: in front of the
    /// point, and nothing between.
    pub fn look_at_lights(&mut self, geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) {
        let tolerance = geometry.plane_tolerance();
        let n = points.len();
        let mut sight = LightSight {
            positions: geometry.lights.iter().map(|l| l.position).collect(),
            reached: vec![false; n * geometry.lights.len()],
        };
        for (light, reached) in geometry.lights.iter().zip(sight.reached.chunks_mut(n.max(1))) {
            reached.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, reached)| {
                let mut facing = Vec::new();
                let mut segments = Vec::new();
                for lane in 0..reached.len() {
                    let i = chunk * CHUNK + lane;
                    let to_light = light.position - points.position[i].as_dvec3();
                    if points.normal[i].as_dvec3().dot(to_light) > tolerance {
                        facing.push(lane);
                        segments.push(Segment { from: points.position[i], to: light.position.as_vec3() });
                    }
                }
                let mut blocked = vec![false; segments.len()];
                tracer.occluded_batch(&segments, &mut blocked);
                facing.into_iter().zip(blocked).for_each(|(lane, blocked)| reached[lane] = !blocked);
            });
        }
        self.lights = sight;
    }

    /// Whether light `light` reaches point `i`.
    pub fn lit(&self, light: usize, i: usize) -> bool {
        let n = self.starts.last().map_or(0, |&n| n as usize);
        i < n && self.lights.reached.get(light * n + i).copied().unwrap_or(false)
    }

    /// Whether it is known what the lights of `geometry` reach.
    pub fn knows_lights(&self, geometry: &Geometry) -> bool {
        geometry.lights.iter().map(|l| l.position).eq(self.lights.positions.iter().copied())
    }
}

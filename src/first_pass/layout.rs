//! Sample points as the sweeps want them: in patches, side by side, in units of the scene's own size.

use super::diffuse::{LANES, Lanes};
use crate::points::SamplePoints;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Points of a patch at most: a row of bits is then one word.
pub const MAX_PATCH: usize = 64;

/// Points of one voxel: a run on one side of one surface, or several short ones.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Its points.
    pub points: Range<usize>,
    /// Its groups of lanes.
    pub groups: Range<usize>,
    /// The voxel that holds it.
    pub voxel: usize,
    /// Unit normal of the plane that holds all its points, and `normal · x` there; `None` where they
    /// lie in no plane.
    pub plane: Option<(DVec3, f64)>,
    /// Smallest and largest coordinates.
    pub bounds: [Vec3; 2],
    /// Largest area of its elements.
    pub largest: f32,
}

/// All points in patches. Lengths are in units of [`Layout::unit`], so that no scene is too large or too small
/// for fourth powers in `f32`; that is a power of two, so that it rounds nothing.
pub struct Layout {
    /// In the order of the points.
    pub patches: Vec<Patch>,
    /// The unit of length, m.
    pub unit: f32,
    /// By point.
    pub position: Vec<Vec3>,
    /// By point.
    pub normal: Vec<Vec3>,
    /// By point.
    pub area: Vec<f32>,
    /// The same by groups of lanes; every patch is filled up with points without area.
    pub lane_position: [Vec<Lanes>; 3],
    /// Normals by groups of lanes.
    pub lane_normal: [Vec<Lanes>; 3],
    /// Areas by groups of lanes.
    pub lane_area: Vec<Lanes>,
    /// How far each point stands in front of its patch's plane, which is by rounding; by point.
    pub lift: Vec<f32>,
    /// The same by groups of lanes.
    pub lane_lift: Vec<Lanes>,
}

impl Patch {
    /// Signed distance of `p` from the plane, positive in front; 0 where there is no plane.
    pub fn height(&self, p: Vec3) -> f64 {
        self.plane.map_or(0.0, |(normal, offset)| normal.dot(p.as_dvec3()) - offset)
    }

    /// Square of the distance between the bounds of two patches.
    pub fn distance2(&self, other: &Patch) -> f32 {
        let ([low, high], [other_low, other_high]) = (self.bounds, other.bounds);
        (low - other_high).max(other_low - high).max(Vec3::ZERO).length_squared()
    }
}

impl Layout {
    /// Of `points` of a scene of the given `radius`; points within `flat` of a plane lie in it, m. Runs shorter than
    /// `short` that follow each other share a patch.
    pub fn new(points: &SamplePoints, radius: f64, flat: f64, short: usize) -> Self {
        let unit = (radius.clamp(1e-30, 1e30).log2().ceil() as i32).clamp(-100, 100);
        let unit = 2.0f32.powi(unit);
        let mut layout = Layout {
            patches: Vec::new(),
            unit,
            position: points.position.iter().map(|p| *p / unit).collect(),
            normal: points.normal.clone(),
            area: points.area.iter().map(|a| a / unit / unit).collect(),
            lane_position: [const { Vec::new() }; 3],
            lane_normal: [const { Vec::new() }; 3],
            lane_area: Vec::new(),
            lift: Vec::with_capacity(points.len()),
            lane_lift: Vec::new(),
        };
        for voxel in 0..points.voxels() {
            let range = points.voxel(voxel);
            let side = |j: usize| (points.surface[j], points.side[j]);
            let mut first = range.start;
            // The short runs that wait for more of their kind.
            let mut waiting = first;
            for i in range.clone() {
                if i + 1 < range.end && side(i + 1) == side(first) && i + 1 - first < MAX_PATCH {
                    continue;
                }
                let long = i + 1 - first >= short;
                if waiting < first && (long || i + 1 - waiting > MAX_PATCH) {
                    layout.push(waiting..first, voxel, flat / f64::from(unit));
                    waiting = first;
                }
                if long || i + 1 == range.end {
                    layout.push(waiting..i + 1, voxel, flat / f64::from(unit));
                    waiting = i + 1;
                }
                first = i + 1;
            }
        }
        layout
    }

    fn push(&mut self, points: Range<usize>, voxel: usize, flat: f64) {
        let start = self.lane_area.len();
        let (positions, normals) = (&self.position[points.clone()], &self.normal[points.clone()]);
        let normal = normals[0].as_dvec3();
        let heights: Vec<f64> = positions.iter().map(|p| normal.dot(p.as_dvec3())).collect();
        let offset = heights.iter().sum::<f64>() / positions.len() as f64;
        let planar =
            normals.iter().all(|n| *n == normals[0]) && heights.iter().all(|h| (h - offset).abs() <= flat);
        self.lift.extend(heights.iter().map(|h| (h - offset) as f32));
        let low = positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let largest = self.area[points.clone()].iter().copied().fold(0.0, f32::max);
        for first in points.clone().step_by(LANES) {
            let group = first..(first + LANES).min(points.end);
            // What fills up a group stands where its first point does.
            let at = |lane: usize| if first + lane < group.end { first + lane } else { first };
            for axis in 0..3 {
                self.lane_position[axis].push(std::array::from_fn(|lane| self.position[at(lane)][axis]));
                self.lane_normal[axis].push(std::array::from_fn(|lane| self.normal[at(lane)][axis]));
            }
            self.lane_lift.push(std::array::from_fn(|lane| self.lift[at(lane)]));
            self.lane_area.push(std::array::from_fn(|lane| {
                if first + lane < group.end { self.area[first + lane] } else { 0.0 }
            }));
        }
        self.patches.push(Patch {
            points,
            groups: start..self.lane_area.len(),
            voxel,
            plane: planar.then_some((normal, offset)),
            bounds: [low, high],
            largest,
        });
    }
}

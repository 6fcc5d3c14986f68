//! What sample points see of the sky.
//!
//! That is geometry: for every point and every patch of directions the projected solid angle of what nothing hides,
//! apart by the panes that stand in the way, since they let light through. It is found
//! out with the graph, and no graph file keeps it. Whatever light a sky gives, no ray is cast again.

use super::patches::Patches;
use super::through::Passages;
use crate::geometry::SurfaceId;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::{RayTracer, Segment};
use glam::DVec3;
use rayon::prelude::*;

/// Cells along either side of a patch that are asked first, and where the answer differs from one to the next.
const COARSE: u32 = 2;
const FINE: u32 = 8;

/// So many points look before what they saw gets its numbers: with its lists of surfaces it takes several times the memory.
const CHUNK: usize = 4096;

/// Part of a patch that a place sees.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyPart {
    /// Which patch.
    pub patch: u16,
    /// What it is seen through: [`Passages`] number.
    pub passage: u16,
    /// ∫ cos θ dω over it, sr.
    pub factor: f32,
}

/// What sample points see of the sky.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SkySight {
    /// The patches; `None` without a sky.
    pub patches: Option<Patches>,
    /// What light passes.
    pub passages: Passages,
    /// Zenith when it was looked for.
    up: Option<DVec3>,
    /// Where the parts of each point end.
    ends: Vec<usize>,
    parts: Vec<SkyPart>,
}

/// Looks for the sky.
pub struct SkyGaze<'a> {
    geometry: &'a Geometry,
    tracer: &'a dyn RayTracer,
    patches: &'a Patches,
    fine: u32,
    /// Whether light may pass anything.
    passes: bool,
}

/// What a place sees through the surfaces of each list.
pub type Seen = Vec<(u16, Vec<SurfaceId>, f32)>;

impl<'a> SkyGaze<'a> {
    /// Cells along either side of a patch over which its radiance is averaged.
    pub const CELLS: u32 = 6;

    /// Asks `finer` times as many cells along a side where something begins to hide the sky.
    pub fn new(geometry: &'a Geometry, tracer: &'a dyn RayTracer, patches: &'a Patches, finer: u32) -> Self {
        let passes = geometry.pane.iter().any(|p| *p);
        SkyGaze { geometry, tracer, patches, fine: FINE * finer, passes }
    }

    /// What is seen from `position` in front of `normal`, by patch and by the surfaces in the way.
    pub fn at(&self, position: DVec3, normal: DVec3) -> Seen {
        let all = self.patches.all();
        let faces: Vec<usize> =
            (0..all.len()).filter(|&p| normal.dot(all[p].middle) > -all[p].radius.sin()).collect();
        let coarse = self.ask(position, normal, &faces, COARSE);
        // What the first cell of a patch sees, and whether all others see the same.
        let mut first: Vec<Option<&Option<Vec<SurfaceId>>>> = vec![None; all.len()];
        let mut even = vec![true; all.len()];
        for (cells, &p) in coarse.chunks(COARSE.pow(2) as usize).zip(&faces) {
            first[p] = Some(&cells[0]);
            even[p] = cells.iter().all(|c| *c == cells[0]);
        }
        let same =
            |p: usize, q: u16| first[q as usize].is_none_or(|f| even[q as usize] && Some(f) == first[p]);
        let (mut whole, mut mixed) = (Vec::new(), Vec::new());
        for &p in &faces {
            let cut = normal.dot(all[p].middle) < all[p].radius.sin() && first[p] != Some(&None);
            let alike = !cut && even[p] && all[p].neighbours.iter().all(|&q| same(p, q));
            if alike { whole.push(p) } else { mixed.push(p) }
        }
        let mut seen = Seen::new();
        for p in whole {
            if let Some(Some(through)) = first[p] {
                seen.push((p as u16, through.clone(), normal.dot(all[p].vector) as f32));
            }
        }
        let fine = self.ask(position, normal, &mixed, self.fine);
        for (cells, &p) in fine.chunks(self.fine.pow(2) as usize).zip(&mixed) {
            let cosines: Vec<f64> =
                self.patches.cells(p, self.fine).map(|d| normal.dot(d).max(0.0)).collect();
            let each = self.patches.solid_angle(p) / f64::from(self.fine.pow(2));
            let from = seen.len();
            for (through, cosine) in cells.iter().zip(cosines) {
                let Some(through) = through else { continue };
                let factor = (each * cosine) as f32;
                match seen[from..].iter_mut().find(|(_, known, _)| known == through) {
                    Some((.., sum)) => *sum += factor,
                    None => seen.push((p as u16, through.clone(), factor)),
                }
            }
        }
        seen.retain(|(.., factor)| *factor > 0.0);
        seen.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
        seen
    }

    /// For `n` x `n` cells of each of `patches`: the surfaces in the way, or `None` where something hides the sky.
    fn ask(&self, position: DVec3, normal: DVec3, patches: &[usize], n: u32) -> Vec<Option<Vec<SurfaceId>>> {
        let directions: Vec<DVec3> = patches.iter().flat_map(|&p| self.patches.cells(p, n)).collect();
        let above: Vec<usize> = (0..directions.len()).filter(|&k| normal.dot(directions[k]) > 1e-4).collect();
        let far = position.length() + 1.01 * self.geometry.radius;
        let end = |k: usize| position + far * directions[k];
        let mut answers = vec![None; directions.len()];
        if self.passes {
            let ways = above.iter().map(|&k| (position, end(k)));
            let walked = Passages::walk_all(self.geometry, self.tracer, ways);
            above.iter().zip(walked).for_each(|(&k, list)| answers[k] = list);
            return answers;
        }
        let segments: Vec<Segment> =
            above.iter().map(|&k| Segment { from: position.as_vec3(), to: end(k).as_vec3() }).collect();
        let mut blocked = vec![false; segments.len()];
        self.tracer.occluded_batch(&segments, &mut blocked);
        for (&k, _) in above.iter().zip(blocked).filter(|(_, blocked)| !blocked) {
            answers[k] = Some(Vec::new());
        }
        answers
    }
}

impl SkySight {
    /// Finds out what `points` see of the sky of `geometry`, if it has one.
    pub fn look(geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) -> Self {
        let Some(up) = geometry.zenith else { return SkySight::default() };
        let patches = Patches::new(up);
        let gaze = SkyGaze::new(geometry, tracer, &patches, 1);
        let at = |i: usize| gaze.at(points.position[i].as_dvec3(), points.normal[i].as_dvec3());
        let (mut passages, mut ends, mut parts) = (Passages::default(), Vec::new(), Vec::new());
        for first in (0..points.len()).step_by(CHUNK) {
            let chunk = first..(first + CHUNK).min(points.len());
            let seen: Vec<Seen> = chunk.into_par_iter().map(at).collect();
            for point in seen {
                for (patch, through, factor) in point {
                    if let Some(passage) = passages.number(&through) {
                        parts.push(SkyPart { patch, passage, factor });
                    }
                }
                ends.push(parts.len());
            }
        }
        SkySight { patches: Some(patches), passages, up: Some(up), ends, parts }
    }

    /// What point `i` sees, patch by patch.
    pub fn of(&self, i: usize) -> &[SkyPart] {
        let Some(&end) = self.ends.get(i) else { return &[] };
        &self.parts[if i == 0 { 0 } else { self.ends[i - 1] }..end]
    }

    /// Whether it is known what is seen of the sky of `geometry`.
    pub fn knows(&self, geometry: &Geometry) -> bool {
        self.up == geometry.zenith
    }
}

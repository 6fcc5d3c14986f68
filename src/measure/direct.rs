//! Light that comes straight from emitting surfaces and lights without a body.

use super::cell::{Cell, sides};
use super::place::Place;
use super::settings::MeasureSettings;
use crate::geometry::SurfaceId;
use crate::second_pass::LitScene;
use crate::tracers::{RayTracer, Segment};
use crate::visibility::{Patches, SkyGaze};
use glam::Vec3;

/// Cells of an emitter wider than this are divided before anything is asked, rad: with [`RAYS`] rays
/// along each way nothing broader than 0.6 degrees can slip between.
const WIDEST: f64 = 0.03;
/// Rays along either way of a cell.
const RAYS: usize = 3;
/// A sensor looks for the sky so many times as finely as a sample point.
const SKY_FINER: u32 = 3;
/// No cell is divided more often.
const DEEPEST: u8 = 12;

/// All emitters of a scene.
pub(super) struct Direct<'a> {
    scene: &'a LitScene<'a>,
    tracer: &'a dyn RayTracer,
    tolerance: f64,
    emitters: Vec<Cell<'a>>,
    /// Directions in which a sky is looked for.
    sky: Option<Patches>,
}

impl<'a> Direct<'a> {
    /// Of `scene`.
    pub fn new(scene: &'a LitScene<'a>, tracer: &'a dyn RayTracer, settings: &MeasureSettings) -> Self {
        let sky = scene.geometry.zenith.map(Patches::new);
        Direct { scene, tracer, tolerance: settings.shadow_tolerance, emitters: emitters(scene), sky }
    }

    /// E, `[W]`.
    pub fn at(&self, place: &Place) -> Vec<f64> {
        let mut irradiance = vec![0.0; self.scene.appearance.wavelengths.len()];
        for emitter in self.emitters.iter().filter(|e| e.faces(self.scene.geometry, place)) {
            let seen = self.seen(place, emitter);
            let emission = &self.scene.appearance.of(emitter.surface).emission;
            irradiance.iter_mut().zip(emission).for_each(|(e, l)| *e += seen * f64::from(*l));
        }
        for (light, intensity) in self.scene.geometry.lights.iter().zip(&self.scene.appearance.lights) {
            let (way, height) = (light.seen_from(place.position), light.height(place.position, place.normal));
            if height > 0.0 && !self.blocked(&[place.segment(way.end.as_vec3())])[0] {
                let share = way.share * place.normal.dot(way.direction);
                irradiance.iter_mut().zip(intensity).for_each(|(e, i)| *e += share * f64::from(*i));
            }
        }
        self.add_sky(place, &mut irradiance);
        irradiance
    }

    /// Adds the light of the sky, where nothing at all is in the way.
    fn add_sky(&self, place: &Place, irradiance: &mut [f64]) {
        let (Some(patches), Some(sky)) = (&self.sky, &self.scene.appearance.sky) else { return };
        let gaze = SkyGaze::new(self.scene.geometry, self.tracer, patches, SKY_FINER);
        for (p, through, factor) in gaze.at(place.position, place.normal) {
            if through.is_empty() {
                let seen = sky.mean(patches.cells(p.into(), SkyGaze::CELLS));
                irradiance.iter_mut().zip(seen).for_each(|(e, l)| *e += f64::from(factor * l));
            }
        }
    }

    fn blocked(&self, segments: &[Segment]) -> Vec<bool> {
        let mut blocked = vec![false; segments.len()];
        self.tracer.occluded_batch(segments, &mut blocked);
        blocked
    }

    /// Projected solid angle of what is seen of an emitter, sr: all rays at once, one level of
    /// division after the other.
    fn seen(&self, place: &Place, emitter: &Cell) -> f64 {
        let least = self.tolerance * emitter.factor(place);
        let mut level = vec![*emitter];
        let mut seen = 0.0;
        while !level.is_empty() {
            let mut next = Vec::new();
            let mut asked: Vec<(Cell, f64, usize)> = Vec::new();
            let mut segments = Vec::new();
            for cell in level {
                let factor = cell.factor(place);
                if factor <= 0.0 {
                    continue;
                }
                if cell.depth < DEEPEST && factor > least && cell.extent(place) > WIDEST {
                    next.extend(cell.divide());
                    continue;
                }
                let first = segments.len();
                segments.extend(
                    aims(&cell).filter(|&p| place.height(p.as_dvec3()) > 0.0).map(|p| place.segment(p)),
                );
                asked.push((cell, factor, first));
            }
            let blocked = self.blocked(&segments);
            for (at, (cell, factor, first)) in asked.iter().enumerate() {
                let end = asked.get(at + 1).map_or(blocked.len(), |next| next.2);
                let open = blocked[*first..end].iter().filter(|b| !**b).count();
                if open > 0 && open < end - first && *factor > least && cell.depth < DEEPEST {
                    next.extend(cell.divide());
                } else if open > 0 {
                    seen += factor * open as f64 / (end - first) as f64;
                }
            }
            level = next;
        }
        seen
    }
}

/// Where rays go in a cell.
fn aims<'c>(cell: &'c Cell<'_>) -> impl Iterator<Item = Vec3> + 'c {
    let at = |k: usize| (k as f32 + 0.5) / RAYS as f32;
    (0..RAYS * RAYS).map(move |k| cell.at(at(k % RAYS), at(k / RAYS)))
}

/// The emitting sides of all surfaces.
pub(super) fn emitters<'a>(scene: &LitScene<'a>) -> Vec<Cell<'a>> {
    let emits = |&s: &SurfaceId| scene.appearance.of(s).emission.iter().any(|&l| l > 0.0);
    let geometry = scene.geometry;
    let whole = |s| sides(geometry, s).map(move |side| Cell::whole(geometry, s, side));
    (0..geometry.surfaces.len() as u32).map(SurfaceId).filter(emits).flat_map(whole).collect()
}

//! Light that reaches a sensor over mirrors, gloss and glass: rays to all specular surfaces, from where
//! they go on as in the second pass. Rays never meet a point light; [`super::mirrored`] sees to those.

use super::cell::Cell;
use super::diffuse::element;
use super::images::{Emitters, Images};
use super::mirrored::Mirrored;
use super::place::Place;
use super::settings::MeasureSettings;
use crate::geometry::{Ray, Side, SurfaceId};
use crate::points::SamplePoints;
use crate::second_pass::{DiffuseField, LitScene, Probe};
use crate::tracers::RayTracer;
use std::collections::BTreeMap;

/// No element is divided more often.
const DEEPEST: u8 = 10;

/// All specular surfaces.
pub(super) struct Specular<'a> {
    scene: &'a LitScene<'a>,
    tracer: &'a dyn RayTracer,
    probe: Probe<'a>,
    mirrored: Mirrored<'a>,
    emitters: Emitters<'a>,
    rays: f64,
    elements: Vec<Cell<'a>>,
}

impl<'a> Specular<'a> {
    /// Of the elements of `points`; `field` is the first pass's solution anywhere between them.
    pub fn new(
        scene: &'a LitScene<'a>,
        points: &'a SamplePoints,
        tracer: &'a dyn RayTracer,
        settings: &MeasureSettings,
        field: &'a DiffuseField<'a>,
    ) -> Self {
        let is_specular = |&i: &usize| scene.appearance.of(points.surface[i]).is_specular();
        Specular {
            scene,
            tracer,
            probe: Probe::new(scene, field),
            mirrored: Mirrored::new(scene, tracer),
            emitters: Emitters::new(scene),
            rays: f64::from(settings.specular_rays),
            elements: (0..points.len()).filter(is_specular).map(|i| element(points, i)).collect(),
        }
    }

    /// E, `[W]`.
    pub fn at(&self, place: &Place) -> Vec<f64> {
        let (aims, total) = self.aims(place);
        if aims.is_empty() {
            return vec![0.0; self.scene.appearance.wavelengths.len()];
        }
        let rays: Vec<Ray> = aims.iter().map(|aim| aim.1).collect();
        // The mean weight is 1.
        let mean = total / rays.len() as f64;
        let weights: Vec<f32> = aims.iter().map(|aim| (aim.2 / mean) as f32).collect();
        let mut irradiance = self.probe.specular(self.tracer, &rays, &weights);
        irradiance.iter_mut().for_each(|e| *e *= mean);
        self.mirrored.add(place, &aims, &mut irradiance);
        irradiance
    }

    /// The pieces of specular elements that the sensor sees, each with a ray to it and its projected
    /// solid angle, sr; and the sum of these before anything was hidden.
    fn aims(&self, place: &Place) -> (Vec<(Cell<'a>, Ray, f64)>, f64) {
        let geometry = self.scene.geometry;
        let facing = |cell: &Cell<'a>| cell.faces(geometry, place).then(|| (*cell, cell.factor(place)));
        let mut left: Vec<(Cell<'a>, f64)> = self.elements.iter().filter_map(facing).collect();
        let total: f64 = left.iter().map(|(_, factor)| factor).sum();
        let most = total / self.rays;
        let mut images: BTreeMap<(SurfaceId, Side), Images> = BTreeMap::new();
        let mut aims = Vec::new();
        while let Some((cell, factor)) = left.pop() {
            let shown = images
                .entry((cell.surface, cell.side))
                .or_insert_with(|| self.emitters.images(self.scene, place, cell.surface, cell.side));
            if cell.depth < DEEPEST && (factor > most || shown.divide(place, &cell, factor)) {
                left.extend(cell.divide().iter().filter_map(facing));
            } else if factor > 0.0 {
                let way = cell.spread(aims.len()).as_dvec3() - place.position;
                let ray = Ray {
                    origin: place.position,
                    direction: way.normalize(),
                    t_min: 0.0,
                    t_max: f64::INFINITY,
                };
                aims.push((cell, ray, factor));
            }
        }
        let rays: Vec<Ray> = aims.iter().map(|aim| aim.1).collect();
        let mut hits = vec![None; rays.len()];
        self.tracer.closest_batch(&rays, &mut hits);
        let seen = |cell: &Cell, hit: &Option<crate::geometry::Hit>| {
            hit.is_some_and(|hit| hit.surface == cell.surface && hit.side == cell.side)
        };
        let aims = aims.into_iter().zip(&hits).filter(|(aim, hit)| seen(&aim.0, hit)).map(|(aim, _)| aim);
        (aims.collect(), total)
    }
}

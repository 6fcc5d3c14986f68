//! Light that surfaces reflect diffusely, gathered over the sensor's hemisphere.

use super::cell::{Cell, on_surface};
use super::place::Place;
use super::settings::MeasureSettings;
use crate::points::SamplePoints;
use crate::second_pass::{DiffuseField, LitScene};
use crate::tracers::RayTracer;
use glam::Vec3;

/// No element is divided more often.
const DEEPEST: u8 = 10;
/// Elements that the sensor's plane cuts are divided so much finer, since a ray to their middle may
/// miss the part in front.
const CUT: f64 = 0.25;

/// All elements that reflect diffusely.
pub(super) struct Diffuse<'a> {
    scene: &'a LitScene<'a>,
    tracer: &'a dyn RayTracer,
    field: &'a DiffuseField<'a>,
    /// Wider than this an element is divided, rad.
    widest: f64,
    elements: Vec<Cell<'a>>,
}

impl<'a> Diffuse<'a> {
    /// The elements of `points`; `field` is the first pass's solution anywhere between them.
    pub fn new(
        scene: &'a LitScene<'a>,
        points: &'a SamplePoints,
        tracer: &'a dyn RayTracer,
        settings: &MeasureSettings,
        field: &'a DiffuseField<'a>,
    ) -> Self {
        let reflects = |&i: &usize| scene.appearance.of(points.surface[i]).diffuse.iter().any(|&r| r > 0.0);
        let elements = (0..points.len()).filter(reflects).map(|i| element(points, i)).collect();
        // A square of solid angle w seen from its front is sqrt(2 w) across.
        Diffuse { scene, tracer, field, widest: (2.0 * settings.max_solid_angle).sqrt(), elements }
    }

    /// E, `[W]`.
    pub fn at(&self, place: &Place) -> Vec<f64> {
        let geometry = self.scene.geometry;
        let mut cells = Vec::new();
        let mut left: Vec<Cell> = Vec::new();
        for element in self.elements.iter().filter(|e| e.faces(geometry, place)) {
            left.push(*element);
            while let Some(cell) = left.pop() {
                let widest = if cell.is_cut(place) { CUT * self.widest } else { self.widest };
                if cell.depth < DEEPEST && cell.extent(place) > widest {
                    left.extend(cell.divide().into_iter().filter(|c| c.faces(geometry, place)));
                } else {
                    cells.push(cell);
                }
            }
        }
        // Not all in the middle: along an edge that hides rows of cells, middles fall on one side together.
        let aims: Vec<Vec3> = cells.iter().enumerate().map(|(k, cell)| cell.spread(k)).collect();
        let segments: Vec<_> = aims.iter().map(|&aim| place.segment(aim)).collect();
        let mut blocked = vec![false; cells.len()];
        self.tracer.occluded_batch(&segments, &mut blocked);
        let w = self.scene.appearance.wavelengths.len();
        let (mut irradiance, mut radiance) = (vec![0.0; w], vec![0.0f32; w]);
        for ((cell, aim), _) in cells.iter().zip(aims).zip(blocked).filter(|(_, blocked)| !blocked) {
            let factor = cell.factor(place);
            self.field.radiance(cell.surface, cell.side, on_surface(geometry, cell, aim), &mut radiance);
            let emission = &self.scene.appearance.of(cell.surface).emission;
            for ((sum, l), e) in irradiance.iter_mut().zip(&radiance).zip(emission) {
                *sum += factor * f64::from((l - e).max(0.0));
            }
        }
        irradiance
    }
}

/// The element of point `i`.
pub(super) fn element(points: &SamplePoints, i: usize) -> Cell<'_> {
    let piece = points.round(i);
    Cell { corners: points.corners[i], piece, surface: points.surface[i], side: points.side[i], depth: 0 }
}

//! Light that reaches a sensor over mirrors, gloss and glass.

use super::place::Place;
use super::settings::MeasureSettings;
use crate::points::SamplePoints;
use crate::second_pass::{DiffuseField, LitScene};
use crate::tracers::RayTracer;

/// All specular surfaces.
pub(super) struct Specular<'a> {
    scene: &'a LitScene<'a>,
}

impl<'a> Specular<'a> {
    /// Of the elements of `points`.
    pub fn new(
        scene: &'a LitScene,
        _points: &SamplePoints,
        _tracer: &'a dyn RayTracer,
        _settings: &MeasureSettings,
        _field: &'a DiffuseField<'a>,
    ) -> Self {
        Specular { scene }
    }

    /// E, `[W]`.
    pub fn at(&self, _place: &Place) -> Vec<f64> {
        vec![0.0; self.scene.appearance.wavelengths.len()]
    }
}

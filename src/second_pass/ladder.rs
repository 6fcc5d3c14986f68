//! The rungs of the second pass: where the diffuse light at a hit comes from.
//!
//! What the first pass found at a point has four parts: what it emits, and what it reflects of light straight from
//! lamps, of light over mirrors and glass, and of light from diffuse surfaces. The rung `interpolate` takes all from
//! there, `direct` asks lamps for the second, and `gather` the hemisphere for the fourth as well. No part is taken twice.
//! Where a ray over the hemisphere ends it takes what `direct` would: between sample points the first pass knows shadows
//! of lamps too coarsely.

use super::LitScene;
use super::direct::Direct;
use super::interpolate::DiffuseField;
use super::settings::{Rung, SecondPassSettings};
use crate::error::{Error, Result};
use crate::tracers::RayTracer;

/// Hemisphere rays that end nearby, one after the other, and go on gathering; the next takes what the first pass has.
pub(super) const NEAR_BOUNCES: u32 = 3;

/// A hemisphere ray ends nearby when it is no longer than this many times the distance between the sample points it
/// meets: closer up the first pass knows their light too coarsely.
pub(super) const NEARBY: f64 = 2.0;

/// What a rung takes from the first pass.
pub(super) struct Fields<'a> {
    /// At a hit.
    near: DiffuseField<'a>,
    /// Where a hemisphere ray ends.
    far: Option<DiffuseField<'a>>,
}

/// Where light comes from on one rung.
pub(super) struct Ladder<'a> {
    /// What is taken from the first pass at a hit.
    pub near: &'a DiffuseField<'a>,
    /// What a hemisphere ray takes from the first pass where it ends.
    pub far: Option<&'a DiffuseField<'a>>,
    /// Whether what is taken at a hit leaves out what it emits and reflects of light straight from lamps.
    pub lamps_apart: bool,
    /// Lamps, to be asked.
    pub direct: Option<Direct<'a>>,
}

impl<'a> Ladder<'a> {
    /// What is taken from the first pass at a hit, or far away by a hemisphere ray.
    #[inline(always)]
    pub fn field(&self, far: bool) -> &'a DiffuseField<'a> {
        self.far.filter(|_| far).unwrap_or(self.near)
    }
}

impl<'a> Fields<'a> {
    /// Those of `rung`.
    ///
    /// # Errors
    /// [`Error::Settings`] where the first pass did not keep its parts apart.
    pub fn new(scene: &LitScene<'a>, rung: Rung) -> Result<Self> {
        let (solution, interpolator) = (scene.solution, scene.interpolator);
        let w = solution.wavelengths.len();
        if rung == Rung::Interpolate {
            return Ok(Fields { near: interpolator.field(solution), far: None });
        }
        let Some(parts) = &solution.parts else {
            let message =
                "the first pass did not keep direct light apart: solve it with `parts`, or interpolate";
            return Err(Error::Settings(message.into()));
        };
        let without = |all: &[f32], part: &[f32]| -> Vec<f32> {
            all.iter().zip(part).map(|(all, part)| (all - part).max(0.0)).collect()
        };
        let reflected = without(&solution.radiance, &parts.emission);
        let indirect = interpolator.field_of(without(&reflected, &parts.direct), w);
        Ok(match rung {
            Rung::Gather => {
                Fields { near: interpolator.field_of(parts.specular.clone(), w), far: Some(indirect) }
            }
            _ => Fields { near: indirect, far: None },
        })
    }

    /// Their part of the key of an image.
    pub fn hash(&self, hasher: &mut blake3::Hasher) {
        self.near.hash(hasher);
        self.far.iter().for_each(|far| far.hash(hasher));
    }

    /// The rung that `settings` ask for; `bright` tells how bright a spectrum is.
    pub fn ladder(
        &'a self,
        scene: &LitScene<'a>,
        tracer: &'a dyn RayTracer,
        settings: &SecondPassSettings,
        bright: impl Fn(&[f32]) -> f64,
    ) -> Ladder<'a> {
        let asked = (settings.lamp_samples, settings.rung != Rung::Interpolate);
        let direct = Direct::new((scene.geometry, scene.appearance), tracer, asked, bright);
        Ladder { near: &self.near, far: self.far.as_ref(), lamps_apart: asked.1, direct }
    }
}

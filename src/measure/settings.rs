//! How carefully sensors look.

use crate::error::{Error, Result};

/// How carefully sensors look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasureSettings {
    /// A part of an emitter that is partly hidden is divided until it would give less than this share of
    /// what the whole emitter would give unhidden.
    pub shadow_tolerance: f64,
    /// Elements that reflect diffusely are divided until they subtend less than about this, sr.
    pub max_solid_angle: f64,
    /// Rays sent to specular surfaces from one sensor, about.
    pub specular_rays: u32,
}

impl Default for MeasureSettings {
    fn default() -> Self {
        MeasureSettings { shadow_tolerance: 1e-3, max_solid_angle: 0.001, specular_rays: 4096 }
    }
}

impl MeasureSettings {
    /// An [`Error::Settings`] that says what to change, if anything.
    pub fn check(&self) -> Result<()> {
        let share = |name: &str, x: f64| {
            if (1e-6..=1.0).contains(&x) {
                Ok(())
            } else {
                Err(Error::Settings(format!("{name} is {x}: it must lie between 1e-6 and 1")))
            }
        };
        share("a sensor's shadow tolerance", self.shadow_tolerance)?;
        share("a sensor's largest solid angle, sr,", self.max_solid_angle)?;
        if !(1..=16384).contains(&self.specular_rays) {
            return Err(Error::Settings(format!(
                "specular rays are {}: it must be 1 to 16384",
                self.specular_rays
            )));
        }
        Ok(())
    }
}

//! Point lights: where they stand belongs to the geometry, how much they give to the appearance.

use crate::spectrum::{Spectrum, Wavelengths, luminance_of};
use glam::DVec3;
use std::f64::consts::PI;

/// A light without extent. It has no body: nothing sees it but what it lights.
#[derive(Clone, Debug, PartialEq)]
pub struct PointLight {
    /// Its name in the scene file.
    pub name: String,
    /// Where it stands, relative to the scene's centre, m.
    pub position: DVec3,
    /// How its intensity depends on direction.
    pub distribution: Distribution,
}

/// How the intensity of a point light depends on direction, 1 where it is largest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distribution {
    /// The same everywhere.
    Isotropic,
    /// I = I₀ cos θ about an axis, nothing behind.
    Lambertian {
        /// Where I₀ goes, unit.
        axis: DVec3,
    },
}

impl Distribution {
    /// Intensity towards `to` (unit) over the largest.
    pub fn towards(&self, to: DVec3) -> f64 {
        match self {
            Distribution::Isotropic => 1.0,
            Distribution::Lambertian { axis } => axis.dot(to).max(0.0),
        }
    }

    /// Flux over the largest intensity, sr.
    pub fn solid_angle(&self) -> f64 {
        match self {
            Distribution::Isotropic => 4.0 * PI,
            Distribution::Lambertian { .. } => PI,
        }
    }
}

/// What a point light gives.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSource {
    /// Spectral shape.
    pub spectrum: Spectrum,
    /// How much.
    pub level: LightLevel,
}

/// How much light a point light gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightLevel {
    /// Luminous flux in all directions together, lm.
    LuminousFlux(f64),
    /// Largest luminous intensity, cd.
    LuminousIntensity(f64),
}

impl LightSource {
    /// What makes the spectrum the largest intensity, W sr⁻¹ nm⁻¹; not negative.
    pub fn factor(&self, distribution: &Distribution) -> f64 {
        let intensity = match self.level {
            LightLevel::LuminousFlux(flux) => flux / distribution.solid_angle(),
            LightLevel::LuminousIntensity(intensity) => intensity,
        };
        let factor = intensity / luminance_of(&self.spectrum);
        if factor.is_finite() { factor.max(0.0) } else { 0.0 }
    }

    /// Largest spectral intensity at `wavelengths`, W sr⁻¹ nm⁻¹: `[W]`, finite and not negative. The
    /// luminous amount is met exactly by the weights of `wavelengths`.
    pub fn sample(&self, distribution: &Distribution, wavelengths: &Wavelengths) -> Vec<f32> {
        let factor = self.factor(distribution);
        let stored = |s: f64| ((factor * s).max(0.0) as f32).min(f32::MAX);
        wavelengths.sample_emission(&self.spectrum).into_iter().map(stored).collect()
    }
}

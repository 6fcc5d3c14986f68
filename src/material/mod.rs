//! Materials: what a surface does with light, as functions of wavelength and as sampled for a run.

mod albedo;
pub mod fresnel;
pub mod glass;
pub mod microfacet;
mod sampled;
mod table;

pub use albedo::{AlbedoTable, directional_albedo};
pub use sampled::{SampledMaterial, Spread, Transmission};
pub use table::{DEFAULT_ENTRIES, FresnelTable, PAPER_ENTRIES, TableError, table_error};

use crate::spectrum::Spectrum;

/// A material of the scene, with spectra as functions of wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the scene file.
    pub name: String,
    /// What it does with the light that falls on it.
    pub body: Body,
    /// What it emits, if anything.
    pub emission: Option<Emission>,
}

impl Material {
    /// Whether its surfaces reflect or transmit specularly.
    pub fn is_specular(&self) -> bool {
        match self.body {
            Body::Opaque { s, .. } => s > 0.0,
            Body::Pane { .. } | Body::Solid { .. } => true,
        }
    }
}

/// What a material does with the light that falls on it.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// R = s R^s + d R^d with d = 1 - s (section 2.2).
    Opaque {
        /// Share of the specular part, 0 to 1.
        s: f64,
        /// Beckmann roughness, 0 for a perfect mirror.
        m: f64,
        /// π R^d, the diffuse albedo; `None`: F(λ, 0), as in the paper.
        diffuse: Option<Spectrum>,
        /// The Fresnel factor of the specular part.
        fresnel: Fresnel,
    },
    /// A thin sheet with parallel faces: light goes straight through (ideal, s = 1).
    Pane {
        /// Refractive index of the sheet.
        n: Spectrum,
        /// Internal transmittance at normal incidence, surfaces not included, 0 to 1.
        transmittance: Spectrum,
    },
    /// The boundary of a closed solid whose inside is behind the surface (ideal, s = 1).
    Solid {
        /// Refractive index of the inside; outside is 1.
        n: Spectrum,
        /// Absorption coefficient of the inside, 1/m (Beer-Lambert).
        absorption: Spectrum,
    },
}

/// The two methods of the paper's appendix.
#[derive(Clone, Debug, PartialEq)]
pub enum Fresnel {
    /// First method: F(λ, 0) measured at normal incidence, its angular course from one index.
    Scaled {
        /// F(λ, 0).
        normal: Spectrum,
        /// Real part of the index at 589 nm.
        n: f64,
        /// Imaginary part of the index at 589 nm.
        k: f64,
    },
    /// Second method: the complex index n + ik at every wavelength.
    Index {
        /// Real part.
        n: Spectrum,
        /// Imaginary part, >= 0.
        k: Spectrum,
    },
}

/// Light that a surface emits, Lambertian.
#[derive(Clone, Debug, PartialEq)]
pub struct Emission {
    /// Spectral shape; absolute only for [`Level::Radiance`].
    pub spectrum: Spectrum,
    /// How much.
    pub level: Level,
}

/// How much light an emitter gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Level {
    /// The spectrum times this factor is the radiance, W m⁻² sr⁻¹ nm⁻¹.
    Radiance(f64),
    /// Luminance, cd m⁻².
    Luminance(f64),
    /// Luminous flux of all surfaces that wear the material together, lm.
    LuminousFlux(f64),
    /// Luminous intensity along the normal of all surfaces that wear the material together, cd.
    LuminousIntensity(f64),
}

/// `x` within `lo..=hi`; unlike `clamp`, what is not a number becomes `lo`.
#[inline]
fn bounded(x: f64, lo: f64, hi: f64) -> f64 {
    x.max(lo).min(hi)
}

//! Materials: what a surface does with light, as functions of wavelength and as sampled for a run.

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
}

/// A material as a run sees it: `W` numbers for each spectrum.
#[derive(Clone, Debug)]
pub struct SampledMaterial {
    /// d π R^d: the share of light reflected diffusely, `[W]`. Zero for glass.
    pub diffuse: Vec<f32>,
    /// Share of the specular part; 1 for glass.
    pub s: f64,
    /// Beckmann roughness; 0 for glass.
    pub m: f64,
    /// Specular reflectance against cos θ: F, or that of the whole sheet for a pane. From outside.
    pub reflect: FresnelTable,
    /// What goes through, for glass.
    pub transmission: Option<Transmission>,
    /// Emitted radiance L^E, W m⁻² sr⁻¹ nm⁻¹, `[W]`.
    pub emission: Vec<f32>,
}

impl SampledMaterial {
    /// Whether points of this material carry directional radiance.
    pub fn is_specular(&self) -> bool {
        self.s > 0.0
    }
}

/// What goes through glass.
#[derive(Clone, Debug)]
pub enum Transmission {
    /// Straight through a sheet.
    Pane {
        /// Transmittance of the whole sheet against cos θ outside.
        transmit: FresnelTable,
    },
    /// Into or out of a solid.
    Solid {
        /// Refractive index used for directions (at the middle of the visible band).
        n: f64,
        /// Reflectance met from inside against cos θ inside; 1 beyond the critical angle.
        inside: FresnelTable,
        /// Absorption coefficient, 1/m, `[W]`.
        absorption: Vec<f32>,
    },
}

/// A factor tabulated against the angle of incidence, all wavelengths side by side
/// (the paper's appendix, "Storage of F").
#[derive(Clone, Debug)]
pub struct FresnelTable {
    /// Number of wavelengths, W.
    pub wavelengths: usize,
    /// `[entries][W]`, from normal to grazing incidence, equally spaced in cos θ from 1 to 0.
    pub values: Vec<f32>,
}

impl FresnelTable {
    /// Entries per wavelength.
    pub fn entries(&self) -> usize {
        self.values.len() / self.wavelengths
    }

    /// The two neighbouring entries for `cos_theta` (clamped to 0..1) are `slot` and `slot + 1`,
    /// and the value is `(1 - f) a + f b`: returns `(slot, f)`.
    #[inline]
    pub fn slot(&self, cos_theta: f32) -> (usize, f32) {
        let last = self.entries() - 1;
        let x = (1.0 - cos_theta.clamp(0.0, 1.0)) * last as f32;
        let slot = (x as usize).min(last - 1);
        (slot, x - slot as f32)
    }

    /// The factor at `cos_theta` for every wavelength, into `out[..W]`.
    #[inline]
    pub fn eval(&self, cos_theta: f32, out: &mut [f32]) {
        let (slot, f) = self.slot(cos_theta);
        let w = self.wavelengths;
        let a = &self.values[slot * w..(slot + 1) * w];
        let b = &self.values[(slot + 1) * w..(slot + 2) * w];
        for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
            *o = a + f * (b - a);
        }
    }
}

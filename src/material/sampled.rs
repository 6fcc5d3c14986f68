//! Materials at the wavelengths of a run.

use super::{Body, Emission, Fresnel, FresnelTable, Level, Material, bounded, fresnel, glass};
use crate::spectrum::{Wavelengths, luminance_of};
use std::f64::consts::PI;

/// Entries of the table met from inside a solid: F leaves its plateau of 1 at the critical angle with a
/// vertical tangent, which equal steps follow poorly (off by up to 0.12 within 0.2 degrees of that angle with this
/// many). Where the refracted direction is known, the outside factor at its cosine is the same number without
/// that error; [`fresnel::inside`] is exact.
const INSIDE_ENTRIES: usize = 1024;

/// Where the index that bends directions is read, nm: the middle of the visible band.
const DIRECTION_NM: f64 = 580.0;

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
    /// Glass taken as a surface that sends on evenly what passes it, in place of what goes through; `diffuse` is then what
    /// it reflects in front.
    pub spread: Option<Spread>,
    /// Emitted radiance L^E, W m⁻² sr⁻¹ nm⁻¹, `[W]`.
    pub emission: Vec<f32>,
}

/// Shares of the light that falls on glass whose light is spread evenly, `[W]` each.
#[derive(Clone, Debug)]
pub struct Spread {
    /// What passes from the front to the back.
    pub inwards: Vec<f32>,
    /// What passes from the back to the front.
    pub outwards: Vec<f32>,
    /// What the back reflects.
    pub inside: Vec<f32>,
}

impl SampledMaterial {
    /// Whether points of this material carry directional radiance.
    pub fn is_specular(&self) -> bool {
        self.s > 0.0
    }

    /// Whether light goes through, on its way or spread.
    pub fn lets_through(&self) -> bool {
        self.transmission.is_some() || self.spread.is_some()
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

impl Material {
    /// The material at `wavelengths`, with `fresnel_entries` angles in its tables. `emitting_area` is the area,
    /// m², of all surfaces that wear the material together (both sides of two-sided ones): a luminous
    /// flux Φ spreads over it as the Lambertian luminance Φ/(πA). With no area a flux emits nothing.
    ///
    /// Every value is finite and not negative, whatever the spectra hold; diffuse and reflected shares are at most 1.
    pub fn sample(
        &self,
        wavelengths: &Wavelengths,
        fresnel_entries: usize,
        emitting_area: f64,
    ) -> SampledMaterial {
        let count = wavelengths.len();
        let emission = match &self.emission {
            Some(emission) => radiance(emission, wavelengths, emitting_area),
            None => vec![0.0; count],
        };
        // Averages over a band are taken of the factor, not of the index.
        let table = |entries: usize, factor: &dyn Fn(f64, f64) -> f64| {
            FresnelTable::new(count, entries, |w, cos| wavelengths.average(w, |nm| factor(nm, cos)))
        };
        let (diffuse, s, m, reflect, transmission) = match &self.body {
            Body::Opaque { s, m, diffuse, fresnel } => {
                let s = unit(*s);
                let albedo = match diffuse {
                    Some(albedo) => wavelengths.sample(albedo),
                    None => (0..count).map(|w| wavelengths.average(w, |nm| fresnel.at(nm, 1.0))).collect(),
                };
                let diffuse = albedo.into_iter().map(|a| ((1.0 - s) * unit(a)) as f32).collect();
                let reflect = table(fresnel_entries, &|nm, cos| fresnel.at(nm, cos));
                (diffuse, s, bounded(*m, 0.0, MAX_ROUGHNESS), reflect, None)
            }
            Body::Pane { n, transmittance } => {
                let pane = |nm: f64, cos: f64| glass::pane(cos, n.at(nm), transmittance.at(nm));
                let reflect = table(fresnel_entries, &|nm, cos| pane(nm, cos).reflectance);
                let transmit = table(fresnel_entries, &|nm, cos| pane(nm, cos).transmittance);
                (vec![0.0; count], 1.0, 0.0, reflect, Some(Transmission::Pane { transmit }))
            }
            Body::Solid { n, absorption } => {
                let reflect = table(fresnel_entries, &|nm, cos| fresnel::unpolarised(cos, n.at(nm), 0.0));
                let inside =
                    table(fresnel_entries.max(INSIDE_ENTRIES), &|nm, cos| fresnel::inside(cos, n.at(nm)));
                let absorption = wavelengths.sample(absorption).into_iter().map(stored).collect();
                let n = n.at(DIRECTION_NM);
                (vec![0.0; count], 1.0, 0.0, reflect, Some(Transmission::Solid { n, inside, absorption }))
            }
        };
        SampledMaterial { diffuse, s, m, reflect, transmission, spread: None, emission }
    }
}

impl Fresnel {
    /// F(λ, θ) of unpolarised light at wavelength `nm`, by the method the material asks for.
    pub fn at(&self, nm: f64, cos_theta: f64) -> f64 {
        match self {
            Fresnel::Scaled { normal, n, k } => fresnel::scaled(cos_theta, normal.at(nm), *n, *k),
            Fresnel::Index { n, k } => fresnel::unpolarised(cos_theta, n.at(nm), k.at(nm)),
        }
    }
}

/// Rougher than this the model says nothing more.
const MAX_ROUGHNESS: f64 = 1e3;

/// Clamped to 0..1; what is not a number becomes 0.
fn unit(x: f64) -> f64 {
    bounded(x, 0.0, 1.0)
}

/// As it is stored: finite and not negative.
fn stored(x: f64) -> f32 {
    (x.max(0.0) as f32).min(f32::MAX)
}

impl Emission {
    /// What makes the spectrum the radiance L^E, W m⁻² sr⁻¹ nm⁻¹, where surfaces of `area`, m², wear the
    /// material; not negative.
    pub fn factor(&self, area: f64) -> f64 {
        let of_luminance = |luminance: f64| luminance / luminance_of(&self.spectrum);
        let factor = match self.level {
            Level::Radiance(factor) => factor,
            Level::Luminance(luminance) => of_luminance(luminance),
            Level::LuminousFlux(flux) => of_luminance(flux / (PI * area)),
            Level::LuminousIntensity(intensity) => of_luminance(intensity / area),
        };
        // Darkness and surfaces without area give nothing, whatever is asked of them.
        if factor.is_finite() { factor.max(0.0) } else { 0.0 }
    }
}

/// Sampled L^E, W m⁻² sr⁻¹ nm⁻¹. The luminance asked for is met exactly by the weights of `wavelengths`.
fn radiance(emission: &Emission, wavelengths: &Wavelengths, area: f64) -> Vec<f32> {
    let factor = emission.factor(area);
    wavelengths.sample_emission(&emission.spectrum).into_iter().map(|s| stored(factor * s)).collect()
}

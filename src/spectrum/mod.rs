//! Spectra as functions of wavelength, and the wavelengths at which a run samples them.

mod curve;
mod emission;
pub mod library;
mod melanopic;
pub mod standard_observer;
mod table;
mod wavelengths;

pub use curve::Spectrum;
pub use melanopic::melanopic_ratio;
pub use standard_observer::{luminance_of, xyz_of};
pub use wavelengths::Wavelengths;

/// Luminous efficacy of radiation at 555 nm, lm/W.
pub const LUMENS_PER_WATT: f64 = 683.0;

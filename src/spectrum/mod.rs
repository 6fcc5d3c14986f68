//! Spectra as functions of wavelength, and the wavelengths at which a run samples them.

/// A quantity as a function of wavelength.
#[derive(Clone, Debug, PartialEq)]
pub enum Spectrum {
    /// The same at every wavelength.
    Constant(f64),
    /// Linear between samples, constant beyond the ends.
    Tabulated {
        /// Wavelengths, nm, increasing.
        nm: Vec<f64>,
        /// Value at each.
        value: Vec<f64>,
    },
}

/// The wavelengths of a run and how to sum over them. A sampled spectrum is a slice of
/// `len()` numbers that means nothing without the `Wavelengths` it was sampled at.
#[derive(Clone, Debug, PartialEq)]
pub struct Wavelengths {
    /// Representative wavelength of each sample, nm.
    pub nm: Vec<f64>,
    /// Band that each sample averages over, nm; `lo == hi` for a point sample.
    pub bands: Vec<[f64; 2]>,
    /// Weights, nm: X = Σ w_x S(λ_i) stands for ∫ S x̄ dλ, and so on (CIE 1931, 2 degrees).
    pub xyz_weights: Vec<[f64; 3]>,
}

impl Wavelengths {
    /// How many samples.
    pub fn len(&self) -> usize {
        self.nm.len()
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.nm.is_empty()
    }
}

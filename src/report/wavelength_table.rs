//! What a number of wavelengths costs in colour: the 24 patches of the colour checker under four lights.

use crate::colour::{delta_e_2000, lab};
use crate::error::Result;
use crate::spectrum::{Spectrum, Wavelengths, library, xyz_of};
use serde::Serialize;
use std::fmt;

/// The lights of the table: daylight, incandescent, and the spiky fluorescent and diode lamps.
pub const LIGHTS: [&str; 4] = ["D65", "A", "FL11", "LED-B3"];

/// The choices of the table, as [`Wavelengths::parse`] reads them; the last has bands under 5 nm.
pub const CHOICES: [&str; 6] = ["meyer4", "4", "8", "16", "32", "80"];

/// CIEDE2000 of the 24 patches against full spectra.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ColourError {
    /// Mean of the patches.
    pub mean: f64,
    /// The worst patch.
    pub worst: f64,
}

/// The errors of one choice of wavelengths.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// One of [`CHOICES`].
    pub wavelengths: &'static str,
    /// Light reflected once, by [`LIGHTS`].
    pub once: [ColourError; 4],
    /// Light reflected twice by the same patch.
    pub twice: [ColourError; 4],
}

/// The table.
#[derive(Clone, Debug, Serialize)]
pub struct WavelengthTable(pub Vec<Row>);

/// The colour error of light reflected `bounces` times by each of the 24 patches, in a scene lit by `light` alone.
/// Both sides are seen against the light itself, integrated in full.
pub fn colour_error(wavelengths: &Wavelengths, light: &Spectrum, bounces: i32) -> ColourError {
    let wavelengths = wavelengths.under(light);
    let lamp = wavelengths.sample_emission(light);
    let white = xyz_of(light);
    let seen = |xyz: [f64; 3]| lab(xyz.map(|x| x.max(0.0)), white);
    let (mut mean, mut worst) = (0.0, 0.0_f64);
    let patches: Vec<Spectrum> =
        library::reflectance_names().into_iter().filter_map(library::reflectance).collect();
    for patch in &patches {
        let reflected: Vec<f64> =
            wavelengths.sample(patch).iter().zip(&lamp).map(|(r, s)| r.powi(bounces) * s).collect();
        let exact = light.times(|nm| patch.at(nm).powi(bounces));
        let error = delta_e_2000(seen(xyz_of(&exact)), seen(wavelengths.xyz(&reflected)));
        mean += error / patches.len() as f64;
        worst = worst.max(error);
    }
    ColourError { mean, worst }
}

impl WavelengthTable {
    /// Measures it.
    ///
    /// # Errors
    /// None but those of [`Wavelengths::parse`], which knows all of [`CHOICES`].
    pub fn measure() -> Result<Self> {
        let lights = LIGHTS.map(|name| library::illuminant(name).unwrap_or(Spectrum::Constant(1.0)));
        let row = |choice| {
            let wavelengths = Wavelengths::parse(choice)?;
            let errors = |bounces| lights.each_ref().map(|light| colour_error(&wavelengths, light, bounces));
            Ok(Row { wavelengths: choice, once: errors(1), twice: errors(2) })
        };
        CHOICES.into_iter().map(row).collect::<Result<_>>().map(WavelengthTable)
    }
}

impl fmt::Display for WavelengthTable {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "CIEDE2000 of 24 patches against full spectra, mean / worst")?;
        write!(f, "{:12}{:10}", "wavelengths", "reflected")?;
        LIGHTS.iter().try_for_each(|light| write!(f, "{light:>15}"))?;
        for row in &self.0 {
            for (name, bounces, errors) in [(row.wavelengths, "once", &row.once), ("", "twice", &row.twice)] {
                write!(f, "\n{name:12}{bounces:10}")?;
                errors.iter().try_for_each(|e| write!(f, "{:>7.2} /{:>6.2}", e.mean, e.worst))?;
            }
        }
        Ok(())
    }
}

//! What a number of wavelengths costs in colour: the 24 patches of the colour checker under four lights.

use crate::colour::{delta_e_76, delta_e_2000, lab};
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
    let [_, _, mean, worst, _] = patch_errors(&wavelengths, light, &lamp, false, bounces);
    ColourError { mean, worst }
}

/// Mean and largest ΔE76, mean and largest ΔE2000 of light reflected `bounces` times by each of the 24 patches
/// of the ColorChecker, and ΔE76 of the white. `lamp` are the samples of the light, `[wavelengths.len()]`; with
/// `own_white` each side is seen against its own white, else both against that of the full spectrum.
pub fn patch_errors(
    wavelengths: &Wavelengths,
    light: &Spectrum,
    lamp: &[f64],
    own_white: bool,
    bounces: i32,
) -> [f64; 5] {
    // Negative X, Y, Z are clamped after the sum.
    let scaled = |xyz: [f64; 3], factor: f64| xyz.map(|x| (factor * x).max(0.0));
    let (exact, sampled) = (xyz_of(light), wavelengths.xyz(lamp));
    let white = scaled(exact, 1.0 / exact[1]);
    let (scale, sampled_white) = match own_white {
        true => (1.0 / sampled[1], scaled(sampled, 1.0 / sampled[1])),
        false => (1.0 / exact[1], white),
    };
    let (mut mean_76, mut max_76, mut mean_00, mut max_00) = (0.0, 0.0_f64, 0.0, 0.0_f64);
    for patch in library::reflectance_names().into_iter().filter_map(library::reflectance) {
        let full = light.times(|nm| patch.at(nm).powi(bounces));
        let a = lab(scaled(xyz_of(&full), 1.0 / exact[1]), white);
        let reflected: Vec<f64> =
            wavelengths.sample(&patch).iter().zip(lamp).map(|(r, s)| r.powi(bounces) * s).collect();
        let b = lab(scaled(wavelengths.xyz(&reflected), scale), sampled_white);
        mean_76 += delta_e_76(a, b) / 24.0;
        max_76 = max_76.max(delta_e_76(a, b));
        mean_00 += delta_e_2000(a, b) / 24.0;
        max_00 = max_00.max(delta_e_2000(a, b));
    }
    let white_76 = delta_e_76(lab(white, white), lab(scaled(sampled, 1.0 / exact[1]), white));
    [mean_76, max_76, mean_00, max_00, white_76]
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

//! What four wavelengths cost in colour: G. W. Meyer, *Wavelength Selection for Synthetic Image
//! Generation* (1988). The error is part of the rule, and a right implementation has neither more nor less.

use super::{Case, Tolerance};
use crate::colour::{delta_e_76, delta_e_2000, lab};
use crate::error::{Error, Result};
use crate::spectrum::{Spectrum, Wavelengths, library, xyz_of};

const RULE: &str = "Meyer's rule derived anew, 24 patches of the ColorChecker against sums at 1 nm";

/// Names of the columns of the table after light and mode; the table has them in this order.
const COLUMNS: [&str; 5] =
    ["mean dE76", "largest dE76", "mean dE2000", "largest dE2000", "dE76 of the white"];

/// One light and mode a line: illuminant, mode, and what [`patch_errors`] returns.
const TABLE: &str = include_str!("data/meyer_delta_e.csv");

pub(super) fn run() -> Result<Vec<Case>> {
    let meyer = Wavelengths::meyer4();
    let damaged = || Error::Numerical("the built-in table of Meyer's errors is damaged".into());
    let mut cases = Vec::new();
    for line in TABLE.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [light, mode, values @ ..] = &fields[..] else { return Err(damaged()) };
        let expected: Vec<f64> = values.iter().filter_map(|v| v.parse().ok()).collect();
        let spectrum = library::illuminant(light).filter(|_| expected.len() == COLUMNS.len());
        let spectrum = spectrum.ok_or_else(damaged)?;
        let lamp = match *mode {
            "corrected" => meyer.sample_emission(&spectrum),
            _ => meyer.sample(&spectrum),
        };
        let found = patch_errors(&meyer, &spectrum, &lamp, *mode == "relative");
        for c in 0..COLUMNS.len() {
            cases.push(Case {
                name: format!("{light}, {mode}: {}", COLUMNS[c]),
                source: RULE,
                expected: expected[c],
                found: found[c],
                tolerance: Tolerance::Absolute(0.01),
            });
        }
    }
    Ok(cases)
}

/// Mean and largest ΔE76, mean and largest ΔE2000 of the 24 patches of the ColorChecker, and ΔE76 of the
/// white. `lamp` are the samples of the light; with `own_white` each side is seen against its own white,
/// else both against that of the full spectrum.
pub fn patch_errors(wavelengths: &Wavelengths, light: &Spectrum, lamp: &[f64], own_white: bool) -> [f64; 5] {
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
        let a = lab(scaled(xyz_of(&light.times(|nm| patch.at(nm))), 1.0 / exact[1]), white);
        let reflected: Vec<f64> = wavelengths.sample(&patch).iter().zip(lamp).map(|(r, s)| r * s).collect();
        let b = lab(scaled(wavelengths.xyz(&reflected), scale), sampled_white);
        mean_76 += delta_e_76(a, b) / 24.0;
        max_76 = max_76.max(delta_e_76(a, b));
        mean_00 += delta_e_2000(a, b) / 24.0;
        max_00 = max_00.max(delta_e_2000(a, b));
    }
    let white_76 = delta_e_76(lab(white, white), lab(scaled(sampled, 1.0 / exact[1]), white));
    [mean_76, max_76, mean_00, max_00, white_76]
}

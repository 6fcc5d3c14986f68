//! What four wavelengths cost in colour: G. W. Meyer, *Wavelength Selection for Synthetic Image
//! Generation* (1988). The error is part of the rule, and a right implementation has neither more nor less.

use super::{Case, Tolerance};
use crate::error::{Error, Result};
use crate::report::wavelength_table::patch_errors;
use crate::spectrum::{Wavelengths, library};

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
        let found = patch_errors(&meyer, &spectrum, &lamp, *mode == "relative", 1);
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

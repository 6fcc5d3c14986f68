//! The one place where scene files meet the built-in spectra.

use super::csv;
use crate::spectrum::Spectrum;

const ILLUMINANTS: [(&str, &str); 2] = [
    ("D65", include_str!("library_data/illuminant_d65_1nm.csv")),
    ("A", include_str!("library_data/illuminant_a_1nm.csv")),
];

const INDICES: [(&str, &str); 3] = [
    ("gold", include_str!("library_data/gold_johnson_christy.csv")),
    ("silver", include_str!("library_data/silver_johnson_christy.csv")),
    ("bk7", include_str!("library_data/bk7_schott.csv")),
];

const COLOR_CHECKER: &str = include_str!("library_data/colorchecker_ohta1997_5nm.csv");

fn spectrum(text: &str, column: &str) -> Option<Spectrum> {
    let (nm, value) = csv::built_in(text, column).ok()?;
    tabulated(nm, value).ok()
}

/// Relative power of a standard illuminant.
pub fn illuminant(name: &str) -> Option<Spectrum> {
    let (_, text) = ILLUMINANTS.iter().find(|(n, _)| *n == name)?;
    let header = text.lines().next()?;
    spectrum(text, header.split(',').nth(1)?.trim())
}

/// Names that [`illuminant`] knows.
pub fn illuminant_names() -> Vec<&'static str> {
    ILLUMINANTS.iter().map(|(name, _)| *name).collect()
}

/// n and k of a material.
pub fn refractive_index(name: &str) -> Option<(Spectrum, Spectrum)> {
    let (_, text) = INDICES.iter().find(|(n, _)| *n == name)?;
    Some((spectrum(text, "n")?, spectrum(text, "k")?))
}

/// Names that [`refractive_index`] knows.
pub fn refractive_index_names() -> Vec<&'static str> {
    INDICES.iter().map(|(name, _)| *name).collect()
}

/// A measured reflectance.
pub fn reflectance(name: &str) -> Option<Spectrum> {
    reflectance_names().contains(&name).then(|| spectrum(COLOR_CHECKER, name))?
}

/// Names that [`reflectance`] knows.
pub fn reflectance_names() -> Vec<&'static str> {
    COLOR_CHECKER.lines().next().unwrap_or("").split(',').skip(1).map(str::trim).collect()
}

/// A spectrum from samples: finite, wavelengths increasing, at least two.
pub fn tabulated(nm: Vec<f64>, value: Vec<f64>) -> Result<Spectrum, String> {
    if nm.len() != value.len() {
        return Err(format!("{} wavelengths and {} values; give as many of each", nm.len(), value.len()));
    }
    if nm.len() < 2 {
        return Err("a tabulated spectrum has at least two samples".into());
    }
    if !nm.iter().chain(&value).all(|x| x.is_finite()) {
        return Err("a spectrum's numbers are finite".into());
    }
    if !nm.windows(2).all(|w| w[0] < w[1]) {
        return Err("wavelengths increase".into());
    }
    Ok(Spectrum::Tabulated { nm, value })
}

/// The value of `spectrum` at a wavelength.
pub fn at(spectrum: &Spectrum, at_nm: f64) -> f64 {
    match spectrum {
        Spectrum::Constant(value) => *value,
        Spectrum::Tabulated { nm, value } => {
            let above = nm.partition_point(|&x| x <= at_nm);
            if above == 0 {
                value[0]
            } else if above == nm.len() {
                value[nm.len() - 1]
            } else {
                let f = (at_nm - nm[above - 1]) / (nm[above] - nm[above - 1]);
                value[above - 1] + f * (value[above] - value[above - 1])
            }
        }
    }
}

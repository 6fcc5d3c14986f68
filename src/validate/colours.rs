//! From spectra to colours: white points, the ColorChecker, metals.

use super::{Case, Tolerance, expected};
use crate::colour::{encode_srgb, lab, xyz_to_linear_srgb};
use crate::error::{Error, Result};
use crate::material::{Body, DEFAULT_ENTRIES, Fresnel, Material};
use crate::spectrum::{Spectrum, Wavelengths, library, xyz_of};
use serde::Deserialize;
use std::collections::BTreeMap;

const SUM: &str = "CIE 1931 observer, sum at 1 nm over 380 to 780 nm (checked against colour-science 0.4.7)";
const METAL: &str = "n and k of Johnson and Christy (1972), Fresnel at 0 degrees, the same sum";

#[derive(Deserialize)]
struct Colorimetry {
    white: BTreeMap<String, White>,
    #[serde(rename = "colorchecker_D65")]
    patches: BTreeMap<String, Colour>,
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names of the table")]
struct White {
    XYZ: [f64; 3],
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names of the table")]
struct Colour {
    XYZ: [f64; 3],
    Lab: [f64; 3],
    srgb_linear: [f64; 3],
    srgb_encoded_0_255: Option<[f64; 3]>,
    R_at_meyer_wavelengths: Option<[f64; 4]>,
}

#[derive(Deserialize)]
struct Metals {
    metals: BTreeMap<String, Colour>,
}

/// What a spectrum that is built in is called; only a damaged program does not have it.
fn built_in<T>(found: Option<T>, name: &str) -> Result<T> {
    found.ok_or_else(|| Error::Numerical(format!("the built-in spectrum {name} is missing")))
}

pub fn run() -> Result<Vec<Case>> {
    let table: Colorimetry = expected::table(include_str!("data/colorimetry.json"))?;
    let mut cases = Vec::new();
    for (name, white) in &table.white {
        let found = xyz_of(&built_in(library::illuminant(name), name)?);
        let pairs = [0, 1, 2].map(|c| (white.XYZ[c], 100.0 * found[c] / found[1]));
        let name = format!("white point of {name}, worst of X, Y, Z");
        cases.push(Case::worst(name, SUM, Tolerance::Absolute(1e-6), pairs));
    }
    let d65 = built_in(library::illuminant("D65"), "D65")?;
    for (name, colour) in &table.patches {
        let patch = built_in(library::reflectance(name), name)?;
        cases.extend(compare(name, SUM, colour, &d65, |nm| patch.at(nm)));
    }
    Ok(cases)
}

/// Gold and silver.
pub fn metals() -> Result<Vec<Case>> {
    let table: Metals = expected::table(include_str!("data/metal_colours.json"))?;
    let d65 = built_in(library::illuminant("D65"), "D65")?;
    let mut cases = Vec::new();
    for (name, colour) in &table.metals {
        let (n, k) = built_in(library::refractive_index(name), name)?;
        let fresnel = Fresnel::Index { n, k };
        cases.extend(compare(name, METAL, colour, &d65, |nm| fresnel.at(nm, 1.0)));
        let body = Body::Opaque { s: 1.0, m: 0.0, diffuse: None, fresnel };
        let metal = Material { name: name.clone(), body, emission: None };
        let sampled = metal.sample(&Wavelengths::meyer4(), DEFAULT_ENTRIES, 0.0);
        let found = sampled.reflect.values.iter().map(|&f| f64::from(f));
        let pairs = colour.R_at_meyer_wavelengths.into_iter().flatten().zip(found);
        let name = format!("{name}, reflectance at the four wavelengths, worst");
        // The table was made at the nodes before they were rounded to 0.1 nm.
        cases.push(Case::worst(name, METAL, Tolerance::Absolute(1e-5), pairs));
    }
    Ok(cases)
}

/// The colour of a reflectance under `light`, in three spaces.
fn compare(
    name: &str,
    source: &'static str,
    colour: &Colour,
    light: &Spectrum,
    reflectance: impl Fn(f64) -> f64,
) -> Vec<Case> {
    let white = xyz_of(light);
    let xyz = xyz_of(&light.times(reflectance)).map(|x| x / white[1]);
    let found_lab = lab(xyz, white.map(|x| x / white[1]));
    let linear = xyz_to_linear_srgb(xyz);
    let worst = |what: &str, tolerance: f64, expected: [f64; 3], found: [f64; 3]| {
        let pairs = expected.into_iter().zip(found);
        Case::worst(format!("{name}, {what}, worst of 3"), source, Tolerance::Absolute(tolerance), pairs)
    };
    let mut cases = vec![
        worst("XYZ", 1e-6, colour.XYZ, xyz.map(|x| 100.0 * x)),
        worst("Lab", 1e-6, colour.Lab, found_lab),
        worst("linear sRGB", 1e-8, colour.srgb_linear, linear),
    ];
    if let Some(encoded) = colour.srgb_encoded_0_255 {
        let found = linear.map(|x| 255.0 * encode_srgb(x.clamp(0.0, 1.0)));
        cases.push(worst("sRGB 0 to 255", 1e-3, encoded.map(|x| x.clamp(0.0, 255.0)), found));
    }
    cases
}

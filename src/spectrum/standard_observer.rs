//! The CIE 1931 2 degree standard observer, and what it sees of a spectrum.
//!
//! All integrals over wavelength are the CIE's sums at 1 nm over 380 to 780 nm.

use super::{LUMENS_PER_WATT, Spectrum, table};
use std::sync::LazyLock;

/// First and last wavelength of every colorimetric sum, nm.
pub const RANGE_NM: [f64; 2] = [380.0, 780.0];

static CMF: LazyLock<Vec<[f64; 3]>> = LazyLock::new(|| {
    let xyz = table::columns(include_str!("data/cmf_1931_2deg_1nm.csv"));
    nanometres().map(|nm| [0, 1, 2].map(|c| xyz[c].1.at(nm))).collect()
});

/// The wavelengths of the sums: 380, 381, ... 780 nm.
pub(super) fn nanometres() -> impl Iterator<Item = f64> {
    (RANGE_NM[0] as u32..=RANGE_NM[1] as u32).map(f64::from)
}

/// x̄ ȳ z̄ at 380, 381, ... 780 nm: `[401]`.
pub fn colour_matching_functions() -> &'static [[f64; 3]] {
    &CMF
}

/// X, Y, Z of a radiance spectrum in W m⁻² sr⁻¹ nm⁻¹, scaled by 683 lm/W: Y is in cd m⁻².
pub fn xyz_of(spectrum: &Spectrum) -> [f64; 3] {
    let mut xyz = [0.0; 3];
    for (nm, cmf) in nanometres().zip(CMF.iter()) {
        let s = LUMENS_PER_WATT * spectrum.over_nanometre(nm);
        for (sum, weight) in xyz.iter_mut().zip(cmf) {
            *sum += s * weight;
        }
    }
    xyz
}

/// Luminance, cd m⁻², of a radiance spectrum in W m⁻² sr⁻¹ nm⁻¹ (or illuminance, lx, of an
/// irradiance spectrum): 683 ∫ S ȳ dλ.
pub fn luminance_of(spectrum: &Spectrum) -> f64 {
    xyz_of(spectrum)[1]
}

/// ∫ light × f dλ over a band, nm, for functions f given at 380, 381, ... 780 nm and linear between.
/// The half samples by which a sum at 1 nm exceeds that integral belong to the bands at the two
/// ends, so that bands that divide 380 to 780 nm add up to the sum.
pub(super) fn band_integrals<const N: usize>(
    functions: &[[f64; N]],
    [lo, hi]: [f64; 2],
    light: &Spectrum,
) -> [f64; N] {
    let mut integral = [0.0; N];
    let mut add = |weight: f64, values: [f64; N]| {
        for (sum, value) in integral.iter_mut().zip(values) {
            *sum += weight * value;
        }
    };
    for (i, pair) in functions.windows(2).enumerate() {
        let from = RANGE_NM[0] + i as f64;
        let (a, b) = (lo.max(from), hi.min(from + 1.0));
        if a < b {
            let f = 0.5 * (a + b) - from;
            let middle = std::array::from_fn(|c| (1.0 - f) * pair[0][c] + f * pair[1][c]);
            add((b - a) * light.mean(a, b), middle);
        }
    }
    for (end, sample) in RANGE_NM.into_iter().zip([functions.first(), functions.last()]) {
        if let Some(sample) = sample.filter(|_| lo <= end && end <= hi) {
            add(0.5 * light.at(end), *sample);
        }
    }
    integral
}

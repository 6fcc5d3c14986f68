//! The CIE 1931 2 degree standard observer, and what it sees of a spectrum.
//!
//! All integrals over wavelength are the CIE's sums at 1 nm over 380 to 780 nm.

use super::{LUMENS_PER_WATT, Spectrum, table};
use std::sync::LazyLock;

/// First and last wavelength of every colorimetric sum, nm.
pub const RANGE_NM: [f64; 2] = [380.0, 780.0];

static CMF: LazyLock<Vec<[f64; 3]>> = LazyLock::new(|| {
    let xyz = table::columns(include_str!("data/cmf_1931_2deg_1nm.csv"));
    wavelengths().map(|nm| [0, 1, 2].map(|c| xyz[c].1.at(nm))).collect()
});

/// The wavelengths of the sums: 380, 381, ... 780 nm.
fn wavelengths() -> impl Iterator<Item = f64> {
    (380..=780).map(f64::from)
}

/// x̄ ȳ z̄ at 380, 381, ... 780 nm: `[401]`.
pub fn colour_matching_functions() -> &'static [[f64; 3]] {
    &CMF
}

/// X, Y, Z of a radiance spectrum in W m⁻² sr⁻¹ nm⁻¹, scaled by 683 lm/W: Y is in cd m⁻².
pub fn xyz_of(spectrum: &Spectrum) -> [f64; 3] {
    let mut xyz = [0.0; 3];
    for (nm, cmf) in wavelengths().zip(CMF.iter()) {
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

/// ∫ x̄, ȳ, z̄ dλ over `lo..hi`, nm, the functions linear between their samples. The half samples
/// by which a sum at 1 nm exceeds that integral belong to the bands at the two ends, so that bands
/// that divide 380 to 780 nm add up to the sum.
pub(super) fn band_weights(lo: f64, hi: f64) -> [f64; 3] {
    [0, 1, 2].map(|c| {
        let mut integral = 0.0;
        for (i, pair) in CMF.windows(2).enumerate() {
            let from = RANGE_NM[0] + i as f64;
            let (a, b) = (lo.max(from), hi.min(from + 1.0));
            if a < b {
                let middle = 0.5 * (a + b) - from;
                integral += (b - a) * ((1.0 - middle) * pair[0][c] + middle * pair[1][c]);
            }
        }
        for (end, sample) in RANGE_NM.into_iter().zip([CMF.first(), CMF.last()]) {
            if lo <= end && end <= hi {
                integral += 0.5 * sample.map_or(0.0, |s| s[c]);
            }
        }
        integral
    })
}

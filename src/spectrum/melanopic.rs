//! Melanopic equivalent daylight illuminance (CIE S 026): the illuminance of D65 that would act on
//! melanopsin as the light at hand does.

use super::standard_observer::nanometres;
use super::{Spectrum, Wavelengths, library, table};
use std::sync::LazyLock;

/// The action spectrum at 380, 381, ... 780 nm, 1 at its peak.
static ACTION: LazyLock<Vec<[f64; 1]>> = LazyLock::new(|| {
    let columns = table::columns(include_str!("data/melanopic_s026_1nm.csv"));
    nanometres().map(|nm| [columns[0].1.at(nm)]).collect()
});

/// ∫ D65 s dλ over its luminance, W/lm: the efficacy of daylight.
static DAYLIGHT: LazyLock<f64> =
    LazyLock::new(|| library::illuminant("D65").map_or(f64::INFINITY, |d65| efficacy(&d65)));

/// The melanopic action spectrum at 380, 381, ... 780 nm, 1 at its peak: `[401]`.
pub(super) fn action() -> &'static [[f64; 1]] {
    &ACTION
}

/// Melanopic irradiance per illuminance, W/lm.
fn efficacy(spectrum: &Spectrum) -> f64 {
    let sum: f64 = nanometres().zip(action()).map(|(nm, [s])| s * spectrum.over_nanometre(nm)).sum();
    sum / super::luminance_of(spectrum)
}

/// Weights for point samples at `nm`: the integrals of the action spectrum against the curve that is
/// linear between the samples and constant beyond them.
pub(super) fn point_weights(samples: &[f64]) -> Vec<f64> {
    let mut weights = vec![0.0; samples.len()];
    for (nm, [action]) in nanometres().zip(action()) {
        let after = samples.partition_point(|&x| x <= nm);
        match (after.checked_sub(1), samples.get(after)) {
            (Some(before), Some(&next)) => {
                let share = (nm - samples[before]) / (next - samples[before]);
                weights[before] += (1.0 - share) * action;
                weights[after] += share * action;
            }
            (Some(before), None) => weights[before] += action,
            (None, _) => weights.first_mut().into_iter().for_each(|w| *w += action),
        }
    }
    weights
}

impl Wavelengths {
    /// Melanopic equivalent daylight illuminance of a sampled irradiance `[len()]`, W m⁻² nm⁻¹, in lx.
    ///
    /// It follows the full spectra within 0.5 % from 16 bands on; four wavelengths give an estimate only,
    /// since none of their weights was made for this action spectrum.
    pub fn melanopic_edi<T: Copy + Into<f64>>(&self, irradiance: &[T]) -> f64 {
        let sum: f64 = self.melanopic_weights.iter().zip(irradiance).map(|(w, &e)| w * e.into()).sum();
        sum / *DAYLIGHT
    }
}

/// Melanopic equivalent daylight illuminance per illuminance of a full spectrum: the melanopic
/// daylight efficacy ratio, by sums at 1 nm. 1 for D65, 0 for darkness.
pub fn melanopic_ratio(spectrum: &Spectrum) -> f64 {
    let ratio = efficacy(spectrum) / *DAYLIGHT;
    if ratio.is_finite() { ratio } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The three components of daylight (CIE 15), 380 to 780 nm by 10 nm.
    const DAYLIGHT: [[f64; 41]; 3] = [
        [
            63.4, 65.8, 94.8, 104.8, 105.9, 96.8, 113.9, 125.6, 125.5, 121.3, 121.3, 113.5, 113.1, 110.8,
            106.5, 108.8, 105.3, 104.4, 100.0, 96.0, 95.1, 89.1, 90.5, 90.3, 88.4, 84.0, 85.1, 81.9, 82.6,
            84.9, 81.3, 71.9, 74.3, 76.4, 63.3, 71.7, 77.0, 65.2, 47.7, 68.6, 65.0,
        ],
        [
            38.5, 35.0, 43.4, 46.3, 43.9, 37.1, 36.7, 35.9, 32.6, 27.9, 24.3, 20.1, 16.2, 13.2, 8.6, 6.1,
            4.2, 1.9, 0.0, -1.6, -3.5, -3.5, -5.8, -7.2, -8.6, -9.5, -10.9, -10.7, -12.0, -14.0, -13.6,
            -12.0, -13.3, -12.9, -10.6, -11.6, -12.2, -10.2, -7.8, -11.2, -10.4,
        ],
        [
            3.0, 1.2, -1.1, -0.5, -0.7, -1.2, -2.6, -2.9, -2.8, -2.6, -2.6, -1.8, -1.5, -1.3, -1.2, -1.0,
            -0.5, -0.3, 0.0, 0.2, 0.5, 2.1, 3.2, 4.1, 4.7, 5.1, 6.7, 7.3, 8.6, 9.8, 10.2, 8.3, 9.6, 8.5, 7.0,
            7.6, 8.0, 6.7, 5.2, 7.4, 6.8,
        ],
    ];

    /// Daylight of a correlated colour temperature between 4000 and 7000 K (CIE 15).
    fn daylight(kelvin: f64) -> Spectrum {
        let t = 1e3 / kelvin;
        let x = -4.6070 * t.powi(3) + 2.9678 * t * t + 0.09911 * t + 0.244063;
        let y = -3.0 * x * x + 2.87 * x - 0.275;
        let m = 0.0241 + 0.2562 * x - 0.7341 * y;
        let (m1, m2) = ((-1.3515 - 1.7703 * x + 5.9114 * y) / m, (0.03 - 31.4424 * x + 30.0717 * y) / m);
        let value = (0..41).map(|i| DAYLIGHT[0][i] + m1 * DAYLIGHT[1][i] + m2 * DAYLIGHT[2][i]).collect();
        Spectrum::tabulated((0..41).map(|i| 380.0 + 10.0 * f64::from(i)).collect(), value).unwrap()
    }

    fn lights() -> [(Spectrum, f64); 3] {
        let d65 = library::illuminant("D65").unwrap();
        // The components reproduce the built-in table, so they are the right ones for D55.
        for nm in (380..=780).step_by(10).map(f64::from) {
            let made = daylight(6504.0);
            assert!((made.at(nm) / made.at(560.0) * 100.0 - d65.at(nm)).abs() < 0.15, "{nm}");
        }
        [(library::illuminant("A").unwrap(), 0.4958), (daylight(5503.0), 0.9040), (d65, 1.0)]
    }

    #[test]
    fn full_spectra_have_the_ratios_of_the_standard() {
        for (light, expected) in lights() {
            let found = melanopic_ratio(&light);
            assert!((found / expected - 1.0).abs() < 5e-4, "{found} for {expected}");
        }
        assert_eq!(melanopic_ratio(&Spectrum::Constant(0.0)), 0.0);
    }

    #[test]
    fn sampled_lights_follow_from_16_bands_on() {
        for (light, expected) in lights() {
            for count in [16, 17, 24, 32, 81] {
                let wavelengths = Wavelengths::bands(count).unwrap();
                let samples = wavelengths.sample_emission(&light);
                let found = wavelengths.melanopic_edi(&samples) / wavelengths.xyz(&samples)[1];
                assert!((found / expected - 1.0).abs() < 5e-3, "{count} bands: {found} for {expected}");
            }
            let meyer = Wavelengths::meyer4();
            let samples = meyer.sample_emission(&light);
            let found = meyer.melanopic_edi(&samples) / meyer.xyz(&samples)[1];
            assert!((found / expected - 1.0).abs() < 0.1, "meyer4: {found} for {expected}");
        }
    }
}

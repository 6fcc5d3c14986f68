//! Clear and coloured glass: the thin sheet as a whole, and absorption inside.

use super::{bounded, fresnel};
use crate::spectrum::Spectrum;
use std::f64::consts::PI;

/// What a whole sheet does with unpolarised light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Share reflected, all inter-reflections together.
    pub reflectance: f64,
    /// Share that goes through.
    pub transmittance: f64,
}

/// A thin sheet of index `n` in air whose internal transmittance at normal incidence is `tau` (0 to 1), met
/// at `cos_theta` outside. With F of one face and τ = tau^(1/cos θ inside), for s and p light separately:
///
/// R = F + F (1-F)² τ²/(1 - F² τ²), T = (1-F)² τ/(1 - F² τ²).
pub fn pane(cos_theta: f64, n: f64, tau: f64) -> Sheet {
    let cos = bounded(cos_theta, 0.0, 1.0);
    let n = bounded(n, 1e-3, 1e6);
    let cos_inside = (1.0 - (1.0 - cos * cos) / (n * n)).max(0.0).sqrt();
    let tau = bounded(tau, 0.0, 1.0);
    let along = if tau < 1.0 { tau.powf(1.0 / cos_inside) } else { 1.0 };
    let mut sheet = Sheet { reflectance: 0.0, transmittance: 0.0 };
    for f in fresnel::polarised(cos, n, 0.0) {
        let (r, t) = if f < 1.0 {
            let t = (1.0 - f).powi(2) * along / (1.0 - (f * along).powi(2));
            (f + f * along * t, t)
        } else {
            (1.0, 0.0)
        };
        sheet.reflectance += 0.5 * r;
        sheet.transmittance += 0.5 * t;
    }
    sheet
}

/// A spectrum derived from `k` at its own wavelengths, or every 5 nm for a constant.
fn derived(k: &Spectrum, f: impl Fn(f64, f64) -> f64) -> Spectrum {
    let nm: Vec<f64> = match k {
        Spectrum::Constant(_) => (0..=80).map(|i| 380.0 + 5.0 * f64::from(i)).collect(),
        Spectrum::Tabulated { nm, .. } => nm.clone(),
    };
    let value = nm.iter().map(|&x| f(x, k.at(x).max(0.0))).collect();
    Spectrum::Tabulated { nm, value }
}

/// Absorption coefficient 4πk/λ, 1/m, from the imaginary part of the index.
pub fn absorption_from_k(k: &Spectrum) -> Spectrum {
    derived(k, |nm, k| 4.0 * PI * k / (nm.max(1e-9) * 1e-9))
}

/// Internal transmittance exp(-4πk d/λ) of a thickness d of `thickness_m` metres, surfaces not included.
pub fn internal_transmittance(k: &Spectrum, thickness_m: f64) -> Spectrum {
    derived(k, |nm, k| (-4.0 * PI * k * thickness_m.max(0.0) / (nm.max(1e-9) * 1e-9)).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::library;

    /// CIE 171:2006 case 5.5, inter-reflection included.
    #[test]
    fn clear_glass_at_normal_incidence() {
        let sheet = pane(1.0, 1.52, 1.0);
        assert!((sheet.transmittance - 0.91832).abs() < 5e-6, "{sheet:?}");
        let f: f64 = 0.042_580;
        assert!((sheet.transmittance - (1.0 - f) / (1.0 + f)).abs() < 1e-6);
    }

    #[test]
    fn a_clear_sheet_loses_nothing_and_a_dark_one_never_gains() {
        for i in 0..=1000 {
            let cos = f64::from(i) / 1000.0;
            for n in [0.7, 1.0, 1.33, 1.52, 2.4] {
                let clear = pane(cos, n, 1.0);
                assert!((clear.reflectance + clear.transmittance - 1.0).abs() < 1e-12, "{cos} {n} {clear:?}");
                let dark = pane(cos, n, 0.5);
                assert!(dark.reflectance + dark.transmittance <= 1.0 + 1e-12 && dark.transmittance <= 0.5);
                assert_eq!(pane(cos, n, 0.0).transmittance, 0.0);
            }
        }
        for odd in [f64::NAN, -1.0, 0.0, 1e300] {
            let sheet = pane(odd, odd, odd);
            assert!(sheet.reflectance.is_finite() && sheet.transmittance.is_finite());
        }
    }

    /// At Brewster's angle p light passes both faces untouched.
    #[test]
    fn polarisations_are_kept_apart() {
        let n: f64 = 1.5;
        let s = fresnel::polarised(n.atan().cos(), n, 0.0)[0];
        let expected = 0.5 * (1.0 + (1.0 - s) / (1.0 + s));
        assert!((pane(n.atan().cos(), n, 1.0).transmittance - expected).abs() < 1e-12);
    }

    #[test]
    fn coloured_glass_has_the_transmittance_its_table_gives() {
        let (_, k) = library::refractive_index("colour_glass_blue_ieb400").unwrap();
        let through = internal_transmittance(&k, 2e-3);
        assert!((through.at(380.0) - 0.858318).abs() < 1e-5 && (through.at(385.0) - 0.8718938).abs() < 1e-5);
        assert!(((-2e-3 * absorption_from_k(&k).at(380.0)).exp() - through.at(380.0)).abs() < 1e-12);
    }
}

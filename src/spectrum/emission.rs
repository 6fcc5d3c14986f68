//! Samples the spectrum of a light so that its colour survives.

use super::{Spectrum, Wavelengths, xyz_of};
use glam::{DMat3, DVec3};

/// See [`Wavelengths::sample_emission`].
pub(super) fn sample(wavelengths: &Wavelengths, spectrum: &Spectrum) -> Vec<f64> {
    let plain: Vec<f64> = wavelengths.bands.iter().map(|&[lo, hi]| spectrum.mean(lo, hi).max(0.0)).collect();
    let exact = xyz_of(spectrum);
    if let Some(moved) = moved_to(wavelengths, &plain, exact) {
        return moved;
    }
    let scaled = |samples: &[f64]| {
        let scale = exact[1] / wavelengths.xyz(samples)[1];
        (scale.is_finite() && scale >= 0.0).then(|| samples.iter().map(|s| scale * s).collect::<Vec<f64>>())
    };
    scaled(&plain).or_else(|| scaled(&vec![1.0; plain.len()])).unwrap_or_else(|| vec![0.0; plain.len()])
}

/// `samples` moved to have `xyz` exactly, minimising Σ ((s' - s)/s)²: s' = s + D² W q with D = diag(s) and
/// (Wᵀ D² W) q = xyz - Wᵀ s. `None` where the three conditions cannot be met with positive samples.
fn moved_to(wavelengths: &Wavelengths, samples: &[f64], xyz: [f64; 3]) -> Option<Vec<f64>> {
    let weights = || wavelengths.xyz_weights.iter().map(|&w| super::LUMENS_PER_WATT * DVec3::from(w));
    let mut normal = DMat3::ZERO;
    for (w, s) in weights().zip(samples) {
        normal += (s * s) * DMat3::from_cols(w * w.x, w * w.y, w * w.z);
    }
    // Scaled to a unit diagonal the determinant tells whether three independent samples take part.
    let diagonal = DVec3::new(normal.x_axis.x, normal.y_axis.y, normal.z_axis.z);
    if diagonal.min_element() <= 0.0 || normal.determinant() < 1e-12 * diagonal.element_product() {
        return None;
    }
    let q = normal.inverse() * (DVec3::from(xyz) - DVec3::from(wavelengths.xyz(samples)));
    let moved: Vec<f64> = weights().zip(samples).map(|(w, s)| s + s * s * w.dot(q)).collect();
    let found = DVec3::from(wavelengths.xyz(&moved));
    let exact = (found - DVec3::from(xyz)).abs().max_element() <= 1e-9 * xyz[1].abs();
    let positive = moved.iter().zip(samples).all(|(m, &s)| if s > 0.0 { *m > 0.0 } else { *m == 0.0 });
    (exact && positive).then_some(moved)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::library;

    fn counts() -> Vec<Wavelengths> {
        let bands = [4, 8, 16, 32, 81, 256].map(|n| Wavelengths::bands(n).unwrap());
        [Wavelengths::meyer4()].into_iter().chain(bands).collect()
    }

    #[test]
    fn the_illuminants_keep_their_colour() {
        for name in library::illuminant_names() {
            let light = library::illuminant(name).unwrap();
            let exact = xyz_of(&light);
            for wavelengths in counts() {
                let samples = wavelengths.sample_emission(&light);
                let found = wavelengths.xyz(&samples);
                assert!(samples.iter().all(|s| *s >= 0.0));
                for c in 0..3 {
                    assert!(
                        (found[c] / exact[c] - 1.0).abs() < 1e-8,
                        "{name} {} {found:?}",
                        wavelengths.len()
                    );
                }
            }
        }
    }

    #[test]
    fn luminance_survives_even_where_the_samples_miss_a_line() {
        for line_nm in [400.0, 456.4, 490.0, 510.0, 589.3, 631.4, 700.0] {
            let line = Spectrum::tabulated(vec![line_nm - 1.0, line_nm, line_nm + 1.0], vec![0.0, 1.0, 0.0])
                .unwrap();
            for wavelengths in counts() {
                let samples = wavelengths.sample_emission(&line);
                let y = wavelengths.xyz(&samples)[1];
                assert!(samples.iter().all(|s| s.is_finite() && *s >= 0.0));
                assert!((y / xyz_of(&line)[1] - 1.0).abs() < 1e-8, "{line_nm} nm, {} samples", samples.len());
            }
        }
    }

    #[test]
    fn darkness_stays_dark() {
        for wavelengths in counts() {
            assert!(wavelengths.sample_emission(&Spectrum::Constant(0.0)).iter().all(|s| *s == 0.0));
            assert!(wavelengths.sample_emission(&Spectrum::Constant(-1.0)).iter().all(|s| *s == 0.0));
        }
    }
}

//! From RGB to spectra: the smooth, bounded reflectances of W. Jakob and J. Hanika, *A Low-Dimensional Function Space
//! for Efficient Spectral Upsampling* (2019), and lights of D65 seen through them.
//!
//! A reflectance is S(c₀ t² + c₁ t + c₂) with S(x) = 1/2 + x/(2 sqrt(1 + x²)) and t from -1 at 380 nm to 1 at 780 nm. The
//! paper looks the coefficients up in a table made beforehand; here they are found for each colour when it is met, which
//! takes about six steps from the grey of its luminance. Its colour is the one under D65 for the CIE 1931 observer.
//! Over the whole sRGB cube the spectrum has the colour it was made from within a CIEDE2000 of 0.001.

use super::lab::lab;
use super::srgb::{D65_WHITE, linear_srgb_luminance, linear_srgb_to_xyz};
use crate::spectrum::{Spectrum, library, standard_observer::colour_matching_functions, xyz_of};
use glam::{DMat3, DVec3};
use std::sync::LazyLock;

/// A spectrum made here has a knot every 5 nm from 380 to 780 nm.
const KNOTS: usize = 81;
const STEP_NM: f64 = 5.0;
const FIRST_NM: f64 = 380.0;

/// Squared distance in L\*a\*b\* at which a colour is met.
const MET: f64 = 1e-8;
const MAX_STEPS: usize = 80;

/// The XYZ under D65 of a reflectance that is linear between knots: Σ weight × value, Y of white 1.
struct Observed {
    weights: Vec<DVec3>,
    white: DVec3,
}

static OBSERVED: LazyLock<Observed> = LazyLock::new(|| {
    let light = library::illuminant("D65").unwrap_or(Spectrum::Constant(1.0));
    let mut weights = vec![DVec3::ZERO; KNOTS];
    for (i, cmf) in colour_matching_functions().iter().enumerate() {
        let at = i as f64 / STEP_NM;
        let (knot, f) = (at as usize, at.fract());
        let seen = light.at(FIRST_NM + i as f64) * DVec3::from(*cmf);
        weights[knot] += (1.0 - f) * seen;
        if f > 0.0 {
            weights[knot + 1] += f * seen;
        }
    }
    let sum: DVec3 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum.y);
    Observed { weights, white: sum / sum.y }
});

/// A reflectance with the colour of linear sRGB `rgb` under D65: each component is held to 0 to 1, what is
/// not a number counts as 0. A grey is the same at every wavelength.
pub fn reflectance_of_srgb(rgb: [f64; 3]) -> Spectrum {
    let rgb = rgb.map(|x| held(x, 1.0));
    if rgb[0] == rgb[1] && rgb[1] == rgb[2] {
        return Spectrum::Constant(rgb[0]);
    }
    let c = fit(rgb);
    let nm = (0..KNOTS).map(|i| FIRST_NM + STEP_NM * i as f64).collect();
    Spectrum::Tabulated { nm, value: (0..KNOTS).map(|i| sigmoid(polynomial(c, i))).collect() }
}

/// The radiance, W m⁻² sr⁻¹ nm⁻¹, of a light whose linear sRGB is `rgb` in cd m⁻²: D65 times the reflectance of the
/// same chromaticity, with the luminance of `rgb`. White is D65. Components that are negative or not a number count as 0.
pub fn radiance_of_srgb(rgb: [f64; 3]) -> Spectrum {
    let rgb = rgb.map(|x| held(x, f64::MAX));
    let largest = rgb[0].max(rgb[1]).max(rgb[2]);
    let light = library::illuminant("D65").unwrap_or(Spectrum::Constant(1.0));
    if largest == 0.0 {
        return Spectrum::Constant(0.0);
    }
    let shape = reflectance_of_srgb(rgb.map(|x| x / largest));
    let shape = light.times(|nm| shape.at(nm));
    // Divided before it is multiplied: the luminance of the largest numbers is none.
    let factor = largest * (linear_srgb_luminance(rgb.map(|x| x / largest)) / xyz_of(&shape)[1]);
    shape.times(|_| factor)
}

/// `x` within 0 to `most`; what is not a number counts as 0.
fn held(x: f64, most: f64) -> f64 {
    if x > 0.0 { x.min(most) } else { 0.0 }
}

/// A linear sRGB colour as XYZ under D65 with Y of white 1. The white is that of the CIE's table, from which the
/// rounded one of sRGB differs by 10⁻⁴.
fn target(rgb: [f64; 3]) -> [f64; 3] {
    let xyz = linear_srgb_to_xyz(rgb);
    [0, 1, 2].map(|c| xyz[c] * OBSERVED.white[c] / D65_WHITE[c])
}

/// The coefficients whose colour is nearest to `rgb`, by Levenberg and Marquardt's steps in L\*a\*b\* from the grey of
/// its luminance.
fn fit(rgb: [f64; 3]) -> DVec3 {
    let xyz = target(rgb);
    let wanted = DVec3::from(lab(xyz, OBSERVED.white.to_array()));
    let y = xyz[1].clamp(1e-4, 1.0 - 1e-4);
    let mut c = DVec3::new(0.0, 0.0, (y - 0.5) / (y * (1.0 - y)).sqrt());
    let (mut found, mut slope) = colour(c);
    let mut damping = 1e-4;
    for _ in 0..MAX_STEPS {
        let wrong = wanted - found;
        if wrong.length_squared() < MET {
            break;
        }
        let mut normal = slope.transpose() * slope;
        for axis in 0..3 {
            normal.col_mut(axis)[axis] *= 1.0 + damping;
        }
        let tried = c + normal.inverse() * (slope.transpose() * wrong);
        let better = tried.is_finite().then(|| colour(tried)).filter(|(lab, _)| {
            let left = (wanted - *lab).length_squared();
            left < wrong.length_squared()
        });
        match better {
            Some(next) => {
                (c, (found, slope)) = (tried, next);
                damping = f64::max(0.1 * damping, 1e-12);
            }
            None => damping *= 10.0,
        }
    }
    c
}

/// L\*a\*b\* of the reflectance with coefficients `c` under D65, and its derivative: a column for each coefficient.
fn colour(c: DVec3) -> (DVec3, DMat3) {
    let (mut xyz, mut columns) = (DVec3::ZERO, [DVec3::ZERO; 3]);
    for (i, &weight) in OBSERVED.weights.iter().enumerate() {
        let (t, x) = (place(i), polynomial(c, i));
        xyz += sigmoid(x) * weight;
        let slope = 0.5 / (1.0 + x * x).powf(1.5);
        for (column, power) in columns.iter_mut().zip([t * t, t, 1.0]) {
            *column += slope * power * weight;
        }
    }
    let white = OBSERVED.white;
    // Of the cube root in the definition of L*a*b*, and of the line that takes its place near black.
    let root = |axis: usize| {
        const DELTA: f64 = 6.0 / 29.0;
        let t: f64 = xyz[axis] / white[axis];
        let slope = if t > DELTA.powi(3) { t.cbrt().powi(-2) } else { (DELTA * DELTA).recip() };
        slope / (3.0 * white[axis])
    };
    let root = DVec3::new(root(0), root(1), root(2));
    let columns = columns.map(|column| {
        let d = root * column;
        DVec3::new(116.0 * d.y, 500.0 * (d.x - d.y), 200.0 * (d.y - d.z))
    });
    let found = DVec3::from(lab(xyz.to_array(), white.to_array()));
    (found, DMat3::from_cols(columns[0], columns[1], columns[2]))
}

/// t of a knot.
fn place(knot: usize) -> f64 {
    -1.0 + 2.0 * knot as f64 / (KNOTS - 1) as f64
}

fn polynomial(c: DVec3, knot: usize) -> f64 {
    let t = place(knot);
    (c.x * t + c.y) * t + c.z
}

/// S; between 0 and 1 for every x.
fn sigmoid(x: f64) -> f64 {
    // For large x the square overflows, and the quotient is 0 where it should be 1.
    let x = x.clamp(-1e9, 1e9);
    (0.5 + 0.5 * x / (1.0 + x * x).sqrt()).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::{decode_srgb, delta_e_2000};
    use crate::spectrum::Wavelengths;

    /// Encoded values of the cube: the faces, edges and corners of the gamut are part of it.
    fn cube(side: usize) -> impl Iterator<Item = [f64; 3]> {
        let at = move |i: usize| decode_srgb(i as f64 / side as f64);
        (0..(side + 1).pow(3)).map(move |i| {
            let n = side + 1;
            [at(i / (n * n)), at(i / n % n), at(i % n)]
        })
    }

    fn d65() -> Spectrum {
        library::illuminant("D65").expect("it is built in")
    }

    /// Measured by the sums at 1 nm of the observer, not by the weights of the fit.
    #[test]
    fn every_colour_of_srgb_comes_back() {
        let light = d65();
        let white = xyz_of(&light);
        let mut worst: f64 = 0.0;
        for rgb in
            cube(8).chain([[1e-5, 0.0, 0.0], [0.0, 1e-9, 2e-9], [1.0, 1.0, 1.0 - 1e-9], [1.0, 0.999, 1.0]])
        {
            let spectrum = reflectance_of_srgb(rgb);
            assert!(spectrum.min() >= 0.0 && spectrum.max() <= 1.0, "{rgb:?}");
            let xyz = xyz_of(&light.times(|nm| spectrum.at(nm))).map(|x| x / white[1]);
            let white = white.map(|x| x / white[1]);
            worst = worst.max(delta_e_2000(lab(target(rgb), white), lab(xyz, white)));
        }
        assert!(worst < 1e-3, "{worst}");
    }

    /// What the bands of a run add to that is the error of the bands, and falls with their number.
    #[test]
    fn few_wavelengths_keep_the_colours_too() {
        let light = d65();
        let white = xyz_of(&light);
        let mean_error = |wavelengths: &Wavelengths| {
            let lamp = wavelengths.sample_emission(&light);
            let errors: Vec<f64> = cube(4)
                .map(|rgb| {
                    let samples = wavelengths.sample(&reflectance_of_srgb(rgb));
                    let lit: Vec<f64> = samples.iter().zip(&lamp).map(|(r, l)| r * l).collect();
                    let xyz = wavelengths.xyz(&lit).map(|x| x / white[1]);
                    let white = white.map(|x| x / white[1]);
                    delta_e_2000(lab(target(rgb), white), lab(xyz, white))
                })
                .collect();
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        for (count, allowed) in [(8, 2.0), (16, 0.8), (32, 0.3)] {
            let error = mean_error(&Wavelengths::bands(count).expect("a sound count"));
            assert!(error < allowed, "{count}: {error}");
        }
        let error = mean_error(&Wavelengths::meyer4());
        assert!(error < 8.0, "meyer4: {error}");
    }

    #[test]
    fn lights_have_the_luminance_and_the_colour_asked_for() {
        for rgb in [[17.0, 12.0, 4.0], [1.0, 1.0, 1.0], [0.0, 0.0, 3e-6], [1e9, 0.0, 2.0]] {
            let radiance = radiance_of_srgb(rgb);
            let (xyz, wanted) = (xyz_of(&radiance), linear_srgb_to_xyz(rgb));
            for c in 0..3 {
                assert!(
                    (xyz[c] - wanted[c]).abs() < 1e-3 * wanted.iter().sum::<f64>(),
                    "{rgb:?}: {xyz:?} {wanted:?}"
                );
            }
            assert!((xyz[1] / wanted[1] - 1.0).abs() < 1e-9);
        }
        assert_eq!(xyz_of(&radiance_of_srgb([0.0, -1.0, f64::NAN])), [0.0; 3]);
    }

    #[test]
    fn no_number_gives_anything_but_a_reflectance() {
        for x in [f64::NAN, -1.0, 0.0, 1e-300, 0.5, 1.0, 2.0, f64::INFINITY] {
            for y in [f64::NAN, 0.0, 1e-300, 0.3, 1.0] {
                let spectrum = reflectance_of_srgb([x, y, 0.2]);
                assert!(spectrum.min() >= 0.0 && spectrum.max() <= 1.0, "{x} {y}");
                let light = radiance_of_srgb([x, y, 1e300]);
                assert!(light.min() >= 0.0 && light.max().is_finite(), "{x} {y}");
            }
        }
    }
}

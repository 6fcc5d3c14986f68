//! The wavelengths of a run and how to sum over them.

use super::standard_observer::{RANGE_NM, band_integrals, colour_matching_functions};
use super::{LUMENS_PER_WATT, Spectrum, emission, melanopic, table};
use crate::error::{Error, Result};

/// A band is divided into steps of at most this many nm where a product or another function of
/// several spectra is averaged over it.
const STEP_NM: f64 = 5.0;

/// Light of these wavelengths is seen best: equal bands divide this range, nm, and the two at its
/// ends go on to the ends of the visible range, where little is seen.
const SEEN_NM: [f64; 2] = [400.0, 700.0];

/// The wavelengths of a run and how to sum over them. A sampled spectrum is a slice of
/// `len()` numbers that means nothing without the `Wavelengths` it was sampled at.
#[derive(Clone, Debug, PartialEq)]
pub struct Wavelengths {
    /// Representative wavelength of each sample, nm.
    pub nm: Vec<f64>,
    /// Band that each sample averages over, nm; `lo == hi` for a point sample.
    pub bands: Vec<[f64; 2]>,
    /// Weights, nm: X = Σ w_x S(λ_i) stands for ∫ S x̄ dλ, and so on (CIE 1931, 2 degrees).
    pub xyz_weights: Vec<[f64; 3]>,
    /// Weights, nm: Σ w E(λ_i) stands for ∫ E s dλ with the melanopic action spectrum s.
    pub melanopic_weights: Vec<f64>,
    /// The parts of each band and their shares in its averages.
    parts: Vec<Vec<Part>>,
}

/// A part of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Part {
    nm: [f64; 2],
    /// The shares of a band's parts are not negative and add up to 1.
    share: f64,
}

impl Wavelengths {
    /// Point samples at `nm` (increasing) with weights of one's own: `[len()]` each.
    pub fn points(nm: Vec<f64>, xyz_weights: Vec<[f64; 3]>) -> Self {
        Wavelengths {
            bands: nm.iter().map(|&x| [x, x]).collect(),
            melanopic_weights: melanopic::point_weights(&nm),
            parts: nm.iter().map(|&x| vec![Part { nm: [x, x], share: 1.0 }]).collect(),
            nm,
            xyz_weights,
        }
    }

    /// The paper's four wavelengths, 456.4, 490.9, 557.7 and 631.4 nm: G. W. Meyer, *Wavelength
    /// Selection for Synthetic Image Generation* (1988), Gaussian quadrature against the opponent
    /// fundamentals A, C1, C2.
    ///
    /// The weights were computed anew from the CIE 1931 functions; a constant spectrum has exact
    /// XYZ. The matrix in circulation (a transcription of Hall, 1989) has one misplaced entry: the C1 weight
    /// 0.31824 stands in the column of 557.7 nm and belongs to 490.9 nm, where the two-point rule
    /// for C1 has its node; as printed the rule fails the first moment of C1 and nearly doubles
    /// the colour error. Some weights are negative: a saturated colour may get a negative X, Y or Z,
    /// to be clamped after the sum and never per wavelength.
    pub fn meyer4() -> Self {
        let weights = table::columns(include_str!("data/meyer4_weights_xyz.csv"));
        let nm = vec![456.4, 490.9, 557.7, 631.4];
        let xyz_weights = nm.iter().map(|&x| [0, 1, 2].map(|c| weights[c].1.at(x))).collect();
        Self::points(nm, xyz_weights)
    }

    /// `count` bands over 380 to 780 nm, each spectrum averaged over the band; the weights are the
    /// integrals of the colour matching functions over it. All bands are equal but for the first and the
    /// last, which go on from 400 and 700 nm to the ends. 1 to 256 bands, else [`Error::Settings`].
    pub fn bands(count: usize) -> Result<Self> {
        if !(1..=256).contains(&count) {
            return Err(Error::Settings(format!("{count} wavelength bands: choose 1 to 256")));
        }
        Ok(Self::of_bands(count))
    }

    /// [`Self::bands`] of a count known to be right.
    pub(crate) fn of_bands(count: usize) -> Self {
        let edge = |i: usize| match i {
            0 => RANGE_NM[0],
            i if i == count => RANGE_NM[1],
            i => SEEN_NM[0] + (SEEN_NM[1] - SEEN_NM[0]) * i as f64 / count as f64,
        };
        Self::averaged((0..count).map(|i| [edge(i), edge(i + 1)]).collect(), &Spectrum::Constant(1.0))
    }

    /// The same bands for a scene lit by `light`, W m⁻² nm⁻¹ or any unit: averages over a band count each
    /// wavelength by the light there. So the average of the *product* of light and reflectance over a
    /// band is the product of the averages, however spiky the light. Point samples stay as they are.
    pub fn under(&self, light: &Spectrum) -> Self {
        if self.bands.iter().any(|[lo, hi]| lo >= hi) {
            return self.clone();
        }
        Self::averaged(self.bands.clone(), light)
    }

    fn averaged(bands: Vec<[f64; 2]>, light: &Spectrum) -> Self {
        let even = Spectrum::Constant(1.0);
        let (mut xyz_weights, mut melanopic_weights, mut parts) = (Vec::new(), Vec::new(), Vec::new());
        for &[lo, hi] in &bands {
            let lit = light.mean(lo, hi);
            let (light, lit) = if lit > 0.0 && lit.is_finite() { (light, lit) } else { (&even, 1.0) };
            let integrals = band_integrals(colour_matching_functions(), [lo, hi], light);
            xyz_weights.push(integrals.map(|x| x / lit));
            let [melanopic] = band_integrals(melanopic::action(), [lo, hi], light);
            melanopic_weights.push(melanopic / lit);
            let count = ((hi - lo) / STEP_NM).ceil().max(1.0);
            let edge = |k: f64| if k == count { hi } else { lo + (hi - lo) * k / count };
            parts.push(
                (0..count as usize)
                    .map(|k| [edge(k as f64), edge(k as f64 + 1.0)])
                    .map(|nm| Part {
                        nm,
                        share: light.mean(nm[0], nm[1]) * (nm[1] - nm[0]) / (lit * (hi - lo)),
                    })
                    .collect(),
            );
        }
        let nm = bands.iter().map(|[lo, hi]| 0.5 * (lo + hi)).collect();
        Wavelengths { nm, bands, xyz_weights, melanopic_weights, parts }
    }

    /// Eight bands: twice the work of four wavelengths in what depends on their number, and a mean colour
    /// error of about 1 CIEDE2000, just noticeable, under any light (four bands 3.5 to 5.4, `meyer4` 3.2 to 8.9
    /// with errors up to 28; 16 bands 0.15 to 0.35): see `report::wavelength_table`.
    pub fn standard() -> Self {
        Self::of_bands(8)
    }

    /// `meyer4`, or a number of bands from `4` to `256`; else [`Error::Settings`] with the choice.
    pub fn parse(text: &str) -> Result<Self> {
        match (text.trim(), text.trim().parse()) {
            ("meyer4", _) => Ok(Self::meyer4()),
            (_, Ok(count @ 4..=256)) => Self::bands(count),
            (other, _) => Err(Error::Settings(format!(
                "wavelengths \"{other}\": choose meyer4, or a number of bands from 4 to 256"
            ))),
        }
    }

    /// How many samples.
    pub fn len(&self) -> usize {
        self.nm.len()
    }

    /// Never true.
    pub fn is_empty(&self) -> bool {
        self.nm.is_empty()
    }

    /// A reflectance, a transmittance or another property of matter at every wavelength, or its mean
    /// over every band under the light of [`Self::under`]: `[len()]`.
    pub fn sample(&self, spectrum: &Spectrum) -> Vec<f64> {
        let mean = |parts: &Vec<Part>| {
            parts.iter().map(|part| part.share * spectrum.mean(part.nm[0], part.nm[1])).sum()
        };
        self.parts.iter().map(mean).collect()
    }

    /// The mean of `f(λ)` over band `i` under the light of [`Self::under`], or its value at a point
    /// sample: for functions of several spectra, whose mean is not the function of the means.
    pub fn average(&self, i: usize, f: impl Fn(f64) -> f64) -> f64 {
        self.parts[i].iter().map(|part| part.share * f(0.5 * (part.nm[0] + part.nm[1]))).sum()
    }

    /// The spectrum of a light: its value at every wavelength, or its plain mean over every band, then moved by the
    /// least relative change that makes its XYZ by these weights those of the full spectrum. Where that would turn a
    /// sample negative the samples are scaled so that Y alone is exact, and where they cannot carry Y either (a narrow line
    /// that they miss) they are those of an equal-energy light with the same Y: luminance is always kept.
    pub fn sample_emission(&self, spectrum: &Spectrum) -> Vec<f64> {
        emission::sample(self, spectrum)
    }

    /// X, Y, Z of sampled radiance `[len()]`, W m⁻² sr⁻¹ nm⁻¹, `f32` or `f64`: Y in cd m⁻² (683 lm/W
    /// included). May be negative for saturated colours.
    pub fn xyz<T: Copy + Into<f64>>(&self, values: &[T]) -> [f64; 3] {
        let mut xyz = [0.0; 3];
        for (weights, &value) in self.xyz_weights.iter().zip(values) {
            let value: f64 = LUMENS_PER_WATT * value.into();
            for (sum, weight) in xyz.iter_mut().zip(weights) {
                *sum += weight * value;
            }
        }
        xyz
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::xyz_of;

    #[test]
    fn a_constant_spectrum_has_exact_xyz_at_any_count() {
        let exact = xyz_of(&Spectrum::Constant(1.0));
        let all = [Wavelengths::meyer4()]
            .into_iter()
            .chain([1, 2, 4, 7, 16, 81, 256].map(|n| Wavelengths::bands(n).unwrap()));
        for wavelengths in all {
            let xyz = wavelengths.xyz(&vec![1.0_f32; wavelengths.len()]);
            for c in 0..3 {
                assert!((xyz[c] / exact[c] - 1.0).abs() < 2e-9, "{} {xyz:?} {exact:?}", wavelengths.len());
            }
        }
    }

    #[test]
    fn parse_accepts_the_choice_and_names_it_otherwise() {
        assert_eq!(Wavelengths::parse("meyer4").unwrap(), Wavelengths::meyer4());
        assert_eq!(Wavelengths::parse("16").unwrap().len(), 16);
        for wrong in ["", "3", "257", "meyer", "-4", "4.5", "99999999999999999999999"] {
            let message = Wavelengths::parse(wrong).unwrap_err().to_string();
            assert!(message.contains("meyer4") && message.contains("256"), "{message}");
        }
        assert!(Wavelengths::bands(0).is_err() && Wavelengths::bands(257).is_err());
    }

    #[test]
    fn averages_agree_with_means_for_linear_functions() {
        let ramp = Spectrum::tabulated(vec![380.0, 780.0], vec![0.0, 1.0]).unwrap();
        for wavelengths in
            [Wavelengths::meyer4(), Wavelengths::bands(4).unwrap(), Wavelengths::bands(100).unwrap()]
        {
            for (i, mean) in wavelengths.sample(&ramp).into_iter().enumerate() {
                assert!((wavelengths.average(i, |nm| ramp.at(nm)) - mean).abs() < 1e-12);
            }
        }
    }
}

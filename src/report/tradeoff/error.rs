//! How far an image is from the truth, seen through a judge that is noisy itself.
//!
//! With T₁, T₂ two images of one setting that differ by their seeds alone, J the judge and σ² the variance that J knows
//! of each of its pixels, (T₁ - J)(T₂ - J) - σ² is in the mean the square of what T is systematically wrong by, and
//! (T₁ - T₂)² / 2 the variance of its noise: neither holds the judge's noise. What is left is how uncertain the first is.
//!
//! Pixels that show a lamp, and their neighbours, do not count for luminance: its own is given, not computed, and so much
//! brighter than all that it lights that the steps along its edge would drown what is asked here.

use crate::colour::{D65_WHITE, delta_e_2000, lab, linear_srgb_to_xyz};
use crate::error::{Error, Result};
use crate::output::{LinearImage, compare};
use serde::{Deserialize, Serialize};

/// An image that counts as true, but for its noise.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The image.
    pub image: LinearImage,
    /// Standard error of each pixel's luminance, cd m⁻²; zeros where it is not known.
    pub noise: Vec<f32>,
    /// Whether each pixel counts for luminance.
    pub counts: Vec<bool>,
}

/// What an image is wrong by. Luminances are those of the pixels that count, relative to the judge's mean over them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Root mean square error of luminance, the judge's noise taken off; 0 where that is more than all there is.
    pub rmse: f64,
    /// What the judge leaves open: the true root mean square error is at least this
    pub rmse_low: f64,
    /// and at most this, two standard deviations either way.
    pub rmse_high: f64,
    /// The part of `rmse` that is the same whatever the seed.
    pub systematic: f64,
    /// The part that another seed would change: noise of the second pass.
    pub noise: f64,
    /// Mean luminance over the judge's, less 1.
    pub mean: f64,
    /// Root mean square error over all pixels, lamps and the judge's noise included.
    pub rmse_all: f64,
    /// Mean CIEDE2000 to the judge, its noise and all: the true mean is at most the judge's own
    /// ([`Judged::delta_e_of_noise`]) away.
    pub delta_e_mean: f64,
    /// 95th percentile of the same.
    pub delta_e_95: f64,
}

impl Judged {
    /// The pixels that count; all, if none does.
    fn counted(&self) -> Vec<usize> {
        let some = self.counts.contains(&true);
        (0..self.image.pixels()).filter(|&p| !some || self.counts[p]).collect()
    }

    /// Mean luminance of the pixels that count, cd m⁻².
    pub fn mean_luminance(&self) -> f64 {
        let counted = self.counted();
        counted.iter().map(|&p| self.image.luminance(p)).sum::<f64>() / counted.len().max(1) as f64
    }

    /// Standard error of luminance, root mean square over the pixels, relative to the mean luminance.
    pub fn relative_noise(&self) -> f64 {
        let counted = self.counted();
        let squares: f64 = counted.iter().map(|&p| f64::from(self.noise[p]).powi(2)).sum();
        share((squares / counted.len().max(1) as f64).sqrt(), self.mean_luminance())
    }

    /// Mean CIEDE2000 that the noise of luminance alone makes between this image and the truth, on the scale of
    /// [`compare`].
    pub fn delta_e_of_noise(&self) -> f64 {
        let white = crate::output::png::white_of(&self.image);
        let n = self.image.pixels();
        let of = |p: usize| {
            let y = self.image.luminance(p);
            let rgb = [0, 1, 2].map(|c| f64::from(self.image.rgb[3 * p + c]) / white);
            let moved = |by: f64| {
                let scale = share(y + by, y);
                lab(linear_srgb_to_xyz(rgb.map(|x| x * scale)), D65_WHITE)
            };
            // The mean of |x| of a normal deviate is sqrt(2/π) of its standard deviation.
            let by = f64::from(self.noise[p]) * std::f64::consts::FRAC_2_PI.sqrt();
            delta_e_2000(moved(0.0), moved(by))
        };
        let sum: f64 = (0..n).map(of).filter(|d| d.is_finite()).sum();
        sum / n.max(1) as f64
    }

    /// What two images of one setting and two seeds are wrong by.
    ///
    /// # Errors
    /// [`Error::Settings`] for images of another size.
    pub fn errors(&self, images: &[LinearImage; 2]) -> Result<Errors> {
        if self.noise.len() != self.image.pixels() || self.counts.len() != self.image.pixels() {
            return Err(Error::Settings("the judge does not know the noise of every pixel".into()));
        }
        let colours = [compare(&self.image, &images[0])?, compare(&self.image, &images[1])?];
        let counted = self.counted();
        let n = counted.len().max(1) as f64;
        let (mut systematic, mut noise, mut open, mut mean) = (0.0, 0.0, 0.0, 0.0);
        for p in counted {
            let (judge, variance) = (self.image.luminance(p), f64::from(self.noise[p]).powi(2));
            let [a, b] = [0, 1].map(|k: usize| images[k].luminance(p) - judge);
            systematic += (a * b - variance) / n;
            noise += (a - b).powi(2) / (2.0 * n);
            // Variance of a b - σ² by the judge's noise alone.
            let off = (0.25 * (a + b).powi(2) - variance).max(0.0);
            open += (4.0 * off + 2.0 * variance) * variance;
            mean += 0.5 * (a + b) / n;
        }
        let open = 2.0 * open.sqrt() / n;
        let square = systematic + noise;
        let luminance = self.mean_luminance();
        let relative = |square: f64| share(square.max(0.0).sqrt(), luminance);
        Ok(Errors {
            rmse: relative(square),
            rmse_low: relative(square - open),
            rmse_high: relative(square + open),
            systematic: relative(systematic),
            noise: relative(noise),
            mean: share(mean, luminance),
            rmse_all: 0.5 * (colours[0].relative_rmse + colours[1].relative_rmse),
            delta_e_mean: 0.5 * (colours[0].delta_e_mean + colours[1].delta_e_mean),
            delta_e_95: 0.5 * (colours[0].delta_e_95 + colours[1].delta_e_95),
        })
    }
}

/// `part` of `whole`, 0 in the dark.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of mean 0 and variance 1, the same each time: sums of four uniform ones.
    fn deviates(seed: u32, n: usize) -> Vec<f32> {
        let of = |i: usize| {
            let set = sobol_burley::sample_4d(i as u32, 0, seed).map(f64::from);
            ((set.iter().sum::<f64>() - 2.0) * 3f64.sqrt()) as f32
        };
        (0..n).map(of).collect()
    }

    fn grey(values: impl Iterator<Item = f32>) -> LinearImage {
        let rgb: Vec<f32> = values.flat_map(|v| [v; 3]).collect();
        LinearImage { width: (rgb.len() / 3) as u32, height: 1, rgb }
    }

    #[test]
    fn systematic_error_and_noise_are_told_apart_through_a_noisy_judge() {
        const N: usize = 1 << 14;
        let truth = |p: usize| 10.0 + 5.0 * (p as f32 * 0.01).sin();
        let judge = deviates(1, N);
        let judged = Judged {
            image: grey((0..N).map(|p| truth(p) + 0.5 * judge[p])),
            noise: vec![0.5; N],
            counts: vec![true; N],
        };
        // Off by 0.3 of a mean of 10, either way, and noise of 0.2: both below the judge's noise.
        let off = |p: usize| if p.is_multiple_of(2) { 0.3 } else { -0.3 };
        let image = |seed| {
            let own = deviates(seed, N);
            grey((0..N).map(move |p| truth(p) + off(p) + 0.2 * own[p]))
        };
        let errors = judged.errors(&[image(2), image(3)]).unwrap();
        assert!((judged.relative_noise() / 0.05 - 1.0).abs() < 0.01);
        assert!((errors.systematic / 0.03 - 1.0).abs() < 0.05, "{errors:?}");
        assert!((errors.noise / 0.02 - 1.0).abs() < 0.02, "{errors:?}");
        let rmse = 0.01 * 13f64.sqrt();
        assert!(errors.rmse_low < rmse && rmse < errors.rmse_high, "{errors:?}");
        assert!(errors.rmse_high - errors.rmse_low < 0.1 * rmse, "{errors:?}");
        assert!(errors.mean.abs() < 1e-3, "{errors:?}");
        let of_noise = judged.delta_e_of_noise();
        assert!((errors.delta_e_mean - of_noise).abs() < of_noise, "{of_noise} {errors:?}");
        // What does not count changes nothing.
        let mut counts = judged.clone();
        counts.counts[0] = false;
        counts.image.rgb[..3].fill(1e6);
        assert!((counts.errors(&[image(2), image(3)]).unwrap().rmse / errors.rmse - 1.0).abs() < 0.01);
        // The truth itself is found to be right within what the judge leaves open.
        let right = judged.errors(&[0, 0].map(|_| grey((0..N).map(truth)))).unwrap();
        assert!(right.rmse_low == 0.0 && right.rmse_high < 0.01, "{right:?}");
    }

    #[test]
    fn images_of_another_size_and_darkness_are_no_panic() {
        let dark = || grey([0.0; 4].into_iter());
        let judged = Judged { image: dark(), noise: vec![0.0; 4], counts: vec![false; 4] };
        assert_eq!(judged.errors(&[dark(), dark()]).unwrap().rmse, 0.0);
        assert_eq!((judged.relative_noise(), judged.delta_e_of_noise()), (0.0, 0.0));
        assert!(judged.errors(&[dark(), grey([0.0; 3].into_iter())]).is_err());
    }
}

//! How far two images are apart.

use super::LinearImage;
use super::png::white_of;
use crate::colour::{D65_WHITE, delta_e_2000, lab, linear_srgb_to_xyz};
use crate::error::{Error, Result};
use serde::Serialize;

/// How far image b is from image a.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Root of the mean square difference of luminance over the mean luminance of a. 0 for equal
    /// images, infinite where a is black and b is not or where a value is not finite.
    pub relative_rmse: f64,
    /// Mean luminance of b over that of a, less 1: what does not average out. 0 for equal images.
    pub relative_bias: f64,
    /// Mean CIEDE2000 over the pixels, where white is what a PNG of a at automatic exposure shows as white.
    pub delta_e_mean: f64,
    /// 95th percentile of the same.
    pub delta_e_95: f64,
    /// Largest difference of a component of linear RGB, cd m⁻².
    pub max_abs: f64,
    /// Whether every component has the same bits.
    pub same_bits: bool,
}

/// Compares `b` with `a`, the reference. An [`Error::Settings`] for images of unequal size.
pub fn compare(a: &LinearImage, b: &LinearImage) -> Result<Difference> {
    if (a.width, a.height, a.rgb.len()) != (b.width, b.height, b.rgb.len()) {
        return Err(Error::Settings(format!(
            "images of {} x {} and {} x {} pixels cannot be compared: render both at one size",
            a.width, a.height, b.width, b.height
        )));
    }
    let (mut squares, mut sum, mut other) = (0.0, 0.0, 0.0);
    for pixel in 0..a.pixels() {
        let reference = a.luminance(pixel);
        squares += (b.luminance(pixel) - reference).powi(2);
        sum += reference;
        other += b.luminance(pixel);
    }
    let n = a.pixels().max(1) as f64;
    let rmse = (squares / n).sqrt();
    let relative = if rmse == 0.0 { 0.0 } else { rmse / (sum / n).abs() };
    let white = white_of(a);
    let colour = |image: &LinearImage, pixel: usize| {
        let rgb = [0, 1, 2].map(|c| f64::from(image.rgb[3 * pixel + c]) / white);
        lab(linear_srgb_to_xyz(rgb), D65_WHITE)
    };
    let mut delta_e: Vec<f64> = (0..a.pixels()).map(|p| delta_e_2000(colour(a, p), colour(b, p))).collect();
    delta_e.sort_by(f64::total_cmp);
    let finite = |x: f64| if x.is_nan() { f64::INFINITY } else { x };
    Ok(Difference {
        relative_bias: if other == sum { 0.0 } else { finite(other / sum - 1.0) },
        delta_e_mean: finite(delta_e.iter().sum::<f64>() / n),
        delta_e_95: delta_e.get((0.95 * (n - 1.0)).round() as usize).map_or(0.0, |d| finite(*d)),
        relative_rmse: finite(relative),
        max_abs: a
            .rgb
            .iter()
            .zip(&b.rgb)
            .map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs())
            .fold(0.0, f64::max),
        same_bits: a.rgb.iter().zip(&b.rgb).all(|(a, b)| a.to_bits() == b.to_bits()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(values: &[f32]) -> LinearImage {
        let rgb = values.iter().flat_map(|v| [*v; 3]).collect();
        LinearImage { width: values.len() as u32, height: 1, rgb }
    }

    #[test]
    fn known_differences() {
        let a = grey(&[1.0, 3.0]);
        let same = compare(&a, &a.clone()).unwrap();
        assert_eq!((same.relative_rmse, same.max_abs, same.same_bits), (0.0, 0.0, true));
        let b = compare(&a, &grey(&[2.0, 2.0])).unwrap();
        assert!((b.relative_rmse - 0.5).abs() < 1e-12, "{b:?}");
        assert_eq!((b.max_abs, b.same_bits, b.relative_bias), (1.0, false, 0.0));
        // White is 3 / 0.8: L* of 0.8 is 91.68, of 0.5333 78.06, of 0.2667 58.67; CIEDE2000 of greys weighs them.
        assert!(
            (same.delta_e_mean, same.delta_e_95) == (0.0, 0.0) && b.delta_e_mean > 8.0 && b.delta_e_95 < 20.0
        );
        assert!((compare(&a, &grey(&[2.0, 6.0])).unwrap().relative_bias - 1.0).abs() < 1e-12);
        assert!(!compare(&grey(&[0.0]), &grey(&[-0.0])).unwrap().same_bits);
        assert!(compare(&a, &grey(&[1.0])).is_err());
    }
}

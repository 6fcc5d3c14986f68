//! How far two images are apart.

use super::LinearImage;
use crate::error::{Error, Result};
use serde::Serialize;

/// How far image b is from image a.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Root of the mean square difference of luminance over the mean luminance of a. 0 for equal
    /// images, infinite where a is black and b is not or where a value is not finite.
    pub relative_rmse: f64,
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
    let (mut squares, mut sum) = (0.0, 0.0);
    for pixel in 0..a.pixels() {
        let reference = a.luminance(pixel);
        squares += (b.luminance(pixel) - reference).powi(2);
        sum += reference;
    }
    let n = a.pixels().max(1) as f64;
    let rmse = (squares / n).sqrt();
    let relative = if rmse == 0.0 { 0.0 } else { rmse / (sum / n).abs() };
    Ok(Difference {
        relative_rmse: if relative.is_nan() { f64::INFINITY } else { relative },
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
        assert_eq!((b.max_abs, b.same_bits), (1.0, false));
        assert!(!compare(&grey(&[0.0]), &grey(&[-0.0])).unwrap().same_bits);
        assert!(compare(&a, &grey(&[1.0])).is_err());
    }
}

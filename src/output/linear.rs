//! Spectral images as colours.

use crate::colour::{linear_srgb_luminance, xyz_to_linear_srgb};
use crate::second_pass::SpectralImage;

/// Luminous efficacy K_m, lm/W.
const LUMENS_PER_WATT: f64 = 683.0;

/// Linear RGB (primaries of Rec. 709, white D65), scaled so that the luminance of (1, 1, 1) is
/// 1 cd m⁻². Colours outside the gamut have negative components.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height][width][3]`, from the top left.
    pub rgb: Vec<f32>,
}

impl LinearImage {
    /// Luminance of a pixel (row by row from the top left), cd m⁻².
    pub fn luminance(&self, pixel: usize) -> f64 {
        linear_srgb_luminance([0, 1, 2].map(|c| f64::from(self.rgb[3 * pixel + c])))
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.rgb.len() / 3
    }
}

impl SpectralImage {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.radiance.len() / self.wavelengths.len().max(1)
    }

    /// Radiance of a pixel (row by row from the top left), W m⁻² sr⁻¹ nm⁻¹, `[W]`.
    pub fn spectrum(&self, pixel: usize) -> &[f32] {
        let w = self.wavelengths.len();
        &self.radiance[pixel * w..(pixel + 1) * w]
    }

    /// CIE 1931 X, Y, Z of a pixel; Y is its luminance, cd m⁻².
    pub fn xyz(&self, pixel: usize) -> [f64; 3] {
        let mut xyz = [0.0; 3];
        for (l, weights) in self.spectrum(pixel).iter().zip(&self.wavelengths.xyz_weights) {
            for (sum, weight) in xyz.iter_mut().zip(weights) {
                *sum += LUMENS_PER_WATT * weight * f64::from(*l);
            }
        }
        xyz
    }

    /// The image as linear RGB, out-of-gamut colours as they are.
    pub fn to_linear(&self) -> LinearImage {
        let mut rgb = Vec::with_capacity(3 * self.pixels());
        for pixel in 0..self.pixels() {
            rgb.extend(xyz_to_linear_srgb(self.xyz(pixel)).map(|c| c as f32));
        }
        LinearImage { width: self.width, height: self.height, rgb }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::Wavelengths;

    fn image(xyz_weights: Vec<[f64; 3]>, radiance: Vec<f32>) -> SpectralImage {
        let n = xyz_weights.len();
        let wavelengths = Wavelengths::points(vec![500.0; n], xyz_weights);
        SpectralImage { width: (radiance.len() / n) as u32, height: 1, wavelengths, radiance }
    }

    #[test]
    fn white_is_grey_and_luminance_is_absolute() {
        // Two wavelengths that together are 200 cd/m2 of the white of Rec. 709, x 0.3127, y 0.3290.
        let (x, z) = (0.3127 / 0.3290, (1.0 - 0.3127 - 0.3290) / 0.3290);
        let weights = vec![[x * 0.3, 0.8, 0.2], [x * 0.7, 0.2, z - 0.2]];
        let image = image(weights, vec![200.0 / 683.0; 2]);
        assert!((image.xyz(0)[1] - 200.0).abs() < 1e-4);
        let linear = image.to_linear();
        for c in &linear.rgb {
            assert!((c - 200.0).abs() < 0.02, "{:?}", linear.rgb);
        }
        assert!((linear.luminance(0) - 200.0).abs() < 0.02);
    }

    #[test]
    fn luminance_survives_for_saturated_colours() {
        let image = image(vec![[0.1, 0.9, 0.05]], vec![1.0, 0.01]);
        let linear = image.to_linear();
        assert!(linear.rgb.iter().any(|c| *c < 0.0), "out of gamut");
        for pixel in 0..2 {
            let y = image.xyz(pixel)[1];
            assert!((linear.luminance(pixel) - y).abs() < 2e-4 * y);
        }
    }
}

//! Textures: only their mean colour is taken.

use super::look::Rgb;
use crate::colour::decode_srgb;
use image::{ImageReader, Limits};
use std::io::Cursor;

/// An image may take this much memory while it is read, bytes.
const MOST_MEMORY: u64 = 512 << 20;
/// Largest width and height of an image, pixels.
const LARGEST_SIDE: u32 = 16384;
/// Image files above this size are not read, bytes.
pub const MAX_IMAGE_BYTES: u64 = 256 << 20;

/// The mean of an image: PNG or JPEG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// Of its sRGB values made linear.
    pub colour: Rgb,
    /// Of its values as they are, for textures that hold no colour.
    pub data: Rgb,
}

/// The mean of the image in `bytes`, or why there is none.
pub fn mean(bytes: &[u8]) -> Result<Mean, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    if reader.format().is_none() {
        return Err("this is neither PNG nor JPEG".into());
    }
    let mut limits = Limits::default();
    limits.max_alloc = Some(MOST_MEMORY);
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    reader.limits(limits);
    let pixels = reader.decode().map_err(|e| e.to_string())?.into_rgb8();
    let linear: Vec<f64> = (0..=255).map(|v| decode_srgb(f64::from(v) / 255.0)).collect();
    let mut counts = vec![[0u64; 3]; 256];
    for pixel in pixels.pixels() {
        for (channel, value) in pixel.0.iter().enumerate() {
            counts[usize::from(*value)][channel] += 1;
        }
    }
    let total = f64::from(pixels.width()) * f64::from(pixels.height());
    let of = |value: &dyn Fn(usize) -> f64| {
        [0, 1, 2].map(|c| (0..256).map(|v| counts[v][c] as f64 * value(v)).sum::<f64>() / total.max(1.0))
    };
    Ok(Mean { colour: of(&|v| linear[v]), data: of(&|v| v as f64 / 255.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageFormat, RgbImage};

    #[test]
    fn the_mean_is_of_light_not_of_code_values() {
        let image = RgbImage::from_fn(2, 2, |x, _| image::Rgb([255 * x as u8, 0, 255]));
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, ImageFormat::Png).expect("written");
        let mean = mean(bytes.get_ref()).expect("it is a PNG");
        assert!((0..3).all(|c| (mean.colour[c] - [0.5, 0.0, 1.0][c]).abs() < 1e-12));
        let cut = &bytes.get_ref()[..bytes.get_ref().len() / 2];
        assert!(super::mean(cut).is_err() && super::mean(b"").is_err() && super::mean(&[0xab; 64]).is_err());
    }
}

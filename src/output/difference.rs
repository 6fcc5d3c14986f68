//! A picture of where two images differ.

use super::LinearImage;
use crate::atomic_file;
use crate::error::{Error, Result};
use std::path::Path;

/// The relative difference of luminance that is shown in full colour.
const FULL: f64 = 0.2;

/// Writes to `path` how `b` differs from `a` in luminance, relative to `a` or to a hundredth of its mean where `a` is
/// darker: white for none, red where `b` is brighter, blue where it is darker, full colour from 20 % on.
///
/// # Errors
/// [`Error::Settings`] for images of unequal size, [`Error::Io`] when the file cannot be written.
pub fn write_difference(path: &Path, a: &LinearImage, b: &LinearImage) -> Result<()> {
    if (a.width, a.height, a.rgb.len()) != (b.width, b.height, b.rgb.len()) {
        return Err(Error::Settings("images of unequal size have no difference to show".into()));
    }
    let mean = (0..a.pixels()).map(|p| a.luminance(p)).sum::<f64>() / a.pixels().max(1) as f64;
    let colour = |p: usize| {
        let (reference, other) = (a.luminance(p), b.luminance(p));
        let relative = (other - reference) / reference.max(0.01 * mean).max(f64::MIN_POSITIVE);
        let faded = 1.0 - (relative.abs() / FULL).min(1.0);
        let byte = |x: f64| (255.0 * x).round() as u8;
        // What is not a number counts as too bright.
        if relative < 0.0 { [byte(faded), byte(faded), 255] } else { [255, byte(faded), byte(faded)] }
    };
    let data: Vec<u8> = (0..a.pixels()).flat_map(colour).collect();
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, a.width, a.height);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&data)?;
        writer.finish()
    });
    written.map_err(|e| Error::io(path, e))?;
    atomic_file::write(path, &bytes)
}

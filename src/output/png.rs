//! PNG previews: 8 bits, sRGB.

use super::LinearImage;
use crate::atomic_file;
use crate::colour::linear_srgb_luminance;
use crate::error::{Error, Result};
use crate::second_pass::SpectralImage;
use std::path::Path;

/// How luminance becomes brightness. At exposure value EV the luminance 100 · 2^-EV cd m⁻² is
/// full white: a value of linear RGB is its component in cd m⁻² times 2^EV / 100. EV 0 suits a
/// display of 100 cd m⁻², the sRGB standard's being 80; one more doubles the brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// The 98th percentile of the luminance of all pixels that are not black becomes 0.8 of full
    /// white (linear). A black image is shown at EV 0.
    Auto,
    /// This exposure value.
    Ev(f64),
}

/// The luminance that is full white at EV 0, cd m⁻².
const REFERENCE_LUMINANCE: f64 = 100.0;

/// Largest exposure value either way: beyond it no number would be left.
const MAX_EV: f64 = 100.0;

/// Writes `image` to `path` as 8-bit sRGB and returns the exposure value used, which the file
/// states too (text chunk `Exposure`).
///
/// The tone is linear up to white and clipped there, component by component. A colour outside the
/// gamut is mixed with the grey of its own luminance until it has no negative component, which
/// keeps its luminance and dominant wavelength. The same image gives the same bytes. Errors:
/// [`Error::Io`] with the path, the reason and what to do; [`Error::Settings`] for an exposure that is
/// not a number between -100 and 100.
pub fn write(path: &Path, image: &SpectralImage, exposure: Exposure) -> Result<f64> {
    let linear = image.to_linear();
    let ev = match exposure {
        Exposure::Auto => auto_ev(&linear),
        Exposure::Ev(ev) if ev.abs() <= MAX_EV => ev,
        Exposure::Ev(ev) => {
            return Err(Error::Settings(format!("exposure {ev} must lie between -100 and 100 EV")));
        }
    };
    atomic_file::write(path, &encode(&linear, ev).map_err(|e| Error::io(path, e))?)?;
    Ok(ev)
}

/// The luminance that a PNG of `image` at automatic exposure shows as full white, cd m⁻².
pub(crate) fn white_of(image: &LinearImage) -> f64 {
    REFERENCE_LUMINANCE / auto_ev(image).exp2()
}

fn auto_ev(image: &LinearImage) -> f64 {
    let mut luminance: Vec<f64> =
        (0..image.pixels()).map(|p| image.luminance(p)).filter(|y| y.is_finite() && *y > 0.0).collect();
    if luminance.is_empty() {
        return 0.0;
    }
    let rank = (0.98 * (luminance.len() - 1) as f64).round() as usize;
    let (_, bright, _) = luminance.select_nth_unstable_by(rank, f64::total_cmp);
    (0.8 * REFERENCE_LUMINANCE / *bright).log2().clamp(-MAX_EV, MAX_EV)
}

fn encode(image: &LinearImage, ev: f64) -> std::result::Result<Vec<u8>, ::png::EncodingError> {
    let scale = ev.exp2() / REFERENCE_LUMINANCE;
    let data: Vec<u8> = image
        .rgb
        .chunks_exact(3)
        .flat_map(|c| into_gamut([c[0], c[1], c[2]].map(f64::from)).map(|c| encode_srgb(c * scale)))
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, image.width, image.height);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_source_srgb(::png::SrgbRenderingIntent::RelativeColorimetric);
    encoder.add_text_chunk("Software".into(), concat!("luxgraph ", env!("CARGO_PKG_VERSION")).into())?;
    let white = REFERENCE_LUMINANCE / ev.exp2();
    encoder.add_text_chunk("Exposure".into(), format!("EV {ev:.6}; full white is {white:.6e} cd/m^2"))?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&data)?;
    writer.finish()?;
    Ok(bytes)
}

/// Mixes a colour with the grey of its luminance until no component is negative. What is
/// darker than black is black.
fn into_gamut(rgb: [f64; 3]) -> [f64; 3] {
    let lowest = rgb[0].min(rgb[1]).min(rgb[2]);
    if lowest >= 0.0 {
        return rgb;
    }
    let grey: f64 = linear_srgb_luminance(rgb);
    if grey <= 0.0 {
        return [0.0; 3];
    }
    let keep = grey / (grey - lowest);
    rgb.map(|c| (grey + keep * (c - grey)).max(0.0))
}

/// The sRGB transfer function (IEC 61966-2-1) to 8 bits.
fn encode_srgb(c: f64) -> u8 {
    let c = c.clamp(0.0, 1.0);
    let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_codes_of_srgb() {
        assert_eq!([0.0, 1.0, 0.5, 0.002, 7.0, -1.0].map(encode_srgb), [0, 255, 188, 7, 255, 0]);
    }

    #[test]
    fn gamut_mapping_keeps_luminance() {
        let luminance = linear_srgb_luminance;
        let colour = [-0.2, 0.9, 0.3];
        let mapped = into_gamut(colour);
        assert!(mapped.iter().all(|c| *c >= 0.0));
        assert!((luminance(mapped) - luminance(colour)).abs() < 1e-12);
        assert_eq!(into_gamut([0.1, 0.2, 0.3]), [0.1, 0.2, 0.3]);
        assert_eq!(into_gamut([-1.0, 0.0, 0.0]), [0.0; 3]);
    }

    #[test]
    fn automatic_exposure_ignores_black_and_few_bright_pixels() {
        let mut values = vec![0.0f32; 100];
        values.extend([50.0; 99]);
        values.push(1e6);
        let image =
            LinearImage { width: 200, height: 1, rgb: values.into_iter().flat_map(|v| [v; 3]).collect() };
        assert!((auto_ev(&image) - (0.8f64 * 100.0 / 50.0).log2()).abs() < 1e-6);
        let black = LinearImage { width: 1, height: 1, rgb: vec![0.0; 3] };
        assert_eq!(auto_ev(&black), 0.0);
    }
}

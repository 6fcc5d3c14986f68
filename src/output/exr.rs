//! OpenEXR: linear RGB for any viewer, and the spectra themselves.

use super::LinearImage;
use crate::atomic_file;
use crate::error::{Error, Result};
use crate::second_pass::SpectralImage;
use ::exr::meta::attribute::Chromaticities;
use ::exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, Text, Vec2, WritableImage, read_first_flat_layer_from_file,
};
use std::io::Cursor;
use std::path::Path;

/// What goes into the file besides R, G and B.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct ExrOptions {
    /// CIE X, Y, Z as channels `CIE.X`, `CIE.Y`, `CIE.Z`.
    pub xyz: bool,
    /// The spectral radiance, one channel a wavelength, after Fichet, Pacanowski and Wilkie, "An
    /// OpenEXR Layout for Spectral Images", JCGT 10(3), 2021: `S0.456,4nm`.
    pub spectral: bool,
}

/// Channel of the standard error of luminance.
pub const NOISE: &str = "noise.Y";

/// Channel of the number of samples.
pub const SAMPLES: &str = "samples";

/// Writes `image` to `path`, 32-bit float, without loss (ZIP).
///
/// R, G, B have the primaries of Rec. 709 and white D65 and are absolute: (1, 1, 1) is 1 cd m⁻²,
/// as the attribute `whiteLuminance` says. Nothing is clamped. The same image gives the same
/// bytes. Errors: [`Error::Io`] with the path, the reason and what to do.
pub fn write(path: &Path, image: &SpectralImage, options: &ExrOptions) -> Result<()> {
    atomic_file::write(path, &encode(path, image, options, &[])?)
}

/// [`write()`] with more channels, a number for each pixel: the standard error of its luminance, cd m⁻², is [`NOISE`],
/// its number of samples [`SAMPLES`]. Those that do not fit the image are left out.
///
/// # Errors
/// As [`write()`].
pub fn write_with(
    path: &Path,
    image: &SpectralImage,
    options: &ExrOptions,
    more: &[(&str, &[f32])],
) -> Result<()> {
    atomic_file::write(path, &encode(path, image, options, more)?)
}

fn encode(
    path: &Path,
    image: &SpectralImage,
    options: &ExrOptions,
    more: &[(&str, &[f32])],
) -> Result<Vec<u8>> {
    let pixels = image.pixels();
    if pixels == 0 || pixels as u64 != u64::from(image.width) * u64::from(image.height) {
        return Err(Error::io(path, "the image is empty or its size does not match its data"));
    }
    let channel = |name: &str, samples: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(samples));
    let linear = image.to_linear();
    let mut channels = Vec::new();
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        channels.push(channel(name, linear.rgb.iter().skip(c).step_by(3).copied().collect()));
    }
    if options.xyz {
        for (c, name) in ["CIE.X", "CIE.Y", "CIE.Z"].into_iter().enumerate() {
            channels.push(channel(name, (0..pixels).map(|p| image.xyz(p)[c] as f32).collect()));
        }
    }
    for (name, numbers) in more.iter().filter(|(_, numbers)| numbers.len() == pixels) {
        channels.push(channel(name, numbers.to_vec()));
    }
    let w = image.wavelengths.len();
    if options.spectral {
        for (k, name) in channel_names(&image.wavelengths.nm).iter().enumerate() {
            channels.push(channel(name, image.radiance.iter().skip(k).step_by(w).copied().collect()));
        }
    }

    let nm: Vec<String> = image.wavelengths.nm.iter().map(|nm| format!("{nm:.6}")).collect();
    let mut attributes = LayerAttributes {
        white_luminance: Some(1.0),
        software_name: Some(Text::from(concat!("luxgraph ", env!("CARGO_PKG_VERSION")))),
        comments: Some(Text::from(
            format!(
                "R, G, B: linear, Rec. 709 primaries, D65, (1, 1, 1) = 1 cd/m^2. Computed at {} nm{}.",
                nm.join(" "),
                if options.spectral { "; S0 channels in W/(m^2 sr nm)" } else { "" }
            )
            .as_str(),
        )),
        ..LayerAttributes::default()
    };
    let size = (image.width as usize, image.height as usize);
    let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::SMALL_FAST_LOSSLESS };
    // One custom attribute a table and no more: the tables are hashed with a random seed, and two
    // entries would come out in either order.
    if options.spectral {
        let units = AttributeValue::Text(Text::from("W.m^-2.sr^-1.nm^-1"));
        attributes.other.insert(Text::from("emissiveUnits"), units);
    }
    let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(channels.into()));
    let mut file = Image::from_layer(layer);
    file.attributes.chromaticities = Some(Chromaticities {
        red: Vec2(0.64, 0.33),
        green: Vec2(0.30, 0.60),
        blue: Vec2(0.15, 0.06),
        white: Vec2(0.3127, 0.3290),
    });
    if options.spectral {
        let version = AttributeValue::Text(Text::from("1.0"));
        file.attributes.other.insert(Text::from("spectralLayoutVersion"), version);
    }
    let mut bytes = Cursor::new(Vec::new());
    file.write().non_parallel().to_buffered(&mut bytes).map_err(|e| Error::io(path, e))?;
    Ok(bytes.into_inner())
}

/// `S0.456,4nm` and so on: as few decimals as tell the wavelengths apart, and at least one where
/// a wavelength is no whole number.
fn channel_names(nm: &[f64]) -> Vec<String> {
    let name = |x: f64, decimals: usize| {
        let digits = format!("{x:.decimals$}").replace('.', ",");
        format!("S0.{digits}nm")
    };
    let mut names = Vec::new();
    for decimals in usize::from(nm.iter().any(|x| x.fract() != 0.0))..=12 {
        names = nm.iter().map(|x| name(*x, decimals)).collect();
        let mut sorted = names.clone();
        sorted.sort();
        sorted.dedup();
        if sorted.len() == nm.len() {
            break;
        }
    }
    names
}

/// Reads R, G, B of the first layer of `path`, of whatever origin. The values are taken as they
/// are. Errors: [`Error::Io`] with the path and the reason.
pub fn read(path: &Path) -> Result<LinearImage> {
    Ok(read_with_noise(path)?.0)
}

/// [`read`], and the channel [`NOISE`], where the file has it.
///
/// # Errors
/// As [`read`].
pub fn read_with_noise(path: &Path) -> Result<(LinearImage, Option<Vec<f32>>)> {
    let image = read_first_flat_layer_from_file(path).map_err(|e| match e {
        ::exr::error::Error::Io(e) => Error::io(path, atomic_file::explain(&e)),
        e => Error::io(path, format!("not an OpenEXR file that can be read: {e}")),
    })?;
    let layer = image.layer_data;
    let find = |name: &str| {
        let found = layer.channel_data.list.iter().find(|c| c.name.eq(name));
        found.map(|c| c.sample_data.values_as_f32().collect::<Vec<f32>>())
    };
    let channel = |name: &str| {
        find(name).ok_or_else(|| Error::io(path, format!("the first layer has no channel {name}")))
    };
    let [r, g, b] = [channel("R")?, channel("G")?, channel("B")?];
    if r.len() != layer.size.area() || g.len() != r.len() || b.len() != r.len() {
        return Err(Error::io(path, "channels R, G, B are not of the image's size"));
    }
    let (Ok(width), Ok(height)) = (u32::try_from(layer.size.0), u32::try_from(layer.size.1)) else {
        return Err(Error::io(path, "the image is too large"));
    };
    let rgb = r.into_iter().zip(g).zip(b).flat_map(|((r, g), b)| [r, g, b]).collect();
    let noise = find(NOISE).filter(|noise| noise.len() == layer.size.area());
    Ok((LinearImage { width, height, rgb }, noise))
}

#[cfg(test)]
mod tests {
    use super::channel_names;

    #[test]
    fn channels_are_named_after_the_layout_and_unique() {
        assert_eq!(channel_names(&[456.4, 490.9]), ["S0.456,4nm", "S0.490,9nm"]);
        assert_eq!(channel_names(&[400.0, 410.0]), ["S0.400nm", "S0.410nm"]);
        assert_eq!(channel_names(&[400.01, 400.04]), ["S0.400,01nm", "S0.400,04nm"]);
    }
}

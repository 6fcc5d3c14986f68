//! The sky for Mitsuba 3: even light all around as it is, any other as an image of all directions.

use super::mitsuba::{LUMINANCE_OF_Y, Writer, float};
use crate::error::Result;
use crate::material::DEFAULT_ENTRIES;
use crate::output::exr::{self, ExrOptions};
use crate::scene::{Light, LightKind, SampledSky, Scene, Sky};
use crate::second_pass::SpectralImage;
use crate::spectrum::{Spectrum, Wavelengths};
use glam::DVec3;
use std::f64::consts::PI;
use std::path::Path;

/// Pixels of the image.
const SIZE: [u32; 2] = [1024, 512];
/// The image beside the scene.
const FILE: &str = "sky.exr";
/// Kind of the even sky.
const UNIFORM: u8 = 5;

/// Tells `writer` of the sky of `scene`, if it has one.
pub(super) fn write(writer: &mut Writer, scene: &Scene, folder: &Path) -> Result<()> {
    let Some(sky) = &scene.appearance.sky else { return Ok(()) };
    if is_even(sky, scene) {
        let factor = sky.factor();
        writer.line(1, "<emitter type=\"constant\">");
        writer.spectrum(2, "radiance", &|nm| factor * sky.spectrum.at(nm));
        writer.line(1, "</emitter>");
        return Ok(());
    }
    let wavelengths = Wavelengths::of_bands(32);
    let sampled = scene.appearance.sample(&scene.geometry, &wavelengths, DEFAULT_ENTRIES);
    let Some(seen) = &sampled.sky else { return Ok(()) };
    exr::write(&folder.join(FILE), &image(seen, &sampled.wavelengths), &ExrOptions::default())?;
    let up = seen.shape.up;
    let [x, z] = across(seen);
    let row = |k: usize| format!("{} {} {} 0", x[k], up[k], z[k]);
    writer.line(1, "<emitter type=\"envmap\">");
    writer.line(2, &format!("<string name=\"filename\" value=\"{FILE}\"/>"));
    // The image is in cd/m2.
    writer.line(2, &float("scale", 1.0 / LUMINANCE_OF_Y));
    writer.line(2, "<transform name=\"to_world\">");
    writer.line(3, &format!("<matrix value=\"{} {} {} 0 0 0 1\"/>", row(0), row(1), row(2)));
    writer.line(2, "</transform>");
    writer.line(1, "</emitter>");
    let [width, height] = SIZE;
    writer.note(format!(
        "the sky: an image of {width} x {height} pixels, whose colours are kept but not the spectra behind them"
    ));
    Ok(())
}

/// Mitsuba's x and z for this sky; its zenith is y.
fn across(sky: &SampledSky) -> [DVec3; 2] {
    let x = sky.shape.up.any_orthonormal_vector();
    [x, x.cross(sky.shape.up)]
}

/// Whether the sky and the ground below are of one radiance.
fn is_even(sky: &Sky, scene: &Scene) -> bool {
    let reflects_all = matches!(sky.ground, Spectrum::Constant(share) if share >= 1.0);
    let beam = |light: &Light| matches!(light.kind, LightKind::Directional { .. });
    sky.shape.kind == UNIFORM && reflects_all && !scene.geometry.lights.iter().any(beam)
}

/// The sky in all directions, as Mitsuba lays them out: from the zenith down, once around from -z towards x.
fn image(sky: &SampledSky, wavelengths: &Wavelengths) -> SpectralImage {
    let [width, height] = SIZE;
    let [x, z] = across(sky);
    let direction = |column: u32, row: u32| -> DVec3 {
        let (sin, cos) = (PI * (f64::from(row) + 0.5) / f64::from(height)).sin_cos();
        let (s, c) = (2.0 * PI * (f64::from(column) + 0.5) / f64::from(width)).sin_cos();
        sin * (s * x - c * z) + cos * sky.shape.up
    };
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
    let radiance = pixels.flat_map(|(column, row)| sky.radiance(direction(column, row))).collect();
    SpectralImage { width, height, wavelengths: wavelengths.clone(), radiance }
}

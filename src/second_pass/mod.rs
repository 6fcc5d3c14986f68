//! The second pass (section 3.4): the view, by distributed ray tracing.

mod bands;
mod cells;
mod chart;
mod checkpoint;
mod clamp;
mod cover;
mod direct;
mod eye;
mod feet;
mod film;
mod gather;
pub mod interpolate;
mod ladder;
mod lamps;
mod lattice;
mod lobe;
mod meeting;
mod noise;
mod parted;
mod probe;
mod render;
mod scatter;
mod sequence;
mod settings;
mod shading;
mod shares;
mod stencil;
mod take;
mod tile;
mod wave;

pub use checkpoint::Checkpoint;
pub(crate) use direct::power_heuristic;
pub use interpolate::{DiffuseField, Interpolator};
pub(crate) use lobe::{lobe_density, lobe_weight, reflect, refract, sample_facet};
pub use noise::{NoiseStats, NoiseTarget, PixelNoise};
pub(crate) use probe::Probe;
pub use render::{LitScene, Rendered, render, render_with_checkpoint};
pub use scatter::ROUGH;
pub(crate) use sequence::mix;
pub use settings::{Passes, Rung, SecondPassSettings, SecondPassStats};
pub(crate) use wave::{NO_MEDIUM, inset, ray_offset};

use crate::spectrum::Wavelengths;

/// Radiance through every pixel.
#[derive(Clone, Debug)]
pub struct SpectralImage {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// What the radiances are sampled at.
    pub wavelengths: Wavelengths,
    /// Radiance, W m⁻² sr⁻¹ nm⁻¹, `[height][width][W]`, from the top left.
    pub radiance: Vec<f32>,
}

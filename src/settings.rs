//! The knobs of a run, with their defaults and presets.

use crate::first_pass::{FirstPassSettings, Kernel};
use crate::material::{DEFAULT_ENTRIES, PAPER_ENTRIES};
use crate::measure::MeasureSettings;
use crate::points::LightRefinement;
use crate::second_pass::{Rung, SecondPassSettings};
use crate::spectrum::Wavelengths;
use crate::tracers::TracerChoice;
use crate::visibility::LinkSettings;
use crate::voxels::VoxelSettings;

/// Everything a run may be asked to do differently. Sampling of the surfaces is the scene's own
/// (its `[sampling]` table), times [`Settings::area_factor`].
#[derive(Clone, Debug)]
pub struct Settings {
    /// Which ray tracer answers.
    pub tracer: TracerChoice,
    /// Factor on the scene's area threshold: 4 gives about a quarter of the points.
    pub area_factor: f64,
    /// Subdivision of space for the graph.
    pub voxels: VoxelSettings,
    /// Wavelengths that light is sampled at.
    pub wavelengths: Wavelengths,
    /// Entries of the Fresnel tables.
    pub fresnel_entries: usize,
    /// Exchange diffuse light over links between points and clusters of points; `None`: between all pairs of points, unless
    /// there are too many of these.
    pub links: Option<LinkSettings>,
    /// Divide elements further where the light bends; `None`: the sampling is by geometry alone.
    pub refinement: Option<LightRefinement>,
    /// With more points than this there are links between them in any case, unless the graph is to be kept in a file, the
    /// scene refines its points by what they see, or light is shot. No limit by default.
    pub most_paired: usize,
    /// First pass.
    pub first_pass: FirstPassSettings,
    /// Second pass.
    pub second_pass: SecondPassSettings,
    /// Sensors.
    pub measure: MeasureSettings,
}

/// Named points on the way from fast to careful.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// A look at the scene: a quarter of the points, with the second pass asking lamps for their own light.
    Draft,
    /// As the paper did it: its kernel, four wavelengths, tables of 20 entries.
    Paper,
    /// The default: 8 wavelength bands.
    Standard,
    /// Four times the points, 16 wavelengths, 256 samples a pixel, with the second pass asking lamps for their own light.
    High,
}

impl Settings {
    /// The settings of a preset.
    pub fn preset(quality: Quality) -> Self {
        let mut settings = Settings {
            tracer: TracerChoice::Auto,
            area_factor: 1.0,
            voxels: VoxelSettings::default(),
            wavelengths: Wavelengths::standard(),
            fresnel_entries: DEFAULT_ENTRIES,
            links: None,
            refinement: None,
            most_paired: usize::MAX,
            first_pass: FirstPassSettings::default(),
            second_pass: SecondPassSettings::default(),
            measure: MeasureSettings::default(),
        };
        match quality {
            Quality::Draft => {
                settings.area_factor = 4.0;
                settings.second_pass.rung = Rung::Direct;
                settings.first_pass.parts = true;
            }
            Quality::Paper => {
                settings.wavelengths = Wavelengths::meyer4();
                settings.fresnel_entries = PAPER_ENTRIES;
                settings.first_pass.kernel = Kernel::Paper;
            }
            Quality::Standard => {}
            Quality::High => {
                settings.area_factor = 0.25;
                settings.wavelengths = Wavelengths::of_bands(16);
                settings.second_pass.rung = Rung::Direct;
                settings.second_pass.samples = 256;
                settings.first_pass.parts = true;
            }
        }
        settings
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings::preset(Quality::Standard)
    }
}

//! What the second pass is asked for, and what it reports.

use super::noise::{NoiseStats, NoiseTarget};
use crate::error::{Error, Result};
use serde::Serialize;

/// Most Sobol' points of one pixel: samples times lobe samples.
const MAX_POINTS: u32 = 1 << 16;

/// Which light the image shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Passes {
    /// L^d alone at the first hit: the paper's figures 7 and 8.
    FirstPassOnly,
    /// L^d and the specular light by distributed ray tracing: figure 9.
    Both,
}

/// Where the second pass takes the diffuse light at a hit from: each rung is slower than the one before, and closer to
/// the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rung {
    /// The paper's: the first pass's, from the four closest sample points on the same surface.
    #[default]
    Interpolate,
    /// What comes straight from lamps is asked of them, which makes shadows sharp; the rest is the first pass's.
    Direct,
    /// And the rest but for that over mirrors and glass is gathered over the hemisphere from the first pass.
    Gather,
}

/// How the second pass samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SecondPassSettings {
    /// Which light the image shows.
    pub passes: Passes,
    /// Where diffuse light comes from.
    pub rung: Rung,
    /// Lamps asked at every hit, but on the rung `interpolate`.
    pub lamp_samples: u32,
    /// Rays over the hemisphere of a hit on the rung `gather`.
    pub gather_samples: u32,
    /// Camera rays a pixel, spread over its area (a box filter); with a noise target the fewest, 32 at least, rounded
    /// up to a power of two.
    pub samples: u32,
    /// Sample each part of the image until the whole is no noisier than this; `None`: `samples` everywhere.
    pub noise: Option<NoiseTarget>,
    /// Rays in the lobe of the first rough specular surface on a path; later ones send one.
    pub lobe_samples: u32,
    /// Specular events after which a path ends. What that cuts off is reported.
    pub max_depth: u32,
    /// A path that would carry less than this share of its pixel sample ends by Russian
    /// roulette, which leaves the mean as it is. 0 switches it off.
    pub tolerance: f64,
    /// So many times the mean radiance that surfaces reflect is what one ray may bring a pixel of a lamp that only
    /// chance finds: from a rough lobe over mirrors or through glass. What that leaves out is reported. Infinite: nothing.
    pub clamp: f64,
    /// Another seed gives another noise.
    pub seed: u32,
}

impl Default for SecondPassSettings {
    fn default() -> Self {
        SecondPassSettings {
            passes: Passes::Both,
            rung: Rung::default(),
            lamp_samples: 1,
            gather_samples: 2,
            samples: 16,
            noise: None,
            lobe_samples: 8,
            max_depth: Self::MAX_DEPTH,
            tolerance: 1e-3,
            clamp: f64::INFINITY,
            seed: 0,
        }
    }
}

impl SecondPassSettings {
    /// Most specular events: one set of Sobol' dimensions each, and one for the pixel.
    pub const MAX_DEPTH: u32 = sobol_burley::NUM_DIMENSION_SETS_4D - 1;

    /// An [`Error::Settings`] that says what to change, if anything.
    pub fn check(&self) -> Result<()> {
        let refuse = |what: String| Err(Error::Settings(what));
        let more = self.lamp_samples.max(self.gather_samples);
        if self.lamp_samples == 0 || self.gather_samples == 0 || more > 256 {
            return refuse(format!(
                "lamp samples ({}) and gather samples ({}) each lie between 1 and 256",
                self.lamp_samples, self.gather_samples
            ));
        }
        let points = u64::from(self.samples) * u64::from(self.lobe_samples);
        if points == 0 || points > u64::from(MAX_POINTS) {
            return refuse(format!(
                "samples a pixel ({}) times lobe samples ({}) must lie between 1 and {MAX_POINTS}",
                self.samples, self.lobe_samples
            ));
        }
        if let Some(target) = self.noise {
            self.check_noise(&target, more)?;
        }
        if self.max_depth > Self::MAX_DEPTH {
            return refuse(format!("at most {} specular events a path are possible", Self::MAX_DEPTH));
        }
        if self.clamp.is_nan() || self.clamp < 0.0 {
            return refuse(format!("the clamp must be 0 or more, or inf, not {}", self.clamp));
        }
        if !(0.0..=1.0).contains(&self.tolerance) {
            return refuse(format!("the tolerance must lie between 0 and 1, not at {}", self.tolerance));
        }
        Ok(())
    }

    /// The same for a noise target; `more` are the rays at a hit.
    fn check_noise(&self, target: &NoiseTarget, more: u32) -> Result<()> {
        let (noise, most) = (target.noise, target.most_samples);
        let refuse = |what: String| Err(Error::Settings(what));
        if !(1e-6..=1.0).contains(&noise) {
            return refuse(format!("a noise of {noise} cannot be asked for: from 0.0001 % to 100 %"));
        }
        if most < self.samples || most > MAX_POINTS {
            return refuse(format!(
                "at most {most} samples a pixel: give from {} (those that all take) to {MAX_POINTS}",
                self.samples
            ));
        }
        let draws = u64::from(most) * u64::from(self.lobe_samples) * u64::from(more);
        if draws > u64::from(u32::MAX) {
            return refuse(format!(
                "at most {most} samples a pixel, times {} lobe samples, times {more} samples of lamps or the hemisphere: \
                 together no more than {}",
                self.lobe_samples,
                u32::MAX
            ));
        }
        Ok(())
    }
}

/// What the second pass did.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SecondPassStats {
    /// Camera rays.
    pub camera_rays: u64,
    /// Rays sent on by reflection.
    pub reflected_rays: u64,
    /// Rays sent on through glass.
    pub transmitted_rays: u64,
    /// Rays sent over hemispheres.
    pub gather_rays: u64,
    /// Segments to lamps.
    pub shadow_rays: u64,
    /// Rays that met nothing.
    pub missed_rays: u64,
    /// Paths that ended at the depth limit.
    pub paths_cut: u64,
    /// Mean share of a pixel sample that those would have carried on.
    pub cut_share: f64,
    /// About which share of the image's light, as it would be without [`SecondPassSettings::clamp`], only chance found,
    pub by_chance_share: f64,
    /// and which of it the clamp left out.
    pub clamped_share: f64,
    /// Paths ended by Russian roulette (without bias).
    pub paths_ended: u64,
    /// What came of a noise target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseStats>,
    /// Wall-clock time, s.
    pub second_pass_s: f64,
}

impl SecondPassStats {
    /// All rays cast.
    pub fn rays(&self) -> u64 {
        self.camera_rays + self.reflected_rays + self.transmitted_rays + self.gather_rays + self.shadow_rays
    }

    /// Adds the counts of another part of the image. `cut_share` and `clamped_share` are plain sums
    /// until they are divided by the whole.
    pub(crate) fn add(&mut self, other: &SecondPassStats) {
        self.camera_rays += other.camera_rays;
        self.reflected_rays += other.reflected_rays;
        self.transmitted_rays += other.transmitted_rays;
        self.gather_rays += other.gather_rays;
        self.shadow_rays += other.shadow_rays;
        self.missed_rays += other.missed_rays;
        self.paths_cut += other.paths_cut;
        self.cut_share += other.cut_share;
        self.by_chance_share += other.by_chance_share;
        self.clamped_share += other.clamped_share;
        self.paths_ended += other.paths_ended;
    }
}

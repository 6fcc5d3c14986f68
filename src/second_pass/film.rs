//! What a tile gathers.

use super::direct::Shadows;
use super::interpolate::Apart;
use super::parted::Weights;
use super::settings::SecondPassStats;

/// Where a tile gathers its light, and room to work in.
pub(super) struct Film {
    /// Sum over the samples, `[pixels][W]`.
    pub radiance: Vec<f64>,
    /// Counts of the tile.
    pub stats: SecondPassStats,
    /// Sobol' seed of each pixel.
    pub seeds: Vec<u32>,
    /// Room for one spectrum each, `[W]`, and for weights.
    pub value: Vec<f32>,
    pub reflected: Vec<f32>,
    pub transmitted: Vec<f32>,
    pub weights: Weights,
    /// Which paths of the wave may go on.
    pub going_on: Vec<u32>,
    /// Those whose place is parted from some of what is around it.
    pub parted: Vec<(u32, bool, Apart)>,
    /// Paths at places that ask lamps.
    pub lit: Vec<u32>,
    /// Those among them that gather, on a rung that does.
    pub gathering: Vec<u32>,
    /// Paths at places whose emission is still to be added.
    pub glowing: Vec<u32>,
    /// Paths that left the scene and see the sky.
    pub missed: Vec<u32>,
    /// Room for what lamps are asked.
    pub shadows: Shadows,
}

impl Film {
    /// An unlit film of `pixels` with `w` wavelengths.
    pub fn new(seeds: Vec<u32>, w: usize) -> Self {
        Film {
            radiance: vec![0.0; seeds.len() * w],
            stats: SecondPassStats::default(),
            seeds,
            value: vec![0.0; w],
            reflected: vec![0.0; w],
            transmitted: vec![0.0; w],
            weights: Weights::default(),
            going_on: Vec::new(),
            parted: Vec::new(),
            lit: Vec::new(),
            gathering: Vec::new(),
            glowing: Vec::new(),
            missed: Vec::new(),
            shadows: Shadows::default(),
        }
    }
}

//! What a lobe returns of the light, against the angle of incidence, in bands of wavelengths.

use super::directions::{LANES, Lanes};
use crate::material::FresnelTable;
use std::hash::Hasher;

/// Wavelengths handled side by side.
pub const BAND: usize = 4;
/// Values of up to [`BAND`] wavelengths.
pub type Band = [f32; BAND];

/// A [`FresnelTable`] times a share, its wavelengths in bands of [`BAND`].
#[derive(Clone, Debug)]
pub struct LobeTable {
    bands: usize,
    last: usize,
    /// Each entry and its difference from the next, `[entries - 1][bands]`.
    values: Vec<(Band, Band)>,
}

impl LobeTable {
    /// The table times `share`; `complement` takes 1 - F instead of F.
    pub fn new(table: &FresnelTable, share: f32, complement: bool) -> Self {
        let w = table.wavelengths;
        let bands = w.div_ceil(BAND);
        let last = table.entries() - 1;
        let value = |entry: usize, k: usize| {
            let value = if k < w { table.values[entry * w + k] } else { 0.0 };
            if complement && k < w { share * (1.0 - value) } else { share * value }
        };
        let values = (0..last * bands)
            .map(|i| {
                let (entry, first) = (i / bands, i % bands * BAND);
                let here: Band = std::array::from_fn(|c| value(entry, first + c));
                (here, std::array::from_fn(|c| value(entry + 1, first + c) - here[c]))
            })
            .collect();
        LobeTable { bands, last, values }
    }

    /// The largest value for wavelength `k`.
    pub fn most(&self, k: usize) -> f32 {
        let ends = |(here, step): &(Band, Band)| here[k % BAND].max(here[k % BAND] + step[k % BAND]);
        self.values.iter().skip(k / BAND).step_by(self.bands).map(ends).fold(0.0, f32::max)
    }

    /// Equal for equal tables.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        for (here, step) in &self.values {
            here.iter().chain(step).for_each(|v| hasher.write_u32(v.to_bits()));
        }
        hasher.finish()
    }

    /// The entry before each `x`, 1 less the root of a cosine, and how far it is towards the next (up to 1).
    #[inline(always)]
    pub fn slots(&self, x: &Lanes) -> ([i32; LANES], Lanes) {
        let (mut slot, mut f) = ([0; LANES], [0.0; LANES]);
        let last = self.last as f32;
        for l in 0..LANES {
            let x = x[l] * last;
            let before = x - 0.5;
            let before = if before > 0.0 { before } else { 0.0 };
            let before = if before < last - 1.0 { before } else { last - 1.0 };
            // Beyond 2^23 numbers are whole, and the last bits are their last digits.
            slot[l] = ((before + 8_388_608.0).to_bits() & 0x7f_ffff) as i32;
            f[l] = x - slot[l] as f32;
        }
        (slot, f)
    }

    /// A band of an entry, and its difference from the next entry.
    #[inline(always)]
    pub fn entry(&self, slot: i32, band: usize) -> &(Band, Band) {
        &self.values[slot as usize * self.bands + band]
    }

    /// The entry before `x`, 1 less the root of a cosine, and how far it is towards the next.
    #[inline(always)]
    pub fn slot(&self, x: f32) -> (i32, f32) {
        let x = x * self.last as f32;
        let slot = (x as i32).min(self.last as i32 - 1);
        (slot, x - slot as f32)
    }

    /// The values at a cosine of a band of wavelengths.
    pub fn band(&self, cosine: f32, band: usize) -> Band {
        let x = (1.0 - cosine.clamp(0.0, 1.0).sqrt()) * self.last as f32;
        let slot = (x as i32).min(self.last as i32 - 1);
        let (here, step) = self.entry(slot, band);
        std::array::from_fn(|c| here[c] + (x - slot as f32) * step[c])
    }

    /// The value at a cosine for wavelength `k`.
    pub fn value(&self, cosine: f32, k: usize) -> f32 {
        self.band(cosine, k / BAND)[k % BAND]
    }
}

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

    /// Equal for equal tables.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        for (here, step) in &self.values {
            here.iter().chain(step).for_each(|v| hasher.write_u32(v.to_bits()));
        }
        hasher.finish()
    }

    /// The entry before each cosine, and how far each is towards the next.
    #[inline(always)]
    pub fn slots(&self, cosine: &Lanes) -> ([i32; LANES], Lanes) {
        let (mut slot, mut f) = ([0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let x = (1.0 - cosine[l].clamp(0.0, 1.0).sqrt()) * self.last as f32;
            slot[l] = (x as i32).min(self.last as i32 - 1);
            f[l] = x - slot[l] as f32;
        }
        (slot, f)
    }

    /// A band of an entry, and its difference from the next entry.
    #[inline(always)]
    pub fn entry(&self, slot: i32, band: usize) -> &(Band, Band) {
        &self.values[slot as usize * self.bands + band]
    }

    /// The values at some cosines for the first wavelength.
    #[inline(always)]
    pub fn first(&self, cosine: &Lanes) -> Lanes {
        let (slot, f) = self.slots(cosine);
        std::array::from_fn(|lane| {
            let (here, step) = self.entry(slot[lane], 0);
            here[0] + f[lane] * step[0]
        })
    }

    /// The values at a cosine of a band of wavelengths.
    pub fn band(&self, cosine: f32, band: usize) -> Band {
        let (slot, f) = self.slots(&[cosine; LANES]);
        let (here, step) = self.entry(slot[0], band);
        std::array::from_fn(|c| here[c] + f[0] * step[c])
    }

    /// The value at a cosine for wavelength `k`.
    pub fn value(&self, cosine: f32, k: usize) -> f32 {
        self.band(cosine, k / BAND)[k % BAND]
    }
}

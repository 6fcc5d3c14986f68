//! The innermost loops of a sweep: what pairs of patches send each other, with two multiplications and additions a
//! wavelength for a pair of points.

use super::diffuse::{LANES, Lanes};
use super::layout::{MAX_PATCH, Patch};
use super::lobe_table::{BAND, Band};
use super::pair_kernel::{Kept, Scratch, Sight};
use super::schedule::Pair;
use crate::simd::HotLoop;

/// A value of every wavelength of a band, for a group of lanes.
pub type BandLanes = [Lanes; BAND];

/// What the points send: area (in units of the layout) times radiance.
pub struct Power {
    /// Bands of wavelengths.
    pub bands: usize,
    /// By point, `[N][bands]`.
    pub by_point: Vec<Band>,
    /// By groups of lanes, `[groups][bands]`.
    pub by_lane: Vec<BandLanes>,
    /// Whether anything comes from a patch.
    pub sends: Vec<bool>,
    /// Whether it is asked what a patch receives.
    pub hears: Vec<bool>,
}

/// The exchanges of one task.
pub struct Exchange<'a> {
    /// What patches see.
    pub sight: Sight<'a>,
    /// Who exchanges light.
    pub pairs: &'a [Pair],
    /// Their kernels, if they are kept.
    pub kept: Option<&'a Kept>,
    /// What they send.
    pub power: &'a Power,
    /// First point of the first patches, and first group of lanes of the second.
    pub origin: (usize, usize),
    /// What the first patches receive, to be summed over the lanes: `[points][bands]`.
    pub first: &'a mut [BandLanes],
    /// What the second patches receive, `[groups][bands]`.
    pub second: &'a mut [BandLanes],
}

/// The kernel of a pair: the points of its rows, and what goes to the first patch and to the second.
struct Rows<'a> {
    points: &'a [u32],
    forth: &'a [Lanes],
    back: &'a [Lanes],
}

impl HotLoop for Exchange<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let patches = &self.sight.layout.patches;
        let mut scratch = Scratch::new();
        let (mut row, mut at) = (0, 0);
        for (p, pair) in self.pairs.iter().enumerate() {
            let (a, b) = (pair.a as usize, pair.b as usize);
            let Power { sends, hears, .. } = self.power;
            let forth = hears[a] && sends[b];
            // Within a curved patch every pair is met from both its ends.
            let back = hears[b] && sends[a] && a != b;
            let second = &patches[b];
            let rows = match self.kept {
                Some(kept) => {
                    let count = usize::from(kept.counts[p]);
                    let size = count * second.groups.len();
                    let (first_row, first) = (row, at);
                    row += count;
                    at += if pair.close { 2 * size } else { size };
                    Rows {
                        points: &kept.points[first_row..row],
                        forth: &kept.kernels[first..first + size],
                        back: &kept.kernels[at - size..at],
                    }
                }
                None if !forth && !back => continue,
                None => {
                    self.sight.kernel(pair, &mut scratch);
                    Rows {
                        points: &scratch.points[..scratch.count],
                        forth: &scratch.forth,
                        back: if pair.close { &scratch.back } else { &scratch.forth },
                    }
                }
            };
            if forth {
                receive(self.power, second, &rows, self.origin.0, self.first);
            }
            if back {
                send(self.power, second, &rows, self.origin.1, self.second);
            }
        }
    }
}

/// What the first patch receives.
#[inline(always)]
fn receive(power: &Power, second: &Patch, rows: &Rows, origin: usize, out: &mut [BandLanes]) {
    let (groups, bands) = (second.groups.len(), power.bands);
    for band in 0..bands {
        for (point, kernel) in rows.points.iter().zip(rows.forth.chunks_exact(groups)) {
            let out = &mut out[(*point as usize - origin) * bands + band];
            let mut sum = *out;
            for (q, g) in kernel.iter().zip(second.groups.clone()) {
                let light = &power.by_lane[g * bands + band];
                for k in 0..BAND {
                    for lane in 0..LANES {
                        sum[k][lane] += q[lane] * light[k][lane];
                    }
                }
            }
            *out = sum;
        }
    }
}

/// What the second patch receives.
#[inline(always)]
fn send(power: &Power, second: &Patch, rows: &Rows, origin: usize, out: &mut [BandLanes]) {
    let (groups, bands) = (second.groups.len(), power.bands);
    for band in 0..bands {
        let mut light = [[0.0; BAND]; MAX_PATCH];
        for (point, light) in rows.points.iter().zip(&mut light) {
            *light = power.by_point[*point as usize * bands + band];
        }
        let light = &light[..rows.points.len()];
        for at in 0..groups {
            let mut sum = [[0.0; LANES]; BAND];
            for (kernel, light) in rows.back.chunks_exact(groups).zip(light) {
                let q = &kernel[at];
                for k in 0..BAND {
                    for lane in 0..LANES {
                        sum[k][lane] += q[lane] * light[k];
                    }
                }
            }
            let out = &mut out[(second.groups.start + at - origin) * bands + band];
            for k in 0..BAND {
                for lane in 0..LANES {
                    out[k][lane] += sum[k][lane];
                }
            }
        }
    }
}

//! What a lobe returns of the light, against the angle of incidence, in bands of wavelengths.

use super::directions::{LANES, Lanes};
use crate::material::FresnelTable;
use std::hash::Hasher;

/// Wavelengths handled side by side.
pub const BAND: usize = 4;
/// Values of up to [`BAND`] wavelengths.
pub type Band = [f32; BAND];

/// Steps of an angle as rows keep it: the error of 1 less the root of the cosine is 8e-6.
pub const STEPS: f32 = 65535.0;

/// Terms of a polynomial that stands for a part of a table,
const TERMS: usize = 5;
/// which has so many steps, or half as many and so on; or one, and is a line.
const WIDTHS: [usize; 4] = [32, 16, 8, 1];
/// How far it may be from the entries it stands for, and from the lines between them; of all light. Tables are no nearer than
/// the second to what they tabulate.
const MISSES: [f32; 2] = [2e-5, 1e-4];

/// Coefficients of the powers of steps.
#[derive(Clone, Copy, Debug)]
pub struct Polynomial([f32; TERMS]);

impl Polynomial {
    /// `b` times its value after `steps`.
    #[inline(always)]
    pub fn times(&self, b: &Lanes, steps: &Lanes) -> Lanes {
        let [c0, c1, c2, c3, c4] = self.0;
        let mut product = [0.0; LANES];
        for lane in 0..LANES {
            let t = steps[lane];
            product[lane] = b[lane] * (c0 + t * (c1 + t * (c2 + t * (c3 + t * c4))));
        }
        product
    }
}

/// A [`FresnelTable`] times a share, its wavelengths in bands of [`BAND`].
#[derive(Clone, Debug)]
pub struct LobeTable {
    bands: usize,
    last: usize,
    /// Each entry and its difference from the next, `[entries - 1][bands]`.
    values: Vec<(Band, Band)>,
    /// What the table is from each entry on, as the coefficients of a polynomial of the steps from there,
    /// `[W][entries - 1]`,
    polynomials: Vec<Polynomial>,
    /// and for how many steps.
    reach: Vec<f32>,
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
        let values: Vec<(Band, Band)> = (0..last * bands)
            .map(|i| {
                let (entry, first) = (i / bands, i % bands * BAND);
                let here: Band = std::array::from_fn(|c| value(entry, first + c));
                (here, std::array::from_fn(|c| value(entry + 1, first + c) - here[c]))
            })
            .collect();
        let mut polynomials = vec![Polynomial([0.0; TERMS]); last * w];
        let mut reach = Vec::with_capacity(last);
        for entry in 0..last {
            let of = |k: usize, width: usize| polynomial(|i| value(entry + i, k), width);
            let fit = |width: usize| (0..w).map(|k| of(k, width)).collect::<Option<Vec<_>>>();
            let mut widths = WIDTHS.into_iter().filter(|width| entry + width <= last);
            if let Some((width, fit)) = widths.find_map(|width| Some((width, fit(width)?))) {
                fit.into_iter().enumerate().for_each(|(k, fit)| polynomials[k * last + entry] = fit);
                reach.push(width as f32);
            }
        }
        LobeTable { bands, last, values, polynomials, reach }
    }

    /// From which entry on a polynomial stands for the table at angles of a range, in [`STEPS`], if one does.
    #[inline(always)]
    pub fn piece(&self, [least, most]: [u16; 2]) -> Option<u32> {
        let scale = self.last as f32 / STEPS;
        let entry = whole(f32::from(least) * scale - 0.5, self.last as f32 - 1.0);
        let end = entry as f32 + self.reach[entry as usize];
        (f32::from(most) * scale <= end).then_some(entry as u32)
    }

    /// How far angles in [`STEPS`] are from the entry where a piece begins.
    #[inline(always)]
    pub fn steps(&self, angle: &[u16; LANES], piece: u32) -> Lanes {
        let (scale, before) = (self.last as f32 / STEPS, piece as i32 as f32);
        let mut steps = [0.0; LANES];
        for lane in 0..LANES {
            steps[lane] = f32::from(angle[lane]) * scale - before;
        }
        steps
    }

    /// A piece at wavelength `k`.
    #[inline(always)]
    pub fn polynomial(&self, piece: u32, k: usize) -> Polynomial {
        self.polynomials[k * self.last + piece as usize]
    }

    /// [`LobeTable::piece`] for some angles.
    #[inline(always)]
    pub fn piece_for(&self, angle: &[u16; LANES]) -> Option<u32> {
        let (mut least, mut most) = (u16::MAX, 0);
        for &angle in angle {
            least = least.min(angle);
            most = most.max(angle);
        }
        self.piece([least, most])
    }

    /// `b` times the table at wavelength `k`, so many steps from where a piece begins, or from its first entry.
    #[inline(always)]
    pub fn share(&self, b: &Lanes, (piece, steps): (Option<u32>, &Lanes), k: usize) -> Lanes {
        if let Some(piece) = piece {
            return self.polynomial(piece, k).times(b, steps);
        }
        let mut share = [0.0; LANES];
        for lane in 0..LANES {
            let slot = whole(steps[lane] - 0.5, self.last as f32 - 1.0);
            let (here, step) = self.entry(slot, k / BAND);
            share[lane] = b[lane] * (here[k % BAND] + (steps[lane] - slot as f32) * step[k % BAND]);
        }
        share
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
            slot[l] = whole(x - 0.5, last - 1.0);
            f[l] = x - slot[l] as f32;
        }
        (slot, f)
    }

    /// A band of an entry, and its difference from the next entry.
    #[inline(always)]
    pub fn entry(&self, slot: i32, band: usize) -> &(Band, Band) {
        &self.values[slot as usize * self.bands + band]
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

/// The whole number nearest to `x`, from 0 to `most`.
#[inline(always)]
fn whole(x: f32, most: f32) -> i32 {
    let x = if x > 0.0 { x } else { 0.0 };
    let x = if x < most { x } else { most };
    // Beyond 2^23 numbers are whole, and the last bits are their last digits.
    ((x + 8_388_608.0).to_bits() & 0x7f_ffff) as i32
}

/// The polynomial through entries 0 to `width` in equal steps, by the entry; if it stands for all between them. A line where
/// the width is 1.
fn polynomial(at: impl Fn(usize) -> f32, width: usize) -> Option<Polynomial> {
    if width == 1 {
        return Some(Polynomial([at(0), at(1) - at(0), 0.0, 0.0, 0.0]));
    }
    // Newton's forward differences.
    let mut d: [f32; TERMS] = std::array::from_fn(|i| at(i * width / (TERMS - 1)));
    for order in 1..TERMS {
        (order..TERMS).rev().for_each(|i| d[i] -= d[i - 1]);
    }
    let h = (width / (TERMS - 1)) as f32;
    let c = [
        d[0],
        (d[1] - d[2] / 2.0 + d[3] / 3.0 - d[4] / 4.0) / h,
        (d[2] - d[3] + 11.0 / 12.0 * d[4]) / (2.0 * h * h),
        (d[3] - 1.5 * d[4]) / (6.0 * h * h * h),
        d[4] / (24.0 * h * h * h * h),
    ];
    let value = |t: f32| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    let near = |i: usize| (value(i as f32) - at(i)).abs() <= MISSES[0];
    let flat = |i: usize| (value(i as f32 + 0.5) - 0.5 * (at(i) + at(i + 1))).abs() <= MISSES[1];
    ((0..=width).all(near) && (0..width).all(flat)).then_some(Polynomial(c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::fresnel;

    /// The table at an angle in steps.
    fn exact(table: &LobeTable, angle: u16, k: usize) -> f32 {
        table.value((1.0 - f32::from(angle) / STEPS).powi(2), k)
    }

    #[test]
    fn polynomials_stand_for_smooth_parts_of_tables_and_for_no_others() {
        let metal = |k: usize, cos: f64| fresnel::unpolarised(cos, 0.2 + 0.3 * k as f64, 3.0);
        let step = |_: usize, cos: f64| if cos < 0.7 { 1.0 } else { 0.1 };
        let (smooth, broken) = (FresnelTable::new(6, 128, metal), FresnelTable::new(6, 128, step));
        for (table, limit) in [(&smooth, 1.5e-4), (&broken, 1e-5)] {
            let table = LobeTable::new(table, 0.8, false);
            let mut off = 0.0f32;
            for first in (0..65535 - 8 * 700).step_by(97) {
                for width in [1u16, 60, 300, 700] {
                    let angle: [u16; LANES] = std::array::from_fn(|lane| first + width * lane as u16);
                    let piece = table.piece_for(&angle);
                    let steps = table.steps(&angle, piece.unwrap_or(0));
                    for k in [0, 1, 4, 5] {
                        let share = table.share(&[2.0; LANES], (piece, &steps), k);
                        for (share, angle) in share.into_iter().zip(angle) {
                            off = off.max((share - 2.0 * exact(&table, angle, k)).abs());
                        }
                    }
                }
            }
            let far = table.reach.iter().filter(|reach| **reach >= 8.0).count();
            println!("off by {off:.1e}, {far} entries of {} reach 8", table.reach.len());
            assert!(off > 0.0 && off < 2.0 * limit && far > 80, "{off} {far}");
        }
    }
}

//! Corrections to the plain kernel, a sparse matrix, and how they are applied.

use super::lobe_table::{BAND, Band};
use crate::simd::{HotLoop, wide};

/// Corrections to the plain kernel as a sparse matrix, rows are receivers.
#[derive(Clone, Debug, Default)]
pub struct Corrections {
    /// First entry of each row, and the number of entries at the end; empty when there is no row.
    starts: Vec<usize>,
    /// The element seen.
    column: Vec<u32>,
    /// What the plain q lacks.
    difference: Vec<f32>,
    /// Ordered pairs whose element is near.
    pub near_pairs: u64,
    /// Pairs of a point and a surface that were summed up exactly.
    pub summed_surfaces: u64,
}

impl Corrections {
    /// Joins rows of (column, difference), given in order.
    pub fn from_rows<'r>(rows: impl Iterator<Item = &'r [(u32, f32)]>) -> Self {
        let mut all = Corrections { starts: vec![0], ..Default::default() };
        for row in rows {
            all.column.extend(row.iter().map(|e| e.0));
            all.difference.extend(row.iter().map(|e| e.1));
            all.starts.push(all.column.len());
        }
        all
    }

    /// The same corrections by element seen: rows are sources, columns receivers.
    pub fn transposed(&self) -> Self {
        let n = self.starts.len().saturating_sub(1);
        let mut starts = vec![0; n + 1];
        for &j in &self.column {
            starts[j as usize + 1] += 1;
        }
        for j in 0..n {
            starts[j + 1] += starts[j];
        }
        let mut next = starts.clone();
        let (mut column, mut difference) = (vec![0; self.column.len()], vec![0.0; self.column.len()]);
        for i in 0..n {
            for (j, entry) in self.row(i) {
                column[next[j]] = i as u32;
                difference[next[j]] = entry;
                next[j] += 1;
            }
        }
        Corrections { starts, column, difference, near_pairs: 0, summed_surfaces: 0 }
    }

    /// Entries of row `i`, by ascending column: (column, difference).
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = if i + 1 < self.starts.len() { self.starts[i]..self.starts[i + 1] } else { 0..0 };
        self.column[range.clone()].iter().map(|&c| c as usize).zip(self.difference[range].iter().copied())
    }

    /// Adds the sums over the row of each of the points from `first` on that is `wanted`, of `light`, `[N][bands]`, to
    /// `sums`, `[points][bands]`.
    pub fn add(
        &self,
        first: usize,
        wanted: impl Fn(usize) -> bool,
        light: &[Band],
        bands: usize,
        sums: &mut [[f64; BAND]],
    ) {
        for (i, sums) in (first..).zip(sums.chunks_mut(bands)).filter(|(i, _)| wanted(*i)) {
            let Some(&[start, end]) = self.starts.get(i..i + 2).and_then(|s| s.first_chunk()) else {
                continue;
            };
            for (band, sum) in sums.iter_mut().enumerate() {
                let (column, difference) = (&self.column[start..end], &self.difference[start..end]);
                let more = wide(RowSum { column, difference, light, bands, band });
                (0..BAND).for_each(|k| sum[k] += more[k]);
            }
        }
    }

    /// The entry of row `i` and column `j`, 0 where there is none.
    pub fn get(&self, i: usize, j: usize) -> f32 {
        let Some(&[start, end]) = self.starts.get(i..i + 2).and_then(|s| s.first_chunk()) else { return 0.0 };
        let found = self.column[start..end].binary_search(&(j as u32));
        found.map_or(0.0, |at| self.difference[start + at])
    }
}

/// Sums that do not wait for each other.
const APART: usize = 4;

/// Σ difference light over a row, for one band.
struct RowSum<'a> {
    column: &'a [u32],
    difference: &'a [f32],
    light: &'a [Band],
    bands: usize,
    band: usize,
}

impl HotLoop for RowSum<'_> {
    type Output = [f64; BAND];

    #[inline(always)]
    fn run(self) -> [f64; BAND] {
        let RowSum { column, difference, light, bands, band } = self;
        let mut sums = [[0.0; BAND]; APART];
        for (columns, differences) in column.chunks(APART).zip(difference.chunks(APART)) {
            for ((sum, &j), &difference) in sums.iter_mut().zip(columns).zip(differences) {
                let light = &light[j as usize * bands + band];
                for k in 0..BAND {
                    sum[k] += f64::from(difference * light[k]);
                }
            }
        }
        std::array::from_fn(|k| (sums[0][k] + sums[1][k]) + (sums[2][k] + sums[3][k]))
    }
}

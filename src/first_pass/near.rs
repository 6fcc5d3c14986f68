//! Pairs whose plain factor is not good enough: what to add to it, by receiver.

use super::form_factor::{NEAR, exact, plain, plane_distances};
use crate::points::SamplePoints;

/// Corrections to the plain kernel as a sparse matrix, rows are receivers.
#[derive(Clone, Debug, Default)]
pub struct NearPairs {
    /// First entry of each row, and the number of entries at the end; empty when there is no row.
    pub starts: Vec<usize>,
    /// The element seen.
    pub column: Vec<u32>,
    /// Exact q less the plain one.
    pub difference: Vec<f32>,
}

impl NearPairs {
    /// Joins rows given in order.
    pub fn from_rows(rows: Vec<Vec<(u32, f32)>>) -> Self {
        let total = rows.iter().map(Vec::len).sum();
        let mut near = NearPairs {
            starts: Vec::with_capacity(rows.len() + 1),
            column: Vec::with_capacity(total),
            difference: Vec::with_capacity(total),
        };
        near.starts.push(0);
        for row in rows {
            for (column, difference) in row {
                near.column.push(column);
                near.difference.push(difference);
            }
            near.starts.push(near.column.len());
        }
        near
    }

    /// The same corrections by element seen: rows are sources, columns receivers.
    pub fn transposed(&self) -> Self {
        let n = self.starts.len().saturating_sub(1);
        let mut rows = vec![Vec::new(); n];
        for i in 0..n {
            for (j, difference) in self.row(i) {
                rows[j].push((i as u32, difference));
            }
        }
        Self::from_rows(rows)
    }

    /// Entries of row `i`: (column, difference).
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = if i + 1 < self.starts.len() { self.starts[i]..self.starts[i + 1] } else { 0..0 };
        self.column[range.clone()].iter().map(|&c| c as usize).zip(self.difference[range].iter().copied())
    }

    /// Number of corrected pairs (ordered).
    pub fn len(&self) -> usize {
        self.column.len()
    }

    /// Whether no pair is corrected.
    pub fn is_empty(&self) -> bool {
        self.column.is_empty()
    }
}

/// The correction for element `j` seen from `i`, if it is near; the two face each other.
pub fn correction(points: &SamplePoints, i: usize, j: usize) -> Option<f32> {
    let (d_i, d_j, r2) = plane_distances(points, i, j);
    (points.area[j] > NEAR * r2).then(|| {
        let exact = exact(points.position[i], points.normal[i], &points.corners[j]);
        (exact - f64::from(plain(d_i, d_j, r2, points.area[j]))) as f32
    })
}

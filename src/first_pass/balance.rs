//! Scale factors of the ideal lobes of mirrors and panes, whose form factors are those of straight lines.
//!
//! They need little: what goes from l to k by way of all elements of a mirror is the form factor from the
//! image of l, whatever the factors of single elements sum to. Those need not sum to 1, for an
//! element that stands near covers more of what is behind it as seen from the middle of a mirror element
//! than as seen through all of it; scaling them to 1 would move light to wrong places. So a member k has one
//! factor u_k for all elements of a mirror: what it gets by way of all of them is what its form factor to
//! the mirror says, and energy is neither created nor lost. Reciprocity holds, since B stays symmetric.

use super::directions::{Directions, LANES};
use super::normalise::weighted;
use super::rows::Rows;
use crate::observer::Observer;
use crate::points::NO_POINT;
use rayon::prelude::*;

/// Rounds of balancing.
const ROUNDS: usize = 3;

/// The lobe of one specular element.
pub struct Element {
    /// The directions, whose scale is changed.
    pub directions: Directions,
    /// Its rows, towards the directions of `other`.
    pub rows: Rows,
    /// The element whose directions light leaves by: this one, or the one on the other side of the pane.
    pub other: usize,
    /// The surface and the side it belongs to.
    pub group: usize,
    /// Its area, m².
    pub area: f32,
    /// The sample points it sees, [`NO_POINT`] for openings.
    pub members: Vec<u32>,
}

/// Balances all elements. `points` is the number of sample points. Returns the (mean, largest) relative
/// deviation left.
///
/// Elements of a group that sees openings are left alone: the cells that stand for those are too coarse to
/// balance against, and light that leaves is lost anyway.
pub fn balance(elements: &mut [Element], points: usize, observer: &dyn Observer) -> (f64, f64) {
    let groups = elements.iter().map(|e| e.group + 1).max().unwrap_or(0);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); groups];
    elements.iter().enumerate().for_each(|(s, e)| members[e.group].push(s));
    let open = |e: &Element| e.members.contains(&NO_POINT);
    let closed = |group: &Vec<usize>| {
        group.iter().all(|&s| !open(&elements[s]) && !open(&elements[elements[s].other]))
    };
    let closed: Vec<bool> = members.iter().map(closed).collect();
    let mut error = (0.0, 0.0);
    for round in 0..ROUNDS {
        let wanted = |e: &Element| round == 0 || closed[e.group];
        let sums: Vec<Vec<f32>> = (elements.par_iter())
            .map(|e| {
                let to = &elements[e.other].directions;
                let sums = || e.rows.product(&e.directions, to, None, &weighted(to, None));
                if wanted(e) { sums() } else { Vec::new() }
            })
            .inspect(|_| observer.advance(u64::from(round == 0)))
            .collect();
        let (mut deviation, mut weight, mut largest) = (0.0, 0.0, 0.0f64);
        for (group, closed) in
            members.iter().zip(&closed).filter(|(g, _)| g.iter().any(|&s| !sums[s].is_empty()))
        {
            let (mut found, mut expected) = (vec![0.0f64; points], vec![0.0f64; points]);
            for &s in group {
                let Element { directions, area, members, .. } = &elements[s];
                for (k, &point) in members.iter().enumerate().filter(|(_, p)| **p != NO_POINT) {
                    let q = f64::from(area * directions.weight[k / LANES][k % LANES]);
                    found[point as usize] += q * f64::from(directions.scale_of(k) * sums[s][k]);
                    expected[point as usize] += q;
                }
            }
            for (found, expected) in found.iter().zip(&expected).filter(|(_, e)| **e > 0.0) {
                let off = (found / expected - 1.0).abs();
                deviation += expected * off;
                weight += expected;
                largest = largest.max(off);
            }
            if !closed {
                continue;
            }
            for &s in group {
                let Element { directions, members, .. } = &mut elements[s];
                for (k, &point) in members.iter().enumerate() {
                    let ratio = (expected[point as usize] / found[point as usize]).sqrt() as f32;
                    if ratio.is_finite() {
                        directions.scale[k / LANES][k % LANES] *= ratio;
                    }
                }
            }
        }
        if weight > 0.0 {
            error = (deviation / weight, largest);
        }
    }
    error
}

//! Scale factors v that give a symmetric operator of non-negative numbers the row sums it should have:
//! v_l Σ_k K(l, k) v_k = t_l, where μ_l K(l, k) = μ_k K(k, l) for some measure μ.
//!
//! Sinkhorn's balancing, a step of log v in proportion to log t / rows, comes near in a few rounds and then hardly gets on:
//! what lobes send from one half of the hemisphere to the other makes K nearly bipartite. So the combination of the last
//! steps is taken that would have left least (D. G. Anderson, 1965; H. F. Walker and P. Ni, "Anderson acceleration for
//! fixed-point iterations", 2011): narrow lobes come as near with 24 products as with 30 of Newton's method and conjugate
//! gradients, and nearer from then on.

use super::cells::solve;

/// Products with K at most, all together.
const PRODUCTS: usize = 24;
/// A step of balancing, as a share of the whole way: 1/2 is the square root.
const STEP: f32 = 0.6;
/// So many steps are combined.
const STEPS: usize = 5;
/// A step of log v is no larger.
const LARGEST: f32 = 1.4;
/// Good enough: mean and largest relative deviation of a row.
const GOOD: (f64, f64) = (2e-4, 2e-3);
/// What keeps changes that all but depend on each other apart, as a share of their squares.
const APART: f64 = 1e-6;

/// The operator and what its rows should sum to.
pub struct Problem<'a, P: Fn(&[f32]) -> Vec<f32>> {
    /// Σ_k K(l, k) x_k of every l, given x.
    pub product: P,
    /// μ
    pub measure: &'a [f32],
    /// t
    pub target: &'a [f32],
}

/// Relative deviation of rows: mean by measure, and largest.
type Deviation = (f64, f64);

impl<P: Fn(&[f32]) -> Vec<f32>> Problem<'_, P> {
    /// The scale factors; 1 where a row holds nothing or should not.
    pub fn solve(&self) -> Vec<f32> {
        let n = self.measure.len();
        let mut v = vec![1.0f32; n];
        let mut best = (f64::INFINITY, v.clone());
        let mut history = History::default();
        for product in 1..=PRODUCTS {
            let rows = self.rows(&v);
            let deviation = self.deviation(&rows);
            if deviation.0 < best.0 {
                best.0 = deviation.0;
                best.1.copy_from_slice(&v);
            }
            if good(deviation) || product == PRODUCTS {
                break;
            }
            // 2 (x - 1) / (x + 1) is log x to the third order.
            let way = |l: usize| match self.counts(l) && rows[l] > 0.0 {
                true => STEP * 2.0 * (self.target[l] - rows[l]) / (self.target[l] + rows[l]),
                false => 0.0,
            };
            let way: Vec<f32> = (0..n).map(way).collect();
            let weighted: Vec<f32> =
                (0..n).map(|l| (self.measure[l] * self.target[l]).max(0.0).sqrt() * way[l]).collect();
            let step = history.step(way, weighted);
            for (v, step) in v.iter_mut().zip(step) {
                *v *= (2.0 + step) / (2.0 - step);
            }
        }
        best.1
    }

    /// v_l Σ_k K(l, k) v_k
    pub fn rows(&self, v: &[f32]) -> Vec<f32> {
        (self.product)(v).iter().zip(v).map(|(sum, v)| sum * v).collect()
    }

    /// Whether row `l` counts.
    fn counts(&self, l: usize) -> bool {
        self.measure[l] > 0.0 && self.target[l] > 0.0
    }

    /// How far `rows` are from the target.
    pub fn deviation(&self, rows: &[f32]) -> Deviation {
        let (mut sum, mut whole, mut largest) = ([0.0f32; SIDE], [0.0f32; SIDE], [0.0f32; SIDE]);
        let all = self.measure.chunks(SIDE).zip(self.target.chunks(SIDE)).zip(rows.chunks(SIDE));
        for ((measure, target), rows) in all {
            for (k, ((&measure, &target), row)) in measure.iter().zip(target).zip(rows).enumerate() {
                let counts = measure > 0.0 && target > 0.0;
                let off = if counts { (row - target).abs() } else { 0.0 };
                sum[k] += measure * off;
                whole[k] += if counts { measure * target } else { 0.0 };
                let share = if counts { off / target } else { 0.0 };
                largest[k] = if share > largest[k] { share } else { largest[k] };
            }
        }
        let (sum, whole) = (total(&sum), total(&whole));
        let largest = f64::from(largest.into_iter().fold(0.0, f32::max));
        (if whole > 0.0 { sum / whole } else { 0.0 }, largest)
    }
}

/// The last steps of Anderson's method.
#[derive(Default)]
struct History {
    /// The way that balancing would go, what it weighs, and the step taken, of the last round.
    last: Option<[Vec<f32>; 3]>,
    /// By how much each step and the way changed together, and the weighted way by itself; the oldest is overwritten.
    changes: Vec<[Vec<f32>; 2]>,
    /// Products of the weighted changes.
    products: [[f64; STEPS]; STEPS],
    /// Steps so far.
    count: usize,
}

impl History {
    /// The step to take where balancing would go this `way`, which is also given as it is `weighted`.
    fn step(&mut self, way: Vec<f32>, weighted: Vec<f32>) -> Vec<f32> {
        let mut step = way.clone();
        if let Some([last, last_weighted, taken]) = self.last.take() {
            let change = |now: &[f32], last: &[f32]| -> Vec<f32> {
                now.iter().zip(last).map(|(a, b)| a - b).collect()
            };
            let mut both = change(&way, &last);
            both.iter_mut().zip(&taken).for_each(|(both, taken)| *both += taken);
            let at = self.count % STEPS;
            let new = [both, change(&weighted, &last_weighted)];
            if at < self.changes.len() {
                self.changes[at] = new
            } else {
                self.changes.push(new)
            }
            for (k, [_, other]) in self.changes.iter().enumerate() {
                self.products[at][k] = dot(&self.changes[at][1], other);
                self.products[k][at] = self.products[at][k];
            }
            self.count += 1;
            for (share, [both, _]) in self.shares(&weighted).into_iter().zip(&self.changes) {
                step.iter_mut().zip(both).for_each(|(step, both)| *step -= share * both);
            }
        }
        step.iter_mut().for_each(|step| *step = step.clamp(-LARGEST, LARGEST));
        self.last = Some([way, weighted, step.clone()]);
        step
    }

    /// How much of each change makes up most of what is `left`; nothing where that cannot be told.
    fn shares(&self, left: &[f32]) -> [f32; STEPS] {
        let (mut matrix, mut right) = (self.products, [0.0; STEPS]);
        for (k, row) in matrix.iter_mut().enumerate() {
            if let Some([_, change]) = self.changes.get(k) {
                right[k] = dot(change, left);
                row[k] *= 1.0 + APART;
            }
            if row[k] == 0.0 {
                row[k] = 1.0;
            }
        }
        let shares = solve(matrix, right).map(|share| share as f32);
        if shares.iter().all(|share| share.is_finite()) { shares } else { [0.0; STEPS] }
    }
}

/// Sums are taken in so many parts side by side, which are short enough for `f32`.
const SIDE: usize = 16;

/// The sum of parts.
fn total(parts: &[f32; SIDE]) -> f64 {
    parts.iter().map(|part| f64::from(*part)).sum()
}

/// Σ a b
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut parts = [0.0f32; SIDE];
    for (a, b) in a.chunks(SIDE).zip(b.chunks(SIDE)) {
        for ((part, a), b) in parts.iter_mut().zip(a).zip(b) {
            *part += a * b;
        }
    }
    total(&parts)
}

/// Whether no more need be done.
fn good(deviation: Deviation) -> bool {
    deviation.0 < GOOD.0 && deviation.1 < GOOD.1
}

/// Lowers `v` until no row is above its target, and returns what rows then lack; their mean and largest share of
/// the target as well.
pub fn lower<P: Fn(&[f32]) -> Vec<f32>>(problem: &Problem<P>, v: &mut [f32]) -> (Vec<f32>, Deviation) {
    let rows = problem.rows(v);
    for (l, v) in v.iter_mut().enumerate().filter(|(l, _)| problem.counts(*l) && rows[*l] > 0.0) {
        *v *= (problem.target[l] / rows[l]).min(1.0);
    }
    let rows = problem.rows(v);
    let lacks = |(l, row): (usize, &f32)| {
        if problem.measure[l] > 0.0 { (problem.target[l] - row).max(0.0) } else { 0.0 }
    };
    (rows.iter().enumerate().map(lacks).collect(), problem.deviation(&rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All but bipartite: the first half of the rows lies with the second, and little with itself.
    #[test]
    fn rows_get_their_sums_though_halves_see_little_but_each_other() {
        let n = 300;
        let half = |l: usize| usize::from(l >= n / 2);
        let measure: Vec<f32> = (0..n).map(|l| 0.5 + (l * 7 % 13) as f32 / 13.0).collect();
        let element = |l: usize, k: usize| {
            let (low, high) = (l.min(k), l.max(k));
            let near = 1.0 + (low * 31 + high * 17) as f32 % 11.0;
            near * if half(l) == half(k) { 0.02 } else { 1.0 } / n as f32
        };
        let product = |x: &[f32]| -> Vec<f32> {
            (0..n).map(|l| (0..n).map(|k| element(l, k) * measure[k] * x[k]).sum()).collect()
        };
        // Sums that scale factors far from each other give.
        let factors: Vec<f32> = (0..n).map(|l| if l % 3 == 0 { 4.0 } else { 0.3 + half(l) as f32 }).collect();
        let target = Problem { product, measure: &measure, target: &[] }.rows(&factors);
        let problem = Problem { product, measure: &measure, target: &target };
        let mut v = problem.solve();
        let (mean, largest) = problem.deviation(&problem.rows(&v));
        assert!(mean < GOOD.0 && largest < GOOD.1, "{mean} {largest}");
        let (lacks, _) = lower(&problem, &mut v);
        let rows = problem.rows(&v);
        for l in 0..n {
            assert!(rows[l] <= target[l] * 1.00001 && lacks[l] >= 0.0);
            assert!((rows[l] + lacks[l] - target[l]).abs() < 1e-5 * target[l]);
        }
    }

    #[test]
    fn rows_that_hold_nothing_or_should_not_are_left_alone() {
        let product = |x: &[f32]| vec![x[0] + x[1], x[0] + x[1], 0.0, x[3]];
        let problem = Problem { product, measure: &[1.0; 4], target: &[1.0, 3.0, 1.0, 0.0] };
        let v = problem.solve();
        assert!(v.iter().all(|v| v.is_finite() && *v > 0.0) && v[2] == 1.0 && v[3] == 1.0, "{v:?}");
        let (mean, largest) = problem.deviation(&problem.rows(&v));
        assert!((mean - 0.2).abs() < 1e-3 && (largest - 1.0).abs() < 1e-6, "{mean} {largest}");
    }
}

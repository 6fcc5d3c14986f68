//! Scale factors v that give a symmetric operator of non-negative numbers the row sums it should have:
//! v_l Σ_k K(l, k) v_k = t_l, where μ_l K(l, k) = μ_k K(k, l) for some measure μ.
//!
//! Sinkhorn's balancing, a step of log v in proportion to log t / rows, comes near in a few rounds and then hardly gets on:
//! what lobes send from one half of the hemisphere to the other makes K nearly bipartite. So the combination of the last
//! steps is taken that would have left least (D. G. Anderson, 1965; H. F. Walker and P. Ni, "Anderson acceleration for
//! fixed-point iterations", 2011): narrow lobes come as near with 24 products as with 30 of Newton's method and conjugate
//! gradients, and nearer from then on.

use super::cells::solve;
use crate::simd::{HotLoop, wide};

/// Products with K at most, all together.
const PRODUCTS: usize = 24;
/// From factors of another roughness so many come as near,
const AGAIN: usize = 9;
/// which is this mean deviation.
const NEAR: f64 = 2e-3;
/// A step of balancing, as a share of the whole way: 1/2 is the square root.
const STEP: f32 = 0.6;
/// So many steps are combined.
const STEPS: usize = 5;
/// A step of log v is no larger.
const LARGEST: f32 = 1.4;
/// Good enough: mean and largest relative deviation of a row.
const GOOD: (f64, f64) = (2e-4, 2e-3);
/// Factors are lowered again where a row is still so many times its target,
const ABOVE: f32 = 1.002;
/// so often at most.
const LOWERINGS: usize = 4;
/// What keeps changes that all but depend on each other apart, as a share of their squares.
const APART: f64 = 1e-6;
/// Vectors are so many numbers at a time; sums are taken in as many parts, which are short enough for `f32`.
const SIDE: usize = 16;

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

/// Scale factors, and the rows they give.
pub type Scaled = (Vec<f32>, Vec<f32>);

impl<P: Fn(&[f32]) -> Vec<f32>> Problem<'_, P> {
    /// The scale factors; 1 where a row holds nothing or should not. `again` if K is already scaled as it should have been at
    /// another roughness.
    pub fn solve(&self, again: bool) -> Scaled {
        let mut v = vec![1.0f32; self.measure.len()];
        let mut best = (f64::INFINITY, v.clone(), Vec::new());
        let mut history = History::default();
        for product in 1..=PRODUCTS {
            let Seen { rows, deviation, way } = self.look(&v);
            if best.2.is_empty() || deviation.0 < best.0 {
                best.0 = deviation.0;
                best.1.copy_from_slice(&v);
                best.2 = rows;
            }
            let near = again && product >= AGAIN && best.0 < NEAR;
            if good(deviation) || near || product == PRODUCTS {
                break;
            }
            history.step(way, &mut v);
        }
        (best.1, best.2)
    }

    /// How far the rows that `v` gives are from the target, and where balancing would go from there.
    fn look(&self, v: &[f32]) -> Seen {
        let sums = (self.product)(v);
        wide(Look { sums, v, measure: self.measure, target: self.target })
    }
}

/// What is to be said of some scale factors.
struct Seen {
    /// v_l Σ_k K(l, k) v_k
    rows: Vec<f32>,
    deviation: Deviation,
    way: Way,
}

/// Where balancing goes: the way of log v, and what it weighs.
struct Way {
    step: Vec<f32>,
    weighted: Vec<f32>,
}

/// [`Problem::look`], given the product.
struct Look<'a> {
    sums: Vec<f32>,
    v: &'a [f32],
    measure: &'a [f32],
    target: &'a [f32],
}

impl HotLoop for Look<'_> {
    type Output = Seen;

    #[inline(always)]
    fn run(mut self) -> Seen {
        let n = self.v.len();
        let (mut sum, mut whole, mut largest) = ([0.0f32; SIDE], [0.0f32; SIDE], [0.0f32; SIDE]);
        let mut way = Way { step: vec![0.0; n], weighted: vec![0.0; n] };
        for first in (0..n).step_by(SIDE) {
            let [sums, v] = [part(&self.sums, first), part(self.v, first)];
            let [measure, target] = [part(self.measure, first), part(self.target, first)];
            let [mut rows, mut step, mut weighted] = [[0.0; SIDE]; 3];
            for l in 0..SIDE {
                let row = sums[l] * v[l];
                rows[l] = row;
                let counts = measure[l] > 0.0 && target[l] > 0.0;
                let weight = if counts { measure[l] * target[l] } else { 0.0 };
                let off = if counts { (row - target[l]).abs() } else { 0.0 };
                sum[l] += measure[l] * off;
                whole[l] += weight;
                let share = if counts { off / target[l] } else { 0.0 };
                largest[l] = if share > largest[l] { share } else { largest[l] };
                // 2 (x - 1) / (x + 1) is log x to the third order.
                let way = STEP * 2.0 * (target[l] - row) / (target[l] + row);
                step[l] = if counts && row > 0.0 { way } else { 0.0 };
                weighted[l] = weight.sqrt() * step[l];
            }
            let here = first..(first + SIDE).min(n);
            way.step[here.clone()].copy_from_slice(&step[..here.len()]);
            way.weighted[here.clone()].copy_from_slice(&weighted[..here.len()]);
            let length = here.len();
            self.sums[here].copy_from_slice(&rows[..length]);
        }
        let (sum, whole) = (total(&sum), total(&whole));
        let largest = f64::from(largest.into_iter().fold(0.0, f32::max));
        let mean = if whole > 0.0 { sum / whole } else { 0.0 };
        Seen { rows: self.sums, deviation: (mean, largest), way }
    }
}

/// The last steps of Anderson's method.
#[derive(Default)]
struct History {
    /// Where balancing would have gone in the last round, and the step taken.
    last: Option<(Way, Vec<f32>)>,
    /// By how much each step and the way changed together, and the weighted way by itself; the oldest is overwritten.
    changes: Vec<[Vec<f32>; 2]>,
    /// Products of the weighted changes.
    products: [[f64; STEPS]; STEPS],
    /// Steps so far.
    count: usize,
}

impl History {
    /// Takes the step of log `v` where balancing would go that way `now`.
    fn step(&mut self, now: Way, v: &mut [f32]) {
        let mut shares = [0.0; STEPS];
        if let Some((last, taken)) = self.last.take() {
            let at = self.count % STEPS;
            if self.changes.len() < STEPS {
                self.changes.push([Vec::new(), Vec::new()]);
            }
            self.changes[at] = wide(Change { now: &now, last, taken: &taken });
            for k in 0..self.changes.len() {
                self.products[at][k] = dot(&self.changes[at][1], &self.changes[k][1]);
                self.products[k][at] = self.products[at][k];
            }
            self.count += 1;
            shares = self.shares(&now.weighted);
        }
        let taken = wide(Step { shares, changes: &self.changes, way: &now.step, v });
        self.last = Some((now, taken));
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

/// How much changed from the last way to that of `now`: with the step taken, and weighted by itself.
struct Change<'a> {
    now: &'a Way,
    last: Way,
    taken: &'a [f32],
}

impl HotLoop for Change<'_> {
    type Output = [Vec<f32>; 2];

    #[inline(always)]
    fn run(self) -> [Vec<f32>; 2] {
        let Change { now, last: Way { mut step, mut weighted }, taken } = self;
        for ((last, now), taken) in step.iter_mut().zip(&now.step).zip(taken) {
            *last = (now - *last) + taken;
        }
        for (last, now) in weighted.iter_mut().zip(&now.weighted) {
            *last = now - *last;
        }
        [step, weighted]
    }
}

/// Takes the way less shares of the changes as a step of log `v`, and returns it.
struct Step<'a> {
    shares: [f32; STEPS],
    changes: &'a [[Vec<f32>; 2]],
    way: &'a [f32],
    v: &'a mut [f32],
}

impl HotLoop for Step<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let mut step = self.way.to_vec();
        for (share, [both, _]) in self.shares.iter().zip(self.changes) {
            for (step, both) in step.iter_mut().zip(both) {
                *step -= share * both;
            }
        }
        for (v, step) in self.v.iter_mut().zip(&mut step) {
            *step = if *step < -LARGEST { -LARGEST } else { *step };
            *step = if *step > LARGEST { LARGEST } else { *step };
            *v *= (2.0 + *step) / (2.0 - *step);
        }
        step
    }
}

/// Some numbers from `first` on, with zeros after the last.
#[inline(always)]
fn part(of: &[f32], first: usize) -> [f32; SIDE] {
    let mut part = [0.0; SIDE];
    match of[first..].first_chunk() {
        Some(whole) => part = *whole,
        None => part[..of.len() - first].copy_from_slice(&of[first..]),
    }
    part
}

/// The sum of parts.
fn total(parts: &[f32; SIDE]) -> f64 {
    parts.iter().map(|part| f64::from(*part)).sum()
}

/// Σ a b
fn dot(a: &[f32], b: &[f32]) -> f64 {
    wide(Dot { a, b })
}

/// [`dot`]
struct Dot<'a> {
    a: &'a [f32],
    b: &'a [f32],
}

impl HotLoop for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let mut sums = [0.0f32; SIDE];
        for first in (0..self.a.len()).step_by(SIDE) {
            let (a, b) = (part(self.a, first), part(self.b, first));
            for l in 0..SIDE {
                sums[l] += a[l] * b[l];
            }
        }
        total(&sums)
    }
}

/// Whether no more need be done.
fn good(deviation: Deviation) -> bool {
    deviation.0 < GOOD.0 && deviation.1 < GOOD.1
}

/// Lowers scale factors until no row is more than its target. Returns them, and what rows then lack; their mean and largest
/// share of the target as well.
///
/// Between nodes K has negative elements: a row may be less than nothing, which is held to its target as well, for it
/// would be made up for by as much light that is spread; and it may rise as others are lowered, which takes another turn.
pub fn lower<P: Fn(&[f32]) -> Vec<f32>>(
    problem: &Problem<P>,
    (mut v, mut rows): Scaled,
) -> (Vec<f32>, Vec<f32>, Deviation) {
    let Problem { measure, target, .. } = *problem;
    let counts = |l: usize| measure[l] > 0.0 && target[l] > 0.0;
    let (mut deviation, mut turns) = ((0.0, 0.0), 0);
    while turns == 0
        || turns < LOWERINGS && (0..v.len()).any(|l| counts(l) && rows[l].abs() > ABOVE * target[l])
    {
        for l in (0..v.len()).filter(|&l| counts(l) && rows[l].abs() > target[l]) {
            v[l] *= target[l] / rows[l].abs();
        }
        Seen { rows, deviation, .. } = problem.look(&v);
        turns += 1;
    }
    for (row, (measure, target)) in rows.iter_mut().zip(measure.iter().zip(target)) {
        *row = if *measure > 0.0 { (target - *row).max(0.0) } else { 0.0 };
    }
    (v, rows, deviation)
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
        let rows = |v: &[f32]| -> Vec<f32> { product(v).iter().zip(v).map(|(sum, v)| sum * v).collect() };
        let target = rows(&factors);
        let problem = Problem { product, measure: &measure, target: &target };
        let solved = problem.solve(false);
        let (mean, largest) = problem.look(&solved.0).deviation;
        assert!(mean < GOOD.0 && largest < GOOD.1, "{mean} {largest}");
        assert_eq!(solved.1, rows(&solved.0));
        let (v, lacks, _) = lower(&problem, solved);
        let rows = rows(&v);
        for l in 0..n {
            assert!(rows[l] <= target[l] * 1.00001 && lacks[l] >= 0.0);
            assert!((rows[l] + lacks[l] - target[l]).abs() < 1e-5 * target[l]);
        }
    }

    #[test]
    fn near_the_end_few_products_do() {
        let n = 200;
        let measure: Vec<f32> = (0..n).map(|l| 0.5 + (l * 5 % 11) as f32 / 11.0).collect();
        // As if scaled for a lobe a little narrower.
        let off: Vec<f32> = (0..n).map(|l| 1.0 + 0.2 * (l as f32 * 0.7).sin()).collect();
        let element =
            |l: usize, k: usize| off[l] * off[k] * (-(l.abs_diff(n - k) as f32 / 4.0).powi(2)).exp();
        let products = std::cell::Cell::new(0);
        let product = |x: &[f32]| -> Vec<f32> {
            products.set(products.get() + 1);
            (0..n).map(|l| (0..n).map(|k| element(l, k) * measure[k] * x[k]).sum()).collect()
        };
        let target: Vec<f32> =
            product(&vec![1.0; n]).iter().enumerate().map(|(l, sum)| sum / off[l]).collect();
        let problem = Problem { product, measure: &measure, target: &target };
        let deviation = |again: bool| {
            products.set(0);
            let (v, _) = problem.solve(again);
            let products = products.get();
            (products, problem.look(&v).deviation.0)
        };
        let (again, cold) = (deviation(true), deviation(false));
        println!("{again:?} and {cold:?} products and deviation");
        assert!(again.0 == AGAIN && again.1 < NEAR, "{again:?}");
        assert!(cold.0 > AGAIN && cold.1 <= again.1, "{cold:?}");
    }

    #[test]
    fn rows_that_hold_nothing_or_should_not_are_left_alone() {
        let product = |x: &[f32]| vec![x[0] + x[1], x[0] + x[1], 0.0, x[3]];
        let problem = Problem { product, measure: &[1.0; 4], target: &[1.0, 3.0, 1.0, 0.0] };
        let (v, _) = problem.solve(false);
        assert!(v.iter().all(|v| v.is_finite() && *v > 0.0) && v[2] == 1.0 && v[3] == 1.0, "{v:?}");
        let (mean, largest) = problem.look(&v).deviation;
        assert!((mean - 0.2).abs() < 1e-3 && (largest - 1.0).abs() < 1e-6, "{mean} {largest}");
    }
}

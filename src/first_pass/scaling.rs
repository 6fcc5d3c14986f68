//! Scale factors v that give a symmetric operator of non-negative numbers the row sums it should have:
//! v_l Σ_k K(l, k) v_k = t_l, where μ_l K(l, k) = μ_k K(k, l) for some measure μ.
//!
//! It begins with Sinkhorn's balancing with square roots, which comes near in a few rounds and then hardly gets on:
//! what lobes send from one half of the hemisphere to the other makes K nearly bipartite. Newton's method on
//! log v goes on from there (P. A. Knight and D. Ruiz, "A fast algorithm for matrix balancing", 2013); its
//! equations are solved by conjugate gradients, one product with K a step.

/// Rounds of square roots at first.
const ROOTS: usize = 3;
/// Products with K at most, all together.
const PRODUCTS: usize = 30;
/// Steps of conjugate gradients for one step of Newton's method at most.
const STEPS: usize = 8;
/// Conjugate gradients stop when what is left is this share of what they began with.
const LEFT: f64 = 0.1;
/// Good enough: mean and largest relative deviation of a row.
const GOOD: (f64, f64) = (2e-4, 2e-3);
/// Factor by which a step changes v at most.
const LARGEST: f32 = 4.0;

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
        let mut v = vec![1.0f32; self.measure.len()];
        let mut rows = self.rows(&v);
        let mut left = PRODUCTS - 1;
        for _ in 0..ROOTS {
            if good(self.deviation(&rows)) {
                return v;
            }
            self.scale(&mut v, |l| (self.target[l] / rows[l]).sqrt());
            rows = self.rows(&v);
            left -= 1;
        }
        while left > 2 {
            let before = self.deviation(&rows);
            if good(before) {
                break;
            }
            let (step, products) = self.newton(&v, &rows, STEPS.min(left - 1));
            let mut next = v.clone();
            self.scale(&mut next, |l| step[l].exp());
            let next_rows = self.rows(&next);
            left -= products + 1;
            if self.deviation(&next_rows).0 < before.0 {
                (v, rows) = (next, next_rows);
            } else if left > 0 {
                self.scale(&mut v, |l| (self.target[l] / rows[l]).sqrt());
                rows = self.rows(&v);
                left -= 1;
            }
        }
        v
    }

    /// v_l Σ_k K(l, k) v_k
    pub fn rows(&self, v: &[f32]) -> Vec<f32> {
        (self.product)(v).iter().zip(v).map(|(sum, v)| sum * v).collect()
    }

    /// Whether row `l` counts.
    fn counts(&self, l: usize) -> bool {
        self.measure[l] > 0.0 && self.target[l] > 0.0
    }

    /// Multiplies v where that can be done.
    fn scale(&self, v: &mut [f32], factor: impl Fn(usize) -> f32) {
        for (l, v) in v.iter_mut().enumerate().filter(|(l, _)| self.counts(*l)) {
            let factor = factor(l);
            if factor > 0.0 && factor.is_finite() {
                *v *= factor.clamp(1.0 / LARGEST, LARGEST);
            }
        }
    }

    /// How far `rows` are from the target.
    pub fn deviation(&self, rows: &[f32]) -> Deviation {
        let (mut sum, mut whole, mut largest) = (0.0, 0.0, 0.0f64);
        for (l, row) in rows.iter().enumerate().filter(|(l, _)| self.counts(*l)) {
            let [row, target, measure] = [*row, self.target[l], self.measure[l]].map(f64::from);
            sum += measure * (row - target).abs();
            whole += measure * target;
            largest = largest.max((row / target - 1.0).abs());
        }
        (if whole > 0.0 { sum / whole } else { 0.0 }, largest)
    }

    /// Newton's step of log v: (rows + v K v) x = target - rows. Also the number of products.
    fn newton(&self, v: &[f32], rows: &[f32], most: usize) -> (Vec<f32>, usize) {
        let n = v.len();
        // Rows that hold nothing take no part.
        let part = |l: usize| self.counts(l) && rows[l] > 0.0;
        let mut x = vec![0.0f32; n];
        let mut residual: Vec<f32> =
            (0..n).map(|l| if part(l) { self.target[l] - rows[l] } else { 0.0 }).collect();
        let preconditioned = |residual: &[f32]| -> Vec<f32> {
            (0..n).map(|l| if part(l) { residual[l] / rows[l] } else { 0.0 }).collect()
        };
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            (0..n).map(|l| f64::from(self.measure[l]) * f64::from(a[l]) * f64::from(b[l])).sum()
        };
        let mut z = preconditioned(&residual);
        let mut direction = z.clone();
        let mut size = dot(&residual, &z);
        let enough = LEFT * LEFT * size;
        for step in 0..most {
            let scaled: Vec<f32> = direction.iter().zip(v).map(|(d, v)| d * v).collect();
            let product = (self.product)(&scaled);
            let image: Vec<f32> = (0..n)
                .map(|l| if part(l) { rows[l] * direction[l] + v[l] * product[l] } else { 0.0 })
                .collect();
            let curvature = dot(&direction, &image);
            let length = (size / curvature) as f32;
            if !length.is_finite() || length <= 0.0 {
                return (x, step + 1);
            }
            for l in 0..n {
                x[l] += length * direction[l];
                residual[l] -= length * image[l];
            }
            z = preconditioned(&residual);
            let next = dot(&residual, &z);
            if next <= enough {
                return (x, step + 1);
            }
            let turn = (next / size) as f32;
            size = next;
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + turn * *d);
        }
        (x, most)
    }
}

/// Whether no more need be done.
fn good(deviation: Deviation) -> bool {
    deviation.0 < GOOD.0 && deviation.1 < GOOD.1
}

/// Lowers `v` until no row is above its target, and returns what rows then lack; their mean and largest share of
/// the target as well.
pub fn lower<P: Fn(&[f32]) -> Vec<f32>>(problem: &Problem<P>, v: &mut [f32]) -> (Vec<f32>, Deviation) {
    let rows = problem.rows(v);
    problem.scale(v, |l| (problem.target[l] / rows[l]).min(1.0));
    let rows = problem.rows(v);
    let lacks = |(l, row): (usize, &f32)| {
        if problem.measure[l] > 0.0 { (problem.target[l] - row).max(0.0) } else { 0.0 }
    };
    (rows.iter().enumerate().map(lacks).collect(), problem.deviation(&rows))
}

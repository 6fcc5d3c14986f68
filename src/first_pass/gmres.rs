//! Flexible GMRES (Saad 1993) for all wavelengths at once: each wavelength has its own small
//! problem, every application of the operator serves all of them.

use crate::error::Result;
use crate::simd::{HotLoop, wide};
use rayon::prelude::*;
use std::ops::Range;

/// Vectors kept before a restart.
const RESTART: usize = 30;

/// What one run did.
pub struct Outcome {
    /// The solution, `[W][N]`.
    pub x: Vec<f32>,
    /// b - A x as the recurrence has it, `[W][N]`.
    pub residual: Vec<f32>,
    /// Applications of the operator.
    pub steps: usize,
    /// Size of the residual by wavelength.
    pub left: Vec<f64>,
    /// How much of each step's z is in x: `[steps][W]`.
    pub shares: Vec<Vec<f64>>,
}

/// One wavelength's least-squares problem: the Hessenberg matrix made triangular by rotations.
#[derive(Default)]
struct Small {
    columns: Vec<Vec<f64>>,
    rotations: Vec<(f64, f64)>,
    /// Right-hand side, rotated along.
    g: Vec<f64>,
    /// [`size`] of the residual.
    left: f64,
    done: bool,
}

impl Small {
    /// Takes the next column of the Hessenberg matrix.
    fn push(&mut self, mut h: Vec<f64>) {
        for (i, &(c, s)) in self.rotations.iter().enumerate() {
            (h[i], h[i + 1]) = (c * h[i] + s * h[i + 1], c * h[i + 1] - s * h[i]);
        }
        let j = h.len() - 2;
        let length = h[j].hypot(h[j + 1]);
        let (c, s) = if length > 0.0 { (h[j] / length, h[j + 1] / length) } else { (1.0, 0.0) };
        self.rotations.push((c, s));
        h[j] = length;
        h.truncate(j + 1);
        self.columns.push(h);
        let g = self.g[j];
        self.g[j] = c * g;
        self.g.push(-s * g);
    }

    /// Coefficients of the z vectors.
    fn solve(&self) -> Vec<f64> {
        let m = self.columns.len();
        let mut y = vec![0.0; m];
        for i in (0..m).rev() {
            let known: f64 = (i + 1..m).map(|j| self.columns[j][i] * y[j]).sum();
            let pivot = self.columns[i][i];
            y[i] = if pivot.abs() > 0.0 { (self.g[i] - known) / pivot } else { 0.0 };
        }
        y
    }

    /// The residual at the points of `plane`, given the orthonormal basis, whose newest vector comes apart.
    fn residual(&self, plane: Range<usize>, basis: &[Vec<f32>], newest: &[f32]) -> Vec<f64> {
        // The rotations undone on the last entry give its coefficients.
        let m = self.columns.len();
        let mut coefficients = vec![0.0; m + 1];
        coefficients[m] = self.g[m];
        for (i, &(c, s)) in self.rotations.iter().enumerate().rev() {
            let (a, b) = (coefficients[i], coefficients[i + 1]);
            (coefficients[i], coefficients[i + 1]) = (c * a - s * b, s * a + c * b);
        }
        let mut residual = vec![0.0; plane.len()];
        let vectors = basis.iter().map(|v| &v[plane.clone()]).take(m).chain([newest]);
        for (coefficient, vector) in coefficients.iter().zip(vectors) {
            residual.iter_mut().zip(vector).for_each(|(r, &v)| *r += coefficient * f64::from(v));
        }
        residual
    }
}

/// Σ area a b
pub(super) fn inner(area: &[f32], a: &[f32], b: &[f32]) -> f64 {
    wide(Inner(area, a, b))
}

/// [`inner`], in so many sums side by side.
struct Inner<'a>(&'a [f32], &'a [f32], &'a [f32]);

impl HotLoop for Inner<'_> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        const LANES: usize = 8;
        let Inner(area, a, b) = self;
        let mut sums = [0.0f64; LANES];
        let (areas, a_s, b_s) = (area.chunks_exact(LANES), a.chunks_exact(LANES), b.chunks_exact(LANES));
        let rest = areas.remainder().iter().zip(a_s.remainder()).zip(b_s.remainder());
        let rest: f64 = rest.map(|((&s, &a), &b)| f64::from(s) * f64::from(a) * f64::from(b)).sum();
        for ((area, a), b) in areas.zip(a_s).zip(b_s) {
            for k in 0..LANES {
                sums[k] += f64::from(area[k]) * f64::from(a[k]) * f64::from(b[k]);
            }
        }
        sums.iter().sum::<f64>() + rest
    }
}

/// Σ root(area weight) |r|: where all weights are areas, flux; where rooms weigh more, each room's beside its own.
fn size((area, weight): (&[f32], &[f32]), r: impl Iterator<Item = f64>) -> f64 {
    let root = |(a, w): (&f32, &f32)| (f64::from(*a) * f64::from(*w)).sqrt();
    area.iter().zip(weight).map(root).zip(r).map(|(root, r)| root * r.abs()).sum()
}

/// The [`size`] of a vector `[W][N]` at each of `w` wavelengths.
pub(super) fn sizes((area, weight): (&[f32], &[f32]), w: usize, r: &[f32]) -> Vec<f64> {
    let n = area.len();
    let of = |k: usize| size((area, weight), r[k * n..(k + 1) * n].iter().map(|&r| f64::from(r)));
    (0..w).map(of).collect()
}

/// Solves A x = b, `[W][N]`, in the norm that weighs points by `weight`, until the [`size`] of the residual of
/// wavelength k is at most `goal[k]` or `limit` steps are done. `step(v, excess)` returns (z, A z) where z
/// is v or something nearer to A⁻¹ v; `excess` is the largest residual yet over its goal.
pub fn solve(
    b: &[f32],
    (area, weight): (&[f32], &[f32]),
    goal: &[f64],
    limit: usize,
    mut step: impl FnMut(&[f32], f64) -> Result<(Vec<f32>, Vec<f32>)>,
) -> Result<Outcome> {
    let (n, w) = (weight.len(), goal.len());
    let mut outcome = Outcome {
        x: vec![0.0; n * w],
        residual: b.to_vec(),
        steps: 0,
        left: vec![0.0; w],
        shares: Vec::new(),
    };
    loop {
        let residual = |k: usize| &outcome.residual[k * n..(k + 1) * n];
        let norm: Vec<f64> = (0..w).map(|k| inner(weight, residual(k), residual(k)).sqrt()).collect();
        outcome.left = sizes((area, weight), w, &outcome.residual);
        let open = |k: usize| outcome.left[k] > goal[k];
        if outcome.steps >= limit || !(0..w).any(open) {
            return Ok(outcome);
        }
        let mut small: Vec<Small> = (0..w)
            .map(|k| Small { g: vec![norm[k]], done: !open(k), left: outcome.left[k], ..Default::default() })
            .collect();
        let mut v = outcome.residual.clone();
        v.par_chunks_mut(n).enumerate().for_each(|(k, v)| {
            let scale = if small[k].done { 0.0 } else { 1.0 / norm[k] };
            v.iter_mut().for_each(|v| *v = (f64::from(*v) * scale) as f32);
        });
        let (mut basis, mut search) = (vec![v], Vec::new());
        while basis.len() <= RESTART && outcome.steps < limit && small.iter().any(|s| !s.done) {
            let excess = small.iter().zip(goal).filter(|(s, _)| !s.done);
            let excess = excess.map(|(s, goal)| s.left / goal).fold(1.0, f64::max);
            let (z, mut next) = step(&basis[basis.len() - 1], excess)?;
            outcome.steps += 1;
            search.push(z);
            next.par_chunks_mut(n).zip(&mut small).enumerate().for_each(|(k, (next, small))| {
                if small.done {
                    next.fill(0.0);
                    return;
                }
                // Twice, as one pass of Gram-Schmidt in f32 leaves too much of the old directions.
                let mut h = vec![0.0; basis.len() + 1];
                for _ in 0..2 {
                    for (h, v) in h.iter_mut().zip(&basis) {
                        let v = &v[k * n..(k + 1) * n];
                        let along = inner(weight, next, v);
                        *h += along;
                        next.iter_mut().zip(v).for_each(|(x, &v)| *x -= (along * f64::from(v)) as f32);
                    }
                }
                let length = inner(weight, next, next).sqrt();
                let old = h.iter().map(|h| h * h).sum::<f64>().sqrt();
                h[basis.len()] = length;
                let exhausted = length <= 1e-7 * old;
                let scale = if exhausted { 0.0 } else { 1.0 / length };
                next.iter_mut().for_each(|x| *x = (f64::from(*x) * scale) as f32);
                small.push(h);
                small.left =
                    size((area, weight), small.residual(k * n..(k + 1) * n, &basis, next).into_iter());
                // What is not a number stays so.
                small.done = exhausted || small.left <= goal[k] || !small.left.is_finite();
            });
            basis.push(next);
        }
        let first = outcome.shares.len();
        outcome.shares.resize(first + search.len(), vec![0.0; w]);
        for (k, small) in small.iter().enumerate() {
            let y = small.solve();
            let plane = k * n..(k + 1) * n;
            for (j, &y) in y.iter().enumerate() {
                outcome.shares[first + j][k] = y;
                for (x, z) in outcome.x[plane.clone()].iter_mut().zip(&search[j][plane.clone()]) {
                    *x += (y * f64::from(*z)) as f32;
                }
            }
            if small.columns.is_empty() {
                continue;
            }
            let last = small.columns.len();
            let residual = small.residual(plane.clone(), &basis[..last], &basis[last][plane.clone()]);
            let residual = residual.iter().map(|&r| r as f32);
            outcome.residual[plane].iter_mut().zip(residual).for_each(|(old, r)| *old = r);
        }
        if small.iter().all(|s| s.columns.is_empty()) {
            return Ok(outcome);
        }
    }
}

//! Flexible GMRES (Saad 1993) for all wavelengths at once: each wavelength has its own small
//! problem, every application of the operator serves all of them.

use crate::error::Result;
use rayon::prelude::*;

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
    /// Norm of the residual by wavelength.
    pub norm: Vec<f64>,
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
    done: bool,
}

impl Small {
    /// Takes the next column of the Hessenberg matrix; returns the norm of the residual.
    fn push(&mut self, mut h: Vec<f64>) -> f64 {
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
        self.left()
    }

    /// Norm of the residual.
    fn left(&self) -> f64 {
        self.g.last().copied().unwrap_or_default().abs()
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

    /// Coefficients of the residual in the orthonormal basis: the rotations undone on its last entry.
    fn residual(&self) -> Vec<f64> {
        let m = self.columns.len();
        let mut r = vec![0.0; m + 1];
        r[m] = self.g[m];
        for (i, &(c, s)) in self.rotations.iter().enumerate().rev() {
            (r[i], r[i + 1]) = (c * r[i] - s * r[i + 1], s * r[i] + c * r[i + 1]);
        }
        r
    }
}

/// Σ area a b, in so many sums side by side.
pub(super) fn inner(area: &[f32], a: &[f32], b: &[f32]) -> f64 {
    const LANES: usize = 8;
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

/// Solves A x = b, `[W][N]`, in the norm that weighs points by `area` (or any weight), until the residual of
/// wavelength k is at most `goal[k]` or `limit` steps are done. `step(v, excess)` returns (z, A z) where z
/// is v or something nearer to A⁻¹ v; `excess` is the largest residual yet over its goal.
pub fn solve(
    b: &[f32],
    area: &[f32],
    goal: &[f64],
    limit: usize,
    mut step: impl FnMut(&[f32], f64) -> Result<(Vec<f32>, Vec<f32>)>,
) -> Result<Outcome> {
    let (n, w) = (area.len(), goal.len());
    let mut outcome = Outcome {
        x: vec![0.0; n * w],
        residual: b.to_vec(),
        steps: 0,
        norm: vec![0.0; w],
        shares: Vec::new(),
    };
    loop {
        let norm = |k: usize| inner(area, &outcome.residual[k * n..][..n], &outcome.residual[k * n..][..n]);
        outcome.norm = (0..w).map(|k| norm(k).sqrt()).collect();
        let open = |k: usize| outcome.norm[k] > goal[k];
        if outcome.steps >= limit || !(0..w).any(open) {
            return Ok(outcome);
        }
        let mut small: Vec<Small> = (0..w)
            .map(|k| Small { g: vec![outcome.norm[k]], done: !open(k), ..Default::default() })
            .collect();
        let mut v = outcome.residual.clone();
        v.par_chunks_mut(n).enumerate().for_each(|(k, v)| {
            let scale = if small[k].done { 0.0 } else { 1.0 / outcome.norm[k] };
            v.iter_mut().for_each(|v| *v = (f64::from(*v) * scale) as f32);
        });
        let (mut basis, mut search) = (vec![v], Vec::new());
        while basis.len() <= RESTART && outcome.steps < limit && small.iter().any(|s| !s.done) {
            let excess = small.iter().zip(goal).filter(|(s, _)| !s.done);
            let excess = excess.map(|(s, goal)| s.left() / goal).fold(1.0, f64::max);
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
                        let along = inner(area, next, v);
                        *h += along;
                        next.iter_mut().zip(v).for_each(|(x, &v)| *x -= (along * f64::from(v)) as f32);
                    }
                }
                let length = inner(area, next, next).sqrt();
                let old = h.iter().map(|h| h * h).sum::<f64>().sqrt();
                h[basis.len()] = length;
                let exhausted = length <= 1e-7 * old;
                let scale = if exhausted { 0.0 } else { 1.0 / length };
                next.iter_mut().for_each(|x| *x = (f64::from(*x) * scale) as f32);
                let residual = small.push(h);
                small.done = exhausted || residual <= goal[k];
            });
            basis.push(next);
        }
        let first = outcome.shares.len();
        outcome.shares.resize(first + search.len(), vec![0.0; w]);
        for (k, small) in small.iter().enumerate() {
            let y = small.solve();
            for (j, &y) in y.iter().enumerate() {
                outcome.shares[first + j][k] = y;
                let plane = k * n..(k + 1) * n;
                for (x, z) in outcome.x[plane.clone()].iter_mut().zip(&search[j][plane]) {
                    *x += (y * f64::from(*z)) as f32;
                }
            }
            if small.columns.is_empty() {
                continue;
            }
            let r = small.residual();
            for i in k * n..(k + 1) * n {
                outcome.residual[i] =
                    r.iter().zip(&basis).map(|(&r, v)| r * f64::from(v[i])).sum::<f64>() as f32;
            }
        }
        if small.iter().all(|s| s.columns.is_empty()) {
            return Ok(outcome);
        }
    }
}

//! Vectors, `[W][N]`, and what combination of them another is nearest to, each wavelength by itself.

use super::gmres::inner;
use crate::simd::{HotLoop, wide};

/// What adds less than this share of itself to the vectors before it adds rounding.
const LEAST: f64 = 1e-3;

/// The span of some vectors in the norm that weighs points by `weight`.
pub struct Span<'a> {
    weight: &'a [f32],
    /// The vectors made orthonormal, and how each of these is made of them, by vector and wavelength.
    orthonormal: Vec<(Vec<f32>, Vec<Vec<f64>>)>,
}

impl<'a> Span<'a> {
    /// Of no vector.
    pub fn new(weight: &'a [f32]) -> Self {
        Span { weight, orthonormal: Vec::new() }
    }

    /// Adds a vector.
    pub fn add(&mut self, mut unit: Vec<f32>) {
        let n = self.weight.len().max(1);
        let (w, j) = (unit.len() / n, self.orthonormal.len());
        let mut made = vec![vec![0.0; w]; j + 1];
        made[j] = vec![1.0; w];
        for (k, unit) in unit.chunks_mut(n).enumerate() {
            let whole = inner(self.weight, unit, unit).sqrt();
            for (other, of) in &self.orthonormal {
                let other = &other[k * n..(k + 1) * n];
                let along = inner(self.weight, unit, other);
                add(unit, -along, other);
                of.iter().zip(&mut made).for_each(|(of, made)| made[k] -= along * of[k]);
            }
            let left = inner(self.weight, unit, unit).sqrt();
            let scale = if left > LEAST * whole { 1.0 / left } else { 0.0 };
            unit.iter_mut().for_each(|x| *x = (f64::from(*x) * scale) as f32);
            made.iter_mut().for_each(|made| made[k] *= scale);
        }
        self.orthonormal.push((unit, made));
    }

    /// How much of each vector makes up most of `b`, by vector and wavelength.
    pub fn shares(&self, b: &[f32]) -> Vec<Vec<f64>> {
        let n = self.weight.len().max(1);
        let mut shares = vec![vec![0.0; b.len() / n]; self.orthonormal.len()];
        for (unit, made) in &self.orthonormal {
            for (k, (b, unit)) in b.chunks(n).zip(unit.chunks(n)).enumerate() {
                let along = inner(self.weight, b, unit);
                made.iter().zip(&mut shares).for_each(|(made, share)| share[k] += along * made[k]);
            }
        }
        shares
    }
}

/// x += factor y.
pub fn add(x: &mut [f32], factor: f64, y: &[f32]) {
    wide(Add { x, factor, y });
}

/// [`add`]
struct Add<'a> {
    x: &'a mut [f32],
    factor: f64,
    y: &'a [f32],
}

impl HotLoop for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (x, y) in self.x.iter_mut().zip(self.y) {
            *x = (f64::from(*x) + self.factor * f64::from(*y)) as f32;
        }
    }
}

/// x += factor y of two vectors of any number of wavelengths, each with its own factor.
pub fn add_each(x: &mut [f32], factors: &[f64], y: &[f32]) {
    let n = x.len() / factors.len().max(1);
    for ((x, factor), y) in x.chunks_mut(n.max(1)).zip(factors).zip(y.chunks(n.max(1))) {
        add(x, *factor, y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_those_of_the_nearest_combination() {
        let weight = [1.0f32, 2.0, 0.5, 1.0];
        let vectors = [[1.0f32, 0.0, 2.0, 0.0, 1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 0.0, 0.0, 0.0, 3.0, 1.0, 0.0]];
        let mut span = Span::new(&weight);
        vectors.iter().for_each(|v| span.add(v.to_vec()));
        // A vector that the others make up changes nothing.
        span.add(vectors[0].iter().zip(&vectors[1]).map(|(a, b)| 2.0 * a - b).collect());
        // What the third place of the second wavelength holds besides is at right angles to both.
        let mut b: Vec<f32> = vec![0.0; 8];
        add_each(&mut b, &[2.0, 0.5], &vectors[0]);
        add_each(&mut b, &[-1.0, 3.0], &vectors[1]);
        b[3] += 7.0;
        let shares = span.shares(&b);
        for (found, expected) in shares.iter().zip([[2.0, 0.5], [-1.0, 3.0], [0.0, 0.0]]) {
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-5), "{shares:?}");
        }
    }
}

//! Systems with one matrix and many right-hand sides: generalized conjugate residuals (Eisenstat, Elman and
//! Schultz 1983) that keep the directions of earlier solutions, all wavelengths at once.
//!
//! What smooth light does is learnt with the first right-hand side; the others, which differ from it by what comes
//! out of specular chains, start from there.

use super::gmres::inner;
use super::span::add;
use rayon::prelude::*;

/// What is less than this share of an image is rounding: of one that was just found, and of one that may be made of others.
const LEAST: [f64; 2] = [1e-6, 1e-3];

/// A vector x, D x, and A x = (1 - ρ/π D) x or, of a solution, b - A x: `[W][N]` each.
#[derive(Clone)]
pub struct Vectors {
    /// x
    pub x: Vec<f32>,
    /// D x
    pub diffuse: Vec<f32>,
    /// A x, or what is left of b.
    pub image: Vec<f32>,
}

/// The same at one wavelength.
struct Plane<'a> {
    x: &'a mut [f32],
    diffuse: &'a mut [f32],
    image: &'a mut [f32],
}

impl Vectors {
    /// By wavelength, for `n` points.
    fn planes(&mut self, n: usize) -> impl IndexedParallelIterator<Item = Plane<'_>> {
        (self.x.par_chunks_mut(n).zip(self.diffuse.par_chunks_mut(n)).zip(self.image.par_chunks_mut(n)))
            .map(|((x, diffuse), image)| Plane { x, diffuse, image })
    }
}

impl Plane<'_> {
    /// Adds `factor` times what `other` holds at wavelength `k`; to the image `factors[1]` times.
    fn add(&mut self, factors: [f64; 2], other: &Vectors, k: usize) {
        let plane = k * self.x.len()..(k + 1) * self.x.len();
        add(self.x, factors[0], &other.x[plane.clone()]);
        add(self.diffuse, factors[0], &other.diffuse[plane.clone()]);
        add(self.image, factors[1], &other.image[plane]);
    }

    fn scale(&mut self, factor: f64) {
        for v in [&mut *self.x, self.diffuse, self.image] {
            v.iter_mut().for_each(|v| *v = (f64::from(*v) * factor) as f32);
        }
    }

    /// Norm of the image.
    fn size(&self, weight: &[f32]) -> f64 {
        inner(weight, self.image, self.image).sqrt()
    }
}

/// Directions of which all is known; the images are orthonormal.
#[derive(Default)]
pub struct Known {
    directions: Vec<Vectors>,
}

impl Known {
    /// Adds a direction.
    pub fn add(&mut self, mut direction: Vectors, weight: &[f32]) {
        direction.planes(weight.len().max(1)).enumerate().for_each(|(k, mut plane)| {
            let size = plane.size(weight);
            plane.scale(if size > 0.0 { 1.0 / size } else { 0.0 });
            self.orthonormalise(k, &mut plane, weight, LEAST[1]);
        });
        self.directions.push(direction);
    }

    /// All x with their D x.
    pub fn into_vectors(self) -> impl Iterator<Item = (Vec<f32>, Vec<f32>)> {
        self.directions.into_iter().map(|direction| (direction.x, direction.diffuse))
    }

    /// Takes out of an image at wavelength `k`, of a size of about 1, and out of what it is the image of, what lies along
    /// those known, and makes it a unit one; nothing is left of it, and the answer is no, where less than `least` is left.
    fn orthonormalise(&self, k: usize, plane: &mut Plane, weight: &[f32], least: f64) -> bool {
        let of = k * weight.len()..(k + 1) * weight.len();
        // Twice, as once in f32 leaves too much of the old images.
        for _ in 0..2 {
            for old in &self.directions {
                let along = inner(weight, plane.image, &old.image[of.clone()]);
                plane.add([-along, -along], old, k);
            }
        }
        let length = plane.size(weight);
        let scale = if length > least { 1.0 / length } else { 0.0 };
        plane.scale(scale);
        scale > 0.0
    }

    /// Solves A x = `b`, `[W][N]`, until the residual of every wavelength is `goal` of b in the norm of `weight`, or
    /// `limit` steps are done. `apply` gives (D v, A v). Returns x with b - A x.
    pub fn solve(
        &mut self,
        b: &[f32],
        weight: &[f32],
        goal: f64,
        limit: usize,
        mut apply: impl FnMut(&[f32]) -> (Vec<f32>, Vec<f32>),
    ) -> Vectors {
        let n = weight.len().max(1);
        let mut found = Vectors { x: vec![0.0; b.len()], diffuse: vec![0.0; b.len()], image: b.to_vec() };
        // Takes out of the residual what lies along a direction; what is left.
        let take = |k: usize, plane: &mut Plane, direction: &Vectors| {
            let along = inner(weight, plane.image, &direction.image[k * n..(k + 1) * n]);
            plane.add([along, -along], direction, k);
        };
        let mut left: Vec<(f64, f64)> = (found.planes(n).enumerate())
            .map(|(k, mut plane)| {
                let whole = plane.size(weight);
                self.directions.iter().for_each(|direction| take(k, &mut plane, direction));
                (plane.size(weight), goal * whole)
            })
            .collect();
        for _ in 0..limit {
            let open = |(norm, goal): &(f64, f64)| norm > goal && norm.is_finite();
            if !left.iter().any(open) {
                break;
            }
            let mut x = vec![0.0; b.len()];
            for ((x, residual), left) in x.chunks_mut(n).zip(found.image.chunks(n)).zip(&left) {
                if open(left) {
                    add(x, 1.0 / left.0, residual);
                }
            }
            let (diffuse, image) = apply(&x);
            let mut direction = Vectors { x, diffuse, image };
            let new: Vec<bool> = (direction.planes(n).enumerate())
                .map(|(k, mut plane)| self.orthonormalise(k, &mut plane, weight, LEAST[0]))
                .collect();
            (found.planes(n).zip(&mut left).enumerate()).for_each(|(k, (mut plane, left))| {
                if open(left) {
                    take(k, &mut plane, &direction);
                    left.0 = if new[k] { plane.size(weight) } else { 0.0 };
                }
            });
            self.directions.push(direction);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_need_not_be_found_again() {
        // A diagonal system at two wavelengths.
        let n = 50;
        let apply = |x: &[f32]| -> Vec<f32> {
            x.iter().enumerate().map(|(i, x)| x * (0.2 + 0.016 * (i % n) as f32)).collect()
        };
        let weight: Vec<f32> = (0..n).map(|i| 1.0 + (i % 3) as f32).collect();
        let b: Vec<f32> = (0..2 * n).map(|i| 1.0 + (i % 7) as f32).collect();
        let mut known = Known::default();
        let mut steps = Vec::new();
        for scale in [1.0f32, 3.0] {
            let mut count = 0;
            let b: Vec<f32> = b.iter().map(|b| scale * b).collect();
            let Vectors { x, diffuse, image: residual } = known.solve(&b, &weight, 1e-4, 100, |x| {
                count += 1;
                (x.iter().map(|x| 2.0 * x).collect(), apply(x))
            });
            assert!(x.iter().zip(&diffuse).all(|(x, d)| (2.0 * x - d).abs() < 1e-5 * scale));
            for ((b, a), r) in b.iter().zip(apply(&x)).zip(&residual) {
                assert!((b - a - r).abs() < 1e-5 * scale, "{b} {a} {r}");
            }
            let norm = |v: &[f32]| inner(&weight, v, v).sqrt();
            for k in 0..2 {
                let part = k * n..(k + 1) * n;
                assert!(norm(&residual[part.clone()]) <= 1.1e-4 * norm(&b[part]));
            }
            steps.push(count);
        }
        assert!(steps[0] > 3 && steps[1] <= 1, "{steps:?}");
    }
}

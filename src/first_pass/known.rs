//! Systems with one matrix and many right-hand sides: generalized conjugate residuals (Eisenstat, Elman and
//! Schultz 1983) that keep the directions of earlier solutions, all wavelengths at once.
//!
//! What smooth light does is learnt with the first right-hand side; the others, which differ from it by what comes
//! out of specular chains, start from there.

use super::gmres::inner;
use rayon::prelude::*;

/// What is less than this share of an image is rounding: of one that was just found, and of one that may be made of others.
const LEAST: [f64; 2] = [1e-6, 1e-3];

/// Directions whose images are known; the images are orthonormal.
#[derive(Default)]
pub struct Known {
    /// By step, `[W][N]`.
    directions: Vec<Vec<f32>>,
    /// By step, `[W][N]`.
    images: Vec<Vec<f32>>,
}

/// One wavelength of a system on its way.
struct Plane<'a> {
    x: &'a mut [f32],
    residual: &'a mut [f32],
    /// Norm of the residual asked for.
    goal: f64,
    norm: f64,
}

impl Plane<'_> {
    /// Takes out of the residual what lies along `image`.
    fn take(&mut self, weight: &[f32], direction: &[f32], image: &[f32]) {
        let along = inner(weight, self.residual, image);
        add(self.x, along, direction);
        add(self.residual, -along, image);
        self.norm = inner(weight, self.residual, self.residual).sqrt();
    }
}

/// x += factor y.
fn add(x: &mut [f32], factor: f64, y: &[f32]) {
    x.iter_mut().zip(y).for_each(|(x, &y)| *x += (factor * f64::from(y)) as f32);
}

impl Known {
    /// Adds a direction of which the `image`, A times it, is known.
    pub fn add(&mut self, mut direction: Vec<f32>, mut image: Vec<f32>, weight: &[f32]) {
        let n = weight.len().max(1);
        (direction.par_chunks_mut(n).zip(image.par_chunks_mut(n)).enumerate()).for_each(
            |(k, (direction, image))| {
                let size = inner(weight, image, image).sqrt();
                let unit = if size > 0.0 { (1.0 / size) as f32 } else { 0.0 };
                for v in [&mut *direction, &mut *image] {
                    v.iter_mut().for_each(|v| *v *= unit);
                }
                self.orthonormalise(k, (direction, image), weight, LEAST[1]);
            },
        );
        self.directions.push(direction);
        self.images.push(image);
    }

    /// Takes out of an image at wavelength `k`, of a size of about 1, and out of its direction, what lies along those
    /// known, and makes it a unit one; nothing is left of it, and the answer is no, where less than `least` is left.
    fn orthonormalise(
        &self,
        k: usize,
        (direction, image): (&mut [f32], &mut [f32]),
        weight: &[f32],
        least: f64,
    ) -> bool {
        let plane = k * weight.len()..(k + 1) * weight.len();
        // Twice, as once in f32 leaves too much of the old images.
        for _ in 0..2 {
            for (old, known) in self.images.iter().zip(&self.directions) {
                let old = &old[plane.clone()];
                let along = inner(weight, image, old);
                add(image, -along, old);
                add(direction, -along, &known[plane.clone()]);
            }
        }
        let length = inner(weight, image, image).sqrt();
        let scale = if length > least { 1.0 / length } else { 0.0 };
        for v in [direction, image] {
            v.iter_mut().for_each(|v| *v = (f64::from(*v) * scale) as f32);
        }
        scale > 0.0
    }

    /// Solves A x = `b`, `[W][N]`, until the residual of every wavelength is `goal` of b in the norm of `weight`, or
    /// `limit` steps are done. `apply` is A. Returns (x, b - A x).
    pub fn solve(
        &mut self,
        b: &[f32],
        weight: &[f32],
        goal: f64,
        limit: usize,
        mut apply: impl FnMut(&[f32]) -> Vec<f32>,
    ) -> (Vec<f32>, Vec<f32>) {
        let n = weight.len().max(1);
        let (mut x, mut residual) = (vec![0.0; b.len()], b.to_vec());
        let mut planes: Vec<Plane> = (x.chunks_mut(n).zip(residual.chunks_mut(n)))
            .map(|(x, residual)| {
                let norm = inner(weight, residual, residual).sqrt();
                Plane { x, residual, goal: goal * norm, norm }
            })
            .collect();
        planes.par_iter_mut().enumerate().for_each(|(k, plane)| {
            for (direction, image) in self.directions.iter().zip(&self.images) {
                plane.take(weight, &direction[k * n..(k + 1) * n], &image[k * n..(k + 1) * n]);
            }
        });
        for _ in 0..limit {
            let open = |plane: &Plane| plane.norm > plane.goal && plane.norm.is_finite();
            if !planes.iter().any(open) {
                break;
            }
            let mut direction = vec![0.0; b.len()];
            for (direction, plane) in direction.chunks_mut(n).zip(&planes).filter(|(_, p)| open(p)) {
                add(direction, 1.0 / plane.norm, plane.residual);
            }
            let mut image = apply(&direction);
            (direction.par_chunks_mut(n).zip(image.par_chunks_mut(n)).zip(&mut planes).enumerate()).for_each(
                |(k, ((direction, image), plane))| {
                    let new = self.orthonormalise(k, (direction, image), weight, LEAST[0]);
                    if open(plane) {
                        plane.take(weight, direction, image);
                        if !new {
                            plane.norm = 0.0;
                        }
                    }
                },
            );
            self.directions.push(direction);
            self.images.push(image);
        }
        (x, residual)
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
            let (x, residual) = known.solve(&b, &weight, 1e-4, 100, |x| {
                count += 1;
                apply(x)
            });
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

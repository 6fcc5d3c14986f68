//! What earlier appearances of the same geometry are worth for the next.
//!
//! D x is known of every earlier solution x and of the directions in which it was searched, whatever was emitted and
//! reflected then. As long as lobes and Fresnel's factors stay as they are so is C x, and with both A x = x - ρ/π (D + C) x
//! for the reflectances of now: the best combination of them costs no sweep and no bounce, and only what it leaves over is
//! still to be solved. Where lamps change their power it is all. When something specular has changed, the combination that
//! was best with the old C takes one round of the new one.

use super::flow::ChainFlow;
use super::gmres::inner;
use crate::scene::SampledAppearance;

/// Vectors that are kept.
const MOST: usize = 16;

/// An image that adds less than this share to those before it adds rounding.
const LEAST: f64 = 1e-3;

/// Earlier solutions and directions over the same form factors.
#[derive(Default)]
pub struct Recalled {
    /// Of the wavelengths.
    spectrum: Vec<f64>,
    /// Of all that C depends on.
    specular: [u8; 32],
    earlier: Vec<Direction>,
    /// From which of them on C x is that of now.
    current: usize,
}

/// A vector x and what becomes of it, `[W][N]` each.
pub struct Direction {
    /// x.
    pub radiance: Vec<f32>,
    /// D x.
    pub diffuse: Vec<f32>,
    /// C x.
    pub chains: ChainFlow,
}

impl Direction {
    /// (D + C) x.
    fn irradiance(&self) -> Vec<f32> {
        let mut sum = self.diffuse.clone();
        sum.iter_mut().zip(&self.chains.irradiance).for_each(|(e, more)| *e += more);
        sum
    }
}

/// What can be said without a sweep or a bounce: the images A x of some vectors x.
pub struct Basis<'a> {
    earlier: &'a [Direction],
    /// A x of each.
    images: Vec<Vec<f32>>,
    /// The same made orthonormal, and how each of these is made of the vectors.
    orthonormal: Vec<(Vec<f32>, Vec<Vec<f64>>)>,
    weight: &'a [f32],
}

impl Recalled {
    /// What of them serves `appearance`.
    pub fn serving(mut self, appearance: &SampledAppearance) -> Recalled {
        if self.spectrum != appearance.wavelengths.nm {
            self = Recalled { spectrum: appearance.wavelengths.nm.clone(), ..Default::default() };
        }
        let specular = specular_key(appearance);
        if self.specular != specular {
            self.specular = specular;
            self.current = self.earlier.len();
        }
        self
    }

    /// Keeps one more.
    pub fn add(&mut self, direction: Direction) {
        if self.earlier.len() == MOST {
            self.earlier.remove(0);
            self.current = self.current.saturating_sub(1);
        }
        self.earlier.push(direction);
    }

    /// Every x with its D x.
    pub fn diffuse(&self) -> impl Iterator<Item = (&[f32], &[f32])> {
        self.earlier.iter().map(|earlier| (&earlier.radiance[..], &earlier.diffuse[..]))
    }

    /// After something specular has changed: what is best for `b` = A x by what chains made of it before, with what they
    /// make of it now. Whether there was anything to try.
    pub fn renew(
        &mut self,
        b: &[f32],
        weight: &[f32],
        reflected: impl Fn(&[f32]) -> Vec<f32>,
        chains: impl FnOnce(&[f32]) -> ChainFlow,
    ) -> bool {
        if self.earlier.is_empty() || self.current < self.earlier.len() {
            return false;
        }
        let basis = Basis::new(&self.earlier, weight, reflected);
        let shares = basis.shares(b);
        let (radiance, diffuse) = (basis.sum(&shares, |e| &e.radiance), basis.sum(&shares, |e| &e.diffuse));
        let chains = chains(&radiance);
        self.add(Direction { radiance, diffuse, chains });
        true
    }

    /// What is known of A = 1 - ρ/π (D + C) in the norm that weighs points by `weight`; `reflected` is ρ/π E.
    pub fn basis<'a>(&'a self, weight: &'a [f32], reflected: impl Fn(&[f32]) -> Vec<f32>) -> Basis<'a> {
        Basis::new(&self.earlier[self.current..], weight, reflected)
    }
}

impl<'a> Basis<'a> {
    fn new(earlier: &'a [Direction], weight: &'a [f32], reflected: impl Fn(&[f32]) -> Vec<f32>) -> Self {
        let n = weight.len().max(1);
        let of = |earlier: &Direction| -> Vec<f32> {
            let back = reflected(&earlier.irradiance());
            earlier.radiance.iter().zip(&back).map(|(x, b)| x - b).collect()
        };
        let images: Vec<Vec<f32>> = earlier.iter().map(of).collect();
        let mut orthonormal: Vec<(Vec<f32>, Vec<Vec<f64>>)> = Vec::new();
        for (j, image) in images.iter().enumerate() {
            let (mut image, w) = (image.clone(), image.len() / n);
            let mut made = vec![vec![0.0; w]; j + 1];
            made[j] = vec![1.0; w];
            for k in 0..w {
                let plane = k * n..(k + 1) * n;
                let image = &mut image[plane.clone()];
                let whole = inner(weight, image, image).sqrt();
                for (other, of) in &orthonormal {
                    let other = &other[plane.clone()];
                    let along = inner(weight, image, other);
                    add(image, -along, other);
                    of.iter().zip(&mut made).for_each(|(of, made)| made[k] -= along * of[k]);
                }
                let left = inner(weight, image, image).sqrt();
                let scale = if left > LEAST * whole { 1.0 / left } else { 0.0 };
                image.iter_mut().for_each(|x| *x = (f64::from(*x) * scale) as f32);
                made.iter_mut().for_each(|made| made[k] *= scale);
            }
            orthonormal.push((image, made));
        }
        Basis { earlier, images, orthonormal, weight }
    }

    /// How much of each vector makes up most of `b`, by vector and wavelength.
    fn shares(&self, b: &[f32]) -> Vec<Vec<f64>> {
        let n = self.weight.len().max(1);
        let mut shares = vec![vec![0.0; b.len() / n]; self.earlier.len()];
        for (image, made) in &self.orthonormal {
            for k in 0..b.len() / n {
                let plane = k * n..(k + 1) * n;
                let along = inner(self.weight, &b[plane.clone()], &image[plane]);
                made.iter().zip(&mut shares).for_each(|(made, share)| share[k] += along * made[k]);
            }
        }
        shares
    }

    /// Σ share x of some property x of the vectors.
    fn sum(&self, shares: &[Vec<f64>], of: impl Fn(&Direction) -> &[f32]) -> Vec<f32> {
        let n = self.weight.len().max(1);
        let mut sum = vec![0.0; self.images.first().map_or(0, Vec::len)];
        for (earlier, share) in self.earlier.iter().zip(shares) {
            for (k, &share) in share.iter().enumerate() {
                let plane = k * n..(k + 1) * n;
                add(&mut sum[plane.clone()], share, &of(earlier)[plane]);
            }
        }
        sum
    }

    /// Takes A x out of `b`, of the combination x that leaves the least of it; adds `factor` x to `radiance`, and as
    /// much of C x to `chains`.
    pub fn take(&self, b: &mut [f32], factor: f64, radiance: &mut [f32], chains: &mut ChainFlow) {
        let n = self.weight.len().max(1);
        let shares = self.shares(b);
        for ((earlier, image), share) in self.earlier.iter().zip(&self.images).zip(&shares) {
            let scaled: Vec<f64> = share.iter().map(|share| factor * share).collect();
            chains.add_scaled(&earlier.chains, &scaled);
            for k in 0..share.len() {
                let plane = k * n..(k + 1) * n;
                add(&mut radiance[plane.clone()], scaled[k], &earlier.radiance[plane.clone()]);
                add(&mut b[plane.clone()], -share[k], &image[plane]);
            }
        }
    }
}

/// x += factor y.
fn add(x: &mut [f32], factor: f64, y: &[f32]) {
    x.iter_mut().zip(y).for_each(|(x, &y)| *x = (f64::from(*x) + factor * f64::from(y)) as f32);
}

/// A hash of all that what surfaces do specularly depends on.
fn specular_key(appearance: &SampledAppearance) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    for material in &appearance.materials {
        let text = if material.is_specular() {
            format!("{:?}", (material.s, material.m, &material.reflect, &material.transmission))
        } else {
            "diffuse".into()
        };
        hasher.update(blake3::hash(text.as_bytes()).as_bytes());
    }
    for material in &appearance.surface_material {
        let specular = appearance.materials[material.0 as usize].is_specular();
        hasher.update(&(if specular { material.0 } else { u32::MAX }).to_le_bytes());
    }
    *hasher.finalize().as_bytes()
}

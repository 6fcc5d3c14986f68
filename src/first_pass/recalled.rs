//! Solutions of earlier appearances, and what they are worth for the next.
//!
//! While form factors and lobes stay as they are, (D + C) x is known of every earlier solution x, whatever was
//! emitted and reflected then: so is A x = x - ρ/π (D + C) x for the reflectances of now. The best combination of earlier
//! solutions costs no sweep and no bounce; only what it leaves over is still to be solved. Where lamps change their power it is
//! all.

use super::flow::ChainFlow;
use super::gmres::inner;
use crate::scene::SampledAppearance;

/// Earlier solutions that are kept.
const MOST: usize = 6;

/// An image that adds less than this share to those before it adds rounding.
const LEAST: f64 = 1e-4;

/// Earlier solutions of the same operators.
#[derive(Default)]
pub struct Recalled {
    key: [u8; 32],
    solutions: Vec<Earlier>,
}

/// One of them, `[W][N]` each.
struct Earlier {
    radiance: Vec<f32>,
    /// (D + C) x.
    irradiance: Vec<f32>,
    /// C x.
    chains: ChainFlow,
}

/// The best that is known already.
pub struct Start {
    /// x.
    pub radiance: Vec<f32>,
    /// C x.
    pub chains: ChainFlow,
    /// b - A x.
    pub residual: Vec<f32>,
}

impl Recalled {
    /// What of them serves `appearance`: all, as long as what surfaces do specularly is the same.
    pub fn serving(mut self, appearance: &SampledAppearance) -> Recalled {
        let key = specular_key(appearance);
        if self.key != key {
            self = Recalled { key, solutions: Vec::new() };
        }
        self
    }

    /// Keeps a solution.
    pub fn add(&mut self, radiance: Vec<f32>, irradiance: Vec<f32>, chains: ChainFlow) {
        if self.solutions.len() == MOST {
            self.solutions.remove(0);
        }
        self.solutions.push(Earlier { radiance, irradiance, chains });
    }

    /// The combination x that leaves the least of `b` = A x, in the norm that weighs points by `weight`; `reflected` is
    /// ρ/π E.
    pub fn start(&self, b: &[f32], weight: &[f32], reflected: impl Fn(&[f32]) -> Vec<f32>) -> Start {
        let (n, w) = (weight.len().max(1), b.len() / weight.len().max(1));
        let mut start =
            Start { radiance: vec![0.0; b.len()], chains: ChainFlow::default(), residual: b.to_vec() };
        // Orthonormal images, and how each is made of the solutions.
        let mut images: Vec<(Vec<f32>, Vec<Vec<f64>>)> = Vec::new();
        for (j, earlier) in self.solutions.iter().enumerate() {
            let back = reflected(&earlier.irradiance);
            let mut image: Vec<f32> = earlier.radiance.iter().zip(&back).map(|(x, b)| x - b).collect();
            let mut made = vec![vec![0.0; w]; j + 1];
            made[j] = vec![1.0; w];
            for k in 0..w {
                let plane = k * n..(k + 1) * n;
                let image = &mut image[plane.clone()];
                let whole = inner(weight, image, image).sqrt();
                for (other, of) in &images {
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
            images.push((image, made));
        }
        let mut shares = vec![vec![0.0; w]; self.solutions.len()];
        for (image, made) in &images {
            for k in 0..w {
                let plane = k * n..(k + 1) * n;
                let along = inner(weight, &b[plane.clone()], &image[plane]);
                made.iter().zip(&mut shares).for_each(|(made, share)| share[k] += along * made[k]);
            }
        }
        for (earlier, share) in self.solutions.iter().zip(&shares) {
            start.chains.add_scaled(&earlier.chains, share);
            let back = reflected(&earlier.irradiance);
            for (k, &share) in share.iter().enumerate() {
                let plane = k * n..(k + 1) * n;
                add(&mut start.radiance[plane.clone()], share, &earlier.radiance[plane.clone()]);
                add(&mut start.residual[plane.clone()], -share, &earlier.radiance[plane.clone()]);
                add(&mut start.residual[plane.clone()], share, &back[plane]);
            }
        }
        start
    }
}

/// x += factor y.
fn add(x: &mut [f32], factor: f64, y: &[f32]) {
    x.iter_mut().zip(y).for_each(|(x, &y)| *x = (f64::from(*x) + factor * f64::from(y)) as f32);
}

/// A hash of all that what surfaces do specularly depends on.
fn specular_key(appearance: &SampledAppearance) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{:?}", appearance.wavelengths.nm).as_bytes());
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

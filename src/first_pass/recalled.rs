//! What earlier appearances of the same geometry are worth for the next.
//!
//! D x is known of every earlier solution x and of the directions in which it was searched, whatever was emitted and
//! reflected then. As long as lobes and Fresnel's factors stay as they are so is C x, and with both A x = x - ρ/π (D + C) x
//! for the reflectances of now: the best combination of them costs no sweep and no bounce, and only what it leaves over is
//! still to be solved. Where lamps change their power it is all, or nearly all. When something specular has changed, the
//! combination that was best with the old C takes one round of the new one. What chains make of any other light is known
//! as far as specular points see the same of it as of some combination.

use super::flow::ChainFlow;
use super::span::{Span, add_each};
use crate::scene::SampledAppearance;

/// Vectors that are kept,
const MOST: usize = 16;
/// and of those of which C x is not known.
const MOST_ENDS: usize = 4;

/// After so many appearances all is forgotten: each makes its directions of those before, and rounds them again.
const MOST_SERVED: usize = 12;

/// Earlier solutions and directions over the same form factors.
#[derive(Default)]
pub struct Recalled {
    /// Of the wavelengths.
    spectrum: Vec<f64>,
    /// Of all that C depends on.
    specular: [u8; 32],
    /// Appearances so far.
    served: usize,
    earlier: Vec<Direction>,
    /// From which of them on C x is that of now.
    current: usize,
    /// (x, D x) of last steps, of which C x was not asked.
    ends: Vec<(Vec<f32>, Vec<f32>)>,
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
    /// (D + C) x, W m⁻² nm⁻¹.
    pub fn irradiance(&self) -> Vec<f32> {
        let mut sum = self.diffuse.clone();
        sum.iter_mut().zip(&self.chains.irradiance).for_each(|(e, more)| *e += more);
        sum
    }
}

/// What can be said without a sweep or a bounce: A x of some vectors x, and C x.
pub struct Basis<'a> {
    earlier: &'a [Direction],
    /// Found since.
    found: Vec<Direction>,
    /// A x of each,
    images: Vec<Vec<f32>>,
    /// in the norm of residuals;
    span: Span<'a>,
    /// and x as specular points see it.
    seen: Span<'a>,
}

impl Recalled {
    /// Whether there is nothing to go on from.
    pub fn is_empty(&self) -> bool {
        self.earlier.is_empty() && self.ends.is_empty()
    }

    /// What of them serves `appearance`.
    pub fn serving(mut self, appearance: &SampledAppearance) -> Recalled {
        self.served += 1;
        if self.spectrum != appearance.wavelengths.nm || self.served > MOST_SERVED {
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

    /// Keeps an x and D x.
    pub fn add_end(&mut self, x: Vec<f32>, diffuse: Vec<f32>) {
        if self.ends.len() == MOST_ENDS {
            self.ends.remove(0);
        }
        self.ends.push((x, diffuse));
    }

    /// Every x with its D x.
    pub fn diffuse(&self) -> impl Iterator<Item = (&[f32], &[f32])> {
        let ends = self.ends.iter().map(|(x, diffuse)| (&x[..], &diffuse[..]));
        self.earlier.iter().map(|earlier| (&earlier.radiance[..], &earlier.diffuse[..])).chain(ends)
    }

    /// After something specular has changed: what is best for `b` = A x by what chains made of it before, with what they
    /// make of it now. Whether there was anything to try.
    pub fn renew(
        &mut self,
        b: &[f32],
        weights: [&[f32]; 2],
        reflected: impl Fn(&[f32]) -> Vec<f32>,
        chains: impl FnOnce(&[f32]) -> ChainFlow,
    ) -> bool {
        if self.earlier.is_empty() || self.current < self.earlier.len() {
            return false;
        }
        let basis = Basis::new(&self.earlier, weights, reflected);
        let shares = basis.span.shares(b);
        let (radiance, diffuse) = (basis.sum(&shares, |e| &e.radiance), basis.sum(&shares, |e| &e.diffuse));
        let chains = chains(&radiance);
        self.add(Direction { radiance, diffuse, chains });
        true
    }

    /// What is known of A = 1 - ρ/π (D + C) and of C, in norms that weigh points by how residuals count and by how specular
    /// points see them; `reflected` is ρ/π E.
    pub fn basis<'a>(&'a self, weights: [&'a [f32]; 2], reflected: impl Fn(&[f32]) -> Vec<f32>) -> Basis<'a> {
        Basis::new(&self.earlier[self.current..], weights, reflected)
    }
}

impl<'a> Basis<'a> {
    fn new(
        earlier: &'a [Direction],
        [weight, seen]: [&'a [f32]; 2],
        reflected: impl Fn(&[f32]) -> Vec<f32>,
    ) -> Self {
        let (span, seen) = (Span::new(weight), Span::new(seen));
        let mut basis = Basis { earlier, found: Vec::new(), images: Vec::new(), span, seen };
        for earlier in earlier {
            let back = reflected(&earlier.irradiance());
            let image = earlier.radiance.iter().zip(&back).map(|(x, b)| x - b).collect();
            basis.know(&earlier.radiance, image);
        }
        basis
    }

    fn know(&mut self, x: &[f32], image: Vec<f32>) {
        self.seen.add(x.to_vec());
        self.span.add(image.clone());
        self.images.push(image);
    }

    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        self.images.is_empty()
    }

    /// Adds a direction and its image.
    pub fn add(&mut self, direction: Direction, image: Vec<f32>) {
        self.know(&direction.radiance, image);
        self.found.push(direction);
    }

    /// Adds a direction to those that are found, but not its image.
    pub fn keep(&mut self, direction: Direction) {
        self.found.push(direction);
    }

    /// The directions that were added.
    pub fn found(self) -> Vec<Direction> {
        self.found
    }

    /// All directions.
    fn directions(&self) -> impl Iterator<Item = &Direction> {
        self.earlier.iter().chain(&self.found)
    }

    /// Σ share x of some property x of the directions.
    fn sum(&self, shares: &[Vec<f64>], of: impl Fn(&Direction) -> &[f32]) -> Vec<f32> {
        let mut sum = vec![0.0; self.images.first().map_or(0, Vec::len)];
        for (direction, share) in self.directions().zip(shares) {
            add_each(&mut sum, share, of(direction));
        }
        sum
    }

    /// Takes A x out of `b`, of the combination x that leaves the least of it; adds `factor` x to `radiance`, and as
    /// much of C x to `chains`.
    pub fn take(&self, b: &mut [f32], factor: f64, radiance: &mut [f32], chains: &mut ChainFlow) {
        for ((direction, image), share) in self.directions().zip(&self.images).zip(self.span.shares(b)) {
            let scaled: Vec<f64> = share.iter().map(|share| factor * share).collect();
            let taken: Vec<f64> = share.iter().map(|share| -share).collect();
            chains.add_scaled(&direction.chains, &scaled);
            add_each(radiance, &scaled, &direction.radiance);
            add_each(b, &taken, image);
        }
    }

    /// What specular chains make of `x` as far as that is known: the combination of directions that specular points see as
    /// nearly the same.
    pub fn follow(&self, x: &[f32]) -> Followed {
        Followed { shares: self.seen.shares(x) }
    }
}

/// A combination of the directions of a [`Basis`].
pub struct Followed {
    shares: Vec<Vec<f64>>,
}

impl Followed {
    /// Adds C of it to an irradiance.
    pub fn irradiance(&self, basis: &Basis, sum: &mut [f32]) {
        for (direction, share) in basis.directions().zip(&self.shares) {
            add_each(sum, share, &direction.chains.irradiance);
        }
    }

    /// Adds C of it.
    pub fn chains(&self, basis: &Basis, sum: &mut ChainFlow) {
        for (direction, share) in basis.directions().zip(&self.shares) {
            sum.add_scaled(&direction.chains, share);
        }
    }

    /// What it leaves of `x`.
    pub fn left(&self, basis: &Basis, x: &[f32]) -> Vec<f32> {
        let mut left = x.to_vec();
        for (direction, share) in basis.directions().zip(&self.shares) {
            let taken: Vec<f64> = share.iter().map(|share| -share).collect();
            add_each(&mut left, &taken, &direction.radiance);
        }
        left
    }
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

//! Sampling to a noise target: how noisy pixels are, and which need more samples.
//!
//! A pixel follows [`REPLICATES`] sequences of independent randomness; what their means differ by tells the noise of
//! the mean of all, which the scatter of the points of one low-discrepancy sequence would not.
//!
//! Who stops when his own samples look quiet stops too early where something bright and rare was missed: the mean
//! would be too low, and the noise told as well. Pixels are therefore coloured like a chessboard, and the samples of a
//! pixel are decided by those around it of the other colour: no sample has a say in how much it counts, and mean and
//! noise are without bias.
//!
//! Samples go where they are worth most. The noise of the image is the root of the mean of r / n, r the variance of
//! one sample of a pixel and n the samples; for a given sum of all n it is least where n grows with the root of r
//! (Neyman 1934, for strata).

use serde::Serialize;

/// Independent sequences of a pixel.
pub(super) const REPLICATES: usize = 2;

/// Samples that every pixel takes at least: the first decision needs them.
const LEAST: u32 = 32;

/// Pixels along the edge of a block: noise is told and decided by block.
const BLOCK: usize = 4;

/// Noise in the dark is told relative to this share of the mean luminance of the image.
const FLOOR: f64 = 0.1;

/// Share of the noise asked for that is aimed at: what decides is itself an estimate.
const AIM: f64 = 0.95;

/// How noisy an image may be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NoiseTarget {
    /// Root mean square over the pixels of the standard error of luminance, each over the mean luminance of the block
    /// of 4 x 4 pixels that it lies in or, in the dark, over a tenth of the mean luminance of the image.
    pub noise: f64,
    /// Most samples a pixel, whatever the noise is then.
    pub most_samples: u32,
}

/// How pixels were sampled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PixelNoise {
    /// Samples that each pixel took, `[height][width]`.
    pub samples: Vec<f32>,
    /// Standard error of luminance, cd m⁻²: root mean square over the block of 4 x 4 pixels, some 20 % uncertain itself.
    pub noise: Vec<f32>,
}

/// What came of a noise target.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NoiseStats {
    /// What was asked for.
    pub asked: f64,
    /// What was reached, as [`NoiseTarget::noise`] has it.
    pub noise: f64,
    /// Samples a pixel, mean over the pixels.
    pub mean_samples: f64,
    /// Of the pixel that took most.
    pub most_samples: u32,
}

/// What the replicates of all pixels have found so far.
pub(super) struct Tally {
    width: usize,
    /// Wavelengths.
    w: usize,
    target: NoiseTarget,
    /// Sum of radiance over all samples, `[pixels][W]`.
    radiance: Vec<f64>,
    /// Sum of luminance over the points of each replicate, cd m⁻², by pixel.
    luminance: Vec<[f64; REPLICATES]>,
    /// Points of each replicate, by pixel.
    points: Vec<u32>,
}

/// Pixels of a block, those of one colour or all.
#[derive(Clone, Copy, Default)]
struct Group {
    pixels: f64,
    /// Sums over them: luminance, its variance, and that of a single sample.
    luminance: f64,
    square: f64,
    single: f64,
}

impl Tally {
    /// Nothing found yet, of an image of `[width, height]` pixels and `w` wavelengths.
    pub fn new([width, height]: [usize; 2], w: usize, target: NoiseTarget) -> Self {
        let pixels = width * height;
        Tally {
            width,
            w,
            target,
            radiance: vec![0.0; pixels * w],
            luminance: vec![[0.0; REPLICATES]; pixels],
            points: vec![0; pixels],
        }
    }

    /// Points that each replicate of each pixel is to have first.
    pub fn first(&self, samples: u32) -> Vec<u32> {
        let least = samples.max(LEAST).div_ceil(REPLICATES as u32).next_power_of_two();
        vec![least.min(self.most()); self.points.len()]
    }

    /// Points of each replicate of a pixel so far.
    pub fn points(&self, pixel: usize) -> u32 {
        self.points[pixel]
    }

    fn most(&self) -> u32 {
        self.target.most_samples.div_ceil(REPLICATES as u32)
    }

    /// Adds what new points have found, sums `[pixels][W + REPLICATES]` of radiance and of the luminance of each replicate.
    /// They now have so many `points`.
    pub fn add(&mut self, sums: &[f32], points: Vec<u32>) {
        for (pixel, sums) in sums.chunks_exact(self.w + REPLICATES).enumerate() {
            let (radiance, luminance) = sums.split_at(self.w);
            let of = &mut self.radiance[pixel * self.w..][..self.w];
            of.iter_mut().zip(radiance).for_each(|(sum, l)| *sum += f64::from(*l));
            self.luminance[pixel].iter_mut().zip(luminance).for_each(|(sum, l)| *sum += f64::from(*l));
        }
        self.points = points;
    }

    /// Mean luminance of a pixel, and the square of its standard error.
    fn of(&self, pixel: usize) -> (f64, f64) {
        let n = f64::from(self.points[pixel].max(1));
        let means = self.luminance[pixel].map(|sum| sum / n);
        let count = REPLICATES as f64;
        let mean = means.iter().sum::<f64>() / count;
        let squares: f64 = means.iter().map(|y| (y - mean) * (y - mean)).sum();
        (mean, squares / (count * (count - 1.0)))
    }

    fn colour(&self, pixel: usize) -> usize {
        (pixel % self.width + pixel / self.width) % 2
    }

    /// Blocks in a row, and in a column.
    fn blocks(&self) -> [usize; 2] {
        [self.width, self.points.len() / self.width].map(|side| side.div_ceil(BLOCK))
    }

    fn block(&self, pixel: usize) -> usize {
        pixel / self.width / BLOCK * self.blocks()[0] + pixel % self.width / BLOCK
    }

    /// What the pixels of each colour of each block have found, and the luminance that noise in the dark is relative to.
    fn groups(&self) -> (Vec<[Group; 2]>, f64) {
        let [across, down] = self.blocks();
        let mut groups = vec![[Group::default(); 2]; across * down];
        let mut sum = 0.0;
        for pixel in 0..self.points.len() {
            let (luminance, square) = self.of(pixel);
            let group = &mut groups[self.block(pixel)][self.colour(pixel)];
            group.pixels += 1.0;
            group.luminance += luminance;
            group.square += square;
            group.single += square * f64::from(self.points[pixel]) * REPLICATES as f64;
            sum += luminance;
        }
        (groups, FLOOR * sum / self.points.len() as f64)
    }

    /// Points that each replicate of each pixel is to have next, twice as many where it is worth it; `None` when it is
    /// enough, or the samples have run out.
    pub fn next(&self) -> Option<Vec<u32>> {
        let (groups, floor) = self.groups();
        let [across, down] = self.blocks();
        let relative = |block: usize, colour: usize| {
            let of = &groups[block][colour];
            (of.pixels, of.single / of.pixels.max(1.0) / against(of.luminance / of.pixels.max(1.0), floor))
        };
        // Of the block and those around it, lest what is rare is missed.
        let around = |block: usize, colour: usize| {
            let (x, y) = (block % across, block / across);
            let (mut pixels, mut sum) = (0.0, 0.0);
            for y in y.saturating_sub(1)..(y + 2).min(down) {
                for x in x.saturating_sub(1)..(x + 2).min(across) {
                    let (n, variance) = relative(y * across + x, colour);
                    (pixels, sum) = (pixels + n, sum + n * variance);
                }
            }
            (pixels > 0.0).then(|| sum / pixels)
        };
        // A single pixel has none of the other colour around it.
        let variances: Vec<[f64; 2]> = (0..groups.len())
            .map(|block| [1, 0].map(|other| around(block, other).or(around(block, 1 - other)).unwrap_or(0.0)))
            .collect();
        let variance = |pixel: usize| variances[self.block(pixel)][self.colour(pixel)];
        let most = self.most();
        let points = |pixel: usize, factor: f64| {
            let wanted = (factor * variance(pixel).sqrt()).min(f64::from(most)) as u32;
            wanted.next_power_of_two().clamp(self.points[pixel], most.max(self.points[pixel]))
        };
        // What a plan will come to is told by what has no part in it: the samples of the pixels themselves.
        let own = |pixel: usize| {
            let [a, b] = &groups[self.block(pixel)];
            let of = [a, b][self.colour(pixel)];
            of.single / of.pixels / against((a.luminance + b.luminance) / (a.pixels + b.pixels), floor)
        };
        let goal = (AIM * self.target.noise).powi(2) * self.points.len() as f64 * REPLICATES as f64;
        let enough = |factor: f64| {
            let of = |pixel| own(pixel) / f64::from(points(pixel, factor));
            (0..self.points.len()).map(of).sum::<f64>() <= goal
        };
        // The least factor that is enough, by halves of its logarithm.
        let (mut low, mut high) = (-64.0f64, 64.0f64);
        while high - low > 1e-3 {
            let middle = 0.5 * (low + high);
            *(if enough(middle.exp2()) { &mut high } else { &mut low }) = middle;
        }
        let next = |pixel: usize| points(pixel, high.exp2()).min(2 * self.points[pixel]);
        let next: Vec<u32> = (0..self.points.len()).map(next).collect();
        (next != self.points).then_some(next)
    }

    /// Mean radiance `[pixels][W]`, and how the image was sampled.
    pub fn finish(&self) -> (Vec<f32>, PixelNoise, NoiseStats) {
        let (groups, floor) = self.groups();
        let whole: Vec<Group> = groups
            .iter()
            .map(|[a, b]| Group {
                pixels: a.pixels + b.pixels,
                luminance: a.luminance + b.luminance,
                square: a.square + b.square,
                single: a.single + b.single,
            })
            .collect();
        let pixels = self.points.len() as f64;
        let relative = |of: &Group| of.square / against(of.luminance / of.pixels.max(1.0), floor);
        let samples: Vec<u32> = self.points.iter().map(|n| n * REPLICATES as u32).collect();
        let stats = NoiseStats {
            asked: self.target.noise,
            noise: (whole.iter().map(relative).sum::<f64>() / pixels).sqrt(),
            mean_samples: samples.iter().map(|&n| f64::from(n)).sum::<f64>() / pixels,
            most_samples: samples.iter().copied().max().unwrap_or(0),
        };
        let noise = |pixel: usize| {
            let of = &whole[self.block(pixel)];
            (of.square / of.pixels.max(1.0)).sqrt() as f32
        };
        let noise = (0..self.points.len()).map(noise).collect();
        let mean = |(k, sum): (usize, &f64)| (sum / f64::from(samples[k / self.w].max(1))) as f32;
        let radiance = self.radiance.iter().enumerate().map(mean).collect();
        (radiance, PixelNoise { samples: samples.iter().map(|&n| n as f32).collect(), noise }, stats)
    }
}

/// Square of the luminance that noise is relative to: `luminance`, in the dark `floor`. Where all is black so is the noise.
fn against(luminance: f64, floor: f64) -> f64 {
    let of = luminance.max(floor);
    if of > 0.0 { of * of } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of 16 x 8 pixels of luminance 2, whose replicates differ by `off(x, y)` times that, 16 points each.
    fn tally(noise: f64, off: impl Fn(usize, usize) -> f64) -> Tally {
        let mut tally = Tally::new([16, 8], 1, NoiseTarget { noise, most_samples: 256 });
        let points = tally.first(1);
        let sums: Vec<f32> = (0..128)
            .flat_map(|p| {
                let d = off(p % 16, p / 16);
                [64.0, 32.0 * (1.0 + d), 32.0 * (1.0 - d)].map(|sum| sum as f32)
            })
            .collect();
        tally.add(&sums, points);
        tally
    }

    #[test]
    fn noise_is_what_replicates_differ_by() {
        let even = tally(0.2, |_, _| 0.1);
        let (radiance, noise, stats) = even.finish();
        assert_eq!(radiance, [2.0; 128]);
        assert_eq!(noise.samples, [32.0; 128]);
        // Means 2.2 and 1.8: variance 2 x 0.2^2 of one, half of that of the mean of both.
        assert!((stats.noise - 0.1).abs() < 1e-6 && (noise.noise[5] - 0.2).abs() < 1e-6, "{stats:?}");
        assert_eq!(even.next(), None);
        assert_eq!(tally(0.0704, |_, _| 0.1).next(), Some(vec![32; 128]));
        assert_eq!(tally(0.5, |_, _| 0.0).next(), None);
    }

    #[test]
    fn samples_of_a_pixel_are_decided_by_the_other_colour_around_it() {
        // One noisy pixel, of colour 0: those of colour 1 in its block and the ones around take more, and no other.
        let next = tally(0.01, |x, y| if (x, y) == (1, 1) { 0.3 } else { 0.0 }).next().expect("noisy");
        for (p, &points) in next.iter().enumerate() {
            let (x, y) = (p % 16, p / 16);
            assert_eq!(points, if x < 8 && (x + y) % 2 == 1 { 32 } else { 16 }, "{x} {y}");
        }
    }

    #[test]
    fn more_samples_go_where_they_are_worth_most() {
        // Noise of 0.3 on the left, 0.03 on the right: to have a tenth, the left and the blocks beside it take more.
        let next = tally(0.1, |x, _| if x < 8 { 0.3 } else { 0.03 }).next().expect("noisy");
        assert!((0..128).all(|p| next[p] == if p % 16 < 12 { 32 } else { 16 }));
    }
}

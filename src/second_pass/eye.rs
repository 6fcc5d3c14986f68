//! Rays from the eye through the pixels of a tile, many at a time.

use crate::geometry::Ray;
use crate::scene::View;
use crate::simd::HotLoop;
use sobol_burley::parts::{hash, owen_scramble_rev, u32_to_f32_norm};

/// Rays that are made together.
const LANES: usize = 8;

/// What scrambles the Sobol' points of a pixel: their order, and the first two dimensions.
type Scramble = [u32; 3];

/// [`sobol_burley`] derives the three from a seed so.
#[inline(always)]
fn scramble(seed: u32) -> Scramble {
    let dimensions = seed.wrapping_mul(0x9c8f_2d3b);
    [hash(seed ^ 0x79c6_8e4a), hash(dimensions ^ 0x912f_69ba), hash(dimensions ^ 0x174f_18ab)]
}

/// The first two numbers of [`sobol_burley::sample_4d`] for point `index` of dimension set 0, without its tables: the first
/// dimension of Sobol's sequence mirrors the bits of the index, and to the second it is a polynomial over
/// {0, 1}, whose argument x becomes 1 + x.
#[inline(always)]
fn sample(index: u32, [order, across, down]: Scramble) -> [f32; 2] {
    let first = owen_scramble_rev(index.reverse_bits(), order).reverse_bits() & 0xffff;
    let mut second = first;
    second ^= (second & 0xff00) >> 8;
    second ^= (second & 0xf0f0) >> 4;
    second ^= (second & 0xcccc) >> 2;
    second ^= (second & 0xaaaa) >> 1;
    let number = |bits: u32, scramble: u32| u32_to_f32_norm(owen_scramble_rev(bits, scramble).reverse_bits());
    [number(first, across), number(second, down)]
}

/// Makes the rays through points `first` and on, `count` of them in each pixel, all of one pixel after the other.
pub(super) struct Look<'a> {
    pub view: &'a View,
    /// A surface nearer to the eye is the one it stands on, and not seen, m.
    pub near: f64,
    /// The pixel at the top left of the tile.
    pub low: [usize; 2],
    /// Pixels in a row of the tile.
    pub columns: usize,
    /// Sobol' seed of each pixel.
    pub seeds: &'a [u32],
    pub first: u32,
    pub count: u32,
    /// Where they are added.
    pub rays: &'a mut Vec<Ray>,
}

impl HotLoop for Look<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let scrambles: Vec<Scramble> = self.seeds.iter().map(|&seed| scramble(seed)).collect();
        let corner = self.low.map(|x| x as f64);
        let total = scrambles.len() * self.count as usize;
        let (mut pixel, mut point) = (0, 0);
        let mut place = [0.0, 0.0];
        for _ in 0..total.div_ceil(LANES) {
            let (mut index, mut of) = ([0; LANES], [[0; LANES]; 3]);
            let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
            let mut used = 0;
            while used < LANES && pixel < scrambles.len() {
                index[used] = self.first + point;
                for (of, scramble) in of.iter_mut().zip(scrambles[pixel]) {
                    of[used] = scramble;
                }
                (x[used], y[used]) = (corner[0] + place[0], corner[1] + place[1]);
                used += 1;
                point += 1;
                if point == self.count {
                    (pixel, point) = (pixel + 1, 0);
                    place[0] += 1.0;
                    if place[0] == self.columns as f64 {
                        place = [0.0, place[1] + 1.0];
                    }
                }
            }
            for lane in 0..LANES {
                let [dx, dy] = sample(index[lane], of.map(|of| of[lane]));
                x[lane] += f64::from(dx);
                y[lane] += f64::from(dy);
            }
            let mut directions = [[0.0; LANES]; 3];
            let mut origin = glam::DVec3::ZERO;
            for lane in 0..LANES {
                let ray = self.view.ray(x[lane], y[lane]);
                directions[0][lane] = ray.direction.x;
                directions[1][lane] = ray.direction.y;
                directions[2][lane] = ray.direction.z;
                origin = ray.origin;
            }
            let [x, y, z] = directions;
            self.rays.extend((0..used).map(|lane| Ray {
                origin,
                direction: glam::DVec3::new(x[lane], y[lane], z[lane]),
                t_min: self.near,
                t_max: f64::INFINITY,
            }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_those_of_the_general_sampler() {
        let indices = (0..2000u32).chain((0..2000).map(|k| 65_535 - 17 * k));
        for index in indices {
            let seed = hash(index / 3);
            let [x, y, ..] = sobol_burley::sample_4d(index, 0, seed);
            assert_eq!(sample(index, scramble(seed)), [x, y], "point {index}, seed {seed:#x}");
        }
    }
}

//! Rays from the eye through pixels, many at a time.

use super::sequence::{number, order, scramble};
use crate::geometry::Ray;
use crate::scene::View;
use crate::simd::HotLoop;
use glam::DVec3;
use sobol_burley::parts::owen_scramble_rev;

/// Rays that are made together: so many that the compiler keeps the loops over them, and makes them wide.
const BLOCK: usize = 64;

/// What scrambles the Sobol' points of a pixel: their order, and the first two dimensions.
type Scramble = [u32; 3];

/// That of a seed.
#[inline(always)]
fn first_two(seed: u32) -> Scramble {
    let [across, down, ..] = scramble(seed, 0);
    [order(seed), across, down]
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
    [number(first, across), number(second, down)]
}

/// Makes the rays through points `first` and on, `count` of them in each pixel, all of one pixel after the other.
pub(super) struct Look<'a> {
    pub view: &'a View,
    /// A surface nearer to the eye is the one it stands on, and not seen, m.
    pub near: f64,
    /// Column and row of each pixel in the image.
    pub places: &'a [[u32; 2]],
    /// Sobol' seed of each pixel, and of those that follow.
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
        let total = self.places.len() * self.count as usize;
        let mut pixels = self.seeds.iter().zip(self.places);
        let mut point = self.count;
        let (mut of, mut corner) = ([0; 3], [0.0; 2]);
        for done in (0..total).step_by(BLOCK) {
            let used = BLOCK.min(total - done);
            let mut block = Block::default();
            for k in 0..used {
                if point == self.count {
                    let Some((&seed, place)) = pixels.next() else { break };
                    (point, of, corner) = (0, first_two(seed), place.map(f64::from));
                }
                block.index[k] = self.first + point;
                [block.order[k], block.across[k], block.down[k]] = of;
                [block.x[k], block.y[k]] = corner;
                point += 1;
            }
            let [x, y, z] = block.directions(self.view);
            let origin = self.view.ray(0.0, 0.0).origin;
            self.rays.extend((0..used).map(|k| Ray {
                origin,
                direction: DVec3::new(x[k], y[k], z[k]),
                t_min: self.near,
                t_max: f64::INFINITY,
            }));
        }
    }
}

/// What a block of rays is made of.
struct Block {
    index: [u32; BLOCK],
    order: [u32; BLOCK],
    across: [u32; BLOCK],
    down: [u32; BLOCK],
    /// Image position: of the pixel's corner, then of the ray.
    x: [f64; BLOCK],
    y: [f64; BLOCK],
}

impl Default for Block {
    fn default() -> Self {
        let (none, nowhere) = ([0; BLOCK], [0.0; BLOCK]);
        Block { index: none, order: none, across: none, down: none, x: nowhere, y: nowhere }
    }
}

impl Block {
    #[inline(always)]
    fn directions(&mut self, view: &View) -> [[f64; BLOCK]; 3] {
        let Block { index, order, across, down, x, y } = self;
        let mut shift = [[0.0f32; BLOCK]; 2];
        for k in 0..BLOCK {
            [shift[0][k], shift[1][k]] = sample(index[k], [order[k], across[k], down[k]]);
        }
        for k in 0..BLOCK {
            x[k] += f64::from(shift[0][k]);
            y[k] += f64::from(shift[1][k]);
        }
        let mut directions = [[0.0; BLOCK]; 3];
        for k in 0..BLOCK {
            [directions[0][k], directions[1][k], directions[2][k]] =
                view.ray(x[k], y[k]).direction.to_array();
        }
        directions
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::second_pass::sequence::mix;

    #[test]
    fn points_are_those_of_the_general_sampler() {
        let indices = (0..2000u32).chain((0..2000).map(|k| 65_535 - 17 * k));
        for index in indices {
            let seed = mix(index / 3);
            let [x, y, ..] = sobol_burley::sample_4d(index, 0, seed);
            assert_eq!(sample(index, first_two(seed)), [x, y], "point {index}, seed {seed:#x}");
        }
    }
}

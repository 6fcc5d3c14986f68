//! The numbers that paths draw: points of Sobol's sequence, scrambled after Owen by a seed.

use crate::simd::{HotLoop, widest};
use sobol_burley::parts::{hash, owen_scramble_rev, sobol_rev, u32_to_f32_norm};
use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};
use std::array::from_fn;
use std::sync::LazyLock;

/// As many points has a sequence, a power of two.
const LENGTH: u32 = 1 << 16;

/// Four uniform numbers in [0, 1): those of `set` of the dimensions of point `index`. Where the sequence ends another
/// one goes on, and after the last set comes the first.
pub(super) fn draw(index: u32, set: u32, seed: u32) -> [f32; 4] {
    let turn = index / LENGTH;
    let seed = if turn == 0 { seed } else { mix(seed ^ mix(turn)) };
    sample_4d(index % LENGTH, set % NUM_DIMENSION_SETS_4D, seed)
}

/// Points whose numbers are found together.
pub(super) const TOGETHER: usize = 8;

/// So few points are as fast one by one.
const FEW: usize = 2;

/// [`draw`] for as many points as there is room for in `numbers`, [`TOGETHER`] at most, from `first` on.
pub(super) fn draw_several(first: u32, set: u32, seed: u32, numbers: &mut [[f32; 4]]) {
    let count = numbers.len().min(TOGETHER);
    if count <= FEW || first >= LENGTH - TOGETHER as u32 {
        let points = (first..).zip(numbers);
        return points.for_each(|(index, numbers)| *numbers = draw(index, set, seed));
    }
    let found = widest(Several { first, set: set % NUM_DIMENSION_SETS_4D, seed });
    numbers.iter_mut().zip(found).for_each(|(numbers, found)| *numbers = found);
}

/// What the 16 bits of a point's index add to its numbers: by set, by four bits of the reversed index, the highest
/// first, by what they are, and by dimension; bits reversed.
static DIRECTIONS: LazyLock<Vec<[[[u32; 4]; 16]; 4]>> = LazyLock::new(|| {
    let of = |set: u32, four: usize, is: usize| {
        from_fn(|dimension| sobol_rev((is as u32) << (28 - 4 * four), 4 * set + dimension as u32))
    };
    (0..NUM_DIMENSION_SETS_4D).map(|set| from_fn(|four| from_fn(|is| of(set, four, is)))).collect()
});

/// Points that follow on each other.
struct Several {
    first: u32,
    set: u32,
    seed: u32,
}

impl HotLoop for Several {
    type Output = [[f32; 4]; TOGETHER];

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Several { first, set, seed } = self;
        let (order, scramble) = (order(seed), scramble(seed, set));
        let directions = &DIRECTIONS[set as usize];
        from_fn(|k| {
            let index = owen_scramble_rev((first + k as u32).reverse_bits(), order);
            let of = |four: usize| &directions[four][(index >> (28 - 4 * four)) as usize & 15];
            let [a, b, c, d] = [of(0), of(1), of(2), of(3)];
            from_fn(|n| number(a[n] ^ b[n] ^ c[n] ^ d[n], scramble[n]))
        })
    }
}

/// What scrambles the order of a sequence's points, as [`sobol_burley`] has it.
#[inline(always)]
pub(super) fn order(seed: u32) -> u32 {
    hash(seed ^ 0x79c6_8e4a)
}

/// What scrambles the four dimensions of a set.
#[inline(always)]
pub(super) fn scramble(seed: u32, set: u32) -> [u32; 4] {
    let dimensions = seed.wrapping_mul(0x9c8f_2d3b) ^ set;
    [0x912f_69ba, 0x174f_18ab, 0x691e_72ca, 0xb40c_c1b8].map(|dimension| hash(dimensions ^ dimension))
}

/// In [0, 1), from reversed bits that are still to be scrambled.
#[inline(always)]
pub(super) fn number(bits: u32, scramble: u32) -> f32 {
    u32_to_f32_norm(owen_scramble_rev(bits, scramble).reverse_bits())
}

/// Scatters the bits of a number (the finaliser of MurmurHash3).
pub(crate) fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x85eb_ca6b);
    x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
    x ^ x >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_points_are_those_of_the_general_sampler() {
        for seed in [0, 7, 0x9e37_79b9] {
            for (first, set) in
                [(0, 0), (3, 1), (800, 2), (40_000, 63), (65_520, 5), (65_533, 1), (90_000, 64)]
            {
                for count in [1, 3, TOGETHER] {
                    let mut numbers = vec![[0.0; 4]; count];
                    draw_several(first, set, seed, &mut numbers);
                    let each: Vec<_> = (first..).take(count).map(|index| draw(index, set, seed)).collect();
                    assert_eq!(numbers, each, "{count} from {first} of set {set}, seed {seed}");
                }
            }
        }
    }

    #[test]
    fn a_sequence_goes_on_beyond_its_end_with_other_points() {
        let seed = 7;
        assert_eq!(draw(5, 1, seed), sample_4d(5, 1, seed));
        assert_ne!(draw(LENGTH + 5, 1, seed), draw(5, 1, seed));
        // Every block of 16 points still has one in each sixteenth.
        let mut met = [false; 16];
        (0..16).for_each(|k| met[(16.0 * draw(LENGTH + k, 0, seed)[0]) as usize] = true);
        assert_eq!(met, [true; 16]);
    }
}

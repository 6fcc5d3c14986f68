//! The numbers that paths draw: points of Sobol's sequence, scrambled after Owen by a seed.

use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};

/// As many points has a sequence, a power of two.
const LENGTH: u32 = 1 << 16;

/// Four uniform numbers in [0, 1): those of `set` of the dimensions of point `index`. Where the sequence ends another
/// one goes on, and after the last set comes the first.
pub(super) fn draw(index: u32, set: u32, seed: u32) -> [f32; 4] {
    let turn = index / LENGTH;
    let seed = if turn == 0 { seed } else { mix(seed ^ mix(turn)) };
    sample_4d(index % LENGTH, set % NUM_DIMENSION_SETS_4D, seed)
}

/// Scatters the bits of a number (the finaliser of MurmurHash3).
pub(super) fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x85eb_ca6b);
    x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
    x ^ x >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

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

//! Transposing a bit matrix in blocks of 32 x 32.

/// Transposes a block in place: bit `c` of word `r` becomes bit `r` of word `c`. Squares of 16, 8,
/// 4, 2 and 1 bits change places across the diagonal in turn.
fn transpose_block(block: &mut [u32; 32]) {
    let mut size = 16;
    let mut mask = 0x0000_ffff_u32;
    while size > 0 {
        for r in 0..32 {
            if r & size == 0 {
                // The upper right square of the pair swaps with the lower left.
                let swap = (block[r] >> size ^ block[r + size]) & mask;
                block[r] ^= swap << size;
                block[r + size] ^= swap;
            }
        }
        size /= 2;
        mask ^= mask << size;
    }
}

/// Writes to `out` the transpose of a matrix of `rows` x `columns` bits whose rows take
/// `columns / 32` words, rounded up. Bits beyond the matrix are 0.
pub(super) fn transpose(words: &[u32], rows: usize, columns: usize, out: &mut Vec<u32>) {
    let (stride, out_stride) = (columns.div_ceil(32), rows.div_ceil(32));
    out.clear();
    out.resize(columns * out_stride, 0);
    let mut block = [0u32; 32];
    for first_row in (0..rows).step_by(32) {
        let height = (rows - first_row).min(32);
        for w in 0..stride {
            for (r, word) in block.iter_mut().enumerate() {
                *word = if r < height { words[(first_row + r) * stride + w] } else { 0 };
            }
            transpose_block(&mut block);
            let width = (columns - 32 * w).min(32);
            for (c, word) in block[..width].iter().enumerate() {
                out[(32 * w + c) * out_stride + first_row / 32] = *word;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_finds_its_place() {
        let mut random = 1u32;
        for (rows, columns) in [(1usize, 1usize), (32, 32), (31, 33), (64, 5), (3, 100), (97, 130)] {
            let stride = columns.div_ceil(32);
            let mut words = vec![0u32; rows * stride];
            for r in 0..rows {
                for c in 0..columns {
                    random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    words[r * stride + c / 32] |= (random >> 31) << (c % 32);
                }
            }
            let mut out = vec![7];
            transpose(&words, rows, columns, &mut out);
            assert_eq!(out.len(), columns * rows.div_ceil(32));
            for r in 0..rows {
                for c in 0..columns {
                    let here = words[r * stride + c / 32] >> (c % 32) & 1;
                    let there = out[c * rows.div_ceil(32) + r / 32] >> (r % 32) & 1;
                    assert_eq!(here, there, "row {r} column {c} of {rows} x {columns}");
                }
            }
            let ones = |w: &[u32]| w.iter().map(|w| w.count_ones()).sum::<u32>();
            assert_eq!(ones(&words), ones(&out), "no bit outside the matrix");
        }
    }
}

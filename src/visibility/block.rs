//! Deciding many pairs of points at once: a block is up to 128 x 128 pairs and a bit for each.
//!
//! With d and e_k as in [`super::blocker`] and r_k(p) = e_k(p) / |d(p)|, a segment a-b whose ends the plane separates
//! crosses the inside of edge k exactly where r_k(a) + r_k(b) > 0: a sum decides. All of r_k comes from `f64`, once a
//! point; the sums are `f32`, 8 or 16 pairs an instruction, and [`Bands::rounding`](super::blocker::Bands) is what that
//! may cost. The least and the greatest r_k of 32 points say the same of all their pairs at once.

use super::against::{Against, LANES, Places};
pub(super) use super::against::{Bits, SIDE, WORDS};
use super::blocker::Blocker;
use super::known::Known;
use crate::simd::{HotLoop, widest};
use glam::Vec3;
use std::ops::Range;

/// Pairs that one blocker was the first to hide.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Hidden {
    /// By the bounds of many.
    pub proved: u64,
    /// One by one.
    pub tested: u64,
}

/// The pairs of up to [`SIDE`] points with up to as many.
#[derive(Debug)]
pub(super) struct Block {
    /// Where the first points are,
    pub rows: Places,
    /// and the second.
    pub columns: Places,
    /// The pairs that nothing is known to hide.
    pub open: [Bits; SIDE],
    /// Of these, the ones that something passes too close to call.
    pub unsure: [Bits; SIDE],
    /// The pairs that were tested one by one.
    pub tested: [Bits; SIDE],
    /// Used again and again,
    scratch: [Against; 2],
    /// and what is kept of rows and of columns.
    known: [Known; 2],
}

impl Default for Block {
    /// A block without points.
    fn default() -> Block {
        Block {
            rows: Places::NONE,
            columns: Places::NONE,
            open: [[0; WORDS]; SIDE],
            unsure: [[0; WORDS]; SIDE],
            tested: [[0; WORDS]; SIDE],
            scratch: [Against::NONE; 2],
            known: [Known::new(), Known::new()],
        }
    }
}

impl Block {
    /// Makes its pairs those of `rows` and `columns`, ranges of the points in `position`; none is open.
    pub fn begin(&mut self, rows: &Range<usize>, columns: &Range<usize>, position: &[Vec3]) {
        let places = |of: &Range<usize>| position[of.clone()].iter().map(|p| p.as_dvec3());
        self.rows.set(places(rows));
        self.columns.set(places(columns));
        let [of_rows, of_columns] = &mut self.known;
        of_rows.begin(rows);
        of_columns.begin(columns);
        self.clear();
    }

    /// Forgets all pairs: none is open.
    fn clear(&mut self) {
        let rows = 0..self.rows.count;
        self.open[rows.clone()].fill([0; WORDS]);
        self.unsure[rows.clone()].fill([0; WORDS]);
        self.tested[rows].fill([0; WORDS]);
    }

    /// How many points are on its two sides.
    pub fn points(&self) -> usize {
        self.rows.count + self.columns.count
    }

    /// The rows, and the columns, that an open pair is in.
    pub fn open_sides(&self) -> (Bits, Bits) {
        let (mut rows, mut columns) = ([0; WORDS], [0; WORDS]);
        for (r, open) in self.open[..self.rows.count].iter().enumerate() {
            rows[r / 32] |= u32::from(*open != [0; WORDS]) << (r % 32);
            columns = std::array::from_fn(|w| columns[w] | open[w]);
        }
        (rows, columns)
    }

    /// How many pairs are open.
    pub fn count_open(&self) -> u64 {
        self.open[..self.rows.count].iter().map(count).sum()
    }

    /// Closes the open pairs that `blocker` hides and marks those that it passes too close to call. No segment is
    /// longer than `length`.
    pub fn test(&mut self, blocker: &Blocker, length: f64) -> Hidden {
        let Block { rows, columns, open, unsure, tested, scratch: [from, to], .. } = self;
        let all = [u32::MAX; WORDS];
        from.set(rows, &all, blocker);
        to.set(columns, &all, blocker);
        let words = [rows.words(), columns.words()];
        widest(Close {
            open,
            unsure,
            tested,
            from,
            to,
            among: [&all; 2],
            words,
            doubt: doubt(blocker, length),
        })
    }

    /// [`Block::test`] against `surface`, for the rows and columns `among` which there are open pairs. How either side lies
    /// against it is looked up if that was asked before; `reach` says which rows, 0, and which columns, 1, it may hide
    /// anything from.
    pub fn test_known(
        &mut self,
        (blocker, surface): (&Blocker, u32),
        length: f64,
        among: [&Bits; 2],
        reach: impl Fn(usize) -> Bits,
    ) -> Hidden {
        let Block { rows, columns, open, unsure, tested, known: [of_rows, of_columns], .. } = self;
        let words = [rows.words(), columns.words()];
        let sides =
            |of: &Against, k: usize| of.sides.map(|side| (0..words[k]).any(|w| side[w] & among[k][w] != 0));
        let from = of_rows.against(surface, |from| from.set(rows, &reach(0), blocker));
        let [front, back] = sides(from, 0);
        if !front && !back {
            return Hidden::default();
        }
        let to = of_columns.against(surface, |to| to.set(columns, &reach(1), blocker));
        let [beyond_back, beyond_front] = sides(to, 1);
        if !(front && beyond_front || back && beyond_back) {
            return Hidden::default();
        }
        widest(Close { open, unsure, tested, from, to, among, words, doubt: doubt(blocker, length) })
    }
}

/// How many bits are set.
pub(super) fn count(bits: &Bits) -> u64 {
    bits.iter().map(|w| u64::from(w.count_ones())).sum()
}

/// What the r_k of two sets of points say of all their pairs.
enum Bound {
    Clear,
    Covers,
    Open,
}

/// All sums of two sets' r_k lie between those of `lo` and of `hi`; less than `band` from 0 is too close to call.
#[inline(always)]
fn bound(lo: [[f32; 4]; 2], hi: [[f32; 4]; 2], band: f32) -> Bound {
    let (mut clear, mut covers) = (false, true);
    for k in 0..4 {
        clear |= hi[0][k] + hi[1][k] < -band;
        covers &= lo[0][k] + lo[1][k] > band;
    }
    if clear {
        Bound::Clear
    } else if covers {
        Bound::Covers
    } else {
        Bound::Open
    }
}

/// s_k above this is beyond doubt, and so is s_k below its opposite, m².
fn doubt(blocker: &Blocker, length: f64) -> f32 {
    let bands = blocker.bands();
    ((bands.slack + bands.rounding) * length) as f32
}

/// Closes the pairs that a blocker hides, given how the points lie against it.
struct Close<'a> {
    open: &'a mut [Bits; SIDE],
    unsure: &'a mut [Bits; SIDE],
    tested: &'a mut [Bits; SIDE],
    from: &'a Against,
    to: &'a Against,
    /// The rows and the columns that count.
    among: [&'a Bits; 2],
    /// Of the rows and of the columns.
    words: [usize; 2],
    doubt: f32,
}

impl HotLoop for Close<'_> {
    type Output = Hidden;

    #[inline(always)]
    fn run(self) -> Hidden {
        let Close {
            open,
            unsure,
            tested,
            from,
            to,
            among: [rows, columns],
            words: [row_words, column_words],
            doubt,
        } = self;
        let mut hidden = Hidden::default();
        for side in 0..2 {
            for v in 0..row_words {
                let members = from.sides[side][v] & rows[v];
                if members == 0 {
                    continue;
                }
                let near = from.bounds[side][v];
                for w in 0..column_words {
                    let opposite = to.sides[1 - side][w] & columns[w];
                    if opposite == 0 {
                        continue;
                    }
                    let beyond = to.bounds[1 - side][w];
                    let all_far = members & !from.far[v] == 0 && opposite & !to.far[w] == 0;
                    let band = doubt * near.nearness * beyond.nearness;
                    let verdict = bound([near.lo, beyond.lo], [near.hi, beyond.hi], band);
                    if matches!(verdict, Bound::Clear) {
                        continue;
                    }
                    let covered = all_far && matches!(verdict, Bound::Covers);
                    let mut left = members;
                    while left != 0 {
                        let i = 32 * v + left.trailing_zeros() as usize;
                        left &= left - 1;
                        let crossing = open[i][w] & opposite;
                        if crossing == 0 {
                            continue;
                        }
                        if covered {
                            open[i][w] &= !crossing;
                            hidden.proved += u64::from(crossing.count_ones());
                            continue;
                        }
                        let ratios = from.ratio.each_ref().map(|r| r[v][i % 32]);
                        let limit = doubt / from.distance[v][i % 32];
                        match bound([ratios, beyond.lo], [ratios, beyond.hi], limit * beyond.nearness) {
                            Bound::Clear => continue,
                            Bound::Covers if all_far => {
                                open[i][w] &= !crossing;
                                hidden.proved += u64::from(crossing.count_ones());
                                continue;
                            }
                            _ => {}
                        }
                        let (hit, maybe) = lanes(ratios, limit, to, w);
                        let row_is_far = from.far[v] >> (i % 32) & 1 == 1;
                        let certain = hit & crossing & if row_is_far { to.far[w] } else { 0 };
                        open[i][w] &= !certain;
                        unsure[i][w] |= maybe & crossing & !certain;
                        tested[i][w] |= crossing;
                        hidden.tested += u64::from(certain.count_ones());
                    }
                }
            }
        }
        hidden
    }
}

/// Of the points of word `w`: which have a segment from the point with these r_k that crosses inside beyond
/// doubt, and which have one that may.
#[inline(always)]
fn lanes(ratios: [f32; 4], limit: f32, to: &Against, w: usize) -> (u32, u32) {
    let ([r0, r1, r2, r3], d) = (to.ratio.each_ref().map(|r| &r[w]), &to.distance[w]);
    let less = |a: f32, b: f32| if a < b { a } else { b };
    let (mut hit, mut maybe) = (0, 0);
    for i in 0..32 {
        let least =
            less(less(ratios[0] + r0[i], ratios[1] + r1[i]), less(ratios[2] + r2[i], ratios[3] + r3[i]));
        let s = d[i] * least;
        hit |= if s > limit { LANES[i] } else { 0 };
        maybe |= if s >= -limit { LANES[i] } else { 0 };
    }
    (hit, maybe)
}

#[cfg(test)]
mod tests {
    use super::super::against::span;
    use super::super::blocker::tests::{BANDS, Random, blocks};
    use super::*;
    use glam::DVec3;

    /// Tests `rows` x `columns` against a surface and holds what is certain to intersection. Returns how many pairs
    /// were proved hidden, tested hidden, unsure and free without a test.
    fn compare(random: &mut Random, rows: &[DVec3], columns: &[DVec3]) -> [u64; 4] {
        let surface = random.surface();
        let blocker = Blocker::new(&surface, &BANDS);
        let mut block = Block::default();
        block.rows.set(rows.iter().copied());
        block.columns.set(columns.iter().copied());
        block.open[..rows.len()].fill(span(0, columns.len()));
        let hidden = block.test(&blocker, 4.0);
        let (mut closed, mut unsure, mut free) = (0, 0, 0);
        for (i, from) in rows.iter().enumerate() {
            for (j, to) in columns.iter().enumerate() {
                let get = |bits: &[Bits; SIDE]| bits[i][j / 32] >> (j % 32) & 1 == 1;
                if !get(&block.open) {
                    closed += 1;
                    assert!(blocks(&surface, *from, *to), "{surface:?} {from} {to}");
                } else if get(&block.unsure) {
                    unsure += 1;
                } else {
                    free += u64::from(!get(&block.tested));
                    assert!(!blocks(&surface, *from, *to), "{surface:?} {from} {to}");
                }
            }
        }
        assert_eq!(closed, hidden.proved + hidden.tested);
        let again = block.test(&blocker, 4.0);
        assert_eq!(again.proved + again.tested, 0, "nothing is hidden twice");
        [hidden.proved, hidden.tested, unsure, free]
    }

    #[test]
    fn certain_pairs_are_as_intersection_says() {
        let mut random = Random(1);
        let mut found = [0; 4];
        for turn in 0..3000 {
            // Points anywhere, and points close together, so that bounds decide.
            let size = if turn % 2 == 0 { 1.0 } else { 0.15 };
            let (o, p) =
                if turn % 2 == 0 { (DVec3::ZERO, DVec3::ZERO) } else { (random.point(), random.point()) };
            let rows: Vec<DVec3> = (0..5).map(|_| o + size * random.point()).collect();
            let columns: Vec<DVec3> = (0..33 + turn % 60).map(|_| p + size * random.point()).collect();
            let these = compare(&mut random, &rows, &columns);
            found = std::array::from_fn(|k| found[k] + these[k]);
        }
        let [proved, tested, unsure, free] = found;
        assert!(proved > 5_000 && tested > 10_000 && free > 100_000 && unsure < 60, "{found:?}");
    }

    #[test]
    fn spans_are_what_they_say() {
        for (first, end) in
            [(0, 0), (0, 1), (0, 32), (5, 31), (31, 33), (64, 128), (0, 128), (127, 128), (40, 30)]
        {
            let bits = span(first, end);
            for i in 0..SIDE {
                assert_eq!(
                    bits[i / 32] >> (i % 32) & 1 == 1,
                    (first..end).contains(&i),
                    "{i} in {first}..{end}"
                );
            }
        }
    }

    #[test]
    fn points_above_a_plane_are_found() {
        let mut random = Random(7);
        let places: Vec<DVec3> = (0..77).map(|_| random.point()).collect();
        let mut side = Places::NONE;
        side.set(places.iter().copied());
        let (normal, offset) = (DVec3::new(0.6, 0.0, 0.8), 0.1);
        let above = side.above(normal, offset, 0.05);
        for i in 0..SIDE {
            let expected = places.get(i).is_some_and(|p| normal.dot(*p) - offset > 0.05);
            assert_eq!(above[i / 32] >> (i % 32) & 1 == 1, expected);
        }
    }
}

//! Lobes between two sets of directions, group by group: kept as far as memory allows, and found anew beyond. Both give
//! the same bits.
//!
//! The lobe of a reflection is the same both ways, so half of it is enough: the rows of a group begin with the group
//! itself. Rows depend on geometry and roughness alone; Fresnel's factors are looked up as light passes.

use super::directions::{Directions, LANES, Lanes};
use super::lobe_table::{LobeTable, STEPS};
use crate::simd::{HotLoop, wide};
use std::ops::Range;

/// What lobes are between a group of directions and others, one after the other.
#[derive(Clone, Debug, Default)]
struct Tiles {
    /// The others.
    groups: Vec<u32>,
    /// B, 1/sr, by the direction of the group.
    b: Vec<[Lanes; LANES]>,
    /// 1 less the root of the cosine of incidence on the facet, in steps.
    angle: Vec<[[u16; LANES]; LANES]>,
    /// The least and the largest of them.
    range: Vec<[u16; 2]>,
}

/// Some of them.
#[derive(Clone, Copy)]
struct Strip<'a> {
    groups: &'a [u32],
    b: &'a [[Lanes; LANES]],
    angle: &'a [[[u16; LANES]; LANES]],
    range: &'a [[u16; 2]],
}

impl Tiles {
    #[inline(always)]
    fn get(&self, range: Range<usize>) -> Strip<'_> {
        Strip {
            groups: &self.groups[range.clone()],
            b: &self.b[range.clone()],
            angle: &self.angle[range.clone()],
            range: &self.range[range],
        }
    }

    fn clear(&mut self) {
        self.groups.clear();
        self.b.clear();
        self.angle.clear();
        self.range.clear();
    }
}

/// A lobe between two sets of directions, by the groups of directions light comes from.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Whether the rows of each group begin with the group itself.
    half: bool,
    /// Those of the first groups, one after the other.
    kept: Tiles,
    /// Where those of each end.
    ends: Vec<usize>,
}

/// Bytes that the lobes between two groups take.
pub const BYTES: usize = size_of::<(u32, [Lanes; LANES], [[u16; LANES]; LANES], [u16; 2])>();

impl Rows {
    /// Of light from `from` to `to`, which are the same where one `half` is enough. About `most` pairs of groups are kept.
    pub fn new(from: &Directions, to: &Directions, half: bool, most: usize) -> Self {
        Self::default().renewed(from, to, half, most)
    }

    /// [`Rows::new`] in the memory of these.
    pub fn renewed(self, from: &Directions, to: &Directions, half: bool, most: usize) -> Self {
        wide(Keep { from, to, half, most, memory: self })
    }

    /// The rows of a group in the first `groups`, in `scratch` if they are not kept.
    #[inline(always)]
    fn of<'a>(
        &'a self,
        from: &Directions,
        to: &Directions,
        (own, groups): (usize, usize),
        scratch: &'a mut Scratch,
    ) -> Strip<'a> {
        match self.ends.get(own) {
            Some(&end) => {
                let start = if own == 0 { 0 } else { self.ends[own - 1] };
                // Groups ascend.
                let within = self.kept.groups[start..end].partition_point(|&g| (g as usize) < groups);
                self.kept.get(start..start + within)
            }
            None => {
                scratch.tiles.clear();
                append(from, to, self.half, (own, groups), &mut scratch.reached, &mut scratch.tiles);
                scratch.tiles.get(0..scratch.tiles.groups.len())
            }
        }
    }

    /// Σ_k B(l, k) x_k over `to` for every l of `from`. `table` multiplies B by its value at the first wavelength.
    pub fn product(
        &self,
        from: &Directions,
        to: &Directions,
        table: Option<&LobeTable>,
        x: &[Lanes],
    ) -> Vec<f32> {
        wide(Product { rows: self, from, to, table, x })
    }
}

/// Room for rows that are not kept.
#[derive(Default)]
struct Scratch {
    tiles: Tiles,
    reached: Reached,
}

/// The groups that some directions reach.
#[derive(Default)]
struct Reached {
    /// Bits of the directions that reach a group, by the group.
    by: Vec<u8>,
    /// The groups.
    groups: Vec<u32>,
}

/// Appends the rows of group `own` in the first `groups`.
#[inline(always)]
fn append(
    from: &Directions,
    to: &Directions,
    half: bool,
    (own, groups): (usize, usize),
    reached: &mut Reached,
    tiles: &mut Tiles,
) {
    reached.by.resize(to.groups(), 0);
    reached.groups.clear();
    let first = if half { own } else { 0 };
    for r in 0..LANES {
        let a = from.get(own * LANES + r);
        if a.to[2] <= 0.0 {
            continue;
        }
        for g in to.reach(a, first..groups) {
            if reached.by[g] == 0 {
                reached.groups.push(g as u32);
            }
            reached.by[g] |= 1 << r;
        }
    }
    reached.groups.sort_unstable();
    for &g in &reached.groups {
        let by = std::mem::take(&mut reached.by[g as usize]);
        let (mut b, mut angle) = ([[0.0; LANES]; LANES], [[0; LANES]; LANES]);
        let (mut least, mut most) = ([u16::MAX; LANES], [0; LANES]);
        for r in 0..LANES {
            if by & 1 << r == 0 {
                continue;
            }
            let a = from.get(own * LANES + r);
            let Some((row, cosine)) = to.lobe(&a, g as usize) else { continue };
            b[r] = row;
            for lane in 0..LANES {
                angle[r][lane] = nearest((1.0 - cosine[lane].clamp(0.0, 1.0).sqrt()) * STEPS);
            }
            // All bits where the lobe is not 0.
            let mut some = [0u16; LANES];
            for lane in 0..LANES {
                some[lane] = 0u16.wrapping_sub(u16::from(row[lane] > 0.0));
            }
            for lane in 0..LANES {
                least[lane] = least[lane].min(angle[r][lane] | !some[lane]);
                most[lane] = most[lane].max(angle[r][lane] & some[lane]);
            }
        }
        let mut range = [u16::MAX, 0];
        for lane in 0..LANES {
            range = [range[0].min(least[lane]), range[1].max(most[lane])];
        }
        if range[0] > range[1] {
            continue;
        }
        // Where the lobe is 0 any angle will do.
        for angle in angle.as_flattened_mut() {
            *angle = (*angle).max(range[0]).min(range[1]);
        }
        tiles.groups.push(g);
        tiles.b.push(b);
        tiles.angle.push(angle);
        tiles.range.push(range);
    }
}

/// [`Rows::new`].
struct Keep<'a> {
    from: &'a Directions,
    to: &'a Directions,
    half: bool,
    most: usize,
    memory: Rows,
}

impl HotLoop for Keep<'_> {
    type Output = Rows;

    #[inline(always)]
    fn run(self) -> Rows {
        let Keep { from, to, half, most, memory: Rows { mut kept, mut ends, .. } } = self;
        let mut reached = Reached::default();
        kept.clear();
        ends.clear();
        while kept.groups.len() < most && ends.len() < from.groups() {
            append(from, to, half, (ends.len(), to.groups()), &mut reached, &mut kept);
            ends.push(kept.groups.len());
        }
        kept.groups.shrink_to_fit();
        kept.b.shrink_to_fit();
        kept.angle.shrink_to_fit();
        kept.range.shrink_to_fit();
        Rows { half, kept, ends }
    }
}

/// [`Rows::product`].
struct Product<'a> {
    rows: &'a Rows,
    from: &'a Directions,
    to: &'a Directions,
    table: Option<&'a LobeTable>,
    x: &'a [Lanes],
}

impl HotLoop for Product<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Product { rows, from, to, table, x } = self;
        let mut scratch = Scratch::default();
        let mut theirs = vec![[0.0f32; LANES]; if rows.half { to.groups() } else { 0 }];
        let mut sums: Vec<f32> = Vec::with_capacity(from.groups() * LANES);
        for own in 0..from.groups() {
            let mut sum = [[0.0; LANES]; LANES];
            let mine = x.get(own).copied().unwrap_or_default();
            let strip = rows.of(from, to, (own, to.groups()), &mut scratch);
            for ((&g, b), angle) in strip.groups.iter().zip(strip.b).zip(strip.angle) {
                let g = g as usize;
                let mut shares = *b;
                if let Some(table) = table {
                    for r in 0..LANES {
                        let piece = table.piece_for(&angle[r]);
                        let steps = table.steps(&angle[r], piece.unwrap_or(0));
                        shares[r] = table.share(&b[r], (piece, &steps), 0);
                    }
                }
                let x = x[g];
                for r in 0..LANES {
                    for lane in 0..LANES {
                        sum[r][lane] += shares[r][lane] * x[lane];
                    }
                }
                // The pairs within a group are met from both their ends.
                if rows.half && g > own {
                    let mut more = theirs[g];
                    for r in 0..LANES {
                        for lane in 0..LANES {
                            more[lane] += shares[r][lane] * mine[r];
                        }
                    }
                    theirs[g] = more;
                }
            }
            for sum in &sum {
                sums.push(sum_of(sum));
            }
        }
        if rows.half {
            sums.iter_mut().zip(theirs.as_flattened()).for_each(|(sum, theirs)| *sum += theirs);
        }
        sums.truncate(from.len);
        sums
    }
}

/// The sum of all lanes.
#[inline(always)]
pub fn sum_of([a, b, c, d, e, f, g, h]: &Lanes) -> f32 {
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}

/// The nearest whole number of 0 to 65535.
#[inline(always)]
fn nearest(x: f32) -> u16 {
    // Beyond 2^23 numbers are whole, and the last bits are their last digits.
    (x + 8_388_608.0).to_bits() as u16
}

/// Adds what a lobe makes of `light`: Σ_l B F light_l towards every k. Where half of the rows is enough, light goes
/// both ways.
pub struct Pass<'a> {
    /// The lobe.
    pub rows: &'a Rows,
    /// Fresnel's factor, or what goes through.
    pub table: &'a LobeTable,
    /// Where the light comes from.
    pub from: &'a Directions,
    /// Where it goes.
    pub to: &'a Directions,
    /// Groups that send light to all, from the first on. With half rows those beyond still send light to those within.
    pub count: usize,
    /// Number of groups that the light is asked for in, from the first on.
    pub groups: usize,
    /// Number of wavelengths.
    pub w: usize,
    /// The light, `[groups of from][W]`, of as many groups as send any.
    pub light: &'a [Lanes],
    /// What comes of it, `[groups][W]`.
    pub out: &'a mut [Lanes],
}

impl HotLoop for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Pass { rows, table, from, to, w, light, out, groups, .. } = self;
        let mut scratch = Scratch::default();
        // What comes back to the directions of a group, to be summed over the lanes.
        let mut back = vec![[[0.0f32; LANES]; LANES]; w];
        for own in 0..self.count.min(from.groups()) {
            let strip = rows.of(from, to, (own, groups), &mut scratch);
            for (((&g, b), angle), range) in
                strip.groups.iter().zip(strip.b).zip(strip.angle).zip(strip.range)
            {
                let g = g as usize;
                let piece = table.piece(*range);
                let (mut pieces, mut steps) = ([piece; LANES], [[0.0; LANES]; LANES]);
                for r in 0..LANES {
                    if piece.is_none() {
                        pieces[r] = table.piece_for(&angle[r]);
                    }
                    steps[r] = table.steps(&angle[r], pieces[r].unwrap_or(0));
                }
                for k in 0..w {
                    let mine = light.get(own * w + k).copied().unwrap_or_default();
                    // The pairs within a group are met from both their ends.
                    let theirs = if rows.half && g > own { light.get(g * w + k) } else { None };
                    let theirs = theirs.copied().unwrap_or_default();
                    // On the stack, for the compiler to see that they are apart.
                    let (mut sum, back) = (out[g * w + k], &mut back[k]);
                    let polynomial = piece.map(|piece| table.polynomial(piece, k));
                    for r in 0..LANES {
                        let share = match polynomial {
                            Some(polynomial) => polynomial.times(&b[r], &steps[r]),
                            None => table.share(&b[r], (pieces[r], &steps[r]), k),
                        };
                        let mut more = back[r];
                        for lane in 0..LANES {
                            sum[lane] += share[lane] * mine[r];
                        }
                        for lane in 0..LANES {
                            more[lane] += share[lane] * theirs[lane];
                        }
                        back[r] = more;
                    }
                    out[g * w + k] = sum;
                }
            }
            if rows.half {
                for (out, back) in out[own * w..].iter_mut().zip(&back) {
                    for r in 0..LANES {
                        out[r] += sum_of(&back[r]);
                    }
                }
                back.fill([[0.0; LANES]; LANES]);
            }
        }
    }
}

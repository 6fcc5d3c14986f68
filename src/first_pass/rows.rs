//! Lobes between two sets of directions, row by row: kept as far as memory allows, and found anew beyond. Both give
//! the same bits.
//!
//! The lobe of a reflection is the same both ways, so half of it is enough: the row of a direction begins with its own
//! group. Rows depend on geometry and roughness alone; Fresnel's factors are looked up as light passes.

use super::directions::{Directions, LANES, Lanes};
use super::lobe_table::{BAND, LobeTable};
use crate::simd::{HotLoop, wide};
use glam::Vec4;
use std::ops::Range;

/// Steps of an angle as it is kept: the error of 1 less the root of the cosine is 8e-6.
const STEPS: f32 = 65535.0;

/// What lobes are towards groups of directions, one after the other.
#[derive(Clone, Debug, Default)]
struct Entries {
    /// The groups.
    groups: Vec<u32>,
    /// B, 1/sr.
    b: Vec<Lanes>,
    /// 1 less the root of the cosine of incidence on the facet, in steps.
    angle: Vec<[u16; LANES]>,
}

/// Some of them.
#[derive(Clone, Copy)]
struct Row<'a> {
    groups: &'a [u32],
    b: &'a [Lanes],
    angle: &'a [[u16; LANES]],
}

impl Entries {
    #[inline(always)]
    fn get(&self, range: Range<usize>) -> Row<'_> {
        Row { groups: &self.groups[range.clone()], b: &self.b[range.clone()], angle: &self.angle[range] }
    }

    fn clear(&mut self) {
        self.groups.clear();
        self.b.clear();
        self.angle.clear();
    }
}

/// A lobe between two sets of directions, by the directions light comes from.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Whether each row begins with its own group.
    half: bool,
    /// The first rows, one after the other.
    kept: Entries,
    /// Where each ends.
    ends: Vec<usize>,
}

/// Bytes that an entry takes.
pub const BYTES: usize = size_of::<(u32, Lanes, [u16; LANES])>();

impl Rows {
    /// Of light from `from` to `to`, which are the same where one `half` is enough. About `most` entries are kept.
    pub fn new(from: &Directions, to: &Directions, half: bool, most: usize) -> Self {
        wide(Keep { from, to, half, most })
    }

    /// Row `l` in the first `groups`, in `scratch` if it is not kept.
    #[inline(always)]
    fn row<'a>(
        &'a self,
        from: &Directions,
        to: &Directions,
        (l, groups): (usize, usize),
        scratch: &'a mut Entries,
    ) -> Row<'a> {
        match self.kept_row(l) {
            Some(range) if groups >= to.groups() => self.kept.get(range),
            Some(range) => {
                // Groups ascend.
                let within = self.kept.groups[range.clone()].partition_point(|&g| (g as usize) < groups);
                self.kept.get(range.start..range.start + within)
            }
            None => {
                scratch.clear();
                append(from, to, self.half, (l, groups), scratch);
                scratch.get(0..scratch.groups.len())
            }
        }
    }

    /// Where row `l` is kept.
    #[inline(always)]
    fn kept_row(&self, l: usize) -> Option<Range<usize>> {
        let end = *self.ends.get(l)?;
        Some(if l == 0 { 0 } else { self.ends[l - 1] }..end)
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

/// Appends row `l` in the first `groups`.
#[inline(always)]
fn append(from: &Directions, to: &Directions, half: bool, (l, groups): (usize, usize), row: &mut Entries) {
    let a = from.get(l);
    if a.to[2] <= 0.0 {
        return;
    }
    let first = if half { l / LANES } else { 0 };
    for g in to.reach(a, first..groups) {
        let Some((b, cosine)) = to.lobe(&a, g) else { continue };
        let mut angle = [0; LANES];
        for lane in 0..LANES {
            angle[lane] = nearest((1.0 - cosine[lane].clamp(0.0, 1.0).sqrt()) * STEPS);
        }
        row.groups.push(g as u32);
        row.b.push(b);
        row.angle.push(angle);
    }
}

/// [`Rows::new`].
struct Keep<'a> {
    from: &'a Directions,
    to: &'a Directions,
    half: bool,
    most: usize,
}

impl HotLoop for Keep<'_> {
    type Output = Rows;

    #[inline(always)]
    fn run(self) -> Rows {
        let Keep { from, to, half, most } = self;
        let (mut kept, mut ends) = (Entries::default(), Vec::new());
        while kept.groups.len() < most && ends.len() < from.len {
            append(from, to, half, (ends.len(), to.groups()), &mut kept);
            ends.push(kept.groups.len());
        }
        kept.groups.shrink_to_fit();
        kept.b.shrink_to_fit();
        kept.angle.shrink_to_fit();
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
        let mut scratch = Entries::default();
        let mut theirs = vec![[0.0f32; LANES]; if rows.half { to.groups() } else { 0 }];
        let mut sums: Vec<f32> = Vec::with_capacity(from.len);
        for l in 0..from.len {
            let mut sum = [0.0; LANES];
            let own = x.get(l / LANES).map_or(0.0, |x| x[l % LANES]);
            let row = rows.row(from, to, (l, to.groups()), &mut scratch);
            for ((&g, b), angle) in row.groups.iter().zip(row.b).zip(row.angle) {
                let g = g as usize;
                let b = match table {
                    Some(table) => table.first(b, angle),
                    None => *b,
                };
                let x = &x[g];
                for lane in 0..LANES {
                    sum[lane] += b[lane] * x[lane];
                }
                // The pairs within a group are met from both their ends.
                if rows.half && g > l / LANES {
                    let theirs = &mut theirs[g];
                    for lane in 0..LANES {
                        theirs[lane] += b[lane] * own;
                    }
                }
            }
            sums.push(sum.iter().sum());
        }
        if rows.half {
            sums.iter_mut().enumerate().for_each(|(l, sum)| *sum += theirs[l / LANES][l % LANES]);
        }
        sums
    }
}

impl LobeTable {
    /// B times the table at the first wavelength.
    #[inline(always)]
    fn first(&self, b: &Lanes, angle: &[u16; LANES]) -> Lanes {
        let (slot, f) = self.slots(&angle.map(|angle| f32::from(angle) / STEPS));
        let mut share = [0.0; LANES];
        for lane in 0..LANES {
            let (here, step) = self.entry(slot[lane], 0);
            share[lane] = b[lane] * (here[0] + f[lane] * step[0]);
        }
        share
    }

    /// B times the table at the wavelengths of a band: by wavelength, then by lane.
    #[inline(always)]
    fn shares(&self, b: &Lanes, (slot, f): &([i32; LANES], Lanes), band: usize) -> [Lanes; BAND] {
        let mut shares = [[0.0; BAND]; LANES];
        for lane in 0..LANES {
            let (here, step) = self.entry(slot[lane], band);
            let share = b[lane] * (Vec4::from(*here) + f[lane] * Vec4::from(*step));
            shares[lane] = share.to_array();
        }
        std::array::from_fn(|k| std::array::from_fn(|lane| shares[lane][k]))
    }
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
    /// Number of rows, from the first on. With half rows the directions beyond still send light to those within.
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
        let mut scratch = Entries::default();
        // What comes back to the directions of a group, to be summed over the lanes.
        let mut back = vec![[0.0f32; LANES]; LANES * w];
        let count = self.count.min(from.len);
        for l in 0..count {
            let row = rows.row(from, to, (l, groups), &mut scratch);
            for first in (0..w).step_by(BAND) {
                let at = (l, first, w);
                match w - first {
                    1 => pass::<1>(out, light, rows.half, at, row, table, &mut back),
                    2 => pass::<2>(out, light, rows.half, at, row, table, &mut back),
                    3 => pass::<3>(out, light, rows.half, at, row, table, &mut back),
                    _ => pass::<BAND>(out, light, rows.half, at, row, table, &mut back),
                }
            }
            if rows.half && (l % LANES == LANES - 1 || l + 1 == count) {
                let out = out[l / LANES * w..].iter_mut();
                for (k, out) in out.enumerate().take(w) {
                    for (lane, out) in out.iter_mut().enumerate() {
                        *out += back[lane * w + k].iter().sum::<f32>();
                    }
                }
                back.fill([0.0; LANES]);
            }
        }
    }
}

/// Row `l` of a [`Pass`] at `K` of `w` wavelengths from `first` on. What comes back goes to `back`, `[LANES][W]`.
#[inline(always)]
fn pass<const K: usize>(
    out: &mut [Lanes],
    light: &[Lanes],
    half: bool,
    (l, first, w): (usize, usize, usize),
    row: Row,
    table: &LobeTable,
    back: &mut [Lanes],
) {
    let (own, known) = (l / LANES, light.len() / w);
    let mine: [f32; K] =
        std::array::from_fn(|k| if own < known { light[own * w + first + k][l % LANES] } else { 0.0 });
    let mut sum = [[0.0f32; LANES]; K];
    for ((&g, b), angle) in row.groups.iter().zip(row.b).zip(row.angle) {
        let g = g as usize;
        let slots = table.slots(&angle.map(|angle| f32::from(angle) / STEPS));
        let shares = table.shares(b, &slots, first / BAND);
        let Some(out) = out[g * w + first..].first_chunk_mut::<K>() else { continue };
        for k in 0..K {
            for lane in 0..LANES {
                out[k][lane] += shares[k][lane] * mine[k];
            }
        }
        // The pairs within a group are met from both their ends.
        if half
            && g > own
            && g < known
            && let Some(theirs) = light[g * w + first..].first_chunk::<K>()
        {
            for k in 0..K {
                for lane in 0..LANES {
                    sum[k][lane] += shares[k][lane] * theirs[k][lane];
                }
            }
        }
    }
    if half {
        back[l % LANES * w + first..][..K].copy_from_slice(&sum);
    }
}

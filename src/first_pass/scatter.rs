//! The innermost loops of the specular chains: radiance from many members through one lobe to many.

use super::directions::{Directions, LANES};
use super::lobe_table::{BAND, Band, LobeTable};
use crate::simd::{HotLoop, wide};
use glam::Vec4;

/// What one kind of scattering does.
#[derive(Clone, Copy)]
pub struct Lobe<'a> {
    /// F (or what goes through) times the specular share.
    pub table: &'a LobeTable,
    /// Bands of wavelengths.
    pub bands: usize,
}

/// Members that send light, ascending or not, and their q L, `[sources][bands]`.
pub type Sources<'a> = (&'a [u32], &'a [Band]);

/// Adds Σ_l F B(l, k) u_l u_k q_l L_l to the radiance towards every k, `[members][bands]`.
pub struct Scatter<'a> {
    /// Where the light comes from.
    pub from: &'a Directions,
    /// The light.
    pub sources: Sources<'a>,
    /// Where it goes.
    pub to: &'a Directions,
    /// How many groups of these directions, from the first on.
    pub groups: usize,
    /// How.
    pub lobe: Lobe<'a>,
    /// Towards each k.
    pub radiance: &'a mut [Band],
}

impl HotLoop for Scatter<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Scatter { from, sources: (members, values), to, groups, lobe: Lobe { table, bands }, radiance } =
            self;
        for (&member, source) in members.iter().zip(values.chunks(bands)) {
            let a = from.get(member as usize);
            let u = from.gain * from.scale_of(member as usize);
            if a.to[2] <= 0.0 {
                continue;
            }
            for g in to.reach(a, 0..groups) {
                let Some((b, cosine)) = to.lobe(&a, g) else { continue };
                let (slot, f) = table.slots(&cosine);
                let scale = &to.scale[g];
                let group = &mut radiance[g * LANES * bands..(g + 1) * LANES * bands];
                // Lanes outside the cone have weight 0: adding that costs less than asking.
                let weight: [f32; LANES] = std::array::from_fn(|lane| b[lane] * u * scale[lane]);
                for (band, l) in source.iter().enumerate() {
                    let l = Vec4::from(*l);
                    for lane in 0..LANES {
                        let (here, step) = table.entry(slot[lane], band);
                        let share = weight[lane] * (Vec4::from(*here) + f[lane] * Vec4::from(*step));
                        let out = &mut group[lane * bands + band];
                        *out = (Vec4::from(*out) + share * l).to_array();
                    }
                }
            }
        }
    }
}

/// [`Scatter`] within one set of directions, and what their lobes lack. The lobe is the same both ways, so when most
/// members send light to all others each pair is computed once for both.
pub fn reflect(members: &Directions, sources: Sources, groups: usize, lobe: Lobe, radiance: &mut [Band]) {
    if !members.spread.is_empty() {
        spread(members, sources, lobe, radiance);
    }
    if 2 * sources.0.len() < members.len || groups < members.groups() {
        wide(Scatter { from: members, sources, to: members, groups, lobe, radiance });
        return;
    }
    let mut light = vec![[0.0; 4]; radiance.len()];
    for (&member, source) in sources.0.iter().zip(sources.1.chunks(lobe.bands)) {
        light[member as usize * lobe.bands..][..lobe.bands].copy_from_slice(source);
    }
    wide(Exchange { members, light: &light, lobe, radiance });
}

/// Adds h_k Σ_l h_l q_l L_l to the radiance towards every k.
fn spread(members: &Directions, (from, values): Sources, lobe: Lobe, radiance: &mut [Band]) {
    let Lobe { table, bands } = lobe;
    let end = |k: usize, band: usize| members.spread[k] * Vec4::from(spread_factor(members, k, table, band));
    let mut sum = vec![Vec4::ZERO; bands];
    for (&l, source) in from.iter().zip(values.chunks(bands)) {
        for (band, (sum, value)) in sum.iter_mut().zip(source).enumerate() {
            *sum += end(l as usize, band) * Vec4::from(*value);
        }
    }
    for (k, out) in radiance.chunks_mut(bands).enumerate().take(members.len) {
        for (band, (out, sum)) in out.iter_mut().zip(&sum).enumerate() {
            *out = (Vec4::from(*out) + end(k, band) * *sum).to_array();
        }
    }
}

/// What light that is spread is multiplied by at either end: the root of F at its own angle, so that both ends together
/// give F. The balance of solids, whose transmission makes up for F, holds F already.
fn spread_factor(members: &Directions, k: usize, table: &LobeTable, band: usize) -> Band {
    if members.origin.m2 == 0.0 {
        return [1.0; BAND];
    }
    table.band(members.z[k / LANES][k % LANES], band).map(|f| f.max(0.0).sqrt())
}

/// What is spread from direction `l` to `k` at wavelength `c`, besides their lobe.
pub fn spread_between(members: &Directions, l: usize, k: usize, table: &LobeTable, c: usize) -> f32 {
    let end = |k: usize| members.spread[k] * spread_factor(members, k, table, c / BAND)[c % BAND];
    end(l) * end(k)
}

/// Every pair of `members` exchanges light: [`Scatter`] both ways at once.
struct Exchange<'a> {
    members: &'a Directions,
    /// q L of every member, 0 where it sends none, `[members][bands]`.
    light: &'a [Band],
    lobe: Lobe<'a>,
    radiance: &'a mut [Band],
}

impl HotLoop for Exchange<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Exchange { members, light, lobe: Lobe { table, bands }, radiance } = self;
        let mut back = vec![Vec4::ZERO; bands];
        for l in 0..members.len {
            let a = members.get(l);
            let u = members.gain * members.scale_of(l);
            if a.to[2] <= 0.0 {
                continue;
            }
            let own = l / LANES;
            let source = &light[l * bands..(l + 1) * bands];
            back.fill(Vec4::ZERO);
            for g in members.reach(a, own..members.groups()) {
                let Some((b, cosine)) = members.lobe(&a, g) else { continue };
                let (slot, f) = table.slots(&cosine);
                let scale = &members.scale[g];
                // The pairs within a group are met from both their ends.
                let both = if g > own { 1.0 } else { 0.0 };
                let weight: [f32; LANES] = std::array::from_fn(|lane| b[lane] * u * scale[lane]);
                let group = &mut radiance[g * LANES * bands..(g + 1) * LANES * bands];
                let theirs = &light[g * LANES * bands..(g + 1) * LANES * bands];
                for (band, (back, mine)) in back.iter_mut().zip(source).enumerate() {
                    let mine = Vec4::from(*mine);
                    let mut sum = Vec4::ZERO;
                    for lane in 0..LANES {
                        let (here, step) = table.entry(slot[lane], band);
                        let share = weight[lane] * (Vec4::from(*here) + f[lane] * Vec4::from(*step));
                        let out = &mut group[lane * bands + band];
                        *out = (Vec4::from(*out) + share * mine).to_array();
                        sum += share * Vec4::from(theirs[lane * bands + band]);
                    }
                    *back += both * sum;
                }
            }
            for (out, back) in radiance[l * bands..(l + 1) * bands].iter_mut().zip(&back) {
                *out = (Vec4::from(*out) + *back).to_array();
            }
        }
    }
}

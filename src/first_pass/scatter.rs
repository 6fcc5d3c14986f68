//! Light through lobes that are not kept: from a few directions to many, and what is spread besides.

use super::directions::{Directions, LANES, Lanes};
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
                let (slot, f) = table.slots(&cosine.map(|c| 1.0 - c.clamp(0.0, 1.0).sqrt()));
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

/// Adds h_k Σ_l h_l light_l to the radiance towards every k in the first groups; light and radiance `[groups][W]`.
pub fn spread(members: &Directions, table: &LobeTable, w: usize, light: &[Lanes], radiance: &mut [Lanes]) {
    if !members.spread.is_empty() {
        wide(Spread { members, table, w, light, radiance });
    }
}

/// [`spread`].
struct Spread<'a> {
    members: &'a Directions,
    table: &'a LobeTable,
    w: usize,
    light: &'a [Lanes],
    radiance: &'a mut [Lanes],
}

impl HotLoop for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Spread { members, table, w, light, radiance } = self;
        let groups = light.len().max(radiance.len()) / w;
        let mut ends = vec![[[0.0; BAND]; LANES]; groups];
        for band in 0..w.div_ceil(BAND) {
            let here = BAND * band..w.min(BAND * (band + 1));
            for ((ends, h), z) in ends.iter_mut().zip(members.spread.chunks(LANES)).zip(&members.z) {
                let mut shares = [0.0; LANES];
                shares[..h.len()].copy_from_slice(h);
                *ends = spread_factors(members, z, table, band);
                for (end, h) in ends.iter_mut().zip(&shares) {
                    end.iter_mut().for_each(|end| *end *= h);
                }
            }
            let mut sum = [0.0; BAND];
            for (light, ends) in light.chunks_exact(w).zip(&ends) {
                for (k, light) in light[here.clone()].iter().enumerate() {
                    sum[k] += light.iter().zip(ends).map(|(l, end)| l * end[k]).sum::<f32>();
                }
            }
            for (radiance, ends) in radiance.chunks_exact_mut(w).zip(&ends) {
                for (k, radiance) in radiance[here.clone()].iter_mut().enumerate() {
                    radiance.iter_mut().zip(ends).for_each(|(l, end)| *l += end[k] * sum[k]);
                }
            }
        }
    }
}

/// What light that is spread is multiplied by at either end: the root of F at its own angle, so that both ends together
/// give F. The balance of solids, whose transmission makes up for F, holds F already. For directions of cosines `z`.
#[inline(always)]
fn spread_factors(members: &Directions, z: &Lanes, table: &LobeTable, band: usize) -> [Band; LANES] {
    if members.origin.m2 == 0.0 {
        return [[1.0; BAND]; LANES];
    }
    let (slot, f) = table.slots(&z.map(|z| 1.0 - z.clamp(0.0, 1.0).sqrt()));
    let mut factors = [[0.0; BAND]; LANES];
    for lane in 0..LANES {
        let (here, step) = table.entry(slot[lane], band);
        for k in 0..BAND {
            factors[lane][k] = (here[k] + f[lane] * step[k]).max(0.0).sqrt();
        }
    }
    factors
}

/// What is spread from direction `l` to `k` at wavelength `c`, besides their lobe.
pub fn spread_between(members: &Directions, l: usize, k: usize, table: &LobeTable, c: usize) -> f32 {
    let factors = |k: usize| spread_factors(members, &members.z[k / LANES], table, c / BAND);
    let end = |k: usize| members.spread[k] * factors(k)[k % LANES][c % BAND];
    end(l) * end(k)
}

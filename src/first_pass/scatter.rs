//! Light through lobes that are not kept: from a few directions to many, and what is spread besides.

use super::directions::{Directions, LANES, Lanes};
use super::lobe_table::{BAND, Band, LobeTable};
use crate::simd::HotLoop;
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
    if members.spread.is_empty() {
        return;
    }
    let count = members.len.min(light.len().max(radiance.len()) / w * LANES);
    for band in 0..w.div_ceil(BAND) {
        let here = BAND * band..w.min(BAND * (band + 1));
        let ends: Vec<Band> = (0..count)
            .map(|k| spread_factor(members, k, table, band).map(|f| f * members.spread[k]))
            .collect();
        let mut sum = [0.0; BAND];
        for (light, ends) in light.chunks_exact(w).zip(ends.chunks(LANES)) {
            for (sum, (light, k)) in sum.iter_mut().zip(light[here.clone()].iter().zip(0..)) {
                *sum += light.iter().zip(ends).map(|(l, end): (&f32, &Band)| l * end[k]).sum::<f32>();
            }
        }
        for (radiance, ends) in radiance.chunks_exact_mut(w).zip(ends.chunks(LANES)) {
            for ((radiance, sum), k) in radiance[here.clone()].iter_mut().zip(sum).zip(0..) {
                radiance.iter_mut().zip(ends).for_each(|(l, end)| *l += end[k] * sum);
            }
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

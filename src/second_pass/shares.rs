//! What a place within an element takes from the element's centre and from the nodes of its border.

use super::chart::LANES;
use glam::DVec2;

/// Weights on the centre and on three nodes; sum 1. Weights of at most 1 lose nothing in `f32`.
#[derive(Clone, Copy, Default)]
pub(super) struct Shares {
    pub centre: f32,
    /// Which nodes of the element's border.
    pub nodes: [u32; 3],
    pub weights: [f32; 3],
}

/// Bilinear in the quarter of a quad element that holds `local` (0 to 1 each way).
#[inline(always)]
pub(super) fn quarter(local: DVec2) -> Shares {
    let (right, upper) = (u32::from(local.x > 0.5), u32::from(local.y > 0.5));
    let (s, t) = ((2.0 * (local.x - 0.5)).abs() as f32, (2.0 * (local.y - 0.5)).abs() as f32);
    let (rest_s, rest_t) = (1.0 - s, 1.0 - t);
    Shares { centre: rest_s * rest_t, nodes: nodes(right, upper), weights: [s * rest_t, rest_s * t, s * t] }
}

/// The nodes of a quarter: the middle of the edge to the left or right, then that of the edge below or above, then the
/// corner.
#[inline(always)]
fn nodes(right: u32, upper: u32) -> [u32; 3] {
    // The border runs corner, middle, corner, ... from (0, 0) counter-clockwise.
    [7 - 4 * right, 1 + 4 * upper, 2 * ((3 * upper) ^ right)]
}

/// [`quarter`] of the first `count` places at `uv` (a column each), in an element of this least u and v and of `scale`
/// over its size: the nodes and the sums of the weights, if all lie in one quarter of it.
#[inline(always)]
pub(super) fn quarters(
    &[low_u, low_v, scale]: &[f64; 3],
    [u, v]: &[[f64; LANES]; 2],
    count: usize,
) -> Option<([u32; 3], [f64; 4])> {
    // Lanes that are left do as the first.
    let mut at = [*u, *v];
    for i in 0..LANES {
        for (at, low) in at.iter_mut().zip([low_u, low_v]) {
            at[i] = ((if i < count { at[i] } else { at[0] }) - low) * scale;
        }
    }
    let inside = |x: f64| (0.0..1.0).contains(&x);
    let (mut weights, mut within, mut sides) = ([[0.0; LANES]; 4], [false; LANES], [[false; LANES]; 2]);
    for i in 0..LANES {
        let (x, y) = (at[0][i], at[1][i]);
        let (s, t) = ((2.0 * (x - 0.5)).abs() as f32, (2.0 * (y - 0.5)).abs() as f32);
        let (rest_s, rest_t) = (1.0 - s, 1.0 - t);
        let taken = if i < count { 1.0 } else { 0.0 };
        for (weights, of) in weights.iter_mut().zip([rest_s * rest_t, s * rest_t, rest_s * t, s * t]) {
            weights[i] = taken * of;
        }
        within[i] = inside(x) & inside(y);
        (sides[0][i], sides[1][i]) = (x > 0.5, y > 0.5);
    }
    let all = |is: [bool; LANES]| is.into_iter().fold(true, |all, is| all & is);
    let [right, upper] = [sides[0][0], sides[1][0]];
    let alike = all(within) & all(sides[0].map(|x| x == right)) & all(sides[1].map(|y| y == upper));
    alike.then(|| (nodes(right.into(), upper.into()), weights.map(|weights| sum(&weights))))
}

/// In `f64`, by halves.
#[inline(always)]
fn sum(weights: &[f32; LANES]) -> f64 {
    let mut halves = weights.map(f64::from);
    for width in [8, 4, 2, 1] {
        for i in 0..width {
            halves[i] += halves[i + width];
        }
    }
    halves[0]
}

/// Linear in the triangle centre, node, next node that holds `d` (from the centre, m); `places` are those of the nodes.
#[inline]
pub(super) fn fan(places: &[[f32; 2]], d: DVec2) -> Shares {
    let place = |i: usize| DVec2::new(f64::from(places[i][0]), f64::from(places[i][1]));
    let n = places.len();
    let (mut best, mut inside) = (0, f64::NEG_INFINITY);
    let first = place(0).perp_dot(d);
    let mut after = first;
    for i in 0..n {
        let before = after;
        after = if i + 1 < n { place(i + 1).perp_dot(d) } else { first };
        let depth = before.min(-after);
        if depth > inside {
            (best, inside) = (i, depth);
        }
    }
    let next = (best + 1) % n;
    let (a, b) = (place(best), place(next));
    let det = a.perp_dot(b);
    let (s, t) = (d.perp_dot(b).max(0.0) / det, a.perp_dot(d).max(0.0) / det);
    // A place just outside, by rounding, takes the border's value.
    let over = (s + t).max(1.0);
    let (s, t) = if det > 0.0 { (s / over, t / over) } else { (0.0, 0.0) };
    let (best, next) = (best as u32, next as u32);
    Shares { centre: (1.0 - s - t) as f32, nodes: [best, next, next], weights: [s as f32, t as f32, 0.0] }
}

/// Four spectra, by their place among all, and a weight of each.
#[derive(Clone, Copy, Default)]
pub(super) struct Mix {
    pub spectra: [u32; 4],
    pub weights: [f32; 4],
}

impl Mix {
    /// The mixture of `all`, `[..][W]`, not negative, to `put` in groups: at which wavelength one begins, and its numbers.
    #[inline(always)]
    pub fn blend(&self, all: &[f32], w: usize, mut put: impl FnMut(usize, &[f32])) {
        let [own, a, b, c] = self.spectra;
        let of = |which: u32| &all[which as usize * w..][..w];
        let spectra = [of(own), of(a), of(b), of(c)];
        // Most counts of wavelengths are made of eights and fours.
        let mut done = self.blend_by::<8>(spectra, 0, &mut put);
        done = self.blend_by::<4>(spectra, done, &mut put);
        self.blend_by::<1>(spectra, done, &mut put);
    }

    /// As many whole groups of `N` as follow from wavelength `start`; where they end.
    #[inline(always)]
    fn blend_by<'s, const N: usize>(
        &self,
        spectra: [&'s [f32]; 4],
        start: usize,
        put: &mut impl FnMut(usize, &[f32]),
    ) -> usize {
        let [own, ta, tb, tc] = self.weights;
        let [m, a, b, c] = spectra;
        let rest = |of: &'s [f32]| of[start..].as_chunks::<N>().0;
        let (m, a, b, c) = (rest(m), rest(a), rest(b), rest(c));
        let mut at = start;
        for (((m, a), b), c) in m.iter().zip(a).zip(b).zip(c) {
            let mut group = [0.0; N];
            for k in 0..N {
                let sum = own * m[k] + (ta * a[k] + tb * b[k] + tc * c[k]);
                group[k] = if sum > 0.0 { sum } else { 0.0 };
            }
            put(at, &group);
            at += N;
        }
        at
    }
}

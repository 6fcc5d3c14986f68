//! What a place within an element takes from the element's centre and from the nodes of its border.

use glam::DVec2;

/// Weights on the centre and on three nodes; sum 1.
pub(super) struct Shares {
    pub centre: f64,
    /// Which nodes of the element's border.
    pub nodes: [usize; 3],
    pub weights: [f64; 3],
}

/// Bilinear in the quarter of a quad element that holds `local` (0 to 1 each way).
#[inline(always)]
pub(super) fn quarter(local: DVec2) -> Shares {
    // The border runs corner, middle, corner, ... from (0, 0) counter-clockwise.
    let (right, upper) = (usize::from(local.x > 0.5), usize::from(local.y > 0.5));
    let corner = 2 * (3 * upper ^ right);
    let DVec2 { x: s, y: t } = (2.0 * (local - 0.5)).abs();
    Shares {
        centre: (1.0 - s) * (1.0 - t),
        // The middle of the edge to the left or right, then that of the edge below or above.
        nodes: [7 - 4 * right, 1 + 4 * upper, corner],
        weights: [s * (1.0 - t), (1.0 - s) * t, s * t],
    }
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
    Shares { centre: 1.0 - s - t, nodes: [best, next, next], weights: [s, t, 0.0] }
}

/// The spectrum of shares `own` of `centre` and `weights` of `nodes`, not negative; all are as long as `out`. Weights of
/// at most 1 lose nothing in `f32`.
#[inline(always)]
pub(super) fn blend(own: f32, centre: &[f32], weights: [f32; 3], nodes: [&[f32]; 3], out: &mut [f32]) {
    // Most counts of wavelengths are made of these.
    let done = blend_by::<8>(own, centre, weights, nodes, out);
    let done =
        done + blend_by::<4>(own, &centre[done..], weights, nodes.map(|n| &n[done..]), &mut out[done..]);
    blend_by::<1>(own, &centre[done..], weights, nodes.map(|n| &n[done..]), &mut out[done..]);
}

/// [`blend`] of as many whole groups of `N` as there are; how many numbers that was.
#[inline(always)]
fn blend_by<const N: usize>(
    own: f32,
    centre: &[f32],
    [ta, tb, tc]: [f32; 3],
    nodes: [&[f32]; 3],
    out: &mut [f32],
) -> usize {
    let (out, [a, b, c]) = (out.as_chunks_mut::<N>().0, nodes.map(|node| node.as_chunks::<N>().0));
    for ((((out, m), a), b), c) in out.iter_mut().zip(centre.as_chunks::<N>().0).zip(a).zip(b).zip(c) {
        // A place of its own lets the compiler see that nothing overlaps.
        let mut group = [0.0; N];
        for k in 0..N {
            let sum = own * m[k] + (ta * a[k] + tb * b[k] + tc * c[k]);
            group[k] = if sum > 0.0 { sum } else { 0.0 };
        }
        *out = group;
    }
    N * out.len()
}

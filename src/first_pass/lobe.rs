//! The rough specular lobe B = R_s / F between two directions of a sample point (section 2.2), spread by
//! the sizes of the elements it connects.

use super::directions::{Bounds, Direction, LANES, Lanes, lanes};
use crate::material::microfacet::rs_over_f_lanes;
use std::f32::consts::PI;

/// The cone of section 3.2 ends where exp(-tan²α / m²) is 1e-2: tan²α = 4.6 m². The share of
/// the facets beyond is 1e-2 as well, and the normalisation puts it back.
const CUT: f32 = 4.605_17;

/// How much wider than its own variance the specular element makes the lobe. Mirror elements stand in
/// a raster of pitch h; Gaussians of deviation σ at that pitch ripple by 2 exp(-2 π² σ² / h²), and
/// σ² / h² is this number / 4π: 3 leaves 2 %, where equal variances (1) would leave 40 %.
const BLUR: f32 = 3.0;

/// What the rough lobe needs to know of an element.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extent {
    /// Slope variance (as m²) from the size of the element.
    pub spread: f32,
    /// Square root of the slope variance from the size of the specular element.
    pub blur: f32,
}

/// [`Extent`] of [`LANES`] elements.
#[derive(Clone, Copy, Debug)]
pub struct Extents {
    spread: Lanes,
    blur: Lanes,
}

impl Extent {
    /// Of an element of solid angle `omega` under cosine `cosine`, where the specular element's longer side is
    /// seen under `angle` (side / distance).
    ///
    /// A disc of that size has the variance Ω / 4π along either axis, the half vector turns half as
    /// much, and m² is twice the variance of the slope along an axis. Across the plane of incidence the slope
    /// varies 1 / cos θ times as much; the lobe is round, so the mean of both counts (cos θ no less than 0.1).
    pub fn new(omega: f32, angle: f32, cosine: f32) -> Self {
        let oblique = 0.5 * (1.0 + 1.0 / (cosine * cosine).max(0.01));
        Extent { spread: omega / (8.0 * PI) * oblique, blur: angle * (BLUR / (8.0 * PI) * oblique).sqrt() }
    }
}

impl Extents {
    /// Of a group of directions.
    pub fn new(group: &[Direction]) -> Self {
        Extents { spread: lanes(group, |d| d.rough.spread), blur: lanes(group, |d| d.rough.blur) }
    }

    /// Of one direction.
    #[inline(always)]
    pub fn get(&self, l: usize) -> Extent {
        Extent { spread: self.spread[l], blur: self.blur[l] }
    }
}

/// m² of the lobe between `a` and an element of the given spread and blur, at most 1.
#[inline(always)]
fn effective(m2: f32, a: &Extent, spread: f32, blur: f32) -> f32 {
    let both = a.blur + blur;
    (m2 + a.spread + spread + both * both).min(1.0)
}

/// A bit for each group that the lobe of `a` may reach.
#[inline(always)]
pub fn reached(bounds: &Bounds, a: &Direction, m2: f32) -> u32 {
    let mut reached = [0u32; LANES];
    for (l, reached) in reached.iter_mut().enumerate() {
        // Distance of the mirrored direction from the group's box.
        let (x, y) = (bounds.gap(0, l, a.to[0]), bounds.gap(1, l, a.to[1]));
        let z = a.to[2] + bounds.z[l];
        let widest = effective(m2, &a.rough, bounds.most[0][l], bounds.most[1][l]);
        *reached = u32::from(x * x + y * y <= 1.001 * CUT * widest * z * z) << l;
    }
    reached.iter().fold(0, |all, bit| all | bit)
}

/// The lobe between `a` and a group: (B, cosine of the angle of incidence on the facet). B is 0 outside
/// the cone.
#[inline(always)]
pub fn between(a: &Direction, [x, y, z]: [&Lanes; 3], group: &Extents, m2: f32) -> Option<(Lanes, Lanes)> {
    let [ax, ay, az] = a.to;
    let mut t2 = [0.0; LANES];
    let mut z2 = [0.0; LANES];
    let mut width = [0.0; LANES];
    let mut inside = [0u32; LANES];
    for l in 0..LANES {
        let (sx, sy, sz) = (x[l] + ax, y[l] + ay, z[l] + az);
        t2[l] = sx * sx + sy * sy;
        z2[l] = sz * sz;
        width[l] = effective(m2, &a.rough, group.spread[l], group.blur[l]);
        inside[l] = u32::from((t2[l] <= CUT * width[l] * z2[l]) & (z[l] > 0.0));
    }
    if inside.iter().fold(0, |any, inside| any | inside) == 0 || az <= 0.0 {
        return None;
    }
    let value = rs_over_f_lanes(&t2, az, z, &width);
    let mut b = [0.0; LANES];
    let mut cosine = [0.0; LANES];
    for l in 0..LANES {
        b[l] = if inside[l] != 0 { value[l] } else { 0.0 };
        // Only the roughness tilts facets; the width that elements add does not.
        cosine[l] = 0.5 * (z2[l] + t2[l] * m2 / width[l]).sqrt();
    }
    Some((b, cosine))
}

#[cfg(test)]
mod tests {
    use super::super::directions::{Directions, Origin};
    use super::*;
    use crate::material::microfacet::rs_over_f;

    #[test]
    fn the_lobe_is_reciprocal_and_is_the_papers() {
        let direction = |x: f32, y: f32| Direction {
            to: [x, y, (1.0 - x * x - y * y).sqrt()],
            weight: 1.0,
            ..Default::default()
        };
        let (a, b) = (direction(-0.5, 0.2), direction(0.3, -0.1));
        let m: f32 = 0.3;
        let both = Directions::new(Origin { m2: m * m, ..Default::default() }, &[a, b]);
        let (forth, cos_h) = both.lobe_at(&a, 1);
        let (back, _) = both.lobe_at(&b, 0);
        assert!((forth / back - 1.0).abs() < 1e-5);
        let (a, b) = (glam::Vec3::from(a.to), glam::Vec3::from(b.to));
        let h = (a + b).normalize();
        let [ni, nr, nh, ih] = [a.z, b.z, h.z, h.dot(a)].map(f64::from);
        assert!((f64::from(cos_h) - ih).abs() < 1e-5);
        let expected = rs_over_f(ni, nr, nh, ih, f64::from(m));
        assert!((f64::from(forth) / expected - 1.0).abs() < 1e-4, "{forth} {expected}");
    }
}

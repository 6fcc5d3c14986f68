//! Directions of the specular lobe, and of ideal reflection and refraction.

use crate::material::microfacet;
use glam::DVec3;

/// The mirror direction of `i` at a surface of normal `n`; all unit and pointing away from it.
#[inline]
pub fn reflect(i: DVec3, n: DVec3) -> DVec3 {
    2.0 * n.dot(i) * n - i
}

/// The refracted direction of `i` (away from the surface, on the side of `n`) where `eta` is the
/// index on that side over the index on the other; `None` beyond the critical angle.
#[inline]
pub fn refract(i: DVec3, n: DVec3, eta: f64) -> Option<DVec3> {
    let cos_i = n.dot(i);
    let cos2_t = 1.0 - eta * eta * (1.0 - cos_i * cos_i).max(0.0);
    (cos2_t > 0.0).then(|| ((eta * cos_i - cos2_t.sqrt()) * n - eta * i).normalize())
}

/// The normal of a facet of slope `m` about `n` (section 2.2) as `i` sees them, for three uniform
/// numbers in [0, 1).
///
/// A V-shaped groove has two facets, mirrored about `n`. Of a pair drawn from the distribution one is
/// chosen by the area that it shows to `i` (E. Heitz and E. d'Eon, *Importance Sampling Microfacet-Based
/// BSDFs using the Distribution of Visible Normals*, 2014). The density is D G₁(i) i·h / (π n·i).
#[inline]
pub fn sample_facet(i: DVec3, n: DVec3, m: f64, u: [f32; 3]) -> DVec3 {
    let h = microfacet::sample_half_vector(m, f64::from(u[0]), f64::from(u[1]));
    let (x, y) = n.any_orthonormal_pair();
    let (across, along) = (h.x * x + h.y * y, h.z * n);
    let [one, other] = [along + across, along - across].map(|h| i.dot(h).max(0.0));
    if f64::from(u[2]) * (one + other) < one { along + across } else { along - across }
}

/// R^s cos θ_r over the density of the direction `r` that the facet `h` of [`sample_facet`] reflects,
/// less F: G/G₁(i), 0 to 1. Zero where the direction leaves through the surface.
#[inline]
pub fn lobe_weight(i: DVec3, r: DVec3, h: DVec3, n: DVec3) -> f64 {
    let (ni, nr, nh, ih) = (n.dot(i), n.dot(r), n.dot(h), i.dot(h));
    let seen = microfacet::masking_g(nh, ni, ni, ih);
    if seen > 0.0 { (microfacet::masking_g(nh, ni, nr, ih) / seen).min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean weight over the samples is the directional albedo for F = 1, known from
    /// quadrature (data/expected/cook_torrance_albedo.json).
    #[test]
    fn mean_weight_is_the_directional_albedo() {
        for (m, degrees, albedo) in [
            (0.1, 0.0f64, 1.0000),
            (0.1, 80.0, 0.9417),
            (0.3, 30.0, 0.9812),
            (0.3, 60.0, 0.9248),
            (0.6, 0.0, 0.7976),
            (1.0, 60.0, 0.7917),
        ] {
            let n = DVec3::new(0.48, 0.6, 0.64);
            let across = n.any_orthonormal_vector();
            let (sin, cos) = degrees.to_radians().sin_cos();
            let i = sin * across + cos * n;
            let samples = 1 << 16;
            let mut sum = 0.0;
            for k in 0..samples {
                let [a, b, c, _] = sobol_burley::sample_4d(k, 0, 1);
                let h = sample_facet(i, n, m, [a, b, c]);
                let r = reflect(i, h);
                sum += lobe_weight(i, r, h, n);
            }
            let mean = sum / f64::from(samples);
            assert!((mean - albedo).abs() < 4e-4, "m {m} at {degrees}: {mean} for {albedo}");
        }
    }

    #[test]
    fn refraction_obeys_snell_and_can_be_undone() {
        let n = DVec3::Z;
        let i = DVec3::new(0.6, 0.0, 0.8);
        let t = refract(i, n, 1.0 / 1.5).unwrap();
        assert!((t.x + 0.4).abs() < 1e-12 && t.z < 0.0);
        let back = refract(t, -n, 1.5).unwrap();
        assert!((back - i).length() < 1e-12, "the way back is the way there");
        assert!(refract(DVec3::new(0.8, 0.0, 0.6), n, 1.5).is_none(), "total internal reflection");
    }
}

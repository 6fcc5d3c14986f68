//! Directions of the specular lobe, and of ideal reflection and refraction.

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

/// A microfacet normal about `n` with density D cos α / π (section 2.2, Beckmann), for two
/// uniform numbers in [0, 1).
#[inline]
pub fn sample_beckmann(n: DVec3, m: f64, u: [f32; 2]) -> DVec3 {
    let tan2 = -m * m * (1.0 - f64::from(u[0])).ln();
    let cos = 1.0 / (1.0 + tan2).sqrt();
    let sin = cos * tan2.sqrt();
    let (sin_phi, cos_phi) = (std::f64::consts::TAU * f64::from(u[1])).sin_cos();
    let (x, y) = n.any_orthonormal_pair();
    sin * (cos_phi * x + sin_phi * y) + cos * n
}

/// R^s cos θ_r over the density of the sample, less F: G (i·h) / ((n·i) (n·h)) with the V-cavity
/// G of Cook and Torrance. Zero where the direction leaves through the surface; never over 2.
#[inline]
pub fn lobe_weight(i: DVec3, r: DVec3, h: DVec3, n: DVec3) -> f64 {
    let (ni, nr, nh, ih) = (n.dot(i), n.dot(r), n.dot(h), i.dot(h));
    if nr <= 0.0 || nh <= 0.0 || ih <= 0.0 {
        return 0.0;
    }
    let ni = ni.max(1e-9);
    // G written out, so that nothing small divides something small at grazing incidence.
    (ih / (ni * nh)).min(2.0).min(2.0 * nr / ni)
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
                let [a, b, ..] = sobol_burley::sample_4d(k, 0, 1);
                let h = sample_beckmann(n, m, [a, b]);
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

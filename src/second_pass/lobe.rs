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

/// How densely the direction that the facet `h` reflects is drawn by [`sample_facet`], 1/sr: D G₁(i) i·h / (π n·i) of
/// facets, and 1/(4 i·h) of it of directions.
#[inline]
pub fn lobe_density(i: DVec3, h: DVec3, n: DVec3, m: f64) -> f64 {
    let (ni, nh, ih) = (n.dot(i), n.dot(h), i.dot(h));
    let seen = microfacet::masking_g(nh, ni, ni, ih);
    if seen > 0.0 { microfacet::beckmann_d(nh, m) * seen / (4.0 * std::f64::consts::PI * ni) } else { 0.0 }
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
    use std::f64::consts::TAU;

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

    /// Independent uniform numbers in [0, 1), the same in every run.
    struct Random(u64);

    impl Random {
        fn next(&mut self) -> f32 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 40) as f32 / (1u64 << 24) as f32
        }
    }

    /// The direction at `degrees` from the normal (0, 0, 1).
    fn at(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(sin, 0.0, cos)
    }

    /// Cells of steepness and azimuth, equally likely under D cos α/π.
    const CELLS: [usize; 2] = [8, 12];

    /// The facet whose chance of a steeper one is `u` and whose azimuth is `v` turns; the cell's own
    /// coordinates undo it.
    fn facet(m: f64, [u, v]: [f64; 2]) -> DVec3 {
        let tan = m * (-u.ln()).sqrt();
        let (sin, cos) = (TAU * v).sin_cos();
        DVec3::new(tan * cos, tan * sin, 1.0).normalize()
    }

    fn cell(m: f64, h: DVec3) -> usize {
        let u = (-(h.x * h.x + h.y * h.y) / (h.z * h.z * m * m)).exp();
        let v = (h.y.atan2(h.x) / TAU).rem_euclid(1.0);
        let index = |x: f64, n: usize| ((x * n as f64) as usize).min(n - 1);
        index(u, CELLS[0]) * CELLS[1] + index(v, CELLS[1])
    }

    /// The chance of each cell under the density D G₁(i) i·h / (π n·i): a fine midpoint sum of what
    /// that is over D cos α/π.
    fn chances(m: f64, i: DVec3) -> Vec<f64> {
        const FINE: usize = 64;
        let mut chances = vec![0.0; CELLS[0] * CELLS[1]];
        let total = [CELLS[0] * FINE, CELLS[1] * FINE];
        for a in 0..total[0] {
            for b in 0..total[1] {
                let x = |k: usize, axis: usize| (k as f64 + 0.5) / total[axis] as f64;
                let h = facet(m, [x(a, 0), x(b, 1)]);
                let (ni, nh, ih) = (i.z, h.z, i.dot(h));
                let relative = microfacet::masking_g(nh, ni, ni, ih) * ih.max(0.0) / (ni * nh);
                chances[a / FINE * CELLS[1] + b / FINE] += relative / (total[0] * total[1]) as f64;
            }
        }
        chances
    }

    #[test]
    fn sampled_facets_pass_a_chi_square_test_against_their_density() {
        let samples = 40_000;
        for m in [1e-3, 0.01, 0.1, 0.3, 1.0, 2.0] {
            for degrees in [0.0, 30.0, 60.0, 80.0, 89.0] {
                let i = at(degrees);
                let chances = chances(m, i);
                assert!((chances.iter().sum::<f64>() - 1.0).abs() < 2e-3, "{m} {degrees}");
                let mut counts = vec![0.0; chances.len()];
                let mut random = Random(1 + degrees as u64);
                for _ in 0..samples {
                    let u = [random.next(), random.next(), random.next()];
                    counts[cell(m, sample_facet(i, DVec3::Z, m, u))] += 1.0;
                }
                // Cells too rare for the test's approximation are pooled.
                let (mut chi2, mut cells, mut rare) = (0.0, 0.0_f64, [0.0; 2]);
                for (count, chance) in counts.iter().zip(&chances) {
                    let expected = f64::from(samples) * chance;
                    if expected < 5.0 {
                        rare = [rare[0] + count, rare[1] + expected];
                    } else {
                        chi2 += (count - expected) * (count - expected) / expected;
                        cells += 1.0;
                    }
                }
                if rare[1] > 0.0 {
                    chi2 += (rare[0] - rare[1]) * (rare[0] - rare[1]) / rare[1].max(5.0);
                }
                // A chance of about 1e-4 each to fail by accident (Wilson and Hilferty).
                let free = cells - 1.0;
                let limit = free * (1.0 - 2.0 / (9.0 * free) + 3.72 * (2.0 / (9.0 * free)).sqrt()).powi(3);
                println!(
                    "m {m} at {degrees}: chi-square {chi2:.1}, {free} degrees of freedom, limit {limit:.1}"
                );
                assert!(chi2 < limit, "m {m} at {degrees}: {chi2} over {limit}");
            }
        }
    }

    /// A lobe that narrows becomes the mirror, in direction and in strength, at every angle.
    #[test]
    fn a_narrow_lobe_joins_the_mirror() {
        for degrees in [0.0, 45.0, 80.0, 89.0] {
            let i = at(degrees);
            let mirror = reflect(i, DVec3::Z);
            for m in [1e-3, 1e-4, 1e-5] {
                let (mut weight, mut spread) = (0.0, 0.0_f64);
                let mut random = Random(7);
                for _ in 0..4000 {
                    let h = sample_facet(i, DVec3::Z, m, [random.next(), random.next(), random.next()]);
                    let r = reflect(i, h);
                    weight += lobe_weight(i, r, h, DVec3::Z) / 4000.0;
                    spread = spread.max(r.angle_between(mirror));
                }
                // No facet is steeper than sqrt(ln 2²⁴) m, and the direction turns twice as far.
                assert!(spread < 8.4 * m, "m {m} at {degrees}: {spread}");
                let lost = 1.0 - weight;
                assert!((0.0..=0.2 * m / i.z).contains(&lost), "m {m} at {degrees}: {lost}");
            }
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

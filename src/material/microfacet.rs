//! The rough reflection of section 2.2: Beckmann's distribution and the V-cavities of Cook and Torrance.
//!
//! `ni`, `nr`, `nh` are the cosines between the normal and the incident direction, the reflected
//! direction and the half vector, `ih` that between incident direction and half vector; `m` is the
//! root-mean-square slope of the facets. `m = 0`, the perfect mirror, is the caller's: a slope under
//! [`MIN_ROUGHNESS`] is treated as that.

use super::bounded;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// The smallest slope that is evaluated: far narrower than any pixel.
pub const MIN_ROUGHNESS: f64 = 1e-6;

/// D = exp(-tan²α/m²)/(m² cos⁴α), without 1/π: ∫ D cos α/π dω = 1. Zero at and below the horizon.
pub fn beckmann_d(cos_alpha: f64, m: f64) -> f64 {
    if cos_alpha.is_nan() || cos_alpha <= 0.0 {
        return 0.0;
    }
    let (m2, cos2) = (m.max(MIN_ROUGHNESS).powi(2), cos_alpha.min(1.0).powi(2));
    let exponent = (1.0 - cos2) / (cos2 * m2);
    if exponent > 700.0 { 0.0 } else { (-exponent).exp() / (m2 * cos2 * cos2) }
}

/// G = min(1, 2 nh nr/ih, 2 nh ni/ih): masking and shadowing in V-shaped grooves. Zero where a cosine
/// is not positive.
pub fn masking_g(nh: f64, ni: f64, nr: f64, ih: f64) -> f64 {
    if nh > 0.0 && ni > 0.0 && nr > 0.0 && ih > 0.0 { (2.0 * nh * nr.min(ni) / ih).min(1.0) } else { 0.0 }
}

/// R_s/F = D G/(4π ni nr), 1/sr (section 2.2). Zero where a direction is at or below the horizon.
pub fn rs_over_f(ni: f64, nr: f64, nh: f64, ih: f64, m: f64) -> f64 {
    let g = masking_g(nh, ni, nr, ih);
    // G/(ni nr) is bounded by 2 nh/(ih max(ni, nr)); taken apart it overflows at grazing angles.
    if g > 0.0 { (beckmann_d(nh, m) * (g / ni.min(nr)) / (4.0 * PI * ni.max(nr))).min(f64::MAX) } else { 0.0 }
}

/// [`rs_over_f`] in single precision for inner loops, `LANES` directions at a time: `t2` is the squared tangential
/// length of the sum of the two unit directions, `ni` and `nr` their cosines, `m2` is m². Within a relative 1e-4 where
/// tan²α <= 6 m², and held at 6 m² beyond; the cosines must be positive.
#[inline(always)]
pub fn rs_over_f_lanes<const LANES: usize>(
    t2: &[f32; LANES],
    ni: f32,
    nr: &[f32; LANES],
    m2: &[f32; LANES],
) -> [f32; LANES] {
    let mut value = [0.0; LANES];
    for l in 0..LANES {
        // tan²α = t2 / z2 and cos²α = z2 / v2, arranged to divide twice.
        let z2 = (ni + nr[l]) * (ni + nr[l]);
        let v2 = t2[l] + z2;
        let slope = 1.0 / (z2 * m2[l]);
        let d_g = exp_minus(t2[l] * slope) * v2 * v2.min(4.0 * (nr[l] + ni) * nr[l].min(ni));
        value[l] = d_g * slope / (4.0 * std::f32::consts::PI * ni * nr[l] * z2);
    }
    value
}

/// exp(-x) for x from 0 to 6 to a relative 2e-5 (x held at 6), in a form that compilers vectorise.
#[inline(always)]
fn exp_minus(x: f32) -> f32 {
    let y = -x.min(6.0) * (1.0 / 16.0);
    let p = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * (1.0 / 120.0 + y / 720.0)))));
    let p2 = p * p;
    let p4 = p2 * p2;
    let p8 = p4 * p4;
    p8 * p8
}

/// A half vector about the normal (0, 0, 1), with density D cos α/π per solid angle: see [`half_vector_pdf`].
/// `u1`, `u2` are uniform in 0..1.
pub fn sample_half_vector(m: f64, u1: f64, u2: f64) -> DVec3 {
    let u1 = bounded(u1, 0.0, 1.0 - f64::EPSILON);
    let tan2 = -m.max(MIN_ROUGHNESS).powi(2) * (-u1).ln_1p();
    let cos = 1.0 / (1.0 + tan2).sqrt();
    let sin = tan2.sqrt() * cos;
    let (sin_phi, cos_phi) = (TAU * u2).sin_cos();
    DVec3::new(sin * cos_phi, sin * sin_phi, cos)
}

/// Density of [`sample_half_vector`], 1/sr of half vectors: D cos α/π. The density of the direction
/// reflected about the half vector is this divided by 4 `ih`.
pub fn half_vector_pdf(cos_alpha: f64, m: f64) -> f64 {
    beckmann_d(cos_alpha, m) * bounded(cos_alpha, 0.0, 1.0) / PI
}

/// What a direction reflected about a sampled half vector carries, F apart: (R_s/F) nr over its density,
/// G ih/(ni nh). At most 2; zero where the direction lies below the horizon.
pub fn sample_weight(ni: f64, nr: f64, nh: f64, ih: f64) -> f64 {
    let g = masking_g(nh, ni, nr, ih);
    if g > 0.0 { (g * ih / (ni * nh)).min(2.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distribution_is_normalised() {
        for m in [1e-4, 0.05, 0.3, 1.0, 2.0] {
            // ∫ D cos α/π dω over x = tan α/m, cos α = 1/sqrt(1 + m² x²).
            let steps = 200_000;
            let sum: f64 = (0..steps)
                .map(|i| {
                    let x = 20.0 * (f64::from(i) + 0.5) / f64::from(steps);
                    let cos = 1.0 / (1.0 + (m * x).powi(2)).sqrt();
                    beckmann_d(cos, m) * 2.0 * m * m * x * cos.powi(4) * 20.0 / f64::from(steps)
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-6, "{m}: {sum}");
        }
    }

    #[test]
    fn single_precision_follows_double() {
        for i in 0..=100 {
            let x = 0.06 * i as f32;
            assert!((exp_minus(x) / (-x).exp() - 1.0).abs() < 2e-5);
        }
        let direction =
            |theta: f64, phi: f64| DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        for m in [0.02, 0.1, 0.3, 1.0] {
            for (theta_i, theta_r, phi) in
                [(0.0, 0.01, 0.0), (0.5, 0.52, 3.1), (1.2, 1.3, 3.0), (1.5, 0.9, 2.0)]
            {
                let (a, b) = (direction(theta_i, 0.0), direction(theta_r, phi));
                let (sum, h) = (a + b, (a + b).normalize());
                let expected = rs_over_f(a.z, b.z, h.z, h.dot(a), m);
                if (1.0 / (h.z * h.z) - 1.0) / (m * m) < 6.0 {
                    let t2 = [(sum.x * sum.x + sum.y * sum.y) as f32];
                    let [found] = rs_over_f_lanes(&t2, a.z as f32, &[b.z as f32], &[(m * m) as f32]);
                    assert!(
                        (f64::from(found) / expected - 1.0).abs() < 1e-4,
                        "{m} {theta_i}: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn reciprocal_finite_and_never_negative() {
        let odd = [-1.0, 0.0, 1e-300, 1e-12, 0.3, 1.0, 1.0 + 1e-9, f64::NAN];
        for ni in odd {
            for nr in odd {
                for nh in odd {
                    for m in [0.0, 1e-4, 0.3, 2.0, f64::NAN] {
                        let r = rs_over_f(ni, nr, nh, 0.5, m);
                        assert!(r >= 0.0 && r.is_finite(), "{ni} {nr} {nh} {m}: {r}");
                        assert_eq!(r, rs_over_f(nr, ni, nh, 0.5, m));
                        assert!(sample_weight(ni, nr, nh, 0.5) <= 2.0);
                        assert!(half_vector_pdf(nh, m).is_finite());
                    }
                }
            }
        }
    }

    /// The sampled tangents follow the distribution: chi-square on 32 cells of equal probability.
    #[test]
    fn samples_follow_their_density() {
        let (m, side) = (0.4, 512);
        let mut cells = [0.0_f64; 32];
        for i in 0..side * side {
            // A fixed, well-spread set of points.
            let u1 = (f64::from(i) + 0.5) / f64::from(side * side);
            let u2 = (f64::from(i) * 0.618_033_988_749_895).fract();
            let h = sample_half_vector(m, u1, u2);
            assert!((h.length() - 1.0).abs() < 1e-12 && h.z > 0.0);
            // Chance of a steeper facet, and the quadrant.
            let steeper = (-(1.0 / (h.z * h.z) - 1.0) / (m * m)).exp();
            let quadrant = usize::from(h.x > 0.0) + 2 * usize::from(h.y > 0.0);
            cells[8 * quadrant + ((8.0 * steeper) as usize).min(7)] += 1.0;
        }
        let expected = f64::from(side * side) / 32.0;
        let chi2: f64 = cells.iter().map(|c| (c - expected).powi(2) / expected).sum();
        assert!(chi2 < 50.0, "{chi2} {cells:?}");
    }
}

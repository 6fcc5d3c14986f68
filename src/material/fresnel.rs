//! The Fresnel factor (Born and Wolf; the paper's section 2.2 and appendix).
//!
//! Cosines are clamped to 0..1 and indices to 0..1e6 (not a number counts as 0), so every result is
//! a reflectance between 0 and 1.

use super::bounded;

/// Power reflectances `[R_s, R_p]` from vacuum (or air) onto a medium of index n + ik. Total reflection included: for
/// n < 1 and k = 0 both are 1 beyond the critical angle.
pub fn polarised(cos_theta: f64, n: f64, k: f64) -> [f64; 2] {
    let [n, k] = [n, k].map(|x| bounded(x, 0.0, 1e6));
    let c = bounded(cos_theta, 0.0, 1.0);
    if n == 1.0 && k == 0.0 {
        // No boundary: at grazing incidence the formula below is 0/0.
        return [0.0, 0.0];
    }
    // a + ib = sqrt((n + ik)² - sin²θ), the larger part from a sum without cancellation.
    let sin2 = 1.0 - c * c;
    let square = [(n - k) * (n + k) - sin2, 2.0 * n * k];
    let modulus = square[0].hypot(square[1]);
    let larger = (0.5 * (modulus + square[0].abs())).sqrt();
    let smaller = if larger > 0.0 { 0.5 * square[1] / larger } else { 0.0 };
    let (a, b) = if square[0] >= 0.0 { (larger, smaller) } else { (smaller, larger) };
    // |x - y|² / |x + y|² for real parts x y and the imaginary part they share; 0/0 is total reflection.
    let ratio = |x: f64, y: f64, imaginary: f64| {
        let (difference, sum) =
            ((x - y).powi(2) + imaginary * imaginary, (x + y).powi(2) + imaginary * imaginary);
        if sum > 0.0 { (difference / sum).min(1.0) } else { 1.0 }
    };
    let s = ratio(c, a, b);
    [s, s * ratio(a * c, sin2, b * c)]
}

/// F of unpolarised light from outside: the mean of R_s and R_p. The second method of the paper's appendix.
pub fn unpolarised(cos_theta: f64, n: f64, k: f64) -> f64 {
    let [s, p] = polarised(cos_theta, n, k);
    0.5 * (s + p)
}

/// F of unpolarised light met from inside a transparent medium of index n, against the cosine inside;
/// 1 beyond the critical angle.
pub fn inside(cos_theta: f64, n: f64) -> f64 {
    if n > 0.0 { unpolarised(cos_theta, 1.0 / n, 0.0) } else { 1.0 }
}

/// F(λ, θ) by the first method of the paper's appendix: from F(λ, 0) = `normal` and the course of the
/// factor of one index n + ik (at 589 nm), with F(λ, π/2) = 1. Good for glass (6e-4) and silver (8e-3), not
/// for gold in the blue (off by up to 0.13).
pub fn scaled(cos_theta: f64, normal: f64, n: f64, k: f64) -> f64 {
    let normal = bounded(normal, 0.0, 1.0);
    let at_normal = unpolarised(1.0, n, k);
    if at_normal >= 1.0 {
        return normal;
    }
    let course = (unpolarised(cos_theta, n, k) - at_normal) / (1.0 - at_normal);
    (normal + (1.0 - normal) * course).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_input_gives_anything_but_a_reflectance() {
        let odd = [
            0.0,
            -1.0,
            1e-300,
            1e-9,
            0.05,
            0.5,
            1.0 - 1e-16,
            1.0,
            1.0 + 1e-7,
            1.5,
            10.0,
            1e12,
            f64::INFINITY,
            f64::NAN,
        ];
        for cos in odd {
            for n in odd {
                for k in odd {
                    let [s, p] = polarised(cos, n, k);
                    for f in [s, p, scaled(cos, k, n, k), inside(cos, n)] {
                        assert!((0.0..=1.0).contains(&f), "{cos} {n} {k}: {f}");
                    }
                }
            }
        }
    }

    #[test]
    fn special_angles() {
        assert!((unpolarised(1.0, 1.52, 0.0) - (0.52_f64 / 2.52).powi(2)).abs() < 1e-15);
        let brewster = 1.5_f64.atan().cos();
        assert!(polarised(brewster, 1.5, 0.0)[1] < 1e-30);
        assert_eq!(unpolarised(0.0, 1.5, 0.0), 1.0);
        let critical = (1.0 - 1.0 / (1.5 * 1.5_f64)).sqrt();
        assert_eq!(inside(critical - 1e-6, 1.5), 1.0);
        assert!(inside(critical + 1e-3, 1.5) < 0.9);
    }

    /// Light reversed along its refracted path meets the same reflectance.
    #[test]
    fn inside_and_outside_agree_along_one_path() {
        for i in 1..=100 {
            let cos_inside = 1.0 - 0.0024 * f64::from(i);
            let cos_outside = (1.0 - 1.45 * 1.45 * (1.0 - cos_inside * cos_inside)).sqrt();
            assert!((inside(cos_inside, 1.45) - unpolarised(cos_outside, 1.45, 0.0)).abs() < 1e-12);
        }
    }
}

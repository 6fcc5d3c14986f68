//! CIELAB and its colour differences.

/// CIE 1976 L\*a\*b\* of XYZ against a white in the same unit. Components that are not positive are on the
/// linear branch of the definition; a white that is not positive gives 0.
pub fn lab(xyz: [f64; 3], white: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let f = |c: usize| {
        let t = if white[c] > 0.0 { xyz[c] / white[c] } else { 0.0 };
        if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [fx, fy, fz] = [0, 1, 2].map(f);
    [116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)]
}

/// ΔE\*ab, CIE 1976: the distance in L\*a\*b\*.
pub fn delta_e_76(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// ΔE00 of two L\*a\*b\* colours (CIE 142-2001; ISO/CIE 11664-6), parametric factors 1.
pub fn delta_e_2000(first: [f64; 3], second: [f64; 3]) -> f64 {
    const POW25_7: f64 = 6_103_515_625.0;
    let chroma_share = |c: f64| {
        let c7 = c.powi(7);
        // Beyond any colour the seventh power overflows; its share is then 1.
        if c7.is_finite() { (c7 / (c7 + POW25_7)).sqrt() } else { 1.0 }
    };
    let [l1, a1, b1] = first;
    let [l2, a2, b2] = second;
    let g = 0.5 * (1.0 - chroma_share(0.5 * (a1.hypot(b1) + a2.hypot(b2))));
    let (a1, a2) = ((1.0 + g) * a1, (1.0 + g) * a2);
    let (c1, c2) = (a1.hypot(b1), a2.hypot(b2));
    let hue =
        |a: f64, b: f64| if a == 0.0 && b == 0.0 { 0.0 } else { b.atan2(a).to_degrees().rem_euclid(360.0) };
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));
    let grey = c1 * c2 == 0.0;

    let turn = if grey {
        0.0
    } else if h2 - h1 > 180.0 {
        h2 - h1 - 360.0
    } else if h2 - h1 < -180.0 {
        h2 - h1 + 360.0
    } else {
        h2 - h1
    };
    let delta_h = 2.0 * (c1 * c2).sqrt() * (0.5 * turn).to_radians().sin();

    let (l, c) = (0.5 * (l1 + l2), 0.5 * (c1 + c2));
    let h = if grey {
        h1 + h2
    } else if (h1 - h2).abs() <= 180.0 {
        0.5 * (h1 + h2)
    } else if h1 + h2 < 360.0 {
        0.5 * (h1 + h2 + 360.0)
    } else {
        0.5 * (h1 + h2 - 360.0)
    };
    let cos = |degrees: f64| degrees.to_radians().cos();
    let t = 1.0 - 0.17 * cos(h - 30.0) + 0.24 * cos(2.0 * h) + 0.32 * cos(3.0 * h + 6.0)
        - 0.20 * cos(4.0 * h - 63.0);
    let l50 = (l - 50.0) * (l - 50.0);
    let s_l = 1.0 + 0.015 * l50 / (20.0 + l50).sqrt();
    let s_c = 1.0 + 0.045 * c;
    let s_h = 1.0 + 0.015 * c * t;
    let rotation = 60.0 * (-((h - 275.0) / 25.0).powi(2)).exp();
    let r_t = -2.0 * chroma_share(c) * rotation.to_radians().sin();

    let (dl, dc, dh) = ((l2 - l1) / s_l, (c2 - c1) / s_c, delta_h / s_h);
    (dl * dl + dc * dc + dh * dh + r_t * dc * dh).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs that probe every branch: G. Sharma, W. Wu, E. N. Dalal, *The CIEDE2000 Color-Difference
    /// Formula* (2005), table 1.
    #[test]
    fn ciede2000_agrees_with_the_published_pairs() {
        let pairs = [
            ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
            ([50.0, 3.1571, -77.2803], [50.0, 0.0, -82.7485], 2.8615),
            ([50.0, 2.8361, -74.0200], [50.0, 0.0, -82.7485], 3.4412),
            ([50.0, -1.3802, -84.2814], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, -1.1848, -84.8006], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, -0.9009, -85.5211], [50.0, 0.0, -82.7485], 1.0000),
            ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0009], 7.1792),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0010], 7.1792),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0011], 7.2195),
            ([50.0, 2.4900, -0.0010], [50.0, -2.4900, 0.0012], 7.2195),
            ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
            ([50.0, 2.5, 0.0], [61.0, -5.0, 29.0], 22.8977),
            ([50.0, 2.5, 0.0], [56.0, -27.0, -3.0], 31.9030),
            ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
            ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
            ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
        ];
        for (a, b, expected) in pairs {
            assert!((delta_e_2000(a, b) - expected).abs() < 1e-4, "{a:?} {b:?}: {}", delta_e_2000(a, b));
            assert!((delta_e_2000(b, a) - expected).abs() < 1e-4);
        }
    }

    #[test]
    fn white_is_100_and_black_is_0() {
        let white = [0.95, 1.0, 1.09];
        assert!(delta_e_76(lab(white, white), [100.0, 0.0, 0.0]) < 1e-12);
        assert!(delta_e_76(lab([0.0; 3], white), [0.0; 3]) < 1e-12);
        assert!(lab([-0.1, -0.1, -0.1], white).iter().all(|x| x.is_finite()));
    }
}

//! How much light the rough reflection of section 2.2 returns in all directions together, F = 1.

use super::bounded;
use super::microfacet::MIN_ROUGHNESS;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Gauss-Legendre points and weights of order 5 on -1..1 (Abramowitz and Stegun, table 25.4).
const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// The slope in units of m where the outer integral ends (exp(-36) is left out), and the panels between two
/// bends of its integrand; in a table fewer do (2e-5).
const LAST_SLOPE: f64 = 6.0;
const PANELS: usize = 12;
const TABLE_PANELS: usize = 4;

/// Directional albedo ∫ R_s/F nr dω_r, light from `cos_theta`, 0 to 1; `m = 0`: 1.
///
/// Over half vectors, with density D cos α/π, the integrand is G ih/(ni nh), piecewise linear in ih = cos α ni +
/// sin α sin θ cos φ: the mean over φ is a closed form. What remains is ∫ exp(-x²) 2x dx over the slope x = tan α/m.
/// Within 1e-8 of adaptive integration.
pub fn directional_albedo(m: f64, cos_theta: f64) -> f64 {
    integrated(m, cos_theta, PANELS)
}

/// [`directional_albedo`] by so many panels.
fn integrated(m: f64, cos_theta: f64, panels: usize) -> f64 {
    if m.is_nan() || m <= 0.0 {
        return 1.0;
    }
    let m = m.clamp(MIN_ROUGHNESS, 1e3);
    // Below this the albedo no longer changes, and its terms would divide by zero.
    let ni = bounded(cos_theta, 1e-9 * m.min(1.0), 1.0);
    let bends = bends(ni.acos()).map(|alpha| (alpha.max(0.0).tan() / m).min(LAST_SLOPE));
    let mut sum = 0.0;
    for pair in bends.windows(2) {
        let width = pair[1] - pair[0];
        for panel in 0..panels {
            for (point, weight) in GAUSS {
                // x = t²(3 - 2t) of the way: it lingers at the bends, where derivatives are steep.
                let t = (panel as f64 + 0.5 + 0.5 * point) / panels as f64;
                let x = pair[0] + width * t * t * (3.0 - 2.0 * t);
                let dx = 0.5 * weight / panels as f64 * width * 6.0 * t * (1.0 - t);
                if dx > 0.0 {
                    sum += dx * 2.0 * x * (-x * x).exp() * mean_over_azimuth(ni, m * x);
                }
            }
        }
    }
    sum.clamp(0.0, 1.0)
}

/// The angles α, in order, at which the extremes of ih over φ, cos(α ± θ), reach a limit between two pieces of
/// [`mean_over_azimuth`], with both ends of the range: there the mean is not smooth in α.
fn bends(theta: f64) -> [f64; 9] {
    let right = 0.5 * PI;
    let (third, half) = (theta / 3.0, 0.5 * theta);
    let free = [right / 3.0 - third, right / 3.0 + third];
    let horizon = [0.5 * right - half, 0.5 * right + half];
    let mut bends = [0.0, free[0], free[1], horizon[0], horizon[1], 0.5 * right, theta, right - theta, right];
    bends.sort_by(f64::total_cmp);
    bends
}

/// Mean over φ of G ih/(ni nh) for half vectors of slope `tan`.
fn mean_over_azimuth(ni: f64, tan: f64) -> f64 {
    let nh = 1.0 / (1.0 + tan * tan).sqrt();
    // ih = a + b cos φ
    let (a, b) = (nh * ni, tan * nh * (1.0 - ni * ni).sqrt());
    // From where the reflected direction rises over the horizon the weight is 2 nr/ni, then 1/(ni nh) ih where neither
    // masking nor shadowing acts (facets under 45 degrees only), then 2 where the incident side is shadowed.
    let horizon = 0.5 * ni / nh;
    let rising = (4.0 * nh / ni, -2.0);
    let free = (1.0 / (ni * nh), 0.0);
    let flat = (0.0, 2.0);
    let shallow = 2.0 * nh * nh > 1.0;
    let (masked_to, free_to) =
        if shallow { (2.0 * ni * nh / (4.0 * nh * nh - 1.0), 2.0 * ni * nh) } else { (ni / nh, ni / nh) };
    let piece = |(slope, offset): (f64, f64), from: f64, to: f64| {
        // φ at which ih falls to the limit.
        let azimuth = |ih: f64| {
            if b > 0.0 {
                ((ih - a) / b).clamp(-1.0, 1.0).acos()
            } else if a >= ih {
                PI
            } else {
                0.0
            }
        };
        let (p, q) = (azimuth(to), azimuth(from));
        ((slope * a + offset) * (q - p) + slope * b * (q.sin() - p.sin())) / PI
    };
    piece(rising, horizon, masked_to) + piece(free, masked_to, free_to) + piece(flat, free_to, f64::INFINITY)
}

/// [`directional_albedo`] of one roughness, for inner loops.
#[derive(Clone, Debug)]
pub struct AlbedoTable {
    /// Offset of the spacing: entries crowd where cos θ is of the order of m, where the albedo turns.
    knee: f32,
    /// Equally spaced in cos θ (1 + knee)/(cos θ + knee), from grazing to normal.
    values: Vec<f32>,
}

impl AlbedoTable {
    /// Entries of a table.
    const ENTRIES: usize = 256;

    /// The table for roughness `m`; `m = 0` is 1 everywhere.
    pub fn new(m: f64) -> Self {
        let knee = bounded(m, MIN_ROUGHNESS, 1e3) as f32;
        let values = (0..Self::ENTRIES)
            .into_par_iter()
            .map(|i| {
                let x = i as f64 / (Self::ENTRIES - 1) as f64;
                let knee = f64::from(knee);
                integrated(m, x * knee / (1.0 + knee - x), TABLE_PANELS) as f32
            })
            .collect();
        AlbedoTable { knee, values }
    }

    /// The albedo for light from `cos_theta` (clamped to 0..1), within 1e-4.
    #[inline]
    pub fn eval(&self, cos_theta: f32) -> f32 {
        let cos = bounded(f64::from(cos_theta), 0.0, 1.0) as f32;
        let x = cos * (1.0 + self.knee) / (cos + self.knee) * (Self::ENTRIES - 1) as f32;
        let slot = (x as usize).min(Self::ENTRIES - 2);
        let (a, b) = (self.values[slot], self.values[slot + 1]);
        a + (x - slot as f32) * (b - a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_follows_the_integral() {
        for m in [0.0, 1e-4, 0.01, 0.05, 0.3, 1.0, 2.0] {
            let table = AlbedoTable::new(m);
            for i in 0..=300 {
                // Crowded towards grazing incidence.
                let cos = (f64::from(i) / 300.0).powi(4);
                let error = (f64::from(table.eval(cos as f32)) - directional_albedo(m, cos)).abs();
                assert!(error < 1e-4, "m {m} cos {cos}: {error}");
            }
        }
    }

    #[test]
    fn no_input_leaves_the_unit_interval() {
        for m in [-1.0, 0.0, 1e-300, 1e-6, 0.3, 1e300, f64::INFINITY, f64::NAN] {
            for cos in [-1.0, 0.0, 1e-300, 1e-9, 0.5, 1.0 + 1e-9, f64::NAN] {
                assert!((0.0..=1.0).contains(&directional_albedo(m, cos)), "{m} {cos}");
                assert!((0.0..=1.0).contains(&AlbedoTable::new(m).eval(cos as f32)), "{m} {cos}");
            }
        }
    }
}

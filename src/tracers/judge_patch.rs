//! The verdict on a line and a bicubic patch, by topology: how often the edge of a piece of the patch, seen along the line,
//! goes round it.
//!
//! The lines that are parallel to this one and no further than the band are seen as the points of a disc about zero.
//!
//! * A piece whose control points all lie beside the disc is met by none of them.
//! * If the edge of a rectangle of (u, v) stays out of the disc and goes round it, the rectangle's image covers all of it:
//!   every one of the lines crosses there. Where all derivatives along u turn one way against all along v, too, each
//!   does so once, and how far along is found by halving.
//! * What is so small that neither holds, because the line touches the patch there or passes its border, is in doubt.
//!
//! No step of it is one of the intersector's, which is Newton's method and its conditions.

use super::judge::Crossing;
use crate::geometry::net::{Net, extent, halves_in_u, halves_in_v, is_beside, part, steps};
use crate::geometry::{Patch, Ray, turns_one_way};
use glam::{DVec2, DVec3};

/// After so many pieces, or pieces in doubt, all that is left is in doubt: the line runs along the surface.
const MOST_PIECES: usize = 1 << 12;
const MOST_DOUBTS: usize = 64;

/// A rectangle reaches this share of a piece beyond it, so that its edge is clear of what the piece meets.
const AROUND: f64 = 0.5;

/// Halvings of a curve to tell how far it turns, and of a piece to find how far along the line meets it.
const DEEPEST: u32 = 12;
const HALVINGS: u32 = 96;

/// A certain crossing: its parameter, and the sine of the angle between line and surface.
struct Met {
    t: f64,
    sine: f64,
}

/// What the line does between two parameters.
#[derive(Default)]
struct Findings {
    met: Vec<Met>,
    /// Where it begins to be in doubt whether it meets the patch.
    doubts: Vec<f64>,
}

/// A line as the one along which all is seen: x and y beside it, m, z its parameter.
struct View {
    from: DVec3,
    direction: DVec3,
    axes: [DVec3; 2],
}

impl View {
    fn new(from: DVec3, to: DVec3) -> View {
        let direction = to - from;
        let (x, y) = direction.normalize().any_orthonormal_pair();
        View { from, direction, axes: [x, y] }
    }

    fn of(&self, p: DVec3) -> DVec3 {
        let (way, [x, y]) = (p - self.from, self.axes);
        DVec3::new(way.dot(x), way.dot(y), way.dot(self.direction) / self.direction.length_squared())
    }

    /// The sine of the angle with the surface at `t`.
    fn sine(&self, patch: &Patch, t: f64) -> f64 {
        let normal = patch.normal(patch.uv_of(self.from + t * self.direction));
        normal.dot(self.direction).abs() / self.direction.length()
    }

    /// What it does between the limits, if its band is so wide.
    fn look(&self, patch: &Patch, band: f64, [t_min, t_max]: [f64; 2]) -> Findings {
        let mut findings = Findings::default();
        let whole = patch.net().map(|row| row.map(|p| self.of(p)));
        let mut left = vec![(whole, DVec2::ZERO, DVec2::ONE)];
        for _ in 0..MOST_PIECES {
            let Some((net, low, size)) = left.pop() else { return findings };
            let (least, most) = extent(&net);
            if is_beside(&net, (least, most), band) || most.z < t_min || least.z > t_max {
                continue;
            }
            let step = AROUND * size;
            let (first, last) = ((low - step).max(DVec2::ZERO), (low + size + step).min(DVec2::ONE));
            let around = part(&whole, first, last);
            if turns_one_way(&around)
                && let Some(turns) = turns(&around, band)
            {
                if turns != 0 {
                    let t = height(around, 0).unwrap_or(0.5 * (least.z + most.z));
                    if !findings.met.iter().any(|met| (met.t - t).abs() < 1e-9) {
                        findings.met.push(Met { t, sine: self.sine(patch, t) });
                    }
                }
                continue;
            }
            let [width, height] = [most.x - least.x, most.y - least.y];
            if width.max(height) <= band {
                findings.doubts.push(least.z);
                if findings.doubts.len() == MOST_DOUBTS {
                    break;
                }
                continue;
            }
            let [along_u, along_v] = steps(&net, |d| d.truncate().length_squared());
            if along_u >= along_v {
                let half = DVec2::new(0.5 * size.x, size.y);
                let [a, b] = halves_in_u(&net);
                left.extend([(a, low, half), (b, low + DVec2::new(half.x, 0.0), half)]);
            } else {
                let half = DVec2::new(size.x, 0.5 * size.y);
                let [a, b] = halves_in_v(&net);
                left.extend([(a, low, half), (b, low + DVec2::new(0.0, half.y), half)]);
            }
        }
        findings.doubts.extend(left.iter().map(|(net, ..)| extent(net).0.z));
        findings
    }
}

/// How often the edge goes round the disc of radius `band` about zero, counter-clockwise; none if it comes too near.
fn turns(net: &Net, band: f64) -> Option<i32> {
    let column = |i: usize| [0, 1, 2, 3].map(|j| net[j][i].truncate());
    let row = |j: usize| net[j].map(DVec3::truncate);
    let backwards = |mut curve: [DVec2; 4]| {
        curve.reverse();
        curve
    };
    let edge = [row(0), column(3), backwards(row(3)), backwards(column(0))];
    let mut angle = 0.0;
    for curve in edge {
        angle += swept(curve, band, DEEPEST)?;
    }
    Some((angle / std::f64::consts::TAU).round() as i32)
}

/// The angle that a cubic curve sweeps as seen from zero, if it stays further away than `band`: that between its ends
/// where a half-plane holds it.
fn swept(curve: [DVec2; 4], band: f64, left: u32) -> Option<f64> {
    let [p, q, r, s] = curve;
    let axis = (p + q + r + s).normalize_or_zero();
    if curve.iter().all(|c| c.dot(axis) > band) {
        return Some(p.perp_dot(s).atan2(p.dot(s)));
    }
    if left == 0 || p.length() <= band || s.length() <= band {
        return None;
    }
    let mean = |a: DVec2, b: DVec2| 0.5 * (a + b);
    let (pq, qr, rs) = (mean(p, q), mean(q, r), mean(r, s));
    let (first, last) = (mean(pq, qr), mean(qr, rs));
    let middle = mean(first, last);
    Some(swept([p, pq, first, middle], band, left - 1)? + swept([middle, last, rs, s], band, left - 1)?)
}

/// The height of the net where x and y are zero, by halving; none where its control points' box does not hold zero.
fn height(net: Net, depth: u32) -> Option<f64> {
    let (least, most) = extent(&net);
    let rounding = 1e-15 * (most.z - least.z).abs().max(most.truncate().abs().max_element());
    if least.truncate().max_element() > rounding || most.truncate().min_element() < -rounding {
        return None;
    }
    if depth == HALVINGS || (most - least).max_element() <= 1e-14 {
        return Some(0.5 * (least.z + most.z));
    }
    let halves = if depth.is_multiple_of(2) { halves_in_u(&net) } else { halves_in_v(&net) };
    halves.into_iter().find_map(|half| height(half, depth + 1))
}

/// How the line from `from` (parameter 0) to `to` (parameter 1) meets `patch` between the limits.
pub(crate) fn crossing(
    patch: &Patch,
    from: DVec3,
    to: DVec3,
    [t_min, t_max]: [f64; 2],
    [edge_band, end_band]: [f64; 2],
) -> Crossing {
    let view = View::new(from, to);
    let length = view.direction.length();
    // Beyond an end something may still be met within its band.
    let beyond = (64.0 * end_band / length).min(0.05);
    let Findings { met, mut doubts } = view.look(patch, edge_band, [t_min - beyond, t_max + beyond]);
    doubts.retain(|&t| t < t_max);
    doubts.iter_mut().for_each(|t| *t = t.max(t_min));
    let mut clearance = if doubts.is_empty() { f64::INFINITY } else { edge_band };
    let mut first = f64::INFINITY;
    for Met { t, sine } in met {
        let within = (t - t_min).min(t_max - t) * length * sine;
        if within > end_band {
            first = first.min(t);
        } else if within >= -end_band {
            doubts.push(t.clamp(t_min, t_max));
            clearance = clearance.min(within.abs());
        }
    }
    match (first.is_finite(), doubts.is_empty()) {
        (true, _) => Crossing::Crosses { t: first, earliest: doubts.iter().copied().fold(first, f64::min) },
        (false, true) => Crossing::Misses,
        (false, false) => {
            let ray = Ray { origin: from, direction: view.direction, t_min, t_max };
            let crosses = patch.intersect(&ray).is_some();
            Crossing::Grazes { crosses, clearance }
        }
    }
}

/// How far the parameter of a certain crossing at `t` may be off either way when the surface is by `band`.
pub(super) fn blur(patch: &Patch, from: DVec3, to: DVec3, t: f64, band: f64) -> f64 {
    let view = View::new(from, to);
    // Parallels meet a bent patch within so many times the way that a plane would make it.
    const BENT: f64 = 4.0;
    BENT * band / (view.sine(patch, t) * view.direction.length()).max(f64::MIN_POSITIVE)
}

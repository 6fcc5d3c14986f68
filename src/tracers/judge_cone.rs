//! The exact verdict on a line and the side of a cylinder or a cone.
//!
//! Along a line the distance from the endless cone falls to a foot and rises from there, as for a sphere (the distance
//! from the axis is convex, the radius there linear). Its signs at the ends and at the foot decide, and where it changes
//! sign the place decides that is found by halving: independently of the formula that tracers use.

use super::judge::Crossing;
use crate::geometry::{Cone, Profile};
use glam::DVec3;

/// How often the stretch with a change of sign is halved: to the last digit of its parameter.
const HALVINGS: usize = 64;

/// A parameter of the line, the distance from the endless cone there, and within how much of 0 that decides nothing, m.
#[derive(Clone, Copy)]
struct Station {
    t: f64,
    outside: f64,
    band: f64,
}

impl Station {
    fn is_certain(&self) -> bool {
        self.outside.abs() > self.band
    }
}

/// A line and a cone.
struct Meeting<'a> {
    cone: &'a Cone,
    from: DVec3,
    direction: DVec3,
}

/// How the line from `from` (parameter 0) to `to` (parameter 1) meets `cone` between the limits.
pub(super) fn crossing(
    cone: &Cone,
    from: DVec3,
    to: DVec3,
    [t_min, t_max]: [f64; 2],
    [edge_band, end_band]: [f64; 2],
) -> Crossing {
    let line = Meeting { cone, from, direction: to - from };
    let station = |t: f64, band: f64| Station { t, outside: cone.outside(line.at(t)), band };
    let mut stations = vec![station(t_min, end_band), station(t_max, end_band)];
    if let Some(foot) = line.foot().filter(|&t| t > t_min && t < t_max) {
        stations.insert(1, station(foot, edge_band));
    }
    let mut doubts: Vec<(f64, f64)> = Vec::new();
    let mut crossings = Vec::new();
    let mut crosses_exactly = false;
    for pair in stations.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        if (a.outside < 0.0) == (b.outside < 0.0) {
            continue;
        }
        let t = line.root(a, b);
        let beyond = line.beyond_rim(t);
        crosses_exactly |= beyond <= 0.0;
        match (a.is_certain() && b.is_certain(), beyond) {
            (_, beyond) if beyond > edge_band => {}
            (true, beyond) if beyond < -edge_band => crossings.push(t),
            _ => doubts.push((t, beyond.abs())),
        }
    }
    // Where the line touches the endless cone, or runs along it, it is within the band for a while.
    for pair in stations.windows(2).filter(|pair| !(pair[0].is_certain() && pair[1].is_certain())) {
        let [a, b] = [pair[0], pair[1]];
        if let Some(t) = line.comes_beside(a, b, a.band.max(b.band)) {
            doubts.push((t, a.outside.abs().min(b.outside.abs())));
        }
    }
    match crossings.first() {
        Some(&t) => {
            let earliest = doubts.iter().map(|d| d.0).fold(t, f64::min);
            Crossing::Crosses { t, earliest }
        }
        None if doubts.is_empty() => Crossing::Misses,
        None => {
            let clearance = doubts.iter().map(|d| d.1).fold(f64::INFINITY, f64::min);
            Crossing::Grazes { crosses: crosses_exactly, clearance }
        }
    }
}

impl Meeting<'_> {
    fn at(&self, t: f64) -> DVec3 {
        self.from + t * self.direction
    }

    /// Where the distance from the endless cone is least; none where it falls or rises all the way.
    fn foot(&self) -> Option<f64> {
        // out = √(a (t - nearest)² + c), and the radius there grows by m along t.
        let axis = self.cone.axis();
        let across = self.direction.reject_from_normalized(axis);
        let away = (self.from - self.cone.base).reject_from_normalized(axis);
        let a = across.length_squared();
        let nearest = -away.dot(across) / a;
        let c = (away + nearest * across).length_squared();
        let m = self.cone.growth() * axis.dot(self.direction);
        (a > m * m).then(|| nearest + m * (c / (a * (a - m * m))).sqrt())
    }

    /// Where the distance changes sign between two places.
    fn root(&self, a: Station, b: Station) -> f64 {
        let (mut low, mut high) = (a.t, b.t);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if (self.cone.outside(self.at(middle)) < 0.0) == (a.outside < 0.0) {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// How far beyond the nearer rim the line meets the endless cone at `t`, times the sine of their angle, m;
    /// negative where it meets the side itself.
    fn beyond_rim(&self, t: f64) -> f64 {
        let p = self.at(t);
        let sine = self.cone.outwards(p).dot(self.direction).abs() / self.direction.length();
        self.beyond(p) * sine
    }

    /// How far beyond the nearer rim a place is, along the side, m.
    fn beyond(&self, p: DVec3) -> f64 {
        let Profile { up, .. } = self.cone.profile(p);
        let height = self.cone.height();
        (-up).max(up - height) * self.cone.slant() / height
    }

    /// Where, between two places of which the distance falls or rises from one to the other, the line is within the
    /// band of the side itself, if it is.
    fn comes_beside(&self, a: Station, b: Station, band: f64) -> Option<f64> {
        let (near, far) = if a.outside.abs() < b.outside.abs() { (a, b) } else { (b, a) };
        if near.outside.abs() > band {
            return None;
        }
        // The last place from the nearer one on that is within the band.
        let (mut within, mut beyond) = (near.t, far.t);
        if far.outside.abs() <= band {
            within = far.t;
        } else {
            for _ in 0..HALVINGS {
                let middle = 0.5 * (within + beyond);
                let is_within = self.cone.outside(self.at(middle)).abs() <= band;
                *if is_within { &mut within } else { &mut beyond } = middle;
            }
        }
        let up = |t: f64| self.cone.profile(self.at(t)).up;
        let (low, high) = (up(near.t).min(up(within)), up(near.t).max(up(within)));
        (low <= self.cone.height() + band && high >= -band).then(|| near.t.min(within))
    }
}

/// How far the parameter of a certain crossing at `t` may be off either way when the surface is by `band`.
pub(super) fn blur(cone: &Cone, from: DVec3, to: DVec3, t: f64, band: f64) -> f64 {
    let line = Meeting { cone, from, direction: to - from };
    let sine = cone.outwards(line.at(t)).dot(line.direction).abs();
    let straight = band / sine;
    // Near a tangent the curve matters: no further than to the foot and a little beyond.
    let foot = line.foot().map_or(f64::INFINITY, |foot| 2.0 * (foot - t).abs());
    let touching = (2.0 * band * (cone.widest() + cone.height())).sqrt() / line.direction.length();
    straight.min(foot.max(touching))
}

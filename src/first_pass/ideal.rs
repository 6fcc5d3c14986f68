//! Ideal reflection and transmission between the elements that a smooth specular element connects.
//!
//! Light goes from an element l to an element k by way of a mirror element s when the straight line from the
//! mirror image of l to k passes through s; so it does through a pane, where l is its own image. Over l
//! and k that is a share of all lines, and the shares of neighbouring mirror elements, which share their
//! edges, sum to 1: a row of mirror elements shows the image of l as one mirror would, however they are
//! divided. B is that share, times the form factor from the image of l to k, over those from l to s
//! and from s to k.
//!
//! In the plane of s lines cross at (p_l + p_k) / (1 / h_l + 1 / h_k): p are slopes (x, y) / z, h heights
//! over the plane. Everything is linear in slopes, and x and y are treated apart.

use super::directions::{Bounds, Direction, LANES, Lanes, Origin, lanes};
use glam::Vec3;

/// What the ideal lobe needs to know of an element.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extent {
    /// (x, y) / z.
    pub slope: [f32; 2],
    /// Half the square of its width in slopes along a line of slope p: (a - 2 b p + c p²), x and y; (a, b).
    pub spread: [[f32; 2]; 2],
    /// c of both.
    pub depth: f32,
    /// How much its slope changes across the specular element, 1/m: 1 / h, but for refraction.
    pub nearness: [f32; 2],
    /// Its normal over its cosine towards the specular element.
    pub tilt: [f32; 3],
}

/// [`Extent`] of [`LANES`] elements.
#[derive(Clone, Copy, Debug)]
pub struct Extents {
    slope: [Lanes; 2],
    spread: [[Lanes; 2]; 2],
    depth: Lanes,
    nearness: [Lanes; 2],
    tilt: [Lanes; 3],
}

/// Narrower than this, elements have no width, and divisions by it would fail.
const LEAST_SPREAD: f32 = 1e-12;

/// How much larger the variance of an element counts than it is. Elements that mirror each other stand in rasters
/// of equal pitch, and tents twice that wide sum to 1 wherever they are; larger ones reach more elements.
const SMOOTH: f32 = 2.0;

/// Bounds of the correction for the angles under which l and k really see each other: beyond, an element
/// is so near the specular one that a single line does not tell how they see each other.
const CORRECTION: (f32, f32) = (0.25, 4.0);

impl Extent {
    /// Of a flat element: `to` (unit) its direction and `height` over the plane, sides `u` and `v` (m), its
    /// `normal` and the cosine it shows; all in the frame of the specular element.
    pub fn new(to: Vec3, height: f32, [u, v]: [Vec3; 2], normal: Vec3, cosine: f32) -> Self {
        let (u, v) = (u / height, v / height);
        let product = |a: usize, b: usize| 0.5 * SMOOTH * (u[a] * u[b] + v[a] * v[b]);
        Extent {
            slope: (to / to.z.max(1e-6)).truncate().to_array(),
            spread: [[product(0, 0), product(0, 2)], [product(1, 1), product(1, 2)]],
            depth: product(2, 2),
            nearness: [1.0 / height; 2],
            tilt: (normal / cosine).to_array(),
        }
    }

    /// Half the square of its width in slopes x or y, along a line of slope `p`.
    fn spread_along(&self, axis: usize, p: f32) -> f32 {
        (self.spread[axis][0] + p * (p * self.depth - 2.0 * self.spread[axis][1])).max(LEAST_SPREAD)
    }

    /// The same along its own direction.
    pub fn own_spread(&self) -> [f32; 2] {
        [0, 1].map(|axis| self.spread_along(axis, self.slope[axis]))
    }

    /// The same seen refracted into direction `to` outside, from direction `from` inside a solid of index `n`.
    pub fn refracted(&self, from: Vec3, to: Vec3, n: f32) -> Self {
        // Slopes turn by n z / z' across the plane of incidence, by n (z / z')³ in it.
        let across = n * from.z / to.z;
        let along = n * (from.z / to.z).powi(3);
        let e = from.truncate().normalize_or_zero();
        let turn = |a: usize, b: usize| {
            let straight = if a == b { across } else { 0.0 };
            straight + (along - across) * e[a] * e[b]
        };
        let square = |a: usize, b: usize| turn(a, b) * turn(a, b);
        let own = self.own_spread();
        Extent {
            slope: (to / to.z).truncate().to_array(),
            spread: [0, 1].map(|a| [square(a, 0) * own[0] + square(a, 1) * own[1], 0.0]),
            depth: 0.0,
            nearness: [0, 1].map(|a| turn(a, a) * self.nearness[a]),
            tilt: [0.0; 3],
        }
    }
}

impl Extents {
    /// Of a group of directions.
    pub fn new(group: &[Direction]) -> Self {
        Extents {
            slope: [0, 1].map(|a| lanes(group, |d| d.ideal.slope[a])),
            spread: [0, 1].map(|a| [0, 1].map(|b| lanes(group, |d| d.ideal.spread[a][b]))),
            depth: lanes(group, |d| d.ideal.depth),
            nearness: [0, 1].map(|a| lanes(group, |d| d.ideal.nearness[a])),
            tilt: [0, 1, 2].map(|a| lanes(group, |d| d.ideal.tilt[a])),
        }
    }

    /// Of one direction.
    #[inline(always)]
    pub fn get(&self, l: usize) -> Extent {
        Extent {
            slope: self.slope.map(|v| v[l]),
            spread: self.spread.map(|v| v.map(|v| v[l])),
            depth: self.depth[l],
            nearness: self.nearness.map(|v| v[l]),
            tilt: self.tilt.map(|v| v[l]),
        }
    }
}

/// A bit for each group that the lobe of `a` may reach.
#[inline(always)]
pub fn reached(bounds: &Bounds, a: &Direction, side: [f32; 2]) -> u32 {
    let (x, y) = (meets::<0>(bounds, &a.ideal, side), meets::<1>(bounds, &a.ideal, side));
    let mut reached = 0;
    for l in 0..LANES {
        reached |= (x[l] & y[l] & u32::from(bounds.z[l] > 0.0)) << l;
    }
    reached
}

/// Whether some line between `a` and a group may pass through the specular element, as far as one axis tells.
///
/// Lines have slopes between those of the two. Along them the two are together at most as wide as along one
/// end of that range, and a root of their depths more for each unit of slope from there. Either end
/// gives a bound: that of what is farther away is tight, for what is near moves a line less.
#[inline(always)]
fn meets<const AXIS: usize>(bounds: &Bounds, a: &Extent, side: [f32; 2]) -> [u32; LANES] {
    let (p, near, half) = (a.slope[AXIS], a.nearness[AXIS], 0.5 * side[AXIS]);
    let [a0, a1] = a.spread[AXIS];
    let own = a.spread_along(AXIS, p);
    let of = &bounds.ideal[AXIS];
    let (low, high) = (&bounds.low[AXIS], &bounds.high[AXIS]);
    let mut meets = [0; LANES];
    for l in 0..LANES {
        let gap = (low[l] + p).max(-p - high[l]);
        let window = half * (near + of.nearest[l]);
        let deep = (a.depth + bounds.depth[l]).sqrt();
        let along_a =
            own + of.square[l] + 2.0 * (p * of.least[l]).max(p * of.most[l]) + p * p * bounds.depth[l];
        let at = |q: f32| q * (q * a.depth + 2.0 * a1);
        let along_k = a0 + at(low[l]).max(at(high[l])) + of.own[l];
        let (apart_a, apart_k) = (near / (near + of.farthest[l]), of.nearest[l] / (near + of.nearest[l]));
        let misses_a = gap * (1.0 - deep * apart_a) > 1.001 * (window + along_a.max(0.0).sqrt());
        let misses_k = gap * (1.0 - deep * apart_k) > 1.001 * (window + along_k.max(0.0).sqrt());
        meets[l] = u32::from(!((gap > 0.0) & (misses_a | misses_k)));
    }
    meets
}

/// Where lines between two elements cross the plane of the specular one, along an axis; all in slopes.
struct Crossing {
    /// Sum of the slopes.
    sum: Lanes,
    /// Sum of the nearnesses.
    near: Lanes,
    /// Half the square of the width of both along the line between them, times the square of `near`.
    square: Lanes,
    /// 1 where such a line may pass through the specular element.
    meets: [u32; LANES],
}

impl Crossing {
    #[inline(always)]
    fn new<const AXIS: usize>(a: &Extent, group: &Extents, side: [f32; 2]) -> Self {
        let (p, own, half) = (a.slope[AXIS], a.nearness[AXIS], 0.5 * side[AXIS]);
        let [a0, a1] = a.spread[AXIS];
        let (slope, nearness) = (&group.slope[AXIS], &group.nearness[AXIS]);
        let [k0, k1] = &group.spread[AXIS];
        let mut c =
            Crossing { sum: [0.0; LANES], near: [0.0; LANES], square: [0.0; LANES], meets: [0; LANES] };
        for l in 0..LANES {
            let near = own + nearness[l];
            let sum = p + slope[l];
            // The slope of the line between the two, towards the group, times `near`.
            let line = slope[l] * own - p * nearness[l];
            let least = LEAST_SPREAD * near * near;
            let square = (a0 + k0[l]) * near * near
                + line * (line * (a.depth + group.depth[l]) + 2.0 * near * (a1 - k1[l]));
            let square = if square > least { square } else { least };
            let beyond = (sum.abs() - half * near) * near;
            c.sum[l] = sum;
            c.near[l] = near;
            c.square[l] = square;
            c.meets[l] = u32::from((beyond <= 0.0) | (beyond * beyond < square));
        }
        c
    }

    /// (Share of the lines that pass through the specular element, its half side).
    #[inline(always)]
    fn share(&self, side: f32) -> (Lanes, Lanes) {
        let (mut share, mut window) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let sharp = self.near[l] / self.square[l].sqrt();
            let half = 0.5 * side * self.near[l];
            share[l] = beyond((half + self.sum[l]) * sharp) + beyond((half - self.sum[l]) * sharp);
            window[l] = half;
        }
        (share, window)
    }
}

/// The lobe between `a` and a group: (B, cosine of the angle of incidence).
#[inline(always)]
pub fn between(a: &Direction, z: &Lanes, group: &Extents, origin: &Origin) -> Option<(Lanes, Lanes)> {
    let x = Crossing::new::<0>(&a.ideal, group, origin.side);
    let y = Crossing::new::<1>(&a.ideal, group, origin.side);
    let az = a.to[2];
    let mut inside = [0u32; LANES];
    for l in 0..LANES {
        inside[l] = x.meets[l] & y.meets[l] & u32::from(z[l] > 0.0);
    }
    if inside.iter().sum::<u32>() == 0 || az <= 0.0 {
        return None;
    }
    let ((share_x, window_x), (share_y, window_y)) = (x.share(origin.side[0]), y.share(origin.side[1]));
    let mut b = [0.0; LANES];
    let mut cosine = [0.0; LANES];
    for l in 0..LANES {
        let both = az * z[l];
        let value = share_x[l] * share_y[l] / (4.0 * window_x[l] * window_y[l] * both * both);
        b[l] = if inside[l] != 0 { value } else { 0.0 };
        cosine[l] = 0.5 * (az + z[l]);
    }
    if origin.straight {
        let own = a.ideal.nearness[0];
        let [ax, ay] = a.ideal.slope;
        let [tx, ty, tz] = a.ideal.tilt;
        let ([gx, gy], [ux, uy, uz], nearness) = (&group.slope, &group.tilt, &group.nearness[0]);
        for l in 0..LANES {
            // The line from k to the image of l, times both nearnesses.
            let other = nearness[l];
            let (v1, v2, v3) = (gx[l] * own - ax * other, gy[l] * own - ay * other, own + other);
            let square = v1 * v1 + v2 * v2 + v3 * v3;
            let from = tx * v1 + ty * v2 - tz * v3;
            let to = -ux[l] * v1 - uy[l] * v2 - uz[l] * v3;
            let correction = from * to * v3 * v3 / (square * square * az * z[l]);
            let correction = if correction > CORRECTION.0 { correction } else { CORRECTION.0 };
            let correction = if correction < CORRECTION.1 { correction } else { CORRECTION.1 };
            let sane = (from > 0.0) & (to > 0.0);
            b[l] *= if sane { correction } else { CORRECTION.0 };
            cosine[l] = v3 / square.sqrt();
        }
    }
    Some((b, cosine))
}

/// How much of a tent of half-width 1 about `t` lies above 0, less a half: from -1/2 to 1/2.
#[inline(always)]
fn beyond(t: f32) -> f32 {
    let t = if t > -1.0 { t } else { -1.0 };
    let t = if t < 1.0 { t } else { 1.0 };
    t - 0.5 * t * t.abs()
}

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
    let (a, own) = (&a.ideal, a.ideal.own_spread());
    let mut reached = [0u32; LANES];
    for (l, reached) in reached.iter_mut().enumerate() {
        // Lines between the two have slopes between theirs: at most this much wider for each unit apart.
        let wider = (a.depth + bounds.depth[l]).sqrt();
        let meets = |axis: usize| {
            let width = (own[axis] + bounds.most[axis][l]).sqrt();
            let window = 0.5 * side[axis] * (a.nearness[axis] + bounds.most[2 + axis][l]);
            bounds.gap(axis, l, a.slope[axis]) * (1.0 - wider) <= 1.001 * (window + width)
        };
        *reached = u32::from(meets(0) & meets(1) & (bounds.z[l] > 0.0)) << l;
    }
    reached.iter().fold(0, |all, bit| all | bit)
}

/// The lobe between `a` and a group: (B, cosine of the angle of incidence).
#[inline(always)]
pub fn between(a: &Direction, z: &Lanes, group: &Extents, origin: &Origin) -> Option<(Lanes, Lanes)> {
    let mut share = [1.0; LANES];
    let mut windows = [4.0; LANES];
    for axis in 0..2 {
        let from = &a.ideal;
        for l in 0..LANES {
            let (p, q) = (from.slope[axis], group.slope[axis][l]);
            let (near, far) = (from.nearness[axis], group.nearness[axis][l]);
            let window = 0.5 * origin.side[axis] * (near + far);
            // The slope of the line between the two, towards the group.
            let line = (q * near - p * far) / (near + far);
            let a_b = group.spread[axis];
            let spread = from.spread[axis][0]
                + a_b[0][l]
                + line * (line * (from.depth + group.depth[l]) + 2.0 * (from.spread[axis][1] - a_b[1][l]));
            let sharp = 1.0 / spread.max(LEAST_SPREAD).sqrt();
            share[l] *= beyond((window + p + q) * sharp) + beyond((window - p - q) * sharp);
            windows[l] *= window;
        }
    }
    let az = a.to[2];
    let mut inside = [0u32; LANES];
    for l in 0..LANES {
        inside[l] = u32::from((share[l] > 0.0) & (z[l] > 0.0));
    }
    if inside.iter().sum::<u32>() == 0 || az <= 0.0 {
        return None;
    }
    let mut b = [0.0; LANES];
    let mut cosine = [0.0; LANES];
    for l in 0..LANES {
        let both = az * z[l];
        let value = share[l] / (windows[l] * both * both);
        b[l] = if inside[l] != 0 { value } else { 0.0 };
        cosine[l] = 0.5 * (az + z[l]);
    }
    if origin.straight {
        for l in 0..LANES {
            // The line from k to the image of l, times both nearnesses.
            let (own, other) = (a.ideal.nearness[0], group.nearness[0][l]);
            let v = [0, 1].map(|axis| group.slope[axis][l] * own - a.ideal.slope[axis] * other);
            let v3 = own + other;
            let v2 = v[0] * v[0] + v[1] * v[1] + v3 * v3;
            let t = &a.ideal.tilt;
            let from = t[0] * v[0] + t[1] * v[1] - t[2] * v3;
            let t = group.tilt.map(|t| t[l]);
            let to = -t[0] * v[0] - t[1] * v[1] - t[2] * v3;
            let correction = from * to * v3 * v3 / (v2 * v2 * az * z[l]);
            let sane = from > 0.0 && to > 0.0;
            b[l] *= if sane { correction.clamp(CORRECTION.0, CORRECTION.1) } else { CORRECTION.0 };
            cosine[l] = v3 / v2.sqrt();
        }
    }
    Some((b, cosine))
}

/// How much of a tent of half-width 1 about `t` lies above 0, less a half: from -1/2 to 1/2.
#[inline(always)]
fn beyond(t: f32) -> f32 {
    let t = t.clamp(-1.0, 1.0);
    t - 0.5 * t * t.abs()
}

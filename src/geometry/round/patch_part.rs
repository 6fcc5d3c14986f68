//! Parts of a bicubic patch, made ready for rays once.
//!
//! Let U be the mean derivative along u of a part, V that along v, and d the direction of a line. The planes through the
//! line and V, and through the line and U, are where the two functions (V × d) · (p - o) and (d × U) · (p - o) are zero.
//! On the part both are bicubic, the first all but linear in u and the second in v, and the line meets the part where both
//! are zero.
//!
//! * The part is missed if the control values of one of them have one sign: it lies in the hull of its control points.
//! * A cone holds all products a × b of derivatives along u and along v, over the part and a little beyond. Where d makes
//!   an angle with the cone's base that is greater than the cone is wide, d · (a × b) has one sign. From one
//!   place of the part to another the way, seen along d, is a sum of one a and one b, and so not zero: no two places are
//!   seen as one. Then Newton's method, wherever it ends, has found the one place there is: on the part, or beside it.
//! * What is left is asked of [`super::patch_crossings`]: lines that come near a tangent, and the few near a corner for
//!   which Newton's method leads too far away.

use super::net::{Net, Spread, differences, extent, part, spread, steps, transposed, weights};
use crate::geometry::{Aabb, Ray};
use crate::simd::{HotLoop, wide};
use glam::{DVec2, DVec3};

/// A patch is cut until the cones of its parts are narrower than this, as the sine of half their angle.
const NARROW: f64 = 0.2;

/// Parts of a patch at least and at most.
const FEWEST: usize = 16;
const MOST: usize = 64;

/// The cone of a part is that of a rectangle which goes this share of its size beyond it, each way.
const BEYOND_PART: f64 = 0.125;

/// Rounding of a coordinate, as a share of the largest.
pub(super) const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// A crossing counts so far beyond the border, in u and v of the patch.
pub(super) const BEYOND: f64 = 1e-10;

/// Steps of Newton's method, which needs two to four.
const STEPS: usize = 8;

/// A step shorter than this is the last: the next would be of the order of its square.
const LAST_STEP: f64 = 1e-6;

/// A part of a patch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    /// Where it begins in the patch's (u, v), and how far it reaches.
    pub low: DVec2,
    pub size: DVec2,
    /// Its control points, and the same coordinate by coordinate.
    pub net: Net,
    columns: [[f64; 16]; 3],
    /// The box around it, and a little more.
    pub bounds: Aabb,
    /// The cone, if there is one.
    cone: Option<Spread>,
    /// How far in its own (u, v) the cone holds: lowest and highest.
    held: [DVec2; 2],
    /// Sums of the derivatives along u and along v.
    along: [DVec3; 2],
    /// The largest coordinate, m.
    largest: f64,
}

/// What is known of a line and a part.
pub(super) enum Met {
    /// It crosses it once, at this parameter, if that is within the limits.
    Once(f64),
    Not,
    Unknown,
}

/// Cuts the patch of these control points. `collapsed` tells which of the edges v = 0, u = 1, v = 1, u = 0 are one point.
pub(super) fn cut(net: &Net, collapsed: [bool; 4]) -> Vec<Part> {
    let of = |low: DVec2, size: DVec2| Part::new(net, collapsed, low, size);
    let mut parts = vec![of(DVec2::ZERO, DVec2::ONE)];
    while parts.len() < MOST {
        // A fold has no cone however it is cut: what is large goes first.
        let width = |p: &Part| p.cone.map_or(1.0, |cone| cone.sine) * p.size.element_product().sqrt();
        let needs = |p: &Part| p.cone.is_none_or(|cone| cone.sine > NARROW);
        let widest = |all: &mut dyn Iterator<Item = (usize, &Part)>| {
            all.map(|(k, p)| (k, width(p))).fold(None, |best: Option<(usize, f64)>, (k, w)| match best {
                Some((_, most)) if most >= w => best,
                _ => Some((k, w)),
            })
        };
        let next = match widest(&mut parts.iter().enumerate().filter(|(_, p)| needs(p))) {
            Some(next) => Some(next),
            None if parts.len() < FEWEST => {
                let size = |p: &Part| p.size.element_product();
                let largest = parts.iter().map(size).fold(0.0, f64::max);
                parts.iter().position(|p| size(p) == largest).map(|k| (k, 0.0))
            }
            None => None,
        };
        let Some((k, _)) = next else { break };
        let Part { low, size, net: own, .. } = parts.swap_remove(k);
        // Across the way that it is bent; where it is not, across the longer one.
        let [bent_u, bent_v] = bends(&own);
        let [long_u, long_v] = steps(&own, |d| d.length_squared());
        let across_u = if (bent_u - bent_v).abs() > 0.02 { bent_u > bent_v } else { long_u >= long_v };
        let (step, half) =
            if across_u { (DVec2::X, DVec2::new(0.5, 1.0)) } else { (DVec2::Y, DVec2::new(1.0, 0.5)) };
        parts.extend([of(low, size * half), of(low + 0.5 * size * step, size * half)]);
    }
    parts.sort_by(|a, b| {
        (a.low.y, a.low.x).partial_cmp(&(b.low.y, b.low.x)).unwrap_or(std::cmp::Ordering::Equal)
    });
    parts
}

/// The most that the lines of control points turn along u and along v, rad.
fn bends(net: &Net) -> [f64; 2] {
    let turn = |line: &[DVec3; 4]| {
        let step = |k: usize| line[k + 1] - line[k];
        let angle = |a: DVec3, b: DVec3| {
            let longest = a.length().max(b.length());
            let angle = a.angle_between(b);
            if a.length().min(b.length()) > 1e-9 * longest && angle.is_finite() { angle } else { 0.0 }
        };
        angle(step(0), step(1)) + angle(step(1), step(2))
    };
    let most = |net: &Net| net.iter().map(turn).fold(0.0, f64::max);
    [most(net), most(&transposed(net))]
}

/// How much larger than its control points' box the box of a part is: crossings count a hair beyond the border.
fn room(min: DVec3, max: DVec3) -> f64 {
    4.0 * ROUNDING * min.abs().max(max.abs()).max_element() + 1e-9 * (max - min).max_element()
}

impl Part {
    fn new(whole: &Net, collapsed: [bool; 4], low: DVec2, size: DVec2) -> Part {
        let net = part(whole, low, low + size);
        let [low_v, high_u, high_v, low_u] = collapsed;
        // Beyond an edge that is one point the surface turns its other side.
        let beyond = |at_edge: bool| if at_edge { 0.0 } else { BEYOND_PART };
        let first = DVec2::new(beyond(low_u && low.x == 0.0), beyond(low_v && low.y == 0.0));
        let high = low + size;
        let last = DVec2::new(beyond(high_u && high.x == 1.0), beyond(high_v && high.y == 1.0));
        let wider = spread(&part(whole, low - size * first, high + size * last));
        let (cone, held) = match wider {
            Some(_) => (wider, [-first, 1.0 + last]),
            None => (spread(&net), [DVec2::ZERO, DVec2::ONE]),
        };
        let (min, max) = extent(&net);
        let largest = min.abs().max(max.abs()).max_element();
        let room = room(min, max);
        let [along_u, along_v] = differences(&net).map(|of| of.iter().sum());
        Part {
            low,
            size,
            columns: [0, 1, 2].map(|k| std::array::from_fn(|i| net[i / 4][i % 4][k])),
            net,
            bounds: Aabb { min: min - room, max: max + room },
            cone,
            held,
            along: [along_u, along_v],
            largest,
        }
    }

    /// A normal of the whole and a direction across it, unit vectors.
    pub(crate) fn frame(&self) -> (DVec3, DVec3) {
        let [along_u, along_v] = self.along;
        let n = along_u.cross(along_v).try_normalize().unwrap_or(DVec3::Z);
        let x = along_u.reject_from_normalized(n).try_normalize();
        (n, x.unwrap_or_else(|| n.any_orthonormal_vector()))
    }

    /// How much room there is in its box around its control points.
    pub(crate) fn room(&self) -> f64 {
        let (min, max) = extent(&self.net);
        room(min, max)
    }

    /// Whether and where the line of `ray` crosses the part.
    #[inline]
    pub(super) fn meet(&self, ray: &Ray) -> Met {
        wide(Meet { part: self, ray })
    }
}

struct Meet<'a> {
    part: &'a Part,
    ray: &'a Ray,
}

/// A function over the part: its control values.
type Values = [f64; 16];

/// The lowest and the highest of the values.
#[inline(always)]
fn range(values: &Values) -> (f64, f64) {
    let (mut low, mut high) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
    for row in values.as_chunks::<4>().0 {
        for k in 0..4 {
            low[k] = if row[k] < low[k] { row[k] } else { low[k] };
            high[k] = if row[k] > high[k] { row[k] } else { high[k] };
        }
    }
    let fold = |of: [f64; 4], less: fn(f64, f64) -> f64| less(less(of[0], of[1]), less(of[2], of[3]));
    (fold(low, f64::min), fold(high, f64::max))
}

/// The value at a place and the derivatives along u and v.
#[inline(always)]
fn evaluate(values: &Values, [bu, du]: &[[f64; 4]; 2], [bv, dv]: &[[f64; 4]; 2]) -> [f64; 3] {
    let (mut at, mut along_v) = ([0.0; 4], [0.0; 4]);
    for (j, row) in values.as_chunks::<4>().0.iter().enumerate() {
        for i in 0..4 {
            at[i] += bv[j] * row[i];
            along_v[i] += dv[j] * row[i];
        }
    }
    let sum = |w: &[f64; 4], of: &[f64; 4]| (w[0] * of[0] + w[1] * of[1]) + (w[2] * of[2] + w[3] * of[3]);
    [sum(bu, &at), sum(du, &at), sum(bu, &along_v)]
}

impl HotLoop for Meet<'_> {
    type Output = Met;

    #[inline(always)]
    fn run(self) -> Met {
        let Meet { part, ray } = self;
        let Some(cone) = &part.cone else { return Met::Unknown };
        let d = ray.direction;
        let [along_u, along_v] = part.along;
        let normals = [along_v.cross(d), d.cross(along_u)];
        let largest = part.largest + ray.origin.abs().max_element();
        let mut values = [[0.0; 16]; 2];
        for (values, n) in values.iter_mut().zip(normals) {
            if part.keeps_to_a_side(ray, n, largest, values) {
                return Met::Not;
            }
        }
        let (facing, length2) = (d.dot(cone.axis), d.length_squared());
        if facing * facing <= cone.sine * cone.sine * length2 {
            // Seen from the side both planes are nearly one: another stands upright on it.
            let missed = part.keeps_to_a_side(ray, cone.axis.cross(d), largest, &mut values[0]);
            return if missed { Met::Not } else { Met::Unknown };
        }
        let [first, second] = &values;
        let column = |i: usize| (first[i] + first[4 + i]) + (first[8 + i] + first[12 + i]);
        let row = |j: usize| (second[4 * j] + second[4 * j + 1]) + (second[4 * j + 2] + second[4 * j + 3]);
        let linear = |from: f64, to: f64| (from / (from - to)).clamp(0.0, 1.0);
        let mut at = DVec2::new(linear(column(0), column(3)), linear(row(0), row(3)));
        let [lowest, highest] = part.held;
        for _ in 0..STEPS {
            let ((bu, du), (bv, dv)) = (weights(at.x), weights(at.y));
            let [f, fu, fv] = evaluate(first, &[bu, du], &[bv, dv]);
            let [g, gu, gv] = evaluate(second, &[bu, du], &[bv, dv]);
            let step = DVec2::new(f * gv - g * fv, g * fu - f * gu) / (fu * gv - fv * gu);
            let next = at - step;
            if step.abs().max_element() < LAST_STEP {
                return part.found(ray, next);
            }
            // What is not a number ends here.
            if !(next.cmpge(lowest - 1.0) & next.cmple(highest + 1.0)).all() {
                return Met::Unknown;
            }
            at = next.clamp(lowest, highest);
        }
        Met::Unknown
    }
}

impl Part {
    /// Whether all of it lies on one side of the plane through the line with normal `n`; gives the control values of the
    /// distance from that plane times the length of `n`.
    #[inline(always)]
    fn keeps_to_a_side(&self, ray: &Ray, n: DVec3, largest: f64, values: &mut Values) -> bool {
        let [x, y, z] = &self.columns;
        let own = n.dot(ray.origin);
        for k in 0..16 {
            values[k] = (n.x * x[k] + n.y * y[k]) + (n.z * z[k] - own);
        }
        let slack = 4.0 * ROUNDING * largest * (n.x.abs() + n.y.abs() + n.z.abs());
        let (low, high) = range(values);
        low > slack || high < -slack
    }

    /// What it means that Newton's method ends at this place of its (u, v).
    #[inline(always)]
    fn found(&self, ray: &Ray, at: DVec2) -> Met {
        let [lowest, highest] = self.held;
        let beyond = BEYOND / self.size;
        let inside = (at.cmpge(-beyond) & at.cmple(1.0 + beyond)).all();
        if !inside {
            let held = (at.cmpge(lowest) & at.cmple(highest)).all();
            return if held { Met::Not } else { Met::Unknown };
        }
        let ((bu, _), (bv, _)) = (weights(at.x), weights(at.y));
        let [x, y, z] = &self.columns;
        let place = [x, y, z].map(|of| {
            let mut at = [0.0; 4];
            for (j, row) in of.as_chunks::<4>().0.iter().enumerate() {
                for i in 0..4 {
                    at[i] += bv[j] * row[i];
                }
            }
            (bu[0] * at[0] + bu[1] * at[1]) + (bu[2] * at[2] + bu[3] * at[3])
        });
        let (d, way) = (ray.direction, DVec3::from_array(place) - ray.origin);
        let t = way.dot(d) / d.length_squared();
        let near = 16.0 * ROUNDING * (self.largest + ray.origin.abs().max_element())
            + 1e-9 * (self.along[0].abs() + self.along[1].abs()).max_element();
        if (way - t * d).abs().max_element() <= near { Met::Once(t) } else { Met::Unknown }
    }
}

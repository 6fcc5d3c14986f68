//! Where a line crosses a part of a bicubic patch for which nothing is known beforehand, as near a tangent.
//!
//! Seen along the line the control points are plane, and so is the map from (u, v): the line crosses where it is zero.
//! The part is halved again and again, and a piece of which the control points' hull does not hold zero is dropped: no
//! crossing is lost. A piece is done when all derivatives along u turn the same way against all those along v: then it
//! meets zero once at most, and Newton's method finds where. What is nowhere so is a fold, where the line touches the
//! patch; such pieces are halved until nothing is left of them but rounding. Patches that share the control points of an
//! edge see the same edge, to the last digits, and a crossing counts a hair beyond it on either side: no line slips
//! between.

use super::net::{Net, differences, evaluate, extent, halves_in_u, halves_in_v, is_beside, steps};
use super::patch_part::{BEYOND, ROUNDING};
use crate::geometry::Ray;
use glam::{DVec2, DVec3};

/// A line that runs along the surface is given up after so many pieces: it meets it nowhere in particular.
const MOST_PIECES: usize = 1 << 14;

/// Steps of Newton's method: from where it is called it needs four or five.
const STEPS: usize = 12;

/// A piece as the line sees it.
struct Piece {
    /// x and y beside the line, z the parameter along it.
    net: Net,
    /// How far it reaches in the patch's (u, v).
    size: DVec2,
}

/// Tells `found` of every crossing of a part of this `size` in (u, v) between the limits, in no order, by its ray
/// parameter, some twice; what it returns is the new upper limit.
pub(super) fn crossings(net: &Net, size: DVec2, ray: &Ray, mut found: impl FnMut(f64) -> f64) {
    let d = ray.direction.to_array();
    let along = (0..3).fold(0, |best, k| if d[k].abs() > d[best].abs() { k } else { best });
    let [i, j, k] = [(along + 1) % 3, (along + 2) % 3, along];
    let shear = [d[i] / d[k], d[j] / d[k], 1.0 / d[k]];
    let seen = |p: DVec3| {
        let v = (p - ray.origin).to_array();
        DVec3::new(v[i] - shear[0] * v[k], v[j] - shear[1] * v[k], shear[2] * v[k])
    };
    let largest = net.iter().flatten().fold(ray.origin.abs(), |most, p| most.max(p.abs())).max_element();
    let (slack, depth) = (ROUNDING * largest, ROUNDING * largest * shear[2].abs());
    let root = net.map(|row| row.map(seen));
    // What is not a number is met nowhere.
    if !root.iter().flatten().all(|p| p.is_finite()) {
        return;
    }
    let mut t_max = ray.t_max;
    let mut left = Vec::with_capacity(24);
    left.push(Piece { net: root, size });
    for _ in 0..MOST_PIECES {
        let Some(Piece { net, size }) = left.pop() else { return };
        let (least, most) = extent(&net);
        if is_beside(&net, (least, most), slack) || most.z <= ray.t_min - depth || least.z >= t_max + depth {
            continue;
        }
        let mut meet = |t: f64| {
            if t > ray.t_min && t < t_max {
                t_max = found(t);
            }
        };
        let flat = [most.x - least.x, most.y - least.y].map(|x| x <= 4.0 * slack);
        if flat == [true; 2] {
            meet(0.5 * (least.z + most.z));
            continue;
        }
        if turns_one_way(&net)
            && let Some(t) = newton(&net, slack, BEYOND / size)
        {
            meet(t);
            continue;
        }
        let [along_u, along_v] = steps(&net, |d| d.truncate().length_squared());
        if along_u >= along_v {
            let size = DVec2::new(0.5 * size.x, size.y);
            left.extend(halves_in_u(&net).map(|net| Piece { net, size }));
        } else {
            let size = DVec2::new(size.x, 0.5 * size.y);
            left.extend(halves_in_v(&net).map(|net| Piece { net, size }));
        }
    }
}

/// Whether all derivatives along u turn the same way against all along v. Between two places of the net the map then
/// changes by a sum of both with a determinant that is not zero: no two places are seen as one.
#[inline(always)]
pub(crate) fn turns_one_way(net: &Net) -> bool {
    let [along_u, along_v] = differences(net).map(|of| of.map(DVec3::truncate));
    let way = along_u[4].perp_dot(along_v[4]).signum();
    along_u.iter().all(|a| along_v.iter().all(|b| way * a.perp_dot(*b) > 0.0))
}

/// The height where the map is zero; none if that is beyond the piece or not found.
#[inline(always)]
fn newton(net: &Net, slack: f64, beyond: DVec2) -> Option<f64> {
    let mut at = DVec2::splat(0.5);
    for _ in 0..STEPS {
        let [place, along_u, along_v] = evaluate(net, at.x, at.y);
        let (place, a, b) = (place.truncate(), along_u.truncate(), along_v.truncate());
        let step = DVec2::new(place.perp_dot(b), a.perp_dot(place)) / a.perp_dot(b);
        let next = (at - step).clamp(DVec2::splat(-0.5), DVec2::splat(1.5));
        let moved = (next - at).abs();
        at = next;
        if moved.max_element() < 1e-9 {
            // The step after this one would be of the order of its square: rounding.
            let [place, ..] = evaluate(net, at.x, at.y);
            let inside = at.cmpge(-beyond).all() && at.cmple(1.0 + beyond).all();
            let near = place.truncate().abs().max_element() <= 16.0 * slack;
            return (inside && near).then_some(place.z);
        }
    }
    None
}

//! Which of the segments between the points of a block may pass through a box.
//!
//! Scaled so that the box is |x|, |y|, |z| <= 1, the segment from p to q keeps clear of it where for some axis |p + q| > 2 + |q - p|
//! (its own box does), or where for some axis x, with d = q - p, |p_y d_z - p_z d_y| > |d_y| + |d_z|: seen along x its line
//! passes by.

use super::against::{Bits, LANES, Places, SIDE, WORDS};
use crate::geometry::Aabb;
use crate::simd::{HotLoop, widest};
use glam::DVec3;

/// A box is taken to be no thinner than this, of the scene's radius, so that `f32` numbers can tell.
const THINNEST: f64 = 0.02;

/// A box that segments may pass through.
pub(super) struct Passing {
    centre: DVec3,
    /// One over its half sizes, 1/m.
    scale: DVec3,
    /// What rounding may do. Scaled, no number is larger than S = 2 R over half the least size, and what is compared
    /// is off by less than 12 times 6e-8 S².
    margin: f32,
}

impl Passing {
    /// The segments of a scene of this `radius` that come as near as `slack` to a box, m.
    pub fn new(bounds: &Aabb, slack: f64, radius: f64) -> Self {
        let half = (0.5 * bounds.size() + slack).max(DVec3::splat(0.5 * THINNEST * radius));
        let largest = 2.0 * radius / half.min_element();
        Passing { centre: bounds.centre(), scale: half.recip(), margin: (2e-6 * largest * largest) as f32 }
    }

    /// Adds to `found` those of `pairs` of which it cannot be ruled out.
    pub fn find(&self, [rows, columns]: [&Places; 2], pairs: &[Bits; SIDE], found: &mut [Bits; SIDE]) {
        widest(Find { passing: self, rows, columns, pairs, found });
    }
}

/// See [`Passing::find`].
struct Find<'a> {
    passing: &'a Passing,
    rows: &'a Places,
    columns: &'a Places,
    pairs: &'a [Bits; SIDE],
    found: &'a mut [Bits; SIDE],
}

impl HotLoop for Find<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Find { passing: Passing { centre, scale, margin }, rows, columns, pairs, found } = self;
        let mut to = [[[0.0f32; 32]; 3]; WORDS];
        for (w, word) in to.iter_mut().enumerate().take(columns.words()) {
            for (k, places) in word.iter_mut().enumerate() {
                for (lane, place) in places.iter_mut().enumerate() {
                    *place = ((columns.at(32 * w + lane)[k] - centre[k]) * scale[k]) as f32;
                }
            }
        }
        let size = |x: f32| if x < 0.0 { -x } else { x };
        let more = |a: f32, b: f32| if a > b { a } else { b };
        for r in 0..rows.count {
            let from = ((DVec3::from_array(rows.at(r)) - *centre) * *scale).as_vec3();
            for (w, [x, y, z]) in to.iter().enumerate().take(columns.words()) {
                let asked = pairs[r][w] & !found[r][w];
                if asked == 0 {
                    continue;
                }
                let mut near = 0;
                for i in 0..32 {
                    let [dx, dy, dz] = [x[i] - from.x, y[i] - from.y, z[i] - from.z];
                    let [sx, sy, sz] = [size(dx), size(dy), size(dz)];
                    let beyond = more(
                        more(size(x[i] + from.x) - sx, size(y[i] + from.y) - sy),
                        size(z[i] + from.z) - sz,
                    );
                    let beside = more(
                        more(
                            size(from.y * dz - from.z * dy) - (sy + sz),
                            size(from.z * dx - from.x * dz) - (sz + sx),
                        ),
                        size(from.x * dy - from.y * dx) - (sx + sy),
                    );
                    near |= if more(beyond - 2.0, beside) > *margin { 0 } else { LANES[i] };
                }
                found[r][w] |= near & asked;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::blocker::tests::Random;
    use super::*;

    /// Whether the segment meets the box, by clipping it.
    fn meets(bounds: &Aabb, p: DVec3, q: DVec3) -> bool {
        let (mut first, mut last) = (0.0f64, 1.0f64);
        for k in 0..3 {
            let d = q[k] - p[k];
            let (t, u) = ((bounds.min[k] - p[k]) / d, (bounds.max[k] - p[k]) / d);
            (first, last) = (first.max(t.min(u)), last.min(t.max(u)));
        }
        first <= last
    }

    #[test]
    fn no_segment_through_a_box_is_ruled_out_and_most_others_are() {
        let mut random = Random(11);
        let (mut passing, mut near, mut all) = (0, 0, 0);
        for turn in 0..200 {
            let (o, size) = (0.4 * random.point(), if turn % 4 == 0 { 0.002 } else { 0.3 });
            let bounds = Aabb::around([o, o + size * (random.point() + 1.0)]);
            let [rows, columns] = [40, 70].map(|n| {
                let mut places = Places::NONE;
                let points: Vec<DVec3> = (0..n).map(|_| 0.5 * random.point()).collect();
                places.set(points.iter().copied());
                (places, points)
            });
            let mut pairs = [[u32::MAX; WORDS]; SIDE];
            pairs[3] = [0; WORDS];
            let mut found = [[0; WORDS]; SIDE];
            Passing::new(&bounds, 1e-6, 1.0).find([&rows.0, &columns.0], &pairs, &mut found);
            assert_eq!(found[3], [0; WORDS], "not asked");
            for (r, p) in rows.1.iter().enumerate().filter(|(r, _)| *r != 3) {
                for (c, q) in columns.1.iter().enumerate() {
                    let may = found[r][c / 32] >> (c % 32) & 1 == 1;
                    let does = meets(&bounds, *p, *q);
                    assert!(may || !does, "{bounds:?} {p} {q}");
                    (passing, near, all) = (passing + u64::from(does), near + u64::from(may), all + 1);
                }
            }
        }
        assert!(passing > 20_000 && near < 2 * passing && 3 * near < all, "{passing} {near} {all}");
    }
}

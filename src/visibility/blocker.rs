//! A surface as something that blocks: certain answers without a ray. They are about polygons; a disc or a sphere is
//! kept away by its box alone, and what it may block is left to the ray tracer.
//!
//! For a point p let d(p) be its signed distance from the surface's plane and e_k(p) that from the
//! plane through edge k at right angles to it, positive inside. The segment a-b crosses the plane
//! where d(a) and d(b) differ in sign, and it does so inside edge k where
//!
//! ```text
//! s_k(a, b) = |d(b)| e_k(a) + |d(a)| e_k(b)
//! ```
//!
//! is positive. s_k is affine in a for fixed b and in b for fixed a as long as neither changes
//! sides, so over two sets of points that the plane separates it is largest and smallest between
//! their hulls' corners: what holds for all corner-to-corner segments holds for all segments. That
//! is what makes the proofs of this module sound.
//!
//! s_k divided by |d(a)| + |d(b)| is the distance of the crossing from the edge, in the plane;
//! divided by the segment's length it is no more than the distance of the two lines in space,
//! which is what rounding in a ray tracer disturbs. Only what lies outside [`Bands`] is certain.

use crate::geometry::{Aabb, Plane, Round, Surface};
use crate::scene::Geometry;
use glam::DVec3;

/// What is too close to call, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bands {
    /// A point this close to a surface's plane is not on either side of it: such a surface
    /// cannot block the point. [`Geometry::plane_tolerance`], as for facing.
    pub apart: f64,
    /// A line that passes an edge closer than this may be judged either way by an `f32` tracer,
    /// whose error is some units in the last place of the coordinates: 6e-8 of the radius each.
    pub slack: f64,
    /// A surface this close to an end may be lost in the margin that a segment leaves out
    /// ([`crate::tracers::Segment::margin`]: 3.8e-6 of the radius at most); twice that.
    pub near: f64,
    /// What `f32` sums may be off, like `slack`. e_k is less than the scene's diameter, 2 R, and r_k (see
    /// [`super::block`]) and their sum are rounded, each by 6e-8 of its size. Where the ends' distances from the
    /// plane add up to no more than the longest segment L, or, for bounds that another point sets, to 3 L, that is less
    /// than 1.1e-6 R L.
    pub rounding: f64,
}

impl Bands {
    /// The bands of a scene.
    pub fn new(geometry: &Geometry) -> Self {
        Bands {
            apart: geometry.plane_tolerance(),
            slack: 4e-6 * geometry.radius,
            near: 8e-6 * geometry.radius,
            rounding: 2e-6 * geometry.radius,
        }
    }
}

/// Edges whose directions differ by less than this sine are parallel.
const PARALLEL: f64 = 1e-9;

/// What one surface does to all segments between two sets of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It blocks none.
    Clear,
    /// It blocks all.
    Covers,
    /// It may block some.
    Open,
}

/// A surface, ready to be tested.
#[derive(Clone, Debug)]
pub(super) struct Blocker {
    /// Unit normal and offset of its plane, and of those through its edges, inward; a triangle's last is repeated.
    planes: [(DVec3, f64); 5],
    vertices: [DVec3; 4],
    /// The directions of its edges, parallel ones but once, and how many these are.
    edges: ([DVec3; 4], usize),
    bounds: Aabb,
    /// No polygon: all that is known of it is its box and what [`Round`] says.
    round: Option<Round>,
    /// `bands` widened by what the vertices are out of plane.
    bands: Bands,
}

impl Blocker {
    /// Prepares `surface`.
    pub fn new(surface: &Surface, bands: &Bands) -> Self {
        if let Some(round) = surface.round() {
            return Blocker {
                planes: [(DVec3::ZERO, 0.0); 5],
                vertices: [round.centre(); 4],
                edges: ([DVec3::ZERO; 4], 0),
                bounds: round.bounds(),
                round: Some(round.clone()),
                bands: *bands,
            };
        }
        let v = surface.vertices();
        let n = v.len();
        let (plane, warp) =
            (surface.plane().unwrap_or(Plane { normal: DVec3::ZERO, offset: 0.0 }), surface.warp());
        let mut edges = [(DVec3::ZERO, 0.0); 4];
        let mut used = 0;
        for k in 0..n {
            let inward = plane.normal.cross(v[(k + 1) % n] - v[k]).normalize_or_zero();
            // An edge without length bounds nothing.
            if inward != DVec3::ZERO {
                let offset = inward.dot(v[k]).min(inward.dot(v[(k + 1) % n]));
                edges[used] = (inward, offset);
                used += 1;
            }
        }
        for k in used..4 {
            edges[k] = edges[used.saturating_sub(1)];
        }
        let [e0, e1, e2, e3] = edges;
        Blocker {
            planes: [(plane.normal, plane.offset), e0, e1, e2, e3],
            vertices: std::array::from_fn(|k| v[k.min(n - 1)]),
            edges: directions(v),
            bounds: surface.bounds(),
            round: None,
            bands: Bands {
                apart: bands.apart + warp,
                slack: bands.slack + warp,
                near: bands.near + warp,
                rounding: bands.rounding,
            },
        }
    }

    /// The disc or sphere that it is, if it is no polygon.
    pub fn round(&self) -> Option<&Round> {
        self.round.as_ref()
    }

    /// The box around it.
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// Its corners; a triangle's last is repeated.
    pub fn vertices(&self) -> &[DVec3; 4] {
        &self.vertices
    }

    /// The directions of its edges, m; parallel ones but once.
    pub fn edges(&self) -> &[DVec3] {
        &self.edges.0[..self.edges.1]
    }

    /// The plane of the surface and those of its edges, as unit normals and offsets; a triangle's last is repeated.
    pub fn planes(&self) -> &[(DVec3, f64); 5] {
        &self.planes
    }

    /// What is too close to call.
    pub fn bands(&self) -> &Bands {
        &self.bands
    }

    /// Whether it can block anything between the boxes `a` and `b`: its plane has something of
    /// both on different sides, and no edge has both outside.
    pub fn may_separate(&self, a: &Aabb, b: &Aabb) -> bool {
        if let Some(round) = &self.round {
            return !round.encloses_box(a) || !round.encloses_box(b);
        }
        let range = |direction: DVec3, offset: f64, of: &Aabb| {
            let (middle, half) = (direction.dot(of.centre()) - offset, 0.5 * direction.abs().dot(of.size()));
            (middle - half, middle + half)
        };
        let [(normal, offset), edges @ ..] = self.planes;
        let ((a_lo, a_hi), (b_lo, b_hi)) = (range(normal, offset, a), range(normal, offset, b));
        let apart = self.bands.apart;
        ((a_lo < -apart && b_hi > apart) || (a_hi > apart && b_lo < -apart))
            && edges.iter().all(|&(m, c)| range(m, c, a).1.max(range(m, c, b).1) >= -self.bands.slack)
    }

    /// What it does to all segments from the hull of `a` to that of `b`, none of which is longer
    /// than `length`.
    pub fn judge(&self, a: &[DVec3; 4], b: &[DVec3; 4], length: f64) -> Verdict {
        if let Some(round) = &self.round {
            let enclosed = a.iter().chain(b).all(|&p| round.encloses(p));
            return if enclosed { Verdict::Clear } else { Verdict::Open };
        }
        let Bands { apart, slack, near, .. } = self.bands;
        let [(normal, offset), edges @ ..] = self.planes;
        let d = |p: &DVec3| normal.dot(*p) - offset;
        let (da, db) = (a.each_ref().map(d), b.each_ref().map(d));
        let ((a_lo, a_hi), (b_lo, b_hi)) = (range(&da), range(&db));
        if !((a_lo < -apart && b_hi > apart) || (a_hi > apart && b_lo < -apart)) {
            return Verdict::Clear;
        }
        let separates = (a_hi < -apart && b_lo > apart) || (a_lo > apart && b_hi < -apart);
        let nearest = a_lo.abs().min(a_hi.abs()).min(b_lo.abs()).min(b_hi.abs());
        let mut covers = separates && nearest > near;
        for (m, c) in edges {
            let (ea, eb) = (a.map(|p| m.dot(p) - c), b.map(|p| m.dot(p) - c));
            if range(&ea).1.max(range(&eb).1) < -slack {
                return Verdict::Clear;
            }
            if separates {
                let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
                for (da, ea) in da.iter().zip(&ea) {
                    for (db, eb) in db.iter().zip(&eb) {
                        let s = db.abs() * ea + da.abs() * eb;
                        (lo, hi) = (lo.min(s), hi.max(s));
                    }
                }
                if hi < -slack * length {
                    return Verdict::Clear;
                }
                covers &= lo > slack * length;
            }
        }
        if covers { Verdict::Covers } else { Verdict::Open }
    }
}

/// The sides of a polygon of up to four corners, those parallel to earlier ones left out, and their number.
fn directions(v: &[DVec3]) -> ([DVec3; 4], usize) {
    let (mut found, mut count) = ([DVec3::ZERO; 4], 0);
    for k in 0..v.len() {
        let edge = v[(k + 1) % v.len()] - v[k];
        let parallel =
            |other: &DVec3| edge.cross(*other).length() <= PARALLEL * edge.length() * other.length();
        if !found[..count].iter().any(parallel) {
            found[count] = edge;
            count += 1;
        }
    }
    (found, count)
}

/// Smallest and largest of four.
fn range(x: &[f64; 4]) -> (f64, f64) {
    (x[0].min(x[1]).min(x[2].min(x[3])), x[0].max(x[1]).max(x[2].max(x[3])))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::{Ray, Shape};
    use crate::tracers::brute_force::intersect_surface;

    /// Numbers in [-1, 1), the same in every run.
    pub(in super::super) struct Random(pub u64);

    impl Random {
        pub fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }

        pub fn point(&mut self) -> DVec3 {
            DVec3::new(self.next(), self.next(), self.next())
        }

        /// A parallelogram or a triangle, of any place, size and direction.
        pub fn surface(&mut self) -> Surface {
            let (o, u, v) = (self.point(), self.point(), self.point());
            Surface::new(if self.next() < 0.0 {
                Shape::Quad([o, o + u, o + u + v, o + v])
            } else {
                Shape::Triangle([o, o + u, o + v])
            })
        }

        /// The corners of a parallelogram.
        fn hull(&mut self, size: f64) -> [DVec3; 4] {
            let (o, u, v) = (self.point(), size * self.point(), size * self.point());
            [o, o + u, o + u + v, o + v]
        }

        /// A point in the hull of `h`.
        fn within(&mut self, h: &[DVec3; 4]) -> DVec3 {
            let (u, v) = (0.5 + 0.5 * self.next(), 0.5 + 0.5 * self.next());
            h[0] + u * (h[1] - h[0]) + v * (h[3] - h[0])
        }
    }

    pub(in super::super) const BANDS: Bands = Bands { apart: 1e-6, slack: 4e-6, near: 8e-6, rounding: 2e-6 };

    pub(in super::super) fn blocks(surface: &Surface, a: DVec3, b: DVec3) -> bool {
        intersect_surface(&Ray { origin: a, direction: b - a, t_min: 1e-6, t_max: 1.0 - 1e-6 }, surface)
            .is_some()
    }

    #[test]
    fn proofs_hold_for_every_segment() {
        let mut random = Random(2);
        let mut found = [0; 3];
        for k in 0..20_000 {
            let surface = random.surface();
            let size = if k % 2 == 0 { 0.1 } else { 0.5 };
            let (a, b) = (random.hull(size), random.hull(size));
            let blocker = Blocker::new(&surface, &BANDS);
            let verdict = blocker.judge(&a, &b, 8.0);
            found[verdict as usize] += 1;
            for _ in 0..20 {
                let hit = blocks(&surface, random.within(&a), random.within(&b));
                assert!(verdict != Verdict::Clear || !hit, "{surface:?} {a:?} {b:?}");
                assert!(verdict != Verdict::Covers || hit, "{surface:?} {a:?} {b:?}");
            }
        }
        assert!(found.iter().all(|&n| n > 100), "{found:?}");
    }

    #[test]
    fn a_surface_without_area_proves_nothing() {
        let p = DVec3::splat(0.5);
        for shape in [Shape::Quad([p; 4]), Shape::Triangle([DVec3::ZERO, p, 0.5 * p])] {
            let blocker = Blocker::new(&Surface::new(shape), &BANDS);
            let mut random = Random(3);
            assert_eq!(blocker.judge(&random.hull(1.0), &random.hull(1.0), 8.0), Verdict::Clear);
        }
    }
}

//! What stands on a surface, and which sample points it parts from a place.
//!
//! A pane or a wall that stands on the floor has light on one side and shade on the other, and so has
//! the corner of a block. Sample points across it are close, but say nothing about this side. The
//! line in which such a thing meets the surface is its foot; a point counts for a place as far as
//! the straight way between them is open.

use super::chart::Chart;
use super::lattice::Lattice;
use super::wave::ray_offset;
use crate::geometry::{Ray, Side, SurfaceId};
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Feet are looked for so high above the surface, as a share of the element's width: what stands a hair's
/// breadth above the surface has a foot too.
const HEIGHT: f64 = 0.01;

/// A way that misses a foot's free end by this share of its length or more, on the wrong side, is
/// closed. Up to there it closes evenly, so that the radiance does not jump behind the end.
const SOFT: f64 = 0.5;

/// Two ends this close, as a share of the foot's length, are one.
const JOINED: f64 = 1e-6;

/// A foot from end to end, in the plane of the surface's chart, m.
pub(super) type Foot = [DVec2; 2];

/// The feet on and around every element.
pub(super) struct Feet {
    starts: Vec<u32>,
    feet: Vec<Foot>,
}

impl Feet {
    /// Finds the feet that part an element from its neighbours, or one of these from theirs, so that on both
    /// sides of an edge the same feet count. `centre` belongs to the elements.
    pub fn new(
        geometry: &Geometry,
        points: &SamplePoints,
        tracer: &dyn RayTracer,
        lattice: &Lattice,
        charts: &[Chart],
        centre: &[DVec3],
    ) -> Self {
        // What is curved has no plane to find feet in, and the parameters of a disc keep no straight lines.
        let ground = |element: usize| {
            let polygon = geometry.surface(points.surface[element]).round().is_none();
            polygon.then(|| Ground::new(geometry, points, element))
        };
        let blockers: Vec<Vec<u32>> = (0..points.len())
            .into_par_iter()
            .map(|element| {
                ground(element).map_or(Vec::new(), |g| g.blockers(tracer, lattice, centre, element))
            })
            .collect();
        let mut found = Feet { starts: vec![0], feet: Vec::new() };
        for element in 0..points.len() {
            let around = lattice.around(element);
            let mut surfaces: Vec<u32> =
                around.iter().flat_map(|&e| blockers[e as usize].iter().copied()).collect();
            surfaces.sort_unstable();
            surfaces.dedup();
            let ground = ground(element);
            let chart = &charts[points.surface[element].index()];
            let feet =
                ground.iter().flat_map(|g| surfaces.iter().filter_map(|&s| g.foot(SurfaceId(s), chart)));
            found.feet.extend(feet);
            found.starts.push(found.feet.len() as u32);
        }
        found
    }

    /// Feet on and around element `i`.
    pub fn of(&self, i: usize) -> &[Foot] {
        &self.feet[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}

/// The side of a foot's line that a place lies on.
#[inline]
pub(super) fn side_of([a, b]: Foot, place: DVec2) -> bool {
    (b - a).perp_dot(place - a) < 0.0
}

/// The plane a little above an element.
struct Ground<'a> {
    geometry: &'a Geometry,
    surface: SurfaceId,
    /// Unit, out of the side that the element lies on.
    up: DVec3,
    height: f64,
}

impl<'a> Ground<'a> {
    fn new(geometry: &'a Geometry, points: &SamplePoints, element: usize) -> Self {
        let surface = points.surface[element];
        let normal = geometry.surface(surface).normal_at(DVec3::ZERO);
        Ground {
            geometry,
            surface,
            up: if points.side[element] == Side::Front { normal } else { -normal },
            height: ray_offset(geometry, surface).max(HEIGHT * f64::from(points.area[element]).sqrt()),
        }
    }

    /// Surfaces met on the ways from the element's centre to its neighbours' and along its border.
    fn blockers(
        &self,
        tracer: &dyn RayTracer,
        lattice: &Lattice,
        centre: &[DVec3],
        element: usize,
    ) -> Vec<u32> {
        let at = centre[element];
        let border = lattice.border.of(element);
        // A little inside, for at the edge of the surface a wall may stand.
        let corner = |k: usize| at.lerp(lattice.position[border[k % border.len()] as usize], 0.99);
        let ways = lattice.around(element).into_iter().map(|e| (at, centre[e as usize]));
        let ways = ways.chain((0..border.len()).map(|k| (corner(k), corner(k + 1))));
        // From both ends: what stands there may have two faces.
        let rays: Vec<Ray> = ways
            .flat_map(|(a, b)| [(a, b), (b, a)])
            .filter_map(|(a, b)| {
                let direction = (b - a).try_normalize()?;
                let origin = a + self.height * self.up;
                Some(Ray { origin, direction, t_min: 0.0, t_max: a.distance(b) })
            })
            .collect();
        let mut hits = vec![None; rays.len()];
        tracer.closest_batch(&rays, &mut hits);
        let patch = |s: SurfaceId| self.geometry.patch[s.index()];
        let mut surfaces: Vec<u32> = hits
            .iter()
            .flatten()
            .map(|hit| hit.surface)
            .filter(|&s| patch(s) != patch(self.surface))
            .map(|s| s.0)
            .collect();
        surfaces.sort_unstable();
        surfaces.dedup();
        surfaces
    }

    /// Where `surface` passes through the plane.
    fn foot(&self, surface: SurfaceId, chart: &Chart) -> Option<Foot> {
        let own = self.geometry.surface(self.surface);
        let vertices = self.geometry.surface(surface).vertices();
        let above = |v: DVec3| own.distance(v) * own.normal_at(v).dot(self.up) - self.height;
        let mut ends = (0..vertices.len()).filter_map(|k| {
            let (a, b) = (vertices[k], vertices[(k + 1) % vertices.len()]);
            let (high, low) = (above(a), above(b));
            ((high < 0.0) != (low < 0.0)).then(|| chart.plane(a.lerp(b, high / (high - low))))
        });
        Some([ends.next()?, ends.next()?])
    }
}

/// Feet, and which of them join at their ends.
pub(super) struct Chain {
    feet: Box<[Foot]>,
    /// By foot and end: the others that begin, end or pass there.
    joined: Box<[[Box<[u32]>; 2]]>,
}

impl Chain {
    /// Of the feet around one element.
    pub fn new(feet: &[Foot]) -> Self {
        let joined = |foot: &Foot, end: DVec2| {
            let near = JOINED * foot[0].distance(foot[1]);
            let others = feet.iter().enumerate();
            let joins = others.filter(|(_, other)| *other != foot && distance(end, **other) <= near);
            joins.map(|(number, _)| number as u32).collect()
        };
        let joined = feet.iter().map(|foot| foot.map(|end| joined(foot, end)));
        Chain { feet: feet.into(), joined: joined.collect() }
    }

    /// The feet.
    pub fn feet(&self) -> &[Foot] {
        &self.feet
    }

    /// How open foot `number` leaves the straight way from `p` to `q`, which lie on two sides of its line: 0 to 1,
    /// continuous but for `p` on the foot.
    #[inline]
    pub fn openness(&self, number: usize, p: DVec2, q: DVec2) -> f64 {
        let way = q - p;
        let side = |at: DVec2| way.perp_dot(at - p);
        let [a, b] = self.feet[number];
        let (side_a, side_b) = (side(a), side(b));
        if (side_a < 0.0) == (side_b < 0.0) {
            return 1.0;
        }
        // An end is free unless another foot goes on from there, away from the way.
        let goes_on = |end: usize, side_end: f64| {
            self.joined[number][end].iter().any(|&other| {
                let beyond = |at: DVec2| side(at) * side_end.signum() > side_end.abs();
                self.feet[other as usize].into_iter().any(beyond)
            })
        };
        let length = a.distance(b);
        let from_a = length * side_a / (side_a - side_b);
        let miss_a = if goes_on(0, side_a) { f64::INFINITY } else { from_a };
        let miss_b = if goes_on(1, side_b) { f64::INFINITY } else { length - from_a };
        let soft = SOFT * way.length();
        (1.0 - miss_a.min(miss_b) / soft).max(0.0)
    }
}

/// Distance of `p` from a segment.
fn distance(p: DVec2, [a, b]: Foot) -> f64 {
    let along = b - a;
    let t = (p - a).dot(along) / along.length_squared();
    p.distance(a + if t > 0.0 { t.min(1.0) } else { 0.0 } * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn foot(ax: f64, ay: f64, bx: f64, by: f64) -> Foot {
        [DVec2::new(ax, ay), DVec2::new(bx, by)]
    }

    fn openness(feet: &[Foot], p: DVec2, q: DVec2) -> f64 {
        let chain = Chain::new(feet);
        let apart = (0..feet.len()).filter(|&k| side_of(feet[k], p) != side_of(feet[k], q));
        apart.fold(1.0, |open, number| open * chain.openness(number, p, q))
    }

    #[test]
    fn ways_across_a_foot_are_closed_and_open_evenly_towards_its_free_end() {
        let feet = [foot(-1.0, 0.0, 1.0, 0.0)];
        let across = |x: f64| openness(&feet, DVec2::new(x, -0.5), DVec2::new(x, 0.5));
        assert_eq!([across(0.0), across(0.5), across(1.0 + 1e-9), across(2.0)], [0.0, 0.0, 1.0, 1.0]);
        assert!((across(0.75) - 0.5).abs() < 1e-12 && across(1.0 - 1e-9) > 1.0 - 1e-8);
        assert_eq!(openness(&feet, DVec2::new(-0.9, 0.1), DVec2::new(0.9, 0.1)), 1.0);
    }

    #[test]
    fn ends_where_another_foot_goes_on_are_not_free() {
        let end = DVec2::new(1.0, 0.0);
        let [from, to] = [DVec2::new(0.99, -0.5), DVec2::new(0.99, 0.5)];
        // Straight on, around a corner, and against the middle of another.
        for other in [foot(1.0, 0.0, 3.0, 0.0), foot(3.0, 1.0, 1.0, 0.0), foot(1.0, -3.0, 1.2, 3.0)] {
            let joint = if other[0].y < -1.0 { DVec2::new(1.1, 0.0) } else { end };
            let feet = [[DVec2::new(-1.0, 0.0), joint], other];
            assert_eq!(openness(&feet, from, to), 0.0, "{other:?}");
        }
        // Back towards the way: the corner of a block, and the way passes just beside it.
        let block = [foot(-1.0, 0.0, 1.0, 0.0), foot(1.0, 0.0, 1.0, 2.0)];
        let open = openness(&block, DVec2::new(0.8, -0.1), DVec2::new(1.2, 0.2));
        assert!(open > 0.0 && open < 1.0, "{open}");
    }
}

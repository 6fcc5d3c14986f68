//! The exact verdict on a segment or a ray, against which every tracer is judged.
//!
//! For each triangle with plane distance d and corners in order, the line A-B crosses the inside if
//! the orientations of (A, B, corner, next corner) agree in sign for its three edges: these signs are
//! computed exactly (J. R. Shewchuk, *Adaptive Precision Floating-Point Arithmetic and Fast Robust
//! Geometric Predicates*, 1997). The crossing lies between the margins if d has opposite signs at
//! A + m (B - A) and B - m (B - A): evaluated in `f64`, whose rounding is far below the band.
//!
//! What is no polygon is judged in `judge_round`, with the same bands.
//!
//! **The band.** A tracer that works in `f32` cannot be held to a decision that hangs on a few units in the
//! last place (`f32`) of the largest coordinate involved: less than [`END_ULPS`] for the distance of either
//! shortened end from the plane, and less than [`EDGE_ULPS`] for the distance between the line and the line of an
//! edge times the sine of their angle (which is what an orientation measures). A segment whose verdict depends on a
//! decision inside the band is [`Verdict::Grazing`]; the inner diagonal of a quad decides nothing and grazes nobody.
//! This is the whole class of segments on which two tracers may differ: outside it all must say the same, which
//! `luxgraph crosscheck` counts and the tests of the tracers demand.
//!
//! Along a ray that goes on, the first surface met may differ where it grazes one, and where two surfaces are met at
//! places that differ by less than the band across either plane: see [`judge_closest`].

use super::{Segment, judge_round};
use crate::geometry::{Ray, Surface, SurfaceId};
use crate::scene::Geometry;
use glam::DVec3;
use robust::{Coord3D, orient3d};

/// Half-width of the band at edges in units in the last place (`f32::EPSILON` times it) of the largest coordinate M
/// of the segment and the surface (or, for rays, of the stretch of ray that matters).
///
/// Embree decides edge p-q of a ray from o by the sign of (q' - p') x (q' + p') . D in `f32`, with p' = p - o and
/// q' = q - o: two subtractions, a sum, two products and a difference in each component, three products and two sums.
/// To first order these eight roundings shift the edge by at most 4 u |q' + p'|, u = EPSILON / 2, and as
/// |p'|, |q'| <= 2 √3 M by less than 14 EPSILON M. Random segments at edges and corners show up to 5.
pub const EDGE_ULPS: f64 = 16.0;

/// The same for the ends of a segment. Measured: no tracer was further off in 1e8 segments a scene, a tenth in planes
/// of surfaces. The margin of a segment is 32 such units along it, so its end clears the plane that it leaves at
/// 8 degrees or more.
pub const END_ULPS: f64 = 4.0;

/// What is true of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// A surface blocks it, whatever the rounding.
    Blocked {
        /// The first surface in the scene's order that does.
        surface: SurfaceId,
    },
    /// Nothing blocks it, whatever the rounding.
    Free,
    /// Within rounding of an edge or of an end: `f32` and `f64` may answer differently.
    Grazing {
        /// The surface that blocks it in exact arithmetic, if any.
        blocked_by: Option<SurfaceId>,
        /// How far the nearest decision is from changing, m; less than the band.
        clearance: f64,
    },
}

impl Verdict {
    /// Whether a tracer that answers `blocked` is wrong beyond rounding.
    pub fn refutes(&self, blocked: bool) -> bool {
        match self {
            Verdict::Blocked { .. } => !blocked,
            Verdict::Free => blocked,
            Verdict::Grazing { .. } => false,
        }
    }
}

/// How a line meets one surface between two parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crossing {
    /// Clear of it by more than the band.
    Misses,
    /// Through its inside by more than the band, at parameter `t`.
    Crosses {
        /// Parameter along the line.
        t: f64,
        /// Where it may already cross the other half of a surface that is out of plane; else `t`.
        earliest: f64,
    },
    /// Within the band of an edge or a limit.
    Grazes {
        /// The exact answer.
        crosses: bool,
        /// Distance to the nearest change of answer, m.
        clearance: f64,
    },
}

/// Judges the segment against all surfaces. A segment that is not finite is free.
pub fn judge(geometry: &Geometry, segment: &Segment) -> Verdict {
    let (from, to) = (segment.from.as_dvec3(), segment.to.as_dvec3());
    if !(from.is_finite() && to.is_finite()) || from == to {
        return Verdict::Free;
    }
    let margin = f64::from(segment.margin());
    let mut blocked_by = None;
    let mut nearest: Option<f64> = None;
    for (i, surface) in geometry.surfaces.iter().enumerate() {
        let surface_id = SurfaceId(i as u32);
        match crossing(surface, from, to, margin, 1.0 - margin) {
            Crossing::Misses => {}
            Crossing::Crosses { .. } => return Verdict::Blocked { surface: surface_id },
            Crossing::Grazes { crosses, clearance } => {
                nearest = Some(nearest.map_or(clearance, |n: f64| n.min(clearance)));
                if crosses {
                    blocked_by = blocked_by.or(Some(surface_id));
                }
            }
        }
    }
    nearest.map_or(Verdict::Free, |clearance| Verdict::Grazing { blocked_by, clearance })
}

/// The surfaces that a tracer may report as the closest along `ray`, and whether it may report none.
#[derive(Clone, Debug, PartialEq)]
pub struct Closest {
    /// All defensible answers; one unless the ray grazes or surfaces coincide.
    pub surfaces: Vec<SurfaceId>,
    /// Whether "nothing" is defensible.
    pub nothing: bool,
}

impl Closest {
    /// Whether a tracer that says `surface` is right, or wrong only within rounding.
    pub fn allows(&self, surface: Option<SurfaceId>) -> bool {
        surface.map_or(self.nothing, |s| self.surfaces.contains(&s))
    }
}

/// Judges the closest hit along `ray`, which is cut at twice the size of the scene beyond its origin. Defensible are
/// the surfaces that it may meet, within the band, before it has certainly met one.
pub fn judge_closest(geometry: &Geometry, ray: &Ray) -> Closest {
    let length = ray.direction.length();
    let reach = (2.0 * (geometry.radius + ray.origin.length()) / length).min(ray.t_max);
    let runs = reach.is_finite() && reach > ray.t_min && ray.origin.is_finite() && ray.direction.is_finite();
    if !runs {
        return Closest { surfaces: Vec::new(), nothing: true };
    }
    let end = ray.at(reach);
    let band = ulps(EDGE_ULPS, ray.origin.abs().max(end.abs()).max_element());
    // Where along the line each surface may be met, from and to, as parameters of `from`-`end`.
    let mut certain = Vec::new();
    let mut doubtful = Vec::new();
    let direction = end - ray.origin;
    for (i, surface) in geometry.surfaces.iter().enumerate() {
        let id = SurfaceId(i as u32);
        match crossing(surface, ray.origin, end, ray.t_min / reach, 1.0) {
            Crossing::Misses => {}
            Crossing::Crosses { t, earliest } => {
                // Oblique surfaces blur the order of hits: the band is across the plane, not along the ray.
                let blur = match surface.round() {
                    Some(round) => judge_round::blur(round, ray.origin, end, t, band),
                    None => band / surface.normal_at(ray.origin).dot(direction).abs(),
                };
                certain.push((id, earliest - blur, t + blur));
            }
            Crossing::Grazes { .. } => {
                let bounds = surface.bounds();
                let (enters, _) = span_in_box(bounds.min - band, bounds.max + band, ray.origin, end);
                doubtful.push((id, enters));
            }
        }
    }
    // What is certainly met stops the ray: nothing that lies beyond is an answer.
    let stop = certain.iter().map(|&(.., latest)| latest).fold(f64::INFINITY, f64::min);
    let certain_ids = certain.iter().filter(|c| c.1 <= stop).map(|c| c.0);
    let doubtful_ids = doubtful.iter().filter(|d| d.1 <= stop).map(|d| d.0);
    Closest { surfaces: certain_ids.chain(doubtful_ids).collect(), nothing: certain.is_empty() }
}

/// How the line from `from` (parameter 0) to `to` (parameter 1) meets `surface` between the parameters
/// `t_min` and `t_max`.
pub fn crossing(surface: &Surface, from: DVec3, to: DVec3, t_min: f64, t_max: f64) -> Crossing {
    let bounds = surface.bounds();
    let largest = from.abs().max(to.abs()).max(bounds.min.abs()).max(bounds.max.abs()).max_element();
    let band = ulps(EDGE_ULPS, largest);
    let (enter, leave) = span_in_box(bounds.min - band, bounds.max + band, from, to);
    if enter > leave {
        return Crossing::Misses;
    }
    if let Some(round) = surface.round() {
        return judge_round::crossing(round, from, to, [t_min, t_max], largest);
    }
    let (triangles, count) = surface.triangles();
    let first = cross_triangle(&triangles[0], from, to, [t_min, t_max], largest);
    if count == 1 {
        return first.crossing();
    }
    first.or_neighbour(&cross_triangle(&triangles[1], from, to, [t_min, t_max], largest))
}

/// So many units in the last place of a coordinate, m.
pub(super) fn ulps(count: f64, coordinate: f64) -> f64 {
    count * f64::from(f32::EPSILON) * coordinate
}

/// A decision: its exact sign, and whether it is further from changing than the band.
#[derive(Clone, Copy)]
struct Sign {
    exact: f64,
    distance: f64,
    certain: bool,
}

impl Sign {
    /// `volume` has the sign; divided by `scale` it is a distance.
    fn new(volume: f64, scale: f64, band: f64) -> Self {
        let distance = (volume / scale).abs();
        Sign { exact: volume, distance, certain: distance > band }
    }

    fn is(self, sign: f64) -> bool {
        self.certain && self.exact * sign > 0.0
    }
}

/// The decisions about one triangle; edge k runs from corner k to corner k + 1.
struct Decisions {
    edges: [Sign; 3],
    starts: Sign,
    ends: Sign,
    t: f64,
}

fn cross_triangle(v: &[DVec3; 3], a: DVec3, b: DVec3, [t_min, t_max]: [f64; 2], largest: f64) -> Decisions {
    let (edge_band, end_band) = (ulps(EDGE_ULPS, largest), ulps(END_ULPS, largest));
    let length = (b - a).length();
    let edge = |k: usize| {
        let (p, q) = (v[k], v[(k + 1) % 3]);
        Sign::new(orientation(a, b, p, q), length * (q - p).length(), edge_band)
    };
    let twice_area = (v[1] - v[0]).cross(v[2] - v[0]).length();
    let (at_a, at_b) = (orientation(v[0], v[1], v[2], a), orientation(v[0], v[1], v[2], b));
    let plane = |t: f64| Sign::new((1.0 - t) * at_a + t * at_b, twice_area, end_band);
    Decisions {
        edges: [edge(0), edge(1), edge(2)],
        starts: plane(t_min),
        ends: plane(t_max),
        // Of a line along the plane nothing is known but where it begins.
        t: if at_a == at_b { t_min } else { (at_a / (at_a - at_b)).max(t_min).min(t_max) },
    }
}

impl Decisions {
    /// Whether a certain decision alone keeps the line off the triangle.
    fn misses(&self) -> bool {
        let beside = self.edges.iter().any(|e| e.is(1.0)) && self.edges.iter().any(|e| e.is(-1.0));
        let same_side = self.starts.certain && self.ends.is(self.starts.exact);
        beside || same_side
    }

    /// Whether the plane is certainly crossed between the limits.
    fn crosses_plane(&self) -> bool {
        self.starts.certain && self.ends.is(-self.starts.exact)
    }

    fn crosses_exactly(&self) -> bool {
        let e = self.edges.map(|e| e.exact);
        let one_side = e.iter().all(|&x| x >= 0.0) || e.iter().all(|&x| x <= 0.0);
        one_side && e.iter().any(|&x| x != 0.0) && self.starts.exact * self.ends.exact < 0.0
    }

    fn clearance(&self) -> f64 {
        let signs = [self.edges[0], self.edges[1], self.edges[2], self.starts, self.ends];
        signs.iter().filter(|s| !s.certain).map(|s| s.distance).fold(f64::INFINITY, f64::min)
    }

    fn crossing(&self) -> Crossing {
        if self.misses() {
            return Crossing::Misses;
        }
        let sign = self.edges[0].exact;
        if self.crosses_plane() && self.edges.iter().all(|e| e.is(sign)) {
            return Crossing::Crosses { t: self.t, earliest: self.t };
        }
        Crossing::Grazes { crosses: self.crosses_exactly(), clearance: self.clearance() }
    }

    /// The two triangles of a quad, whose edge 1 is the shared diagonal. Through the diagonal is through the quad:
    /// the two sides of it are exactly opposite, so one of the triangles is met.
    fn or_neighbour(&self, other: &Decisions) -> Crossing {
        let (mine, its) = (self.crossing(), other.crossing());
        let sign = self.edges[0].exact;
        let outer = [self.edges[0], self.edges[2], other.edges[0], other.edges[2]];
        let through = self.crosses_plane() && other.crosses_plane() && outer.iter().all(|e| e.is(sign));
        let (t, u) = (self.t, other.t);
        let both = t.min(u);
        match (mine, its) {
            // A line may cross both halves of a quadrilateral that is out of plane.
            (Crossing::Crosses { .. }, Crossing::Crosses { .. }) => {
                Crossing::Crosses { t: both, earliest: both }
            }
            (Crossing::Crosses { .. }, Crossing::Grazes { .. }) => Crossing::Crosses { t, earliest: both },
            (Crossing::Grazes { .. }, Crossing::Crosses { .. }) => Crossing::Crosses { t: u, earliest: both },
            (Crossing::Crosses { .. }, _) => mine,
            (_, Crossing::Crosses { .. }) => its,
            _ if through => Crossing::Crosses { t: t.max(u), earliest: both },
            (
                Crossing::Grazes { crosses: a, clearance: x },
                Crossing::Grazes { crosses: b, clearance: y },
            ) => Crossing::Grazes { crosses: a || b, clearance: x.min(y) },
            (Crossing::Grazes { .. }, _) => mine,
            _ => its,
        }
    }
}

/// Six times the signed volume of p q r s; the sign is exact.
fn orientation(p: DVec3, q: DVec3, r: DVec3, s: DVec3) -> f64 {
    let coord = |v: DVec3| Coord3D { x: v.x, y: v.y, z: v.z };
    orient3d(coord(p), coord(q), coord(r), coord(s))
}

/// The parameters between which the line from `from` (0) to `to` (1) runs through the box, kept to 0..1; the
/// first is greater than the second if it stays outside.
fn span_in_box(min: DVec3, max: DVec3, from: DVec3, to: DVec3) -> (f64, f64) {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for k in 0..3 {
        let d = to[k] - from[k];
        if d == 0.0 {
            if from[k] < min[k] || from[k] > max[k] {
                return (1.0, 0.0);
            }
            continue;
        }
        let (x, y) = ((min[k] - from[k]) / d, (max[k] - from[k]) / d);
        enter = enter.max(x.min(y));
        leave = leave.min(x.max(y));
    }
    (enter, leave)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::scene::ObjectId;
    use glam::Vec3;

    /// The square |x|, |y| <= 1 in z = 0, in a scene centred on it.
    fn square() -> Geometry {
        let v = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        Geometry::new(vec![(Shape::Quad(v), false, 0, ObjectId(0))], vec!["square".into()])
    }

    fn verdict(from: [f32; 3], to: [f32; 3]) -> Verdict {
        judge(&square(), &Segment { from: Vec3::from(from), to: Vec3::from(to) })
    }

    const BLOCKED: Verdict = Verdict::Blocked { surface: SurfaceId(0) };

    #[test]
    fn clear_cases_are_decided() {
        assert_eq!(verdict([0.3, 0.1, 1.0], [-0.2, 0.4, -1.0]), BLOCKED);
        assert_eq!(verdict([1.5, 0.0, 1.0], [1.5, 0.0, -1.0]), Verdict::Free);
        assert_eq!(verdict([0.3, 0.1, 1.0], [-0.2, 0.4, 0.5]), Verdict::Free);
        assert_eq!(verdict([f32::NAN, 0.1, 1.0], [0.0, 0.0, -1.0]), Verdict::Free);
    }

    #[test]
    fn the_diagonal_of_a_quad_is_no_edge() {
        assert_eq!(verdict([0.5, -0.5, 1.0], [0.5, -0.5, -1.0]), BLOCKED);
        assert_eq!(verdict([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]), BLOCKED);
    }

    #[test]
    fn an_edge_is_grazed_on_either_side_within_the_band_only() {
        let ulp = f32::EPSILON;
        for (x, blocked) in [(1.0 - 4.0 * ulp, true), (1.0, true), (1.0 + 4.0 * ulp, false)] {
            match verdict([x, 0.1, 1.0], [x, 0.1, -1.0]) {
                Verdict::Grazing { blocked_by, clearance } => {
                    assert_eq!(blocked_by.is_some(), blocked, "x = {x}");
                    assert!((clearance - f64::from((x - 1.0).abs())).abs() < 1e-12, "x = {x}: {clearance}");
                }
                other => panic!("x = {x}: {other:?}"),
            }
        }
        assert_eq!(verdict([1.0 - 40.0 * ulp, 0.1, 1.0], [1.0 - 40.0 * ulp, 0.1, -1.0]), BLOCKED);
        assert_eq!(verdict([1.0 + 40.0 * ulp, 0.1, 1.0], [1.0 + 40.0 * ulp, 0.1, -1.0]), Verdict::Free);
    }

    #[test]
    fn a_segment_that_leaves_the_surface_is_free_and_clear_of_it() {
        // The margin of a sample pair lifts its end off its own plane by more than the band.
        assert_eq!(verdict([0.2, 0.3, 0.0], [0.4, -0.6, 0.7]), Verdict::Free);
        assert_eq!(verdict([0.4, -0.6, 0.7], [0.2, 0.3, 0.0]), Verdict::Free);
    }

    #[test]
    fn a_segment_in_the_plane_grazes_beside_nothing() {
        assert!(matches!(
            verdict([-2.0, 0.0, 0.0], [2.0, 0.1, 0.0]),
            Verdict::Grazing { blocked_by: None, .. }
        ));
        assert_eq!(verdict([1.5, -2.0, 0.0], [1.6, 2.0, 0.0]), Verdict::Free);
    }

    #[test]
    fn both_of_two_coincident_surfaces_may_be_the_closest() {
        let one = square().surfaces[0].shape.clone();
        let geometry = Geometry::new(
            vec![(one.clone(), false, 0, ObjectId(0)), (one, false, 1, ObjectId(0))],
            vec!["twins".into()],
        );
        let ray = Ray { origin: DVec3::Z, direction: -DVec3::Z, t_min: 0.0, t_max: f64::INFINITY };
        let closest = judge_closest(&geometry, &ray);
        assert!(closest.allows(Some(SurfaceId(0))) && closest.allows(Some(SurfaceId(1))));
        assert!(!closest.allows(None));
    }
}

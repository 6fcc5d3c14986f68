//! The exact verdict on a line and a disc or a sphere.
//!
//! All in `f64`, whose rounding (some 1e-15 of the coordinates) is eight orders below the bands. A line keeps the
//! bands of [`super::judge`]: an end of it is uncertain within [`END_ULPS`] of the plane or the sphere, the line itself
//! within [`EDGE_ULPS`] of being a tangent of the sphere, or of passing the rim of the disc (the distance of the two
//! lines in space times the sine of their angle, as for edges).

use super::judge::{Crossing, EDGE_ULPS, END_ULPS, ulps};
use super::{judge_cone, judge_patch};
use crate::geometry::{Disc, Ray, Round, Sphere};
use glam::DVec3;

/// How the line from `from` (parameter 0) to `to` (parameter 1) meets `round` between the parameters.
pub(super) fn crossing(round: &Round, from: DVec3, to: DVec3, limits: [f64; 2], largest: f64) -> Crossing {
    let bands = [ulps(EDGE_ULPS, largest), ulps(END_ULPS, largest)];
    match round {
        Round::Disc(disc) => disc_crossing(disc, from, to, limits, bands),
        Round::Sphere(sphere) => sphere_crossing(sphere, from, to, limits, bands),
        Round::Cone(cone) => judge_cone::crossing(cone, from, to, limits, bands),
        Round::Patch(patch) => judge_patch::crossing(patch, from, to, limits, bands),
    }
}

/// How far the parameter of a certain crossing at `t` may be off either way when the surface is by `band`.
pub(super) fn blur(round: &Round, from: DVec3, to: DVec3, t: f64, band: f64) -> f64 {
    let ray = Ray { origin: from, direction: to - from, t_min: 0.0, t_max: 1.0 };
    match round {
        Round::Disc(disc) => band / disc.normal.dot(ray.direction).abs(),
        Round::Cone(cone) => judge_cone::blur(cone, from, to, t, band),
        Round::Patch(patch) => judge_patch::blur(patch, from, to, t, band),
        Round::Sphere(sphere) => {
            let [first, second] = sphere.crossings(&ray);
            let which = usize::from((second - t).abs() < (first - t).abs());
            let shift = |radius: f64| (Sphere { radius, ..*sphere }.crossings(&ray)[which] - t).abs();
            // Where the smaller sphere is missed the line may as well be a tangent.
            let inner = shift(sphere.radius - band);
            let inner = if inner.is_nan() { 0.5 * (second - first) } else { inner };
            inner.max(shift(sphere.radius + band))
        }
    }
}

fn sphere_crossing(
    sphere: &Sphere,
    from: DVec3,
    to: DVec3,
    [t_min, t_max]: [f64; 2],
    [edge_band, end_band]: [f64; 2],
) -> Crossing {
    let direction = to - from;
    let height = |t: f64| (from + t * direction).distance(sphere.centre) - sphere.radius;
    let foot = (sphere.centre - from).dot(direction) / direction.length_squared();
    // Along the line the distance from the centre falls down to the foot and rises from there.
    let mut stations = vec![(t_min, height(t_min), end_band), (t_max, height(t_max), end_band)];
    if foot > t_min && foot < t_max {
        stations.insert(1, (foot, height(foot), edge_band));
    }
    let ray = Ray { origin: from, direction, t_min, t_max };
    let exact = Round::Sphere(*sphere).intersect(&ray);
    let certain = |(_, height, band): (f64, f64, f64)| height.abs() > band;
    let crosses = stations
        .windows(2)
        .position(|pair| certain(pair[0]) && certain(pair[1]) && (pair[0].1 < 0.0) != (pair[1].1 < 0.0));
    if let Some(k) = crosses {
        let roots = sphere.crossings(&ray);
        // On the way down the first root, on the way up the second.
        let t = roots[usize::from(stations[k].1 < 0.0)].max(stations[k].0).min(stations[k + 1].0);
        let doubtful = stations[..k].iter().copied().find(|&s| !certain(s));
        return Crossing::Crosses { t, earliest: doubtful.map_or(t, |s| s.0.min(t)) };
    }
    if stations.iter().all(|&s| certain(s)) {
        return Crossing::Misses;
    }
    let doubts = stations.iter().filter(|&&s| !certain(s)).map(|s| s.1.abs());
    Crossing::Grazes { crosses: exact.is_some(), clearance: doubts.fold(f64::INFINITY, f64::min) }
}

fn disc_crossing(
    disc: &Disc,
    from: DVec3,
    to: DVec3,
    [t_min, t_max]: [f64; 2],
    [edge_band, end_band]: [f64; 2],
) -> Crossing {
    let direction = to - from;
    let length = direction.length();
    let speed = disc.normal.dot(direction);
    let height = |t: f64| disc.normal.dot(from + t * direction - disc.centre);
    let (start, end) = (height(t_min), height(t_max));
    let nearest = {
        let foot = (disc.centre - from).dot(direction) / (length * length);
        (from + foot.clamp(t_min, t_max) * direction).distance(disc.centre) - disc.radius
    };
    let sure = [start, end].map(|h| h.abs() > end_band);
    if nearest > edge_band || sure == [true; 2] && (start < 0.0) == (end < 0.0) {
        return Crossing::Misses;
    }
    // Of a line along the plane nothing is known but where it begins.
    let t = disc.normal.dot(disc.centre - from) / speed;
    let t = if t.is_finite() { t } else { t_min };
    let beyond = (from + t * direction).distance(disc.centre) - disc.radius;
    let rim = beyond * speed.abs() / length;
    if rim > edge_band {
        return Crossing::Misses;
    }
    let opposite = (start < 0.0) != (end < 0.0);
    if sure == [true; 2] && rim < -edge_band && opposite {
        let t = t.max(t_min).min(t_max);
        return Crossing::Crosses { t, earliest: t };
    }
    let doubts = [(start, end_band), (end, end_band), (rim, edge_band)];
    let doubts = doubts.iter().filter(|(x, band)| x.abs() <= *band).map(|(x, _)| x.abs());
    let crosses = rim <= 0.0 && start * end < 0.0;
    Crossing::Grazes { crosses, clearance: doubts.fold(f64::INFINITY, f64::min) }
}

#[cfg(test)]
mod tests {
    use super::super::Segment;
    use super::super::judge::{Verdict, judge};
    use super::*;
    use crate::geometry::{Cone, Shape, SurfaceId};
    use crate::scene::{Geometry, ObjectId};
    use glam::Vec3;

    fn verdict(shape: Shape, from: [f32; 3], to: [f32; 3]) -> Verdict {
        let geometry = Geometry::new(vec![(shape, false, 0, ObjectId(0))], vec!["round".into()]);
        judge(&geometry, &Segment { from: Vec3::from(from), to: Vec3::from(to) })
    }

    const BLOCKED: Verdict = Verdict::Blocked { surface: SurfaceId(0) };

    fn ball(inward: bool) -> Shape {
        Shape::from(Sphere { centre: DVec3::ZERO, radius: 1.0, inward })
    }

    #[test]
    fn spheres_are_decided_by_their_ends_and_by_the_line() {
        for inward in [false, true] {
            let verdict = |from, to| verdict(ball(inward), from, to);
            assert_eq!(verdict([-2.0, 0.3, 0.1], [2.0, 0.2, -0.1]), BLOCKED, "through");
            assert_eq!(verdict([-2.0, 0.3, 0.1], [0.2, 0.2, -0.1]), BLOCKED, "into");
            assert_eq!(verdict([0.2, 0.3, 0.1], [0.2, 0.2, -5.0]), BLOCKED, "out of");
            assert_eq!(verdict([0.5, 0.3, 0.1], [-0.2, 0.2, -0.1]), Verdict::Free, "within");
            assert_eq!(verdict([-2.0, 1.1, 0.0], [2.0, 1.1, 0.0]), Verdict::Free, "beside");
            assert_eq!(verdict([-2.0, 0.3, 0.1], [-1.5, 0.2, -0.1]), Verdict::Free, "before");
            assert_eq!(verdict([-1.0, 0.0, 0.0], [1.5, 0.2, -0.1]), BLOCKED, "from it, through it");
            assert_eq!(verdict([-1.0, 0.0, 0.0], [-2.5, 0.2, -0.1]), Verdict::Free, "from it, away");
        }
    }

    #[test]
    fn tangents_graze_within_the_band_only() {
        let ulp = f32::EPSILON;
        let at = |y: f32| verdict(ball(false), [-2.0, y, 0.0], [2.0, y, 0.0]);
        for (y, blocked) in [(1.0 - 4.0 * ulp, true), (1.0 + 4.0 * ulp, false)] {
            match at(y) {
                Verdict::Grazing { blocked_by, clearance } => {
                    assert_eq!(blocked_by.is_some(), blocked, "{y}");
                    assert!((clearance - f64::from((y - 1.0).abs())).abs() < 1e-12, "{y}: {clearance}");
                }
                other => panic!("{y}: {other:?}"),
            }
        }
        assert_eq!(at(1.0 - 40.0 * ulp), BLOCKED);
        assert_eq!(at(1.0 + 40.0 * ulp), Verdict::Free);
    }

    #[test]
    fn discs_are_decided_by_their_plane_and_their_rim() {
        let disc = Shape::from(Disc { centre: DVec3::ZERO, normal: DVec3::Z, radius: 1.0 });
        let verdict = |from, to| verdict(disc.clone(), from, to);
        assert_eq!(verdict([0.5, 0.5, 1.0], [0.5, 0.5, -1.0]), BLOCKED);
        assert_eq!(verdict([0.8, 0.8, 1.0], [0.8, 0.8, -1.0]), Verdict::Free, "a corner of its box");
        assert_eq!(verdict([0.5, 0.5, 1.0], [0.5, 0.5, 0.1]), Verdict::Free);
        assert_eq!(verdict([0.2, 0.3, 0.0], [0.4, -0.6, 0.7]), Verdict::Free, "from it");
        let ulp = f32::EPSILON;
        let at = |x: f32| verdict([x, 0.0, 1.0], [x, 0.0, -1.0]);
        assert!(matches!(at(1.0 - 4.0 * ulp), Verdict::Grazing { blocked_by: Some(_), .. }));
        assert!(matches!(at(1.0 + 4.0 * ulp), Verdict::Grazing { blocked_by: None, .. }));
        assert_eq!((at(1.0 - 40.0 * ulp), at(1.0 + 40.0 * ulp)), (BLOCKED, Verdict::Free));
        assert!(
            matches!(verdict([-2.0, 0.1, 0.0], [2.0, 0.1, 0.0]), Verdict::Grazing { .. }),
            "in its plane"
        );
        assert_eq!(verdict([-2.0, 1.2, 0.0], [2.0, 1.2, 0.0]), Verdict::Free, "in its plane, beside it");
    }

    #[test]
    fn cones_are_decided_by_their_ends_their_rims_and_the_line() {
        let cone = |top_radius: f64| {
            Shape::from(Cone { base: DVec3::NEG_Z, top: DVec3::Z, radius: 1.0, top_radius, inward: false })
        };
        for top in [1.0, 0.5] {
            let verdict = |from, to| verdict(cone(top), from, to);
            assert_eq!(verdict([-2.0, 0.3, 0.1], [2.0, 0.2, -0.1]), BLOCKED, "through");
            assert_eq!(verdict([-0.3, 0.3, 0.1], [2.0, 0.2, -0.1]), BLOCKED, "out of");
            assert_eq!(verdict([0.1, 0.2, 5.0], [0.2, 0.1, -5.0]), Verdict::Free, "in and out at the ends");
            assert_eq!(verdict([-2.0, 0.0, 1.1], [2.0, 0.0, 1.1]), Verdict::Free, "over the top");
            assert_eq!(verdict([-2.0, 1.1, 0.0], [2.0, 1.1, 0.0]), Verdict::Free, "beside");
            // Along the side, from beyond the base to beyond the top.
            let along = |off: f32| {
                let at = |z: f32| [0.5 * (1.0 + top as f32) - 0.5 * z * (1.0 - top as f32) + off, 0.0, z];
                verdict(at(-2.0), at(2.0))
            };
            assert!(matches!(along(0.0), Verdict::Grazing { .. }), "{top}: {:?}", along(0.0));
            assert_eq!((along(1e-4), along(-1e-4)), (Verdict::Free, Verdict::Free));
        }
    }
}

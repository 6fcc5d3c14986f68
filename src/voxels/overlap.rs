//! Whether a triangle meets a box, by separating axes, or a surface that is no polygon does.

use crate::geometry::{Aabb, Round};
use glam::DVec3;

/// Whether `triangle` meets the box of centre `centre` and half edges `half`, touching included.
/// Of the 13 axes that can separate them (box faces, triangle plane, edge by edge) none may. A
/// degenerate axis separates nothing, so errors are on the side of meeting.
pub(super) fn triangle_meets_box(triangle: &[DVec3; 3], centre: DVec3, half: DVec3) -> bool {
    let v = triangle.map(|p| p - centre);
    let apart = |axis: DVec3| {
        let reach = half.dot(axis.abs());
        let along = v.map(|p| p.dot(axis));
        along[0].min(along[1]).min(along[2]) > reach || along[0].max(along[1]).max(along[2]) < -reach
    };
    if DVec3::AXES.into_iter().any(apart) {
        return false;
    }
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    !apart(edges[0].cross(edges[1]))
        && !edges.iter().any(|e| DVec3::AXES.into_iter().any(|axis| apart(axis.cross(*e))))
}

/// Whether `round` may meet the box: never false where it does. For a sphere the answer is exact; other
/// boxes near it may be taken to meet it.
pub(super) fn round_meets_box(round: &Round, centre: DVec3, half: DVec3) -> bool {
    let offset = (round.centre() - centre).abs();
    let nearest = (offset - half).max(DVec3::ZERO).length();
    match round {
        Round::Sphere(sphere) => {
            let furthest = (offset + half).length();
            // The box is padded by far more than these sums are rounded by.
            nearest <= sphere.radius && furthest >= sphere.radius
        }
        Round::Patch(patch) => patch.may_meet_box(&Aabb { min: centre - half, max: centre + half }),
        Round::Cone(cone) => {
            // The distance from the endless cone changes by no more than the way to a corner.
            let axis = cone.axis();
            let bounds = round.bounds();
            let (up, reach) = (cone.profile(centre).up, axis.abs().dot(half));
            cone.outside(centre).abs() <= half.length()
                && up - reach <= cone.height()
                && up + reach >= 0.0
                && bounds.min.cmple(centre + half).all()
                && bounds.max.cmpge(centre - half).all()
        }
        Round::Disc(disc) => {
            let bounds = round.bounds();
            nearest <= disc.radius
                && disc.normal.dot(disc.centre - centre).abs() <= disc.normal.abs().dot(half)
                && bounds.min.cmple(centre + half).all()
                && bounds.max.cmpge(centre - half).all()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_axis_separates() {
        let half = DVec3::ONE;
        let meets = |t: [[f64; 3]; 3]| triangle_meets_box(&t.map(DVec3::from), DVec3::ZERO, half);
        assert!(meets([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]]), "a corner inside");
        assert!(meets([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]]), "all corners outside");
        assert!(meets([[1.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 5.0, 0.0]]), "touching a face");
        assert!(!meets([[1.1, 0.0, 0.0], [5.0, 0.0, 0.0], [5.0, 5.0, 0.0]]), "beyond a face");
        let plane = |d: f64| [[d, 0.0, 0.0], [0.0, d, 0.0], [0.0, 0.0, d]];
        assert!(meets(plane(2.9)) && !meets(plane(3.1)), "the triangle's plane");
        // Past the box's vertical edge at (1, 1): the axis is z x edge. The boxes overlap.
        let wall = |d: f64| [[d, 0.0, -5.0], [0.0, d, -5.0], [0.5 * d, 0.5 * d, 5.0]];
        assert!(meets(wall(1.9)) && !meets(wall(2.1)), "an edge by an edge");
    }

    #[test]
    fn round_surfaces_meet_the_boxes_that_hold_their_points() {
        use crate::geometry::{Cone, Disc, Sphere};
        let centre = DVec3::new(0.2, -0.1, 0.4);
        let normal = DVec3::new(0.3, 1.0, -0.5).normalize();
        let rounds = [
            Round::Sphere(Sphere { centre, radius: 1.3, inward: false }),
            Round::Disc(Disc { centre, normal, radius: 1.3 }),
            Round::Cone(Cone {
                base: centre - normal,
                top: centre + normal,
                radius: 0.9,
                top_radius: 0.2,
                inward: false,
            }),
            Round::Cone(Cone {
                base: centre - normal,
                top: centre + normal,
                radius: 0.7,
                top_radius: 0.7,
                inward: true,
            }),
        ];
        let half = DVec3::splat(0.1);
        for round in rounds {
            let mut met = std::collections::HashSet::new();
            for i in 0..=300 {
                for j in 0..=300 {
                    let p = round.point_at(f64::from(i) / 300.0, f64::from(j) / 300.0);
                    met.insert((p / 0.2).floor().as_ivec3().to_array());
                }
            }
            let (mut found, mut all) = (0, 0);
            for x in -10..10 {
                for y in -10..10 {
                    for z in -10..10 {
                        let middle = 0.2 * DVec3::new(f64::from(x), f64::from(y), f64::from(z)) + 0.1;
                        let meets = round_meets_box(&round, middle, half);
                        assert!(meets || !met.contains(&[x, y, z]), "{round:?} {middle}");
                        found += i32::from(meets);
                        all += 1;
                    }
                }
            }
            assert!(found < 2 * met.len() as i32 && found < all / 4, "{found} {} {all}", met.len());
        }
    }

    #[test]
    fn agrees_with_sampling_the_triangle() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 * 6.0 - 3.0
        };
        let mut met = 0;
        for _ in 0..2000 {
            let t = [0; 3].map(|_| DVec3::new(next(), next(), next()));
            let sampled = (0..=40).any(|i| {
                (0..=40 - i).any(|j| {
                    let (u, v) = (f64::from(i) / 40.0, f64::from(j) / 40.0);
                    ((1.0 - u - v) * t[0] + u * t[1] + v * t[2]).abs().max_element() < 1.0
                })
            });
            let meets = triangle_meets_box(&t, DVec3::ZERO, DVec3::ONE);
            assert!(meets || !sampled, "{t:?}");
            // A triangle this big that comes 0.2 inside is not missed by the sampling.
            let deep = triangle_meets_box(&t, DVec3::ZERO, DVec3::splat(0.8));
            assert!(sampled || !deep, "{t:?}");
            met += usize::from(meets);
        }
        assert!(met > 500 && met < 1900);
    }
}

//! Form factors to surfaces that are no polygons: q = π F, as in [`super::form_factor`].

use super::form_factor::NEAR;
use crate::geometry::{Cone, Disc, Profile, Round, Side};
use crate::points::{Middle, Piece};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Pieces are not divided more often than this for the sake of one point; what is closer than that to a point of
/// another surface is next to nothing of the hemisphere.
const DEEPEST: u8 = 8;

/// Of a piece of a surface that is no polygon seen from a point of another surface: the plain kernel over pieces of
/// it, each with its own place and normal, as small as that is right for; what is below the horizon or faces away does
/// not count. Some or none of the [`Piece::middles`] are `known`.
pub fn of_piece(position: Vec3, normal: Vec3, piece: &Piece, known: &[Middle]) -> f64 {
    let (o, n) = (position.as_dvec3(), normal.as_dvec3());
    let fine = |place: DVec3, area: f64| area <= 0.25 * f64::from(NEAR) * place.distance_squared(o);
    let q = piece.sum(known, DEEPEST, fine, |place, its, area| {
        let d = place - o;
        let r2 = d.length_squared();
        let kernel = area * n.dot(d).max(0.0) * (-its.dot(d)).max(0.0) / (r2 * r2);
        if kernel.is_finite() { kernel.min(PI) } else { 0.0 }
    });
    q.min(PI)
}

/// Of a piece of a hollow surface seen from the middle of another piece of it, or of itself. On the inside of a sphere
/// d_i = d_j = r² / 2R, so the kernel is A / 4R² whatever the points. Elsewhere it is bounded in the same way, by the
/// curvature, and some few pieces add up to it however near they are; but for the tip of a cone, about which it turns
/// within an element. Some or none of the [`Piece::middles`] are `known`.
pub fn of_own(from: &Piece, piece: &Piece, known: &[Middle]) -> f64 {
    if let Round::Sphere(sphere) = piece.round {
        return piece.area() / (4.0 * sphere.radius * sphere.radius);
    }
    let o = from.at(0.5, 0.5);
    let n = from.normal_at(o);
    let fine = |place: DVec3, area: f64| area <= 0.02 * place.distance_squared(o);
    piece.sum(known, 4, fine, |place, its, area| {
        let d = place - o;
        let r2 = d.length_squared();
        let kernel = area * n.dot(d).max(0.0) * (-its.dot(d)).max(0.0) / (r2 * r2);
        if kernel.is_finite() { kernel } else { 0.0 }
    })
}

/// Of all of one side of a surface that is no polygon, as far as it is above the horizon and nothing hides it; `None`
/// where that is not known.
pub fn of_whole(position: Vec3, normal: Vec3, round: &Round, side: Side) -> Option<f64> {
    let (o, n) = (position.as_dvec3(), normal.as_dvec3());
    match round {
        Round::Disc(disc) => Some(of_disc(o, n, disc)),
        Round::Sphere(sphere) => {
            let (way, outside) = (sphere.centre - o, !round.encloses(o));
            match (outside, round.looks_out(side)) {
                (true, true) => Some(of_ball(n.dot(way) / way.length(), sphere.radius / way.length())),
                // All that is seen from within is the sphere.
                (false, false) => Some(PI),
                _ => None,
            }
        }
        Round::Patch(_) => None,
        Round::Cone(cone) => (!round.looks_out(side)).then(|| of_hollow(o, n, cone)).flatten(),
    }
}

/// Of the inside of a cylinder or a cone seen from within it: all that is not one of its two ends.
fn of_hollow(o: DVec3, n: DVec3, cone: &Cone) -> Option<f64> {
    let (axis, height) = (cone.axis(), cone.height());
    let Profile { up, .. } = cone.profile(o);
    let near = NEAR_END * (height + cone.widest());
    if up < -near || up > height + near || cone.outside(o) > near {
        return None;
    }
    // From a place in the plane of an end, which may lie either way by rounding, it is seen as from a little above.
    let within = |from: f64, to: f64| o + (up.clamp(from, to.max(from)) - up) * axis;
    let base = Disc { centre: cone.base, normal: axis, radius: cone.radius };
    let top = Disc { centre: cone.top, normal: axis, radius: cone.top_radius };
    let ends = of_disc(within(near, height), n, &base) + of_disc(within(0.0, height - near), n, &top);
    Some((PI - ends).clamp(0.0, PI))
}

/// A place so near the plane of an end, as a share of the size, lies in it.
const NEAR_END: f64 = 1e-6;

/// Of a ball seen from outside: `cosine` of the angle between the receiver's normal and the way to its centre, `sine` of
/// half the angle that it fills. Clipped at the horizon (the spherical cap's projected solid angle; S. Lagarde and
/// C. de Rousiers, *Moving Frostbite to PBR*, 2014, give this form).
fn of_ball(cosine: f64, sine: f64) -> f64 {
    let sine = sine.min(1.0);
    if cosine >= sine {
        return PI * sine * sine * cosine;
    }
    if cosine <= -sine {
        return 0.0;
    }
    let slant = (1.0 - cosine * cosine).sqrt();
    let x = (1.0 / (sine * sine) - 1.0).max(0.0).sqrt();
    let y = (-x * cosine / slant).clamp(-1.0, 1.0);
    let height = slant * (1.0 - y * y).sqrt();
    ((cosine * y.acos() - x * height) * sine * sine + height.atan2(x)).max(0.0)
}

/// Of a disc: Lambert's contour integral ½ ∮ n · (r × dr) / r², along the rim as far as it is above the horizon
/// and along the chord that closes it.
fn of_disc(o: DVec3, n: DVec3, disc: &Disc) -> f64 {
    let (x, y) = disc.axes();
    let (m, radius) = (disc.centre - o, disc.radius);
    // The rim is m + R (cos φ x + sin φ y): its height over the horizon is h + s cos(φ - top).
    let (h, hx, hy) = (n.dot(m), radius * n.dot(x), radius * n.dot(y));
    let (slope, top) = (hx.hypot(hy), hy.atan2(hx));
    if h + slope <= 0.0 {
        return 0.0;
    }
    let half = if h >= slope { PI } else { (-h / slope).clamp(-1.0, 1.0).acos() };
    // n · (r × dr) = (a + b cos φ + c sin φ) dφ and r² = d + e cos φ + f sin φ; both turned so that f is 0.
    let a = radius * radius * n.dot(disc.normal);
    let (b, c) = (radius * n.dot(m.cross(y)), -radius * n.dot(m.cross(x)));
    let (e, f) = (2.0 * radius * m.dot(x), 2.0 * radius * m.dot(y));
    let d = m.length_squared() + radius * radius;
    let (g, turn) = (e.hypot(f), f.atan2(e));
    let (b, c) = (b * turn.cos() + c * turn.sin(), c * turn.cos() - b * turn.sin());
    let (from, to) = (top - half - turn, top + half - turn);
    let arc = if g <= 1e-3 * d {
        // All but on the axis the closed form cancels and the integrand is all but constant.
        gauss(from, to, |phi| (a + b * phi.cos() + c * phi.sin()) / (d + g * phi.cos()))
    } else {
        let root = ((d - g).max(0.0) * (d + g)).sqrt();
        let whole = |phi: f64| {
            // The half-angle formula, with the branches of the tangent joined.
            let turns = ((phi + PI) / (2.0 * PI)).floor();
            let within = phi - 2.0 * PI * turns;
            let angle = ((d - g).max(0.0) * (0.5 * within).sin()).atan2(root * (0.5 * within).cos());
            2.0 * (angle + PI * turns)
        };
        let spread = if root > 0.0 { (a - b * d / g) / root * (whole(to) - whole(from)) } else { 0.0 };
        b / g * (to - from) + spread - c / g * ((d + g * to.cos()) / (d + g * from.cos())).ln()
    };
    let chord = if half < PI {
        let at = |phi: f64| m + radius * (phi.cos() * x + phi.sin() * y);
        let (p, q) = (at(top + half), at(top - half));
        let cross = p.cross(q);
        n.dot(cross).signum() * cross.length().atan2(p.dot(q))
    } else {
        0.0
    };
    let q = 0.5 * (arc + chord).abs();
    if q.is_finite() { q.min(PI) } else { 0.0 }
}

/// Gauss-Legendre with four points on each of sixteen pieces.
fn gauss(from: f64, to: f64, value: impl Fn(f64) -> f64) -> f64 {
    const PIECES: usize = 16;
    const RULE: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];
    let half = 0.5 * (to - from) / PIECES as f64;
    let piece = |k: usize| {
        let middle = from + (2 * k + 1) as f64 * half;
        RULE.iter().map(|(at, weight)| weight * value(middle + at * half)).sum::<f64>() * half
    };
    (0..PIECES).map(piece).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Sphere;

    /// The same by very many small pieces.
    fn fine(o: Vec3, n: Vec3, piece: &Piece) -> f64 {
        let (o, n) = (o.as_dvec3(), n.as_dvec3());
        piece.sum(
            &[],
            9,
            |_, _| false,
            |place, its, area| {
                let d = place - o;
                area * n.dot(d).max(0.0) * (-its.dot(d)).max(0.0) / d.length_squared().powi(2)
            },
        )
    }

    #[test]
    fn whole_discs_and_spheres_are_what_their_pieces_add_up_to() {
        let centre = DVec3::new(0.2, 0.1, -0.3);
        let disc = Round::Disc(Disc { centre, normal: DVec3::new(0.3, -0.2, 1.0).normalize(), radius: 0.8 });
        let ball = Round::Sphere(Sphere { centre, radius: 0.8, inward: false });
        let places = [[0.3, 0.2, 1.4], [2.0, -0.4, 0.6], [-1.0, 1.5, 2.5], [0.2, 0.1, 2.7], [0.9, 0.9, 0.5]];
        let normals =
            [[0.0, 0.0, -1.0], [-1.0, 0.2, -0.3], [0.5, 1.0, -0.2], [-0.3, -1.0, 0.4], [1.0, 0.1, 0.1]];
        let mut clipped = 0;
        for round in [disc, ball] {
            let piece = Piece::whole(&round, Side::Front);
            for place in places.map(Vec3::from) {
                for normal in normals.map(|n| Vec3::from(n).normalize()) {
                    let expected = fine(place, normal, &piece);
                    let whole = of_whole(place, normal, &round, Side::Front).unwrap();
                    assert!(
                        (whole - expected).abs() < 3e-4,
                        "{round:?} {place} {normal}: {whole} {expected}"
                    );
                    let pieces = of_piece(place, normal, &piece, &[]);
                    assert!(
                        (pieces - expected).abs() < 0.02 * expected + 2e-3,
                        "{place} {normal}: {pieces} {expected}"
                    );
                    clipped += usize::from(expected > 0.0 && expected < 0.05);
                }
            }
        }
        assert!(clipped > 3);
    }

    #[test]
    fn closed_forms() {
        // On the axis of a disc at distance h: R² / (R² + h²); over a ball at distance d: (R / d)² cos θ.
        let disc = Disc { centre: DVec3::ZERO, normal: DVec3::Z, radius: 1.0 };
        for h in [1e-3, 0.1, 1.0, 30.0] {
            let found = of_disc(h * DVec3::Z, DVec3::NEG_Z, &disc) / PI;
            assert!((found * (1.0 + h * h) - 1.0).abs() < 1e-9, "{h}: {found}");
        }
        // Beside the axis, parallel: ½ (1 + (1 - ρ² - h²) / root) with root² = (1 + ρ² + h²)² - 4 ρ².
        for (rho, h) in [(0.5, 0.5), (1.0, 0.01), (1.0, 1e-6), (3.0, 0.2)] {
            let s: f64 = rho * rho + h * h;
            let root = ((1.0 + s).powi(2) - 4.0 * rho * rho).sqrt();
            let found = of_disc(DVec3::new(rho, 0.0, h), DVec3::NEG_Z, &disc) / PI;
            let expected = 0.5 * (1.0 + (1.0 - s) / root);
            assert!((found - expected).abs() < 1e-9, "{rho} {h}: {found} {expected}");
        }
        assert!((of_ball(0.6, 0.5) - PI * 0.25 * 0.6).abs() < 1e-12);
        assert!((of_ball(0.4, 0.4 + 1e-12) - PI * 0.16 * 0.4).abs() < 1e-9, "no jump at the horizon");
        assert!(of_ball(-0.4, 0.4 - 1e-9) == 0.0 && of_ball(-0.4, 0.4 + 1e-3).abs() < 1e-4);
        // A ball that all but touches fills the hemisphere it stands over, or a quarter of all directions.
        assert!((of_ball(1.0, 1.0 - 1e-9) - PI).abs() < 1e-6 && (of_ball(0.0, 1.0) - 0.5 * PI).abs() < 1e-9);
    }
}

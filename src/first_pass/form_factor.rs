//! Form factors between a sample point and an element (section 3.2: G δS / π).
//!
//! All functions return q = π F, the projected solid angle of the element seen from the point.

use super::round::{of_own, of_piece};
use crate::points::{Middle, SamplePoints};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// An element whose extent² / r² is above this gets its exact factor; see [`extent2`].
///
/// What the plain kernel is wrong by at the threshold, in per cent of the factor of the element seen
/// from its front, the worse of both ways to turn it (measured by the test
/// `the_threshold_of_the_plain_kernel_is_measured`; it grows with extent² / r²):
///
/// | sides of the element, the same extent | 1:1 | 10:1 | 10⁴:1 | 10⁴:1 if judged by its area |
/// |---|---|---|---|---|
/// | parallel to the receiver | 0.33 | 0.33 | 0.33 | 84 |
/// | tilted by 60 degrees | 0.08 | 0.33 | 0.33 | 42 |
/// | perpendicular to the receiver | 0.08 | 0.33 | 0.33 | 42 |
///
/// The elements of one surface err the same way, which is why they are also summed up as a whole
/// ([`super::near`]).
pub const NEAR: f32 = 0.01;

/// Distances of two points from each other's planes: `(d_i(j), d_j(i), r²)`, m and m².
/// The same bits, up to the order, whichever point comes first.
#[inline]
pub fn plane_distances(points: &SamplePoints, i: usize, j: usize) -> (f32, f32, f32) {
    let d = points.position[j] - points.position[i];
    (points.normal[i].dot(d), -points.normal[j].dot(d), d.dot(d))
}

/// The paper's kernel: cos cos δS_j / r², at most π so that F <= 1.
#[inline(always)]
pub fn plain(d_i: f32, d_j: f32, r2: f32, area: f32) -> f32 {
    let inverse = 1.0 / r2;
    ((d_i * inverse) * (d_j * inverse) * area).min(std::f32::consts::PI)
}

/// Exact q of a polygon seen from a point: Lambert's formula after the part below the horizon is
/// cut away (Baum, Rushmeier and Winget 1989, section 4). `corners` in order, repeated ones allowed.
pub fn exact(position: Vec3, normal: Vec3, corners: &[Vec3; 4]) -> f64 {
    let origin = position.as_dvec3();
    let n = normal.as_dvec3();
    let corner = corners.map(|c| c.as_dvec3() - origin);
    // Cutting a quadrilateral with one plane leaves at most five corners.
    let mut above = [DVec3::ZERO; 5];
    let mut count = 0;
    for i in 0..4 {
        let (a, b) = (corner[i], corner[(i + 1) % 4]);
        let (da, db) = (n.dot(a), n.dot(b));
        if da >= 0.0 && count < 5 {
            above[count] = a;
            count += 1;
        }
        if (da < 0.0) != (db < 0.0) && count < 5 {
            above[count] = a + (b - a) * (da / (da - db));
            count += 1;
        }
    }
    let mut sum = 0.0;
    for i in 0..count {
        let (a, b) = (above[i], above[(i + 1) % count]);
        let cross = a.cross(b);
        let sine = cross.length();
        if sine > 0.0 {
            sum += n.dot(cross) / sine * sine.atan2(a.dot(b));
        }
    }
    (0.5 * sum).abs().min(PI)
}

/// Square of the size of element `j` as near and far judge it, m²: the area of a square, but half the
/// square of the length of a strip. (Half the sum of the squares from its centre to its corners.)
pub fn extent2(points: &SamplePoints, j: usize) -> f32 {
    0.5 * points.corners[j].iter().map(|c| c.distance_squared(points.position[j])).sum::<f32>()
}

/// q of element `j` seen from point `i`, near or far: of a polygon exact, else by smaller pieces of the true
/// surface, of which some or none of the middles are `known`.
pub fn near(points: &SamplePoints, i: usize, j: usize, known: &[Middle]) -> f64 {
    match points.round(j) {
        Some(piece) if points.surface[i] == points.surface[j] => {
            points.round(i).map_or(0.0, |from| of_own(&from, &piece, known))
        }
        Some(piece) => of_piece(points.position[i], points.normal[i], &piece, known),
        None => exact(points.position[i], points.normal[i], &points.corners[j]),
    }
}

/// q of element `j` seen from point `i`, which face each other: exact where the element is near and
/// `analytic` is set, plain otherwise.
pub fn projected_solid_angle(points: &SamplePoints, i: usize, j: usize, analytic: bool) -> f32 {
    let (d_i, d_j, r2) = plane_distances(points, i, j);
    if analytic && extent2(points, j) > NEAR * r2 {
        near(points, i, j, &[]) as f32
    } else {
        plain(d_i, d_j, r2, points.area[j])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean over an n x n grid of points on a unit square of the factor to the other unit square.
    fn between_squares(opposite: bool) -> f64 {
        let n = 40;
        let v = |x: f64, y: f64, z: f64| DVec3::new(x, y, z).as_vec3();
        let target = if opposite {
            [v(0., 0., 1.), v(0., 1., 1.), v(1., 1., 1.), v(1., 0., 1.)]
        } else {
            [v(0., 0., 0.), v(0., 1., 0.), v(0., 1., 1.), v(0., 0., 1.)]
        };
        let mut sum = 0.0;
        for i in 0..n * n {
            let at = |k: usize| (k as f64 + 0.5) / n as f64;
            sum += exact(v(at(i % n), at(i / n), 0.0), Vec3::Z, &target);
        }
        sum / (n * n) as f64 / PI
    }

    #[test]
    fn squares_have_their_tabulated_factors() {
        assert!((between_squares(true) - 0.199_824_895_698_387_46).abs() < 2e-5);
        assert!((between_squares(false) - 0.200_043_776_075_403_16).abs() < 3e-4);
    }

    #[test]
    fn a_polygon_that_crosses_the_horizon_is_cut() {
        let wall = |low: f32| {
            [
                Vec3::new(1.0, -1.0, low),
                Vec3::new(1.0, 1.0, low),
                Vec3::new(1.0, 1.0, 1.0),
                Vec3::new(1.0, -1.0, 1.0),
            ]
        };
        let whole = exact(Vec3::ZERO, Vec3::Z, &wall(0.0));
        let crossing = exact(Vec3::ZERO, Vec3::Z, &wall(-1.0));
        assert!(whole > 0.1 && (whole - crossing).abs() < 1e-12);
    }

    #[test]
    fn the_plain_kernel_is_good_where_it_is_used() {
        // Squares at the threshold distance, facing and tilted: at most 0.4 % of a facing one's.
        let r = (1.0 / NEAR).sqrt();
        for tilt in [0.0_f32, 0.5, 1.0, 1.3] {
            let normal = Vec3::new(tilt.sin(), 0.0, -tilt.cos());
            let (u, v) = (Vec3::Y * 0.5, normal.cross(Vec3::Y) * 0.5);
            let centre = Vec3::Z * r;
            let corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
            let exact = exact(Vec3::ZERO, Vec3::Z, &corners);
            let plain = plain(r, -normal.dot(centre), r * r, 1.0);
            assert!((exact - f64::from(plain)).abs() < 0.004 * f64::from(NEAR), "{tilt}: {exact} {plain}");
        }
    }
}

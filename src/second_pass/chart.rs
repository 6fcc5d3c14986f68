//! From a place on a surface back to its (u, v).

use crate::geometry::{Round, Shape, Surface};
use glam::{DVec2, DVec3};

/// A surface's plane with two axes, ready to invert [`Surface::point_at`]. For what is no polygon the plane is that of
/// its parameters, as large as the surface: cells are rectangles in it, and what is linear along their edges meets on
/// both sides.
#[derive(Clone, Debug)]
pub struct Chart {
    round: Option<(Round, DVec2)>,
    origin: DVec3,
    x: DVec3,
    y: DVec3,
    /// v1 - v0 in the plane.
    e: DVec2,
    /// Last vertex minus v0 in the plane.
    f: DVec2,
    /// v0 - v1 + v2 - v3 of a quad: what makes it more than a parallelogram. Zero for a triangle.
    g: DVec2,
    triangle: bool,
    /// What (u, v) are of a place relative to v0, for triangles and parallelograms.
    linear: Option<[DVec3; 2]>,
}

/// Places that are looked up together.
pub(super) const LANES: usize = 16;

/// A quad bent less than this, as a share of its edges, is a parallelogram: rounding makes true ones so.
const PARALLELOGRAM: f64 = 1e-13;

impl Chart {
    /// The chart of `surface`; its first axis runs along v0 v1.
    pub fn new(surface: &Surface) -> Self {
        if let Some(round) = surface.round() {
            let [origin, x, y] = [DVec3::ZERO; 3];
            let [e, f, g] = [DVec2::ZERO; 3];
            return Chart {
                round: Some((round.clone(), round.lengths())),
                origin,
                x,
                y,
                e,
                f,
                g,
                triangle: false,
                linear: None,
            };
        }
        let v = surface.vertices();
        let x = (v[1] - v[0]).normalize_or_zero();
        let mut chart = Chart {
            round: None,
            origin: v[0],
            x,
            y: surface.normal_at(v[0]).cross(x),
            e: DVec2::ZERO,
            f: DVec2::ZERO,
            g: DVec2::ZERO,
            triangle: matches!(surface.shape, Shape::Triangle(_)),
            linear: None,
        };
        chart.e = chart.plane(v[1]);
        chart.f = chart.plane(v[v.len() - 1]);
        if !chart.triangle {
            chart.g = chart.plane(v[2]) - chart.e - chart.f;
        }
        if chart.g.length() <= PARALLELOGRAM * (chart.e.length() + chart.f.length()) {
            let across = |d: DVec2| (d.y * chart.x - d.x * chart.y) / chart.e.perp_dot(chart.f);
            chart.linear = Some([across(chart.f), -across(chart.e)]);
        }
        chart
    }

    /// `p` in the plane, relative to v0, m.
    #[inline]
    pub fn plane(&self, p: DVec3) -> DVec2 {
        if let Some((round, lengths)) = &self.round {
            return *lengths * round.uv_of(p);
        }
        let d = p - self.origin;
        DVec2::new(self.x.dot(d), self.y.dot(d))
    }

    /// The place of a node in the plane, m: `p` in space, at `(u, v)` of an element that it borders on. Where the plane
    /// of the parameters folds onto itself, one place in space is several there.
    pub fn plane_at(&self, p: DVec3, uv: DVec2) -> DVec2 {
        match &self.round {
            Some((_, lengths)) => *lengths * uv,
            None => self.plane(p),
        }
    }

    /// (u, v) of the place `p`, brought into the surface.
    #[inline(always)]
    pub fn uv_of(&self, p: DVec3) -> DVec2 {
        let Some([of_u, of_v]) = self.linear else { return self.uv(self.plane(p)) };
        let d = p - self.origin;
        let uv = DVec2::new(clamp_unit(of_u.dot(d)), clamp_unit(of_v.dot(d)));
        if self.triangle { uv / (uv.x + uv.y).max(1.0) } else { uv }
    }

    /// [`Chart::uv_of`] of places of which each coordinate has a column.
    #[inline(always)]
    pub fn uv_of_all(&self, p: &[[f64; LANES]; 3]) -> [[f64; LANES]; 2] {
        let mut uv = [[0.0; LANES]; 2];
        let Some([of_u, of_v]) = self.linear else {
            for i in 0..LANES {
                [uv[0][i], uv[1][i]] = self.uv_of(DVec3::new(p[0][i], p[1][i], p[2][i])).to_array();
            }
            return uv;
        };
        for i in 0..LANES {
            let d = [p[0][i] - self.origin.x, p[1][i] - self.origin.y, p[2][i] - self.origin.z];
            let along = |of: DVec3| of.x * d[0] + of.y * d[1] + of.z * d[2];
            [uv[0][i], uv[1][i]] = [clamp_unit(along(of_u)), clamp_unit(along(of_v))];
        }
        if self.triangle {
            let [us, vs] = &mut uv;
            for (u, v) in us.iter_mut().zip(vs) {
                let over = (*u + *v).max(1.0);
                (*u, *v) = (*u / over, *v / over);
            }
        }
        uv
    }

    /// (u, v) of the place in the plane `h`, brought into the surface.
    ///
    /// For a quad h = u e + v f + u v g. Eliminating u leaves
    /// (g × f) v² + (h × g + e × f) v + h × e = 0, whose slope at the root inside a convex quad is
    /// the Jacobian and so positive: that root is taken, in the form that does not cancel.
    #[inline]
    fn uv(&self, h: DVec2) -> DVec2 {
        if let Some((_, lengths)) = &self.round {
            return DVec2::new(clamp_unit(h.x / lengths.x), clamp_unit(h.y / lengths.y));
        }
        let (e, f, g) = (self.e, self.f, self.g);
        let (a, b, c) = (g.perp_dot(f), h.perp_dot(g) + e.perp_dot(f), h.perp_dot(e));
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let v = clamp_unit(if b >= 0.0 { -2.0 * c / (b + root) } else { (root - b) / (2.0 * a) });
        let along = e + v * g;
        DVec2::new(clamp_unit((h - v * f).dot(along) / along.length_squared()), v)
    }
}

/// Into 0..1; what is not a number becomes 0.
#[inline(always)]
fn clamp_unit(x: f64) -> f64 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad(corners: [[f64; 2]; 4]) -> Surface {
        // A tilted plane, so that the chart has something to do.
        let place = |[x, y]: [f64; 2]| DVec3::new(x, 0.8 * y + 0.3, 0.6 * y);
        Surface::new(Shape::Quad(corners.map(place)))
    }

    #[test]
    fn inverts_convex_quads_and_triangles() {
        let shapes = [
            quad([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]),
            quad([[0.0, 0.0], [3.0, -0.5], [2.0, 2.0], [-0.3, 0.4]]),
            // Almost a triangle at v2, and thin.
            quad([[0.0, 0.0], [1.0, 0.0], [0.5001, 0.5], [0.0, 1.0]]),
            quad([[0.0, 0.0], [1.0, 0.0], [1.0, 1e-3], [0.0, 2e-3]]),
            // A trapezoid: g is parallel to e, the equation loses its square.
            quad([[0.0, 0.0], [4.0, 0.0], [3.0, 1.0], [1.0, 1.0]]),
            Surface::new(Shape::Triangle([DVec3::ZERO, DVec3::X, DVec3::new(0.2, 0.3, 0.9)])),
        ];
        for surface in shapes {
            let chart = Chart::new(&surface);
            for i in 0..=20 {
                for j in 0..=20 {
                    let (u, v) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                    if matches!(surface.shape, Shape::Triangle(_)) && u + v > 1.0 {
                        continue;
                    }
                    let back = chart.uv_of(surface.point_at(u, v));
                    // Compared in space: at a corner that is all but straight (u, v) is ill defined.
                    let error = (surface.point_at(back.x, back.y) - surface.point_at(u, v)).length();
                    assert!(error < 1e-7, "{surface:?} at {u} {v}: {back}");
                }
            }
        }
    }

    #[test]
    fn places_outside_come_inside() {
        let surface = quad([[0.0, 0.0], [3.0, -0.5], [2.0, 2.0], [-0.3, 0.4]]);
        let chart = Chart::new(&surface);
        for p in [[-9.0, 0.0], [9.0, 9.0], [1e9, -1e9], [0.0, -1e-9], [f64::NAN, 0.0]] {
            let uv = chart.uv(DVec2::from(p));
            assert!(uv.cmpge(DVec2::ZERO).all() && uv.cmple(DVec2::ONE).all(), "{uv}");
        }
    }
}

//! The test of a ray against a triangle that the exact-minded tracers share.
//!
//! Watertight in the manner of Woop, Benthin and Wald, *Watertight Ray/Triangle Intersection*, JCGT
//! 2(1), 2013: vertices are first projected along the ray, each by itself, so all triangles around
//! a vertex or an edge see the same rounded place, and the sign of an edge function of two
//! projected places is then exact. Signed volumes, whose rounding differs from edge to edge, leak:
//! 25 of 12,960 rays aimed at vertices, edges and diagonals from within a closed room.

use crate::geometry::{Aabb, Ray};
use glam::DVec3;

/// A frame along a ray: the ray runs up the third axis from the origin, its parameter the height.
#[derive(Clone, Copy, Debug)]
pub struct RayFrame {
    origin: [f64; 3],
    axes: [usize; 3],
    shear: [f64; 3],
}

impl RayFrame {
    /// The frame of `ray`. A ray without direction makes places that are not numbers, which no
    /// triangle test accepts.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction.to_array();
        let along = if d[0].abs() >= d[1].abs() && d[0].abs() >= d[2].abs() {
            0
        } else if d[1].abs() >= d[2].abs() {
            1
        } else {
            2
        };
        let axes = [(along + 1) % 3, (along + 2) % 3, along];
        let shear = [d[axes[0]] / d[along], d[axes[1]] / d[along], 1.0 / d[along]];
        RayFrame { origin: ray.origin.to_array(), axes, shear }
    }

    /// One over the largest component of the direction.
    #[inline(always)]
    pub fn inverse_speed(&self) -> f64 {
        self.shear[2].abs()
    }

    /// Four vertices in the frame, given and returned coordinate by coordinate: [`RayFrame::project`] of each, to
    /// the bit.
    #[inline(always)]
    pub fn project_four(&self, vertices: &[[f64; 4]; 3]) -> [[f64; 4]; 3] {
        let [i, j, k] = self.axes;
        let mut out = [[0.0; 4]; 3];
        for v in 0..4 {
            let z = vertices[k][v] - self.origin[k];
            out[0][v] = vertices[i][v] - self.origin[i] - self.shear[0] * z;
            out[1][v] = vertices[j][v] - self.origin[j] - self.shear[1] * z;
            out[2][v] = self.shear[2] * z;
        }
        out
    }

    /// A vertex in the frame; `z` is the ray parameter.
    #[inline]
    pub fn project(&self, vertex: DVec3) -> DVec3 {
        let v = vertex.to_array();
        let [x, y, z] = self.axes.map(|a| v[a] - self.origin[a]);
        DVec3::new(x - self.shear[0] * z, y - self.shear[1] * z, self.shear[2] * z)
    }
}

/// The edge function of two projected vertices: of the right sign, and exactly the opposite for the
/// edge turned round.
#[inline]
pub fn edge(p: DVec3, q: DVec3) -> f64 {
    let (a, b) = (p.x * q.y, p.y * q.x);
    if a != b || a == 0.0 {
        // Rounding is monotonic: it may make unequal products equal but never swap them.
        return a - b;
    }
    equal_products(p, q, a)
}

/// Equal once rounded: what rounding took from each decides.
#[cold]
fn equal_products(p: DVec3, q: DVec3, product: f64) -> f64 {
    p.x.mul_add(q.y, -product) - p.y.mul_add(q.x, -product)
}

/// The ray parameter of the crossing, from the edge functions opposite to the three vertices and the
/// vertices' heights; `None` if the ray passes outside or lies in the triangle's plane.
#[inline]
pub fn crossing(weights: [f64; 3], heights: [f64; 3]) -> Option<f64> {
    let [u, v, w] = weights;
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let sum = u + v + w;
    (sum != 0.0).then(|| (u * heights[0] + v * heights[1] + w * heights[2]) / sum)
}

/// Whether the ray's place at `t` lies in the box of `corners`, as far as rounding can tell. A triangle in whose
/// plane the ray runs is projected to a line, and the edge functions may then be rounding alone that agrees
/// in sign: the place they give can be far beside the triangle.
#[inline]
pub fn is_in_box(ray: &Ray, t: f64, corners: [DVec3; 3]) -> bool {
    let bounds = Aabb::around(corners);
    let place = ray.at(t);
    let slack = IN_BOX * ray.origin.abs().max(bounds.min.abs()).max(bounds.max.abs()).max_element();
    Aabb { min: bounds.min - slack, max: bounds.max + slack }.contains(place)
}

/// Room for rounding in [`is_in_box`], as a share of the largest coordinate: enough for `f64` at 1e-8 radian, little
/// enough to stay within the bounds of [`super::judge`].
const IN_BOX: f64 = 1e-7;

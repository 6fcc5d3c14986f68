//! Rooms and spheres.

use crate::geometry::Shape;
use glam::DVec3;
use std::f64::consts::PI;

/// Corners of the walls of a box as seen from within: -x, +x, -y, +y, -z, +z.
pub fn walls(low: [f64; 3], high: [f64; 3]) -> [[[f64; 3]; 4]; 6] {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
    [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
        .map(|f| f.map(corner))
}

/// The unit sphere seen from within: 1280 triangles that have its area together.
pub fn sphere() -> Vec<Shape> {
    let mut triangles = icosahedron();
    for _ in 0..3 {
        triangles = triangles.into_iter().flat_map(divide).collect();
    }
    let area: f64 = triangles.iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).length()).sum();
    let radius = (4.0 * PI / area).sqrt();
    triangles.into_iter().map(|[a, b, c]| Shape::Triangle([a, c, b].map(|v| radius * v))).collect()
}

/// Corners on the unit sphere, counter-clockwise from outside.
fn icosahedron() -> Vec<[DVec3; 3]> {
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut corners = Vec::new();
    for a in [-1.0, 1.0] {
        for b in [-golden, golden] {
            corners.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
        }
    }
    let mut triangles = Vec::new();
    // Faces are the triples of neighbours, 2 apart.
    let near = |a: DVec3, b: DVec3| (a.distance(b) - 2.0).abs() < 1e-9;
    for (i, &a) in corners.iter().enumerate() {
        for (j, &b) in corners.iter().enumerate().skip(i + 1) {
            for &c in corners.iter().skip(j + 1).filter(|&&c| near(a, b) && near(b, c) && near(c, a)) {
                let outwards = (b - a).cross(c - a).dot(a) > 0.0;
                let face = if outwards { [a, b, c] } else { [a, c, b] };
                triangles.push(face.map(DVec3::normalize));
            }
        }
    }
    triangles
}

/// Four triangles with all corners on the unit sphere.
fn divide([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [x, y, z] = [b + c, c + a, a + b].map(DVec3::normalize);
    [[a, z, y], [z, b, x], [y, x, c], [x, y, z]]
}

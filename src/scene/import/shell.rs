//! Whether glass is a body or a sheet: what its faces enclose.

use super::mesh::Face;
use crate::geometry::Aabb;
use glam::{DVec3, I64Vec3};
use std::collections::HashMap;

/// What the faces of a material make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shell {
    /// They enclose a volume, with the front outside.
    Solid {
        /// The mean length of a chord through it, 4 V/S (Cauchy), m.
        mean_chord: f64,
    },
    /// The same, with the front inside.
    InsideOut {
        /// As above.
        mean_chord: f64,
    },
    /// They enclose a volume in which there is a light.
    Bulb,
    /// They have a free edge, or neighbours that look opposite ways.
    Sheet,
}

/// Corners are one where they are no further apart than this share of all that the faces take up: programs that write
/// the seam of a sphere twice do not come out at the same place to the bit.
const ONE_PLACE: f64 = 1e-5;

/// What `faces` make. `lights` are places of light, in the same coordinates: one for each surface that emits.
pub fn shell(faces: &[&Face], vertices: &[DVec3], lights: &[DVec3]) -> Shell {
    let mut used: Vec<u32> = faces.iter().flat_map(|f| f.corners).collect();
    used.sort_unstable();
    used.dedup();
    let places: Vec<DVec3> = used.iter().map(|&v| vertices[v as usize]).collect();
    let welded = near(&places);
    let number = |v: u32| welded[used.partition_point(|&u| u < v)];
    // Of a closed surface every edge is passed as often one way as the other.
    let mut edges: HashMap<(u32, u32), [u32; 2]> = HashMap::new();
    let (mut volume, mut area) = (0.0, 0.0);
    let mut triangles = Vec::with_capacity(2 * faces.len());
    for face in faces {
        let count = usize::from(face.count);
        let corners: Vec<u32> = face.corners[..count].iter().map(|&c| number(c)).collect();
        for k in 0..count {
            let (a, b) = (corners[k], corners[(k + 1) % count]);
            if a != b {
                edges.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
            }
        }
        for k in 2..count {
            let t = [corners[0], corners[k - 1], corners[k]].map(|v| places[v as usize] - places[0]);
            volume += t[0].dot(t[1].cross(t[2])) / 6.0;
            area += 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
            triangles.push(t);
        }
    }
    if faces.is_empty() || edges.values().any(|[there, back]| there != back) {
        return Shell::Sheet;
    }
    let mean_chord = 4.0 * f64::abs(volume) / area;
    if !(mean_chord > 0.0 && mean_chord.is_finite()) {
        return Shell::Sheet;
    }
    if lights.iter().any(|&light| is_inside(light - places[0], &triangles)) {
        return Shell::Bulb;
    }
    if volume > 0.0 { Shell::Solid { mean_chord } } else { Shell::InsideOut { mean_chord } }
}

/// Per place the first one that is as good as the same.
fn near(places: &[DVec3]) -> Vec<u32> {
    let bounds = Aabb::around(places.iter().copied());
    let apart = ONE_PLACE * bounds.size().max_element();
    let cell = |p: DVec3| ((p - bounds.min) / apart.max(f64::MIN_POSITIVE)).round().as_i64vec3();
    let mut known: HashMap<I64Vec3, Vec<u32>> = HashMap::with_capacity(places.len());
    let mut first = Vec::with_capacity(places.len());
    for (i, &place) in places.iter().enumerate() {
        let own = cell(place);
        let around = (0..27i64).map(|k| own + I64Vec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        let same = |&&j: &&u32| places[j as usize].distance(place) <= apart;
        let found = around.filter_map(|c| known.get(&c)?.iter().find(same).copied()).min();
        if found.is_none() {
            known.entry(own).or_default().push(i as u32);
        }
        first.push(found.unwrap_or(i as u32));
    }
    first
}

/// Whether a ray from `p` in an odd direction leaves the closed surface of `triangles` an odd number of times.
fn is_inside(p: DVec3, triangles: &[[DVec3; 3]]) -> bool {
    let way = DVec3::new(0.5377, 0.2718, 0.7982).normalize();
    let passes = |[a, b, c]: &[DVec3; 3]| {
        // Signed volumes of the ray's line with the edges: all of one sign if it passes between them.
        let side = |from: DVec3, to: DVec3| way.dot((from - p).cross(to - p)) > 0.0;
        let (x, y, z) = (side(*a, *b), side(*b, *c), side(*c, *a));
        let normal = (*b - *a).cross(*c - *a);
        x == y && y == z && (*a - p).dot(normal) * way.dot(normal) > 0.0
    };
    triangles.iter().filter(|t| passes(t)).count() % 2 == 1
}

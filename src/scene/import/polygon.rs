//! Polygons of any kind to triangles, and pairs of triangles in one plane to quadrilaterals.

use super::mesh::Face;
use crate::geometry::{QuadKind, classify_quad};
use glam::DVec3;
use std::collections::HashMap;

/// The triangles of a polygon with more than three corners, convex or not: indices of its corners. A polygon out of
/// plane is divided as its shadow on its mean plane is.
pub fn triangles(points: &[DVec3]) -> Vec<[usize; 3]> {
    let flat: Vec<[f64; 3]> = points.iter().map(|p| (*p - points[0]).to_array()).collect();
    let mut plane = Vec::new();
    if !flat.iter().flatten().all(|x| x.is_finite())
        || !earcut::utils3d::project3d_to_2d(&flat, flat.len(), &mut plane)
    {
        // All on a line: the faces have no area, and are counted as such later.
        return (2..points.len()).map(|k| [0, k - 1, k]).collect();
    }
    let mut corners: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(plane, &[], &mut corners);
    corners.chunks_exact(3).map(|t| [t[0] as usize, t[1] as usize, t[2] as usize]).collect()
}

/// Sines of the corners of a quadrilateral that is made of triangles are at least this: nearer to a triangle it is better
/// two.
const LEAST_SINE: f64 = 0.1;

/// Merges triangles of one part that share an edge, lie in one plane and make a convex quadrilateral. Of several
/// choices the one with the longest edge between them is taken: the diagonal of what once was a quadrilateral. Returns
/// how many pairs.
pub fn merge_pairs(faces: &mut Vec<Face>, vertices: &[DVec3], welded: &[u32]) -> usize {
    let number = |v: u32| welded[v as usize];
    // By directed edge: the triangle, and which of its corners the edge starts from.
    let mut edges: HashMap<(u32, u32), (u32, u8)> = HashMap::new();
    for (i, face) in faces.iter().enumerate().filter(|(_, f)| f.count == 3) {
        for k in 0..3 {
            let (a, b) = (number(face.corners[k]), number(face.corners[(k + 1) % 3]));
            edges.entry((a, b)).or_insert((i as u32, k as u8));
        }
    }
    let mut gone = vec![false; faces.len()];
    let mut pairs = 0;
    for i in 0..faces.len() {
        let face = faces[i];
        if face.count != 3 || gone[i] {
            continue;
        }
        let mut best: Option<(f64, usize, [u32; 4])> = None;
        for k in 0..3 {
            let [p, q, r] = [0, 1, 2].map(|step| face.corners[(k + step) % 3]);
            let Some(&(j, from)) = edges.get(&(number(q), number(p))) else { continue };
            let other = faces[j as usize];
            if (j as usize) <= i || gone[j as usize] || other.count != 3 || other.part != face.part {
                continue;
            }
            let s = other.corners[(usize::from(from) + 2) % 3];
            let length = vertices[p as usize].distance_squared(vertices[q as usize]);
            let corners = [p, s, q, r];
            if best.is_none_or(|(longest, ..)| length > longest) && is_flat_quad(corners, vertices) {
                best = Some((length, j as usize, corners));
            }
        }
        if let Some((_, j, corners)) = best {
            faces[i].corners = corners;
            faces[i].count = 4;
            gone[j] = true;
            pairs += 1;
        }
    }
    let mut gone = gone.into_iter();
    faces.retain(|_| gone.next() != Some(true));
    pairs
}

fn is_flat_quad(corners: [u32; 4], vertices: &[DVec3]) -> bool {
    let v = corners.map(|c| vertices[c as usize] - vertices[corners[0] as usize]);
    let sharp = |k: usize| {
        let (before, after) = ((v[(k + 3) % 4] - v[k]), (v[(k + 1) % 4] - v[k]));
        after.cross(before).length() >= LEAST_SINE * after.length() * before.length()
    };
    (0..4).all(sharp) && matches!(classify_quad(&v), QuadKind::Flat)
}

#[cfg(test)]
mod tests {
    use super::super::mesh::START;
    use super::*;

    fn face(corners: [u32; 3]) -> Face {
        let [a, b, c] = corners;
        Face { corners: [a, b, c, c], count: 3, part: 0, patch: 0, place: START }
    }

    fn area(points: &[DVec3], triangles: &[[usize; 3]]) -> f64 {
        let of =
            |t: &[usize; 3]| 0.5 * (points[t[1]] - points[t[0]]).cross(points[t[2]] - points[t[0]]).length();
        triangles.iter().map(of).sum()
    }

    /// An L, tilted: the triangles have its area, which a fan from any corner has not.
    #[test]
    fn concave_polygons_keep_their_area() {
        let tilted = |x: f64, y: f64| DVec3::new(x, 0.6 * y + 2.0, 0.8 * y - 1.0);
        let l = [(0., 0.), (2., 0.), (2., 1.), (1., 1.), (1., 3.), (0., 3.)].map(|(x, y)| tilted(x, y));
        for turn in 0..l.len() {
            let mut points = l.to_vec();
            points.rotate_left(turn);
            let found = triangles(&points);
            assert_eq!(found.len(), 4);
            assert!((area(&points, &found) - 4.0).abs() < 1e-12);
            let normal = (l[1] - l[0]).cross(l[5] - l[0]);
            for t in found {
                let own = (points[t[1]] - points[t[0]]).cross(points[t[2]] - points[t[0]]);
                assert!(own.dot(normal) > 0.0, "a triangle looks the other way");
            }
        }
        assert_eq!(triangles(&[DVec3::ZERO, DVec3::X, 2.0 * DVec3::X, 3.0 * DVec3::X]).len(), 2);
    }

    #[test]
    fn a_rectangle_cut_in_two_is_one_again() {
        let mut vertices = vec![DVec3::ZERO, 2.0 * DVec3::X, DVec3::new(2.0, 1.0, 0.0), DVec3::Y];
        // A corner that is written twice, as in files whose vertices carry normals.
        vertices.push(vertices[2]);
        let welded = super::super::mesh::weld(&vertices);
        let mut faces = vec![face([0, 1, 2]), face([0, 4, 3])];
        assert_eq!(merge_pairs(&mut faces, &vertices, &welded), 1);
        assert_eq!((faces.len(), faces[0].count), (1, 4));
        let shape = faces[0].corners.map(|c| vertices[c as usize]);
        assert!(matches!(classify_quad(&shape), QuadKind::Flat));
        assert!((shape[1] - shape[0]).cross(shape[3] - shape[0]).z > 0.0);
        // Lifted out of plane, turned over, or of another part they stay two.
        vertices[3].z = 1e-3;
        for spoiled in [[face([0, 1, 2]), face([0, 4, 3])], [face([0, 1, 2]), face([0, 3, 4])]] {
            assert_eq!(merge_pairs(&mut spoiled.to_vec(), &vertices, &welded), 0);
        }
    }
}

//! Bicubic patches that go on smoothly over a common edge.

use crate::geometry::{Patch, Round, Shape};
use crate::sets::Sets;
use glam::DVec3;
use std::collections::HashMap;

/// The normals of smooth neighbours differ by less than this along their edge, rad.
const SMOOTH: f64 = 0.02;

/// An edge by the coordinates of its control points, from the end that sorts first, and the part that it belongs to.
type Edge = ([[u64; 3]; 4], usize);

/// For each shape, given with its part, the number of the patch that it belongs to: bicubic patches of one part are one
/// where they share the control points of an edge and have one normal along it.
pub fn first_of_each<'s>(shapes: impl Iterator<Item = (&'s Shape, usize)>) -> Vec<u32> {
    let shapes: Vec<_> = shapes.collect();
    let mut edges: HashMap<Edge, Vec<(u32, [DVec3; 3])>> = HashMap::new();
    let mut patches = Sets::new(shapes.len());
    for (k, (shape, part)) in shapes.into_iter().enumerate() {
        let Shape::Round(Round::Patch(patch)) = shape else { continue };
        for (edge, normals) in edges_of(patch) {
            let known = edges.entry((edge, part)).or_default();
            for (other, its) in known.iter() {
                if normals.iter().zip(its).all(|(a, b)| a.distance(*b) < SMOOTH) {
                    patches.join(*other, k as u32);
                }
            }
            known.push((k as u32, normals));
        }
    }
    patches.all()
}

/// The edges that have a length, and the normals at three places of each.
fn edges_of(patch: &Patch) -> impl Iterator<Item = ([[u64; 3]; 4], [DVec3; 3])> {
    let at = |edge: usize, t: f64| match edge {
        0 => [t, 0.0],
        1 => [1.0, t],
        2 => [t, 1.0],
        _ => [0.0, t],
    };
    let collapsed = patch.collapsed();
    let edges = patch.edges().into_iter().enumerate().filter(move |(k, _)| !collapsed[*k]);
    edges.map(move |(k, points)| {
        let mut key = points.map(|p| (p + 0.0).to_array().map(f64::to_bits));
        let mut normals = [0.25, 0.5, 0.75].map(|t| patch.normal(at(k, t).into()));
        if key[3] < key[0] || key[3] == key[0] && key[2] < key[1] {
            key.reverse();
            normals.reverse();
        }
        (key, normals)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(x: f64, turned: bool, bent: f64) -> Shape {
        let at = |i: usize, j: usize| {
            let (u, v) = (i as f64 / 3.0, j as f64 / 3.0);
            DVec3::new(x + u, v, bent * u * (x - 0.5))
        };
        // The same sheet with u and v turned about by a quarter.
        Patch::new(std::array::from_fn(|j| {
            std::array::from_fn(|i| if turned { at(j, 3 - i) } else { at(i, j) })
        }))
        .into()
    }

    #[test]
    fn smooth_neighbours_are_one_patch() {
        let shapes =
            [sheet(0.0, false, 0.0), sheet(1.0, false, 0.0), sheet(1.0, true, 1.0), sheet(-1.0, true, 0.0)];
        let of = |parts: [usize; 4]| first_of_each(shapes.iter().zip(parts));
        assert_eq!(of([0; 4]), [0, 0, 2, 0], "a crease parts, and how an edge is run through does not");
        assert_eq!(of([0, 1, 0, 0]), [0, 1, 2, 0], "so does another object");
    }
}

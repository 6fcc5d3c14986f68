//! A furnished room of 134 quadrilaterals, as many as the paper's test scene has.
#![allow(dead_code, reason = "each group of tests uses its share")]

use glam::{DMat3, DVec3};
use luxgraph::geometry::Shape;
use luxgraph::scene::{Geometry, ObjectId};

/// Quadrilaterals, counter-clockwise from the front.
pub type Quads = Vec<[DVec3; 4]>;

/// A box between two corners, turned by `angle` about the vertical through its own middle; `faces`
/// picks from -z, +z, -y, +y, -x, +x. Normals point outwards.
pub fn block(low: [f64; 3], high: [f64; 3], angle: f64, faces: &[usize]) -> Quads {
    const CORNERS: [[usize; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let (low, high) = (DVec3::from(low), DVec3::from(high));
    let (middle, turn) = (0.5 * (low + high), DMat3::from_rotation_z(angle));
    let corner = |i: usize| {
        let pick = |bit: usize, a: usize| if i >> bit & 1 == 1 { high[a] } else { low[a] };
        middle + turn * (DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2)) - middle)
    };
    faces.iter().map(|&f| CORNERS[f].map(corner)).collect()
}

const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];
const SIDES: [usize; 4] = [2, 3, 4, 5];

/// A closed room seen from within.
pub fn walls(low: [f64; 3], high: [f64; 3]) -> Quads {
    let mut quads = block(low, high, 0.0, &ALL);
    quads.iter_mut().for_each(|q| q.reverse());
    quads
}

fn legs(low: [f64; 3], high: [f64; 3], width: f64) -> Quads {
    let mut quads = Quads::new();
    for x in [low[0], high[0] - width] {
        for y in [low[1], high[1] - width] {
            quads.extend(block([x, y, low[2]], [x + width, y + width, high[2]], 0.0, &SIDES));
        }
    }
    quads
}

fn chair(x: f64, y: f64) -> Quads {
    let mut quads = legs([x, y, 0.0], [x + 0.45, y + 0.45, 0.43], 0.04);
    quads.extend(block([x, y, 0.43], [x + 0.45, y + 0.45, 0.47], 0.0, &ALL));
    quads.extend(block([x, y, 0.55], [x + 0.04, y + 0.45, 0.95], 0.0, &ALL));
    quads
}

/// The room: 5 by 4 by 2.8 m.
pub fn quads() -> Quads {
    let mut quads = walls([0.0; 3], [5.0, 4.0, 2.8]);
    quads.extend(legs([1.9, 1.4, 0.0], [3.3, 2.3, 0.72], 0.07));
    quads.extend(block([1.9, 1.4, 0.72], [3.3, 2.3, 0.76], 0.0, &ALL));
    quads.extend(chair(1.3, 1.6));
    quads.extend(chair(3.6, 1.8));
    // Cupboard, book shelves, two lamps, a turned stool.
    quads.extend(block([0.01, 3.3, 0.0], [1.1, 3.95, 1.9], 0.0, &[1, 2, 3, 4, 5]));
    for board in 0..4 {
        let z = 0.5 + 0.35 * f64::from(board);
        quads.extend(block([4.7, 0.6, z], [4.98, 1.9, z + 0.03], 0.0, &ALL));
    }
    for x in [1.2, 3.2] {
        quads.extend(block([x, 1.8, 2.6], [x + 0.6, 2.1, 2.7], 0.0, &ALL));
    }
    quads.extend(block([0.5, 0.5, 0.0], [0.9, 0.9, 0.45], 0.5, &ALL));
    // Door, mirror, rug: a little off the surfaces they hang or lie on.
    let panel = |a: [f64; 3], b: [f64; 3], c: [f64; 3], d: [f64; 3]| [a, b, c, d].map(DVec3::from);
    quads.push(panel([4.0, 3.99, 0.0], [3.2, 3.99, 0.0], [3.2, 3.99, 2.1], [4.0, 3.99, 2.1]));
    quads.push(panel([0.005, 1.2, 1.0], [0.005, 2.2, 1.0], [0.005, 2.2, 2.0], [0.005, 1.2, 2.0]));
    quads.push(panel([1.6, 1.1, 0.005], [3.6, 1.1, 0.005], [3.6, 2.6, 0.005], [1.6, 2.6, 0.005]));
    quads
}

/// Quadrilaterals as a scene, one-sided.
pub fn geometry(quads: &[[DVec3; 4]]) -> Geometry {
    let shapes =
        quads.iter().enumerate().map(|(i, q)| (Shape::Quad(*q), false, i as u32, ObjectId(0))).collect();
    Geometry::new(shapes, vec!["all".into()])
}

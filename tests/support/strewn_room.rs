//! Scenes for the tests of ray tracers, made without the scene loader.

use glam::{DQuat, DVec3};
use luxgraph::geometry::Shape;
use luxgraph::scene::{Geometry, ObjectId};

/// A room of 6 x 6 x 3 m with `boxes` boxes strewn about, each face a quad facing outwards (the
/// room's own inwards), one face in seven given as two triangles; all of it turned by `turn` about a
/// skew axis, rad. 22 boxes make 138 faces.
pub fn room(boxes: usize, turn: f64) -> Geometry {
    let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), turn);
    let mut shapes = Vec::new();
    let mut face = |corners: [DVec3; 4]| {
        let [a, b, c, d] = corners.map(|p| rotation * p);
        let patch = shapes.len() as u32;
        if patch % 7 == 3 {
            shapes.push((Shape::Triangle([a, b, c]), false, patch, ObjectId(0)));
            shapes.push((Shape::Triangle([a, c, d]), false, patch, ObjectId(0)));
        } else {
            shapes.push((Shape::Quad([a, b, c, d]), false, patch, ObjectId(0)));
        }
    };
    let mut state = 7u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24)
    };
    box_faces(DVec3::new(-3.0, -3.0, 0.0), DVec3::new(3.0, 3.0, 3.0), true).into_iter().for_each(&mut face);
    for _ in 0..boxes {
        let centre = DVec3::new(5.0 * random() - 2.5, 5.0 * random() - 2.5, 2.0 * random() + 0.5);
        let half = DVec3::new(random(), random(), random()) * 0.4 + 0.05;
        box_faces(centre - half, centre + half, false).into_iter().for_each(&mut face);
    }
    Geometry::new(shapes, vec!["room".into()])
}

fn box_faces(min: DVec3, max: DVec3, inwards: bool) -> [[DVec3; 4]; 6] {
    std::array::from_fn(|i| {
        let (axis, high) = (i / 2, i % 2 == 1);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut corners = [(false, false), (true, false), (true, true), (false, true)].map(|(at_u, at_v)| {
            let mut p = min;
            p[axis] = if high { max[axis] } else { min[axis] };
            p[u] = if at_u { max[u] } else { min[u] };
            p[v] = if at_v { max[v] } else { min[v] };
            p
        });
        if high == inwards {
            corners.reverse();
        }
        corners
    })
}

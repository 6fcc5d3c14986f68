//! A hall of desks: a scene of any number of quadrilaterals to measure growth on.

use crate::geometry::Shape;
use crate::material::{Body, Emission, Fresnel, Level, Material};
use crate::points::Sampling;
use crate::scene::{Appearance, Camera, Geometry, MaterialId, ObjectId, Scene};
use crate::spectrum::Spectrum;
use glam::DVec3;

/// Metres of floor that a desk takes each way.
const PITCH: f64 = 3.0;
/// Height of the hall, m.
const HEIGHT: f64 = 4.0;

/// Materials of the hall, in their order.
#[derive(Clone, Copy)]
enum Wears {
    Wall,
    Floor,
    Wood,
    Metal,
    Cloth,
    Lamp,
}

/// Reflectance of each, and luminance, cd/m². Grey: growth is a matter of geometry.
const MATERIALS: [(&str, f64, f64); 6] = [
    ("wall", 0.7, 0.0),
    ("floor", 0.3, 0.0),
    ("wood", 0.4, 0.0),
    ("metal", 0.5, 0.0),
    ("cloth", 0.2, 0.0),
    ("lamp", 0.8, 5000.0),
];

/// Faces of a box, by the axis and the direction in which they look.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
/// Number of the face that looks down.
const BOTTOM: usize = 4;
/// Number of the face that looks up.
const TOP: usize = 5;

/// Surfaces in the making.
#[derive(Default)]
struct Furniture {
    faces: Vec<([DVec3; 4], Wears, ObjectId)>,
    objects: Vec<String>,
}

impl Furniture {
    fn object(&mut self, name: String) -> ObjectId {
        self.objects.push(name);
        ObjectId(self.objects.len() as u32 - 1)
    }

    /// A box, but for the faces `without`, seen from outside.
    fn block(&mut self, low: DVec3, high: DVec3, wears: Wears, object: ObjectId, without: &[usize]) {
        let corner = |i: usize| {
            DVec3::new([low.x, high.x][i & 1], [low.y, high.y][i >> 1 & 1], [low.z, high.z][i >> 2])
        };
        let wanted = FACES.iter().enumerate().filter(|(number, _)| !without.contains(number));
        self.faces.extend(wanted.map(|(_, face)| (face.map(corner), wears, object)));
    }

    /// A desk with a screen, drawers and a chair: 38 faces.
    fn desk(&mut self, at: DVec3, name: String) {
        let object = self.object(name);
        let mut part = |low: [f64; 3], high: [f64; 3], wears, without: &[usize]| {
            self.block(at + DVec3::from(low), at + DVec3::from(high), wears, object, without);
        };
        part([0.0, 0.0, 0.72], [1.6, 0.8, 0.75], Wears::Wood, &[]);
        for x in [0.02, 1.54] {
            part([x, 0.05, 0.0], [x + 0.04, 0.75, 0.72], Wears::Metal, &[BOTTOM, TOP]);
        }
        part([0.5, 0.6, 0.85], [1.1, 0.65, 1.2], Wears::Metal, &[]);
        part([1.1, 0.1, 0.1], [1.5, 0.7, 0.65], Wears::Metal, &[]);
        part([0.35, -0.55, 0.42], [0.85, -0.05, 0.48], Wears::Cloth, &[]);
        part([0.35, -0.6, 0.55], [0.85, -0.55, 0.95], Wears::Cloth, &[]);
    }
}

/// A closed hall of `rows` by `columns` desks under a lamp each second desk: 38 quadrilaterals a desk
/// and 6 a lamp. Everything is diffuse.
pub fn hall(rows: usize, columns: usize) -> Scene {
    let mut furniture = Furniture::default();
    let room = furniture.object("room".into());
    let size = DVec3::new(PITCH * columns as f64, PITCH * rows as f64, HEIGHT);
    furniture.block(DVec3::ZERO, size, Wears::Wall, room, &[]);
    // Seen from within.
    for (corners, wears, _) in &mut furniture.faces {
        corners.reverse();
        if corners.iter().all(|c| c.z == 0.0) {
            *wears = Wears::Floor;
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let at = PITCH * DVec3::new(column as f64, row as f64, 0.0);
            furniture.desk(at + DVec3::new(0.7, 1.2, 0.0), format!("desk {row} {column}"));
            if (row + column) % 2 == 0 {
                let object = furniture.object(format!("lamp {row} {column}"));
                let low = at + DVec3::new(0.9, 1.3, 3.3);
                let high = low + DVec3::new(1.2, 0.3, 0.08);
                furniture.block(low, high, Wears::Metal, object, &[BOTTOM]);
                furniture.block(low, high, Wears::Lamp, object, &[0, 1, 2, 3, TOP]);
            }
        }
    }
    scene(furniture, size)
}

fn scene(furniture: Furniture, size: DVec3) -> Scene {
    let grey = Spectrum::Constant;
    let materials = MATERIALS.map(|(name, reflectance, luminance)| Material {
        name: name.into(),
        body: Body::Opaque {
            s: 0.0,
            m: 0.0,
            diffuse: Some(grey(reflectance)),
            fresnel: Fresnel::Index { n: grey(1.5), k: grey(0.0) },
        },
        emission: (luminance > 0.0)
            .then_some(Emission { spectrum: grey(1.0), level: Level::Luminance(luminance) }),
    });
    let worn = furniture.faces.iter().map(|(_, wears, _)| MaterialId(*wears as u32)).collect();
    let shapes = furniture.faces.iter().enumerate();
    let shapes = shapes.map(|(i, (corners, _, object))| (Shape::Quad(*corners), false, i as u32, *object));
    let geometry = Geometry::new(shapes.collect(), furniture.objects);
    let camera = Camera {
        name: "entrance".into(),
        position: DVec3::new(0.3, 0.3, 2.2),
        target: DVec3::new(0.5 * size.x, 0.5 * size.y, 0.5),
        up: DVec3::Z,
        fov_deg: 60.0,
        resolution: [640, 480],
    };
    Scene {
        sampling: Sampling::by_area(geometry.surfaces.iter().map(|s| s.area).sum::<f64>() / 1500.0),
        appearance: Appearance {
            materials: materials.into(),
            surface_material: worn,
            lights: Vec::new(),
            sky: None,
        },
        geometry,
        cameras: vec![camera],
        sensors: Vec::new(),
        grids: Vec::new(),
        notes: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hall_is_as_large_as_it_says_and_looks_inwards() {
        let scene = hall(3, 4);
        let geometry = &scene.geometry;
        assert_eq!(geometry.surfaces.len(), 6 + 12 * 38 + 6 * 6);
        let room = geometry.surfaces[..6].iter();
        assert!(room.clone().all(|s| s.distance(DVec3::ZERO) > 0.0), "walls see the middle");
        let area: f64 = room.map(|s| s.area).sum();
        assert!((area - 2.0 * (12.0 * 9.0 + 4.0 * (12.0 + 9.0))).abs() < 1e-4);
        // The divergence of the place over a desk's top is three times its volume.
        let volume: f64 =
            geometry.surfaces[6..12].iter().map(|s| s.distance(DVec3::ZERO) * s.area / -3.0).sum();
        assert!((volume - 1.6 * 0.8 * 0.03).abs() < 1e-6, "a box looks outwards");
        let lamps = scene.appearance.surface_material.iter().filter(|m| m.0 == Wears::Lamp as u32).count();
        assert_eq!(lamps, 6);
    }
}

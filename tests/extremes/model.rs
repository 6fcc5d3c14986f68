//! Small scenes that can be moved and written as a scene file.

use glam::{DMat3, DVec3};
use std::fmt::Write;

pub type Quad = [DVec3; 4];

/// A scene before it is written down.
#[derive(Clone)]
pub struct Model {
    /// (material, corners of quads), one object each.
    pub quads: Vec<(&'static str, Quad)>,
    pub triangles: Vec<(&'static str, [DVec3; 3])>,
    /// The `[materials]` of the file.
    pub materials: String,
    /// m²
    pub max_area: f64,
    pub eye: DVec3,
    pub target: DVec3,
}

/// A material that reflects and glows diffusely.
pub fn glowing(name: &str, rho: f64, emission: f64) -> String {
    format!(
        "[materials.{name}]\nreflectance = {rho:?}\n\
         emission = {{ spectrum = 1.0, radiance = {emission:?} }}\n"
    )
}

/// The faces of a box, seen from outside.
pub fn block(low: DVec3, high: DVec3) -> Vec<Quad> {
    let v = |i: usize| {
        let pick = |bit: usize, a: usize| if i >> bit & 1 == 0 { low[a] } else { high[a] };
        DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
    };
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
        .map(|face| face.map(v))
        .to_vec()
}

/// The faces of a box, seen from within.
pub fn walls(low: DVec3, high: DVec3) -> Vec<Quad> {
    block(low, high).into_iter().map(|[a, b, c, d]| [d, c, b, a]).collect()
}

impl Model {
    /// A closed box between the corners; every face wears "wall", which `materials` must describe. The eye is
    /// in the middle.
    pub fn closed_box(low: DVec3, high: DVec3, materials: String, elements: f64) -> Model {
        let size = high - low;
        let area = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        let eye = 0.5 * (low + high);
        Model {
            quads: walls(low, high).into_iter().map(|q| ("wall", q)).collect(),
            triangles: Vec::new(),
            materials,
            max_area: area / elements,
            eye,
            target: eye + size * DVec3::new(0.31, 0.27, 0.11),
        }
    }

    /// A closed room whose walls glow alike: B = E / (1 - rho) everywhere.
    pub fn furnace(rho: f64, emission: f64) -> Model {
        let size = DVec3::new(2.0, 1.5, 1.0);
        Model::closed_box(-0.5 * size, 0.5 * size, glowing("wall", rho, emission), 200.0)
    }

    /// [`Model::furnace`], one wall in triangles, with a block and a warped quadrilateral in the middle.
    pub fn furnished_furnace(rho: f64, emission: f64) -> Model {
        let mut model = Model::furnace(rho, emission);
        let (_, [a, b, c, d]) = model.quads.remove(1);
        model.triangles = vec![("wall", [a, b, c]), ("wall", [c, d, a])];
        // Turned and at odd places, so that no segment between two points runs along an edge by design.
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.4);
        let cube = block(DVec3::splat(-0.217), DVec3::splat(0.217));
        let centre = DVec3::new(0.313, -0.097, -0.041);
        model.quads.extend(cube.into_iter().map(|q| ("wall", q.map(|v| centre + turn * v))));
        let warped =
            [[-0.71, -0.43, -0.19], [-0.29, -0.41, -0.23], [-0.31, 0.03, -0.11], [-0.69, 0.01, -0.17]];
        model.quads.push(("both", warped.map(DVec3::from)));
        model.materials += &(glowing("both", rho, emission) + "two_sided = true\n");
        model
    }

    /// Every place p at scale p + offset.
    pub fn placed(&self, scale: f64, offset: DVec3) -> Model {
        let at = |p: DVec3| scale * p + offset;
        Model {
            quads: self.quads.iter().map(|(m, q)| (*m, q.map(at))).collect(),
            triangles: self.triangles.iter().map(|(m, t)| (*m, t.map(at))).collect(),
            materials: self.materials.clone(),
            max_area: scale * scale * self.max_area,
            eye: at(self.eye),
            target: at(self.target),
        }
    }

    /// The scene file.
    pub fn toml(&self) -> String {
        let mut text = format!("format = 1\n[sampling]\nmax_area = {:?}\n{}", self.max_area, self.materials);
        let place = |p: &DVec3| format!("[{:?}, {:?}, {:?}]", p.x, p.y, p.z);
        let mut object = |i: usize, material: &str, kind: &str, corners: &[DVec3]| {
            let corners: Vec<String> = corners.iter().map(place).collect();
            let corners = corners.join(", ");
            let _ = write!(
                text,
                "[[objects]]\nname = \"{kind} {i}\"\nmaterial = \"{material}\"\n{kind} = [[{corners}]]\n"
            );
        };
        self.quads.iter().enumerate().for_each(|(i, (m, q))| object(i, m, "quads", q));
        self.triangles.iter().enumerate().for_each(|(i, (m, t))| object(i, m, "triangles", t));
        let (eye, target) = (place(&self.eye), place(&self.target));
        let _ = write!(
            text,
            "[[cameras]]\nname = \"eye\"\nposition = {eye}\ntarget = {target}\nup = [0.1, 0.2, 1.0]\n\
             fov_deg = 70.0\nresolution = [8, 6]\n"
        );
        text
    }
}

//! A scene: geometry, which the visibility graph depends on, and appearance, which it does not.

mod camera;
mod compile;
mod csv;
mod description;
mod emission;
mod framing;
mod ies;
mod import;
mod joined;
mod light;
mod lights;
mod load;
mod materials;
mod motion;
mod parts;
mod places;
mod sampled;
mod sensor;
mod skies;
mod sky;
mod source;
mod spectra;
mod suggest;
mod surfaces;
mod touching;
mod web;
mod written;

pub use camera::{Camera, View};
pub use light::{Distribution, Light, LightKind, LightLevel, LightSource, Way};
pub use load::{SceneDescription, load, load_with_changes};
pub use sampled::SampledAppearance;
pub use sensor::{Grid, Sensor};
pub use sky::{SampledSky, Sky, SkyLevel, SkyShape};
pub use web::{Web, WebType};

use crate::geometry::{Aabb, Surface, SurfaceId};
use crate::material::Material;
use crate::points::Sampling;
use glam::DVec3;

/// Index of a material in [`Appearance::materials`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// Index of an object in [`Geometry::objects`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ObjectId(pub u32);

/// A compiled scene: everything is validated, nothing is missing.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Shapes: all that visibility depends on.
    pub geometry: Geometry,
    /// Materials and who wears them: all that may change under a graph.
    pub appearance: Appearance,
    /// How the scene file asks for the surfaces to be sampled.
    pub sampling: Sampling,
    /// Named cameras, in the order of the file; at least one.
    pub cameras: Vec<Camera>,
    /// Single sensors, in the order of the file.
    pub sensors: Vec<Sensor>,
    /// Grids of sensors, in the order of the file.
    pub grids: Vec<Grid>,
    /// What the loader repaired or ignored, one sentence each.
    pub notes: Vec<String>,
}

/// The shapes of a scene, in coordinates relative to [`Geometry::centre`].
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Centre of the bounds in world coordinates, m. World = centre + local.
    pub centre: DVec3,
    /// Half the diagonal of the bounds, m.
    pub radius: f64,
    /// All surfaces.
    pub surfaces: Vec<Surface>,
    /// Per surface: whether its back has sample points too.
    pub two_sided: Vec<bool>,
    /// Per surface: whether light may go straight through it, which takes two sides. All that have two until a scene file
    /// tells which wear panes.
    pub pane: Vec<bool>,
    /// Per surface: the patch it belongs to. Surfaces of one patch are pieces of one smooth
    /// surface (the two triangles of a warped quadrilateral) and are interpolated across.
    pub patch: Vec<u32>,
    /// Per surface: its object.
    pub object: Vec<ObjectId>,
    /// Names of the objects.
    pub objects: Vec<String>,
    /// Per surface: the largest area of its elements where the scene file sets one for the
    /// object, m²; it takes the place of [`Sampling::max_area`].
    pub max_area: Vec<Option<f64>>,
    /// Lights without a body. What they give is the appearance's.
    pub lights: Vec<Light>,
    /// Where the zenith is, unit, of a scene under a sky. What the sky gives is the appearance's.
    pub zenith: Option<DVec3>,
}

impl Geometry {
    /// Centres `shapes` (world coordinates, with `two_sided`, patch and object of each) and puts
    /// their vertices, centres and radii on the `f32` lattice.
    pub fn new(shapes: Vec<(crate::geometry::Shape, bool, u32, ObjectId)>, objects: Vec<String>) -> Self {
        let bounds = shapes.iter().fold(Aabb::EMPTY, |b, (shape, ..)| b.union(shape.bounds()));
        let centre = if shapes.is_empty() { DVec3::ZERO } else { bounds.centre() };
        let local = |p: DVec3| (p - centre).as_vec3().as_dvec3();
        let mut geometry = Geometry {
            centre,
            radius: if shapes.is_empty() { 0.0 } else { 0.5 * bounds.size().length() },
            surfaces: Vec::with_capacity(shapes.len()),
            two_sided: Vec::with_capacity(shapes.len()),
            pane: Vec::new(),
            patch: Vec::with_capacity(shapes.len()),
            object: Vec::with_capacity(shapes.len()),
            objects,
            max_area: vec![None; shapes.len()],
            lights: Vec::new(),
            zenith: None,
        };
        for (shape, two_sided, patch, object) in shapes {
            geometry.surfaces.push(Surface::new(shape.placed(local)));
            geometry.two_sided.push(two_sided);
            geometry.patch.push(patch);
            geometry.object.push(object);
        }
        geometry.pane = geometry.two_sided.clone();
        geometry
    }

    /// The smallest box around all surfaces, local coordinates.
    pub fn bounds(&self) -> Aabb {
        self.surfaces.iter().fold(Aabb::EMPTY, |b, s| b.union(s.bounds()))
    }

    /// The surface `id`.
    pub fn surface(&self, id: SurfaceId) -> &Surface {
        &self.surfaces[id.index()]
    }

    /// The largest area that an element of surface `id` may have, m².
    pub fn max_area_of(&self, id: SurfaceId, sampling: &Sampling) -> f64 {
        self.max_area[id.index()].unwrap_or(sampling.max_area) * sampling.area_factor
    }

    /// Distances from a plane below this are no distance at all: the `f32` lattice cannot tell, m.
    pub fn plane_tolerance(&self) -> f64 {
        1e-6 * self.radius
    }

    /// A hash of all that sampling and what points see of each other depend on. Lights are no part of
    /// it: a graph finds out anew what each of them reaches.
    pub fn hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        for (surface, two_sided) in self.surfaces.iter().zip(&self.two_sided) {
            hasher.update(&[surface.vertices().len() as u8, u8::from(*two_sided)]);
            if let Some(round) = surface.round() {
                hasher.update(&round.bytes());
            }
            for v in surface.vertices() {
                for x in v.to_array() {
                    hasher.update(&x.to_le_bytes());
                }
            }
        }
        *hasher.finalize().as_bytes()
    }
}

/// Materials, and which surface wears which.
#[derive(Clone, Debug)]
pub struct Appearance {
    /// All materials of the scene file, used or not.
    pub materials: Vec<Material>,
    /// Per surface: its material.
    pub surface_material: Vec<MaterialId>,
    /// What each of [`Geometry::lights`] gives.
    pub lights: Vec<LightSource>,
    /// What the sky gives, if there is one.
    pub sky: Option<Sky>,
}

impl Appearance {
    /// The material of surface `id`.
    pub fn material(&self, id: SurfaceId) -> &Material {
        &self.materials[self.surface_material[id.index()].0 as usize]
    }
}

//! What is read from an OBJ or a glTF file, before it is placed in a scene.

use super::super::description::{CameraTable, LightTable, MaterialTable};
use super::polygon;
use crate::error::Error;
use crate::sets::Sets;
use glam::DVec3;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The contents of an OBJ or glTF file.
#[derive(Clone, Debug)]
pub struct Model {
    /// The file.
    pub path: PathBuf,
    /// Corners, in the units of the file.
    pub vertices: Vec<DVec3>,
    /// Triangles and quadrilaterals.
    pub faces: Vec<Face>,
    /// Numbers of patches are below this.
    pub patches: u32,
    /// What the faces belong to.
    pub parts: Vec<Part>,
    /// Materials that the file, or one that it names, defines.
    pub materials: Vec<Material>,
    /// Lights that the file defines.
    pub lights: Vec<LightTable>,
    /// Cameras that the file defines.
    pub cameras: Vec<CameraTable>,
    /// Whether a material that is worn and nowhere defined becomes a plain one.
    pub with_defaults: bool,
    /// What was repaired, approximated or ignored, one sentence each.
    pub notes: Vec<String>,
}

/// A material of a model.
#[derive(Clone, Debug)]
pub struct Material {
    /// Its name in the file.
    pub name: String,
    /// The same as a scene file would say it.
    pub table: MaterialTable,
    /// The file that defines it.
    pub file: PathBuf,
}

/// A triangle or quadrilateral.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Vertices; a triangle's last is repeated.
    pub corners: [u32; 4],
    /// 3 or 4.
    pub count: u8,
    /// Index into [`Model::parts`].
    pub part: u32,
    /// Faces with the same number are pieces of one smooth surface.
    pub patch: u32,
    /// Where it is written.
    pub place: Place,
}

/// All faces of one object that wear one material.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Part {
    /// The name of the object.
    pub object: Option<String>,
    /// The name of the material.
    pub material: Option<String>,
    /// The first face of the part.
    pub place: Place,
}

/// Line and column in the file, from 1. What has no lines is all at the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    /// Line.
    pub line: u32,
    /// Column in characters.
    pub column: u32,
}

/// The beginning of a file.
pub const START: Place = Place { line: 1, column: 1 };

/// A corner of a polygon: which vertex, and which normal, if any ([`NO_NORMAL`] else).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Corner {
    pub vertex: u32,
    pub normal: u32,
}

/// The corner has no normal of its own.
pub const NO_NORMAL: u32 = u32::MAX;

impl Model {
    /// Nothing yet.
    pub fn new(path: &Path) -> Model {
        Model {
            path: path.to_path_buf(),
            vertices: Vec::new(),
            faces: Vec::new(),
            patches: 0,
            parts: Vec::new(),
            materials: Vec::new(),
            lights: Vec::new(),
            cameras: Vec::new(),
            with_defaults: true,
            notes: Vec::new(),
        }
    }

    /// The error `message` at `place`.
    pub fn error(&self, place: Place, message: impl Into<String>) -> Error {
        error_at(&self.path, place, message)
    }

    /// Takes the faces that polygons became, and says what became of them.
    pub fn take(&mut self, made: Faces) {
        self.faces = made.faces;
        self.patches = made.patches;
        if made.split > 0 {
            let were = if made.split == 1 { "polygon" } else { "polygons" };
            let split = made.split;
            self.note(format_args!("{split} {were} with more than four corners divided"));
        }
        if made.lost > 0 {
            let were = if made.lost == 1 { "polygon" } else { "polygons" };
            let lost = made.lost;
            self.note(format_args!(
                "{lost} {were} with more than four corners that enclose no area left out"
            ));
        }
        if made.merged > 0 {
            let merged = made.merged;
            self.note(format_args!("{merged} pairs of triangles in one plane taken as quadrilaterals"));
        }
        if made.smooth > 0 {
            let smooth = made.smooth;
            self.note(format_args!(
                "{smooth} faces are smooth by their normals: diffuse light is interpolated across their edges, and \
                 mirrors and glass in views reflect smoothly"
            ));
        }
    }

    /// Adds a note that begins with the file's name.
    pub fn note(&mut self, what: impl std::fmt::Display) {
        self.notes.push(format!("{}: {what}", self.path.display()));
    }
}

/// The error `message` at `place` of the file `path`.
pub fn error_at(path: &Path, place: Place, message: impl Into<String>) -> Error {
    Error::Scene {
        path: path.to_path_buf(),
        line: place.line as usize,
        column: place.column as usize,
        message: message.into(),
    }
}

/// Collects polygons with the normals at their corners, and makes faces of them.
#[derive(Default)]
pub struct Polygons {
    faces: Vec<Face>,
    /// By face.
    normals: Vec<[u32; 4]>,
    split: usize,
    lost: usize,
}

/// What became of the polygons.
pub struct Faces {
    /// Triangles and quadrilaterals.
    pub faces: Vec<Face>,
    /// Numbers of their patches are below this.
    pub patches: u32,
    /// Polygons with more than four corners that were divided.
    pub split: usize,
    /// Such polygons that enclose nothing.
    pub lost: usize,
    /// Pairs of triangles that became quadrilaterals.
    pub merged: usize,
    /// Faces that go on smoothly around an edge.
    pub smooth: usize,
}

impl Polygons {
    /// Adds a polygon of at least three corners.
    pub fn push(&mut self, corners: &[Corner], vertices: &[DVec3], part: u32, place: Place) {
        let mut add = |of: &[Corner]| {
            let corner = |k: usize| of[k.min(of.len() - 1)];
            let corners = [0, 1, 2, 3].map(|k| corner(k).vertex);
            self.normals.push([0, 1, 2, 3].map(|k| corner(k).normal));
            self.faces.push(Face { corners, count: of.len() as u8, part, patch: 0, place });
        };
        if corners.len() <= 4 {
            return add(corners);
        }
        let points: Vec<DVec3> = corners.iter().map(|c| vertices[c.vertex as usize]).collect();
        let triangles = polygon::triangles(&points);
        if triangles.is_empty() {
            self.lost += 1;
            return;
        }
        for triangle in triangles {
            add(&triangle.map(|k| corners[k]));
        }
        self.split += 1;
    }

    /// Joins what is smooth and merges what is flat. `vertices` are those of the corners.
    pub fn finish(self, vertices: &[DVec3]) -> Faces {
        let Polygons { mut faces, normals, split, lost } = self;
        let (welded, patches) = (weld(vertices), faces.len() as u32);
        let smooth = join_smooth(&mut faces, &normals, vertices, &welded);
        let merged = polygon::merge_pairs(&mut faces, vertices, &welded);
        Faces { faces, patches, split, lost, merged, smooth }
    }
}

/// Per vertex the first one at the same place.
pub fn weld(vertices: &[DVec3]) -> Vec<u32> {
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(vertices.len());
    let number = |(i, v): (usize, &DVec3)| {
        // Adding zero makes -0 and 0 the same place.
        *first.entry((*v + 0.0).to_array().map(f64::to_bits)).or_insert(i as u32)
    };
    vertices.iter().enumerate().map(number).collect()
}

/// Gives faces one patch where they share an edge and its normals, and wear one material. Returns how many of them
/// bend there.
fn join_smooth(faces: &mut [Face], normals: &[[u32; 4]], vertices: &[DVec3], welded: &[u32]) -> usize {
    let facing = |face: &Face| {
        let [a, b, c, d] = face.corners.map(|v| vertices[v as usize]);
        if face.count == 3 { (b - a).cross(c - a) } else { (c - a).cross(d - b) }.normalize_or_zero()
    };
    let mut patches = Sets::new(faces.len());
    let mut edges: HashMap<(u32, [Corner; 2]), u32> = HashMap::new();
    let mut bent: Vec<u32> = Vec::new();
    for (i, (face, normals)) in faces.iter().zip(normals).enumerate() {
        let count = usize::from(face.count);
        let corner = |k: usize| {
            let k = k % count;
            Corner { vertex: welded[face.corners[k] as usize], normal: normals[k] }
        };
        for k in 0..count {
            let mut edge = [corner(k), corner(k + 1)];
            if edge.iter().any(|c| c.normal == NO_NORMAL) {
                continue;
            }
            edge.sort_unstable_by_key(|c| (c.vertex, c.normal));
            let other = *edges.entry((face.part, edge)).or_insert(i as u32);
            if other != i as u32 {
                patches.join(other, i as u32);
                if facing(face).dot(facing(&faces[other as usize])) < 1.0 - 1e-9 {
                    bent.extend([i as u32, other]);
                }
            }
        }
    }
    for (i, face) in faces.iter_mut().enumerate() {
        face.patch = patches.of(i as u32);
    }
    bent.sort_unstable();
    bent.dedup();
    bent.len()
}

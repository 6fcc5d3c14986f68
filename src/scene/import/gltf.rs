//! glTF 2.0, as JSON with buffers beside it or as one binary file: meshes with the places that the nodes give them,
//! materials, lights and cameras.

use super::super::source::{MAX_OBJ_BYTES, Source, Sources};
use super::buffers::Buffers;
use super::census;
use super::dress::dress;
use super::gltf_materials;
use super::mesh::{Corner, Model, NO_NORMAL, Part, Place, Polygons, START, error_at};
use super::{note, read_bytes};
use crate::error::{Error, Result};
use glam::{DMat3, DMat4, DQuat, DVec3};
use gltf::json::accessor::Type;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::{Checked, Validate};
use gltf::json::{Node, Root};
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use toml::Spanned;

/// More faces than this are refused: a small file can ask for many by naming one mesh often.
const MOST_FACES: usize = 4_000_000;
/// Vertices at most, those that no triangle uses too.
const MOST_VERTICES: usize = 3 * MOST_FACES;
/// Nodes may stand below each other so deep.
const DEEPEST: usize = 1000;

/// Extensions that change nothing which is read here, or are read.
const READ: [&str; 8] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];
/// Extensions without which there are no meshes to read.
const NEEDED: [&str; 3] =
    ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Reads the glTF file `path`, JSON or binary, and the files that it names.
pub fn read(path: &Path, sources: &mut Sources) -> Result<Model> {
    let bytes = read_bytes(path, MAX_OBJ_BYTES).map_err(|why| Error::io(path, why))?;
    let base = sources.add(Source { path: path.to_path_buf(), text: String::new() });
    let fault = |message: String| error_at(path, START, message);
    let (json, binary) = parts(bytes).map_err(fault)?;
    census::check(&json).map_err(fault)?;
    let mut root: Root = serde_json::from_slice(&json).map_err(|e| {
        let place = Place { line: e.line().max(1) as u32, column: e.column().max(1) as u32 };
        let message = e.to_string();
        let message = message.rsplit_once(" at line ").map_or(message.as_str(), |(what, _)| what);
        error_at(path, place, format!("this is no glTF 2.0: {message}; export the scene again"))
    })?;
    drop(json);
    if let Some(needed) = root.extensions_required.iter().find(|e| NEEDED.contains(&e.as_str())) {
        return Err(fault(format!(
            "the meshes are compressed by {needed}, which is not read; export without it"
        )));
    }
    // The other extensions only change looks; those not read are noted.
    root.extensions_required.clear();
    // The library's validation looks these up unasked.
    let positions = |p: &Primitive| p.attributes.get(&Checked::Valid(Semantic::Positions)).map(|a| a.value());
    for (i, mesh) in root.meshes.iter().enumerate() {
        if mesh.primitives.iter().filter_map(positions).any(|accessor| accessor >= root.accessors.len()) {
            return Err(fault(format!(
                "meshes[{i}] has positions that do not exist; export the scene again"
            )));
        }
    }
    let mut first = None;
    root.validate(&root, gltf::json::Path::new, &mut |at, what| {
        let at = at().to_string();
        // What is not followed may lead nowhere, and bounds are not read.
        let aside = ["textures", "images", "samplers", "animations", "skins"];
        let followed = !aside.iter().any(|kind| at.starts_with(kind));
        if followed && !at.ends_with(".min") && !at.ends_with(".max") {
            first.get_or_insert_with(|| format!("{at}: {what}"));
        }
    });
    if let Some(what) = first {
        return Err(fault(format!("this is no valid glTF 2.0: {what}; export the scene again")));
    }
    let buffers = Buffers::read(&root, path, binary).map_err(fault)?;
    let (described, notes) = gltf_materials::describe(&root, &buffers, path, base);
    let material_names = described.iter().map(|d| d.name.clone()).collect();
    let mut reader = Reader {
        root: &root,
        buffers: &buffers,
        model: Model::new(path),
        polygons: Polygons::default(),
        normals: HashMap::new(),
        material_names,
        names: HashMap::new(),
        base,
        faces: 0,
        ignored: BTreeSet::new(),
    };
    reader.scene().map_err(fault)?;
    let Reader { mut model, polygons, mut ignored, .. } = reader;
    let made = polygons.finish(&model.vertices);
    model.take(made);
    model.notes.extend(notes);
    dress(&mut model, described);
    let unread = root.extensions_used.iter().filter(|e| !READ.contains(&e.as_str()));
    ignored.extend(unread.take(16).map(|e| e.chars().take(64).collect()));
    for (what, there) in [("animations", !root.animations.is_empty()), ("skins", !root.skins.is_empty())] {
        if there {
            ignored.insert(what.to_owned());
        }
    }
    if !ignored.is_empty() {
        let list: Vec<String> = ignored.into_iter().collect();
        model.note(format_args!("ignored {}", list.join(", ")));
    }
    Ok(model)
}

/// The JSON and the binary part.
fn parts(mut bytes: Vec<u8>) -> std::result::Result<(Vec<u8>, Option<Vec<u8>>), String> {
    if !bytes.starts_with(b"glTF") {
        if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
            return Err("the file is UTF-16 text; save it as UTF-8".into());
        }
        if bytes.starts_with(b"\xef\xbb\xbf") {
            bytes.drain(..3);
        }
        return Ok((bytes, None));
    }
    let length = bytes.get(8..12).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if bytes.len() < 20 || length.is_none_or(|length| length < 20 || length as usize > bytes.len()) {
        return Err("this binary glTF file is cut off; copy or export it again".into());
    }
    let glb = gltf::Glb::from_slice(&bytes).map_err(|e| {
        let what = match e {
            gltf::Error::Binary(e) => e.to_string(),
            other => other.to_string(),
        };
        format!("this binary glTF file is damaged ({what}); export it again as glTF 2.0")
    })?;
    Ok((glb.json.into_owned(), glb.bin.map(|bin| bin.into_owned())))
}

/// A file that is read.
pub(super) struct Reader<'a> {
    pub root: &'a Root,
    buffers: &'a Buffers<'a>,
    pub model: Model,
    polygons: Polygons,
    /// Numbers of normals, by their bits.
    normals: HashMap<[u64; 3], u32>,
    material_names: Vec<String>,
    /// How often a name was given.
    names: HashMap<String, usize>,
    base: usize,
    faces: usize,
    /// Kinds of things that are left out.
    pub ignored: BTreeSet<String>,
}

/// `Ok`, or what is wrong.
pub(super) type Read = std::result::Result<(), String>;

impl Reader<'_> {
    /// All nodes of the scene that is shown first.
    fn scene(&mut self) -> Read {
        let root = self.root;
        let scene = root.scene.map_or(0, |s| s.value());
        let top: Vec<usize> = match root.scenes.get(scene) {
            Some(scene) => scene.nodes.iter().map(|n| n.value()).collect(),
            None => {
                let below: BTreeSet<usize> =
                    root.nodes.iter().flat_map(|n| n.children.iter().flatten()).map(|n| n.value()).collect();
                (0..root.nodes.len()).filter(|n| !below.contains(n)).collect()
            }
        };
        if root.scenes.len() > 1 {
            self.ignored.insert("scenes other than the first shown".into());
        }
        let mut seen = vec![false; root.nodes.len()];
        let mut open: Vec<(usize, DMat4, usize)> =
            top.into_iter().rev().map(|node| (node, DMat4::IDENTITY, 0)).collect();
        while let Some((index, above, depth)) = open.pop() {
            let Some(node) = root.nodes.get(index) else {
                return Err(format!("nodes[{index}] does not exist"));
            };
            if std::mem::replace(&mut seen[index], true) || depth > DEEPEST {
                let message =
                    "is reached twice or lies too deep: nodes must form a tree; export the scene again";
                return Err(format!("nodes[{index}] {message}"));
            }
            let place = above * matrix(node);
            if !place.is_finite() {
                return Err(format!("nodes[{index}] has a transform that is not finite; mend it"));
            }
            self.node(index, node, place)?;
            open.extend(node.children.iter().flatten().rev().map(|child| (child.value(), place, depth + 1)));
        }
        Ok(())
    }

    fn node(&mut self, index: usize, node: &Node, place: DMat4) -> Read {
        if let Some(mesh) = node.mesh.and_then(|m| self.root.meshes.get(m.value())) {
            let called = node.name.as_ref().or(mesh.name.as_ref()).filter(|n| !n.is_empty());
            let name = self.unique(called.cloned().unwrap_or_else(|| format!("node {index}")));
            for (k, primitive) in mesh.primitives.iter().enumerate() {
                self.primitive(primitive, place, &name)
                    .map_err(|what| format!("nodes[{index}], primitive {k}: {what}"))?;
            }
        }
        let light = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
        if let Some(light) = light {
            self.light(light.light.value(), index, node, place)?;
        }
        if let Some(camera) = node.camera {
            self.camera(camera.value(), index, node, place);
        }
        Ok(())
    }

    /// `name`, with a number if it was given before.
    pub fn unique(&mut self, name: String) -> String {
        let times = self.names.entry(name.clone()).or_insert(0);
        *times += 1;
        if *times == 1 { name } else { format!("{name}#{times}") }
    }

    fn primitive(&mut self, primitive: &Primitive, place: DMat4, object: &str) -> Read {
        let Checked::Valid(mode) = primitive.mode else { return Err("has an unknown mode".into()) };
        if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            self.ignored.insert("points and lines".into());
            return Ok(());
        }
        if primitive.targets.is_some() {
            self.ignored.insert("morph targets".into());
        }
        let attribute = |which: Semantic| primitive.attributes.get(&Checked::Valid(which)).copied();
        let Some(positions) = attribute(Semantic::Positions) else {
            return Err("has no positions; export it again".into());
        };
        let positions = vectors(&self.buffers.values(positions, Type::Vec3)?);
        let normals = match attribute(Semantic::Normals) {
            Some(normals) => vectors(&self.buffers.values(normals, Type::Vec3)?),
            None => Vec::new(),
        };
        let order: Vec<usize> = match primitive.indices {
            Some(indices) => {
                let values = self.buffers.values(indices, Type::Scalar)?;
                values.into_iter().map(|i| i as usize).collect()
            }
            None => (0..positions.len()).collect(),
        };
        if let Some(wrong) = order.iter().find(|&&i| i >= positions.len()) {
            return Err(format!("has an index {wrong}, but only {} vertices", positions.len()));
        }
        let triangles: Vec<[usize; 3]> = match mode {
            Mode::TriangleStrip => (2..order.len())
                .map(|k| if k % 2 == 0 { [k - 2, k - 1, k] } else { [k - 1, k - 2, k] })
                .collect(),
            Mode::TriangleFan => (2..order.len()).map(|k| [0, k - 1, k]).collect(),
            _ => (0..order.len() / 3).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        };
        self.faces += triangles.len();
        if self.faces > MOST_FACES {
            return Err(format!("there are more than {MOST_FACES} triangles; leave some out"));
        }
        let first = self.model.vertices.len();
        if first + positions.len() > MOST_VERTICES {
            return Err(format!("there are more than {MOST_VERTICES} vertices; leave some out"));
        }
        for p in &positions {
            let p = place.transform_point3(*p);
            if !p.is_finite() {
                return Err("has a position that is not finite; mend the mesh".into());
            }
            self.model.vertices.push(p);
        }
        let linear = DMat3::from_mat4(place);
        let mirrored = linear.determinant() < 0.0;
        let part = self.part(object, primitive);
        let numbers: Vec<u32> = normals.iter().map(|n| self.normal(linear, *n)).collect();
        for mut triangle in triangles {
            if mirrored {
                triangle.swap(1, 2);
            }
            let corners = triangle.map(|k| {
                let vertex = order[k];
                let normal = numbers.get(vertex).copied().unwrap_or(NO_NORMAL);
                Corner { vertex: (first + vertex) as u32, normal }
            });
            self.polygons.push(&corners, &self.model.vertices, part, START);
        }
        Ok(())
    }

    /// The number of a normal as it stands in the scene; equal to a thousandth, for programs round them.
    fn normal(&mut self, linear: DMat3, normal: DVec3) -> u32 {
        let cofactor = DMat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        );
        let Some(n) = (cofactor * normal).try_normalize() else { return NO_NORMAL };
        let next = self.normals.len() as u32;
        let bits = ((1000.0 * n).round() + 0.0).to_array().map(f64::to_bits);
        *self.normals.entry(bits).or_insert(next)
    }

    fn part(&mut self, object: &str, primitive: &Primitive) -> u32 {
        let material = primitive.material.and_then(|m| self.material_names.get(m.value())).cloned();
        let part = Part { object: Some(object.to_owned()), material, place: START };
        // Only the primitives of one node can share a part, and they come one after the other.
        let near = self.model.parts.len().saturating_sub(64);
        match self.model.parts[near..].iter().position(|p| *p == part) {
            Some(found) => (near + found) as u32,
            None => {
                self.model.parts.push(part);
                self.model.parts.len() as u32 - 1
            }
        }
    }

    /// `value` as if this file had it in a table.
    pub fn here<T>(&self, value: T) -> Spanned<T> {
        Spanned::new(self.base..self.base, value)
    }
}

fn vectors(values: &[f64]) -> Vec<DVec3> {
    values.chunks_exact(3).map(DVec3::from_slice).collect()
}

/// Where a node puts what is below it.
fn matrix(node: &Node) -> DMat4 {
    if let Some(matrix) = node.matrix {
        return DMat4::from_cols_array(&matrix.map(f64::from));
    }
    let vector = |v: Option<[f32; 3]>, default: f64| {
        v.map_or(DVec3::splat(default), |v| DVec3::from_array(v.map(f64::from)))
    };
    let turn = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)));
    let turn = if turn.length() > 1e-6 { turn.normalize() } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(vector(node.scale, 1.0), turn, vector(node.translation, 0.0))
}

/// Names without repetitions, in their order: a name that was given before gets a number.
pub fn distinct(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut taken: BTreeSet<String> = BTreeSet::new();
    let mut distinct = Vec::new();
    for name in names {
        let mut unique = name.clone();
        for k in 2.. {
            if taken.insert(unique.clone()) {
                break;
            }
            unique = format!("{name}#{k}");
        }
        distinct.push(unique);
    }
    distinct
}

/// Notes on kinds of things, each with the names of the materials it is about.
pub fn list(kinds: std::collections::BTreeMap<&'static str, Vec<String>>, path: &Path) -> Vec<String> {
    kinds.iter().map(|(what, names)| format!("{}: {what}: {}", path.display(), note::names(names))).collect()
}

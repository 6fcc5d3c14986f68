//! Which objects there are and what each wears.

use super::SceneDescription;
use super::description::Name;
use super::import::{Model, Place};
use super::motion::Motion;
use super::suggest;
use crate::error::{Error, Result};
use std::collections::BTreeSet;
use std::sync::Arc;
use toml::Spanned;

/// An object of the compiled scene: one name, one material.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// The name of the material it wears; it exists.
    pub material: String,
    /// The index of the entry under `[[objects]]`.
    pub object: usize,
    /// The part of the model, if it comes from one.
    pub model_part: Option<u32>,
    /// Where changes moved it.
    pub motion: Option<Motion>,
    /// Whether changes removed it.
    pub removed: bool,
    /// Whether `[assign]` gave it its material, and where.
    assigned: Option<usize>,
}

/// What changes do to the objects of a name.
#[derive(Clone, Debug)]
pub enum Edit {
    /// They wear another material.
    Assign(Name),
    /// They go elsewhere.
    Move(Motion),
    /// They are no longer there.
    Remove,
}

impl Part {
    /// The error `message` where changes assigned the material, or else at `place`.
    pub fn error(&self, description: &SceneDescription, place: usize, message: String) -> Error {
        description.sources.error(self.assigned.unwrap_or(place), message)
    }

    /// Whether `name` means this object: its own name, or that of the whole model.
    fn answers_to(&self, name: &str) -> bool {
        match self.name.strip_prefix(name) {
            Some("") => true,
            Some(rest) => self.model_part.is_some() && rest.starts_with(['/', ':']),
            None => false,
        }
    }
}

/// All objects of `description` with their materials.
pub fn parts(description: &SceneDescription) -> Result<Vec<Part>> {
    let (document, sources) = (&description.document, &description.sources);
    let mut parts = Vec::new();
    let mut names = BTreeSet::new();
    for (i, object) in document.objects.iter().enumerate() {
        let table = object.get_ref();
        if !names.insert(table.name.get_ref()) {
            let message = format!("there are two objects \"{}\"; rename one", table.name.get_ref());
            return Err(sources.error(table.name.span().start, message));
        }
        match description.models.get(&i) {
            Some(model) => model_parts(description, i, model, &mut parts)?,
            None => {
                let Some(material) = &table.material else {
                    let message = format!("object \"{}\" has no `material`; add one", table.name.get_ref());
                    return Err(sources.error(object.span().start, message));
                };
                known_material(description, material.get_ref())
                    .map_err(|message| sources.error(material.span().start, message))?;
                parts.push(Part {
                    name: table.name.get_ref().clone(),
                    material: material.get_ref().clone(),
                    object: i,
                    model_part: None,
                    motion: None,
                    removed: false,
                    assigned: None,
                });
            }
        }
    }
    edit(description, &mut parts)?;
    Ok(parts)
}

/// Applies the edits of all changes, in their order.
fn edit(description: &SceneDescription, parts: &mut [Part]) -> Result<()> {
    let sources = &description.sources;
    for (object, edit) in &description.edits {
        if let Edit::Assign(material) = edit {
            known_material(description, material.get_ref())
                .map_err(|message| sources.error(material.span().start, message))?;
        }
        let (mut found, mut removed) = (false, false);
        for part in parts.iter_mut().filter(|p| p.answers_to(object.get_ref())) {
            if part.removed {
                removed = true;
                continue;
            }
            match edit {
                Edit::Assign(material) => {
                    part.material.clone_from(material.get_ref());
                    part.assigned = Some(object.span().start);
                }
                Edit::Move(motion) => {
                    part.motion = Some(part.motion.map_or(*motion, |before| before.then(motion)));
                }
                Edit::Remove => part.removed = true,
            }
            found = true;
        }
        if found {
            continue;
        }
        let message = if removed {
            format!("object \"{}\" was removed before; leave this out", object.get_ref())
        } else {
            let known: Vec<&str> = parts.iter().filter(|p| !p.removed).map(|p| p.name.as_str()).collect();
            suggest::unknown("object", object.get_ref(), &known)
        };
        return Err(sources.error(object.span().start, message));
    }
    Ok(())
}

/// The parts of a model: `NAME/object`, and where an object wears several materials
/// `NAME/object:material` for the others.
fn model_parts(
    description: &SceneDescription,
    object: usize,
    model: &Arc<Model>,
    parts: &mut Vec<Part>,
) -> Result<()> {
    let table = description.document.objects[object].get_ref();
    let materials = &description.document.materials;
    let mut taken = BTreeSet::new();
    for (i, part) in model.parts.iter().enumerate() {
        let (material, place) = match &part.material {
            Some(usemtl) => match table.materials.get(usemtl.as_str()) {
                Some(mapped) => (mapped.get_ref(), Err(mapped.span().start)),
                None if materials.contains_key(usemtl.as_str()) => (usemtl, Ok(part.place)),
                None => (table.material.as_ref().map_or(usemtl, Spanned::get_ref), Ok(part.place)),
            },
            None => match &table.material {
                Some(material) => (material.get_ref(), Err(material.span().start)),
                None => {
                    let message = "a face before any usemtl; give the object a `material` in the scene file";
                    return Err(model.error(part.place, message));
                }
            },
        };
        known_material(description, material).map_err(|message| match place {
            Ok(place) => {
                let remedy = "define it, or map it under `materials` of the object";
                model.error(place, format!("{message}; {remedy}"))
            }
            Err(offset) => description.sources.error(offset, message),
        })?;
        let base = table.name.get_ref();
        let mut name = part.object.as_ref().map_or(base.clone(), |o| format!("{base}/{o}"));
        if !taken.insert(name.clone()) {
            name = format!("{name}:{}", part.material.as_deref().unwrap_or(""));
            taken.insert(name.clone());
        }
        let material = material.clone();
        let model_part = Some(i as u32);
        parts.push(Part { name, material, object, model_part, motion: None, removed: false, assigned: None });
    }
    Ok(())
}

fn known_material(description: &SceneDescription, name: &str) -> std::result::Result<(), String> {
    let materials = &description.document.materials;
    if materials.contains_key(name) {
        return Ok(());
    }
    let known: Vec<&str> = materials.keys().map(|n| n.get_ref().as_str()).collect();
    Err(suggest::unknown("material", name, &known))
}

/// Where a face is written.
#[derive(Clone, Copy, Debug)]
pub enum FacePlace {
    /// In the scene file.
    Toml(usize),
    /// In the OBJ or glTF file of an object.
    Model(usize, Place),
}

impl FacePlace {
    /// The error `message` there.
    pub fn error(self, description: &SceneDescription, message: impl Into<String>) -> Error {
        match self {
            FacePlace::Toml(offset) => description.sources.error(offset, message),
            FacePlace::Model(object, place) => description.models[&object].error(place, message),
        }
    }
}

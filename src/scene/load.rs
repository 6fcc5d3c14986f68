//! Reading scene files, and changes on top of them.

use super::description::{Changes, Document, FORMAT_VERSION, LightChanges, MaterialTable, Name};
use super::obj::Mesh;
use super::source::Sources;
use super::suggest;
use super::{Appearance, Geometry, Scene};
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// Reads and compiles the scene file `path`.
pub fn load(path: &Path) -> Result<Scene> {
    SceneDescription::read(path)?.compile()
}

/// Reads the scene file `path`, compiles it, and gives it the appearance that it has after the
/// changes files, in their order. The geometry, and so the graph, is that of the scene file.
pub fn load_with_changes(path: &Path, changes: &[impl AsRef<Path>]) -> Result<Scene> {
    let mut description = SceneDescription::read(path)?;
    let mut scene = description.compile()?;
    for changes in changes {
        description = description.changed(changes.as_ref())?;
    }
    scene.appearance = description.appearance(&scene.geometry)?;
    Ok(scene)
}

/// A scene as its files write it. [`SceneDescription::compile`] makes a [`Scene`] of it;
/// [`SceneDescription::changed`] and [`SceneDescription::appearance`] give further appearances
/// to a scene that is compiled already.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    pub(super) sources: Sources,
    pub(super) document: Document,
    /// By index of the object that names the file.
    pub(super) meshes: BTreeMap<usize, Arc<Mesh>>,
    /// `[assign]` of all changes: the material of the last that names the object counts.
    pub(super) assigned: Vec<(Name, Name)>,
}

impl SceneDescription {
    /// Reads a scene file and the OBJ files it names.
    pub fn read(path: &Path) -> Result<SceneDescription> {
        let mut sources = Sources::default();
        let document: Document = sources.parse(path)?;
        check_format(&sources, &document.format)?;
        let mut meshes = BTreeMap::new();
        for (i, object) in document.objects.iter().enumerate() {
            if let Some(obj) = &object.get_ref().obj {
                let path = sources.directory(obj.span().start).join(obj.get_ref());
                let mesh = Mesh::read(&path).map_err(|e| match e {
                    // A file that cannot be had is the fault of the line that names it.
                    Error::Io { message, .. } => {
                        sources.error(obj.span().start, format!("cannot read {}: {message}", path.display()))
                    }
                    other => other,
                })?;
                meshes.insert(i, Arc::new(mesh));
            }
        }
        Ok(SceneDescription { sources, document, meshes, assigned: Vec::new() })
    }

    /// This description with the changes file `path` applied.
    pub fn changed(&self, path: &Path) -> Result<SceneDescription> {
        let mut description = self.clone();
        let changes: Changes = description.sources.parse(path)?;
        check_format(&description.sources, &changes.format)?;
        let known = description.document.materials.keys().map(|n| n.get_ref().clone()).collect::<Vec<_>>();
        for (name, table) in changes.materials {
            let used = || changes.assign.values().any(|m| m.get_ref() == name.get_ref());
            match description.document.materials.remove(name.get_ref().as_str()) {
                Some(base) => {
                    description.document.materials.insert(name, over(base, table));
                }
                None if used() => {
                    description.document.materials.insert(name, table);
                }
                None => {
                    let known: Vec<&str> = known.iter().map(String::as_str).collect();
                    let message = suggest::unknown("material", name.get_ref(), &known);
                    let message = format!("{message}; a new material is worn by some object under [assign]");
                    return Err(description.sources.error(name.span().start, message));
                }
            }
        }
        for (name, table) in changes.spectra {
            description.document.spectra.remove(name.get_ref().as_str());
            description.document.spectra.insert(name, table);
        }
        for (name, change) in changes.lights {
            description.change_light(&name, change)?;
        }
        description.assigned.extend(changes.assign);
        Ok(description)
    }

    /// Gives the light `name` what `change` says; the keys of one kind exclude each other.
    fn change_light(&mut self, name: &Name, change: LightChanges) -> Result<()> {
        let lights = &mut self.document.lights;
        let Some(at) = lights.iter().position(|l| l.get_ref().name.get_ref() == name.get_ref()) else {
            let known: Vec<&str> = lights.iter().map(|l| l.get_ref().name.get_ref().as_str()).collect();
            let message = suggest::unknown("light", name.get_ref(), &known);
            return Err(self.sources.error(name.span().start, message));
        };
        let mut light = lights[at].get_ref().clone();
        if change.illuminant.is_some() || change.spectrum.is_some() {
            (light.illuminant, light.spectrum) = (change.illuminant, change.spectrum);
        }
        if change.luminous_flux.is_some() || change.luminous_intensity.is_some() {
            light.luminous_flux = change.luminous_flux;
            light.luminous_intensity = change.luminous_intensity;
        }
        // What is wrong with it from here on is the fault of the change.
        lights[at] = Spanned::new(name.span(), light);
        Ok(())
    }

    /// The appearance that this description gives to `geometry`, which was compiled from it or
    /// from the description it is a change of.
    ///
    /// A change that needs sample points on a side that has none is refused.
    pub fn appearance(&self, geometry: &Geometry) -> Result<Appearance> {
        super::compile::appearance(self, geometry)
    }

    /// Validates everything and makes the scene.
    pub fn compile(&self) -> Result<Scene> {
        super::compile::scene(self)
    }
}

/// `base` with the keys of `change`. Saying what glass it is takes the opaque keys away, and the
/// other way round, because the two exclude each other.
fn over(base: MaterialTable, change: MaterialTable) -> MaterialTable {
    let to_glass = change.pane.is_some() || change.solid.is_some();
    let to_opaque = change.reflectance.is_some() || change.fresnel.is_some();
    let opaque = if to_glass { MaterialTable::default() } else { base.clone() };
    let glass = if to_glass || to_opaque { MaterialTable::default() } else { base.clone() };
    MaterialTable {
        reflectance: change.reflectance.or(opaque.reflectance),
        fresnel: change.fresnel.or(opaque.fresnel),
        specular: change.specular.or(opaque.specular),
        roughness: change.roughness.or(opaque.roughness),
        pane: change.pane.or(glass.pane),
        solid: change.solid.or(glass.solid),
        emission: change.emission.or(base.emission),
        two_sided: change.two_sided.or(base.two_sided),
    }
}

fn check_format(sources: &Sources, format: &Spanned<u32>) -> Result<()> {
    if *format.get_ref() == FORMAT_VERSION {
        return Ok(());
    }
    let message = format!("this program reads format = {FORMAT_VERSION}, the file says {}", format.get_ref());
    Err(sources.error(format.span().start, message))
}

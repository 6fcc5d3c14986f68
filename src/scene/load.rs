//! Reading scene files, and changes on top of them.

use super::description::{
    Changes, Document, FORMAT_VERSION, LightChanges, MaterialTable, MoveTable, Name, ObjectTable, SkyTable,
};
use super::ies::Luminaire;
use super::motion::Motion;
use super::obj::Mesh;
use super::parts::Edit;
use super::source::Sources;
use super::suggest;
use super::{Appearance, Geometry, Scene};
use crate::error::Result;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::Spanned;

/// Reads and compiles the scene file `path`.
pub fn load(path: &Path) -> Result<Scene> {
    SceneDescription::read(path)?.compile()
}

/// Reads the scene file `path`, compiles it, and changes it as the changes files say, in their order. Unless
/// one of them moves, adds or removes objects the geometry, and so the graph, is that of the scene file.
pub fn load_with_changes(path: &Path, changes: &[impl AsRef<Path>]) -> Result<Scene> {
    let mut description = SceneDescription::read(path)?;
    let scene = description.compile()?;
    for changes in changes {
        description = description.changed(changes.as_ref())?;
    }
    description.compile_over(&scene)
}

/// A scene as its files write it. [`SceneDescription::compile`] makes a [`Scene`] of it;
/// [`SceneDescription::changed`] and [`SceneDescription::compile_over`] make others of a scene that is compiled
/// already.
#[derive(Clone, Debug)]
pub struct SceneDescription {
    pub(super) sources: Sources,
    pub(super) document: Document,
    /// By index of the object that names the file.
    pub(super) meshes: BTreeMap<usize, Arc<Mesh>>,
    /// By index of the light that names the file.
    pub(super) luminaires: BTreeMap<usize, Luminaire>,
    /// What all changes do to objects, in their order.
    pub(super) edits: Vec<(Name, Edit)>,
    /// Whether changes moved, added or removed an object.
    pub(super) rearranged: bool,
}

impl SceneDescription {
    /// Reads a scene file and the OBJ and IES files it names.
    pub fn read(path: &Path) -> Result<SceneDescription> {
        let mut sources = Sources::default();
        let document: Document = sources.parse(path)?;
        check_format(&sources, &document.format)?;
        let (meshes, luminaires) = (BTreeMap::new(), BTreeMap::new());
        let mut description =
            SceneDescription { sources, document, meshes, luminaires, edits: Vec::new(), rearranged: false };
        description.read_meshes(0)?;
        description.read_luminaires()?;
        Ok(description)
    }

    /// Reads the IES files of the lights, each once.
    fn read_luminaires(&mut self) -> Result<()> {
        let mut known: BTreeMap<PathBuf, Luminaire> = BTreeMap::new();
        for (i, light) in self.document.lights.iter().enumerate() {
            let Some(ies) = &light.get_ref().ies else { continue };
            let path = self.sources.directory(ies.span().start).join(ies.get_ref());
            let luminaire = match known.get(&path) {
                Some(luminaire) => luminaire.clone(),
                None => Luminaire::read(&path).map_err(|e| self.sources.blame(ies, &path, e))?,
            };
            known.insert(path, luminaire.clone());
            self.luminaires.insert(i, luminaire);
        }
        Ok(())
    }

    /// Reads the OBJ files of the objects from index `first` on.
    fn read_meshes(&mut self, first: usize) -> Result<()> {
        let sources = &self.sources;
        for (i, object) in self.document.objects.iter().enumerate().skip(first) {
            if let Some(obj) = &object.get_ref().obj {
                let path = sources.directory(obj.span().start).join(obj.get_ref());
                let mesh = Mesh::read(&path).map_err(|e| sources.blame(obj, &path, e))?;
                self.meshes.insert(i, Arc::new(mesh));
            }
        }
        Ok(())
    }

    /// This description with the changes file `path` applied.
    pub fn changed(&self, path: &Path) -> Result<SceneDescription> {
        let mut description = self.clone();
        let changes: Changes = description.sources.parse(path)?;
        check_format(&description.sources, &changes.format)?;
        let known = description.document.materials.keys().map(|n| n.get_ref().clone()).collect::<Vec<_>>();
        let worn = changes.objects.iter().map(Spanned::get_ref);
        let worn = worn.flat_map(|o| o.material.iter().chain(o.materials.values()));
        let worn: Vec<&Name> = worn.chain(changes.assign.values()).collect();
        for (name, table) in changes.materials {
            let used = || worn.iter().any(|m| m.get_ref() == name.get_ref());
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
                    let message = format!(
                        "{message}; a new material is worn by some object under [assign] or [[objects]]"
                    );
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
        if let Some(change) = changes.sky {
            description.change_sky(change)?;
        }
        description.rearrange(changes.remove, &changes.moves, changes.objects)?;
        let assigned = changes.assign.into_iter().map(|(object, material)| (object, Edit::Assign(material)));
        description.edits.extend(assigned);
        Ok(description)
    }

    /// Takes some objects away, moves others, and adds `objects`.
    fn rearrange(
        &mut self,
        remove: Vec<Name>,
        moves: &[MoveTable],
        objects: Vec<Spanned<ObjectTable>>,
    ) -> Result<()> {
        self.rearranged |= !remove.is_empty() || !moves.is_empty() || !objects.is_empty();
        self.edits.extend(remove.into_iter().map(|object| (object, Edit::Remove)));
        for table in moves {
            let motion = Motion::of(&self.sources, table)?;
            let names = table.objects.get_ref();
            self.edits.extend(names.iter().map(|object| (object.clone(), Edit::Move(motion))));
        }
        let first = self.document.objects.len();
        self.document.objects.extend(objects);
        self.read_meshes(first)
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
        let amounts = [&change.luminous_flux, &change.luminous_intensity, &change.illuminance, &change.scale];
        if amounts.iter().any(|amount| amount.is_some()) {
            light.luminous_flux = change.luminous_flux;
            light.luminous_intensity = change.luminous_intensity;
            light.illuminance = change.illuminance;
            light.scale = change.scale;
        }
        // What is wrong with it from here on is the fault of the change.
        lights[at] = Spanned::new(name.span(), light);
        Ok(())
    }

    /// Gives the sky what `change` says.
    fn change_sky(&mut self, change: Spanned<SkyTable>) -> Result<()> {
        let place = change.span();
        let Some(sky) = self.document.sky.take() else {
            let message = "the scene file has no [sky] that could change; give it one, which may be dark";
            return Err(self.sources.error(place.start, message));
        };
        // What is wrong with it from here on is the fault of the change.
        self.document.sky = Some(Spanned::new(place, sky.into_inner().changed(change.into_inner())));
        Ok(())
    }

    /// The appearance that this description gives to `geometry`, which was compiled from it or
    /// from the description it is a change of.
    ///
    /// A change that needs sample points on a side that has none is refused.
    pub fn appearance(&self, geometry: &Geometry) -> Result<Appearance> {
        super::compile::appearance(self, geometry)
    }

    /// Whether changes moved, added or removed objects, so that the geometry is another.
    pub fn is_rearranged(&self) -> bool {
        self.rearranged
    }

    /// Validates everything and makes the scene.
    pub fn compile(&self) -> Result<Scene> {
        super::compile::scene(self)
    }

    /// Makes the scene of this description, which is a change of the one that `scene` was compiled from. Where nothing is
    /// moved, added or removed it has the geometry of `scene`. What stays is sampled as it was.
    pub fn compile_over(&self, scene: &Scene) -> Result<Scene> {
        if !self.rearranged {
            return Ok(Scene { appearance: self.appearance(&scene.geometry)?, ..scene.clone() });
        }
        Ok(Scene { sampling: scene.sampling, ..self.compile()? })
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

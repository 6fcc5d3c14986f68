//! Reading scene files, and changes on top of them.

use super::description::{
    Changes, Document, FORMAT_VERSION, LightChanges, MaterialTable, MoveTable, Name, ObjectTable, SkyTable,
    SpectrumRef,
};
use super::ies::Luminaire;
use super::import::{self, Kind, Model};
use super::motion::Motion;
use super::parts::Edit;
use super::source::{Source, Sources};
use super::suggest;
use super::{Appearance, Geometry, Scene};
use crate::error::Result;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::Spanned;

/// Illuminance by the sky around a model without any light, lx, and the reflectance of the ground beneath.
const DARK_MODEL_LUX: f64 = 10_000.0;
const DARK_MODEL_GROUND: f64 = 0.3;

/// Reads and compiles the scene file `path`, or the OBJ or glTF file.
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
    pub(super) models: BTreeMap<usize, Arc<Model>>,
    /// By index of the light that names the file.
    pub(super) luminaires: BTreeMap<usize, Luminaire>,
    /// The materials that come from models, and the files that define them.
    imported: BTreeMap<String, PathBuf>,
    /// What all changes do to objects, in their order.
    pub(super) edits: Vec<(Name, Edit)>,
    /// Whether changes moved, added or removed an object.
    pub(super) rearranged: bool,
}

impl SceneDescription {
    /// Reads a scene file and the OBJ, glTF and IES files it names, or an OBJ or glTF file by itself.
    pub fn read(path: &Path) -> Result<SceneDescription> {
        if let Some(kind) = Kind::of(path) {
            return SceneDescription::of_model(kind, path);
        }
        let mut sources = Sources::default();
        let document: Document = sources.parse(path)?;
        check_format(&sources, &document.format)?;
        let mut description = SceneDescription::new(sources, document);
        description.read_models(0)?;
        description.read_luminaires()?;
        Ok(description)
    }

    fn new(sources: Sources, document: Document) -> SceneDescription {
        let (models, luminaires, imported) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        SceneDescription {
            sources,
            document,
            models,
            luminaires,
            imported,
            edits: Vec::new(),
            rearranged: false,
        }
    }

    /// A scene of one object: the model in the file `path`.
    fn of_model(kind: Kind, path: &Path) -> Result<SceneDescription> {
        let mut sources = Sources::default();
        // Nothing is written for the one entry that the scene has, so all its places are the beginning.
        sources.add(Source { path: path.to_path_buf(), text: String::new() });
        let entry = format!("format = {FORMAT_VERSION}\n[[objects]]\nname = \"model\"");
        let document: Document = toml::from_str(&entry).map_err(|e| sources.error(0, e.message()))?;
        let mut description = SceneDescription::new(sources, document);
        if let (Some(object), Some(stem)) =
            (description.document.objects.first_mut(), path.file_stem().and_then(|s| s.to_str()))
        {
            object.get_mut().name = Spanned::new(0..0, stem.to_owned());
        }
        description.read_model(0, kind, path, true)?;
        description.light_if_dark();
        Ok(description)
    }

    /// Puts a model without any light under a sky, for all of it would be black.
    fn light_if_dark(&mut self) {
        let document = &mut self.document;
        if !document.lights.is_empty() || document.materials.values().any(|m| m.emission.is_some()) {
            return;
        }
        fn at<T>(value: T) -> Spanned<T> {
            Spanned::new(0..0, value)
        }
        let sky = SkyTable {
            kind: Some(at(SpectrumRef::Named("overcast".into()))),
            sun: None,
            up: Some(at([0.0, 1.0, 0.0])),
            illuminant: Some(at("D65".into())),
            spectrum: None,
            zenith_luminance: None,
            illuminance: Some(at(DARK_MODEL_LUX)),
            ground: Some(at(SpectrumRef::Constant(DARK_MODEL_GROUND))),
        };
        document.sky = Some(at(sky));
        for model in self.models.values_mut() {
            Arc::make_mut(model).note(format_args!(
                "there is no light: an overcast sky of {DARK_MODEL_LUX} lx and a ground that reflects \
                 {DARK_MODEL_GROUND} of it stand around"
            ));
        }
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

    /// Reads the models of the objects from index `first` on.
    fn read_models(&mut self, first: usize) -> Result<()> {
        for i in first..self.document.objects.len() {
            let object = self.document.objects[i].get_ref();
            let (kind, name) = match (&object.obj, &object.gltf) {
                (Some(obj), _) => (Kind::Obj, obj.clone()),
                (None, Some(gltf)) => (Kind::Gltf, gltf.clone()),
                (None, None) => continue,
            };
            let path = self.sources.directory(name.span().start).join(name.get_ref());
            self.read_model(i, kind, &path, false).map_err(|e| self.sources.blame(&name, &path, e))?;
        }
        Ok(())
    }

    /// Reads the model of object `i`. Its materials, lights and cameras become those of the scene; a material of the
    /// scene file comes before one of the model with its name. `alone`: there is no scene file that would say what the
    /// model does not.
    fn read_model(&mut self, i: usize, kind: Kind, path: &Path, alone: bool) -> Result<()> {
        let mut model = import::read(kind, path, &mut self.sources)?;
        let object = self.document.objects[i].get_ref();
        let materials = &mut self.document.materials;
        for import::Material { name, table, file } in std::mem::take(&mut model.materials) {
            let mut known_as = name.clone();
            match self.imported.get(&name) {
                Some(defined) if *defined == file => continue,
                // Another file has a material of this name.
                Some(_) if !object.materials.contains_key(name.as_str()) => {
                    known_as = format!("{}:{name}", object.name.get_ref());
                    let worn = model.parts.iter_mut().filter(|p| p.material.as_deref() == Some(&name));
                    worn.for_each(|part| part.material = Some(known_as.clone()));
                }
                _ => {}
            }
            if !materials.contains_key(known_as.as_str()) {
                materials.insert(Spanned::new(0..0, known_as.clone()), table);
                self.imported.insert(known_as, file);
            }
        }
        let mut plain: Vec<String> = Vec::new();
        let has_default = object.material.is_some();
        for part in model.parts.iter_mut().filter(|_| (alone || model.with_defaults) && !has_default) {
            let worn = part.material.get_or_insert_with(|| "default".to_owned());
            if !materials.contains_key(worn.as_str()) && !object.materials.contains_key(worn.as_str()) {
                materials.insert(Spanned::new(0..0, worn.clone()), import::plain(0));
                plain.push(worn.clone());
            }
        }
        if !plain.is_empty() {
            let names = import::names(&plain);
            model.note(format_args!("materials that are nowhere defined are grey, reflectance 0.5: {names}"));
        }
        let scale = object.scale.as_ref().map_or(1.0, |s| *s.get_ref());
        let translate = object.translate.as_ref().map_or([0.0; 3], |t| *t.get_ref());
        let placed = |at: &mut Spanned<[f64; 3]>| {
            let p = *at.get_ref();
            *at.get_mut() = [0, 1, 2].map(|axis| scale * p[axis] + translate[axis]);
        };
        let prefix = if alone { String::new() } else { format!("{}/", object.name.get_ref()) };
        let renamed = |name: &mut Name| *name.get_mut() = format!("{prefix}{}", name.get_ref());
        for mut light in std::mem::take(&mut model.lights) {
            light.position.iter_mut().for_each(placed);
            renamed(&mut light.name);
            self.document.lights.push(Spanned::new(0..0, light));
        }
        for mut camera in std::mem::take(&mut model.cameras) {
            placed(&mut camera.position);
            placed(&mut camera.target);
            renamed(&mut camera.name);
            self.document.cameras.push(Spanned::new(0..0, camera));
        }
        self.models.insert(i, Arc::new(model));
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
        self.read_models(first)
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

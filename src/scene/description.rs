//! The scene file as written: every value with its place, nothing checked but its type.
//! `scenes/FORMAT.md` documents the keys.

use crate::colour::decode_srgb;
use serde::Deserialize;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use std::collections::BTreeMap;
use std::fmt;
use toml::Spanned;

/// Version of the format that this program reads.
pub const FORMAT_VERSION: u32 = 1;

/// A name with its place.
pub type Name = Spanned<String>;

/// A scene file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Document {
    pub format: Spanned<u32>,
    #[serde(default)]
    pub sampling: SamplingTable,
    #[serde(default)]
    pub spectra: BTreeMap<Name, SpectrumTable>,
    #[serde(default)]
    pub materials: BTreeMap<Name, MaterialTable>,
    #[serde(default)]
    pub objects: Vec<Spanned<ObjectTable>>,
    #[serde(default)]
    pub lights: Vec<Spanned<LightTable>>,
    pub sky: Option<Spanned<SkyTable>>,
    #[serde(default)]
    pub sensors: Vec<Spanned<SensorTable>>,
    #[serde(default)]
    pub grids: Vec<Spanned<GridTable>>,
    #[serde(default)]
    pub cameras: Vec<Spanned<CameraTable>>,
}

/// A changes file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Changes {
    pub format: Spanned<u32>,
    #[serde(default)]
    pub spectra: BTreeMap<Name, SpectrumTable>,
    #[serde(default)]
    pub materials: BTreeMap<Name, MaterialTable>,
    #[serde(default)]
    pub lights: BTreeMap<Name, LightChanges>,
    pub sky: Option<Spanned<SkyTable>>,
    #[serde(default)]
    pub assign: BTreeMap<Name, Name>,
    #[serde(default)]
    pub remove: Vec<Name>,
    #[serde(default)]
    pub moves: Vec<MoveTable>,
    #[serde(default)]
    pub objects: Vec<Spanned<ObjectTable>>,
}

/// `[sampling]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplingTable {
    pub max_area: Option<Spanned<f64>>,
    pub max_solid_angle: Option<Spanned<f64>>,
    pub refine_solid_angle: Option<Spanned<f64>>,
    pub max_level: Option<Spanned<u8>>,
}

/// `[spectra.NAME]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpectrumTable {
    pub file: Option<Name>,
    pub column: Option<Name>,
    pub wavelengths_nm: Option<Spanned<Vec<f64>>>,
    pub values: Option<Spanned<Vec<f64>>>,
    pub constant: Option<Spanned<f64>>,
    pub scale: Option<Spanned<f64>>,
}

/// `[materials.NAME]`, in a scene or in changes.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialTable {
    pub reflectance: Option<Spanned<SpectrumRef>>,
    pub fresnel: Option<Spanned<FresnelRef>>,
    pub specular: Option<Spanned<f64>>,
    pub roughness: Option<Spanned<f64>>,
    pub pane: Option<Spanned<PaneTable>>,
    pub solid: Option<Spanned<SolidTable>>,
    pub emission: Option<Spanned<EmissionTable>>,
    pub two_sided: Option<Spanned<bool>>,
}

impl MaterialTable {
    /// Whether its surfaces need sample points on both sides.
    pub fn needs_both_sides(&self) -> bool {
        self.pane.is_some() || self.solid.is_some() || self.two_sided.as_ref().is_some_and(|t| *t.get_ref())
    }
}

/// A spectrum where one is used: by name, a constant, or a colour in linear sRGB.
#[derive(Clone, Debug)]
pub enum SpectrumRef {
    Constant(f64),
    Named(String),
    Rgb([f64; 3]),
}

/// `{ rgb = ... }` or `{ srgb = ... }` where a spectrum is used.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ColourTable {
    rgb: Option<[f64; 3]>,
    srgb: Option<[f64; 3]>,
}

/// The Fresnel factor: a built-in index by name, or a table.
#[derive(Clone, Debug)]
pub enum FresnelRef {
    Named(String),
    Table(Box<FresnelTable>),
}

/// `fresnel = { ... }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FresnelTable {
    pub index: Option<Name>,
    pub normal: Option<Spanned<SpectrumRef>>,
    pub n: Option<Spanned<SpectrumRef>>,
    pub k: Option<Spanned<SpectrumRef>>,
}

/// `pane = { ... }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaneTable {
    pub index: Spanned<SpectrumRef>,
    pub thickness_m: Option<Spanned<f64>>,
    pub transmittance: Option<Spanned<SpectrumRef>>,
}

/// `solid = { ... }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolidTable {
    pub index: Spanned<SpectrumRef>,
    pub absorption_per_m: Option<Spanned<SpectrumRef>>,
    pub transmittance: Option<Spanned<SpectrumRef>>,
    pub over_m: Option<Spanned<f64>>,
}

/// `emission = { ... }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EmissionTable {
    pub illuminant: Option<Name>,
    pub spectrum: Option<Spanned<SpectrumRef>>,
    pub radiance: Option<Spanned<f64>>,
    pub luminance: Option<Spanned<f64>>,
    pub luminous_flux: Option<Spanned<f64>>,
    pub luminous_intensity: Option<Spanned<f64>>,
}

/// `[[objects]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectTable {
    pub name: Name,
    pub material: Option<Name>,
    pub max_area: Option<Spanned<f64>>,
    #[serde(default)]
    pub quads: Vec<Spanned<[[f64; 3]; 4]>>,
    #[serde(default)]
    pub triangles: Vec<Spanned<[[f64; 3]; 3]>>,
    #[serde(default)]
    pub discs: Vec<Spanned<DiscTable>>,
    #[serde(default)]
    pub spheres: Vec<Spanned<SphereTable>>,
    #[serde(default)]
    pub cylinders: Vec<Spanned<CylinderTable>>,
    #[serde(default)]
    pub cones: Vec<Spanned<ConeTable>>,
    #[serde(default)]
    pub patches: Vec<Spanned<[[[f64; 3]; 4]; 4]>>,
    pub obj: Option<Name>,
    pub gltf: Option<Name>,
    pub scale: Option<Spanned<f64>>,
    pub translate: Option<Spanned<[f64; 3]>>,
    #[serde(default)]
    pub materials: BTreeMap<Name, Name>,
    #[serde(default)]
    pub leave_out: Vec<Name>,
}

/// `discs = [{ ... }]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiscTable {
    pub centre: Spanned<[f64; 3]>,
    pub normal: Spanned<[f64; 3]>,
    pub radius: Spanned<f64>,
}

/// `spheres = [{ ... }]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereTable {
    pub centre: Spanned<[f64; 3]>,
    pub radius: Spanned<f64>,
    #[serde(default)]
    pub inward: bool,
}

/// `cylinders = [{ ... }]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CylinderTable {
    pub base: Spanned<[f64; 3]>,
    pub top: Spanned<[f64; 3]>,
    pub radius: Spanned<f64>,
    #[serde(default)]
    pub inward: bool,
}

/// `cones = [{ ... }]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConeTable {
    pub base: Spanned<[f64; 3]>,
    pub top: Spanned<[f64; 3]>,
    pub radius: Spanned<f64>,
    pub top_radius: Option<Spanned<f64>>,
    #[serde(default)]
    pub inward: bool,
}

/// `[[lights]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightTable {
    pub name: Name,
    pub position: Option<Spanned<[f64; 3]>>,
    pub distribution: Option<Name>,
    pub direction: Option<Spanned<[f64; 3]>>,
    pub inner_cone_deg: Option<Spanned<f64>>,
    pub outer_cone_deg: Option<Spanned<f64>>,
    pub diameter_deg: Option<Spanned<f64>>,
    pub ies: Option<Name>,
    pub c0: Option<Spanned<[f64; 3]>>,
    pub up: Option<Spanned<[f64; 3]>>,
    pub spread: Option<Spanned<[u32; 2]>>,
    pub illuminant: Option<Name>,
    pub spectrum: Option<Spanned<SpectrumRef>>,
    pub luminous_flux: Option<Spanned<f64>>,
    pub luminous_intensity: Option<Spanned<f64>>,
    pub illuminance: Option<Spanned<f64>>,
    pub scale: Option<Spanned<f64>>,
}

/// `[lights.NAME]` in changes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightChanges {
    pub illuminant: Option<Name>,
    pub spectrum: Option<Spanned<SpectrumRef>>,
    pub luminous_flux: Option<Spanned<f64>>,
    pub luminous_intensity: Option<Spanned<f64>>,
    pub illuminance: Option<Spanned<f64>>,
    pub scale: Option<Spanned<f64>>,
}

/// `[sky]`, in a scene or in changes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkyTable {
    #[serde(rename = "type")]
    pub kind: Option<Spanned<SpectrumRef>>,
    pub sun: Option<Spanned<[f64; 3]>>,
    pub up: Option<Spanned<[f64; 3]>>,
    pub illuminant: Option<Name>,
    pub spectrum: Option<Spanned<SpectrumRef>>,
    pub zenith_luminance: Option<Spanned<f64>>,
    pub illuminance: Option<Spanned<f64>>,
    pub ground: Option<Spanned<SpectrumRef>>,
}

impl SkyTable {
    /// This table with the keys of `change`, each as a whole; a spectrum and an amount replace the other ways to give them.
    pub fn changed(self, change: SkyTable) -> SkyTable {
        let spectrum = change.illuminant.is_some() || change.spectrum.is_some();
        let amount = change.zenith_luminance.is_some() || change.illuminance.is_some();
        SkyTable {
            kind: change.kind.or(self.kind),
            sun: change.sun.or(self.sun),
            up: change.up.or(self.up),
            illuminant: if spectrum { change.illuminant } else { self.illuminant },
            spectrum: if spectrum { change.spectrum } else { self.spectrum },
            zenith_luminance: if amount { change.zenith_luminance } else { self.zenith_luminance },
            illuminance: if amount { change.illuminance } else { self.illuminance },
            ground: change.ground.or(self.ground),
        }
    }
}

/// `[[moves]]` in changes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveTable {
    pub objects: Spanned<Vec<Name>>,
    pub rotate: Option<RotateTable>,
    pub translate: Option<Spanned<[f64; 3]>>,
}

/// `rotate = { ... }` in changes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotateTable {
    pub degrees: Spanned<f64>,
    pub about: Spanned<[f64; 3]>,
    pub axis: Option<Spanned<[f64; 3]>>,
}

/// `[[sensors]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorTable {
    pub name: Name,
    pub position: Spanned<[f64; 3]>,
    pub normal: Spanned<[f64; 3]>,
}

/// `[[grids]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridTable {
    pub name: Name,
    pub origin: Spanned<[f64; 3]>,
    pub u: Spanned<[f64; 3]>,
    pub v: Spanned<[f64; 3]>,
    pub counts: Spanned<[u32; 2]>,
    pub normal: Option<Spanned<[f64; 3]>>,
    pub offset: Option<Spanned<f64>>,
}

/// `[[cameras]]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraTable {
    pub name: Name,
    pub position: Spanned<[f64; 3]>,
    pub target: Spanned<[f64; 3]>,
    pub up: Option<Spanned<[f64; 3]>>,
    pub fov_deg: Option<Spanned<f64>>,
    pub resolution: Option<Spanned<[u32; 2]>>,
}

impl<'de> Deserialize<'de> for SpectrumRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOfThem;
        impl<'de> Visitor<'de> for OneOfThem {
            type Value = SpectrumRef;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("the name of a spectrum or a number, or a colour { rgb = [r, g, b] }")
            }
            fn visit_f64<E: de::Error>(self, value: f64) -> Result<SpectrumRef, E> {
                Ok(SpectrumRef::Constant(value))
            }
            fn visit_i64<E: de::Error>(self, value: i64) -> Result<SpectrumRef, E> {
                Ok(SpectrumRef::Constant(value as f64))
            }
            fn visit_str<E: de::Error>(self, value: &str) -> Result<SpectrumRef, E> {
                Ok(SpectrumRef::Named(value.to_owned()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SpectrumRef, A::Error> {
                match ColourTable::deserialize(de::value::MapAccessDeserializer::new(map))? {
                    ColourTable { rgb: Some(rgb), srgb: None } => Ok(SpectrumRef::Rgb(rgb)),
                    ColourTable { rgb: None, srgb: Some(srgb) } => {
                        Ok(SpectrumRef::Rgb(srgb.map(decode_srgb)))
                    }
                    _ => Err(de::Error::custom(
                        "a colour is { rgb = [r, g, b] }, linear, or { srgb = [r, g, b] }, encoded",
                    )),
                }
            }
        }
        deserializer.deserialize_any(OneOfThem)
    }
}

impl<'de> Deserialize<'de> for FresnelRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrTable;
        impl<'de> Visitor<'de> for NameOrTable {
            type Value = FresnelRef;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("the name of a refractive index, or a table { index | normal, n, k }")
            }
            fn visit_str<E: de::Error>(self, value: &str) -> Result<FresnelRef, E> {
                Ok(FresnelRef::Named(value.to_owned()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<FresnelRef, A::Error> {
                let table = FresnelTable::deserialize(de::value::MapAccessDeserializer::new(map))?;
                Ok(FresnelRef::Table(Box::new(table)))
            }
        }
        deserializer.deserialize_any(NameOrTable)
    }
}

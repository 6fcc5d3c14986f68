//! From a description to a scene: all validation happens here.

use super::description::{CameraTable, MaterialTable, Name, SamplingTable};
use super::framing;
use super::lights;
use super::materials::Materials;
use super::parts::{Part, parts};
use super::places::{self, unique, vector};
use super::skies;
use super::source::Sources;
use super::spectra::Spectra;
use super::surfaces::{Shaped, shape};
use super::touching;
use super::{Appearance, Camera, Geometry, Light, LightKind, MaterialId, Scene, SceneDescription};
use crate::error::Result;
use crate::geometry::SurfaceId;
use crate::points::{Cell, Sampling};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use toml::Spanned;

/// Coordinates beyond this are refused, m: ray tracers compute with squares of them in `f32`.
pub const MAX_COORDINATE: f64 = 1e18;

/// A scene with a smaller radius than this is refused, m: squares of distances between neighbouring sample
/// points would leave the normal range of `f32`.
pub const MIN_RADIUS: f64 = 1e-12;

/// A sampling that would make more points than this is refused: their graph fits no machine.
const MAX_POINTS: f64 = 4e6;

/// Largest width or height of an image, pixels.
const MAX_SIDE: u32 = 65536;
/// Largest image, pixels.
const MAX_PIXELS: u64 = 1 << 26;

/// Makes the scene of `description`.
pub fn scene(description: &SceneDescription) -> Result<Scene> {
    let document = &description.document;
    let parts = parts(description)?;
    let both_sides = |part: &Part| {
        document.materials.get(part.material.as_str()).is_some_and(MaterialTable::needs_both_sides)
    };
    let Shaped { mut geometry, mut notes } = shape(description, &parts, both_sides)?;
    for (object, pane) in geometry.object.iter().zip(&mut geometry.pane) {
        *pane = pane_of(&document.materials, &parts[object.0 as usize]).is_some();
    }
    let sampling = sampling(&description.sources, &document.sampling, &geometry)?;
    geometry.lights = lights::lights(description, geometry.centre, geometry.radius)?;
    geometry.zenith = skies::zenith(description)?;
    let (sensors, grids) = places::sensors(description)?;
    let appearance = appearance(description, &geometry)?;
    let cameras = cameras(description, &geometry, &appearance, &mut notes)?;
    notes.extend(description.models.values().flat_map(|m| m.notes.iter().cloned()));
    notes.extend(touching::notes(&geometry, &appearance));
    Ok(Scene { geometry, appearance, sampling, cameras, sensors, grids, notes })
}

/// The appearance that `description` gives to `geometry`.
pub fn appearance(description: &SceneDescription, geometry: &Geometry) -> Result<Appearance> {
    let document = &description.document;
    let sources = &description.sources;
    let compiler = Materials { sources, spectra: Spectra::new(sources, &document.spectra)? };
    let mut materials = Vec::with_capacity(document.materials.len());
    let mut ids = BTreeMap::new();
    for (name, table) in &document.materials {
        ids.insert(name.get_ref().as_str(), MaterialId(materials.len() as u32));
        materials.push(compiler.compile(name, table)?);
    }
    let parts = parts(description)?;
    let mut surface_material = Vec::with_capacity(geometry.surfaces.len());
    let directional = |light: &Light| matches!(light.kind, LightKind::Directional { .. });
    let looked_through = geometry.zenith.is_some() || geometry.lights.iter().any(directional);
    for (object, (two_sided, pane)) in
        geometry.object.iter().zip(geometry.two_sided.iter().zip(&geometry.pane))
    {
        let Some(part) = parts.get(object.0 as usize) else {
            let message = "this geometry was not compiled from this scene file";
            return Err(sources.error(0, message));
        };
        if !two_sided && let Some(place) = side_missing(&document.materials, part) {
            let message = format!(
                "material \"{}\" needs light on both sides of object \"{}\", whose sample points are on the \
                 front alone; give the material that it wears in the scene file `two_sided = true` and \
                 build the graph again",
                part.material, part.name
            );
            return Err(part.error(description, place, message));
        }
        if !pane
            && looked_through
            && let Some(place) = pane_of(&document.materials, part)
        {
            let message = format!(
                "object \"{}\" was no pane when it was found out where sun and sky come through panes; let it wear a pane in the \
                 scene file, and the other material in a changes file",
                part.name
            );
            return Err(part.error(description, place, message));
        }
        // `parts` has checked that the material exists.
        surface_material.push(ids[part.material.as_str()]);
    }
    let lights = lights::sources(description, &compiler.spectra, geometry)?;
    let sky = skies::sky(description, &compiler.spectra, geometry.zenith)?;
    Ok(Appearance { materials, surface_material, lights, sky })
}

/// Where `part` is given a pane, if it wears one.
fn pane_of(materials: &BTreeMap<Name, MaterialTable>, part: &Part) -> Option<usize> {
    Some(materials.get(part.material.as_str())?.pane.as_ref()?.span().start)
}

/// The key that asks for both sides, if `part` wears a material that does.
fn side_missing(materials: &BTreeMap<Name, MaterialTable>, part: &Part) -> Option<usize> {
    let table = materials.get(part.material.as_str())?;
    let asks = table.needs_both_sides();
    let keys = [
        table.pane.as_ref().map(Spanned::span),
        table.solid.as_ref().map(Spanned::span),
        table.two_sided.as_ref().map(Spanned::span),
    ];
    keys.into_iter().flatten().next().filter(|_| asks).map(|span| span.start)
}

fn sampling(sources: &Sources, table: &SamplingTable, geometry: &Geometry) -> Result<Sampling> {
    let positive = |at: &Option<Spanned<f64>>, what: &str| match at {
        Some(x) if !(x.get_ref().is_finite() && *x.get_ref() > 0.0) => {
            Err(sources.error(x.span().start, format!("{what} is a positive number")))
        }
        _ => Ok(at.as_ref().map(|x| *x.get_ref())),
    };
    // 1,500 to 6,000 elements when nothing is said.
    let total: f64 = geometry.surfaces.iter().map(|s| s.area).sum();
    let max_area =
        positive(&table.max_area, "the largest area of an element, m2,")?.unwrap_or(total / 1500.0);
    let max_level = table.max_level.as_ref().map_or(12, |l| *l.get_ref());
    if max_level > Cell::MAX_LEVEL {
        let at = table.max_level.as_ref().map_or(0, |l| l.span().start);
        return Err(sources.error(at, format!("max_level is at most {}", Cell::MAX_LEVEL)));
    }
    let sampling = Sampling {
        area_factor: 1.0,
        max_area,
        max_solid_angle: positive(&table.max_solid_angle, "a solid angle, sr,")?,
        refine_solid_angle: positive(&table.refine_solid_angle, "a solid angle, sr,")?,
        max_level,
    };
    let points: f64 = (0..geometry.surfaces.len())
        .map(|i| {
            let id = SurfaceId(i as u32);
            let ratio = geometry.surface(id).area / geometry.max_area_of(id, &sampling);
            let level = (ratio.log2() / 2.0).ceil().clamp(0.0, f64::from(max_level));
            4f64.powf(level) * if geometry.two_sided[i] { 2.0 } else { 1.0 }
        })
        .sum();
    if points > MAX_POINTS {
        let at = table.max_area.as_ref().map_or(0, |a| a.span().start);
        let message =
            format!("this sampling makes {points:.0} points, more than {MAX_POINTS}; raise max_area");
        return Err(sources.error(at, message));
    }
    Ok(sampling)
}

/// The cameras of the scene; one that frames it if it has none.
fn cameras(
    description: &SceneDescription,
    geometry: &Geometry,
    appearance: &Appearance,
    notes: &mut Vec<String>,
) -> Result<Vec<Camera>> {
    let sources = &description.sources;
    let cameras = &description.document.cameras;
    if cameras.is_empty() {
        // Models are drawn with y upwards; what is written in a scene file with z.
        let models_alone = description.models.len() == description.document.objects.len();
        let camera = framing::camera(geometry, appearance, if models_alone { DVec3::Y } else { DVec3::Z });
        let [p, t] =
            [camera.position, camera.target].map(|v| format!("[{:.3}, {:.3}, {:.3}]", v.x, v.y, v.z));
        notes.push(format!("there is no camera: one frames the scene, position = {p}, target = {t}"));
        return Ok(vec![camera]);
    }
    let mut names = BTreeSet::new();
    for camera in cameras {
        unique(sources, &mut names, &camera.get_ref().name, "cameras")?;
    }
    cameras.iter().map(|c| camera(sources, c.get_ref())).collect()
}

fn camera(sources: &Sources, table: &CameraTable) -> Result<Camera> {
    let vector = |at: &Spanned<[f64; 3]>| vector(sources, at, "a camera");
    let (position, target) = (vector(&table.position)?, vector(&table.target)?);
    let (up, up_at) = match &table.up {
        Some(up) => (vector(up)?, up.span().start),
        None => (DVec3::Z, table.target.span().start),
    };
    let Some(forward) = (target - position).try_normalize() else {
        return Err(sources.error(table.target.span().start, "a camera looks at another place than its own"));
    };
    match up.try_normalize() {
        Some(up) if forward.cross(up).length() > 1e-6 => {}
        _ => {
            let message = "a camera's `up` ([0, 0, 1] if not given) is not along its view; give another";
            return Err(sources.error(up_at, message));
        }
    }
    let fov_deg = table.fov_deg.as_ref().map_or(45.0, |f| *f.get_ref());
    if !(fov_deg > 0.0 && fov_deg < 180.0) {
        let at = table.fov_deg.as_ref().map_or(0, |f| f.span().start);
        return Err(sources.error(at, "fov_deg, the vertical angle of view, lies between 0 and 180"));
    }
    let resolution = table.resolution.as_ref().map_or([640, 480], |r| *r.get_ref());
    let [w, h] = resolution;
    if !(1..=MAX_SIDE).contains(&w)
        || !(1..=MAX_SIDE).contains(&h)
        || u64::from(w) * u64::from(h) > MAX_PIXELS
    {
        let at = table.resolution.as_ref().map_or(0, |r| r.span().start);
        let message = format!(
            "resolution is [width, height], each 1 to {MAX_SIDE}, at most {MAX_PIXELS} pixels together; \
             this is {w} x {h}"
        );
        return Err(sources.error(at, message));
    }
    Ok(Camera { name: table.name.get_ref().clone(), position, target, up, fov_deg, resolution })
}

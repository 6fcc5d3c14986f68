//! Gives a model its materials. What glass is, a body or a sheet, and whether a back can be lit, is decided by what
//! the faces enclose.

use super::look::{Look, Rgb};
use super::mesh::{Face, Material, Model};
use super::note;
use super::shell::{Shell, shell};
use glam::DVec3;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::PathBuf;

/// A material before it is known what its faces make.
pub struct Described {
    /// Its name.
    pub name: String,
    /// What it looks like.
    pub look: Look,
    /// Where it is written, a position in the sources.
    pub place: usize,
    /// The file that defines it.
    pub file: PathBuf,
}

/// At most so many places of light are looked for inside glass.
const MOST_LIGHTS: usize = 64;

/// Makes the materials of `model`, turns faces of glass that look inwards, and says what was decided.
pub fn dress(model: &mut Model, described: Vec<Described>) {
    let lights = lights(model, &described);
    let worn = worn(model);
    let mut decided: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for Described { name, mut look, place, file } in described {
        let mut made = Shell::Sheet;
        if look.is_glass() {
            let worn = worn.get(&name).map_or(&[][..], |of| of);
            let faces: Vec<&Face> = worn.iter().map(|&f| &model.faces[f]).collect();
            made = shell(&faces, &model.vertices, &lights);
            let what = match made {
                _ if faces.is_empty() => None,
                Shell::Solid { .. } => Some("glass that encloses a volume is a `solid`"),
                Shell::InsideOut { .. } => {
                    worn.iter().for_each(|&f| turn(&mut model.faces[f]));
                    Some(
                        "glass that encloses a volume is a `solid`; its faces looked inwards and were turned",
                    )
                }
                Shell::Bulb => Some("glass around a light is a thin bulb, a `pane`"),
                Shell::Sheet => Some("glass that encloses nothing is a thin sheet, a `pane`"),
            };
            if let Some(what) = what {
                decided.entry(what).or_default().push(name.clone());
            }
        }
        if look.two_sided {
            let worn = worn.get(&name).map_or(&[][..], |of| of);
            let faces: Vec<&Face> = worn.iter().map(|&f| &model.faces[f]).collect();
            // No light ever reaches the inside of a closed body that has none in it.
            if matches!(shell(&faces, &model.vertices, &lights), Shell::Solid { .. }) {
                look.two_sided = false;
                let what = "closed bodies have no inside that is lit, and are taken as one-sided";
                decided.entry(what).or_default().push(name.clone());
            }
        }
        if look.is_too_light() {
            decided.entry("reflectances are held to 0.95 in all").or_default().push(name.clone());
        }
        if look.is_wide() {
            decided.entry("gloss so rough that it is taken for diffuse").or_default().push(name.clone());
        }
        let table = look.table(made, place);
        model.materials.push(Material { name, table, file });
    }
    let decided: Vec<String> =
        decided.into_iter().map(|(what, materials)| format!("{what}: {}", note::names(&materials))).collect();
    decided.iter().for_each(|what| model.note(what));
}

/// The faces that wear each material.
fn worn(model: &Model) -> HashMap<String, Vec<usize>> {
    let mut worn: HashMap<String, Vec<usize>> = HashMap::new();
    let mut by_part = vec![Vec::new(); model.parts.len()];
    model.faces.iter().enumerate().for_each(|(f, face)| by_part[face.part as usize].push(f));
    for (part, faces) in model.parts.iter().zip(by_part) {
        if let Some(material) = &part.material {
            worn.entry(material.clone()).or_default().extend(faces);
        }
    }
    worn.values_mut().for_each(|faces| faces.sort_unstable());
    worn
}

fn turn(face: &mut Face) {
    let count = usize::from(face.count);
    face.corners[..count].reverse();
    face.corners[3] = face.corners[count.min(4) - 1];
    if count == 4 {
        face.corners.rotate_right(1);
    }
}

/// Middles of some of the faces that emit.
fn lights(model: &Model, described: &[Described]) -> Vec<DVec3> {
    const DARK: Rgb = [0.0; 3];
    let bright: HashSet<&str> =
        described.iter().filter(|d| d.look.emission != DARK).map(|d| d.name.as_str()).collect();
    let emits =
        |f: &&Face| model.parts[f.part as usize].material.as_deref().is_some_and(|m| bright.contains(m));
    let places: Vec<DVec3> = model
        .faces
        .iter()
        .filter(emits)
        .map(|f| f.corners[..3].iter().map(|&v| model.vertices[v as usize]).sum::<DVec3>() / 3.0)
        .collect();
    let step = places.len().div_ceil(MOST_LIGHTS).max(1);
    let points =
        model.lights.iter().filter_map(|light| Some(DVec3::from_array(*light.position.as_ref()?.get_ref())));
    places.into_iter().step_by(step).chain(points).collect()
}

#[cfg(test)]
mod tests {
    use super::super::look::Body;
    use super::super::mesh::{Part, START};
    use super::*;
    use std::path::Path;

    /// A unit cube of glass, and a triangle that emits at `light`.
    fn cube(light: DVec3) -> Model {
        let mut model = Model::new(Path::new("cube"));
        model.vertices =
            (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let face = |corners, count, part| Face { corners, count, part, patch: 0, place: START };
        model.faces = quads.iter().map(|&q| face(q, 4, 0)).collect();
        model.vertices.extend([light, light + 0.1 * DVec3::X, light + 0.1 * DVec3::Y]);
        model.faces.push(face([8, 9, 10, 10], 3, 1));
        let part = |name: &str| Part { object: None, material: Some(name.into()), place: START };
        model.parts = vec![part("glass"), part("lamp")];
        model
    }

    fn dressed(mut model: Model) -> Model {
        let described = |name: &str, body, emission| {
            let look = Look { body, emission, two_sided: false };
            Described { name: name.into(), look, place: 0, file: PathBuf::new() }
        };
        let glass = Body::Glass { index: 1.5, filter: [0.5; 3], over: None };
        let dark = Body::Opaque { diffuse: [0.0; 3], specular: [0.0; 3], index: None, m: 0.0 };
        dress(&mut model, vec![described("glass", glass, [0.0; 3]), described("lamp", dark, [1.0; 3])]);
        model
    }

    #[test]
    fn glass_is_what_its_faces_make() {
        let closed = dressed(cube(DVec3::splat(3.0)));
        let solid = closed.materials[0].table.solid.as_ref().expect("a body").get_ref();
        assert!((solid.over_m.as_ref().expect("a length").get_ref() - 4.0 / 6.0).abs() < 1e-12);
        assert!(dressed(cube(DVec3::splat(0.5))).materials[0].table.pane.is_some(), "a bulb");
        let mut open = cube(DVec3::splat(3.0));
        open.faces.remove(2);
        assert!(dressed(open).materials[0].table.pane.is_some(), "open");
        let mut inwards = cube(DVec3::splat(3.0));
        let outwards = inwards.faces.clone();
        inwards.faces[..6].iter_mut().for_each(turn);
        assert!(inwards.faces[0].corners != outwards[0].corners);
        let turned = dressed(inwards);
        assert!(turned.materials[0].table.solid.is_some());
        for (found, expected) in turned.faces.iter().zip(&outwards) {
            assert_eq!(found.corners, expected.corners);
        }
    }
}

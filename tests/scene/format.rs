//! Do the examples of scenes/FORMAT.md load, and mean what the page says?

use glam::DVec3;
use luxgraph::material::{Body, Fresnel, Level};
use luxgraph::points::divide_by_area;
use luxgraph::scene::{Appearance, Scene, SceneDescription, load};
use luxgraph::spectrum::Spectrum;
use std::path::PathBuf;

fn examples() -> Vec<String> {
    let page = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/FORMAT.md");
    let page = std::fs::read_to_string(page).expect("the page is there");
    page.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap_or("").to_owned()).collect()
}

fn body<'a>(appearance: &'a Appearance, name: &str) -> &'a Body {
    &appearance.materials.iter().find(|m| m.name == name).expect(name).body
}

/// A floor and a camera with `[materials.it]` as given, worn by the floor.
fn wearing(keys: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join("s.toml");
    let text = format!(
        "format = 1\n[materials.it]\n{keys}\n[[objects]]\nname = \"o\"\nmaterial = \"it\"\n\
         quads = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]\n\
         [[cameras]]\nname = \"c\"\nposition = [0, 0, 3]\ntarget = [1, 1, 0]\n"
    );
    std::fs::write(&path, text).expect("written");
    load(&path).unwrap_or_else(|e| panic!("{keys}: {e}"))
}

#[test]
fn the_examples_of_the_page_load() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let [scene, changes, moves] = &examples()[..] else { panic!("the page has three examples") };
    let [scene_path, changes_path, moves_path] = ["s", "c", "m"].map(|name| folder.path().join(name));
    for (path, text) in [(&scene_path, scene), (&changes_path, changes), (&moves_path, moves)] {
        std::fs::write(path, text).expect("written");
    }
    let description = SceneDescription::read(&scene_path).expect("reads");
    let scene = description.compile().expect("compiles");
    assert!(matches!(body(&scene.appearance, "gold"), Body::Opaque { s: 0.9, m: 0.3, .. }));
    // The floor has the area of the scene, the plate its own: 4 m2 / 256 and 2 m2 / 256.
    let elements = divide_by_area(&scene.geometry, &scene.sampling);
    assert_eq!(elements.iter().filter(|(id, _)| id.index() == 0).count(), 256);
    assert_eq!(elements.iter().filter(|(id, _)| id.index() == 1).count(), 256);
    let changed =
        description.changed(&changes_path).expect("reads").appearance(&scene.geometry).expect("fits");
    assert!(matches!(body(&changed, "gold"), Body::Opaque { s: 0.9, m: 0.1, .. }));
    assert_eq!(changed.materials[changed.surface_material[0].0 as usize].name, "gold");
    // The lamp is gone, the plate turned by 20 degrees about its middle and shifted, and a ball has come.
    let moved = description.changed(&moves_path).and_then(|d| d.compile_over(&scene)).expect("fits");
    let [floor, plate, ball] = &moved.geometry.surfaces[..] else { panic!("three surfaces") };
    assert!((floor.area - 4.0).abs() < 1e-6 && ball.round().is_some());
    let corner = plate.vertices()[0] + moved.geometry.centre;
    let (sin, cos) = 20f64.to_radians().sin_cos();
    assert!(corner.distance(DVec3::new(1.0 - cos, 1.7 - sin, 0.0)) < 1e-6, "{corner}");
}

#[test]
fn glass_gets_points_on_both_sides_and_its_absorption() {
    let scene = wearing("pane = { index = \"green_glass\", thickness_m = 0.002 }");
    assert!(scene.geometry.two_sided[0]);
    let Body::Pane { transmittance, .. } = body(&scene.appearance, "it") else { panic!("a pane") };
    let thick = wearing("pane = { index = \"green_glass\", thickness_m = 0.004 }");
    let Body::Pane { transmittance: twice, .. } = body(&thick.appearance, "it") else { panic!("a pane") };
    for nm in [420.0, 540.0, 650.0] {
        assert!((0.0..=1.0).contains(&transmittance.at(nm)));
        assert!((transmittance.at(nm).powi(2) - twice.at(nm)).abs() < 1e-9, "Beer-Lambert at {nm}");
    }
    let solid = wearing("solid = { index = 1.5, transmittance = 0.5, over_m = 0.01 }");
    let Body::Solid { absorption, .. } = body(&solid.appearance, "it") else { panic!("a solid") };
    assert!((absorption.at(550.0) - 2f64.ln() / 0.01).abs() < 1e-9);
    let opaque = wearing("solid = { index = 1.5, transmittance = 0, over_m = 0.01 }");
    let Body::Solid { absorption, .. } = body(&opaque.appearance, "it") else { panic!("a solid") };
    assert!(absorption.max().is_finite());
}

#[test]
fn an_index_left_out_follows_from_the_reflectance() {
    let scene = wearing("fresnel = { normal = 0.04 }\nspecular = 1");
    let Body::Opaque { fresnel: Fresnel::Scaled { n, k, .. }, diffuse, .. } = body(&scene.appearance, "it")
    else {
        panic!("the first method")
    };
    assert!((n - 1.5).abs() < 1e-12 && *k == 0.0);
    assert_eq!(*diffuse, None);
}

#[test]
fn emitters_keep_their_units() {
    for (key, level) in [
        ("luminous_flux = 800", Level::LuminousFlux(800.0)),
        ("luminance = 100", Level::Luminance(100.0)),
        ("radiance = 2", Level::Radiance(2.0)),
    ] {
        let scene = wearing(&format!("emission = {{ spectrum = 1, {key} }}"));
        let emission = scene.appearance.materials[0].emission.clone().expect("it emits");
        assert_eq!(emission.level, level);
        assert_eq!(emission.spectrum, Spectrum::Constant(1.0));
        let Body::Opaque { diffuse, .. } = &scene.appearance.materials[0].body else { panic!("opaque") };
        assert_eq!(*diffuse, Some(Spectrum::Constant(0.0)), "what only emits reflects nothing");
    }
}

#[test]
fn glass_that_stands_in_a_floor_is_noted() {
    let scene = |height: f64| {
        let text = format!(
            r#"format = 1
[materials.grey]
reflectance = 0.5
[materials.glass]
solid = {{ index = 1.5 }}
[[objects]]
name = "floor"
material = "grey"
quads = [[[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]]
[[objects]]
name = "block"
material = "glass"
quads = [[[1, 1, {height}], [1, 2, {height}], [2, 2, {height}], [2, 1, {height}]]]
[[cameras]]
name = "main"
position = [0, 0, 3]
target = [1, 1, 0]
"#
        );
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        load(&path).unwrap().notes
    };
    let notes = scene(0.0);
    assert!(
        notes.len() == 1 && notes[0].contains("\"block\"") && notes[0].contains("\"floor\""),
        "{notes:?}"
    );
    assert!(scene(0.001).is_empty());
}

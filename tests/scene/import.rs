//! Do scenes made elsewhere arrive as they were meant, and do damaged ones fail with a place and a remedy?

use crate::folder::Folder;
use base64::Engine;
use luxgraph::error::Error;
use luxgraph::geometry::Shape;
use luxgraph::material::{Body, Level, Material};
use luxgraph::scene::{LightKind, LightLevel, Scene, SceneDescription, load};
use proptest::prelude::*;
use std::path::PathBuf;

fn material<'a>(scene: &'a Scene, name: &str) -> &'a Material {
    scene.appearance.materials.iter().find(|m| m.name == name).unwrap_or_else(|| panic!("no material {name}"))
}

/// A box that is open towards +z, with the front of its walls inside; in it a floor lamp, a glass cube and an L.
const BOX_OBJ: &str = "mtllib box.mtl
v 0 0 0
v 2 0 0
v 2 2 0
v 0 2 0
v 0 0 2
v 2 0 2
v 2 2 2
v 0 2 2
usemtl wall
o back
f 1 2 3 4
o sides
f 1 4 8 5
f 2 6 7 3
f 1 5 6 2
f 4 3 7 8
v 0.9 1.9 0.9
v 1.1 1.9 0.9
v 1.1 1.9 1.1
v 0.9 1.9 1.1
usemtl lamp
o lamp
f -4 -3 -2 -1
v 0.2 0.1 0.2
v 0.6 0.1 0.2
v 0.6 0.5 0.2
v 0.2 0.5 0.2
v 0.2 0.1 0.6
v 0.6 0.1 0.6
v 0.6 0.5 0.6
v 0.2 0.5 0.6
usemtl glass
o cube
f -8 -5 -6 -7
f -4 -3 -2 -1
f -8 -7 -3 -4
f -5 -1 -2 -6
f -8 -4 -1 -5
f -7 -6 -2 -3
v 1 0.1 1
v 1.6 0.1 1
v 1.6 0.4 1
v 1.2 0.4 1
v 1.2 0.8 1
v 1 0.8 1
usemtl shiny
o letter
f -6 -5 -4 -3 -2 -1
usemtl nowhere
f -6 -5 -5
";
const BOX_MTL: &str = "newmtl wall
Kd 0.7 0.2 0.1
newmtl lamp
Kd 0 0 0
Ke 17 12 4
newmtl glass
Ni 1.5
Tf 0.8 0.9 1
illum 7
newmtl shiny
Kd 0.3 0.3 0.3
Ks 0.04 0.04 0.04
Ns 48
";

fn write_box(folder: &Folder) -> PathBuf {
    folder.write("box.mtl", BOX_MTL);
    folder.write("box.obj", BOX_OBJ)
}

#[test]
fn an_obj_file_is_a_scene() {
    let folder = Folder::new();
    let scene = load(&write_box(&folder)).expect("loads");
    let emission = material(&scene, "lamp").emission.clone().expect("it shines");
    let Level::Luminance(luminance) = emission.level else { panic!("{:?}", emission.level) };
    assert!((luminance - (17.0 * 0.2126390 + 12.0 * 0.7151687 + 4.0 * 0.0721923)).abs() < 1e-4);
    let Body::Solid { n, absorption } = &material(&scene, "glass").body else { panic!("not solid") };
    assert_eq!(n.at(550.0), 1.5);
    // 0.8 of the red over the mean chord of a cube of 0.4 m, 4 V/S = 2/3 of its side.
    let over_chord = |nm: f64| (-absorption.at(nm) * 0.4 * 2.0 / 3.0).exp();
    let (red, green, blue) = (over_chord(600.0), over_chord(540.0), over_chord(460.0));
    assert!(0.7 < red && red < green && green < blue && blue <= 1.0, "{red} {green} {blue}");
    let Body::Opaque { s, m, .. } = material(&scene, "shiny").body else { panic!("not opaque") };
    assert!((s - 0.7).abs() < 1e-12 && (m - 0.2).abs() < 1e-12);
    // The L is cut into convex pieces that keep its area.
    let letter = scene.geometry.objects.iter().position(|o| o == "box/letter").expect("there");
    let of_letter = |i: &usize| scene.geometry.object[*i].0 as usize == letter;
    let area: f64 =
        (0..scene.geometry.surfaces.len()).filter(of_letter).map(|i| scene.geometry.surfaces[i].area).sum();
    assert!((area - 0.26).abs() < 1e-6, "{area}");
    for part in ["more than four corners", "without area", "cd/m2", "`solid`: glass", "no camera", "nowhere"]
    {
        assert!(scene.notes.iter().any(|n| n.contains(part)), "{part}: {:?}", scene.notes);
    }
    // The camera looks in where the box is open.
    let camera = &scene.cameras[0];
    assert!(camera.position.z > 2.0 && (camera.target - camera.position).normalize().z < -0.9, "{camera:?}");
}

#[test]
fn a_scene_file_goes_over_a_model() {
    let folder = Folder::new();
    write_box(&folder);
    let scene = "format = 1\n[materials.wall]\nreflectance = { srgb = [0.5, 0.5, 0.5] }\n[materials.mine]\n\
                 reflectance = 0.25\n[[objects]]\nname = \"b\"\nobj = \"box.obj\"\nmaterials = { shiny = \"mine\" }\nleave_out = [\"lamp\"]\n";
    let scene = load(&folder.write("over.toml", scene)).expect("loads");
    let reflectance = |name: &str| match &material(&scene, name).body {
        Body::Opaque { diffuse: Some(diffuse), .. } => diffuse.at(550.0),
        other => panic!("{other:?}"),
    };
    assert!((reflectance("wall") - 0.2140).abs() < 1e-4);
    let letter = scene.geometry.objects.iter().position(|o| o == "b/letter").expect("there");
    let surface = scene.geometry.object.iter().position(|o| o.0 as usize == letter).expect("worn");
    let worn = scene.appearance.surface_material[surface].0 as usize;
    assert_eq!(scene.appearance.materials[worn].name, "mine");
    let worn = |name: &str| {
        let id = scene.appearance.materials.iter().position(|m| m.name == name).expect("it is there") as u32;
        scene.appearance.surface_material.iter().filter(|m| m.0 == id).count()
    };
    assert_eq!((worn("lamp"), worn("wall")), (0, 5), "the lamp is left out");
}

#[test]
fn polygons_that_enclose_nothing_are_left_out_and_counted() {
    let folder = Folder::new();
    // Six corners on one line, and five in one place; beside them a pentagon.
    let obj = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 4 0 0\nv 5 0 0\nv 0 1 0\nv 1 1 0\nv 0.5 1.5 0\n\
               f 1 2 3 4 5 6\nf 1 1 1 1 1\nf 1 2 8 9 7\n";
    let scene = load(&folder.write("lines.obj", obj)).expect("loads");
    let area: f64 = scene.geometry.surfaces.iter().map(|s| s.area).sum();
    assert!((area - 1.25).abs() < 1e-6, "{area}");
    let told = "7 faces without area left out";
    assert!(scene.notes.iter().any(|n| n.contains(told)), "{:?}", scene.notes);
}

#[test]
fn a_model_without_its_materials_is_grey() {
    let folder = Folder::new();
    let scene = load(&folder.write("box.obj", BOX_OBJ)).expect("loads");
    assert!(matches!(&material(&scene, "wall").body, Body::Opaque { s: 0.0, .. }));
    assert!(scene.notes.iter().any(|n| n.contains("there is no material file box.mtl")), "{:?}", scene.notes);
    let bare = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    assert!(load(&folder.write("bare.obj", bare)).is_ok(), "not even a name");
}

/// Four corners of a unit square as floats, six indices as u16 (two triangles), padded.
fn square_bytes() -> Vec<u8> {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let mut bytes: Vec<u8> = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

/// Two squares, one mirrored; a lamp, a camera, and a material of each kind.
fn square_json(buffer: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_lights_punctual","KHR_materials_emissive_strength","X_other"],
"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point","intensity":100}},
 {{"type":"spot","intensity":50,"spot":{{"innerConeAngle":0.1,"outerConeAngle":0.5}}}},{{"type":"directional","intensity":1000}}]}}}},
"scene":0,"scenes":[{{"nodes":[0,2]}}],
"nodes":[{{"name":"up","translation":[0,0,1],"scale":[2,2,2],"children":[1,3]}},
 {{"name":"square","mesh":0}},
 {{"name":"mirrored","mesh":1,"scale":[-1,1,1]}},
 {{"name":"bulb","translation":[1,1,1],"extensions":{{"KHR_lights_punctual":{{"light":0}}}},"children":[4,5,6]}},
 {{"name":"eye","camera":0}},
 {{"extensions":{{"KHR_lights_punctual":{{"light":1}}}}}},
 {{"extensions":{{"KHR_lights_punctual":{{"light":2}}}}}}],
"cameras":[{{"type":"perspective","perspective":{{"yfov":0.5,"aspectRatio":2,"znear":0.1}}}}],
"materials":[{{"name":"metal","pbrMetallicRoughness":{{"baseColorFactor":[1,0.7,0.3,1],"metallicFactor":1,"roughnessFactor":0.5}}}},
 {{"name":"lamp","pbrMetallicRoughness":{{"baseColorFactor":[0.5,0.5,0.5,1],"metallicFactor":0}},"emissiveFactor":[1,1,1],
  "doubleSided":true,"extensions":{{"KHR_materials_emissive_strength":{{"emissiveStrength":250}}}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}},
 {{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":1}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
 {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}}],
"bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":12}}],
"buffers":[{{{buffer}"byteLength":60}}]}}"#
    )
}

fn square_gltf() -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(square_bytes());
    square_json(&format!("\"uri\":\"data:application/octet-stream;base64,{data}\","))
}

fn square_glb() -> Vec<u8> {
    let (mut json, bytes) = (square_json("").into_bytes(), square_bytes());
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = (12 + 8 + json.len() + 8 + bytes.len()) as u32;
    let mut glb = b"glTF".to_vec();
    for word in [2, length, json.len() as u32] {
        glb.extend(word.to_le_bytes());
    }
    glb.extend(b"JSON");
    glb.extend(json);
    glb.extend((bytes.len() as u32).to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(bytes);
    glb
}

#[test]
fn gltf_arrives_as_it_was_meant() {
    let folder = Folder::new();
    let text = load(&folder.write("s.gltf", square_gltf())).expect("loads");
    let binary = load(&folder.write("s.glb", square_glb())).expect("loads");
    assert_eq!(text.geometry.hash(), binary.geometry.hash());
    let surfaces = &text.geometry.surfaces;
    assert_eq!(surfaces.len(), 2, "pairs of triangles are squares again");
    assert!(surfaces.iter().all(|s| matches!(s.shape, Shape::Quad(_))));
    assert!((surfaces[0].area - 4.0).abs() < 1e-6 && (surfaces[1].area - 1.0).abs() < 1e-6);
    // Mirrored, it still shows the front that it showed.
    assert!(surfaces.iter().all(|s| s.normal_at(s.middle()).z > 0.99));
    assert_eq!(text.geometry.two_sided, [false, true]);

    let Body::Opaque { s, m, .. } = material(&text, "metal").body else { panic!("not opaque") };
    assert_eq!((s, m), (1.0, 0.25));
    let emission = material(&text, "lamp").emission.clone().expect("it shines");
    assert!(matches!(emission.level, Level::Luminance(l) if (l - 250.0).abs() < 1e-9));

    let lights = &text.geometry.lights;
    let LightKind::Point { position, .. } = lights[0].kind else { panic!("{:?}", lights[0]) };
    assert!((position + text.geometry.centre).distance([2.0, 2.0, 3.0].into()) < 1e-9);
    assert!(
        matches!(text.appearance.lights[0].level, LightLevel::LuminousIntensity(i) if (i - 100.0).abs() < 1e-9)
    );
    assert!(lights.iter().any(|l| matches!(l.kind, LightKind::Directional { .. })));

    let camera = &text.cameras[0];
    assert_eq!((camera.name.as_str(), camera.resolution), ("eye", [640, 320]));
    assert!((camera.fov_deg - 0.5f64.to_degrees()).abs() < 1e-5);
    assert!(text.notes.iter().any(|n| n.ends_with("ignored X_other")), "{:?}", text.notes);
}

/// (what is replaced, by what, word of the message)
#[test]
fn damaged_gltf_fails_with_a_reason() {
    let cases = [
        (r#""children":[1,3]"#, r#""children":[1,3,0]"#, "tree"),
        (r#""mesh":0}"#, r#""mesh":7}"#, "nodes[1].mesh"),
        (r#""count":4"#, r#""count":5"#, "accessors[0]"),
        (r#""count":4"#, r#""count":4000000000"#, "accessors[0]"),
        (r#""count":4"#, r#""count":2"#, "index"),
        (r#""byteOffset":48"#, r#""byteOffset":18446744073709551615"#, "bufferViews[1]"),
        (r#""byteLength":60"#, r#""byteLength":61"#, "cut off"),
        (r#""componentType":5126"#, r#""componentType":5121"#, "no surface"),
        (r#""POSITION":0"#, r#""POSITION":9"#, "meshes[0]"),
        ("base64,", "base64,*", "base64"),
        (r#""translation":[0,0,1]"#, r#""translation":[0,0,1e39]"#, "gltf"),
        (
            r#""asset":{"version":"2.0"},"#,
            r#""extensionsRequired":["KHR_draco_mesh_compression"],"asset":{"version":"2.0"},"#,
            "draco",
        ),
    ];
    let folder = Folder::new();
    for (old, new, word) in cases {
        let text = square_gltf();
        assert!(text.contains(old), "{old}");
        match load(&folder.write("s.gltf", text.replacen(old, new, 1))) {
            Ok(_) => panic!("{new}: accepted"),
            Err(e @ Error::Scene { .. }) => assert!(e.to_string().contains(word), "{new}: {e}"),
            Err(other) => panic!("{new}: {other}"),
        }
    }
    let missing = square_json("\"uri\":\"no%20such.bin\",");
    let error = load(&folder.write("s.gltf", missing)).expect_err("no buffer").to_string();
    assert!(error.contains("no such.bin"), "{error}");
    let glb = square_glb();
    for cut in [0, 3, 11, 19, 40, glb.len() - 1] {
        assert!(load(&folder.write("s.glb", &glb[..cut])).is_err(), "{cut}");
    }
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(square_gltf().bytes().flat_map(|b| [b, 0])).collect();
    let error = load(&folder.write("s.gltf", wide)).expect_err("UTF-16").to_string();
    assert!(error.contains("UTF-8"), "{error}");
    let nan = {
        let mut bytes = square_bytes();
        bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes());
        let data = base64::engine::general_purpose::STANDARD.encode(bytes);
        square_json(&format!("\"uri\":\"data:;base64,{data}\","))
    };
    let error = load(&folder.write("s.gltf", nan)).expect_err("NaN").to_string();
    assert!(error.contains("not finite"), "{error}");
}

#[test]
fn lights_are_counted_and_held_to_what_can_be_computed() {
    let folder = Folder::new();
    for intensity in ["1e30", "-5"] {
        let text = square_gltf().replacen("\"intensity\":100", &format!("\"intensity\":{intensity}"), 1);
        let scene = load(&folder.write("s.gltf", text)).expect("loads");
        assert_eq!(scene.geometry.lights.len(), 2);
        assert!(
            scene.notes.iter().any(|n| n.contains("less than nothing or more than")),
            "{:?}",
            scene.notes
        );
    }
    let light = r#",{"extensions":{"KHR_lights_punctual":{"light":0}}}"#;
    let last = r#"{"extensions":{"KHR_lights_punctual":{"light":2}}}]"#;
    let many =
        square_gltf().replacen(last, &format!("{}{}]", &last[..last.len() - 1], light.repeat(10_000)), 1);
    let children: Vec<String> = (4..10_007).map(|k| k.to_string()).collect();
    let many = many.replacen("\"children\":[4,5,6]", &format!("\"children\":[{}]", children.join(",")), 1);
    let error = load(&folder.write("s.gltf", many)).expect_err("too many").to_string();
    assert!(error.contains("more than 10000 lights"), "{error}");
}

#[test]
fn light_goes_straight_through_panes_alone() {
    let folder = Folder::new();
    folder.write("box.mtl", BOX_MTL);
    let solid = load(&folder.write("box.obj", BOX_OBJ)).expect("loads").geometry;
    assert!(solid.two_sided.contains(&true) && !solid.pane.contains(&true), "the cube is a body");
    // A cube without its last face is a sheet.
    let open =
        load(&folder.write("open.obj", BOX_OBJ.replace("f -7 -6 -2 -3\n", ""))).expect("loads").geometry;
    assert_eq!(open.pane.iter().filter(|p| **p).count(), 5);
}

/// Bytes of `whole`, some of them others, some cut out, and the end perhaps missing.
fn damaged(whole: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let n = whole.len();
    let edits = prop::collection::vec((0..n, any::<u8>(), 0..12usize, 0..4u8), 1..6);
    (edits, 0..2 * n).prop_map(move |(edits, end)| {
        let mut bytes = whole.clone();
        bytes.truncate(end.max(1));
        for (at, byte, length, kind) in edits {
            let at = at % bytes.len();
            match kind {
                0 => bytes[at] = byte,
                1 => bytes[at] = b"0123456789-.e/[]{},\" \n"[usize::from(byte) % 22],
                2 => drop(bytes.drain(at..(at + length).min(bytes.len() - 1).max(at))),
                _ => {
                    let copy = bytes[at..(at + length).min(bytes.len())].to_vec();
                    bytes.splice(at..at, copy);
                }
            }
        }
        bytes
    })
}

fn survives(folder: &Folder, name: &str) {
    // It loads, or it says why not.
    if let Err(e) = SceneDescription::read(&folder.path().join(name)).and_then(|d| d.compile()) {
        assert!(!e.to_string().is_empty());
    }
}

/// Cut off at every length, each kind of file is read or refused with a reason.
#[test]
fn files_cut_short_anywhere_never_do_harm() {
    let folder = Folder::new();
    folder.write("box.mtl", BOX_MTL);
    for cut in 0..BOX_OBJ.len() {
        folder.write("box.obj", &BOX_OBJ[..cut]);
        survives(&folder, "box.obj");
    }
    folder.write("box.obj", BOX_OBJ);
    for cut in 0..BOX_MTL.len() {
        folder.write("box.mtl", &BOX_MTL[..cut]);
        survives(&folder, "box.obj");
    }
    let text = square_gltf();
    for cut in 0..text.len() {
        assert!(load(&folder.write("s.gltf", &text[..cut])).is_err(), "JSON cut at {cut}");
    }
    let binary = square_glb();
    for cut in 0..binary.len() {
        assert!(load(&folder.write("s.glb", &binary[..cut])).is_err(), "glb cut at {cut}");
    }
}

/// (the file, line, word of the message)
#[test]
fn damaged_obj_fails_with_a_place_and_a_remedy() {
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let folder = Folder::new();
    for (more, line, word) in [
        ("v nan 0 0\nf 1 2 5\n", 6, "finite"),
        ("v 0 inf 0\nf 1 2 5\n", 6, "finite"),
        ("v 1e400 0 0\nf 1 2 5\n", 6, "finite"),
        ("f 1 2 5\n", 5, "vertex 5 does not exist"),
        ("f 1 2 -5\n", 5, "vertex -5 does not exist"),
        ("f 1 2 0\n", 5, "vertex 0 does not exist"),
        ("f 1 2 99999999999999999999\n", 5, "99999999999999999999"),
        ("f 1 2\n", 5, "corners"),
        ("f 1//x 2 3\n", 5, "normal index"),
        ("v 1\nf 1 2 3\n", 5, "three coordinates"),
    ] {
        match load(&folder.write("s.obj", format!("{square}{more}"))) {
            Err(Error::Scene { line: found, message, .. }) => {
                assert_eq!(found, line, "{more}: {message}");
                assert!(message.contains(word), "{more}: {message}");
            }
            Err(other) => panic!("{more}: {other}"),
            Ok(_) => panic!("{more}: accepted"),
        }
    }
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(square.bytes().flat_map(|b| [b, 0])).collect();
    let error = load(&folder.write("s.obj", wide)).expect_err("UTF-16").to_string();
    assert!(error.contains("s.obj"), "{error}");
    let error = load(&folder.path().join("none.obj")).expect_err("missing").to_string();
    assert!(error.contains("none.obj"), "{error}");
}

/// Nodes that are their own descendants, by way of each other or by themselves.
#[test]
fn nodes_in_a_ring_are_refused() {
    let folder = Folder::new();
    for (old, new) in [
        (r#""name":"square","mesh":0"#, r#""name":"square","mesh":0,"children":[0]"#),
        (r#""name":"square","mesh":0"#, r#""name":"square","mesh":0,"children":[1]"#),
        (r#""name":"eye","camera":0"#, r#""name":"eye","camera":0,"children":[3]"#),
    ] {
        let text = square_gltf();
        assert!(text.contains(old), "{old}");
        let error = load(&folder.write("s.gltf", text.replacen(old, new, 1))).expect_err(new).to_string();
        assert!(error.contains("tree"), "{new}: {error}");
    }
}

/// A model without any light is put under a sky, and says so.
#[test]
fn a_model_without_light_is_put_under_a_sky() {
    let folder = Folder::new();
    let bare = load(&folder.write("bare.obj", "v 0 0 0\nv 1 0 0\nv 0 0 -1\nf 1 2 3\n")).expect("loads");
    let sky = bare.appearance.sky.as_ref().expect("a sky");
    assert!((sky.shape.horizontal() * sky.factor()).is_finite());
    assert_eq!(bare.geometry.zenith, Some([0.0, 1.0, 0.0].into()));
    assert!(bare.notes.iter().any(|n| n.contains("there is no light")), "{:?}", bare.notes);
    folder.write("box.mtl", BOX_MTL);
    let lit = load(&folder.write("box.obj", BOX_OBJ)).expect("loads");
    assert!(lit.appearance.sky.is_none() && !lit.notes.iter().any(|n| n.contains("there is no light")));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn no_obj_file_panics(bytes in damaged(BOX_OBJ.into())) {
        let folder = Folder::new();
        folder.write("box.mtl", BOX_MTL);
        folder.write("box.obj", bytes);
        survives(&folder, "box.obj");
    }

    #[test]
    fn no_mtl_file_panics(bytes in damaged(BOX_MTL.into())) {
        let folder = Folder::new();
        folder.write("box.mtl", bytes);
        folder.write("box.obj", BOX_OBJ);
        survives(&folder, "box.obj");
    }

    #[test]
    fn no_gltf_file_panics(bytes in damaged(square_gltf().into())) {
        let folder = Folder::new();
        folder.write("s.gltf", bytes);
        survives(&folder, "s.gltf");
    }

    #[test]
    fn no_glb_file_panics(bytes in damaged(square_glb())) {
        let folder = Folder::new();
        folder.write("s.glb", bytes);
        survives(&folder, "s.glb");
    }
}

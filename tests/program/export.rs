//! Is a scene written whole for another renderer, and is what it cannot be told said?

use luxgraph::export::mitsuba::export;
use luxgraph::scene::load;
use std::path::Path;

/// Every tag that is opened is closed, in order.
fn is_balanced(xml: &str) -> bool {
    let mut open = Vec::new();
    for tag in xml.split('<').skip(1) {
        let tag = tag.split('>').next().unwrap();
        if tag.starts_with('!') || tag.ends_with('/') {
            continue;
        }
        let name = tag.split_whitespace().next().unwrap();
        match name.strip_prefix('/') {
            Some(closed) if open.pop() != Some(closed) => return false,
            Some(_) => {}
            None => open.push(name),
        }
    }
    open.is_empty()
}

fn exported(scene: &str) -> (String, Vec<String>, tempfile::TempDir) {
    let scene = load(Path::new(scene)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let notes = export(&scene, &scene.cameras[0], 64, folder.path()).unwrap();
    (std::fs::read_to_string(folder.path().join("scene.xml")).unwrap(), notes, folder)
}

#[test]
fn the_papers_room_is_written_whole() {
    let scene = load(Path::new("scenes/paper_room.toml")).unwrap();
    let (xml, notes, folder) = exported("scenes/paper_room.toml");
    assert!(is_balanced(&xml));
    assert!(notes.iter().any(|n| n.contains("\"gold\"") && n.contains("Smith")), "{notes:?}");
    // Each spectrum has a value for every nanometre.
    let spectra: Vec<&str> = xml.split("name=\"values\" value=\"").skip(1).collect();
    assert!(spectra.len() > 10);
    for spectrum in spectra {
        assert_eq!(spectrum.split('"').next().unwrap().split(',').count(), 471);
    }
    // The meshes that are named are there, and have two triangles for each quadrilateral.
    let mut triangles = 0;
    for part in xml.split("<string name=\"filename\" value=\"").skip(1) {
        let bytes = std::fs::read(folder.path().join(part.split('"').next().unwrap())).unwrap();
        let head = String::from_utf8_lossy(&bytes[..300.min(bytes.len())]).into_owned();
        let count = |of: &str| -> usize {
            head.split(of).nth(1).unwrap().split_whitespace().next().unwrap().parse().unwrap()
        };
        let (vertices, faces) = (count("element vertex "), count("element face "));
        assert_eq!(bytes.len(), head.find("end_header\n").unwrap() + 11 + 12 * vertices + 13 * faces);
        triangles += faces;
    }
    let expected: usize = scene.geometry.surfaces.iter().map(|s| s.triangles().1).sum();
    assert_eq!(triangles, expected);
    // Every material that is referred to is there.
    for part in xml.split("<ref id=\"").skip(1) {
        let id = part.split('"').next().unwrap();
        assert!(xml.contains(&format!("id=\"{id}\">")), "{id}");
    }
}

/// Mitsuba refuses tables without any value above zero: the absorption index of a varnish is one.
#[test]
fn spectra_that_are_the_same_everywhere_are_no_tables() {
    let (xml, _, _folder) = exported("tests/target_scenes/glossy.toml");
    assert!(is_balanced(&xml) && xml.contains("<spectrum type=\"uniform\" name=\"k\">"));
    let tables = xml.lines().filter(|line| line.contains("name=\"values\""));
    for table in tables {
        let values = table.split("value=\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
        let first = values.split(", ").next().unwrap();
        assert!(values.split(", ").any(|value| value != first), "{values}");
    }
}

#[test]
fn round_surfaces_stay_round() {
    let (xml, _, _folder) = exported("scenes/sphere_and_disc.toml");
    assert!(is_balanced(&xml));
    assert!(xml.contains("<shape type=\"sphere\">") && xml.contains("<shape type=\"disk\">"));
}

/// A floor under a sky of this kind over ground of this reflectance.
fn under_sky(kind: &str, ground: f64) -> (String, Vec<String>, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    let text = format!(
        "format = 1\n[materials.grey]\nreflectance = 0.5\n[[objects]]\nname = \"floor\"\nmaterial = \"grey\"\n\
         quads = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]\n\
         [sky]\ntype = {kind}\nilluminant = \"D65\"\nzenith_luminance = 1000\nground = {ground}\n"
    );
    std::fs::write(&path, text).unwrap();
    exported(path.to_str().unwrap())
}

#[test]
fn skies_are_written_as_mitsuba_has_them() {
    let (xml, notes, _folder) = under_sky("\"uniform\"", 1.0);
    assert!(is_balanced(&xml) && xml.contains("<emitter type=\"constant\">"), "{xml}");
    assert!(!notes.iter().any(|n| n.contains("sky")), "{notes:?}");

    let (xml, notes, folder) = under_sky("\"overcast\"", 0.3);
    assert!(is_balanced(&xml) && xml.contains("<emitter type=\"envmap\">"), "{xml}");
    assert!(notes.iter().any(|n| n.contains("the sky: an image")), "{notes:?}");
    // From the zenith down to a third of it at the horizon, and the ground below.
    let image = luxgraph::output::exr::read(&folder.path().join("sky.exr")).unwrap();
    let column = image.width / 3;
    let luminance = |row: u32| image.luminance((row * image.width + column) as usize);
    for row in 0..image.height {
        let sine = (std::f64::consts::PI * (f64::from(row) + 0.5) / f64::from(image.height)).cos();
        let expected = if sine > 0.0 { 1000.0 * (1.0 + 2.0 * sine) / 3.0 } else { 0.3 * 1000.0 * 7.0 / 9.0 };
        assert!((luminance(row) / expected - 1.0).abs() < 1e-3, "{row}: {} for {expected}", luminance(row));
    }
}

#[test]
fn a_folder_that_cannot_be_made_is_an_error() {
    let scene = load(Path::new("scenes/cornell_box.toml")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let error = export(&scene, &scene.cameras[0], 64, &file.join("below")).unwrap_err().to_string();
    assert!(error.contains("below"), "{error}");
}

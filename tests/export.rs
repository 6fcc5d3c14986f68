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

#[test]
fn round_surfaces_stay_round() {
    let (xml, _, _folder) = exported("scenes/sphere_and_disc.toml");
    assert!(is_balanced(&xml));
    assert!(xml.contains("<shape type=\"sphere\">") && xml.contains("<shape type=\"disk\">"));
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

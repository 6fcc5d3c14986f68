//! The two scenes that ship: are they what they claim to be?

use glam::DVec3;
use luxgraph::geometry::{Ray, Shape, Side};
use luxgraph::material::{Body, Level};
use luxgraph::points::divide_by_area;
use luxgraph::scene::{Scene, SceneDescription, load, load_with_changes};
use luxgraph::tracers::RayTracer;
use luxgraph::tracers::brute_force::BruteForce;
use std::path::PathBuf;

fn scenes(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}

fn paper_room() -> Scene {
    load(&scenes("paper_room.toml")).expect("the scene loads")
}

fn specular_share(scene: &Scene, surface: usize) -> f64 {
    match &scene.appearance.materials[scene.appearance.surface_material[surface].0 as usize].body {
        Body::Opaque { s, .. } => *s,
        _ => 1.0,
    }
}

#[test]
fn the_room_has_the_counts_of_the_paper() {
    let scene = paper_room();
    assert_eq!(scene.geometry.surfaces.len(), 134);
    assert!(scene.geometry.surfaces.iter().all(|s| matches!(s.shape, Shape::Quad(_))));
    assert!(scene.notes.is_empty(), "{:?}", scene.notes);
    let elements = divide_by_area(&scene.geometry, &scene.sampling);
    let n = elements.len() as f64;
    assert!((n / 4010.0 - 1.0).abs() < 0.03, "{n} points");
    let specular = elements.iter().filter(|(id, _)| specular_share(&scene, id.index()) > 0.0).count();
    assert!((150..=240).contains(&specular), "{specular} specular points");
    let flux: f64 =
        scene.appearance.materials.iter().filter_map(|m| m.emission.as_ref()).fold(0.0, |sum, e| {
            match e.level {
                Level::LuminousFlux(lm) => sum + lm,
                _ => sum,
            }
        });
    assert_eq!(flux, 12000.0);
}

/// Nothing leaves the room, and from inside only fronts are seen.
#[test]
fn the_room_is_closed_and_faces_inwards() {
    let scene = paper_room();
    let tracer = BruteForce::new(&scene.geometry);
    for camera in &scene.cameras {
        for i in 0..60 {
            for j in 0..45 {
                let [w, h] = camera.resolution.map(f64::from);
                let ray = camera.ray(
                    (f64::from(i) + 0.5) * w / 60.0,
                    (f64::from(j) + 0.5) * h / 45.0,
                    scene.geometry.centre,
                );
                let hit =
                    tracer.closest(&ray).unwrap_or_else(|| panic!("{}: a ray leaves the room", camera.name));
                let object = &scene.geometry.objects[scene.geometry.object[hit.surface.index()].0 as usize];
                assert_eq!(hit.side, Side::Front, "{}: {object}", camera.name);
            }
        }
    }
}

/// Where light from the middle of `lamp`, mirrored once in the first surface of `mirror`, lands: one
/// object and point for each of 100 places on it that the lamp reaches straight.
fn mirrored_once(scene: &Scene, lamp: &str, mirror: &str) -> Vec<(String, DVec3)> {
    let surface_of = |name: &str| {
        let is = |o: &luxgraph::scene::ObjectId| scene.geometry.objects[o.0 as usize] == name;
        scene.geometry.surfaces[scene.geometry.object.iter().position(is).expect(name)].clone()
    };
    let (lamp, mirror) = (surface_of(lamp), surface_of(mirror));
    let tracer = BruteForce::new(&scene.geometry);
    let from = lamp.point_at(0.5, 0.5) + 1e-3 * lamp.normal_at(lamp.middle());
    let mut landed = Vec::new();
    for i in 0..10 {
        for j in 0..10 {
            let at = mirror.point_at((f64::from(i) + 0.5) / 10.0, (f64::from(j) + 0.5) / 10.0);
            let origin = at + 1e-6 * mirror.normal_at(mirror.middle());
            let way = origin - from;
            let t_max = way.length();
            let incoming = way / t_max;
            if tracer.closest(&Ray { origin: from, direction: incoming, t_min: 1e-6, t_max }).is_some() {
                continue;
            }
            let direction = incoming
                - 2.0 * incoming.dot(mirror.normal_at(mirror.middle())) * mirror.normal_at(mirror.middle());
            let ray = Ray { origin, direction, t_min: 1e-6, t_max: f64::INFINITY };
            let hit = tracer.closest(&ray).expect("a closed room");
            let object = scene.geometry.object[hit.surface.index()].0 as usize;
            landed.push((scene.geometry.objects[object].clone(), ray.at(hit.t) + scene.geometry.centre));
        }
    }
    landed
}

/// Light of luminaire 2, mirrored, lands on the wall between the door (its frame ends at y = 2.29)
/// and the corner.
#[test]
fn the_mirror_throws_its_spot_beside_the_door() {
    let landed = mirrored_once(&paper_room(), "lamp 2", "mirror");
    let beside = landed.iter().filter(|(o, at)| o == "wall x=5" && at.y > 2.29).count();
    assert!(beside >= 60, "{beside} of 100 rays land beside the door: {landed:?}");
}

/// Light of luminaire 1, thrown back by the flat of the leg that is turned to it, lands on the floor
/// and the bench near the foot.
#[test]
fn the_leg_throws_light_near_its_foot() {
    let landed = mirrored_once(&paper_room(), "lamp 1", "table leg");
    assert!(landed.len() >= 40, "{} of 100 places on the leg are lit", landed.len());
    let near = landed
        .iter()
        .filter(|(o, at)| matches!(o.as_str(), "floor" | "bench") && (at.x - 2.4).hypot(at.y - 1.75) < 0.9)
        .count();
    assert!(2 * near >= landed.len(), "{near} of {}: {landed:?}", landed.len());
}

#[test]
fn changes_keep_the_geometry_and_change_the_light() {
    let base = paper_room();
    let description = SceneDescription::read(&scenes("paper_room.toml")).expect("reads");
    for (file, specular) in [
        ("paper_room_diffuse.changes.toml", 0),
        ("paper_room_gold_to_sand.changes.toml", 2),
        ("paper_room_lamp_a.changes.toml", 6),
    ] {
        let changed = description.changed(&scenes(file)).expect(file);
        let appearance = changed.appearance(&base.geometry).expect(file);
        let scene = load_with_changes(&scenes("paper_room.toml"), &[scenes(file)]).expect(file);
        assert_eq!(scene.geometry.hash(), base.geometry.hash());
        assert_eq!(scene.appearance.surface_material, appearance.surface_material);
        assert_eq!(scene.appearance.materials, appearance.materials);
        assert_ne!(
            (&appearance.materials, &appearance.surface_material),
            (&base.appearance.materials, &base.appearance.surface_material)
        );
        let count = (0..134).filter(|&i| specular_share(&scene, i) > 0.0).count();
        assert_eq!(count, specular, "{file}");
    }
}

#[test]
fn the_cornell_box_is_the_measured_one() {
    let scene = load(&scenes("cornell_box.toml")).expect("the scene loads");
    // The left wall is the only warped quadrilateral: two triangles of one patch.
    let triangles: Vec<usize> = (0..scene.geometry.surfaces.len())
        .filter(|&i| matches!(scene.geometry.surfaces[i].shape, Shape::Triangle(_)))
        .collect();
    assert_eq!(triangles.len(), 2);
    assert_eq!(scene.geometry.patch[triangles[0]], scene.geometry.patch[triangles[1]]);
    assert_eq!(scene.notes.len(), 1);
    let n = divide_by_area(&scene.geometry, &scene.sampling).len();
    assert!((3000..=5000).contains(&n), "{n} points");
    // Through the open front every ray meets a front.
    let tracer = BruteForce::new(&scene.geometry);
    let camera = &scene.cameras[0];
    let mut fronts = 0;
    for i in 0..64 {
        for j in 0..64 {
            let ray = camera.ray(8.0 * f64::from(i) + 4.0, 8.0 * f64::from(j) + 4.0, scene.geometry.centre);
            if let Some(hit) = tracer.closest(&ray) {
                assert_eq!(hit.side, Side::Front);
                fronts += 1;
            }
        }
    }
    assert!(fronts > 3600, "{fronts} of 4096");
}

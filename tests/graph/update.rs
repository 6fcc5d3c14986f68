//! Does the graph of a scene in which objects moved, came or went have the bits of one built from nothing, and less work?

use luxgraph::error::Error;
use luxgraph::observer::Silent;
use luxgraph::pipeline::{self, Prepared};
use luxgraph::scene::{Scene, SceneDescription};
use luxgraph::settings::{Quality, Settings};
use luxgraph::tracers::{TracerChoice, choose};
use luxgraph::visibility::Edge;
use std::path::{Path, PathBuf};

/// The scene file `name`, with `sampling` instead of its own.
fn scene_file(folder: &Path, name: &str, sampling: &str) -> PathBuf {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let text = std::fs::read_to_string(shipped.join(name)).expect("it ships");
    let text = text.replace("spectra/", &format!("{}/", shipped.join("spectra").display()));
    let start = text.find("[sampling]").expect("it says how it is sampled");
    let end = start + text[start..].find("\n\n").expect("there is more");
    let path = folder.join(name);
    std::fs::write(&path, [&text[..start], "[sampling]\n", sampling, &text[end..]].concat())
        .expect("written");
    path
}

fn settings() -> Settings {
    Settings::preset(Quality::Standard)
}

fn prepare(scene: &Scene, choice: TracerChoice) -> Prepared {
    let tracer = choose(choice, &scene.geometry).expect("it is there");
    let (geometry, sampling) = (&scene.geometry, &scene.sampling);
    pipeline::prepare(geometry, sampling, &settings(), tracer.as_ref(), None, &Silent).expect("built")
}

/// The graph after `changes`, updated and from nothing; compares every bit.
fn update_and_compare(path: &Path, changes: &str, choice: TracerChoice) -> (Prepared, Prepared) {
    let description = SceneDescription::read(path).expect("reads");
    let scene = description.compile().expect("compiles");
    let file = path.with_extension("changes.toml");
    std::fs::write(&file, format!("format = 1\n{changes}")).expect("written");
    let changed = description.changed(&file).and_then(|d| d.compile_over(&scene)).expect("changes");
    let before = prepare(&scene, choice);
    let whole = prepare(&changed, choice);
    let tracer = choose(choice, &changed.geometry).expect("it is there");
    let updated = pipeline::prepare_changed(
        (&scene.geometry, &before),
        &changed.geometry,
        &changed.sampling,
        &settings(),
        tracer.as_ref(),
        &Silent,
    )
    .expect("updated");
    assert_eq!(whole.points.key, updated.points.key, "{changes}");
    let n = whole.points.len();
    let differ = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
    let differ = differ.filter(|&(i, j)| whole.graph.unblocked(i, j) != updated.graph.unblocked(i, j));
    assert_eq!(differ.count(), 0, "{changes}");
    let kind = |edge: Edge| match edge {
        Edge::Visible => 0,
        Edge::Hidden => 1,
        Edge::Partial(_) => 2,
    };
    for a in 0..whole.points.voxels() {
        for b in a..whole.points.voxels() {
            assert_eq!(kind(whole.graph.edge(a, b)), kind(updated.graph.edge(a, b)), "{changes}: {a} {b}");
        }
    }
    (updated, whole)
}

const CHAIR: &str = r#"
[[moves]]
objects = ["chair 1 seat", "chair 1 legs"]
rotate = { degrees = 35, about = [2.45, 2.48, 0] }
translate = [-0.9, 0.45, 0]
"#;
const VASE_GONE: &str = "remove = [\"vase\"]\n";
const BOX_COMES: &str = r#"
[[objects]]
name = "screen"
material = "brown stone"
max_area = 0.1
quads = [[[1.5, 1, 0.001], [1.5, 2, 0.001], [1.5, 2, 1.4], [1.5, 1, 1.4]]]
triangles = [[[1.4, 1, 0.001], [1.4, 2, 0.001], [1.4, 1.5, 1.4]]]
"#;

#[test]
fn a_graph_after_a_move_has_the_bits_of_a_new_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = scene_file(folder.path(), "paper_room.toml", "max_area = 0.1");
    let all = format!("{VASE_GONE}{CHAIR}{BOX_COMES}");
    for choice in [TracerChoice::Auto, TracerChoice::Voxel] {
        for (changes, known) in [(CHAIR, 0.65), (VASE_GONE, 0.9), (BOX_COMES, 0.7), (&all, 0.45)] {
            let (updated, whole) = update_and_compare(&path, changes, choice);
            let stats = &updated.graph.stats;
            assert!(stats.pairs == whole.graph.stats.pairs && whole.graph.stats.copied == 0);
            let share = stats.copied as f64 / stats.pairs as f64;
            assert!(share > known, "{changes}: {share}");
            assert!(stats.rays_cast <= whole.graph.stats.rays_cast, "{changes}");
        }
    }
}

#[test]
fn refined_points_keep_their_bits_too() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sampling = "max_area = 0.2\nrefine_solid_angle = 0.3";
    let path = scene_file(folder.path(), "paper_room.toml", sampling);
    update_and_compare(&path, CHAIR, TracerChoice::Auto);
}

#[test]
fn balls_and_discs_may_move() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = scene_file(folder.path(), "sphere_and_disc.toml", "max_area = 0.02");
    let text = std::fs::read_to_string(&path).expect("written before");
    let names: Vec<&str> = (text.split("[[objects]]").skip(1))
        .filter(|object| object.contains("spheres =") || object.contains("discs ="))
        .filter_map(|object| object.split('"').nth(1))
        .collect();
    assert!(names.len() >= 2, "{names:?}");
    for name in names {
        let changes = format!("[[moves]]\nobjects = [\"{name}\"]\ntranslate = [0.03, -0.02, 0.01]\n");
        update_and_compare(&path, &changes, TracerChoice::Auto);
        update_and_compare(&path, &format!("remove = [\"{name}\"]\n"), TracerChoice::Auto);
    }
}

#[test]
fn a_scene_of_another_size_is_built_anew() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = scene_file(folder.path(), "paper_room.toml", "max_area = 0.3");
    let out = "[[moves]]\nobjects = [\"vase\"]\ntranslate = [20, 0, 0]\n";
    let (updated, _) = update_and_compare(&path, out, TracerChoice::Auto);
    assert_eq!(updated.graph.stats.copied, 0);
}

/// (changes, line, word of the message)
#[test]
fn mistakes_in_moves_are_located() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = scene_file(folder.path(), "paper_room.toml", "max_area = 0.3");
    let description = SceneDescription::read(&path).expect("reads");
    let scene = description.compile().expect("compiles");
    let rotate = "[[moves]]\nobjects = [\"vase\"]\nrotate = ";
    let cases: &[(&str, usize, &str)] = &[
        ("remove = [\"vaze\"]", 2, "did you mean \"vase\""),
        ("remove = [\"vase\", \"vase\"]", 2, "was removed before"),
        ("[[moves]]\nobjects = [\"vase\"]", 3, "`translate` or `rotate`"),
        ("[[moves]]\nobjects = [\"vaze\"]\ntranslate = [1, 0, 0]", 3, "did you mean \"vase\""),
        ("[[moves]]\nobjects = [\"vase\"]\ntranslate = [nan, 0, 0]", 4, "finite"),
        ("[[moves]]\nobjects = [\"vase\"]\ntranslate = [1e19, 0, 0]", 4, "1e18"),
        ("[[moves]]\ntranslate = [1, 0, 0]", 2, "`objects` is missing"),
        ("[[moves]]\nobjects = [\"vase\"]\nturn = 3", 4, "unknown key `turn`"),
        (&format!("{rotate}{{ degrees = inf, about = [0, 0, 0] }}"), 4, "degrees"),
        (&format!("{rotate}{{ degrees = 3 }}"), 4, "`about` is missing"),
        (&format!("{rotate}{{ degrees = 3, about = [0, 0, 0], axis = [0, 0, 0] }}"), 4, "cannot be zero"),
        ("[[objects]]\nname = \"vase\"\nmaterial = \"sand\"", 3, "two objects \"vase\""),
        ("[[objects]]\nname = \"new\"\nmaterial = \"sandd\"", 4, "did you mean \"sand\""),
        ("[[objects]]\nname = \"new\"\nobj = \"none.obj\"", 4, "cannot read"),
        ("[materials.new]\nreflectance = 0.5", 2, "[[objects]]"),
    ];
    for (changes, line, word) in cases {
        let file = folder.path().join("c.toml");
        std::fs::write(&file, format!("format = 1\n{changes}\n")).expect("written");
        match description.changed(&file).and_then(|d| d.compile_over(&scene)) {
            Err(Error::Scene { path, line: at, message, .. }) => {
                assert!(
                    path.ends_with("c.toml") && at == *line && message.contains(word),
                    "{changes}: {at} {message}"
                );
            }
            Err(other) => panic!("{changes}: {other}"),
            Ok(_) => panic!("{changes}: accepted"),
        }
    }
}

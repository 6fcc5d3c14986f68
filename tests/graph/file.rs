//! Does a saved graph come back whole, or not at all?

use crate::rooms;
use glam::{DMat3, DVec3};
use luxgraph::error::{Error, Result};
use luxgraph::geometry::{Hit, Ray, SurfaceId};
use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::points::{SamplePoints, Sampling, request_key};
use luxgraph::scene::Geometry;
use luxgraph::settings::Settings;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::{RayTracer, Segment};
use luxgraph::visibility::file::{load, save};
use luxgraph::visibility::{GraphStats, VisibilityGraph};
use luxgraph::voxels::{VoxelSettings, Voxels};
use std::path::PathBuf;

const REQUEST: [u8; 32] = [7; 32];
/// Bytes before the elements.
const HEADER: usize = 108;

struct Saved {
    geometry: Geometry,
    points: SamplePoints,
    graph: VisibilityGraph,
    path: PathBuf,
    folder: tempfile::TempDir,
}

fn saved() -> Saved {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 1.0, 3);
    let graph = VisibilityGraph::build(&geometry, &points, &BruteForce::new(&geometry), &Silent).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.graph");
    save(&path, &REQUEST, &points, &graph).unwrap();
    Saved { geometry, points, graph, path, folder }
}

impl Saved {
    fn load(&self, request: &[u8; 32]) -> Result<(SamplePoints, VisibilityGraph)> {
        load(&self.path, request, &self.geometry, |elements| rooms::points(&self.geometry, elements, 3))
    }

    /// The message with which the file is refused when it holds `bytes`.
    fn refusal(&self, bytes: &[u8]) -> String {
        std::fs::write(&self.path, bytes).unwrap();
        refusal(self.load(&REQUEST))
    }
}

fn refusal(loaded: Result<(SamplePoints, VisibilityGraph)>) -> String {
    match loaded {
        Err(error @ Error::Graph { .. }) => {
            assert!(error.is_input());
            error.to_string()
        }
        other => panic!("{other:?}"),
    }
}

fn assert_same(points: &SamplePoints, graph: &VisibilityGraph, others: (&SamplePoints, &VisibilityGraph)) {
    assert_eq!(format!("{points:?}"), format!("{:?}", others.0));
    let other = others.1;
    assert_eq!(other.key(), graph.key());
    assert_eq!(GraphStats { build_s: graph.stats.build_s, ..other.stats.clone() }, graph.stats);
    for a in 0..graph.voxels() {
        for b in 0..=a {
            assert_eq!(other.edge(b, a), graph.edge(b, a));
        }
    }
    for i in 0..points.len() {
        for j in 0..points.len() {
            assert_eq!(other.unblocked(i, j), graph.unblocked(i, j));
        }
    }
}

#[test]
fn what_is_saved_is_what_is_loaded() {
    let saved = saved();
    let (points, graph) = saved.load(&REQUEST).unwrap();
    assert_same(&saved.points, &saved.graph, (&points, &graph));
    // Saved once more, it replaces the old file, is the same to the byte and leaves no other.
    let bytes = std::fs::read(&saved.path).unwrap();
    save(&saved.path, &REQUEST, &points, &graph).unwrap();
    assert_eq!(std::fs::read(&saved.path).unwrap(), bytes);
    assert_eq!(std::fs::read_dir(saved.folder.path()).unwrap().count(), 1);
}

/// Finds closest hits, which covered points are told by; must not be asked what a segment meets.
struct NoSegments<'a>(BruteForce<'a>);

impl RayTracer for NoSegments<'_> {
    fn name(&self) -> String {
        "no segments".into()
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.0.closest(ray)
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        panic!("{segment:?} was cast")
    }
}

#[test]
fn refined_points_are_loaded_with_their_graph_and_no_segment_is_cast() {
    // A room with a shelf close under its ceiling, which refinement divides.
    let mut scene = rooms::Furniture::default();
    scene.block(DVec3::ONE, DVec3::ONE, DMat3::IDENTITY, true);
    scene.block(DVec3::new(1.0, 1.0, 1.8), DVec3::new(0.4, 0.3, 0.02), DMat3::IDENTITY, false);
    let geometry = scene.geometry();
    let sampling = Sampling { refine_solid_angle: Some(1.0), ..Sampling::by_area(0.3) };
    let settings = Settings::default();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.graph");
    let prepare = |sampling: &Sampling, tracer: &dyn RayTracer| {
        pipeline::prepare(&geometry, sampling, &settings, tracer, Some(&path), &Silent)
    };
    let built = prepare(&sampling, &BruteForce::new(&geometry)).unwrap();
    let levels = || built.points.cell.iter().map(|c| c.level);
    assert!(!built.graph_loaded && levels().max() > levels().min(), "the points are refined in places");
    let no_segments = NoSegments(BruteForce::new(&geometry));
    let loaded = prepare(&sampling, &no_segments).unwrap();
    assert!(loaded.graph_loaded);
    assert_same(&built.points, &built.graph, (&loaded.points, &loaded.graph));

    // Whoever asks for something else is told so.
    let unrefined = Sampling { refine_solid_angle: None, ..sampling };
    let finer = Sampling { refine_solid_angle: Some(0.5), ..sampling };
    let smaller = Sampling { max_area: 0.2, ..sampling };
    for other in [unrefined, finer, smaller] {
        let error = prepare(&other, &no_segments).err().expect("another request").to_string();
        assert!(error.contains("another geometry or sampling"), "{error}");
    }
}

#[test]
fn any_flipped_bit_is_noticed() {
    let saved = saved();
    let bytes = std::fs::read(&saved.path).unwrap();
    let step = bytes.len() / 300;
    for place in (0..HEADER).chain((HEADER..bytes.len()).step_by(step)).chain(bytes.len() - 32..bytes.len()) {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1 << (place % 8);
        let message = saved.refusal(&damaged);
        assert!(message.contains("build") || message.contains("name another"), "{message}");
    }
}

#[test]
fn any_missing_or_added_byte_is_noticed() {
    let saved = saved();
    let bytes = std::fs::read(&saved.path).unwrap();
    for length in
        [0, 7, 8, 43, 75, 76, 107, HEADER, HEADER + 31, HEADER + 32, bytes.len() / 2, bytes.len() - 1]
    {
        assert!(saved.refusal(&bytes[..length]).contains("build the graph again"));
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(saved.refusal(&longer).contains("damaged"));
}

#[test]
fn sizes_that_lie_allocate_nothing() {
    let saved = saved();
    let bytes = std::fs::read(&saved.path).unwrap();
    for size in [u64::MAX, u64::MAX / 2, 1 << 62, 1 << 40] {
        for place in [76, 84, 92, 100] {
            let mut lying = bytes.clone();
            lying[place..place + 8].copy_from_slice(&size.to_le_bytes());
            assert!(saved.refusal(&lying).contains("damaged"));
        }
    }
}

/// `bytes` with a checksum that is right for them.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len() - 32;
    let hash = blake3::hash(&bytes[..end]);
    bytes[end..].copy_from_slice(hash.as_bytes());
    bytes
}

#[test]
fn elements_that_lie_are_refused_though_the_checksum_is_right() {
    let saved = saved();
    let bytes = std::fs::read(&saved.path).unwrap();
    assert_eq!(sealed(bytes.clone()), bytes);
    // Surface, path and level of the first element; each time another element, or none.
    for (place, value) in [(0, 63), (3, 255), (4, 255), (7, 255), (8, 17), (8, 255), (8, 0)] {
        let mut lying = bytes.clone();
        assert_ne!(lying[HEADER + place], value);
        lying[HEADER + place] = value;
        let message = saved.refusal(&sealed(lying));
        assert!(message.contains("damaged") && message.contains("elements"), "{message}");
    }
    // The first element twice.
    let mut lying = bytes.clone();
    lying.copy_within(HEADER..HEADER + 9, HEADER + 9);
    assert!(saved.refusal(&sealed(lying)).contains("sample points"));
}

#[test]
fn other_versions_files_and_scenes_are_named() {
    let saved = saved();
    let bytes = std::fs::read(&saved.path).unwrap();
    assert!(refusal(saved.load(&[8; 32])).contains("another geometry or sampling"));
    for version in [2, 4] {
        let mut other = bytes.clone();
        other[8] = version;
        assert!(saved.refusal(&other).contains(&format!("version {version}")));
    }
    assert!(saved.refusal(&[b'x'; 1000]).contains("not a visibility graph"));
    std::fs::remove_file(&saved.path).unwrap();
    assert!(matches!(saved.load(&REQUEST), Err(Error::Io { .. })));
}

#[test]
fn a_request_is_told_from_its_thresholds() {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 1.0, 3);
    let plain = Sampling::by_area(1.0);
    let refined = Sampling { refine_solid_angle: Some(0.5), ..plain };
    let others = [
        plain,
        refined,
        Sampling { refine_solid_angle: Some(0.4), ..plain },
        Sampling { max_area: 1.01, ..refined },
        Sampling { max_level: 3, ..refined },
    ];
    let voxels = |max_level| Voxels::build(&geometry, &VoxelSettings { max_objects: 5, max_level });
    let (coarse, fine) = (voxels(3), voxels(4));
    let keys = others.map(|sampling| request_key(&geometry, &sampling, &coarse, &points));
    for (i, key) in keys.iter().enumerate() {
        assert!(!keys[..i].contains(key), "{i}");
    }
    let smaller = rooms::sample(&geometry, 0.5, 3);
    assert_ne!(request_key(&geometry, &plain, &coarse, &smaller), keys[0]);
    assert_ne!(request_key(&geometry, &plain, &fine, &points), keys[0]);
    assert_eq!(request_key(&geometry, &plain, &coarse, &points), keys[0]);
}

#[test]
fn a_folder_that_is_not_there_is_an_error_of_the_system() {
    let Saved { points, graph, folder, .. } = saved();
    let nowhere = folder.path().join("no").join("room.graph");
    assert!(matches!(save(&nowhere, &REQUEST, &points, &graph), Err(Error::Io { .. })));
    assert!(matches!(save("/", &REQUEST, &points, &graph), Err(Error::Io { .. })));
    assert!(!nowhere.exists());
}

#[test]
fn a_graph_is_saved_with_its_own_points_only() {
    let Saved { geometry, graph, folder, .. } = saved();
    let finer = rooms::sample(&geometry, 0.5, 3);
    let path = folder.path().join("other.graph");
    assert!(matches!(save(&path, &REQUEST, &finer, &graph), Err(Error::Settings(_))));
    assert!(!path.exists());
}

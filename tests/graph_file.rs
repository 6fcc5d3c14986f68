//! Does a saved graph come back whole, or not at all?

#[path = "support/rooms.rs"]
mod rooms;

use luxgraph::error::Error;
use luxgraph::observer::Silent;
use luxgraph::points::SamplePoints;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::visibility::{GraphStats, VisibilityGraph};
use std::path::{Path, PathBuf};

struct Saved {
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
    graph.save(&path).unwrap();
    Saved { points, graph, path, folder }
}

/// The message with which a file is refused.
fn refusal(path: &Path, points: &SamplePoints) -> String {
    match VisibilityGraph::load(path, points) {
        Err(error @ Error::Graph { .. }) => {
            assert!(error.is_input());
            error.to_string()
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_is_saved_is_what_is_loaded() {
    let Saved { points, graph, path, folder } = saved();
    let loaded = VisibilityGraph::load(&path, &points).unwrap();
    assert_eq!(loaded.key(), graph.key());
    assert_eq!(GraphStats { build_s: graph.stats.build_s, ..loaded.stats.clone() }, graph.stats);
    for a in 0..graph.voxels() {
        for b in 0..=a {
            assert_eq!(loaded.edge(b, a), graph.edge(b, a));
        }
    }
    for i in 0..points.len() {
        for j in 0..points.len() {
            assert_eq!(loaded.unblocked(i, j), graph.unblocked(i, j));
        }
    }
    // Saved once more, it replaces the old file, is the same to the byte and leaves no other.
    let bytes = std::fs::read(&path).unwrap();
    loaded.save(&path).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn any_flipped_bit_is_noticed() {
    let Saved { points, path, folder: _folder, .. } = saved();
    let bytes = std::fs::read(&path).unwrap();
    let step = bytes.len() / 300;
    for place in (0..76).chain((76..bytes.len()).step_by(step)).chain(bytes.len() - 32..bytes.len()) {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1 << (place % 8);
        std::fs::write(&path, &damaged).unwrap();
        let message = refusal(&path, &points);
        assert!(message.contains("build") || message.contains("name another"), "{message}");
    }
}

#[test]
fn any_missing_or_added_byte_is_noticed() {
    let Saved { points, path, folder: _folder, .. } = saved();
    let bytes = std::fs::read(&path).unwrap();
    for length in [0, 7, 8, 43, 75, 76, 107, 108, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        assert!(refusal(&path, &points).contains("build the graph again"));
    }
    let mut longer = bytes.clone();
    longer.push(0);
    std::fs::write(&path, &longer).unwrap();
    assert!(refusal(&path, &points).contains("damaged"));
}

#[test]
fn sizes_that_lie_allocate_nothing() {
    let Saved { points, path, folder: _folder, .. } = saved();
    let bytes = std::fs::read(&path).unwrap();
    for size in [u64::MAX, u64::MAX / 2, 1 << 62, 1 << 40] {
        for place in [44, 52, 60] {
            let mut lying = bytes.clone();
            lying[place..place + 8].copy_from_slice(&size.to_le_bytes());
            std::fs::write(&path, &lying).unwrap();
            assert!(refusal(&path, &points).contains("damaged"));
        }
    }
}

#[test]
fn other_versions_files_and_scenes_are_named() {
    let Saved { points, path, folder, .. } = saved();
    let bytes = std::fs::read(&path).unwrap();

    let geometry = rooms::furnished_room(false);
    let finer = rooms::sample(&geometry, 0.5, 3);
    assert!(refusal(&path, &finer).contains("another geometry or sampling"));

    let mut newer = bytes.clone();
    newer[8] = 2;
    std::fs::write(&path, &newer).unwrap();
    assert!(refusal(&path, &points).contains("version 2"));

    std::fs::write(&path, vec![b'x'; 1000]).unwrap();
    assert!(refusal(&path, &points).contains("not a visibility graph"));

    let missing = VisibilityGraph::load(folder.path().join("none"), &points);
    assert!(matches!(missing, Err(Error::Io { .. })));
}

#[test]
fn a_folder_that_is_not_there_is_an_error_of_the_system() {
    let Saved { graph, folder, .. } = saved();
    let nowhere = folder.path().join("no").join("room.graph");
    assert!(matches!(graph.save(&nowhere), Err(Error::Io { .. })));
    assert!(matches!(graph.save("/"), Err(Error::Io { .. })));
}

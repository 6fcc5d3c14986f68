//! How much a glTF file lists, counted before room is made for it: an entry of three bytes of JSON becomes a structure of
//! two thousand.

use serde::Deserialize;
use serde::de::IgnoredAny;

/// More of what is small, and of what is large, are refused.
const MOST: usize = 1_000_000;
const MOST_MATERIALS: usize = 50_000;

/// The lists of a file. What is ignored takes no memory.
#[derive(Deserialize, Default)]
#[serde(default)]
struct Lists {
    accessors: Vec<IgnoredAny>,
    #[serde(rename = "bufferViews")]
    buffer_views: Vec<IgnoredAny>,
    buffers: Vec<IgnoredAny>,
    cameras: Vec<IgnoredAny>,
    images: Vec<IgnoredAny>,
    materials: Vec<IgnoredAny>,
    meshes: Vec<IgnoredAny>,
    nodes: Vec<IgnoredAny>,
    samplers: Vec<IgnoredAny>,
    scenes: Vec<IgnoredAny>,
    textures: Vec<IgnoredAny>,
}

/// Refuses JSON that lists too much. What is no such JSON is left to the parser.
pub fn check(json: &[u8]) -> Result<(), String> {
    let Ok(lists) = serde_json::from_slice::<Lists>(json) else { return Ok(()) };
    let counts = [
        ("accessors", lists.accessors.len(), MOST),
        ("bufferViews", lists.buffer_views.len(), MOST),
        ("buffers", lists.buffers.len(), MOST),
        ("cameras", lists.cameras.len(), MOST),
        ("images", lists.images.len(), MOST),
        ("materials", lists.materials.len(), MOST_MATERIALS),
        ("meshes", lists.meshes.len(), MOST),
        ("nodes", lists.nodes.len(), MOST),
        ("samplers", lists.samplers.len(), MOST),
        ("scenes", lists.scenes.len(), MOST),
        ("textures", lists.textures.len(), MOST),
    ];
    match counts.iter().find(|(_, count, most)| count > most) {
        Some((name, count, most)) => {
            Err(format!("there are {count} {name}, more than {most}; export fewer, or the scene in parts"))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_refused_by_name() {
        let of = |count: usize| format!("{{\"materials\":[{}{{}}]}}", "{},".repeat(count - 1)).into_bytes();
        assert_eq!(check(&of(MOST_MATERIALS)), Ok(()));
        let error = check(&of(MOST_MATERIALS + 1)).expect_err("too many");
        assert!(error.contains("50001 materials"), "{error}");
        assert_eq!(check(b"no JSON"), Ok(()));
    }
}

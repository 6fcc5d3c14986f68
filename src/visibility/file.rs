//! The graph on disk, with the elements of the points it was built for.
//!
//! Little-endian, in this order: the magic `LUXGRAPH`; the version (`u32`); the key of the request
//! and that of the sample points (32 bytes each); the numbers of voxels, of elements, of words and
//! of bytes of the statistics (`u64` each); the elements, each as surface (`u32`), path (`u32`) and
//! level (`u8`) of its cell; the first point of each voxel and their number (`u32`); one byte for
//! each edge (0 visible, 1 hidden, 2 partial, and 4 more if rays were cast for it); the words of the partial edges in
//! the order of the edges (`u32`); the statistics (JSON); and the BLAKE3 hash of all that (32 bytes). Where a partial
//! edge's words begin follows from the sizes of the voxels, so no offset can be wrong.
//!
//! Refinement (4.2.2) makes points that only the graph itself can tell. So a file answers to the
//! key of what was asked for ([`request_key`](crate::points::request_key)), and the points are made
//! again from the elements.

use super::graph::{Edge, VisibilityGraph, edge_index, stride_of};
use super::stats::GraphStats;
use crate::atomic_file;
use crate::error::{Error, Result};
use crate::geometry::SurfaceId;
use crate::points::{Cell, Element, SamplePoints};
use crate::scene::Geometry;
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"LUXGRAPH";
const VERSION: u32 = 3;
/// Magic, version, two keys and four sizes.
const HEADER: u64 = 8 + 4 + 2 * 32 + 4 * 8;
/// Surface, path and level.
const ELEMENT: usize = 4 + 4 + 1;
const HASH: u64 = 32;
/// Added to the kind of an edge for which rays were cast.
const CAST: u8 = 4;
/// Words converted at a time.
const BLOCK: usize = 1 << 14;

/// Writes the graph of `points` to `path` as the answer to the request with the key `request`; the
/// file appears whole or not at all.
///
/// # Errors
/// [`Error::Settings`] when the graph is not that of the points; [`Error::Io`] when the folder
/// cannot be written or the disk is full.
pub fn save(
    path: impl AsRef<Path>,
    request: &[u8; 32],
    points: &SamplePoints,
    graph: &VisibilityGraph,
) -> Result<()> {
    if graph.key != points.key {
        return Err(Error::Settings("a graph can be saved with the points it was built for only".into()));
    }
    atomic_file::write_with(path.as_ref(), |file| {
        graph.put(request, &points.elements(), BufWriter::new(&mut *file))?;
        file.sync_all()
    })
}

/// Reads what [`save`] wrote for the same `request`: the points, which `rebuild` makes of their
/// elements (of `geometry`) as it did for the saved graph, and the graph. What point lights reach is
/// still to be found out ([`VisibilityGraph::look_at_lights`]).
///
/// # Errors
/// [`Error::Io`] when the file cannot be read; [`Error::Graph`] when it is no graph, damaged, of
/// another version, or of another scene, sampling or division into voxels.
pub fn load(
    path: impl AsRef<Path>,
    request: &[u8; 32],
    geometry: &Geometry,
    rebuild: impl FnOnce(&[Element]) -> SamplePoints,
) -> Result<(SamplePoints, VisibilityGraph)> {
    let path = path.as_ref();
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
    let reader = Reader { path, input: Hashed::new(BufReader::new(file)), length };
    reader.read(request, geometry.surfaces.len(), rebuild)
}

impl VisibilityGraph {
    fn put(&self, request: &[u8; 32], elements: &[Element], out: impl Write) -> io::Result<()> {
        let stats = serde_json::to_vec(&self.stats)?;
        let mut out = Hashed::new(out);
        let words: usize = (0..self.voxels()).map(|b| self.words_of_edges_to(b)).sum();
        out.put(MAGIC)?;
        out.put(&VERSION.to_le_bytes())?;
        out.put(request)?;
        out.put(&self.key)?;
        for size in [self.voxels(), elements.len(), words, stats.len()] {
            out.put(&(size as u64).to_le_bytes())?;
        }
        for (surface, cell) in elements {
            out.put(&surface.0.to_le_bytes())?;
            out.put(&cell.path.to_le_bytes())?;
            out.put(&[cell.level])?;
        }
        out.put_words(&self.starts)?;
        let kind = |(edge, cast): (&Edge, &bool)| kind_of(*edge) + CAST * u8::from(*cast);
        let kinds: Vec<u8> = self.edges.iter().zip(&self.cast).map(kind).collect();
        out.put(&kinds)?;
        for b in 0..self.voxels() {
            for a in 0..=b {
                if let Edge::Partial(first) = self.edge(a, b) {
                    let first = first as usize;
                    out.put_words(&self.words[first..first + self.tile_words(a, b)])?;
                }
            }
        }
        out.put(&stats)?;
        let hash = *out.hasher.finalize().as_bytes();
        out.inner.write_all(&hash)?;
        out.inner.flush()
    }

    /// Words of the tile of voxels `a <= b`.
    fn tile_words(&self, a: usize, b: usize) -> usize {
        self.voxel(a).len() * stride_of(self.voxel(b).len())
    }

    /// Words of all partial edges between `b` and voxels up to it.
    fn words_of_edges_to(&self, b: usize) -> usize {
        let partial = |a: &usize| matches!(self.edge(*a, b), Edge::Partial(_));
        (0..=b).filter(partial).map(|a| self.tile_words(a, b)).sum()
    }
}

fn kind_of(edge: Edge) -> u8 {
    match edge {
        Edge::Visible => 0,
        Edge::Hidden => 1,
        Edge::Partial(_) => 2,
    }
}

/// The word in the first four of `bytes`.
fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// The element in [`ELEMENT`] bytes.
fn element(bytes: &[u8]) -> Element {
    (SurfaceId(word(bytes)), Cell { path: word(&bytes[4..]), level: bytes[8] })
}

/// Hashes all that passes.
struct Hashed<T> {
    inner: T,
    hasher: blake3::Hasher,
}

impl<T> Hashed<T> {
    fn new(inner: T) -> Self {
        Hashed { inner, hasher: blake3::Hasher::new() }
    }
}

impl<T: Write> Hashed<T> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.inner.write_all(bytes)
    }

    fn put_words(&mut self, words: &[u32]) -> io::Result<()> {
        let mut bytes = Vec::with_capacity(4 * words.len().min(BLOCK));
        for block in words.chunks(BLOCK) {
            bytes.clear();
            bytes.extend(block.iter().flat_map(|w| w.to_le_bytes()));
            self.put(&bytes)?;
        }
        Ok(())
    }
}

/// Reads and doubts.
struct Reader<'a> {
    path: &'a Path,
    input: Hashed<BufReader<File>>,
    /// Of the file, bytes.
    length: u64,
}

impl Reader<'_> {
    fn read(
        mut self,
        request: &[u8; 32],
        surfaces: usize,
        rebuild: impl FnOnce(&[Element]) -> SamplePoints,
    ) -> Result<(SamplePoints, VisibilityGraph)> {
        if self.length < HEADER + HASH {
            return Err(self.damaged("it is too short"));
        }
        if self.array::<8>()? != *MAGIC {
            return Err(self.refused("this is not a visibility graph; name another file"));
        }
        let version = u32::from_le_bytes(self.array()?);
        if version != VERSION {
            return Err(self.refused(&format!(
                "the graph has format version {version}, this program reads version {VERSION}; \
                 delete the file and build the graph again"
            )));
        }
        let [answers, key] = [self.array()?, self.array()?];
        let [voxels, elements, words, stats] = [self.size()?, self.size()?, self.size()?, self.size()?];
        // Sizes are checked against the file before anything is allocated for them.
        let edges = voxels.checked_add(1).and_then(|v| voxels.checked_mul(v)).map(|e| e / 2);
        let total = edges.and_then(|edges| {
            let starts = voxels.checked_add(1)?.checked_mul(4)?;
            let words = words.checked_mul(4)?;
            let elements = elements.checked_mul(ELEMENT as u64)?;
            [elements, starts, edges, words, stats, HASH].iter().try_fold(HEADER, |t, s| t.checked_add(*s))
        });
        if total != Some(self.length) {
            return Err(self.damaged("its length is not what its header says"));
        }
        if answers != *request {
            return Err(self.refused(
                "the graph was built for another geometry or sampling; build it again for this scene, \
                 or name the scene it belongs to",
            ));
        }
        let elements = self.bytes(ELEMENT * elements as usize)?;
        let starts = self.words(voxels as usize + 1)?;
        let kinds = self.bytes(edges.unwrap_or(0) as usize)?;
        let bits = self.words(words as usize)?;
        let stats = self.bytes(stats as usize)?;
        let hash = *self.input.hasher.finalize().as_bytes();
        if self.array::<32>()? != hash {
            return Err(self.damaged("its checksum does not match"));
        }
        // From here on only a file that was made to deceive can be wrong, and it must not panic.
        let elements: Vec<Element> = elements.chunks_exact(ELEMENT).map(element).collect();
        if !elements.iter().all(|(surface, cell)| surface.index() < surfaces && cell.is_valid()) {
            return Err(self.damaged("its elements are not elements of the scene"));
        }
        let points = rebuild(&elements);
        if key != points.key || starts != points.voxel_starts {
            return Err(self.damaged("its sample points are not those of its elements"));
        }
        let Ok(stats) = serde_json::from_slice::<GraphStats>(&stats) else {
            return Err(self.damaged("its statistics cannot be read"));
        };
        let mut graph = VisibilityGraph {
            starts,
            edges: Vec::new(),
            cast: kinds.iter().map(|kind| kind & CAST != 0).collect(),
            words: bits,
            key,
            lights: Default::default(),
            stats,
        };
        if !graph.place_edges(&kinds) {
            return Err(self.damaged("its edges do not fit its bits"));
        }
        Ok((points, graph))
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.input.inner.read_exact(&mut bytes).map_err(|e| Error::io(self.path, e))?;
        self.input.hasher.update(&bytes);
        Ok(bytes)
    }

    fn size(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn bytes(&mut self, count: usize) -> Result<Vec<u8>> {
        let mut bytes = vec![0; count];
        self.input.inner.read_exact(&mut bytes).map_err(|e| Error::io(self.path, e))?;
        self.input.hasher.update(&bytes);
        Ok(bytes)
    }

    fn words(&mut self, count: usize) -> Result<Vec<u32>> {
        let mut words = Vec::with_capacity(count);
        while words.len() < count {
            let block = self.bytes(4 * (count - words.len()).min(BLOCK))?;
            words.extend(block.chunks_exact(4).map(word));
        }
        Ok(words)
    }

    fn refused(&self, message: &str) -> Error {
        Error::Graph { path: PathBuf::from(self.path), message: message.into() }
    }

    fn damaged(&self, how: &str) -> Error {
        self.refused(&format!("the graph file is damaged ({how}); delete it and build the graph again"))
    }
}

impl VisibilityGraph {
    /// Makes edges of their kinds; their bits follow one another. False when they do not fit.
    fn place_edges(&mut self, kinds: &[u8]) -> bool {
        let mut next = 0usize;
        let voxels = self.voxels();
        self.edges.reserve_exact(kinds.len());
        for b in 0..voxels {
            for a in 0..=b {
                self.edges.push(match kinds[edge_index(a, b)] & !CAST {
                    0 => Edge::Visible,
                    1 => Edge::Hidden,
                    2 => {
                        let first = next as u64;
                        next += self.tile_words(a, b);
                        Edge::Partial(first)
                    }
                    _ => return false,
                });
            }
        }
        next == self.words.len()
    }
}

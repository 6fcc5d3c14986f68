//! The graph as it is stored and read.

use super::lights::LightSight;
use super::stats::GraphStats;
use super::transpose::transpose;
use crate::points::SamplePoints;

/// What two voxels see of each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// Nothing stands between any two facing points.
    Visible,
    /// No two facing points see each other.
    Hidden,
    /// A bit for every pair; the number is the first word of the tile.
    Partial(u64),
}

/// h_ij for all pairs of sample points. Facing is geometric and not stored: a set bit says that
/// nothing stands between the two points, *if* they face each other.
#[derive(Clone, Debug, Default)]
pub struct VisibilityGraph {
    pub(super) starts: Vec<u32>,
    pub(super) edges: Vec<Edge>,
    /// By edge: whether rays were cast for it. What they say of segments that graze something is a matter of rounding.
    pub(super) cast: Vec<bool>,
    pub(super) words: Vec<u32>,
    pub(super) key: [u8; 32],
    pub(super) lights: LightSight,
    /// How the graph was built.
    pub stats: GraphStats,
}

/// The bits between the points of voxel a (rows) and those of voxel b (columns).
#[derive(Clone, Copy, Debug)]
pub enum Tile<'a> {
    /// All bits are set.
    Visible,
    /// No bit is set.
    Hidden,
    /// Row `r` is `words[r * stride..(r + 1) * stride]`, column `c` is bit `c % 32` of word `c / 32`.
    Bits {
        /// All rows.
        words: &'a [u32],
        /// Words of a row.
        stride: usize,
    },
}

impl Tile<'_> {
    /// The bit of row `r`, column `c`.
    pub fn get(&self, r: usize, c: usize) -> bool {
        match self {
            Tile::Visible => true,
            Tile::Hidden => false,
            Tile::Bits { words, stride } => words[r * stride + c / 32] >> (c % 32) & 1 == 1,
        }
    }
}

/// Place of the edge between voxels `a <= b` in the linear array of edges.
pub(super) fn edge_index(a: usize, b: usize) -> usize {
    b * (b + 1) / 2 + a
}

/// Words that a row of `n` bits takes.
pub(super) fn stride_of(n: usize) -> usize {
    n.div_ceil(32)
}

impl VisibilityGraph {
    /// A graph from a predicate over point pairs `i < j`: for tests and small references.
    pub fn from_fn(points: &SamplePoints, sees: impl Fn(usize, usize) -> bool) -> Self {
        let voxels = points.voxels();
        let mut graph = VisibilityGraph {
            starts: points.voxel_starts.clone(),
            edges: Vec::with_capacity(voxels * (voxels + 1) / 2),
            cast: vec![true; voxels * (voxels + 1) / 2],
            words: Vec::new(),
            key: points.key,
            lights: LightSight::default(),
            stats: GraphStats::default(),
        };
        for b in 0..voxels {
            for a in 0..=b {
                let (rows, columns) = (points.voxel(a), points.voxel(b));
                graph.edges.push(Edge::Partial(graph.words.len() as u64));
                for i in rows {
                    let mut row = vec![0u32; stride_of(columns.len())];
                    for (c, j) in columns.clone().enumerate() {
                        let seen = i != j && sees(i.min(j), i.max(j));
                        row[c / 32] |= u32::from(seen) << (c % 32);
                    }
                    graph.words.extend(row);
                }
            }
        }
        graph
    }

    /// The key of the sample points that the graph was built for ([`SamplePoints::key`]).
    pub fn key(&self) -> &[u8; 32] {
        &self.key
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The points of voxel `v`.
    pub fn voxel(&self, v: usize) -> std::ops::Range<usize> {
        self.starts[v] as usize..self.starts[v + 1] as usize
    }

    /// The edge between two voxels, in either order.
    pub fn edge(&self, a: usize, b: usize) -> Edge {
        self.edges[edge_index(a.min(b), a.max(b))]
    }

    /// Whether rays were cast for the edge between two voxels.
    pub(super) fn was_cast(&self, a: usize, b: usize) -> bool {
        self.cast[edge_index(a.min(b), a.max(b))]
    }

    /// The tile with the points of `a` as rows and of `b` as columns. `scratch` holds the bits
    /// when the stored tile is the other way round.
    pub fn tile<'s>(&'s self, a: usize, b: usize, scratch: &'s mut Vec<u32>) -> Tile<'s> {
        let first = match self.edge(a, b) {
            Edge::Visible => return Tile::Visible,
            Edge::Hidden => return Tile::Hidden,
            Edge::Partial(first) => first as usize,
        };
        let (rows, columns) = (self.voxel(a).len(), self.voxel(b).len());
        let stride = stride_of(columns);
        if a <= b {
            return Tile::Bits { words: &self.words[first..first + rows * stride], stride };
        }
        let stored = &self.words[first..first + columns * stride_of(rows)];
        transpose(stored, columns, rows, scratch);
        Tile::Bits { words: scratch, stride }
    }

    /// Whether nothing stands between points `i` and `j`; facing is the caller's to test.
    pub fn unblocked(&self, i: usize, j: usize) -> bool {
        let (i, j) = (i.min(j), i.max(j));
        let (a, b) = (self.voxel_of(i), self.voxel_of(j));
        let (r, c) = (i - self.voxel(a).start, j - self.voxel(b).start);
        match self.edge(a, b) {
            Edge::Visible => true,
            Edge::Hidden => false,
            Edge::Partial(first) => {
                let word = first as usize + r * stride_of(self.voxel(b).len()) + c / 32;
                self.words[word] >> (c % 32) & 1 == 1
            }
        }
    }

    /// The voxel that holds point `i`.
    pub(super) fn voxel_of(&self, i: usize) -> usize {
        self.starts.partition_point(|&s| s as usize <= i) - 1
    }

    /// Memory the graph takes, bytes.
    pub fn memory_bytes(&self) -> u64 {
        (self.words.len() * 4 + self.edges.len() * (size_of::<Edge>() + 1) + self.starts.len() * 4) as u64
    }
}

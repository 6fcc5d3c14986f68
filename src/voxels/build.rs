//! Recursive halving of the scene's box.

use super::overlap::{round_meets_box, triangle_meets_box};
use super::{MAX_LEVEL, PADDING, VOXEL_BITS, VoxelSettings, Voxels};
use crate::geometry::{Aabb, Surface, SurfaceId};
use crate::scene::Geometry;
use glam::DVec3;

/// Halving stops when the lists of surfaces of all voxels together would be longer than this, or
/// than [`ENTRIES_PER_SURFACE`] for each surface if that is more: large surfaces that overlap meet
/// more voxels at each level, and no depth would thin them out.
const MAX_ENTRIES: usize = 1 << 21;

/// See [`MAX_ENTRIES`].
const ENTRIES_PER_SURFACE: usize = 32;

/// What voxels hold: a surface, or one of the parts that rays are asked of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    /// The surface.
    pub surface: SurfaceId,
    /// The box around the part.
    pub bounds: Aabb,
    /// Whether it is all of the surface.
    pub is_whole: bool,
}

/// A voxel while it may still be halved.
struct Node {
    level: u8,
    /// Halves taken, one bit a level, the last in the lowest bit.
    path: u32,
    /// Place along each axis among the nodes of its level.
    place: [u32; 3],
    surfaces: Vec<u32>,
}

/// The box and the axis that each level halves.
struct Frame {
    min: DVec3,
    size: DVec3,
    axes: Vec<usize>,
    pad: f64,
}

impl Frame {
    fn new(bounds: Aabb, max_level: u8) -> Self {
        let diagonal = bounds.size().length();
        let usable = diagonal.is_finite() && bounds.min.cmple(bounds.max).all();
        let (bounds, diagonal) =
            if usable { (bounds, diagonal) } else { (Aabb { min: DVec3::ZERO, max: DVec3::ZERO }, 0.0) };
        // A scene that is one place still has a box with an inside.
        let pad = (PADDING * diagonal).max(1e-30);
        // The box reaches twice as far as a voxel listens: all surfaces lie well inside, and a
        // planar scene gets a thickness.
        let min = bounds.min - 2.0 * pad;
        let size = bounds.max + 2.0 * pad - min;
        let mut rest = size;
        let axes = (0..max_level.min(MAX_LEVEL))
            .map(|_| {
                let axis = (0..3).fold(0, |best, a| if rest[a] > rest[best] { a } else { best });
                rest[axis] *= 0.5;
                axis
            })
            .collect();
        Frame { min, size, axes, pad }
    }

    /// How often the first `level` levels halve each axis.
    fn halvings(&self, level: u8) -> [u32; 3] {
        [0, 1, 2].map(|a| self.axes[..level as usize].iter().filter(|&&x| x == a).count() as u32)
    }

    /// Plane `i` of `2^halvings + 1` along `axis`: the same bits whatever level asks.
    fn plane(&self, axis: usize, i: u32, halvings: u32) -> f64 {
        self.min[axis] + self.size[axis] * (f64::from(i) / f64::from(1u32 << halvings))
    }

    fn bounds(&self, node: &Node) -> Aabb {
        let halvings = self.halvings(node.level);
        let corner = |end: u32| {
            let [x, y, z] = [0, 1, 2].map(|a| self.plane(a, node.place[a] + end, halvings[a]));
            DVec3::new(x, y, z)
        };
        Aabb { min: corner(0), max: corner(1) }
    }

    /// The two halves of `node`, each with the parts of `node` that meet it.
    fn halve(&self, node: &Node, geometry: &Geometry, parts: &[Part]) -> [Node; 2] {
        let axis = self.axes[node.level as usize];
        let mut halves = [0, 1].map(|side| {
            let mut place = node.place;
            place[axis] = 2 * place[axis] + side;
            Node { level: node.level + 1, path: node.path << 1 | side, place, surfaces: Vec::new() }
        });
        let bounds = [self.bounds(&halves[0]), self.bounds(&halves[1])];
        let middle = bounds[0].max[axis];
        for &s in &node.surfaces {
            let part = &parts[s as usize];
            let span = part.bounds;
            let reaches = [span.min[axis] <= middle + self.pad, span.max[axis] >= middle - self.pad];
            for side in 0..2 {
                // What meets the whole and keeps to one side meets that half.
                let straddles = reaches[1 - side];
                if reaches[side] && (!straddles || self.meets(geometry, part, &bounds[side])) {
                    halves[side].surfaces.push(s);
                }
            }
        }
        halves
    }

    fn meets(&self, geometry: &Geometry, part: &Part, voxel: &Aabb) -> bool {
        let surface = geometry.surface(part.surface);
        let (triangles, count) = surface.triangles();
        let half = 0.5 * voxel.size() + self.pad;
        match surface.round() {
            Some(round) if part.is_whole => return round_meets_box(round, voxel.centre(), half),
            Some(_) => {
                let apart = (part.bounds.centre() - voxel.centre()).abs() - 0.5 * part.bounds.size();
                return apart.cmple(half).all();
            }
            None => {}
        }
        triangles[..count].iter().any(|t| triangle_meets_box(t, voxel.centre(), half))
    }
}

impl Voxels {
    /// Halves the box of the scene, each time across its longest side (the first of equal ones),
    /// until at most `max_objects` surfaces meet each voxel or `max_level` is reached (section
    /// 4.1). The box and the voxels' reach are padded by [`PADDING`]. Takes O(n log n) for surfaces
    /// that are small against the scene.
    pub fn build(geometry: &Geometry, settings: &VoxelSettings) -> Voxels {
        let whole = |(i, surface): (usize, &Surface)| Part {
            surface: SurfaceId(i as u32),
            bounds: surface.bounds(),
            is_whole: true,
        };
        Self::of_parts(
            geometry,
            &geometry.surfaces.iter().enumerate().map(whole).collect::<Vec<_>>(),
            settings,
        )
    }

    /// [`Voxels::build`] over parts of surfaces; the voxels then hold the numbers of parts.
    pub(crate) fn of_parts(geometry: &Geometry, parts: &[Part], settings: &VoxelSettings) -> Voxels {
        let frame = Frame::new(geometry.bounds(), settings.max_level);
        let limit = MAX_ENTRIES.max(ENTRIES_PER_SURFACE * parts.len());
        let all = (0..parts.len() as u32).collect();
        let mut leaves = vec![Node { level: 0, path: 0, place: [0; 3], surfaces: all }];
        // Level by level, so that the limit on the lists falls on all places alike.
        for level in 0..frame.axes.len() as u8 {
            let entries: usize = leaves.iter().map(|n| n.surfaces.len()).sum();
            let open = |n: &Node| n.level == level && n.surfaces.len() > settings.max_objects;
            if entries > limit || !leaves.iter().any(open) {
                break;
            }
            let mut next = Vec::with_capacity(leaves.len() + leaves.len() / 2);
            for node in leaves {
                if open(&node) {
                    next.extend(frame.halve(&node, geometry, parts));
                } else {
                    next.push(node);
                }
            }
            leaves = next;
        }
        Self::from_leaves(&frame, leaves)
    }

    fn from_leaves(frame: &Frame, mut leaves: Vec<Node>) -> Voxels {
        leaves.sort_by_key(|n| u64::from(n.path) << (MAX_LEVEL - n.level));
        let level = leaves.iter().map(|n| n.level).max().unwrap_or(0);
        let finest = frame.halvings(level);
        let planes = [0, 1, 2]
            .map(|a| (0..=1u32 << finest[a]).map(|i| frame.plane(a, i, finest[a])).collect::<Vec<f64>>());
        let last = |a: usize| planes[a][planes[a].len() - 1];
        let mut voxels = Voxels {
            min: frame.min,
            max: DVec3::new(last(0), last(1), last(2)),
            cells_per_length: [0, 1, 2].map(|a| f64::from(1u32 << finest[a]) / frame.size[a]),
            cell_size: [0, 1, 2].map(|a| frame.size[a] / f64::from(1u32 << finest[a])),
            halvings: finest,
            masks: (0..=level)
                .map(|l| {
                    let halvings = frame.halvings(l);
                    [0, 1, 2].map(|a| (1 << (finest[a] - halvings[a])) - 1)
                })
                .collect(),
            planes,
            index: vec![0; 1 << level],
            cells: Vec::with_capacity(leaves.len()),
            starts: vec![0],
            surfaces: Vec::new(),
            level,
        };
        let (nx, ny) = (1usize << finest[0], 1usize << finest[1]);
        for (v, node) in leaves.iter().enumerate() {
            let halvings = frame.halvings(node.level);
            let entry = u32::from(node.level) << VOXEL_BITS | v as u32;
            let cells = [0, 1, 2].map(|a| {
                let shift = finest[a] - halvings[a];
                [node.place[a] << shift, (node.place[a] + 1) << shift]
            });
            for k in cells[2][0]..cells[2][1] {
                for j in cells[1][0]..cells[1][1] {
                    let row = (k as usize * ny + j as usize) * nx;
                    voxels.index[row + cells[0][0] as usize..row + cells[0][1] as usize].fill(entry);
                }
            }
            voxels.cells.push(cells);
            voxels.surfaces.extend(node.surfaces.iter().map(|&s| SurfaceId(s)));
            voxels.starts.push(voxels.surfaces.len() as u32);
        }
        voxels
    }
}

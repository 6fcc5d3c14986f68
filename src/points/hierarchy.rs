//! A tree over the sample points: cells of surfaces below, groups of surfaces that lie near each other and look the
//! same way above.

use super::{Cell, Piece, SamplePoints};
use crate::geometry::{Side, SurfaceId};
use crate::scene::Geometry;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use std::ops::Range;

/// Points that may act as one.
#[derive(Clone, Debug)]
pub struct Cluster {
    /// Its points, as a range of [`Hierarchy::order`].
    pub first: u32,
    /// One past the last of them.
    pub end: u32,
    /// The cluster after all that are part of this one; its parts begin at the next index.
    pub skip: u32,
    /// Mean position by area, m.
    pub position: Vec3,
    /// Mean normal by area; as short as the normals differ.
    pub normal: Vec3,
    /// All together, m².
    pub area: f32,
    /// Around all elements, m.
    pub low: Vec3,
    /// The other corner.
    pub high: Vec3,
    /// The largest angle between a normal and the mean one, rad.
    pub spread: f32,
    /// The cell that it is, if it is one of a single surface.
    pub cell: Option<(SurfaceId, Side, Cell)>,
    /// The cluster that is the whole side of that surface.
    pub whole: u32,
}

/// All clusters, each followed by its parts.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    /// The first is all points.
    pub clusters: Vec<Cluster>,
    /// Indices of points in the order of the tree.
    pub order: Vec<u32>,
    /// Corners of the cells, as of [`SamplePoints::corners`]; by cluster, of no meaning where there is no cell.
    pub corners: Vec<[Vec3; 4]>,
}

impl Cluster {
    /// Number of points.
    pub fn len(&self) -> usize {
        (self.end - self.first) as usize
    }

    /// Whether there is none, which no cluster of a hierarchy is.
    pub fn is_empty(&self) -> bool {
        self.end == self.first
    }
}

/// One side of one surface while the upper part of the tree is built.
struct Item {
    /// Its points, sorted by cell.
    points: Vec<u32>,
    position: Vec3,
    normal: Vec3,
}

impl Hierarchy {
    /// Of `points` of `geometry`.
    pub fn new(geometry: &Geometry, points: &SamplePoints) -> Self {
        let mut sorted: Vec<u32> = (0..points.len() as u32).collect();
        let side = |i: u32| (points.surface[i as usize], points.side[i as usize] == Side::Back);
        let place = |i: u32| {
            let cell = points.cell[i as usize];
            u64::from(cell.path) << (2 * (Cell::MAX_LEVEL - cell.level))
        };
        sorted.sort_unstable_by_key(|&i| (side(i), place(i)));
        let mut items: Vec<Item> =
            sorted.chunk_by(|&a, &b| side(a) == side(b)).map(|of| item(points, of)).collect();
        let mut hierarchy = Hierarchy::default();
        if !items.is_empty() {
            hierarchy.group(geometry, points, &mut items);
        }
        hierarchy
    }

    /// The parts of cluster `c`.
    pub fn parts(&self, c: usize) -> impl Iterator<Item = usize> + '_ {
        let end = self.clusters[c].skip as usize;
        let mut next = c + 1;
        std::iter::from_fn(move || {
            let part = next;
            next = self.clusters.get(part)?.skip as usize;
            (part < end).then_some(part)
        })
    }

    /// Its points.
    pub fn points(&self, c: usize) -> &[u32] {
        let Cluster { first, end, .. } = self.clusters[c];
        &self.order[first as usize..end as usize]
    }

    /// `count` of its points, spread evenly in the order of the tree, or all of them where there are no more. `turn`
    /// below 1 shifts the choice.
    pub fn spread(&self, c: usize, count: usize, turn: f32) -> impl Iterator<Item = usize> + '_ {
        let points = self.points(c);
        let (n, count) = (points.len(), count.min(points.len()));
        (0..count).map(move |k| {
            let at = (k as f32 + turn) * n as f32 / count as f32;
            points[(at as usize).min(n - 1)] as usize
        })
    }

    /// Adds the tree over some sides of surfaces.
    fn group(&mut self, geometry: &Geometry, points: &SamplePoints, items: &mut [Item]) {
        if let [item] = items {
            let (of, first) = (std::mem::take(&mut item.points), self.clusters.len());
            self.cell(geometry, points, &of, Cell::ROOT);
            self.clusters[first..].iter_mut().for_each(|part| part.whole = first as u32);
            return;
        }
        let own = self.open();
        let middle = halve(items);
        let (low, high) = items.split_at_mut(middle);
        self.group(geometry, points, low);
        self.group(geometry, points, high);
        self.close(own, points);
    }

    /// Adds the tree over the points `of` one side of a surface, which lie in `cell`.
    fn cell(&mut self, geometry: &Geometry, points: &SamplePoints, of: &[u32], cell: Cell) {
        let own = self.open();
        let first = of[0] as usize;
        let (id, side) = (points.surface[first], points.side[first]);
        if of.len() == 1 {
            self.order.extend(of);
        } else if cell.level == Cell::MAX_LEVEL {
            // More than one point in the smallest cell: the same element given twice.
            of.chunks(1).for_each(|one| self.cell(geometry, points, one, cell));
        } else {
            let child = |i: &u32| {
                let at = points.cell[*i as usize];
                at.path >> (2 * (at.level.max(cell.level + 1) - cell.level - 1)) & 3
            };
            for part in of.chunk_by(|a, b| child(a) == child(b)) {
                self.cell(geometry, points, part, cell.child(child(&part[0])));
            }
        }
        self.close(own, points);
        let cell = if of.len() == 1 { points.cell[first] } else { cell };
        let cluster = &mut self.clusters[own];
        cluster.cell = Some((id, side, cell));
        let surface = geometry.surface(id);
        if let Some(round) = surface.round() {
            let piece = Piece { round, side, cell };
            let (middle, reach) = (piece.at(0.5, 0.5).as_vec3(), piece.reach() as f32);
            (cluster.low, cluster.high) = (middle - reach, middle + reach);
        } else {
            let corners = if of.len() == 1 {
                points.corners[first]
            } else {
                let mut corners = cell.corners(surface).map(|v: DVec3| v.as_vec3());
                if side == Side::Back {
                    corners.reverse();
                }
                corners
            };
            self.corners[own] = corners;
            cluster.low = corners.into_iter().fold(Vec3::INFINITY, Vec3::min);
            cluster.high = corners.into_iter().fold(Vec3::NEG_INFINITY, Vec3::max);
        }
    }

    /// A cluster of which the parts are yet to come.
    fn open(&mut self) -> usize {
        let first = self.order.len() as u32;
        self.clusters.push(Cluster {
            first,
            end: first,
            skip: 0,
            position: Vec3::ZERO,
            normal: Vec3::ZERO,
            area: 0.0,
            low: Vec3::INFINITY,
            high: Vec3::NEG_INFINITY,
            spread: 0.0,
            cell: None,
            whole: 0,
        });
        self.corners.push([Vec3::ZERO; 4]);
        self.clusters.len() - 1
    }

    /// Sums up what has been added since it was opened.
    fn close(&mut self, own: usize, points: &SamplePoints) {
        let range: Range<usize> = self.clusters[own].first as usize..self.order.len();
        let (position, normal, area, spread) = mean(points, &self.order[range.clone()]);
        let skip = self.clusters.len();
        let (low, high) = self.clusters[own + 1..skip]
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), part| {
                (low.min(part.low), high.max(part.high))
            });
        self.clusters[own] = Cluster {
            first: range.start as u32,
            end: range.end as u32,
            skip: skip as u32,
            position,
            normal,
            area,
            low,
            high,
            spread,
            cell: None,
            whole: 0,
        };
    }
}

/// Mean position and normal by area, the area, and the largest angle between a normal and the mean one.
fn mean(points: &SamplePoints, of: &[u32]) -> (Vec3, Vec3, f32, f32) {
    let (mut position, mut normal, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for &i in of {
        let own = f64::from(points.area[i as usize]);
        position += own * points.position[i as usize].as_dvec3();
        normal += own * points.normal[i as usize].as_dvec3();
        area += own;
    }
    let direction = normal.normalize_or_zero();
    let angle = |&i: &u32| {
        let own = points.normal[i as usize].as_dvec3();
        // Where no direction is the mean one, none is near it.
        if direction == DVec3::ZERO { PI } else { own.cross(direction).length().atan2(own.dot(direction)) }
    };
    let spread = of.iter().map(angle).fold(0.0, f64::max);
    ((position / area).as_vec3(), (normal / area).as_vec3(), area as f32, spread as f32)
}

fn item(points: &SamplePoints, of: &[u32]) -> Item {
    let (position, normal, ..) = mean(points, of);
    Item { points: of.to_vec(), position, normal }
}

/// Surfaces in one plane are better neighbours than such as lie behind each other: what is seen of them differs less.
/// Distance along their normal counts as so many times distance along their plane.
const FLATTEN: f32 = 8.0;

/// Sorts the items into two parts, neither of them empty, and returns where the second begins: halfway along the
/// widest of seven axes. Three are of place; three of direction, of which a turn by a radian counts as the whole
/// width of the group; and one is the height of the plane over the origin.
fn halve(items: &mut [Item]) -> usize {
    let axes = |item: &Item| -> [f32; 7] {
        let (p, n) = (item.position, item.normal);
        [p.x, p.y, p.z, n.x, n.y, n.z, n.dot(p)]
    };
    let (mut low, mut high) = ([f32::INFINITY; 7], [f32::NEG_INFINITY; 7]);
    for axes in items.iter().map(axes) {
        low = std::array::from_fn(|k| low[k].min(axes[k]));
        high = std::array::from_fn(|k| high[k].max(axes[k]));
    }
    let extent: [f32; 7] = std::array::from_fn(|k| high[k] - low[k]);
    let width = Vec3::new(extent[0], extent[1], extent[2]).length();
    let factors = [1.0, 1.0, 1.0, width, width, width, FLATTEN];
    // Heights over the origin mean nothing while the normals differ.
    let turned = extent[3..6].iter().any(|&turn| turn > 0.5);
    let widths: [f32; 7] =
        std::array::from_fn(|k| if k == 6 && turned { 0.0 } else { factors[k] * extent[k] });
    let axis = (1..7).fold(0, |best, k| if widths[k] > widths[best] { k } else { best });
    let value = |item: &Item| axes(item)[axis];
    items.sort_by(|a, b| value(a).total_cmp(&value(b)));
    let middle = 0.5 * (value(&items[0]) + value(&items[items.len() - 1]));
    let at = items.partition_point(|item| value(item) < middle);
    if at == 0 || at == items.len() { items.len() / 2 } else { at }
}

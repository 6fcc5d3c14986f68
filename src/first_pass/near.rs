//! What to add to the plain kernel: by pairs, where an element is near, and by surfaces, so that all
//! elements of a surface together have the exact factor of the whole.

use super::diffuse::{DiffuseOperator, LANES, Lanes};
use super::form_factor::{NEAR, exact, extent2, near};
use super::round::of_whole;
use crate::geometry::{Round, Shape, Side};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::simd::{HotLoop, wide};
use crate::visibility::Tile;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// A surface is summed up exactly when its far elements may be wrong by more than about a third of
/// this projected solid angle, sr.
const DOUBT: f32 = 1e-5;

/// Corrections to the plain kernel as a sparse matrix, rows are receivers.
#[derive(Clone, Debug, Default)]
pub struct Corrections {
    /// First entry of each row, and the number of entries at the end; empty when there is no row.
    starts: Vec<usize>,
    /// The element seen.
    column: Vec<u32>,
    /// What the plain q lacks.
    difference: Vec<f32>,
    /// Ordered pairs whose element is near.
    pub near_pairs: u64,
    /// Pairs of a point and a surface that were summed up exactly.
    pub summed_surfaces: u64,
}

/// The corrections of one receiver.
#[derive(Clone, Debug, Default)]
struct Row {
    entries: Vec<(u32, f32)>,
    near: u64,
    surfaces: u64,
}

impl Corrections {
    /// Those of all pairs that see each other.
    pub fn new(geometry: &Geometry, operator: &DiffuseOperator, observer: &dyn Observer) -> Self {
        let patches = Patches::new(geometry, operator.points);
        let rows = |task| Receivers { operator, patches: &patches }.rows(task);
        let done = |rows: &Vec<Row>| observer.advance(rows.len() as u64);
        observer.begin("form factors", operator.points.len() as u64);
        let blocks: Vec<Vec<Row>> = operator.tasks.par_iter().map(|&task| rows(task)).inspect(done).collect();
        observer.end();
        let rows: Vec<Row> = blocks.into_iter().flatten().collect();
        Corrections {
            near_pairs: rows.iter().map(|r| r.near).sum(),
            summed_surfaces: rows.iter().map(|r| r.surfaces).sum(),
            ..Self::from_rows(rows.iter().map(|r| r.entries.as_slice()))
        }
    }

    /// Joins rows given in order.
    fn from_rows<'r>(rows: impl Iterator<Item = &'r [(u32, f32)]>) -> Self {
        let mut all = Corrections { starts: vec![0], ..Default::default() };
        for row in rows {
            all.column.extend(row.iter().map(|e| e.0));
            all.difference.extend(row.iter().map(|e| e.1));
            all.starts.push(all.column.len());
        }
        all
    }

    /// The same corrections by element seen: rows are sources, columns receivers.
    pub fn transposed(&self) -> Self {
        let n = self.starts.len().saturating_sub(1);
        let mut rows = vec![Vec::new(); n];
        for i in 0..n {
            for (j, difference) in self.row(i) {
                rows[j].push((i as u32, difference));
            }
        }
        Self::from_rows(rows.iter().map(Vec::as_slice))
    }

    /// Entries of row `i`, by ascending column: (column, difference).
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = if i + 1 < self.starts.len() { self.starts[i]..self.starts[i + 1] } else { 0..0 };
        self.column[range.clone()].iter().map(|&c| c as usize).zip(self.difference[range].iter().copied())
    }

    /// The entry of row `i` and column `j`, 0 where there is none.
    pub fn get(&self, i: usize, j: usize) -> f32 {
        let Some(&[start, end]) = self.starts.get(i..i + 2).and_then(|s| s.first_chunk()) else { return 0.0 };
        let found = self.column[start..end].binary_search(&(j as u32));
        found.map_or(0.0, |at| self.difference[start + at])
    }
}

/// A side of a surface and its points within one voxel.
struct Run {
    patch: usize,
    points: Range<usize>,
}

/// A whole side of a surface.
enum Whole {
    /// Corners.
    Polygon([Vec3; 4]),
    /// What is no polygon.
    Round(Round, Side),
}

impl Whole {
    /// q of all that is above the horizon and faces the point, if known.
    fn seen_from(&self, position: Vec3, normal: Vec3) -> Option<f64> {
        match self {
            Whole::Polygon(corners) => Some(exact(position, normal, corners)),
            Whole::Round(round, side) => of_whole(position, normal, round, *side),
        }
    }
}

/// The sides of surfaces that carry points.
struct Patches {
    /// The whole surface.
    wholes: Vec<Whole>,
    /// What each voxel holds of them.
    runs: Vec<Vec<Run>>,
    /// Of every element.
    extent2: Vec<f32>,
}

impl Patches {
    fn new(geometry: &Geometry, points: &SamplePoints) -> Self {
        let mut found = std::collections::HashMap::new();
        let mut patches = Patches {
            wholes: Vec::new(),
            runs: Vec::with_capacity(points.voxels()),
            extent2: (0..points.len()).map(|j| extent2(points, j)).collect(),
        };
        for v in 0..points.voxels() {
            let mut runs: Vec<Run> = Vec::new();
            for j in points.voxel(v) {
                let id = (points.surface[j], points.side[j] == Side::Front);
                let patch = *found.entry(id).or_insert_with(|| {
                    patches.wholes.push(match geometry.surface(id.0).shape {
                        Shape::Quad(v) => Whole::Polygon(v.map(|v| v.as_vec3())),
                        Shape::Triangle([a, b, c]) => Whole::Polygon([a, b, c, c].map(|v| v.as_vec3())),
                        Shape::Disc(disc) => Whole::Round(Round::Disc(disc), points.side[j]),
                        Shape::Sphere(sphere) => Whole::Round(Round::Sphere(sphere), points.side[j]),
                    });
                    patches.wholes.len() - 1
                });
                match runs.last_mut() {
                    Some(run) if run.patch == patch => run.points.end = j + 1,
                    _ => runs.push(Run { patch, points: j..j + 1 }),
                }
            }
            patches.runs.push(runs);
        }
        patches
    }
}

/// What a receiver knows of one patch.
#[derive(Clone, Copy, Default)]
struct Sum {
    /// q of all elements that face the receiver, hidden or not.
    all: f64,
    /// q of those that are visible.
    seen: f64,
    /// Σ q extent² / r² over the far ones.
    doubt: f32,
    /// The visible element of largest q.
    best: (u32, f32),
}

/// Receivers looking at the patches.
struct Receivers<'a> {
    operator: &'a DiffuseOperator<'a>,
    patches: &'a Patches,
}

impl Receivers<'_> {
    fn rows(&self, (a, first, end): (usize, usize, usize)) -> Vec<Row> {
        let DiffuseOperator { points, graph, .. } = self.operator;
        let mut scratch = vec![Vec::new(); points.voxels()];
        let tiles: Vec<Tile> = scratch.iter_mut().enumerate().map(|(b, s)| graph.tile(a, b, s)).collect();
        let mut sums = vec![Sum::default(); self.patches.wholes.len()];
        (first..end).map(|i| self.row(i, i - points.voxel(a).start, &tiles, &mut sums)).collect()
    }

    /// The corrections of receiver `i`, row `r` of its `tiles`; leaves `sums` as it found them.
    fn row(&self, i: usize, r: usize, tiles: &[Tile], sums: &mut [Sum]) -> Row {
        let points = self.operator.points;
        let mut row = Row::default();
        let mut met: Vec<usize> = Vec::new();
        let mut q = Vec::new();
        // What is wholly hidden counts only for patches of which something is seen.
        let (hidden, open): (Vec<usize>, Vec<usize>) =
            (0..tiles.len()).partition(|&b| matches!(tiles[b], Tile::Hidden));
        for (b, hidden) in open.into_iter().map(|b| (b, false)).chain(hidden.into_iter().map(|b| (b, true))) {
            let counts = |run: &Run, sums: &[Sum]| !hidden || sums[run.patch].seen > 0.0;
            if !self.patches.runs[b].iter().any(|run| counts(run, sums)) {
                continue;
            }
            q.clear();
            wide(Facing { operator: self.operator, i, b, q: &mut q });
            for run in &self.patches.runs[b] {
                if !counts(run, sums) {
                    continue;
                }
                let sum = self.sum(i, r, (b, &tiles[b], run), &q, &mut row.entries);
                if sum.all > 0.0 {
                    let whole = &mut sums[run.patch];
                    if whole.all == 0.0 {
                        met.push(run.patch);
                    }
                    whole.add(&sum);
                }
            }
        }
        row.near = row.entries.len() as u64;
        row.entries.sort_unstable_by_key(|e| e.0);
        for patch in met {
            let sum = std::mem::take(&mut sums[patch]);
            if sum.seen == 0.0 || sum.doubt < DOUBT {
                continue;
            }
            let whole = self.patches.wholes[patch].seen_from(points.position[i], points.normal[i]);
            let Some(whole) = whole else { continue };
            // The visible part shares the error of the whole. What is too much comes off one element,
            // but never more than half of it.
            let lacking = ((sum.seen * (whole / sum.all - 1.0)) as f32).max(-0.5 * sum.best.1);
            row.surfaces += 1;
            match row.entries.binary_search_by_key(&sum.best.0, |e| e.0) {
                Ok(at) => row.entries[at].1 += lacking,
                Err(at) => row.entries.insert(at, (sum.best.0, lacking)),
            }
        }
        row
    }

    /// What receiver `i`, row `r` of `tile`, knows of a run in voxel `b`, given the plain factors `q`. Near
    /// elements that it sees are added to `entries`.
    fn sum(
        &self,
        i: usize,
        r: usize,
        (b, tile, run): (usize, &Tile, &Run),
        q: &[Lanes],
        entries: &mut Vec<(u32, f32)>,
    ) -> Sum {
        let points = self.operator.points;
        let start = points.voxel(b).start;
        let mut sum = Sum::default();
        for j in run.points.clone() {
            let c = j - start;
            let plain = q[c / LANES][c % LANES];
            if plain <= 0.0 {
                continue;
            }
            let visible = tile.get(r, c);
            let extent = self.patches.extent2[j];
            let r2 = points.position[i].distance_squared(points.position[j]);
            let mut q = f64::from(plain);
            if extent > NEAR * r2 {
                q = near(points, i, j);
                if visible {
                    entries.push((j as u32, (q - f64::from(plain)) as f32));
                }
            } else {
                sum.doubt += plain * extent / r2;
            }
            sum.all += q;
            if visible {
                sum.seen += q;
                if q as f32 > sum.best.1 {
                    sum.best = (j as u32, q as f32);
                }
            }
        }
        sum
    }
}

impl Sum {
    fn add(&mut self, more: &Sum) {
        self.all += more.all;
        self.seen += more.seen;
        self.doubt += more.doubt;
        if more.best.1 > self.best.1 {
            self.best = more.best;
        }
    }
}

/// The plain q of all elements of voxel `b` that point `i` faces, hidden or not, in columns.
struct Facing<'a> {
    operator: &'a DiffuseOperator<'a>,
    i: usize,
    b: usize,
    q: &'a mut Vec<Lanes>,
}

impl HotLoop for Facing<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Facing { operator, i, b, q } = self;
        let columns = &operator.columns;
        let groups = columns.starts[b]..columns.starts[b + 1];
        q.extend(groups.map(|g| columns.seen_from(operator.points, i, g, 0xff, operator.tolerance)));
    }
}

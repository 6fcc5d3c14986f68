//! What to add to the plain kernel: by pairs, where an element is near, and by surfaces, so that all
//! elements of a surface together have the exact factor of the whole.

use super::corrections::Corrections;
use super::diffuse::{DiffuseOperator, LANES, Lanes};
use super::form_factor::{NEAR, exact, extent2, near};
use super::layout::Layout;
use super::round::{of_own, of_whole};
use super::schedule::row_bits;
use crate::geometry::{Round, Shape, Side, SurfaceId};
use crate::observer::Observer;
use crate::points::{Middle, Piece, SamplePoints};
use crate::scene::Geometry;
use crate::simd::{HotLoop, wide};
use crate::visibility::Tile;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// A surface is summed up exactly when its far elements may be wrong by more than about a third of
/// this projected solid angle, sr.
pub(super) const DOUBT: f32 = 1e-5;

/// So many middles of pieces are kept at most where that leaves more than one an element, 56 bytes each,
const MIDDLES: usize = 1 << 20;

/// and no more levels of them for an element.
const LEVELS: u8 = 3;

/// The corrections of one receiver.
#[derive(Clone, Debug, Default)]
struct Row {
    entries: Vec<(u32, f32)>,
    near: u64,
    surfaces: u64,
}

impl Corrections {
    /// Those of all pairs that see each other.
    /// `layout` has one side of one surface in every patch.
    pub fn new(
        geometry: &Geometry,
        operator: &DiffuseOperator,
        layout: &Layout,
        observer: &dyn Observer,
    ) -> Self {
        let sides = Sides::new(geometry, operator.points, layout);
        let rows = |task| Receivers { operator, layout, sides: &sides }.rows(task);
        let done = |rows: &Vec<Row>| observer.advance(rows.len() as u64);
        observer.begin("form factors", operator.points.len() as u64);
        let blocks: Vec<Vec<Row>> = operator.tasks.par_iter().map(|&task| rows(task)).inspect(done).collect();
        observer.end();
        let rows: Vec<Row> = blocks.into_iter().flatten().collect();
        let mut all = Self::from_rows(rows.iter().map(|r| r.entries.as_slice()));
        all.near_pairs = rows.iter().map(|r| r.near).sum();
        all.summed_surfaces = rows.iter().map(|r| r.surfaces).sum();
        all
    }
}

/// A whole side of a surface.
enum Whole {
    /// Corners.
    Polygon([Vec3; 4]),
    /// What is no polygon.
    Round(Round, Side, SurfaceId),
}

impl Whole {
    /// Whether elements may have no exact factors: they may be partly out of sight of a point that faces them, or in
    /// sight of one that they turn away from, however far it is, and what is near is summed up of pieces.
    fn is_inexact(&self) -> bool {
        matches!(self, Whole::Round(..))
    }

    /// Whether it is this side of the surface `id`, and no polygon.
    fn is_round(&self, id: SurfaceId, side: Side) -> bool {
        matches!(self, Whole::Round(_, its, own) if *own == id && *its == side)
    }

    /// Whether all its elements have their exact factors from each other.
    fn is_exact_within(&self) -> bool {
        matches!(self, Whole::Round(Round::Sphere(_), ..))
    }

    /// q of all that is above the horizon and faces the point, if known.
    fn seen_from(&self, position: Vec3, normal: Vec3) -> Option<f64> {
        match self {
            Whole::Polygon(corners) => Some(exact(position, normal, corners)),
            Whole::Round(round, side, _) => of_whole(position, normal, round, *side),
        }
    }
}

/// The sides of surfaces that carry points.
struct Sides {
    /// The whole surface.
    wholes: Vec<Whole>,
    /// The side that each patch is part of.
    of_patch: Vec<usize>,
    /// [`extent2`] of every element, by groups of lanes, in units of the layout.
    extent2: Vec<Lanes>,
    /// By element, as far as it is no polygon: its [`Piece::middles`].
    middles: Vec<Vec<Middle>>,
}

impl Sides {
    fn new(geometry: &Geometry, points: &SamplePoints, layout: &Layout) -> Self {
        let mut found = std::collections::HashMap::new();
        let round = (0..points.len()).filter(|&j| points.round(j).is_some()).count();
        let fit = |levels: u8| round * (4usize.pow(u32::from(levels) + 1) / 3) <= MIDDLES;
        let levels = (0..=LEVELS).rev().find(|&levels| fit(levels)).unwrap_or(0);
        let mut sides = Sides {
            wholes: Vec::new(),
            of_patch: Vec::with_capacity(layout.patches.len()),
            extent2: vec![[0.0; LANES]; layout.lane_area.len()],
            middles: (0..points.len())
                .into_par_iter()
                .map(|j| points.round(j).map_or_else(Vec::new, |piece| piece.middles(levels)))
                .collect(),
        };
        for patch in &layout.patches {
            let first = patch.points.start;
            let id = (points.surface[first], points.side[first] == Side::Front);
            sides.of_patch.push(*found.entry(id).or_insert_with(|| {
                sides.wholes.push(match &geometry.surface(id.0).shape {
                    Shape::Quad(v) => Whole::Polygon(v.map(|v| v.as_vec3())),
                    Shape::Triangle([a, b, c]) => Whole::Polygon([a, b, c, c].map(|v| v.as_vec3())),
                    Shape::Round(round) => Whole::Round(round.clone(), points.side[first], id.0),
                });
                sides.wholes.len() - 1
            }));
            for (at, j) in patch.points.clone().enumerate() {
                let extent = extent2(points, j) / layout.unit / layout.unit;
                sides.extent2[patch.groups.start + at / LANES][at % LANES] = extent;
            }
        }
        sides
    }
}

/// What a receiver knows of one side.
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
    /// Whether the receiver has looked at it, and whether it saw something.
    met: bool,
    some: bool,
}

/// An element that is near a receiver which it faces.
struct Near {
    element: usize,
    side: usize,
    /// q by the plain kernel.
    plain: f32,
    visible: bool,
}

/// Receivers looking at the sides.
struct Receivers<'a> {
    operator: &'a DiffuseOperator<'a>,
    layout: &'a Layout,
    sides: &'a Sides,
}

impl Receivers<'_> {
    fn rows(&self, (a, first, end): (usize, usize, usize)) -> Vec<Row> {
        let DiffuseOperator { points, graph, .. } = self.operator;
        let mut scratch = vec![Vec::new(); points.voxels()];
        let tiles: Vec<Tile> = scratch.iter_mut().enumerate().map(|(b, s)| graph.tile(a, b, s)).collect();
        let hidden = |p: &usize| matches!(tiles[self.layout.patches[*p].voxel], Tile::Hidden);
        let (hidden, open) = (0..self.sides.of_patch.len()).partition::<Vec<usize>, _>(hidden);
        let mut sums = vec![Sum::default(); self.sides.wholes.len()];
        (first..end)
            .map(|i| self.row((i, i - points.voxel(a).start), &tiles, [&open, &hidden], &mut sums))
            .collect()
    }

    /// The corrections of a receiver, given its row in the `tiles` and what they say of the patches;
    /// leaves `sums` as it found them.
    fn row(
        &self,
        at: (usize, usize),
        tiles: &[Tile],
        [open, hidden]: [&[usize]; 2],
        sums: &mut [Sum],
    ) -> Row {
        let points = self.operator.points;
        let i = at.0;
        let (mut close, mut met) = (Vec::new(), Vec::new());
        let (close, met) = (&mut close, &mut met);
        wide(Look { receivers: self, at, tiles, patches: open, sums, near: close, met });
        close.iter().for_each(|n: &Near| sums[n.side].some |= n.visible);
        // What is wholly hidden counts only for sides of which something is seen.
        let counts = |p: &usize| sums[self.sides.of_patch[*p]].some;
        let hidden: Vec<usize> = hidden.iter().copied().filter(counts).collect();
        wide(Look { receivers: self, at, tiles, patches: &hidden, sums, near: close, met });

        let mut row = Row::default();
        for Near { element, side, plain, visible } in close.drain(..) {
            let q = near(points, i, element, &self.sides.middles[element]);
            sums[side].all += q;
            if visible {
                row.entries.push((element as u32, (q - f64::from(plain)) as f32));
                sums[side].seen += q;
                sums[side].best = larger(sums[side].best, (element as u32, q as f32));
            }
        }
        let hollow = points.round(i).filter(Piece::faces_itself);
        let own = hollow.map_or(0.0, |piece| of_own(&piece, &piece, &self.sides.middles[i]));
        if own > 0.0 {
            row.entries.push((i as u32, own as f32));
        }
        row.near = row.entries.len() as u64;
        row.entries.sort_unstable_by_key(|e| e.0);
        for &side in met.iter() {
            let mut sum = std::mem::take(&mut sums[side]);
            let whole = &self.sides.wholes[side];
            let same = whole.is_round(points.surface[i], points.side[i]);
            if same {
                sum.all += own;
                sum.seen += own;
            }
            let exact = sum.doubt < DOUBT && !whole.is_inexact() || same && whole.is_exact_within();
            if sum.seen == 0.0 || exact {
                continue;
            }
            let whole = whole.seen_from(points.position[i], points.normal[i]);
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
}

/// The larger of two elements, the first of equal ones.
fn larger(a: (u32, f32), b: (u32, f32)) -> (u32, f32) {
    if b.1 > a.1 { b } else { a }
}

/// One receiver looking at patches: what is far is added up by sides, what is near is noted.
struct Look<'a> {
    receivers: &'a Receivers<'a>,
    /// The receiver, and its row in the tiles.
    at: (usize, usize),
    tiles: &'a [Tile<'a>],
    patches: &'a [usize],
    sums: &'a mut [Sum],
    near: &'a mut Vec<Near>,
    /// Sides looked at.
    met: &'a mut Vec<usize>,
}

impl HotLoop for Look<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Look {
            receivers: Receivers { operator, layout, sides },
            at: (i, r),
            tiles,
            patches,
            sums,
            near,
            met,
        } = self;
        let DiffuseOperator { graph, tolerance, .. } = operator;
        let tolerance = tolerance / layout.unit;
        let (p, n) = (layout.position[i], layout.normal[i]);
        let ([x, y, z], [nx, ny, nz]) = (&layout.lane_position, &layout.lane_normal);
        for &patch in patches {
            let side = sides.of_patch[patch];
            let patch = &layout.patches[patch];
            if patch.plane.is_some() && patch.height(p) as f32 <= 0.0 {
                continue;
            }
            let column = patch.points.start - graph.voxel(patch.voxel).start;
            let bits = row_bits(&tiles[patch.voxel], r, column, patch.points.len());
            // In f64: what is lacking is a small difference of these sums.
            let [mut all, mut seen] = [[0.0f64; LANES]; 2];
            let mut doubt = [0.0f32; LANES];
            let mut best = sums[side].best;
            for (at, g) in patch.groups.clone().enumerate() {
                let bits = (bits >> (at * LANES)) as u32;
                let (mut q, mut ratio, mut visible) = ([0.0; LANES], [0.0; LANES], [0.0f32; LANES]);
                let (mut close, mut better) = ([0u32; LANES], [0u32; LANES]);
                for lane in 0..LANES {
                    let (dx, dy, dz) = (x[g][lane] - p.x, y[g][lane] - p.y, z[g][lane] - p.z);
                    let here = n.x * dx + n.y * dy + n.z * dz;
                    let there = -(nx[g][lane] * dx + ny[g][lane] * dy + nz[g][lane] * dz);
                    let inverse = 1.0 / (dx * dx + dy * dy + dz * dz);
                    let plain = (here * inverse) * (there * inverse) * layout.lane_area[g][lane];
                    let plain = if plain < PI { plain } else { PI };
                    let faces = (here > tolerance) & (there > tolerance);
                    q[lane] = if faces { plain } else { 0.0 };
                    ratio[lane] = if faces { sides.extent2[g][lane] * inverse } else { 0.0 };
                    visible[lane] = if bits & (1 << lane) != 0 { q[lane] } else { 0.0 };
                    close[lane] = u32::from(ratio[lane] > NEAR);
                    better[lane] = u32::from(visible[lane] > best.1);
                }
                if close.iter().sum::<u32>() != 0 {
                    for lane in 0..LANES {
                        if ratio[lane] > NEAR && q[lane] > 0.0 {
                            let element = patch.points.start + at * LANES + lane;
                            let seen = visible[lane] > 0.0;
                            near.push(Near { element, side, plain: q[lane], visible: seen });
                            (q[lane], visible[lane]) = (0.0, 0.0);
                        }
                    }
                }
                if better.iter().sum::<u32>() != 0 {
                    for (lane, &visible) in visible.iter().enumerate() {
                        best = larger(best, ((patch.points.start + at * LANES + lane) as u32, visible));
                    }
                }
                for lane in 0..LANES {
                    all[lane] += f64::from(q[lane]);
                    seen[lane] += f64::from(visible[lane]);
                    doubt[lane] += q[lane] * ratio[lane];
                }
            }
            let sum = &mut sums[side];
            if !sum.met {
                met.push(side);
            }
            sum.met = true;
            sum.some |= seen.iter().any(|&q| q > 0.0);
            sum.all += all.iter().sum::<f64>();
            sum.seen += seen.iter().sum::<f64>();
            sum.doubt += doubt.iter().sum::<f32>();
            sum.best = best;
        }
    }
}

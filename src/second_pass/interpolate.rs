//! L^d anywhere on a surface, from the sample points around (section 3.4).
//!
//! Every element gets a radiance at its corners and at the middles of its edges, made of the
//! elements around them (`stencil`), and keeps the sample point's own at its centre. Between
//! them a regular quad element is bilinear in each of its quarters: where elements are equal this
//! is bilinear interpolation between the four closest sample points, the paper's rule. Triangles, and
//! quads beside much smaller ones, are linear over a fan of triangles around the centre. Along an
//! edge both are linear from node to node, so the whole is continuous whatever the refinement.
//!
//! Covered sample points (`cover`) take the radiance of those around them, and so do not darken
//! what is seen beside the cover. Points beyond something that stands on the surface (`feet`) do not
//! count on this side of it.
//!
//! Bilinear quarters were chosen over a fan everywhere because they are the paper's rule to the
//! letter and need no search; on a smooth gradient the eye sees no difference.

use super::chart::Chart;
use super::cover::{StandIn, covered, stand_ins};
use super::feet::{Feet, openness, side_of};
use super::lattice::{Lattice, sheet};
use super::stencil::Stencils;
use crate::first_pass::DiffuseSolution;
use crate::geometry::{Shape, Side, SurfaceId};
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Where to look for the radiance of a place: depends on geometry and sample points alone.
pub struct Interpolator {
    /// Per surface.
    charts: Vec<Chart>,
    triangle: Vec<bool>,
    /// First cell of each sheet (surface and side): `[2 surfaces + 1]`.
    sheet_starts: Vec<u32>,
    /// Start of the cell on the Morton curve at the deepest level, and its element; sorted
    /// within a sheet.
    cells: Vec<(u32, u32)>,
    /// By element, which is the index of its sample point.
    elements: Vec<Element>,
    lattice: Lattice,
    /// Place of every border node in the plane, relative to the element's centre, m.
    border_at: Vec<[f32; 2]>,
    stencils: Stencils,
    stand_ins: Vec<StandIn>,
    /// By element.
    covered: Vec<bool>,
    feet: Feet,
    /// By foot: the side of its line on which all elements lie that a place in the foot's element may take from, if they
    /// do and none is covered.
    common_side: Vec<Option<bool>>,
    /// Where to begin looking for a cell.
    buckets: Buckets,
}

/// What stands in, at most, for the elements around a place that are all parted from it, as a
/// share of the whole weight.
const WIDER: f64 = 1e-4;

/// How open the way to an element beyond a foot is: next to nothing.
const BEYOND: f64 = 1e-9;

#[derive(Clone, Copy)]
struct Element {
    /// Lowest (u, v) of a quad's cell.
    low: DVec2,
    /// One over its size in u and v.
    scale: f64,
    /// Centre, local coordinates, m.
    centre: DVec3,
}

impl Interpolator {
    /// Prepares the elements of `points`, which belong to `geometry`; `tracer` tells which of them
    /// are covered, and what stands between them.
    pub fn new(geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) -> Self {
        let charts: Vec<Chart> = geometry.surfaces.iter().map(Chart::new).collect();
        let lattice = Lattice::new(geometry, points);
        let n = points.len();
        let mut keyed: Vec<(usize, u32, u32)> = Vec::with_capacity(n);
        let mut elements = Vec::with_capacity(n);
        let (mut centres, mut normals) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut border_at = Vec::new();
        for i in 0..n {
            let (id, cell) = (points.surface[i], points.cell[i]);
            let surface = geometry.surface(id);
            let start = u64::from(cell.path) << (32 - 2 * u32::from(cell.level));
            keyed.push((sheet(id.index(), points.side[i]), start as u32, i as u32));
            let uv = cell.centre_uv(&surface.shape);
            let position = surface.point_at(uv.x, uv.y);
            let chart = &charts[id.index()];
            let centre = chart.plane(position);
            elements.push(Element {
                low: cell.corners_uv(&surface.shape)[0],
                scale: f64::from(1u32 << cell.level),
                centre: position,
            });
            for &node in lattice.border.of(i) {
                let at = chart.plane_near(lattice.position[node as usize], centre);
                border_at.push((at - centre).as_vec2().to_array());
            }
            centres.push(position);
            normals.push(surface.normal_at(position));
        }
        keyed.sort_unstable();
        let mut sheet_starts = vec![0u32; 2 * geometry.surfaces.len() + 1];
        for (sheet, ..) in &keyed {
            sheet_starts[sheet + 1] += 1;
        }
        for i in 1..sheet_starts.len() {
            sheet_starts[i] += sheet_starts[i - 1];
        }
        let feet = Feet::new(geometry, points, tracer, &lattice, &charts, &centres);
        let cells: Vec<(u32, u32)> = keyed.into_iter().map(|(_, start, element)| (start, element)).collect();
        let buckets = Buckets::new(&sheet_starts, &cells);
        let mut interpolator = Interpolator {
            triangle: geometry.surfaces.iter().map(|s| matches!(s.shape, Shape::Triangle(_))).collect(),
            charts,
            sheet_starts,
            cells,
            elements,
            stencils: Stencils::new(&lattice, &centres, &normals),
            lattice,
            border_at,
            stand_ins: Vec::new(),
            covered: Vec::new(),
            feet,
            common_side: Vec::new(),
            buckets,
        };
        let covered = covered(geometry, points, tracer, |surface, side, position| {
            let chart = &interpolator.charts[surface.index()];
            let found = interpolator.locate(surface.index(), side, chart.uv(chart.plane(position)));
            found.map(|element| element as u32)
        });
        interpolator.stand_ins = stand_ins(&interpolator.lattice, &centres, &covered);
        interpolator.covered = covered;
        interpolator.common_side = interpolator.common_sides(points);
        interpolator
    }

    /// See `common_side`.
    fn common_sides(&self, points: &SamplePoints) -> Vec<Option<bool>> {
        let mut sides = Vec::with_capacity(self.feet.len());
        for i in 0..self.elements.len() {
            let feet = self.feet.of(i);
            if feet.is_empty() {
                continue;
            }
            let chart = &self.charts[points.surface[i].index()];
            let border = self.lattice.border.of(i).iter();
            let nodes = border.flat_map(|&node| self.lattice.halved(node).unwrap_or([node, node]));
            let rows = nodes.flat_map(|node| self.stencils.of(node as usize).iter().map(|&(e, _)| e));
            let mut taken: Vec<u32> = rows.chain([i as u32]).collect();
            taken.sort_unstable();
            taken.dedup();
            let covered = taken.iter().any(|&e| self.covered[e as usize]);
            let place = |e: u32| chart.plane(self.elements[e as usize].centre);
            sides.extend(feet.iter().map(|&foot| {
                let first = side_of(foot, place(i as u32));
                (!covered && taken.iter().all(|&e| side_of(foot, place(e)) == first)).then_some(first)
            }));
        }
        sides
    }

    /// The covered sample points whose radiance those around them stand in for.
    pub fn covered(&self) -> impl Iterator<Item = usize> {
        self.stand_ins.iter().map(|s| s.element as usize)
    }

    /// Number of sample points.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Works out the radiance of all nodes for `solution`, which must have one spectrum for
    /// every sample point.
    ///
    /// A node's radiance strays from the range of the points it is made of by no more than that range, and
    /// never falls under half of their darkest: enough for linear fields but those that vanish at a
    /// border, and a bound on how far a border can run away. Where the edge of a shadow is near it
    /// would else turn black.
    pub fn field(&self, solution: &DiffuseSolution) -> DiffuseField<'_> {
        let w = solution.wavelengths.len();
        let centres = self.centres(solution, w);
        let of = |element: u32| &centres[element as usize * w..];
        let mut nodes = vec![0.0f32; self.stencils.len() * w];
        nodes.par_chunks_mut(w.max(1)).enumerate().for_each(|(node, out)| {
            let row = self.stencils.of(node);
            for (k, out) in out.iter_mut().enumerate().take(if row.is_empty() { 0 } else { w }) {
                let (mut sum, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
                for &(element, weight) in row {
                    let value = f64::from(of(element)[k]);
                    sum += weight * value;
                    (low, high) = (low.min(value), high.max(value));
                }
                let range = high - low;
                *out = sum.max(low - range).max(0.5 * low).min(high + range).max(0.0) as f32;
            }
        });
        for &(node, a, b) in &self.lattice.halves {
            for k in 0..w {
                let mean = 0.5 * (nodes[a as usize * w + k] + nodes[b as usize * w + k]);
                nodes[node as usize * w + k] = mean;
            }
        }
        DiffuseField { interpolator: self, centres, nodes, w }
    }

    /// Radiance at the centres of all elements, `[N][W]`, covered ones stood in for.
    fn centres(&self, solution: &DiffuseSolution, w: usize) -> Vec<f32> {
        let mut centres = solution.radiance.clone();
        for StandIn { element, from } in &self.stand_ins {
            for k in 0..w {
                let of = |e: u32| f64::from(centres[e as usize * w + k]);
                centres[*element as usize * w + k] = from.iter().map(|&(e, t)| t * of(e)).sum::<f64>() as f32;
            }
        }
        centres
    }

    /// What a place in element `i` takes if a foot parts it from some of the elements that `shares` would
    /// take from: the open ways keep their share of the weight.
    fn parted(&self, i: usize, place: DVec2, chart: &Chart, shares: &Shares) -> Option<Parted> {
        let feet = self.feet.of(i);
        if feet.is_empty() {
            return None;
        }
        // A place on the rim may lie beyond it by rounding, and so beyond a wall's foot.
        let inwards = place.lerp(chart.plane(self.elements[i].centre), 1e-6);
        let sides = &self.common_side[self.feet.range(i)];
        if feet.iter().zip(sides).all(|(&foot, side)| *side == Some(side_of(foot, inwards))) {
            return None;
        }
        let mut weights = Vec::with_capacity(32);
        weights.push((i as u32, shares.centre));
        let mut add = |element: u32, weight: f64| match weights.iter_mut().find(|(e, _)| *e == element) {
            Some((_, sum)) => *sum += weight,
            None => weights.push((element, weight)),
        };
        for (&node, weight) in shares.nodes.iter().zip(shares.weights) {
            let (nodes, weight) = match self.lattice.halved(node) {
                Some(ends) => (ends, 0.5 * weight),
                None => ([node, node], 0.5 * weight),
            };
            for node in nodes {
                self.stencils.of(node as usize).iter().for_each(|&(e, w)| add(e, weight * w));
            }
        }
        // What the covered would say they have from all sides. A place parted from all others takes what
        // it has from beyond.
        let open = |e: u32| {
            let way = || openness(feet, inwards, chart.plane(self.elements[e as usize].centre));
            if self.covered[e as usize] { 0.0 } else { way().max(BEYOND) }
        };
        let (mut all, mut closed, mut negative) = (0.0, 0.0, 0.0);
        for (element, weight) in &mut weights {
            let open = open(*element);
            all += weight.abs();
            negative += weight.min(0.0).abs();
            closed += weight.abs() * (1.0 - open);
            *weight = weight.max(0.0) * open;
        }
        if closed <= 0.0 {
            return None;
        }
        let closed = closed / all;
        let around = self.lattice.around(i);
        let trust = |e: u32| 1.0 / self.elements[e as usize].centre.distance_squared(self.elements[i].centre);
        let size =
            around.iter().filter(|&&e| e != i as u32).map(|&e| trust(e)).fold(f64::MIN_POSITIVE, f64::max);
        let wider = around.into_iter().map(|e| (e, open(e) * trust(e).min(size) / size));
        weights.extend(wider.map(|(e, share)| (e, WIDER * closed * share)));
        let total: f64 = weights.iter().map(|(_, w)| w).sum();
        // All around is covered: nothing better is known.
        (total > 0.0).then(|| Parted {
            // Extrapolation needs all it stands on; what follows leaves it out.
            whole: (1.0 - 8.0 * closed).max(0.0) * (8.0 * negative / all).min(1.0),
            weights: weights.into_iter().map(|(e, w)| (e, w / total)).collect(),
        })
    }

    /// The element at a place of a sheet, if the sheet has any.
    fn locate(&self, surface: usize, side: Side, uv: DVec2) -> Option<usize> {
        let sheet = sheet(surface, side);
        let code = if self.triangle[surface] { triangle_code(uv) } else { quad_code(uv) };
        let range = self.buckets.range(sheet, code, self.sheet_starts[sheet + 1] as usize);
        let after = self.cells[range.clone()].partition_point(|(start, _)| *start <= code);
        self.cells[range].get(after.saturating_sub(1)).map(|(_, element)| *element as usize)
    }
}

/// The cells of each sheet by the first digits of their place on the Morton curve.
struct Buckets {
    /// Per sheet: its first entry in `starts`, and by how many bits a code is too long to number a bucket.
    sheets: Vec<(u32, u32)>,
    /// Per bucket, and one past the last of each sheet: the cell that holds its beginning.
    starts: Vec<u32>,
}

impl Buckets {
    /// No more buckets than 4 to the power of this for a sheet.
    const MAX_LEVEL: u32 = 8;

    /// About as many buckets as cells for each sheet.
    fn new(sheet_starts: &[u32], cells: &[(u32, u32)]) -> Self {
        let mut buckets = Buckets { sheets: Vec::with_capacity(sheet_starts.len()), starts: Vec::new() };
        for ends in sheet_starts.windows(2) {
            let (first, end) = (ends[0], ends[1]);
            let level = ((end - first).max(1).ilog2().div_ceil(2)).min(Self::MAX_LEVEL);
            let shift = 32 - 2 * level;
            buckets.sheets.push((buckets.starts.len() as u32, shift));
            let own = &cells[first as usize..end as usize];
            buckets.starts.extend((0..1u64 << (2 * level)).map(|bucket| {
                let after = own.partition_point(|(start, _)| u64::from(*start) <= bucket << shift);
                first + after.saturating_sub(1) as u32
            }));
            buckets.starts.push(end.saturating_sub(u32::from(end > first)));
        }
        buckets
    }

    /// Cells of a sheet, which ends before the cell `end`, among which the one that holds `code` is.
    #[inline]
    fn range(&self, sheet: usize, code: u32, end: usize) -> std::ops::Range<usize> {
        let (first, shift) = self.sheets[sheet];
        let bucket = first as usize + (u64::from(code) >> shift) as usize;
        let (low, high) = (self.starts[bucket] as usize, self.starts[bucket + 1] as usize);
        low..(high + 1).min(end)
    }
}

/// L^d of a solution as a function of place.
pub struct DiffuseField<'a> {
    interpolator: &'a Interpolator,
    /// `[N][W]`.
    centres: Vec<f32>,
    /// `[nodes][W]`.
    nodes: Vec<f32>,
    w: usize,
}

impl DiffuseField<'_> {
    /// L^d at `position` (local coordinates, on the surface) on one side, into `out[..W]`. A side
    /// without sample points is black.
    pub fn radiance(&self, surface: SurfaceId, side: Side, position: DVec3, out: &mut [f32]) {
        let of = self.interpolator;
        let chart = &of.charts[surface.index()];
        let place = chart.plane(position);
        let uv = chart.uv(place);
        let Some(i) = of.locate(surface.index(), side, uv) else {
            out.fill(0.0);
            return;
        };
        let border = of.lattice.border.of(i);
        let shares = if of.lattice.regular[i] {
            let element = &of.elements[i];
            quarter(border, ((uv - element.low) * element.scale).clamp(DVec2::ZERO, DVec2::ONE))
        } else {
            let places = &of.border_at[of.lattice.border.range(i)];
            fan(border, places, place - chart.plane(of.elements[i].centre))
        };
        let w = self.w;
        let centre = &self.centres[i * w..][..w];
        let nodes = shares.nodes.map(|node| &self.nodes[node as usize * w..][..w]);
        blend(&shares, centre, nodes, &mut out[..w]);
        if let Some(Parted { whole, weights }) = of.parted(i, place, chart, &shares) {
            for (k, out) in out.iter_mut().enumerate().take(self.w) {
                let of = |e: u32| f64::from(self.centres[e as usize * self.w + k]);
                let part: f64 = weights.iter().map(|&(e, w)| w * of(e)).sum();
                *out = (whole * f64::from(*out) + (1.0 - whole) * part) as f32;
            }
        }
    }

    /// Feeds all that the radiance depends on, but for the geometry, to `hasher`.
    pub(super) fn hash(&self, hasher: &mut blake3::Hasher) {
        for (start, element) in &self.interpolator.cells {
            hasher.update(&[start.to_le_bytes(), element.to_le_bytes()].concat());
        }
        for values in [&self.centres, &self.nodes] {
            for chunk in values.chunks(1 << 12) {
                hasher.update(&chunk.iter().flat_map(|l| l.to_le_bytes()).collect::<Vec<u8>>());
            }
        }
    }
}

/// What a place within an element takes from the centre and from three nodes of the border; sum 1.
struct Shares {
    centre: f64,
    nodes: [u32; 3],
    weights: [f64; 3],
}

/// The spectrum of `shares` of four spectra, not negative; all are equally long. Weights of at most 1 lose nothing
/// in `f32`. Four wavelengths at a time: counts are multiples of that, but for odd ones.
#[inline]
fn blend(shares: &Shares, centre: &[f32], nodes: [&[f32]; 3], out: &mut [f32]) {
    let own = shares.centre as f32;
    let [ta, tb, tc] = shares.weights.map(|t| t as f32);
    let mix = |m: f32, a: f32, b: f32, c: f32| {
        let sum = own * m + (ta * a + tb * b + tc * c);
        if sum > 0.0 { sum } else { 0.0 }
    };
    let [a, b, c] = nodes;
    let (out, out_rest) = out.as_chunks_mut::<4>();
    let (m, m_rest) = centre.as_chunks::<4>();
    let ((a, a_rest), (b, b_rest), (c, c_rest)) =
        (a.as_chunks::<4>(), b.as_chunks::<4>(), c.as_chunks::<4>());
    for ((((out, m), a), b), c) in out.iter_mut().zip(m).zip(a).zip(b).zip(c) {
        for k in 0..4 {
            out[k] = mix(m[k], a[k], b[k], c[k]);
        }
    }
    for (k, out) in out_rest.iter_mut().enumerate() {
        *out = mix(m_rest[k], a_rest[k], b_rest[k], c_rest[k]);
    }
}

/// What a place parted from some elements by feet takes from others.
struct Parted {
    /// How much of the radiance as if nothing were parted stays: 0 but where that is extrapolated, and next
    /// to nothing is parted.
    whole: f64,
    /// The rest by (element, weight), sum 1.
    weights: Vec<(u32, f64)>,
}

/// Bilinear in the quarter of a quad element that holds `local` (0 to 1 each way).
fn quarter(border: &[u32], local: DVec2) -> Shares {
    // The border runs corner, middle, corner, ... from (0, 0) counter-clockwise.
    let (right, upper) = (local.x > 0.5, local.y > 0.5);
    let corner = match (right, upper) {
        (false, false) => 0,
        (true, false) => 2,
        (true, true) => 4,
        (false, true) => 6,
    };
    let (beside_u, beside_v) = (if upper { 5 } else { 1 }, if right { 3 } else { 7 });
    let DVec2 { x: s, y: t } = (2.0 * (local - 0.5)).abs();
    Shares {
        centre: (1.0 - s) * (1.0 - t),
        // `beside_u` is the middle of the edge above or below: the centre moved in v.
        nodes: [border[beside_v], border[beside_u], border[corner]],
        weights: [s * (1.0 - t), (1.0 - s) * t, s * t],
    }
}

/// Linear in the triangle centre, node, next node that holds `d` (from the centre, m).
fn fan(border: &[u32], places: &[[f32; 2]], d: DVec2) -> Shares {
    let place = |i: usize| DVec2::new(f64::from(places[i][0]), f64::from(places[i][1]));
    let n = border.len();
    let (mut best, mut inside) = (0, f64::NEG_INFINITY);
    for i in 0..n {
        let depth = place(i).perp_dot(d).min(d.perp_dot(place((i + 1) % n)));
        if depth > inside {
            (best, inside) = (i, depth);
        }
    }
    let (a, b) = (place(best), place((best + 1) % n));
    let det = a.perp_dot(b);
    let (s, t) = (d.perp_dot(b).max(0.0) / det, a.perp_dot(d).max(0.0) / det);
    // A place just outside, by rounding, takes the border's value.
    let over = (s + t).max(1.0);
    let (s, t) = if det > 0.0 { (s / over, t / over) } else { (0.0, 0.0) };
    let (a, b) = (border[best], border[(best + 1) % n]);
    Shares { centre: 1.0 - s - t, nodes: [a, b, b], weights: [s, t, 0.0] }
}

/// The cell at the deepest level, as the path of [`crate::points::Cell`], at (u, v) of a quad.
fn quad_code(uv: DVec2) -> u32 {
    let at = |x: f64| ((x * 65536.0) as u32).min(65535);
    let spread = |x: u32| {
        let x = (x | x << 8) & 0x00ff_00ff;
        let x = (x | x << 4) & 0x0f0f_0f0f;
        let x = (x | x << 2) & 0x3333_3333;
        (x | x << 1) & 0x5555_5555
    };
    spread(at(uv.x)) | spread(at(uv.y)) << 1
}

/// The same for a triangle: the weights of the corners become those in the child that holds them.
fn triangle_code(uv: DVec2) -> u32 {
    let mut w = [1.0 - uv.x - uv.y, uv.x, uv.y];
    let mut code = 0;
    for _ in 0..16 {
        let corner = w.iter().position(|&x| x >= 0.5);
        w = match corner {
            Some(0) => [w[0] - w[1] - w[2], 2.0 * w[1], 2.0 * w[2]],
            Some(1) => [2.0 * w[0], w[1] - w[0] - w[2], 2.0 * w[2]],
            Some(_) => [2.0 * w[0], 2.0 * w[1], w[2] - w[0] - w[1]],
            None => [w[1] + w[2] - w[0], w[0] + w[2] - w[1], w[0] + w[1] - w[2]],
        };
        code = code << 2 | corner.map_or(3, |c| c as u32);
    }
    code
}

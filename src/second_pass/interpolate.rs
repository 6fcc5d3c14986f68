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

use super::cells::Cells;
use super::chart::{Chart, LANES};
use super::cover::{StandIn, covered, stand_ins};
use super::feet::Feet;
use super::lattice::{Lattice, sheet};
use super::parted::{Parting, Weights};
use super::shares::{Mix, Shares, fan, quarter, quarters};
use super::stencil::Stencils;
use crate::first_pass::DiffuseSolution;
use crate::geometry::{Shape, Side, Surface, SurfaceId};
use crate::points::SamplePoints;
use crate::scene::Geometry;
use crate::tracers::RayTracer;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::ops::Range;

/// Where to look for the radiance of a place: depends on geometry and sample points alone.
pub struct Interpolator {
    /// Per surface.
    charts: Vec<Chart>,
    cells: Cells,
    /// By element, which is the index of its sample point.
    elements: Vec<Element>,
    lattice: Lattice,
    /// Place of every border node in the plane, relative to the element's centre, m.
    border_at: Vec<[f32; 2]>,
    stencils: Stencils,
    stand_ins: Vec<StandIn>,
    /// Elements on and around which something stands.
    partings: Vec<Parting>,
    /// Per surface: how far apart its sample points are, m.
    spacing: Vec<f64>,
    /// By element: the surface that it is on.
    surface: Vec<SurfaceId>,
}

/// Nothing stands on or around an element.
const OPEN: u32 = u32::MAX;

#[derive(Clone, Copy)]
struct Element {
    /// Lowest (u, v) of a quad's cell.
    low: DVec2,
    /// One over its size in u and v.
    scale: f64,
    /// Centre in the plane, m.
    centre: DVec2,
    /// Its nodes among those of all borders.
    border: [u32; 2],
    /// Whether the border is corner, middle, corner, middle and so on.
    regular: bool,
    /// Which of the partings is its own, or [`OPEN`].
    parting: u32,
}

impl Element {
    #[inline(always)]
    fn border(&self) -> Range<usize> {
        self.border[0] as usize..self.border[1] as usize
    }
}

impl Interpolator {
    /// Prepares the elements of `points`, which belong to `geometry`; `tracer` tells which of them
    /// are covered, and what stands between them.
    pub fn new(geometry: &Geometry, points: &SamplePoints, tracer: &dyn RayTracer) -> Self {
        let charts: Vec<Chart> = geometry.surfaces.iter().map(Chart::new).collect();
        let lattice = Lattice::new(geometry, points);
        let n = points.len();
        let sheet_of = |i: usize| sheet(points.surface[i].index(), points.side[i]);
        let triangle = |s: usize| matches!(geometry.surfaces[s / 2].shape, Shape::Triangle(_));
        let triangle: Vec<bool> = (0..2 * geometry.surfaces.len()).map(triangle).collect();
        let cells = Cells::new(&triangle, (0..n).map(|i| (sheet_of(i), points.cell[i], i as u32)));
        let mut elements = Vec::with_capacity(n);
        let (mut centres, mut normals) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut border_at = Vec::new();
        for i in 0..n {
            let (id, cell) = (points.surface[i], points.cell[i]);
            let surface = geometry.surface(id);
            let uv = cell.centre_uv(&surface.shape);
            let position = surface.point_at(uv.x, uv.y);
            let chart = &charts[id.index()];
            let centre = chart.plane_at(position, uv);
            for (&node, at) in lattice.border.of(i).iter().zip(lattice.border_uv(i)) {
                let at = chart.plane_at(lattice.position[node as usize], at);
                border_at.push((at - centre).as_vec2().to_array());
            }
            let border = lattice.border.range(i);
            elements.push(Element {
                low: cell.corners_uv(&surface.shape)[0],
                scale: f64::from(1u32 << cell.level),
                centre,
                border: [border.start as u32, border.end as u32],
                regular: lattice.regular[i],
                parting: OPEN,
            });
            centres.push(position);
            normals.push(surface.normal_at(position));
        }
        let feet = Feet::new(geometry, points, tracer, &lattice, &charts, &centres);
        let covered = covered(geometry, points, tracer, |surface, side, position| {
            let found = cells.find(sheet(surface.index(), side), charts[surface.index()].uv_of(position));
            found.map(|element| element as u32)
        });
        let stencils = Stencils::new(&lattice, &centres, &normals);
        let mut partings = Vec::new();
        for (i, element) in elements.iter_mut().enumerate().filter(|(i, _)| !feet.of(*i).is_empty()) {
            element.parting = partings.len() as u32;
            let chart = &charts[points.surface[i].index()];
            partings.push(Parting::new(i, feet.of(i), chart, &lattice, &stencils, &centres, &covered));
        }
        let stand_ins = stand_ins(&lattice, &centres, &covered);
        let mut fronts = vec![0u32; geometry.surfaces.len()];
        (0..n)
            .filter(|&i| points.side[i] == Side::Front)
            .for_each(|i| fronts[points.surface[i].index()] += 1);
        let apart = |(surface, &n): (&Surface, &u32)| (surface.area / f64::from(n.max(1))).sqrt();
        let spacing = geometry.surfaces.iter().zip(&fronts).map(apart).collect();
        let surface = points.surface.clone();
        Interpolator {
            charts,
            cells,
            elements,
            lattice,
            border_at,
            stencils,
            stand_ins,
            partings,
            spacing,
            surface,
        }
    }

    /// The covered sample points whose radiance those around them stand in for.
    pub fn covered(&self) -> impl Iterator<Item = usize> {
        self.stand_ins.iter().map(|s| s.element as usize)
    }

    /// Sample point `i` and those of its surface and side whose elements touch its own.
    pub fn around(&self, i: usize) -> Vec<u32> {
        self.lattice.around(i)
    }

    /// How far apart the sample points of a surface are, m.
    pub(super) fn spacing(&self, surface: SurfaceId) -> f64 {
        self.spacing[surface.index()]
    }

    /// The surface that an element is on.
    pub(super) fn surface(&self, element: usize) -> SurfaceId {
        self.surface[element]
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
        self.field_of(solution.radiance.clone(), solution.wavelengths.len())
    }

    /// [`Interpolator::field`] of any part of the radiance of the sample points, `[N][w]`.
    pub(super) fn field_of(&self, radiance: Vec<f32>, w: usize) -> DiffuseField<'_> {
        let mut spectra = self.centres(radiance, w);
        spectra.resize((self.len() + self.stencils.len()) * w, 0.0);
        let (centres, nodes) = spectra.split_at_mut(self.len() * w);
        let of = |element: u32| &centres[element as usize * w..];
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
        DiffuseField { interpolator: self, spectra, w }
    }

    /// Radiance at the centres of all elements, `[N][W]`, covered ones stood in for.
    fn centres(&self, mut centres: Vec<f32>, w: usize) -> Vec<f32> {
        for StandIn { element, from } in &self.stand_ins {
            for k in 0..w {
                let of = |e: u32| f64::from(centres[e as usize * w + k]);
                centres[*element as usize * w + k] = from.iter().map(|&(e, t)| t * of(e)).sum::<f64>() as f32;
            }
        }
        centres
    }
}

/// What a place takes.
pub(super) enum Found {
    /// Nothing: no sample point lies on its side.
    Black,
    /// All that its element offers.
    Whole(Taken),
    /// What is left of that.
    Parted(Apart),
}

/// What a place takes of an element.
#[derive(Clone, Copy, Default)]
pub(super) struct Taken {
    /// Which.
    pub element: u32,
    /// Of its centre and its nodes.
    pub shares: Shares,
}

/// A place that something may part from some of what is around it.
#[derive(Clone, Copy)]
pub(super) struct Apart {
    /// What it would take.
    taken: Taken,
    /// In the plane, m.
    place: DVec2,
}

/// L^d of a solution as a function of place.
pub struct DiffuseField<'a> {
    interpolator: &'a Interpolator,
    /// That of the centres of all elements, then that of all nodes: `[N + nodes][W]`.
    spectra: Vec<f32>,
    w: usize,
}

impl DiffuseField<'_> {
    /// L^d at `position` (local coordinates, on the surface) on one side, into `out[..W]`. A side
    /// without sample points is black.
    pub fn radiance(&self, surface: SurfaceId, side: Side, position: DVec3, out: &mut [f32]) {
        let out = &mut out[..self.w];
        match self.find(surface, side, position) {
            Found::Black => out.fill(0.0),
            Found::Whole(taken) => {
                self.blend(&taken, |at, group| out[at..at + group.len()].copy_from_slice(group))
            }
            Found::Parted(apart) => self.part(&apart, out, &mut Weights::default()),
        }
    }

    /// What a place takes, for [`DiffuseField::blend`] or, where something may part it from some of that, for
    /// [`DiffuseField::part`]; nothing where the side is black.
    #[inline(always)]
    pub(super) fn find(&self, surface: SurfaceId, side: Side, position: DVec3) -> Found {
        let chart = &self.interpolator.charts[surface.index()];
        self.find_at(chart, sheet(surface.index(), side), position, chart.uv_of(position))
    }

    /// The chart of a surface and the number of its side, for [`DiffuseField::find_at`] and [`DiffuseField::find_alike`].
    #[inline(always)]
    pub(super) fn side(&self, surface: SurfaceId, side: Side) -> (&Chart, usize) {
        (&self.interpolator.charts[surface.index()], sheet(surface.index(), side))
    }

    /// What the first `count` of several places of a sheet take together, which lie at `uv` (a column for each), if
    /// they all take from the same centre and nodes: the element, these nodes and the sums of the weights.
    #[inline(always)]
    pub(super) fn find_alike(
        &self,
        sheet: usize,
        uv: &[[f64; LANES]; 2],
        count: usize,
    ) -> Option<(u32, [u32; 3], [f64; 4])> {
        let of = self.interpolator;
        let first = of.cells.find(sheet, DVec2::new(uv[0][0], uv[1][0]))?;
        let element = &of.elements[first];
        if !element.regular {
            return None;
        }
        let (low, scale) = (element.low, element.scale);
        let (nodes, sums) = quarters(&[low.x, low.y, scale], uv, count)?;
        let open = element.parting == OPEN || of.partings[element.parting as usize].is_open(nodes);
        open.then_some((first as u32, nodes, sums))
    }

    /// What the place `position` of a sheet takes, which lies at `uv`.
    #[inline(always)]
    pub(super) fn find_at(&self, chart: &Chart, sheet: usize, position: DVec3, uv: DVec2) -> Found {
        let of = self.interpolator;
        let Some(i) = of.cells.find(sheet, uv) else { return Found::Black };
        let element = &of.elements[i];
        let shares = if element.regular {
            quarter(((uv - element.low) * element.scale).clamp(DVec2::ZERO, DVec2::ONE))
        } else {
            fan(&of.border_at[element.border()], chart.plane(position) - element.centre)
        };
        let taken = Taken { element: i as u32, shares };
        if element.parting == OPEN {
            return Found::Whole(taken);
        }
        let place = chart.plane(position);
        if !of.partings[element.parting as usize].parts(place, shares.nodes) {
            return Found::Whole(taken);
        }
        Found::Parted(Apart { taken, place })
    }

    /// The spectrum of what is taken, to `put` in groups: at which wavelength one begins, and its numbers.
    #[inline(always)]
    pub(super) fn blend(&self, taken: &Taken, put: impl FnMut(usize, &[f32])) {
        let of = self.interpolator;
        let Taken { element, shares: Shares { centre, nodes, weights: [a, b, c] } } = *taken;
        let (count, border) = (of.elements.len() as u32, of.lattice.border.all());
        let start = of.elements[element as usize].border[0];
        let [p, q, r] = nodes.map(|node| count + border[(start + node) as usize]);
        let mix = Mix { spectra: [element, p, q, r], weights: [centre, a, b, c] };
        mix.blend(&self.spectra, self.w, put);
    }

    /// The spectrum of a place that something may part from some of what is around it, into `out`, which is as long as
    /// a spectrum.
    #[inline(always)]
    pub(super) fn part(&self, apart: &Apart, out: &mut [f32], room: &mut Weights) {
        let Apart { taken, place } = apart;
        self.blend(taken, |at, group| out[at..at + group.len()].copy_from_slice(group));
        let of = self.interpolator;
        let parting = &of.partings[of.elements[taken.element as usize].parting as usize];
        let Some(whole) = parting.weigh(*place, &taken.shares, room) else { return };
        out.iter_mut().for_each(|out| *out *= whole as f32);
        for &(element, weight) in room.all() {
            let weight = ((1.0 - whole) * weight) as f32;
            let centre = &self.spectra[element as usize * self.w..][..self.w];
            for (out, centre) in out.iter_mut().zip(centre) {
                *out += weight * centre;
            }
        }
    }

    /// Feeds all that the radiance depends on, but for the geometry, to `hasher`.
    pub(super) fn hash(&self, hasher: &mut blake3::Hasher) {
        self.interpolator.cells.hash(hasher);
        for chunk in self.spectra.chunks(1 << 12) {
            hasher.update(&chunk.iter().flat_map(|l| l.to_le_bytes()).collect::<Vec<u8>>());
        }
    }
}

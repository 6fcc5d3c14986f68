//! What a ray cannot meet, eight surfaces at a time in `f32`.
//!
//! Every surface lies in an oriented box: flat surfaces in one without thickness, so that the test is nearly as
//! sharp as the surface itself. The test may keep what the ray misses but never drops what it meets: its
//! bound on rounding is derived in [`Line`]. What it keeps is decided in `f64`.

use crate::geometry::{Aabb, Round, Surface};
use crate::simd::fetch;
use glam::{DMat3, DVec3};

/// Boxes side by side: one register of AVX2.
pub(super) const LANES: usize = 8;

/// A box turned to fit what lies in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct OrientedBox {
    /// Unit axes as columns; along the last it is thinnest.
    axes: DMat3,
    /// Along the axes, m.
    centre: DVec3,
    /// Half edge lengths, m.
    half: DVec3,
}

impl OrientedBox {
    /// Whether its axes are not those of space.
    fn is_turned(&self) -> bool {
        let along = |axis: DVec3| axis.abs().max_element() > 1.0 - 1e-9;
        !(along(self.axes.x_axis) && along(self.axes.y_axis))
    }

    /// A box around part number `part` of `surface`: flat, its first axis along an edge, where the surface is.
    pub fn around(surface: &Surface, part: usize) -> Self {
        let n = surface.plane().map_or(DVec3::Z, |plane| plane.normal);
        if let Some(Round::Patch(patch)) = surface.round() {
            let part = &patch.parts()[part];
            let (n, x) = part.frame();
            let room = part.room();
            let fit = OrientedBox::of_points(part.net.as_flattened(), DMat3::from_cols(x, n.cross(x), n));
            return OrientedBox { half: fit.half + room, ..fit };
        }
        if let Some(round) = surface.round() {
            let x = n.any_orthonormal_vector();
            let axes = DMat3::from_cols(x, n.cross(x), n);
            let radius = round.radius();
            let half = DVec3::new(radius, radius, if surface.is_planar() { 0.0 } else { radius });
            return OrientedBox { axes, centre: axes.transpose() * round.centre(), half };
        }
        let corners = surface.vertices();
        let along = corners[1] - corners[0];
        let x = (along - along.dot(n) * n).try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
        OrientedBox::of_points(corners, DMat3::from_cols(x, n.cross(x), n))
    }

    /// The smallest box with these axes around `points`.
    fn of_points(points: &[DVec3], axes: DMat3) -> Self {
        let places = points.iter().map(|&v| axes.transpose() * v);
        let (low, high) =
            places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        OrientedBox { axes, centre: 0.5 * (low + high), half: 0.5 * (high - low) }
    }
}

/// What surfaces lie in: boxes along the axes of space, and turned ones where those are smaller.
#[derive(Clone, Debug, Default)]
pub(super) struct Blocks {
    blocks: Vec<Block>,
    turned: Vec<Turned>,
}

/// Eight boxes along the axes of space, structure of arrays.
#[derive(Clone, Debug)]
#[repr(align(64))]
struct Block {
    /// Their middles.
    centre: [[f32; LANES]; 3],
    /// Their half edge lengths.
    half: [[f32; LANES]; 3],
    /// What the boxes hold.
    ids: [u32; LANES],
    /// Which lanes hold a box: byte `l` is 1 or 0 for lane `l`.
    used: u64,
    /// The turned boxes of the same surfaces, where they are smaller; else [`NOT_TURNED`].
    turned: u32,
}

/// See [`Block::turned`].
const NOT_TURNED: u32 = u32::MAX;

/// Eight turned boxes, structure of arrays.
#[derive(Clone, Debug)]
#[repr(align(64))]
struct Turned {
    /// For each axis: its three components and the centre along it.
    axes: [[[f32; LANES]; 4]; 3],
    /// Half edge lengths.
    half: [[f32; LANES]; 3],
}

impl Blocks {
    /// How many blocks there are.
    pub fn count(&self) -> usize {
        self.blocks.len()
    }

    /// Adds a block of at most eight: numbers, boxes along the axes of space, and turned ones.
    pub fn push(&mut self, surfaces: impl Iterator<Item = (u32, Aabb, OrientedBox)> + Clone) {
        let mut block = Block {
            centre: [[0.0; LANES]; 3],
            half: [[0.0; LANES]; 3],
            ids: [u32::MAX; LANES],
            used: 0,
            turned: NOT_TURNED,
        };
        for (lane, (id, bounds, _)) in surfaces.clone().take(LANES).enumerate() {
            let (centre, half) = (bounds.centre().as_vec3(), 0.5 * bounds.size().as_vec3());
            for k in 0..3 {
                block.centre[k][lane] = centre[k];
                block.half[k][lane] = half[k];
            }
            block.ids[lane] = id;
            block.used |= 1 << (8 * lane);
        }
        if surfaces.clone().any(|(_, _, fit)| fit.is_turned()) {
            block.turned = self.turned.len() as u32;
            self.turned.push(Turned::new(surfaces.map(|(.., fit)| fit)));
        }
        self.blocks.push(block);
    }

    /// Asks for block `index` ahead of time.
    #[inline(always)]
    pub fn fetch(&self, index: usize) {
        let Block { centre, half, ids, .. } = &self.blocks[index];
        fetch(&centre[0]);
        fetch(&centre[2]);
        fetch(&half[1]);
        fetch(ids);
    }

    /// The lanes of block `index` of which `line` may meet the box within the `stretch`, byte `l` 1 or 0 for lane
    /// `l`, and what they hold.
    #[inline(always)]
    pub fn candidates(&self, index: usize, line: &Line, stretch: &Stretch) -> (u64, &[u32; LANES]) {
        let block = &self.blocks[index];
        let mut kept = block.candidates(line, stretch);
        if kept != 0 && block.turned != NOT_TURNED {
            kept &= self.turned[block.turned as usize].candidates(line, stretch);
        }
        (kept, &block.ids)
    }
}

impl Block {
    /// Of which boxes c + t d with |t| up to the reach meets the one around m with half edges h: no axis of space
    /// parts them, |c - m| <= h + reach |d|, and neither does one across the line and an axis of space,
    /// |(c - m)_u d_v - (c - m)_v d_u| <= h_u |d_v| + h_v |d_u|.
    // One lane of several columns at a time, which the compiler makes one register of.
    #[allow(clippy::needless_range_loop)]
    #[inline(always)]
    fn candidates(&self, line: &Line, stretch: &Stretch) -> u64 {
        let ([dx, dy, dz], error) = (line.direction, line.error);
        let [x, y, z] = stretch.centre;
        let [rx, ry, rz] = [dx, dy, dz].map(|d| stretch.reach * d.abs() + error);
        let mut missed = [0u8; LANES];
        for l in 0..LANES {
            let [hx, hy, hz] = [self.half[0][l], self.half[1][l], self.half[2][l]];
            let [ox, oy, oz] = [x - self.centre[0][l], y - self.centre[1][l], z - self.centre[2][l]];
            let beyond = |o: f32, h: f32, r: f32| o.abs() - (h + r);
            let beside = |(o, d, h): (f32, f32, f32), (p, e, k): (f32, f32, f32)| {
                (o * e - p * d).abs() - (h * e.abs() + k * d.abs() + error)
            };
            let [at_x, at_y, at_z] = [(ox, dx, hx), (oy, dy, hy), (oz, dz, hz)];
            let along = larger(larger(beyond(ox, hx, rx), beyond(oy, hy, ry)), beyond(oz, hz, rz));
            let across = larger(larger(beside(at_x, at_y), beside(at_y, at_z)), beside(at_z, at_x));
            // What is not a number decides nothing.
            missed[l] = u8::from(larger(along, across) > 0.0);
        }
        !u64::from_le_bytes(missed) & self.used
    }
}

impl Turned {
    fn new(boxes: impl Iterator<Item = OrientedBox>) -> Self {
        let mut turned = Turned { axes: [[[0.0; LANES]; 4]; 3], half: [[0.0; LANES]; 3] };
        for (lane, fit) in boxes.take(LANES).enumerate() {
            for k in 0..3 {
                let axis = fit.axes.col(k).as_vec3();
                let row = [axis.x, axis.y, axis.z, fit.centre[k] as f32];
                for (values, value) in turned.axes[k].iter_mut().zip(row) {
                    values[lane] = value;
                }
                turned.half[k][lane] = fit.half[k] as f32;
            }
        }
        turned
    }

    /// In the frame of a box with half edges h, the line o + t d meets it only if it comes close enough along the
    /// thin axis n within the limits, and if its projections along the other axes, u and v, do not pass it by:
    /// |o_u d_n - o_n d_u| <= h_u |d_n| + h_n |d_u|.
    #[inline(always)]
    fn candidates(&self, line: &Line, stretch: &Stretch) -> u64 {
        let [x, y, z] = stretch.centre;
        let [dx, dy, dz] = line.direction;
        let mut missed = [0u8; LANES];
        for l in 0..LANES {
            let origin = |k: usize| {
                let [ax, ay, az, c] = &self.axes[k];
                ax[l] * x + ay[l] * y + az[l] * z - c[l]
            };
            let direction = |k: usize| {
                let [ax, ay, az, _] = &self.axes[k];
                ax[l] * dx + ay[l] * dy + az[l] * dz
            };
            let [half_u, half_v, half_n] = [self.half[0][l], self.half[1][l], self.half[2][l] + line.error];
            let (o_n, d_n) = (origin(2), direction(2));
            let beyond = o_n.abs() - (half_n + stretch.reach * d_n.abs());
            let beside = |k: usize, half: f32| {
                let (o, d) = (origin(k), direction(k));
                (o * d_n - o_n * d).abs() - (half * d_n.abs() + half_n * d.abs() + line.error)
            };
            let miss = larger(beyond, larger(beside(0, half_u), beside(1, half_v)));
            missed[l] = u8::from(miss > 0.0);
        }
        !u64::from_le_bytes(missed)
    }
}

/// The larger of two, `b` where one is not a number: an instruction.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// A ray in `f32`: a direction of which the largest component is 1.
///
/// The bound: let R be the largest distance from the local origin of the middle of a [`Stretch`] and of box centres,
/// and u = 2⁻²⁴. The direction is at most D = √3 long. Rounding the middle, the direction, an axis and a centre and
/// summing costs at most 16 u R for a coordinate of the middle in a box's frame (at most 2 R), and 8 u D for one of
/// the direction (at most D). Along n, where the reach, times D, is at most 4 R, that makes 16 u R + 4 R · 8 u, and 16
/// u R for the reach and the last sums: 64 u R. Beside, each of two products errs by 2 R · 8 u D + 16 u R D, each of
/// two half edges (at most 2 R) times a direction by 20 u R D, and the sums by 8 u R D: under 128 u R D in all. Boxes
/// along the axes of space are spared the turning and err by less. `error` is 512 u R, and what rounding in
/// `f64` may add where the ray comes from afar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    direction: [f32; 3],
    error: f32,
}

impl Line {
    /// The line along `direction` within `reach` of the local origin, of a ray that begins at `origin`.
    #[inline(always)]
    pub fn new(direction: DVec3, origin: DVec3, reach: f64) -> Self {
        let afar = 64.0 * f64::EPSILON * (origin.x.abs() + origin.y.abs() + origin.z.abs());
        Line {
            direction: direction.as_vec3().to_array(),
            error: (ROUNDING * reach + afar) as f32 + f32::MIN_POSITIVE,
        }
    }
}

/// Part of a [`Line`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    centre: [f32; 3],
    reach: f32,
}

impl Stretch {
    /// What lies around `centre`, `reach` times the line's direction either way.
    #[inline(always)]
    pub fn new(centre: DVec3, reach: f64) -> Self {
        Stretch { centre: centre.as_vec3().to_array(), reach: reach as f32 }
    }
}

/// 512 units of rounding: see [`Line`].
const ROUNDING: f64 = 512.0 / (1u32 << 24) as f64;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;

    /// Lines to places on the surfaces, to edges and corners too, near and far, with limits that leave no room: what
    /// they meet is kept, and most of the rest is not.
    #[test]
    fn what_is_met_is_kept_and_most_else_is_not() {
        let mut state = 1u64;
        let mut unit = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let (mut lines, mut kept) = (0u32, 0u32);
        for scale in [1e-9, 1.0, 1e12] {
            for _ in 0..200 {
                let mut place = || scale * (DVec3::new(unit(), unit(), unit()) * 2.0 - 1.0);
                let surfaces: [Surface; LANES] = std::array::from_fn(|k| {
                    let (o, x, y) = (place(), 0.3 * place(), 0.3 * place());
                    // Some bent, some triangles.
                    let bend = if k % 3 == 0 { 0.05 * place() } else { DVec3::ZERO };
                    let shape = if k % 4 == 1 {
                        Shape::Triangle([o, o + x, o + y])
                    } else {
                        Shape::Quad([o, o + x, o + x + y + bend, o + y])
                    };
                    Surface::new(shape.placed(|p| p.as_vec3().as_dvec3()))
                });
                let mut blocks = Blocks::default();
                blocks.push(
                    surfaces
                        .iter()
                        .enumerate()
                        .map(|(k, s)| (k as u32, s.bounds(), OrientedBox::around(s, 0))),
                );
                for (lane, surface) in surfaces.iter().enumerate() {
                    for corner in 0..4 {
                        // On one of the triangles that stand for the surface: inside, on an edge, at a corner.
                        let (triangles, count) = surface.triangles();
                        let [a, b, c] = triangles[corner % count];
                        let (s, t) = match corner {
                            0 => (0.5 * unit(), 0.5 * unit()),
                            1 => (0.0, unit()),
                            2 => (1.0, 0.0),
                            _ => (0.0, 0.0),
                        };
                        let target = a + s * (b - a) + t * (c - a);
                        let start = scale * (DVec3::new(unit(), unit(), unit()) * 2.0 - 1.0);
                        let way = target - start;
                        let length = way.abs().max_element();
                        let line = Line::new(way / length, start, 3.0 * scale);
                        let (found, _) = blocks.candidates(0, &line, &Stretch::new(target, 0.0));
                        assert!(
                            found >> (8 * lane) & 1 == 1,
                            "{:?} from {start} to {target}",
                            surfaces[lane]
                        );
                        (lines, kept) = (lines + 1, kept + found.count_ones());
                    }
                }
            }
        }
        assert!(f64::from(kept) < 1.2 * f64::from(lines), "{kept} kept for {lines} met");
    }

    #[test]
    fn lanes_without_a_box_are_never_kept() {
        let mut blocks = Blocks::default();
        blocks.push([].into_iter());
        let line = Line::new(DVec3::X, DVec3::ZERO, 1.0);
        for limit in [0.0, f64::INFINITY, f64::NAN] {
            let (found, _) = blocks.candidates(0, &line, &Stretch::new(DVec3::splat(limit), limit));
            assert_eq!(found, 0);
        }
    }
}

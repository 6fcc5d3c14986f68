//! Rays on their way to Embree.

use super::raw::{EMPTY_RAY, LANES, LARGEST, Query, lux_packet, lux_ray};
use crate::geometry::Ray;
use crate::simd::HotLoop;

/// Units in the last place (`f32`) of the scene's size by which Embree's distances are taken to be
/// uncertain, so that the limits of a ray can be decided in `f64`.
pub const LIMIT_ULPS: f64 = 32.0;

/// How Embree's scene lies to ours.
#[derive(Clone, Copy)]
pub struct Frame {
    /// Distance of the furthest corner from the local origin, m.
    pub radius: f64,
    /// Lengths in Embree's scene over lengths in ours: a power of two.
    pub scale: f64,
}

/// How Embree's ray parameter lies to the caller's.
#[derive(Clone, Copy)]
pub struct Span {
    /// How far the origin was moved, m.
    pub moved: f64,
    /// One over the length of the caller's direction.
    pub shrink: f64,
}

impl Span {
    /// The caller's ray parameter at Embree's `t`.
    #[inline(always)]
    pub fn parameter(&self, t: f32, frame: &Frame) -> f64 {
        (self.moved + f64::from(t) * (1.0 / frame.scale)) * self.shrink
    }
}

/// A ray in `f32`, before it is known to be one.
struct Rounded {
    origin: [f32; 3],
    direction: [f32; 3],
    t_min: f32,
    t_max: f32,
    /// Whether Embree may see it: limits that are no limits (NaN), or that exclude one another, hit nothing.
    sound: bool,
    span: Span,
}

/// A ray as Embree sees it: unit direction, so that its parameter is a length, and an origin that is
/// moved up to the scene if it lies far before it, so that rounding it to `f32` costs nothing.
#[inline(always)]
fn round([ox, oy, oz]: [f64; 3], [dx, dy, dz]: [f64; 3], limits: [f64; 2], frame: &Frame) -> Rounded {
    let Frame { radius, scale } = *frame;
    let length = (dx * dx + dy * dy + dz * dz).sqrt();
    let shrink = 1.0 / length;
    let unit = [shrink * dx, shrink * dy, shrink * dz];
    let (start, end) = (limits[0] * length, limits[1] * length);
    // No surface lies before the tangent plane of the sphere around the scene.
    let entry = -(ox * unit[0] + oy * unit[1] + oz * unit[2]) - 1.01 * radius;
    let ahead = if entry > start { entry } else { start };
    let moved = if (entry > 0.0) | (start < 0.0) { ahead } else { 0.0 };
    let origin = [ox + moved * unit[0], oy + moved * unit[1], oz + moved * unit[2]];
    let bound = length_bound(origin);
    let slack = LIMIT_ULPS * f64::from(f32::EPSILON) * (radius + bound);
    let from = scale * (start - moved - slack);
    let t_min = (if from > 0.0 { from } else { 0.0 }) as f32;
    let t_max = (scale * (end - moved + slack)) as f32;
    let origin = origin.map(|x| (scale * x) as f32);
    let direction = unit.map(|x| x as f32);
    let small = |[x, y, z]: [f32; 3]| (x.abs() <= LARGEST) & (y.abs() <= LARGEST) & (z.abs() <= LARGEST);
    let sound = (limits[0] < limits[1]) & (t_min <= t_max) & small(origin) & small(direction);
    Rounded { origin, direction, t_min, t_max, sound, span: Span { moved, shrink } }
}

/// One ray as Embree sees it, and what its parameter means.
#[inline]
pub fn single(ray: &Ray, frame: &Frame) -> (lux_ray, Span) {
    let rounded = round(ray.origin.to_array(), ray.direction.to_array(), [ray.t_min, ray.t_max], frame);
    let Rounded { origin, direction, t_min, t_max, sound, span } = rounded;
    (if sound { lux_ray { origin, t_min, direction, t_max } } else { EMPTY_RAY }, span)
}

/// The rays of a packet as they came, a column for each number, and what their parameters mean.
#[derive(Clone, Copy)]
pub struct Columns {
    /// Origin, m.
    pub origin: [[f64; LANES]; 3],
    /// Direction.
    pub direction: [[f64; LANES]; 3],
    /// Hits at or before this parameter do not count.
    pub t_min: [f64; LANES],
    /// Hits at or beyond this parameter do not count.
    pub t_max: [f64; LANES],
    moved: [f64; LANES],
    shrink: [f64; LANES],
}

impl Columns {
    /// No ray: limits that exclude one another.
    pub const EMPTY: Columns = Columns {
        origin: [[0.0; LANES]; 3],
        direction: [[0.0; LANES]; 3],
        t_min: [0.0; LANES],
        t_max: [0.0; LANES],
        moved: [0.0; LANES],
        shrink: [1.0; LANES],
    };

    /// What the parameter of a lane means.
    #[inline(always)]
    pub fn span(&self, lane: usize) -> Span {
        Span { moved: self.moved[lane], shrink: self.shrink[lane] }
    }

    /// Up to [`LANES`] rays.
    #[inline(always)]
    fn fill(&mut self, rays: &[Ray]) {
        if rays.len() < LANES {
            *self = Columns::EMPTY;
        }
        for (lane, ray) in rays.iter().enumerate().take(LANES) {
            for axis in 0..3 {
                self.origin[axis][lane] = ray.origin[axis];
                self.direction[axis][lane] = ray.direction[axis];
            }
            self.t_min[lane] = ray.t_min;
            self.t_max[lane] = ray.t_max;
        }
    }

    /// The rays as Embree sees them.
    #[inline(always)]
    fn pack(&mut self, frame: &Frame, packet: &mut lux_packet) {
        let Columns { origin: [ox, oy, oz], direction: [dx, dy, dz], t_min, t_max, .. } = self;
        for i in 0..LANES {
            let ray = round([ox[i], oy[i], oz[i]], [dx[i], dy[i], dz[i]], [t_min[i], t_max[i]], frame);
            let or = |x: f32, other: f32| if ray.sound { x } else { other };
            for axis in 0..3 {
                packet.origin[axis][i] = or(ray.origin[axis], 0.0);
                packet.direction[axis][i] = or(ray.direction[axis], 1.0);
            }
            packet.t_min[i] = or(ray.t_min, 0.0);
            packet.t_max[i] = or(ray.t_max, -1.0);
            packet.limit[i] = or(ray.t_max, -1.0);
            self.moved[i] = ray.span.moved;
            self.shrink[i] = ray.span.shrink;
        }
    }
}

/// Rays on their way into packets.
pub struct Pack<'a> {
    /// The rays.
    pub rays: &'a [Ray],
    /// How Embree's scene lies.
    pub frame: &'a Frame,
    /// Where they go, [`LANES`] to each; lanes that are left become empty.
    pub packets: &'a mut [Query],
    /// Where they go as they are.
    pub columns: &'a mut [Columns],
}

impl HotLoop for Pack<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for ((rays, packet), columns) in self.rays.chunks(LANES).zip(self.packets).zip(self.columns) {
            columns.fill(rays);
            columns.pack(self.frame, &mut packet.0.rays);
        }
    }
}

/// No less than the length of a vector, and no more than √3 times it: without a root.
#[inline(always)]
pub fn length_bound([x, y, z]: [f64; 3]) -> f64 {
    x.abs() + y.abs() + z.abs()
}

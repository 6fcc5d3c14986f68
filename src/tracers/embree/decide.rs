//! Deciding in `f64` on what Embree found, a packet at a time.

use super::face::{Face, REACH, confirmed, crossing, grazes, meets_front};
use super::query::{Columns, Frame};
use super::raw::{LANES, LUX_MISS, lux_hits};
use crate::geometry::{Hit, Side, SurfaceId};
use crate::simd::HotLoop;

/// Decides on packets.
pub struct Decide<'a> {
    /// By surface.
    pub faces: &'a [Face],
    /// How Embree's scene lies.
    pub frame: &'a Frame,
    /// The rays.
    pub rays: &'a [Columns],
    /// What Embree found.
    pub found: &'a [lux_hits],
    /// What counts; no longer than there are rays.
    pub hits: &'a mut [Option<Hit>],
    /// For each packet the lanes that are left to be decided one by one, a bit each: where what was found does not
    /// count or the ray runs flat along it, or a lane met what is no polygon.
    pub left: &'a mut [u16],
}

impl HotLoop for Decide<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut planes = Planes::NONE;
        let packets = self.rays.iter().zip(self.found).zip(self.hits.chunks_mut(LANES)).zip(self.left);
        for (((rays, found), hits), left) in packets {
            *left = if planes.gather(self.faces, found) {
                planes.decide(self.frame, rays, found, hits)
            } else {
                u16::MAX
            };
        }
    }
}

/// What the rays of a packet meet, a column for each number.
struct Planes {
    corner: [[f64; LANES]; 3],
    across: [[f64; LANES]; 3],
    normal: [[f64; LANES]; 3],
    low: [[f64; LANES]; 3],
    high: [[f64; LANES]; 3],
}

/// Row `i` of three columns.
#[inline(always)]
fn row(columns: &[[f64; LANES]; 3], i: usize) -> [f64; 3] {
    [columns[0][i], columns[1][i], columns[2][i]]
}

impl Planes {
    const NONE: Planes = {
        let none = [[0.0; LANES]; 3];
        Planes { corner: none, across: none, normal: none, low: none, high: none }
    };

    /// What was found, unless a lane met what is no polygon. Lanes that met nothing keep what they had.
    #[inline(always)]
    fn gather(&mut self, faces: &[Face], found: &lux_hits) -> bool {
        let first = found.surface[0];
        // Most packets from the eye meet one surface.
        if found.surface.iter().fold(true, |same, &surface| same & (surface == first)) {
            let Some(face) = faces.get(first as usize) else { return true };
            let (Some(one), Some(other)) = (face.plane(0), face.plane(1)) else { return false };
            let [low, high] = face.corners();
            for axis in 0..3 {
                for i in 0..LANES {
                    let of = |k: usize| if found.part[i] == 1 { other[k][axis] } else { one[k][axis] };
                    (self.corner[axis][i], self.across[axis][i]) = (of(0), of(1));
                }
                self.normal[axis] = [one[2][axis]; LANES];
                self.low[axis] = [low[axis]; LANES];
                self.high[axis] = [high[axis]; LANES];
            }
            return true;
        }
        for i in 0..LANES {
            let Some(face) = faces.get(found.surface[i] as usize) else { continue };
            let Some([corner, across, normal]) = face.plane(found.part[i]) else { return false };
            let [low, high] = face.corners();
            for axis in 0..3 {
                self.corner[axis][i] = corner[axis];
                self.across[axis][i] = across[axis];
                self.normal[axis][i] = normal[axis];
                self.low[axis][i] = low[axis];
                self.high[axis][i] = high[axis];
            }
        }
        true
    }

    /// Writes down what counts; the lanes that met something which does not, or that run flat along what they met.
    #[inline(always)]
    fn decide(&self, frame: &Frame, rays: &Columns, found: &lux_hits, hits: &mut [Option<Hit>]) -> u16 {
        let (mut t, mut counts) = ([0.0; LANES], [false; LANES]);
        let (mut within, mut front) = ([false; LANES], [false; LANES]);
        let mut flat = [false; LANES];
        for i in 0..LANES {
            let ray = [row(&rays.origin, i), row(&rays.direction, i)];
            let span = rays.span(i);
            let rough = span.parameter(found.t[i], frame);
            let exact = crossing(ray, [row(&self.corner, i), row(&self.across, i)]);
            let reach = REACH * frame.radius * span.shrink;
            let bounds = [row(&self.low, i), row(&self.high, i)];
            (t[i], counts[i]) = confirmed(ray, rays.t_min[i], [rough, exact, reach], bounds);
            within[i] = t[i] < rays.t_max[i];
            flat[i] = grazes(row(&self.across, i), ray[1], 1.0 / (span.shrink * span.shrink));
            front[i] = meets_front(row(&self.normal, i), ray[1]);
        }
        let mut left = 0;
        for (i, hit) in hits.iter_mut().enumerate().take(LANES) {
            let met = found.surface[i] != LUX_MISS;
            let side = if front[i] { Side::Front } else { Side::Back };
            let at = Hit { surface: SurfaceId(found.surface[i]), t: t[i], side };
            *hit = (met & counts[i] & within[i]).then_some(at);
            left |= u16::from(met & (!counts[i] | flat[i])) << i;
        }
        left
    }
}

//! Segments on their way into packets.

use super::raw::{EMPTY_PACKET, LANES, Packet, lux_packet};
use crate::simd::HotLoop;
use glam::Vec3;

/// The rays of up to [`LANES`] segments, from one end of each to the other less its margins.
pub struct Filling {
    packet: Packet,
    /// The far ends, m.
    to: [[f32; LANES]; 3],
    /// Lanes that are filled.
    count: usize,
}

impl Filling {
    /// No ray.
    pub fn new() -> Self {
        Filling { packet: EMPTY_PACKET, to: [[0.0; LANES]; 3], count: 0 }
    }

    /// Adds a segment; true when that was the last there is room for.
    #[inline]
    pub fn push(&mut self, from: Vec3, to: Vec3) -> bool {
        let lane = self.count % LANES;
        let rays = &mut self.packet.0;
        for (axis, (x, y)) in from.to_array().into_iter().zip(to.to_array()).enumerate() {
            rays.origin[axis][lane] = x;
            self.to[axis][lane] = y;
        }
        self.count = lane + 1;
        self.count == LANES
    }

    /// How many segments are in.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The rays at `scale` times their size, in the packet; the next segment begins another.
    #[inline]
    pub fn rays(&mut self, scale: f32) -> &mut [Packet] {
        crate::simd::wide(Finish { rays: &mut self.packet.0, to: &self.to, scale });
        for lane in self.count..LANES {
            self.packet.0.t_max[lane] = -1.0;
        }
        self.count = 0;
        std::slice::from_mut(&mut self.packet)
    }
}

/// Makes rays of the ends of segments.
struct Finish<'a> {
    rays: &'a mut lux_packet,
    to: &'a [[f32; LANES]; 3],
    scale: f32,
}

impl HotLoop for Finish<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Finish { rays, to, scale } = self;
        for i in 0..LANES {
            let from = Vec3::new(rays.origin[0][i], rays.origin[1][i], rays.origin[2][i]);
            let to = Vec3::new(to[0][i], to[1][i], to[2][i]);
            let margin = crate::tracers::Segment { from, to }.margin();
            let (origin, direction) = (scale * from, scale * (to - from));
            for axis in 0..3 {
                rays.origin[axis][i] = origin[axis];
                rays.direction[axis][i] = direction[axis];
            }
            rays.t_min[i] = margin;
            rays.t_max[i] = 1.0 - margin;
            rays.limit[i] = 1.0 - margin;
        }
    }
}

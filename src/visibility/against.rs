//! How many points lie against one blocker: signed distances from its plane and ratios to its edges, all at once.

use super::blocker::Blocker;
use crate::simd::{HotLoop, widest};
use glam::DVec3;

/// Words of a row.
pub(super) const WORDS: usize = 4;

/// No side of a block has more points.
pub(super) const SIDE: usize = 32 * WORDS;

/// A bit for each point of a side.
pub(super) type Bits = [u32; WORDS];

/// Bits of the lanes of a word.
pub(super) const LANES: [u32; 32] = {
    let mut bits = [0; 32];
    let mut i = 0;
    while i < 32 {
        bits[i] = 1 << i;
        i += 1;
    }
    bits
};

/// The places of one side's points, structure of arrays, m.
#[derive(Debug)]
pub(super) struct Places {
    x: [f64; SIDE],
    y: [f64; SIDE],
    z: [f64; SIDE],
    /// How many there are.
    pub count: usize,
}

impl Places {
    /// No point.
    pub const NONE: Places = Places { x: [0.0; SIDE], y: [0.0; SIDE], z: [0.0; SIDE], count: 0 };

    /// Takes the first [`SIDE`] of `places`.
    pub fn set(&mut self, places: impl Iterator<Item = DVec3>) {
        self.count = 0;
        for (i, p) in places.take(SIDE).enumerate() {
            (self.x[i], self.y[i], self.z[i]) = (p.x, p.y, p.z);
            self.count = i + 1;
        }
        // What is left over of another block would be computed with, for nothing.
        for i in self.count..self.count.next_multiple_of(32) {
            (self.x[i], self.y[i], self.z[i]) = (0.0, 0.0, 0.0);
        }
    }

    /// Where point `i` is.
    #[inline(always)]
    pub fn at(&self, i: usize) -> [f64; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }

    /// Words with a point in them.
    pub fn words(&self) -> usize {
        self.count.div_ceil(32)
    }

    /// The points whose distance above the plane `normal · x = offset` is more than `least`.
    pub fn above(&self, normal: DVec3, offset: f64, least: f64) -> Bits {
        widest(Above { places: self, normal, offset, least })
    }
}

/// See [`Places::above`].
struct Above<'a> {
    places: &'a Places,
    normal: DVec3,
    offset: f64,
    least: f64,
}

impl HotLoop for Above<'_> {
    type Output = Bits;

    #[inline(always)]
    fn run(self) -> Bits {
        let Above { places: Places { x, y, z, count }, normal, offset, least } = self;
        let mut bits = [0; WORDS];
        for (w, word) in bits.iter_mut().enumerate().take(count.div_ceil(32)) {
            for (lane, bit) in LANES.iter().enumerate() {
                let i = 32 * w + lane;
                let height = normal.x * x[i] + normal.y * y[i] + normal.z * z[i] - offset;
                *word |= if height > least { *bit } else { 0 };
            }
        }
        only_first(bits, *count)
    }
}

/// `bits` without those from the `count`th on.
fn only_first(mut bits: Bits, count: usize) -> Bits {
    for (w, word) in bits.iter_mut().enumerate() {
        let used = count.saturating_sub(32 * w).min(32);
        *word &= (u64::MAX >> (64 - used.max(1))) as u32 & if used == 0 { 0 } else { u32::MAX };
    }
    bits
}

/// The bits `first..end`.
pub(super) fn span(first: usize, end: usize) -> Bits {
    let (upto_end, upto_first) = (only_first([u32::MAX; WORDS], end), only_first([u32::MAX; WORDS], first));
    std::array::from_fn(|w| upto_end[w] & !upto_first[w])
}

/// Where the points of one side lie against a blocker.
#[derive(Clone, Debug)]
pub(super) struct Against {
    /// r_k, 32 points a word.
    pub ratio: [[[f32; 32]; WORDS]; 4],
    /// |d|, m.
    pub distance: [[f32; 32]; WORDS],
    /// The points in front of its plane, and behind it.
    pub sides: [Bits; 2],
    /// Those that are not so near the plane that a ray tracer may lose the blocker in a segment's margin.
    pub far: Bits,
    /// Of the points of each word on either side.
    pub bounds: [[Bounds; WORDS]; 2],
}

/// The least and greatest r_k of some points, and the largest 1 / |d|.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Least.
    pub lo: [f32; 4],
    /// Greatest.
    pub hi: [f32; 4],
    /// Largest 1 / |d|, 1/m.
    pub nearness: f32,
}

/// See [`Against::set`].
struct Set<'a> {
    against: &'a mut Against,
    places: &'a Places,
    usable: &'a Bits,
    blocker: &'a Blocker,
}

impl HotLoop for Set<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.against.find(self.places, self.usable, self.blocker);
    }
}

impl Against {
    pub const NONE: Against = Against {
        ratio: [[[0.0; 32]; WORDS]; 4],
        distance: [[0.0; 32]; WORDS],
        sides: [[0; WORDS]; 2],
        far: [0; WORDS],
        bounds: [[Bounds { lo: [0.0; 4], hi: [0.0; 4], nearness: 0.0 }; WORDS]; 2],
    };

    /// Computes all for `places`, of which only `usable` count.
    pub fn set(&mut self, places: &Places, usable: &Bits, blocker: &Blocker) {
        widest(Set { against: self, places, usable, blocker });
    }

    #[inline(always)]
    fn find(&mut self, places: &Places, usable: &Bits, blocker: &Blocker) {
        let bands = blocker.bands();
        let usable = only_first(*usable, places.count);
        let ([(n, c), edges @ ..], Places { x, y, z, .. }) = (blocker.planes(), places);
        for w in 0..places.words() {
            if usable[w] == 0 {
                (self.sides[0][w], self.sides[1][w]) = (0, 0);
                continue;
            }
            let (mut front, mut back, mut far) = (0, 0, 0);
            for (lane, bit) in LANES.iter().enumerate() {
                let i = 32 * w + lane;
                let d = n.x * x[i] + n.y * y[i] + n.z * z[i] - c;
                let size = if d < 0.0 { -d } else { d };
                front |= if d > bands.apart { *bit } else { 0 };
                back |= if d < -bands.apart { *bit } else { 0 };
                far |= if size > bands.near { *bit } else { 0 };
                self.distance[w][lane] = size as f32;
                // What is not apart is on neither side, and its ratios are not looked at.
                let inverse = 1.0 / if size > bands.apart { size } else { f64::INFINITY };
                for (ratio, (m, c)) in self.ratio.iter_mut().zip(edges) {
                    ratio[w][lane] = ((m.x * x[i] + m.y * y[i] + m.z * z[i] - c) * inverse) as f32;
                }
            }
            self.sides[0][w] = front & usable[w];
            self.sides[1][w] = back & usable[w];
            self.far[w] = far;
            for side in 0..2 {
                self.bound(side, w);
            }
        }
    }

    /// Bounds the points of word `w` that are on `side`.
    #[inline(always)]
    fn bound(&mut self, side: usize, w: usize) {
        let bits = self.sides[side][w];
        if bits == 0 {
            return;
        }
        // Eight at a time, so that a register holds them.
        let (mut lo, mut hi) = ([[f32::MAX; 8]; 4], [[f32::MIN; 8]; 4]);
        let mut nearest = [f32::MAX; 8];
        for first in [0, 8, 16, 24] {
            for lane in 0..8 {
                let among = bits & LANES[first + lane] != 0;
                for k in 0..4 {
                    let r = self.ratio[k][w][first + lane];
                    let (low, high) = if among { (r, r) } else { (f32::MAX, f32::MIN) };
                    lo[k][lane] = if low < lo[k][lane] { low } else { lo[k][lane] };
                    hi[k][lane] = if high > hi[k][lane] { high } else { hi[k][lane] };
                }
                let d = if among { self.distance[w][first + lane] } else { f32::MAX };
                nearest[lane] = if d < nearest[lane] { d } else { nearest[lane] };
            }
        }
        let bounds = Bounds {
            lo: lo.map(|lanes| fold(lanes, |a, b| if a < b { a } else { b })),
            hi: hi.map(|lanes| fold(lanes, |a, b| if a > b { a } else { b })),
            nearness: 1.0 / fold(nearest, |a, b| if a < b { a } else { b }),
        };
        self.bounds[side][w] = bounds;
    }
}

/// One of all lanes, by halves.
#[inline(always)]
fn fold(mut lanes: [f32; 8], pick: impl Fn(f32, f32) -> f32) -> f32 {
    for half in [4, 2, 1] {
        for i in 0..half {
            lanes[i] = pick(lanes[i], lanes[i + half]);
        }
    }
    lanes[0]
}

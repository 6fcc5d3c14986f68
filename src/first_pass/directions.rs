//! Directions of what a specular point sees, side by side, and the lobe between any two of them.

use super::{ideal, lobe};
use std::ops::Range;

/// Directions handled side by side.
pub const LANES: usize = 8;
/// A value for each of [`LANES`] directions.
pub type Lanes = [f32; LANES];

/// Lobes of which m² is so many times that of the other at most are scaled nearly alike.
const AKIN: f32 = 4.0;

/// One direction from a specular element to an element it sees. The frame's x and y lie along the
/// sides of the specular element and are shared by both sides of its surface, z is the side's normal.
#[derive(Clone, Copy, Debug, Default)]
pub struct Direction {
    /// Unit vector.
    pub to: [f32; 3],
    /// Projected solid angle that the direction stands for, sr.
    pub weight: f32,
    /// What a rough lobe needs to know of the element.
    pub rough: lobe::Extent,
    /// What an ideal lobe needs to know of the element.
    pub ideal: ideal::Extent,
}

/// The specular element that directions are seen from.
#[derive(Clone, Copy, Debug, Default)]
pub struct Origin {
    /// m² of its lobe; 0 for ideal reflection and refraction.
    pub m2: f32,
    /// Its sides along x and y, m.
    pub side: [f32; 2],
    /// Whether light that leaves along the mirrored direction, or straight on, came along a straight line
    /// (unfolded at the mirror): not so where it is refracted.
    pub straight: bool,
}

/// Directions of what a point sees on one side of its surface, in structure of arrays. Neighbours in
/// the list should be neighbours in direction ([`tile_order`]), so that groups can be passed over whole.
#[derive(Clone, Debug, Default)]
pub struct Directions {
    /// What sees them.
    pub origin: Origin,
    /// First tangential coordinate.
    pub x: Vec<Lanes>,
    /// Second tangential coordinate.
    pub y: Vec<Lanes>,
    /// Cosine with the normal; 0 where there is nothing (padding, beyond the critical angle).
    pub z: Vec<Lanes>,
    /// Projected solid angle that the direction stands for.
    pub weight: Vec<Lanes>,
    /// Scale factor u of the normalisation.
    pub scale: Vec<Lanes>,
    /// m² and scale factors of a rough lobe that was last balanced from nothing. What goes on from there and is not kept
    /// here cannot drift: factors have directions in which rows hardly change.
    pub from_nothing: Option<(f32, Vec<Lanes>)>,
    /// As [`Direction::rough`]; empty for an ideal lobe.
    pub rough: Vec<lobe::Extents>,
    /// As [`Direction::ideal`]; empty for a rough lobe.
    pub ideal: Vec<ideal::Extents>,
    /// Factor on what comes in from these directions; 1 but inside solids, where it makes up for a
    /// critical cone that the elements do not fill exactly.
    pub gain: f32,
    /// h of every direction: besides its lobe, light is spread as h_l h_k, which sums to what the lobe lacks. Empty
    /// where lobes lack nothing.
    pub spread: Vec<f32>,
    /// Number of directions; the rest is padding.
    pub len: usize,
    /// What holds for all directions of a group, [`LANES`] groups side by side.
    bounds: Vec<Bounds>,
    /// The same of blocks of [`LANES`] groups.
    blocks: Vec<Bounds>,
}

/// What holds for all directions of each of [`LANES`] groups.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Smallest coordinates: of unit vectors, or of slopes for an ideal lobe.
    pub low: [Lanes; 2],
    /// Largest coordinates.
    pub high: [Lanes; 2],
    /// Largest cosine.
    pub z: Lanes,
    /// Largest spread and blur, for a rough lobe.
    pub most: [Lanes; 2],
    /// Largest depth, for an ideal lobe.
    pub depth: Lanes,
    /// Extents along x and y, for an ideal lobe.
    pub ideal: [IdealBounds; 2],
}

/// What holds for the [`ideal::Extent`]s of each of [`LANES`] groups along an axis.
#[derive(Clone, Copy, Debug)]
pub struct IdealBounds {
    /// Largest a of the spread.
    pub square: Lanes,
    /// Smallest b of the spread.
    pub least: Lanes,
    /// Largest b of the spread.
    pub most: Lanes,
    /// Largest spread of an element along its own direction.
    pub own: Lanes,
    /// Largest nearness.
    pub nearest: Lanes,
    /// Smallest nearness.
    pub farthest: Lanes,
}

impl Bounds {
    /// Of groups that hold nothing.
    const NONE: Bounds = Bounds {
        low: [[f32::MAX; LANES]; 2],
        high: [[f32::MIN; LANES]; 2],
        z: [0.0; LANES],
        most: [[0.0; LANES]; 2],
        depth: [0.0; LANES],
        ideal: [IdealBounds {
            square: [0.0; LANES],
            least: [f32::MAX; LANES],
            most: [f32::MIN; LANES],
            own: [0.0; LANES],
            nearest: [0.0; LANES],
            farthest: [f32::MAX; LANES],
        }; 2],
    };

    /// Takes in a direction of the group in `lane`.
    fn include(&mut self, lane: usize, d: &Direction, ideal: bool) {
        let raise = |most: &mut Lanes, v: f32| most[lane] = most[lane].max(v);
        let lower = |least: &mut Lanes, v: f32| least[lane] = least[lane].min(v);
        for axis in 0..2 {
            let at = if ideal { d.ideal.slope[axis] } else { d.to[axis] };
            lower(&mut self.low[axis], at);
            raise(&mut self.high[axis], at);
            let of = &mut self.ideal[axis];
            raise(&mut of.square, d.ideal.spread[axis][0]);
            lower(&mut of.least, d.ideal.spread[axis][1]);
            raise(&mut of.most, d.ideal.spread[axis][1]);
            raise(&mut of.own, d.ideal.own_spread()[axis]);
            raise(&mut of.nearest, d.ideal.nearness[axis]);
            lower(&mut of.farthest, d.ideal.nearness[axis]);
        }
        raise(&mut self.z, d.to[2]);
        raise(&mut self.most[0], d.rough.spread);
        raise(&mut self.most[1], d.rough.blur);
        raise(&mut self.depth, d.ideal.depth);
    }

    /// How far `-at` lies outside the box of a group along an axis.
    #[inline(always)]
    pub fn gap(&self, axis: usize, lane: usize, at: f32) -> f32 {
        (self.low[axis][lane] + at).max(-at - self.high[axis][lane]).max(0.0)
    }

    /// A bit for each group that the lobe of `a` may reach.
    #[inline(always)]
    fn reached(&self, a: &Direction, origin: &Origin) -> u32 {
        if origin.m2 > 0.0 { lobe::reached(self, a, origin.m2) } else { ideal::reached(self, a, origin.side) }
    }
}

/// The groups that a lobe may reach, ascending.
pub struct Reach<'a> {
    directions: &'a Directions,
    a: Direction,
    /// The next bounds of blocks to look at.
    next: usize,
    /// The bits of the blocks left, and of the groups left of the current block.
    blocks: u32,
    groups: u32,
    block: usize,
    /// The groups asked for.
    range: Range<usize>,
}

impl Iterator for Reach<'_> {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let Directions { origin, blocks, bounds, .. } = self.directions;
        while self.groups == 0 {
            while self.blocks == 0 {
                self.blocks = blocks.get(self.next)?.reached(&self.a, origin);
                self.next += 1;
            }
            self.block = (self.next - 1) * LANES + self.blocks.trailing_zeros() as usize;
            self.blocks &= self.blocks - 1;
            let first = self.range.start.saturating_sub(self.block * LANES);
            if first < LANES {
                self.groups = bounds.get(self.block)?.reached(&self.a, origin) & (u32::MAX << first);
            }
        }
        let group = self.block * LANES + self.groups.trailing_zeros() as usize;
        self.groups &= self.groups - 1;
        (group < self.range.end).then_some(group)
    }
}

/// [`tile_order`] of a whole list.
pub fn strip_order<T>(list: &mut [T], to: impl Fn(&T) -> [f32; 3]) {
    tile_order(list, 0, to);
}

/// Sorts anything that has a direction so that groups of [`LANES`] are compact, and so are blocks of
/// [`LANES`] groups. `offset` is the number of directions that stand before.
pub fn tile_order<T>(list: &mut [T], offset: usize, to: impl Fn(&T) -> [f32; 3]) {
    const BLOCK: usize = LANES * LANES;
    let head = tile(list, offset, BLOCK, &to);
    let (head, rest) = list.split_at_mut(head);
    tile(head, offset, LANES, &to);
    for block in rest.chunks_mut(BLOCK) {
        tile(block, 0, LANES, &to);
    }
}

/// Sorts into strips of x and by y within a strip, tiles of `size` directions. Returns how many fill up
/// the tile that those before began.
fn tile<T>(list: &mut [T], offset: usize, size: usize, to: impl Fn(&T) -> [f32; 3]) -> usize {
    list.sort_by(|a, b| to(a)[0].total_cmp(&to(b)[0]));
    let head = (offset.next_multiple_of(size) - offset).min(list.len());
    let rest = &mut list[head..];
    let strips = (rest.len() as f32 / size as f32).sqrt().ceil().max(1.0) as usize;
    let strip = rest.len().div_ceil(strips).next_multiple_of(size).max(size);
    for strip in rest.chunks_mut(strip) {
        strip.sort_by(|a, b| to(a)[1].total_cmp(&to(b)[1]));
    }
    head
}

impl Directions {
    /// Directions in the order given.
    pub fn new(origin: Origin, list: &[Direction]) -> Self {
        let mut d = Directions { origin, len: list.len(), gain: 1.0, ..Default::default() };
        let ideal = origin.m2 == 0.0;
        for (g, group) in list.chunks(LANES).enumerate() {
            d.x.push(lanes(group, |l| l.to[0]));
            d.y.push(lanes(group, |l| l.to[1]));
            d.z.push(lanes(group, |l| l.to[2]));
            d.weight.push(lanes(group, |l| l.weight));
            d.scale.push(lanes(group, |_| 1.0));
            if ideal {
                d.ideal.push(ideal::Extents::new(group));
            } else {
                d.rough.push(lobe::Extents::new(group));
            }
            for (bounds, at) in [(&mut d.bounds, g), (&mut d.blocks, g / LANES)] {
                if at / LANES == bounds.len() {
                    bounds.push(Bounds::NONE);
                }
                let bounds = &mut bounds[at / LANES];
                let shown = group.iter().filter(|direction| direction.to[2] > 0.0);
                shown.for_each(|direction| bounds.include(at % LANES, direction, ideal));
            }
        }
        d
    }

    /// The same directions of a rough lobe of another `m2`, not yet scaled, or with the scales that were found `from_nothing` for
    /// one nearly alike.
    pub fn roughened(mut self, m2: f32, from_nothing: bool) -> Self {
        self.origin.m2 = m2;
        self.spread.clear();
        let akin = |of: &(f32, Vec<Lanes>)| (1.0 / AKIN..=AKIN).contains(&(m2 / of.0));
        match self.from_nothing.as_ref().filter(|of| from_nothing && akin(of)) {
            Some((_, scale)) => self.scale.clone_from(scale),
            None => self.scale.fill([1.0; LANES]),
        }
        self
    }

    /// Direction `i`.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Direction {
        let (g, l) = (i / LANES, i % LANES);
        Direction {
            to: [self.x[g][l], self.y[g][l], self.z[g][l]],
            weight: self.weight[g][l],
            rough: self.rough.get(g).map_or_else(Default::default, |e| e.get(l)),
            ideal: self.ideal.get(g).map_or_else(Default::default, |e| e.get(l)),
        }
    }

    /// Whether scale factors have been found.
    pub fn is_scaled(&self) -> bool {
        self.scale.iter().flatten().any(|scale| *scale != 1.0)
    }

    /// Scale factor of direction `i`.
    pub fn scale_of(&self, i: usize) -> f32 {
        self.scale[i / LANES][i % LANES]
    }

    /// The groups of lanes within `range` that the lobe of `a` may reach, ascending.
    #[inline(always)]
    pub fn reach(&self, a: Direction, range: Range<usize>) -> Reach<'_> {
        let next = range.start / (LANES * LANES);
        Reach { directions: self, a, next, blocks: 0, groups: 0, block: 0, range }
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.x.len()
    }

    /// The lobe between `a` and the directions of group `g`: (B in 1/sr, cosine of the angle of
    /// incidence on the facet). `None` when B is 0 for all.
    #[inline(always)]
    pub fn lobe(&self, a: &Direction, g: usize) -> Option<(Lanes, Lanes)> {
        if self.origin.m2 > 0.0 {
            lobe::between(a, [&self.x[g], &self.y[g], &self.z[g]], &self.rough[g], self.origin.m2)
        } else {
            ideal::between(a, &self.z[g], &self.ideal[g], &self.origin)
        }
    }

    /// [`Directions::lobe`] for one direction: (B, cosine).
    pub fn lobe_at(&self, a: &Direction, i: usize) -> (f32, f32) {
        match self.lobe(a, i / LANES) {
            Some((b, cosine)) => (b[i % LANES], cosine[i % LANES]),
            None => (0.0, 0.0),
        }
    }
}

/// A value of each direction of a group, 0 in the padding.
pub fn lanes(group: &[Direction], of: impl Fn(&Direction) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for (lane, direction) in lanes.iter_mut().zip(group) {
        *lane = of(direction);
    }
    lanes
}

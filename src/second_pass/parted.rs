//! What a place takes from the elements around it where something that stands there parts some of them from it.

use super::chart::Chart;
use super::feet::{Chain, Foot, side_of};
use super::lattice::Lattice;
use super::shares::Shares;
use super::stencil::Stencils;
use glam::{DVec2, DVec3};

/// What stands in, at most, for the elements around a place that are all parted from it, as a
/// share of the whole weight.
const WIDER: f64 = 1e-4;

/// How open the way to an element beyond a foot is: next to nothing.
const BEYOND: f64 = 1e-9;

/// An element on and around which something stands, with all that its places may take from.
pub(super) struct Parting {
    feet: Chain,
    /// The element itself comes first.
    sources: Box<[Source]>,
    /// By foot: on which side of its line each source lies, a bit each, [`WORD`] to a word.
    sides: Box<[u64]>,
    /// The same for those the way to which the foot may close from some place in the element.
    near: Box<[u64]>,
    /// Nodes, a [`bit`] each: places that take from one of them are parted from something wherever they are.
    always: u64,
    /// Feet whose lines cross the element, and the same for places on either side of them, by [`side_of`].
    across: Box<[(Foot, [u64; 2])]>,
    /// By node of the border: where its row of `entries` ends.
    ends: Box<[u32]>,
    /// (source, weight): what the nodes are made of.
    entries: Box<[(u32, f32)]>,
}

/// An element that another may take from.
struct Source {
    element: u32,
    /// Its centre in the plane of the chart, m.
    place: DVec2,
    covered: bool,
    /// Its share of what stands in for elements that are parted.
    wider: f64,
}

/// Sources whose bits make a word.
const WORD: usize = 64;

/// An element lies on one side of a foot's line if it does but for this share of its size: far less than
/// [`Parting::inwards`] moves a place.
const LEVEL: f64 = 1e-9;

/// How far the corners and nodes on an element's `border` lie from a foot's line, over the distance of the furthest
/// from its `centre`: the least, and the most. Negative where [`side_of`] is true.
fn range([a, b]: Foot, border: &[DVec2], centre: DVec2) -> (f64, f64) {
    let size = border.iter().map(|at| at.distance(centre)).fold(0.0, f64::max) * a.distance(b);
    let heights = border.iter().map(|&at| (b - a).perp_dot(at - a) / size);
    heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
}

/// Whether a foot leaves the straight way to `q` open from wherever in the element with this `border`: both of its
/// ends lie on the same side of all these ways, for how far aside is linear in where a way begins.
fn passes(foot: Foot, border: &[DVec2], q: DVec2) -> bool {
    let aside = |p: DVec2, end: DVec2| (q - p).perp_dot(end - p) / ((q - p).length() * (end - p).length());
    let all = |is: &dyn Fn(f64) -> bool| border.iter().all(|&p| foot.iter().all(|&end| is(aside(p, end))));
    all(&|aside| aside > LEVEL) || all(&|aside| aside < -LEVEL)
}

/// The bit of a node of an element's border; all from the 64th on share one.
#[inline(always)]
fn bit(node: u32) -> u64 {
    1 << node.min(u64::BITS - 1)
}

/// Room for the weights of one place, to be used again.
#[derive(Default)]
pub(super) struct Weights {
    /// (element, weight), sum 1.
    of: Vec<(u32, f64)>,
    open: Vec<f64>,
}

impl Weights {
    /// The (element, weight) found last, sum 1.
    pub fn all(&self) -> &[(u32, f64)] {
        &self.of
    }
}

impl Parting {
    /// For element `own`, with `feet` on and around it. `centre` and `covered` belong to the elements.
    pub fn new(
        own: usize,
        feet: &[Foot],
        chart: &Chart,
        lattice: &Lattice,
        stencils: &Stencils,
        centre: &[DVec3],
        covered: &[bool],
    ) -> Self {
        let around = lattice.around(own);
        let trust = |e: u32| 1.0 / centre[e as usize].distance_squared(centre[own]);
        let others = around.iter().filter(|&&e| e != own as u32);
        let size = others.map(|&e| trust(e)).fold(f64::MIN_POSITIVE, f64::max);
        let source = |sources: &mut Vec<Source>, element: u32| {
            sources.iter().position(|s| s.element == element).unwrap_or_else(|| {
                let (place, covered) = (chart.plane(centre[element as usize]), covered[element as usize]);
                sources.push(Source { element, place, covered, wider: 0.0 });
                sources.len() - 1
            })
        };
        let mut sources = Vec::with_capacity(16);
        source(&mut sources, own as u32);
        let (mut ends, mut entries) = (Vec::new(), Vec::<(u32, f32)>::new());
        for &node in lattice.border.of(own) {
            let start = entries.len();
            for node in lattice.halved(node).unwrap_or([node, node]) {
                for &(element, weight) in stencils.of(node as usize) {
                    let (at, half) = (source(&mut sources, element) as u32, (0.5 * weight) as f32);
                    match entries[start..].iter_mut().find(|(known, _)| *known == at) {
                        Some((_, sum)) => *sum += half,
                        None => entries.push((at, half)),
                    }
                }
            }
            ends.push(entries.len() as u32);
        }
        for &element in &around {
            let at = source(&mut sources, element);
            sources[at].wider = trust(element).min(size) / size;
        }
        let words = |is: &dyn Fn(Foot, DVec2) -> bool| -> Box<[u64]> {
            let of = |foot: Foot| {
                sources.chunks(WORD).map(move |some| {
                    let bits = some.iter().map(|of| u64::from(is(foot, of.place)));
                    bits.enumerate().fold(0, |word, (at, bit)| word | bit << at)
                })
            };
            feet.iter().flat_map(|&foot| of(foot)).collect()
        };
        let border = lattice.border.of(own).iter().zip(lattice.border_uv(own));
        let border: Vec<DVec2> =
            border.map(|(&node, uv)| chart.plane_at(lattice.position[node as usize], uv)).collect();
        let (sides, near) = (words(&side_of), words(&|foot, place| !passes(foot, &border, place)));
        // The nodes with a source, or all if the element itself is one.
        let nodes = |is: &dyn Fn(usize) -> bool| {
            let mut start = 0;
            let all = if is(0) { u64::MAX } else { 0 };
            ends.iter().enumerate().fold(all, |bits, (node, &end)| {
                let of = &entries[std::mem::replace(&mut start, end as usize)..end as usize];
                if of.iter().any(|&(source, _)| is(source as usize)) { bits | bit(node as u32) } else { bits }
            })
        };
        let mut always = nodes(&|source| sources[source].covered);
        let mut across = Vec::new();
        let count = sources.len().div_ceil(WORD);
        for ((&foot, sides), near) in feet.iter().zip(sides.chunks(count)).zip(near.chunks(count)) {
            let has = |words: &[u64], source: usize| words[source / WORD] >> (source % WORD) & 1 == 1;
            let parts =
                [false, true].map(|side| nodes(&|source| has(near, source) && has(sides, source) != side));
            let (low, high) = range(foot, &border, sources[0].place);
            match (low >= -LEVEL, high <= LEVEL) {
                (true, _) => always |= parts[0],
                (_, true) => always |= parts[1],
                _ => across.push((foot, parts)),
            }
        }
        Parting {
            sides,
            near,
            always,
            across: across.into_iter().filter(|(_, parts)| *parts != [0; 2]).collect(),
            feet: Chain::new(feet),
            sources: sources.into(),
            ends: ends.into(),
            entries: entries.into(),
        }
    }

    /// Whether nothing parts any place of the element that takes from its centre and these nodes of its border from these.
    #[inline(always)]
    pub fn is_open(&self, [a, b, c]: [u32; 3]) -> bool {
        let across = self.across.iter().fold(0, |all, (_, [one, other])| all | one | other);
        (self.always | across) & (bit(a) | bit(b) | bit(c)) == 0
    }

    /// Whether something parts `place` in the element from what it would take from: the element's centre and these
    /// nodes of its border.
    #[inline(always)]
    pub fn parts(&self, place: DVec2, [a, b, c]: [u32; 3]) -> bool {
        let taken = bit(a) | bit(b) | bit(c);
        let inwards = self.inwards(place);
        let parts = |(foot, parts): &(Foot, [u64; 2])| parts[usize::from(side_of(*foot, inwards))];
        self.always & taken != 0 || self.across.iter().any(|foot| parts(foot) & taken != 0)
    }

    /// A place on the rim may lie beyond it by rounding, and so beyond a wall's foot.
    fn inwards(&self, place: DVec2) -> DVec2 {
        place.lerp(self.sources[0].place, 1e-6)
    }

    /// What `place` in the element takes if a foot parts it from some of the elements that `shares` would take from: the
    /// open ways keep their share of the weight. The weights are left in `room`; the result is how much of the radiance as
    /// if nothing were parted stays: 0 but where that is extrapolated, and next to nothing is parted. `None`
    /// where nothing is parted, as where [`Parting::parts`] says so.
    #[inline(always)]
    pub fn weigh(&self, place: DVec2, shares: &Shares, room: &mut Weights) -> Option<f64> {
        let inwards = self.inwards(place);
        // What the covered would say they have from all sides.
        room.open.clear();
        room.open.extend(self.sources.iter().map(|source| if source.covered { 0.0 } else { 1.0 }));
        let words = self.sources.len().div_ceil(WORD);
        let ways = self.sides.chunks(words).zip(self.near.chunks(words));
        for (number, (foot, (sides, near))) in self.feet.feet().iter().zip(ways).enumerate() {
            let beyond = if side_of(*foot, inwards) { u64::MAX } else { 0 };
            for (word, (sides, near)) in sides.iter().zip(near).enumerate() {
                // Whose way may cross the foot: those on the other side of its line.
                let first = word * WORD;
                let mut across = (sides ^ beyond) & near;
                while across != 0 {
                    let at = first + across.trailing_zeros() as usize;
                    across &= across - 1;
                    if room.open[at] > 0.0 {
                        room.open[at] *= self.feet.openness(number, inwards, self.sources[at].place);
                    }
                }
            }
        }
        // A place parted from all others takes what it has from beyond.
        for (open, source) in room.open.iter_mut().zip(&self.sources) {
            *open = if source.covered { 0.0 } else { open.max(BEYOND) };
        }
        room.of.clear();
        room.of.extend(self.sources.iter().map(|source| (source.element, 0.0)));
        room.of[0].1 = f64::from(shares.centre);
        for (&node, weight) in shares.nodes.iter().zip(shares.weights) {
            let node = node as usize;
            let start = if node > 0 { self.ends[node - 1] } else { 0 };
            for &(source, share) in &self.entries[start as usize..self.ends[node] as usize] {
                room.of[source as usize].1 += f64::from(weight * share);
            }
        }
        let (mut all, mut closed, mut negative) = (0.0, 0.0, 0.0);
        for ((_, weight), open) in room.of.iter_mut().zip(&room.open) {
            all += weight.abs();
            negative += weight.min(0.0).abs();
            closed += weight.abs() * (1.0 - open);
            *weight = weight.max(0.0) * open;
        }
        if closed <= 0.0 {
            return None;
        }
        let closed = closed / all;
        let mut total = 0.0;
        for (((_, weight), open), source) in room.of.iter_mut().zip(&room.open).zip(&self.sources) {
            *weight += WIDER * closed * open * source.wider;
            total += *weight;
        }
        // All around is covered: nothing better is known.
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        room.of.iter_mut().for_each(|(_, weight)| *weight /= total);
        // Extrapolation needs all it stands on; what follows leaves it out.
        Some((1.0 - 8.0 * closed).max(0.0) * (8.0 * negative / all).min(1.0))
    }
}

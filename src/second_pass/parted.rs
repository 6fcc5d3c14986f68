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
    /// The first sources, so many, are taken from where nothing is parted.
    taken: usize,
    /// Whether some of those are covered.
    covers: bool,
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

/// The lowest `count` bits of a word.
fn lowest(count: usize) -> u64 {
    if count < WORD { (1 << count) - 1 } else { u64::MAX }
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
        let taken = sources.len();
        for &element in &around {
            let at = source(&mut sources, element);
            sources[at].wider = trust(element).min(size) / size;
        }
        let sides = feet.iter().flat_map(|&foot| {
            sources.chunks(WORD).map(move |some| {
                let sides = some.iter().map(|of| u64::from(side_of(foot, of.place)));
                sides.enumerate().fold(0, |word, (at, side)| word | side << at)
            })
        });
        Parting {
            sides: sides.collect(),
            taken,
            covers: sources[..taken].iter().any(|of| of.covered),
            feet: Chain::new(feet),
            sources: sources.into(),
            ends: ends.into(),
            entries: entries.into(),
        }
    }

    /// Whether something parts `place` in the element from what it would take from.
    #[inline(always)]
    pub fn parts(&self, place: DVec2) -> bool {
        let inwards = self.inwards(place);
        let words = self.sources.len().div_ceil(WORD);
        self.covers
            || self.feet.feet().iter().zip(self.sides.chunks(words)).any(|(foot, sides)| {
                let beyond = if side_of(*foot, inwards) { u64::MAX } else { 0 };
                let taken = (0..self.taken).step_by(WORD);
                taken.zip(sides).any(|(first, sides)| (sides ^ beyond) & lowest(self.taken - first) != 0)
            })
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
        for (number, (foot, sides)) in self.feet.feet().iter().zip(self.sides.chunks(words)).enumerate() {
            let beyond = if side_of(*foot, inwards) { u64::MAX } else { 0 };
            for (word, sides) in sides.iter().enumerate() {
                // Whose way may cross the foot: those on the other side of its line.
                let first = word * WORD;
                let mut across = (sides ^ beyond) & lowest(self.sources.len() - first);
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

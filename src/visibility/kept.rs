//! Which surfaces and sample points of a scene are those of another, and where the bits of these points are.

use super::block::{Bits, WORDS};
use super::graph::{Edge, VisibilityGraph, stride_of};
use crate::geometry::{Aabb, SurfaceId};
use crate::points::{Cell, NO_POINT, SamplePoints};
use crate::scene::Geometry;
use std::collections::HashMap;
use std::ops::Range;

/// What two scenes have in common.
pub(super) struct Kept {
    /// By point: its number before, or [`NO_POINT`].
    before: Vec<u32>,
    /// Surfaces of the scene before that are no longer there, by its numbers,
    pub gone: Vec<u32>,
    /// and those of the present scene that were not there.
    pub come: Vec<u32>,
}

/// Points of a side that were next to each other before: `count` of them from bit `at` on, which were points `from` and
/// following of voxel `voxel`.
pub(super) struct Run {
    at: u32,
    count: u32,
    voxel: u32,
    from: u32,
}

impl Kept {
    /// What is in both scenes. A point on which something came to lie flat, or lay, does not count as the same.
    pub fn between(before: (&Geometry, &SamplePoints), now: (&Geometry, &SamplePoints)) -> Kept {
        let was = same_surfaces(before.0, now.0);
        let mut stays = vec![false; before.0.surfaces.len()];
        was.iter().flatten().for_each(|&s| stays[s as usize] = true);
        let numbers = |of: &mut dyn Iterator<Item = bool>| -> Vec<u32> {
            of.enumerate().filter(|(_, changed)| *changed).map(|(s, _)| s as u32).collect()
        };
        let gone = numbers(&mut stays.iter().map(|stays| !stays));
        let come = numbers(&mut was.iter().map(Option::is_none));

        let reach = now.0.plane_tolerance();
        let changed: Vec<Aabb> = (gone.iter().map(|&s| before.0.surfaces[s as usize].bounds()))
            .chain(come.iter().map(|&s| now.0.surfaces[s as usize].bounds()))
            .collect();
        let around = changed.iter().fold(Aabb::EMPTY, |all, bounds| all.union(*bounds));
        let key = |points: &SamplePoints, i: usize, surface: SurfaceId| {
            let Cell { path, level } = points.cell[i];
            (surface, points.side[i], path, level)
        };
        let places: HashMap<_, u32> =
            (0..before.1.len()).map(|i| (key(before.1, i, before.1.surface[i]), i as u32)).collect();
        let mut last = NO_POINT;
        let mut find = |i: usize| {
            let surface = SurfaceId(was[now.1.surface[i].index()]?);
            let p = now.1.position[i].as_dvec3();
            let within = |of: &Aabb| p.cmpge(of.min - reach).all() && p.cmple(of.max + reach).all();
            if within(&around) && changed.iter().any(within) {
                return None;
            }
            let key_now = key(now.1, i, surface);
            // Most points come after the one that they came after.
            let next = last.wrapping_add(1) as usize;
            let follows = next < before.1.len() && key(before.1, next, before.1.surface[next]) == key_now;
            let found = if follows { Some(next as u32) } else { places.get(&key_now).copied() };
            last = found.unwrap_or(last);
            found
        };
        let before = (0..now.1.len()).map(|i| find(i).unwrap_or(NO_POINT)).collect();
        Kept { before, gone, come }
    }

    /// How many points stayed.
    pub fn count(&self) -> usize {
        self.before.iter().filter(|&&i| i != NO_POINT).count()
    }

    /// The number that point `i` had.
    pub fn before(&self, i: usize) -> Option<usize> {
        (self.before[i] != NO_POINT).then_some(self.before[i] as usize)
    }

    /// Where `graph` has the bits of the points of a side, and which of them it has.
    pub fn runs(&self, graph: &VisibilityGraph, points: &Range<usize>) -> (Vec<Run>, Bits) {
        let (mut runs, mut stayed): (Vec<Run>, Bits) = (Vec::new(), [0; WORDS]);
        for (at, i) in points.clone().enumerate() {
            let Some(before) = self.before(i) else { continue };
            stayed[at / 32] |= 1 << (at % 32);
            let voxel = graph.voxel_of(before);
            let from = (before - graph.voxel(voxel).start) as u32;
            let (at, voxel) = (at as u32, voxel as u32);
            match runs.last_mut() {
                Some(run)
                    if run.voxel == voxel && run.at + run.count == at && run.from + run.count == from =>
                {
                    run.count += 1;
                }
                _ => runs.push(Run { at, count: 1, voxel, from }),
            }
        }
        (runs, stayed)
    }

    /// The bits of point `i` of `graph` towards the points of a side; all are set where nothing stands between facing
    /// points. And the bits of those points that no ray was cast to find out about.
    pub fn row(&self, graph: &VisibilityGraph, i: usize, runs: &[Run]) -> (Bits, Bits) {
        let a = graph.voxel_of(i);
        let r = i - graph.voxel(a).start;
        let (mut bits, mut known) = (0u128, 0u128);
        for run in runs {
            let b = run.voxel as usize;
            if graph.was_cast(a, b) {
                continue;
            }
            let part = match graph.edge(a, b) {
                Edge::Visible => u128::MAX,
                Edge::Hidden => 0,
                Edge::Partial(first) if a <= b => {
                    let stride = stride_of(graph.voxel(b).len());
                    let row = first as usize + r * stride;
                    bits_from(&graph.words[row..row + stride], run.from as usize)
                }
                // The tile lies the other way round.
                Edge::Partial(first) => {
                    let stride = stride_of(graph.voxel(a).len());
                    let word = |k: u32| first as usize + (run.from + k) as usize * stride + r / 32;
                    let bit = |k: u32| u128::from(graph.words[word(k)] >> (r % 32) & 1) << k;
                    (0..run.count).map(bit).fold(0, |bits, bit| bits | bit)
                }
            };
            let all = u128::MAX >> (128 - run.count);
            bits |= (part & all) << run.at;
            known |= all << run.at;
        }
        let words = |bits: u128| std::array::from_fn(|w| (bits >> (32 * w)) as u32);
        (words(bits), words(known))
    }
}

/// The 128 bits from bit `first` of `words` on.
fn bits_from(words: &[u32], first: usize) -> u128 {
    let (word, shift) = (first / 32, first % 32);
    let mut bits = 0;
    for (k, w) in words[word..].iter().take(5).enumerate() {
        let place = (32 * k) as i32 - shift as i32;
        let w = u128::from(*w);
        bits |= if place < 0 {
            w >> -place
        } else if place < 128 {
            w << place
        } else {
            0
        };
    }
    bits
}

/// For each surface of `now` the surface of `before` that it is: of the object of the same name, the same place there,
/// and the same shape.
fn same_surfaces(before: &Geometry, now: &Geometry) -> Vec<Option<u32>> {
    let mut of_object: HashMap<&str, Vec<u32>> = HashMap::new();
    for (s, object) in before.object.iter().enumerate() {
        of_object.entry(&before.objects[object.0 as usize]).or_default().push(s as u32);
    }
    let mut used: HashMap<&str, usize> = HashMap::new();
    let same = |s: usize| {
        let name = now.objects[now.object[s].0 as usize].as_str();
        let nth = used.entry(name).or_default();
        *nth += 1;
        let was = *of_object.get(name)?.get(*nth - 1)?;
        let alike = before.surfaces[was as usize].shape == now.surfaces[s].shape
            && before.two_sided[was as usize] == now.two_sided[s];
        alike.then_some(was)
    };
    (0..now.surfaces.len()).map(same).collect()
}

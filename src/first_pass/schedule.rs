//! Which patches exchange light, and in which order.
//!
//! An exchange serves both ways at once, so it adds to what both its patches receive. Patches are
//! dealt into groups, and the exchanges between any two groups are one task. The tasks of a round have no group in
//! common and run side by side; the rounds follow each other as in a tournament where everyone
//! meets everyone. So every sum has one order, whatever the number of threads.

use super::layout::{Layout, Patch};
use crate::visibility::{Edge, Tile, VisibilityGraph};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::ops::Range;

/// Points of a group, about.
const GROUP: usize = 128;

/// Two patches of which some points see each other.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// The first.
    pub a: u32,
    /// The second; never before the first.
    pub b: u32,
    /// Whether all of their points that face each other see each other.
    pub open: bool,
    /// Whether every element has its own distances from the other's plane, and its form factor may need to be
    /// held to 1: so near, or so curved, are they.
    pub close: bool,
}

/// All exchanges of a sweep.
pub struct Schedule {
    /// The patches of each group.
    pub groups: Vec<Range<usize>>,
    /// Tasks by round: two groups, the second never before the first, and their pairs.
    pub rounds: Vec<Vec<(usize, usize, Range<usize>)>>,
    /// The pairs of all tasks.
    pub pairs: Vec<Pair>,
}

impl Schedule {
    /// Of what `graph` lets pass, between points in front of each other by more than `tolerance`, in units of
    /// `layout`.
    pub fn new(layout: &Layout, graph: &VisibilityGraph, tolerance: f32) -> Self {
        let groups = deal(&layout.patches);
        let mut tasks: Vec<Vec<(usize, usize)>> = tournament(groups.len());
        tasks.push((0..groups.len()).map(|g| (g, g)).collect());
        let mut schedule = Schedule { groups, rounds: Vec::new(), pairs: Vec::new() };
        let meet = |&(i, j): &(usize, usize)| {
            let (first, second) = (schedule.groups[i].clone(), schedule.groups[j].clone());
            let pairs = first.flat_map(|a| second.clone().map(move |b| (a, b))).filter(|(a, b)| a <= b);
            pairs.filter_map(|(a, b)| pair(layout, graph, tolerance, a, b)).collect::<Vec<Pair>>()
        };
        let found: Vec<Vec<Vec<Pair>>> =
            tasks.par_iter().map(|round| round.par_iter().map(meet).collect()).collect();
        for (round, found) in tasks.into_iter().zip(found) {
            let mut next = Vec::with_capacity(round.len());
            for ((i, j), found) in round.into_iter().zip(found) {
                let start = schedule.pairs.len();
                schedule.pairs.extend(found);
                next.push((i, j, start..schedule.pairs.len()));
            }
            next.retain(|(_, _, pairs)| !pairs.is_empty());
            schedule.rounds.push(next);
        }
        schedule
    }
}

/// Runs of patches of about [`GROUP`] points.
fn deal(patches: &[Patch]) -> Vec<Range<usize>> {
    let mut groups = Vec::new();
    let mut first = 0;
    for p in 0..patches.len() {
        let points = patches[p].points.end - patches[first].points.start;
        if p + 1 == patches.len() || points >= GROUP {
            groups.push(first..p + 1);
            first = p + 1;
        }
    }
    groups
}

/// The rounds in which each of `n` meets every other once: one stays, the others move on around a table.
fn tournament(n: usize) -> Vec<Vec<(usize, usize)>> {
    let seats = n.next_multiple_of(2);
    let seat = |round: usize, at: usize| if at == 0 { 0 } else { 1 + (at - 1 + round) % (seats - 1) };
    let opposite = |round: usize, at: usize| {
        let (i, j) = (seat(round, at), seat(round, seats - 1 - at));
        (i.min(j), i.max(j))
    };
    (0..seats.saturating_sub(1))
        .map(|round| (0..seats / 2).map(|at| opposite(round, at)).filter(|&(_, j)| j < n).collect())
        .collect()
}

/// What two patches have to do with each other, if anything.
fn pair(layout: &Layout, graph: &VisibilityGraph, tolerance: f32, a: usize, b: usize) -> Option<Pair> {
    let (first, second) = (&layout.patches[a], &layout.patches[b]);
    let edge = graph.edge(first.voxel, second.voxel);
    let ahead = |patch: &Patch, other: &Patch| {
        patch.plane.is_none()
            || layout.position[other.points.clone()].iter().any(|&p| patch.height(p) as f32 > tolerance)
    };
    if edge == Edge::Hidden || !ahead(first, second) || !ahead(second, first) {
        return None;
    }
    let (some, all) = match graph.tile(first.voxel, second.voxel, &mut Vec::new()) {
        Tile::Visible => (true, true),
        Tile::Hidden => (false, false),
        tile => {
            let (row, column) = (graph.voxel(first.voxel).start, graph.voxel(second.voxel).start);
            let (mut some, mut all) = (0, u64::MAX);
            for i in first.points.clone() {
                let bits = row_bits(&tile, i - row, second.points.start - column, second.points.len());
                some |= bits;
                all &= bits;
            }
            (some != 0, all == u64::MAX >> (64 - second.points.len()))
        }
    };
    let planar = first.plane.is_some() && second.plane.is_some();
    let near = first.distance2(second) * PI <= first.largest.max(second.largest);
    (some && (a != b || !planar)).then_some(Pair {
        a: a as u32,
        b: b as u32,
        open: all,
        close: near || !planar,
    })
}

/// The bits of row `r` of a tile for `len` columns (at most 64) from `column` on; none beyond.
#[inline(always)]
pub fn row_bits(tile: &Tile, r: usize, column: usize, len: usize) -> u64 {
    let all = u64::MAX >> (64 - len);
    match tile {
        Tile::Visible => all,
        Tile::Hidden => 0,
        Tile::Bits { words, stride } => {
            let (at, shift) = (r * stride + column / 32, column % 32);
            let word = |k: usize| words.get(at + k).map_or(0, |&w| u64::from(w));
            let low = word(0) | word(1) << 32;
            // Shifted by 64, the last word would not be moved at all.
            let high = if shift > 0 { word(2) << (64 - shift) } else { 0 };
            (low >> shift | high) & all
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_a_tournament_each_meets_every_other_once_and_nobody_twice_a_round() {
        for n in 0..12 {
            let mut met = std::collections::HashSet::new();
            for round in tournament(n) {
                let mut seen = std::collections::HashSet::new();
                for (i, j) in round {
                    assert!(i < j && j < n && seen.insert(i) && seen.insert(j) && met.insert((i, j)));
                }
            }
            assert_eq!(met.len(), n * n.saturating_sub(1) / 2);
        }
    }

    #[test]
    fn bits_are_found_wherever_they_lie() {
        let words: Vec<u32> = (0..12u32).map(|i| 0x9e37_79b9u32.wrapping_mul(i + 1)).collect();
        let tile = Tile::Bits { words: &words, stride: 4 };
        for r in 0..3 {
            for column in 0..128 {
                for len in 1..=64.min(128 - column) {
                    let bits = row_bits(&tile, r, column, len);
                    let expected = |c: usize| c < len && tile.get(r, column + c);
                    assert!((0..64).all(|c| (bits >> c & 1 == 1) == expected(c)), "{r} {column} {len}");
                }
            }
        }
    }
}

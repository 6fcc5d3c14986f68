//! A rough lobe by way of nodes: light goes from the directions of a cell to its nodes, through the lobe from nodes to
//! nodes, and from these to directions. B(l, k) becomes Σ W(l, p) B(p, q) W(k, q), which is as symmetric as B is; rows cost
//! what nodes ask, however many directions there are.

use super::cells::{Division, SIDE, divide};
use super::directions::{Direction, Directions, LANES, Lanes, tile_order};
use super::lobe_table::BAND;
use crate::simd::{HotLoop, wide};

/// Nodes of a cell at most.
const SLOTS: usize = SIDE * SIDE;

/// More nodes than this share of the directions do not pay.
const PAYS: f32 = 0.8;

/// The nodes of a lobe, and how directions are made up of them.
#[derive(Clone, Debug)]
pub struct Nodes {
    /// The nodes as directions: those of the first directions first.
    pub directions: Directions,
    /// How many groups of nodes belong to the first directions, and how many groups of these there are.
    first: (usize, usize),
    /// Cells and single directions, of the first directions and of the others.
    parts: [Part; 2],
}

/// Some directions.
#[derive(Clone, Debug, Default)]
struct Part {
    /// (Direction, its node) of those that are their own.
    single: Vec<[u32; 2]>,
    /// Cells, one after the other.
    cells: Vec<Cell>,
    /// The directions of all cells,
    members: Vec<u32>,
    /// and their shares of the nodes along both sides.
    shares: Vec<[[f32; SIDE]; 2]>,
}

/// A cell of directions.
#[derive(Clone, Debug)]
struct Cell {
    /// Where its directions end.
    end: usize,
    /// Nodes along both sides.
    count: [usize; 2],
    /// The nodes of its slots.
    nodes: [u32; SLOTS],
}

impl Part {
    /// Of a division, the nodes of which are appended to `list`.
    fn new(all: &Directions, division: Division, list: &mut Vec<Direction>) -> Self {
        let Division { cells, members, shares, nodes, single } = division;
        let owns = single.iter().map(|&m| all.get(m as usize));
        let nodes: Vec<Direction> = owns.chain(nodes).collect();
        let mut order: Vec<(u32, [f32; 3])> = (0..).zip(nodes.iter().map(|n| n.to)).collect();
        tile_order(&mut order, list.len(), |n| n.1);
        let mut place = vec![0; nodes.len()];
        for (node, _) in order {
            place[node as usize] = list.len() as u32;
            list.push(nodes[node as usize]);
        }
        let mut places = place.into_iter();
        let single = single.into_iter().zip(&mut places).map(|(m, node)| [m, node]).collect();
        let mut end = 0;
        let cell = |cell: super::cells::Cell| {
            end += cell.members;
            let mut nodes = [0; SLOTS];
            used(cell.count).zip(&mut places).for_each(|(slot, node)| nodes[slot] = node);
            Cell { end, count: cell.count, nodes }
        };
        let cells = cells.into_iter().map(cell).collect();
        Part { single, cells, members, shares }
    }
}

impl Nodes {
    /// Of the rough lobe of `all`, whose first `links` groups have nodes of their own; `None` where all are better taken
    /// as they are.
    pub fn new(all: &Directions, links: usize, tolerance: f32) -> Option<Self> {
        if tolerance <= 0.0 || all.origin.m2 <= 0.0 {
            return None;
        }
        let split = (links * LANES).min(all.len);
        let mut list: Vec<Direction> = Vec::new();
        let linked = Part::new(all, divide(all, 0..split, tolerance), &mut list);
        let first = list.len().div_ceil(LANES);
        let others = Part::new(all, divide(all, split..all.len, tolerance), &mut list);
        if list.len() as f32 > PAYS * all.len as f32 {
            return None;
        }
        Some(Nodes {
            directions: Directions::new(all.origin, &list),
            first: (first, links),
            parts: [linked, others],
        })
    }

    /// How many groups of nodes stand for the first `groups` of directions: those of the links, or all.
    pub fn groups(&self, groups: usize) -> usize {
        if groups <= self.first.1 { self.first.0 } else { self.directions.groups() }
    }

    /// The parts that the first `groups` of directions belong to.
    fn parts(&self, groups: usize) -> &[Part] {
        if groups <= self.first.1 { &self.parts[..1] } else { &self.parts }
    }

    /// What directions hold, `[groups][W]`, as the nodes hold it, `[groups of nodes][W]`: Σ_l W(l, p) x_l.
    pub fn gather(&self, w: usize, x: &[Lanes]) -> Vec<Lanes> {
        wide(Gather { nodes: self, w, x })
    }

    /// What nodes hold as the first `groups` of directions hold it: Σ_p W(l, p) x_p.
    pub fn scatter(&self, w: usize, groups: usize, x: &[Lanes]) -> Vec<Lanes> {
        wide(Scatter { nodes: self, w, groups, x })
    }

    /// The nodes that direction `l` is made up of, and their shares.
    pub fn of(&self, l: usize) -> Vec<(usize, f32)> {
        let own = |part: &Part| {
            if let Some(single) = part.single.iter().find(|s| s[0] as usize == l) {
                return vec![(single[1] as usize, 1.0)];
            }
            let Some(at) = part.members.iter().position(|&m| m as usize == l) else { return Vec::new() };
            let shares = slots(&part.shares[at]);
            let cell = part.cells.iter().find(|cell| at < cell.end);
            let slots = |cell: &Cell| used(cell.count).map(|i| (cell.nodes[i] as usize, shares[i])).collect();
            cell.map(slots).unwrap_or_default()
        };
        self.parts.iter().flat_map(own).collect()
    }
}

/// The shares of all slots of a cell.
#[inline(always)]
fn slots([u, v]: &[[f32; SIDE]; 2]) -> [f32; SLOTS] {
    let mut slots = [0.0; SLOTS];
    for i in 0..SIDE {
        for j in 0..SIDE {
            slots[i * SIDE + j] = u[i] * v[j];
        }
    }
    slots
}

/// The slots of a cell that nodes stand in.
#[inline(always)]
fn used([along, across]: [usize; 2]) -> impl Iterator<Item = usize> {
    (0..along).flat_map(move |i| (0..across).map(move |j| i * SIDE + j))
}

/// [`Nodes::gather`].
struct Gather<'a> {
    nodes: &'a Nodes,
    w: usize,
    x: &'a [Lanes],
}

impl HotLoop for Gather<'_> {
    type Output = Vec<Lanes>;

    #[inline(always)]
    fn run(self) -> Vec<Lanes> {
        let Gather { nodes, w, x } = self;
        let groups = x.len() / w;
        let mut out = vec![[0.0; LANES]; nodes.groups(groups) * w];
        for part in nodes.parts(groups) {
            for first in (0..w).step_by(BAND) {
                match w - first {
                    1 => part.gather::<1>((first, w), x, &mut out),
                    2 => part.gather::<2>((first, w), x, &mut out),
                    3 => part.gather::<3>((first, w), x, &mut out),
                    _ => part.gather::<BAND>((first, w), x, &mut out),
                }
            }
        }
        out
    }
}

/// [`Nodes::scatter`].
struct Scatter<'a> {
    nodes: &'a Nodes,
    w: usize,
    groups: usize,
    x: &'a [Lanes],
}

impl HotLoop for Scatter<'_> {
    type Output = Vec<Lanes>;

    #[inline(always)]
    fn run(self) -> Vec<Lanes> {
        let Scatter { nodes, w, groups, x } = self;
        let mut out = vec![[0.0; LANES]; groups * w];
        for part in nodes.parts(groups) {
            for first in (0..w).step_by(BAND) {
                match w - first {
                    1 => part.scatter::<1>((first, w), x, &mut out),
                    2 => part.scatter::<2>((first, w), x, &mut out),
                    3 => part.scatter::<3>((first, w), x, &mut out),
                    _ => part.scatter::<BAND>((first, w), x, &mut out),
                }
            }
        }
        out
    }
}

impl Part {
    /// Adds up what directions hold at `K` of `w` wavelengths for the nodes.
    #[inline(always)]
    fn gather<const K: usize>(&self, (first, w): (usize, usize), x: &[Lanes], out: &mut [Lanes]) {
        for [member, node] in &self.single {
            let ([g, lane], [h, to]) = (place(*member), place(*node));
            for k in 0..K {
                out[h * w + first + k][to] = x[g * w + first + k][lane];
            }
        }
        let mut start = 0;
        for cell in &self.cells {
            let mut sums = [[[0.0f32; SIDE]; SIDE]; K];
            for (member, [u, v]) in self.members[start..cell.end].iter().zip(&self.shares[start..cell.end]) {
                let [g, lane] = place(*member);
                let x = &x[g * w + first..][..K];
                for k in 0..K {
                    let mut row = [0.0; SIDE];
                    for j in 0..SIDE {
                        row[j] = v[j] * x[k][lane];
                    }
                    for i in 0..SIDE {
                        for j in 0..SIDE {
                            sums[k][i][j] += u[i] * row[j];
                        }
                    }
                }
            }
            for slot in used(cell.count) {
                let [h, to] = place(cell.nodes[slot]);
                for k in 0..K {
                    out[h * w + first + k][to] = sums[k][slot / SIDE][slot % SIDE];
                }
            }
            start = cell.end;
        }
    }

    /// Makes up what directions hold at `K` of `w` wavelengths from the nodes.
    #[inline(always)]
    fn scatter<const K: usize>(&self, (first, w): (usize, usize), x: &[Lanes], out: &mut [Lanes]) {
        for [member, node] in &self.single {
            let ([g, lane], [h, from]) = (place(*member), place(*node));
            for k in 0..K {
                out[g * w + first + k][lane] = x[h * w + first + k][from];
            }
        }
        let mut start = 0;
        for cell in &self.cells {
            let mut values = [[0.0f32; SLOTS]; K];
            for slot in used(cell.count) {
                let [h, from] = place(cell.nodes[slot]);
                for k in 0..K {
                    values[k][slot] = x[h * w + first + k][from];
                }
            }
            for (member, [u, v]) in self.members[start..cell.end].iter().zip(&self.shares[start..cell.end]) {
                let [g, lane] = place(*member);
                let out = &mut out[g * w + first..][..K];
                for k in 0..K {
                    let mut sums = [0.0; SIDE];
                    for i in 0..SIDE {
                        for j in 0..SIDE {
                            sums[j] += u[i] * values[k][i * SIDE + j];
                        }
                    }
                    out[k][lane] = (sums[0] * v[0] + sums[1] * v[1]) + (sums[2] * v[2] + sums[3] * v[3]);
                }
            }
            start = cell.end;
        }
    }
}

/// Group and lane.
#[inline(always)]
fn place(i: u32) -> [usize; 2] {
    [i as usize / LANES, i as usize % LANES]
}

#[cfg(test)]
mod tests {
    use super::super::normalise::tests::hemisphere;
    use super::super::rows::Rows;
    use super::*;

    /// x as groups of lanes.
    fn lanes(x: &[f32]) -> Vec<Lanes> {
        x.chunks(LANES).map(|x| std::array::from_fn(|lane| x.get(lane).copied().unwrap_or(0.0))).collect()
    }

    #[test]
    fn cells_make_up_their_directions_and_the_way_back_is_the_transpose() {
        let members = hemisphere(0.3, 20);
        let nodes = Nodes::new(&members, 5, 0.1).expect("nodes pay");
        let (n, p) = (members.len, nodes.directions.len);
        for l in 0..n {
            let of = nodes.of(l);
            assert!((of.iter().map(|(_, share)| share).sum::<f32>() - 1.0).abs() < 1e-5, "{l}: {of:?}");
        }
        let x: Vec<f32> = (0..n).map(|l| (l % 13) as f32 - 4.0).collect();
        let y: Vec<f32> = (0..p).map(|p| (p % 7) as f32 - 2.0).collect();
        let dot = |a: &[Lanes], b: &[Lanes]| {
            a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| f64::from(a * b)).sum::<f64>()
        };
        let forth = dot(&nodes.gather(1, &lanes(&x)), &lanes(&y));
        let back = dot(&lanes(&x), &nodes.scatter(1, members.groups(), &lanes(&y)));
        assert!((forth - back).abs() < 1e-4 * forth.abs(), "{forth} {back}");
        // The first groups are served by the first nodes alone.
        let first = nodes.scatter(1, 5, &lanes(&y[..nodes.groups(5) * LANES]));
        assert_eq!(first, nodes.scatter(1, members.groups(), &lanes(&y))[..5]);
        assert!(Nodes::new(&members, 5, 0.0).is_none());
    }

    #[test]
    fn lobes_by_nodes_are_as_near_as_asked() {
        // Wider lobes bend at grazing angles in ways that cells do not follow: 4 % of their height are left at 0.8.
        for (m, tolerances) in [(0.2, &[0.1, 0.01][..]), (0.4, &[0.1, 0.01]), (0.8, &[0.1])] {
            let members = hemisphere(m, 32);
            for &tolerance in tolerances {
                let nodes = Nodes::new(&members, 0, tolerance).expect("nodes pay");
                let ends = &nodes.directions;
                let rows = Rows::new(ends, ends, true, usize::MAX);
                let (mut off, mut count, mut worst) = (0.0, 0, 0.0f32);
                for l in (0..members.len).step_by(29) {
                    let a = members.get(l);
                    let mut x = vec![0.0; members.len];
                    x[l] = 1.0;
                    let sums = rows.product(ends, ends, None, &nodes.gather(1, &lanes(&x)));
                    let found = nodes.scatter(1, members.groups(), &lanes(&sums));
                    let exact: Vec<f32> = (0..members.len).map(|k| members.lobe_at(&a, k).0).collect();
                    let height = exact.iter().copied().fold(0.0, f32::max);
                    for (exact, found) in exact.iter().zip(found.iter().flatten()).filter(|(b, _)| **b > 0.0)
                    {
                        off += f64::from((exact - found) / height).powi(2);
                        worst = worst.max((exact - found).abs() / height);
                        count += 1;
                    }
                }
                let off = (off / f64::from(count)).sqrt();
                println!(
                    "m {m}, tolerance {tolerance}: {} directions, {} nodes, off by {off:.1e}, {worst:.1e} at most",
                    members.len, ends.len
                );
                assert!(off > 1e-6 && off < f64::from(tolerance), "m {m}, {tolerance}: {off}");
                assert!((ends.len as f32) < 0.8 * members.len as f32);
            }
        }
    }
}

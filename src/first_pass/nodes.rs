//! A rough lobe by way of nodes: light goes from the directions of a cell to its nodes, through the lobe from nodes to
//! nodes, and from these to directions. B(l, k) becomes Σ W(l, p) B(p, q) W(k, q), which is as symmetric as B is; rows cost
//! what nodes ask, however many directions there are.

use super::cells::{Cell, Division, SIDE, divide};
use super::directions::{Direction, Directions, LANES, Lanes, tile_order};
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
    /// Cells, with the nodes of their slots.
    cells: Vec<(Cell, [u32; SLOTS])>,
}

/// Where a node comes from.
enum Origin {
    Single(u32),
    Slot(usize, usize),
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
        let mut parts: [Part; 2] = Default::default();
        let mut first = 0;
        for (part, range) in parts.iter_mut().zip([0..split, split..all.len]) {
            let Division { cells, single } = divide(all, range, tolerance);
            let mut nodes: Vec<(Direction, Origin)> = Vec::new();
            nodes.extend(single.iter().map(|&m| (all.get(m as usize), Origin::Single(m))));
            part.cells = cells.into_iter().map(|cell| (cell, [0; SLOTS])).collect();
            for (c, (cell, _)) in part.cells.iter_mut().enumerate() {
                let [_, across] = cell.count;
                let nodes_of = std::mem::take(&mut cell.nodes).into_iter().enumerate();
                nodes.extend(
                    nodes_of.map(|(i, node)| (node, Origin::Slot(c, i / across * SIDE + i % across))),
                );
            }
            tile_order(&mut nodes, list.len(), |n| n.0.to);
            for (node, origin) in nodes {
                match origin {
                    Origin::Single(member) => part.single.push([member, list.len() as u32]),
                    Origin::Slot(cell, slot) => part.cells[cell].1[slot] = list.len() as u32,
                }
                list.push(node);
            }
            if split > 0 && first == 0 {
                first = list.len().div_ceil(LANES);
            }
        }
        if list.len() as f32 > PAYS * all.len as f32 {
            return None;
        }
        Some(Nodes { directions: Directions::new(all.origin, &list), first: (first, links), parts })
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
            let at = |(cell, nodes): &(Cell, [u32; SLOTS])| {
                let at = cell.members.iter().position(|&m| m as usize == l)?;
                let shares = slots(&cell.shares[at]);
                Some(used(cell).map(|i| (nodes[i] as usize, shares[i])).collect())
            };
            part.cells.iter().find_map(at).unwrap_or_default()
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
fn used(cell: &Cell) -> impl Iterator<Item = usize> {
    let [along, across] = cell.count;
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
        let mut sums = vec![[0.0f32; SLOTS]; w];
        for part in nodes.parts(groups) {
            for [member, node] in &part.single {
                let ([g, lane], [h, to]) = (place(*member), place(*node));
                for k in 0..w {
                    out[h * w + k][to] = x[g * w + k][lane];
                }
            }
            for (cell, places) in &part.cells {
                sums.fill([0.0; SLOTS]);
                for (member, shares) in cell.members.iter().zip(&cell.shares) {
                    let ([g, lane], shares) = (place(*member), slots(shares));
                    for (sums, x) in sums.iter_mut().zip(&x[g * w..(g + 1) * w]) {
                        let x = x[lane];
                        for slot in 0..SLOTS {
                            sums[slot] += shares[slot] * x;
                        }
                    }
                }
                for slot in used(cell) {
                    let [h, to] = place(places[slot]);
                    for k in 0..w {
                        out[h * w + k][to] = sums[k][slot];
                    }
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
        let mut values = vec![[0.0f32; SLOTS]; w];
        for part in nodes.parts(groups) {
            for [member, node] in &part.single {
                let ([g, lane], [h, from]) = (place(*member), place(*node));
                for k in 0..w {
                    out[g * w + k][lane] = x[h * w + k][from];
                }
            }
            for (cell, places) in &part.cells {
                for slot in used(cell) {
                    let [h, from] = place(places[slot]);
                    for k in 0..w {
                        values[k][slot] = x[h * w + k][from];
                    }
                }
                for (member, shares) in cell.members.iter().zip(&cell.shares) {
                    let ([g, lane], [u, v]) = (place(*member), shares);
                    for (out, values) in out[g * w..(g + 1) * w].iter_mut().zip(&values) {
                        let mut sums = [0.0; SIDE];
                        for (u, values) in u.iter().zip(values.chunks_exact(SIDE)) {
                            for j in 0..SIDE {
                                sums[j] += u * values[j];
                            }
                        }
                        out[lane] = (sums[0] * v[0] + sums[1] * v[1]) + (sums[2] * v[2] + sums[3] * v[3]);
                    }
                }
            }
        }
        out
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

//! Which surfaces meet a shaft: the hull of two boxes, or of two patches.

use super::blocker::Blocker;
use crate::geometry::Aabb;
use glam::DVec3;

/// A box tree over the blockers.
#[derive(Debug)]
pub(super) struct BlockerTree {
    nodes: Vec<Node>,
    /// Blockers in the order of the leaves.
    order: Vec<u32>,
    /// The largest slack of any blocker, m.
    slack: f64,
}

#[derive(Debug)]
struct Node {
    bounds: Aabb,
    /// Blockers below: a range of `order`.
    first: u32,
    count: u32,
    /// The node after all below this one.
    skip: u32,
}

/// A leaf holds no more than this.
const LEAF: usize = 4;

impl BlockerTree {
    /// Halves the blockers by the middles of their boxes along the longest side, again and again.
    pub fn new(blockers: &[Blocker]) -> Self {
        let mut tree = BlockerTree {
            nodes: Vec::new(),
            order: (0..blockers.len() as u32).collect(),
            slack: blockers.iter().map(|b| b.bands().slack).fold(0.0, f64::max),
        };
        if !blockers.is_empty() {
            tree.split(blockers, 0, blockers.len());
        }
        tree
    }

    fn split(&mut self, blockers: &[Blocker], first: usize, end: usize) {
        let of = |i: u32| blockers[i as usize].bounds();
        let part = &mut self.order[first..end];
        let bounds = part.iter().fold(Aabb::EMPTY, |b, &i| b.union(*of(i)));
        let node = self.nodes.len();
        let (size, count) = (bounds.size(), part.len());
        self.nodes.push(Node { bounds, first: first as u32, count: count as u32, skip: 0 });
        if count > LEAF {
            let axis = if size.max_element() == size.x { 0 } else { 1 + usize::from(size.z > size.y) };
            part.select_nth_unstable_by(count / 2, |&i, &j| {
                of(i).centre()[axis].total_cmp(&of(j).centre()[axis]).then(i.cmp(&j))
            });
            self.split(blockers, first, first + count / 2);
            self.split(blockers, first + count / 2, end);
        }
        self.nodes[node].skip = self.nodes.len() as u32;
    }

    /// The blockers, in the order of their numbers, that may block something between boxes `a`
    /// and `b`.
    pub fn candidates(&self, blockers: &[Blocker], a: &Aabb, b: &Aabb, found: &mut Vec<u32>) {
        found.clear();
        let shaft = BoxShaft::new(a, b);
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !shaft.meets(&node.bounds, self.slack) {
                at = node.skip as usize;
                continue;
            }
            if node.count as usize <= LEAF {
                let leaf = &self.order[node.first as usize..(node.first + node.count) as usize];
                found.extend(leaf.iter().filter(|&&i| {
                    let blocker = &blockers[i as usize];
                    shaft.meets(blocker.bounds(), blocker.bands().slack) && blocker.may_separate(a, b)
                }));
            }
            at += 1;
        }
        found.sort_unstable();
    }

    /// The blockers, in the order of their numbers, whose boxes come within `reach` of `bounds`.
    pub fn touching(&self, blockers: &[Blocker], bounds: &Aabb, reach: f64, found: &mut Vec<u32>) {
        found.clear();
        let meets =
            |of: &Aabb| of.min.cmple(bounds.max + reach).all() && of.max.cmpge(bounds.min - reach).all();
        let mut at = 0;
        while let Some(node) = self.nodes.get(at) {
            if !meets(&node.bounds) {
                at = node.skip as usize;
                continue;
            }
            if node.count as usize <= LEAF {
                let leaf = &self.order[node.first as usize..(node.first + node.count) as usize];
                found.extend(leaf.iter().filter(|&&i| meets(blockers[i as usize].bounds())));
            }
            at += 1;
        }
        found.sort_unstable();
    }
}

/// Whether a box may meet something between two others.
pub(super) fn meets_shaft(of: &Aabb, a: &Aabb, b: &Aabb, slack: f64) -> bool {
    BoxShaft::new(a, b).meets(of, slack)
}

/// The hull of two boxes, as far as boxes and three separating axes see it: the axes at right
/// angles to the line of centres and to a coordinate axis.
pub(super) struct BoxShaft {
    hull: Aabb,
    axes: [Axis; 3],
    ends: [Aabb; 2],
    /// From the one's centre to the other's, m.
    along: DVec3,
}

/// A direction, of any length, and what the shaft spans along it.
#[derive(Clone, Copy)]
struct Axis {
    direction: DVec3,
    length: f64,
    lo: f64,
    hi: f64,
}

impl Axis {
    /// The axis at right angles to `along`, the line of centres of a shaft's `ends`, and to `edge`.
    fn between([a, b]: &[Aabb; 2], along: DVec3, edge: DVec3) -> Axis {
        // A zero axis spans nothing and separates nothing.
        let direction = along.cross(edge);
        let ((a, ha), (b, hb)) = (extent(a, direction), extent(b, direction));
        Axis { direction, length: direction.length(), lo: (a - ha).min(b - hb), hi: (a + ha).max(b + hb) }
    }
}

/// Middle and half of what a box spans along `direction`.
fn extent(of: &Aabb, direction: DVec3) -> (f64, f64) {
    (direction.dot(of.centre()), 0.5 * direction.abs().dot(of.size()))
}

impl BoxShaft {
    /// The shaft between boxes `a` and `b`.
    pub fn new(a: &Aabb, b: &Aabb) -> Self {
        let along = b.centre() - a.centre();
        let ends = [*a, *b];
        let axes = DVec3::AXES.map(|axis| Axis::between(&ends, along, axis));
        BoxShaft { hull: a.union(*b), axes, ends, along }
    }

    /// Whether an axis at right angles to the line of centres and to an edge of the blocker keeps the two apart, or one
    /// of the axes that every shaft has.
    pub fn misses(&self, blocker: &Blocker) -> bool {
        let slack = blocker.bands().slack;
        if !self.meets(blocker.bounds(), slack) {
            return true;
        }
        let v = blocker.vertices();
        blocker.edges().iter().any(|&edge| {
            let axis = Axis::between(&self.ends, self.along, edge);
            let at = v.map(|p| axis.direction.dot(p));
            let (lo, hi) = (at[0].min(at[1]).min(at[2].min(at[3])), at[0].max(at[1]).max(at[2].max(at[3])));
            let slack = slack * axis.length;
            hi < axis.lo - slack || lo > axis.hi + slack
        })
    }

    pub fn meets(&self, of: &Aabb, slack: f64) -> bool {
        let slack3 = DVec3::splat(slack);
        of.min.cmple(self.hull.max + slack3).all()
            && of.max.cmpge(self.hull.min - slack3).all()
            && self.axes.iter().all(|axis| {
                let (middle, half) = extent(of, axis.direction);
                let slack = slack * axis.length;
                middle + half >= axis.lo - slack && middle - half <= axis.hi + slack
            })
    }
}

/// Whether an axis at right angles to the shaft between two patches and to an edge of the
/// blocker, or a side of the box around the shaft, keeps the two apart.
pub(super) fn misses_shaft(blocker: &Blocker, a: &[DVec3; 4], b: &[DVec3; 4], hull: &Aabb) -> bool {
    let slack = blocker.bands().slack;
    let (bounds, slack3) = (blocker.bounds(), DVec3::splat(slack));
    if bounds.min.cmpgt(hull.max + slack3).any() || bounds.max.cmplt(hull.min - slack3).any() {
        return true;
    }
    if blocker.round().is_some() {
        let around = |hull: &[DVec3; 4]| Aabb::around(hull.iter().copied());
        return !BoxShaft::new(&around(a), &around(b)).meets(bounds, slack);
    }
    let v = blocker.vertices();
    let along = b.iter().sum::<DVec3>() - a.iter().sum::<DVec3>();
    (0..4).any(|k| {
        let axis = along.cross(v[(k + 1) % 4] - v[k]).normalize_or_zero();
        let span = |points: &mut dyn Iterator<Item = &DVec3>| {
            points
                .map(|p| axis.dot(*p))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(x), hi.max(x)))
        };
        let (shaft, surface) = (span(&mut a.iter().chain(b)), span(&mut v.iter()));
        shaft.1 < surface.0 - slack || surface.1 < shaft.0 - slack
    })
}

#[cfg(test)]
mod tests {
    use super::super::blocker::Bands;
    use super::*;
    use crate::geometry::{Ray, Shape, Surface};
    use crate::tracers::brute_force::intersect_surface;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from_array)
    }

    fn cloud(size: f64) -> impl Strategy<Value = Vec<DVec3>> {
        let offsets = prop::collection::vec(point(), 4);
        (point(), offsets).prop_map(move |(o, v)| v.iter().map(|v| o + size * *v).collect())
    }

    proptest! {
        #[test]
        fn no_surface_that_blocks_is_culled(
            triangles in prop::collection::vec((point(), point(), point()), 1..40),
            a in cloud(0.2),
            b in cloud(0.4),
        ) {
            let surfaces: Vec<Surface> = triangles
                .iter()
                .map(|(o, u, v)| Surface::new(Shape::Triangle([*o, *o + 0.5 * u, *o + 0.5 * v])))
                .collect();
            let bands = Bands { apart: 1e-6, slack: 4e-6, near: 8e-6, rounding: 2e-6 };
            let blockers: Vec<Blocker> = surfaces.iter().map(|s| Blocker::new(s, &bands)).collect();
            let tree = BlockerTree::new(&blockers);
            let around = |p: &[DVec3]| Aabb::around(p.iter().copied());
            let mut found = Vec::new();
            tree.candidates(&blockers, &around(&a), &around(&b), &mut found);
            prop_assert!(found.windows(2).all(|w| w[0] < w[1]));
            let hull = around(&a).union(around(&b));
            let corners = |p: &[DVec3]| [p[0], p[1], p[2], p[3]];
            for from in &a {
                for to in &b {
                    let ray = Ray { origin: *from, direction: *to - *from, t_min: 1e-4, t_max: 1.0 - 1e-4 };
                    for (k, surface) in surfaces.iter().enumerate() {
                        if intersect_surface(&ray, surface).is_some() {
                            prop_assert!(found.contains(&(k as u32)));
                            prop_assert!(!BoxShaft::new(&around(&a), &around(&b)).misses(&blockers[k]));
                            prop_assert!(!misses_shaft(&blockers[k], &corners(&a), &corners(&b), &hull));
                        }
                    }
                }
            }
        }
    }
}

//! Pairs of points of which one, or both, lie on a curved surface: such points have no common plane, so they face one by
//! one, and what may stand between them is known by boxes alone.

use super::cull::meets_shaft;
use super::patch::Patch;
use super::voxel_pair::PairWork;
use crate::geometry::Aabb;
use crate::points::facing::SidePlane;

impl PairWork<'_> {
    /// Decides the pairs of two patches, one of them at least curved: those that do not face, then all where nothing
    /// comes near, else by the tracer.
    pub fn curved_patches(&mut self, a: &Patch, b: &Patch) {
        let build = self.build;
        let points = build.points;
        let around = |of: &Patch| Aabb::around(of.points.clone().map(|i| points.position[i].as_dvec3()));
        let boxes = [around(a), around(b)];
        let may_block = |&c: &u32| {
            let blocker = &build.blockers[c as usize];
            let within = |of: &Patch| {
                let encloses =
                    |i: usize| blocker.round().is_some_and(|r| r.encloses(points.position[i].as_dvec3()));
                of.points.clone().all(encloses)
            };
            // A planar surface, and a convex one seen from without, hides nothing from points of its own that face it; nor
            // does it hide what is in the body it bounds from anything else in it.
            let harmless = match blocker.round() {
                Some(round) if !round.is_planar() => {
                    let looks_out =
                        |of: &Patch| of.surface.0 == c && round.looks_out(points.side[of.points.start]);
                    looks_out(a) || looks_out(b) || within(a) && within(b)
                }
                _ => [a, b].iter().any(|of| of.surface.0 == c),
            };
            !harmless && meets_shaft(blocker.bounds(), &boxes[0], &boxes[1], blocker.bands().slack)
        };
        let clear = build.settings.proofs && !self.open.iter().any(may_block);
        let plane = |of: &Patch, i: usize| {
            if of.curved { SidePlane::touching(points, i) } else { of.plane }
        };
        for i in a.points.clone() {
            let (from, own) = (points.position[i].as_dvec3(), plane(a, i));
            let first = if a.points == b.points { i + 1 } else { b.points.start };
            for j in first..b.points.end {
                let to = points.position[j].as_dvec3();
                if own.height(to) <= build.bands.apart || plane(b, j).height(from) <= build.bands.apart {
                    self.result.stats.not_facing += 1;
                    continue;
                }
                self.result.facing += 1;
                if build.under[i] || build.under[j] {
                    self.result.stats.proved += 1;
                } else if clear {
                    self.result.stats.proved += 1;
                    self.see_points(i, j);
                } else {
                    self.push(i, j);
                }
            }
        }
    }
}

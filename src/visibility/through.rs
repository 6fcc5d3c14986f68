//! Surfaces that straight light may pass: panes of glass.

use crate::geometry::{Ray, SurfaceId};
use crate::scene::{Geometry, SampledAppearance};
use crate::tracers::RayTracer;
use glam::DVec3;
use std::collections::BTreeMap;

/// More surfaces in a row let nothing through.
const MOST: usize = 8;
/// Numbers of lists.
const MOST_LISTS: usize = u16::MAX as usize;

/// Lists of surfaces that light passes one after the other; number 0 is the empty one.
#[derive(Clone, Debug, PartialEq)]
pub struct Passages {
    lists: Vec<Vec<SurfaceId>>,
    numbers: BTreeMap<Vec<SurfaceId>, u16>,
    /// Ways that got no number, because there are too many lists: nothing comes through.
    pub lost: u64,
}

impl Default for Passages {
    fn default() -> Self {
        Passages { lists: vec![Vec::new()], numbers: BTreeMap::from([(Vec::new(), 0)]), lost: 0 }
    }
}

impl Passages {
    /// The number of a list, which it gets if it is new; `None` when there are too many.
    pub fn number(&mut self, list: &[SurfaceId]) -> Option<u16> {
        if let Some(&known) = self.numbers.get(list) {
            return Some(known);
        }
        if self.lists.len() > MOST_LISTS {
            self.lost += 1;
            return None;
        }
        let number = self.lists.len() as u16;
        self.lists.push(list.to_vec());
        self.numbers.insert(list.to_vec(), number);
        Some(number)
    }

    /// All lists.
    pub fn lists(&self) -> &[Vec<SurfaceId>] {
        &self.lists
    }

    /// The planar panes on the way from `from` to `to`; `None` if anything else is there.
    pub fn walk(
        geometry: &Geometry,
        tracer: &dyn RayTracer,
        from: DVec3,
        to: DVec3,
    ) -> Option<Vec<SurfaceId>> {
        Self::walk_all(geometry, tracer, [(from, to)].into_iter()).pop().flatten()
    }

    /// What the panes on the way from `from` to `to` let through, `[W]`; `None` if anything else is there.
    pub fn light(
        geometry: &Geometry,
        appearance: &SampledAppearance,
        tracer: &dyn RayTracer,
        from: DVec3,
        to: DVec3,
    ) -> Option<Vec<f32>> {
        let list = Self::walk(geometry, tracer, from, to)?;
        appearance.through(geometry, &list, (to - from).normalize())
    }

    /// [`Passages::walk`] for many ways, one surface after the other.
    pub fn walk_all(
        geometry: &Geometry,
        tracer: &dyn RayTracer,
        ways: impl Iterator<Item = (DVec3, DVec3)>,
    ) -> Vec<Option<Vec<SurfaceId>>> {
        let above = 4.0 * geometry.plane_tolerance();
        let ray = |(from, to): (DVec3, DVec3)| {
            let length = (to - from).length();
            Ray { origin: from, direction: (to - from) / length, t_min: above, t_max: length }
        };
        let mut rays: Vec<Ray> = ways.map(ray).collect();
        let mut lists = vec![Some(Vec::new()); rays.len()];
        let mut whose: Vec<usize> = (0..rays.len()).collect();
        let mut hits = Vec::new();
        while !rays.is_empty() {
            hits.clear();
            hits.resize(rays.len(), None);
            tracer.closest_batch(&rays, &mut hits);
            let mut kept = 0;
            for k in 0..rays.len() {
                let Some(hit) = hits[k] else { continue };
                let own = &mut lists[whose[k]];
                let passes = geometry.pane[hit.surface.index()] && geometry.surface(hit.surface).is_planar();
                match own {
                    Some(list) if passes && list.len() < MOST => {
                        list.push(hit.surface);
                        rays[kept] = Ray { t_min: hit.t + above, ..rays[k] };
                        whose[kept] = whose[k];
                        kept += 1;
                    }
                    _ => *own = None,
                }
            }
            rays.truncate(kept);
            whose.truncate(kept);
        }
        lists
    }
}

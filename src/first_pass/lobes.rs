//! The lobes of specular points: their rows and their scale factors.

use super::balance::{Element, balance};
use super::bounce::reflectance;
use super::directions::{Directions, LANES};
use super::nodes::Nodes;
use super::normalise::{Face, normalise_reflection, normalise_solid};
use super::rows::{BYTES, Rows};
use super::specular::{SpecularPoint, SpecularSet};
use crate::geometry::Side;
use crate::observer::Observer;
use crate::points::SamplePoints;
use rayon::prelude::*;

impl SpecularPoint {
    /// The ideal lobe of its reflection, or of what goes straight `through` it, if it has one.
    fn straight_lobe(&mut self, through: bool) -> Option<&mut Directions> {
        let lobe = if through { self.transmission.as_mut() } else { Some(&mut self.reflection) };
        lobe.filter(|d| d.origin.m2 == 0.0 && d.origin.straight)
    }
}

impl SpecularSet {
    /// Finds the nodes, to a `tolerance`, and the rows of all lobes that have none, and keeps about `most_bytes` of
    /// the rows.
    pub(super) fn find_rows(&mut self, tolerance: f32, most_bytes: u64) {
        let lobes = self.points.iter().map(|p| 1 + usize::from(p.transmission.is_some())).sum::<usize>();
        let most = most_bytes as usize / lobes.max(1) / BYTES;
        self.points.par_iter_mut().filter(|p| !p.scaled).for_each(|p| {
            // Reflection and transmission of glass are ideal.
            p.nodes = Nodes::new(&p.reflection, p.link_groups, tolerance);
            let ends = p.nodes.as_ref().map_or(&p.reflection, |nodes| &nodes.directions);
            p.rows = std::mem::take(&mut p.rows).renewed(ends, ends, true, most);
        });
        let through = |p: &SpecularPoint| {
            let twin = &self.points[p.twin.filter(|_| !p.scaled)? as usize];
            let (from, to) = (p.transmission.as_ref()?, twin.transmission.as_ref()?);
            Some(Rows::new(from, to, false, most))
        };
        let through: Vec<_> = self.points.par_iter().map(through).collect();
        for (point, through) in self.points.iter_mut().zip(through).filter(|(p, _)| !p.scaled) {
            point.through = through;
        }
    }

    /// Scales all lobes that are not yet scaled to their directional albedo.
    pub(super) fn normalise(&mut self, sample: &SamplePoints, observer: &dyn Observer) {
        let materials = &self.materials;
        let new = || self.points.iter().filter(|p| !p.scaled);
        let lobes: usize = new().map(|p| 1 + usize::from(p.transmission.is_some())).sum();
        observer.begin("specular lobes", lobes as u64);
        self.points
            .par_iter_mut()
            .filter(|p| !p.scaled)
            .filter_map(|p| materials[p.material].as_ref().map(|m| (p, m)))
            .filter(|(p, _)| p.reflection.origin.m2 > 0.0)
            .for_each(|(p, m)| {
                let SpecularPoint { reflection, nodes, rows, errors, .. } = p;
                errors.push(normalise_reflection(reflection, (nodes.as_ref(), rows), &m.albedo));
                observer.advance(1);
            });
        for through in [false, true] {
            self.balanced[usize::from(through)] = self.balance(sample, through, observer);
        }
        self.normalise_solids(observer);
        observer.end();
        self.points.iter_mut().for_each(|p| p.scaled = true);
        let balanced = self.balanced.iter().filter_map(|b| b.1.as_ref());
        let errors: Vec<(f64, f64)> =
            self.points.iter().flat_map(|p| &p.errors).chain(balanced).copied().collect();
        if !errors.is_empty() {
            let mean = errors.iter().map(|e| e.0).sum::<f64>() / errors.len() as f64;
            self.closure_error = (mean, errors.iter().map(|e| e.1).fold(0.0, f64::max));
        }
    }

    /// Scales what solids reflect and refract, and notes what balancing did not place in its lobe.
    fn normalise_solids(&mut self, observer: &dyn Observer) {
        let pairs: Vec<(usize, usize)> = (self.points.iter().enumerate())
            .filter(|(_, p)| {
                !p.scaled && !p.inside && p.transmission.as_ref().is_some_and(|t| !t.origin.straight)
            })
            .filter_map(|(s, p)| p.twin.map(|t| (s, t as usize)))
            .collect();
        let scaled: Vec<_> = pairs
            .par_iter()
            .filter_map(|&(s, t)| {
                let material = self.material(&self.points[s])?;
                let transmit = material.transmit.as_ref()?;
                let mut lobes = [s, t].map(|s| {
                    let p = &self.points[s];
                    (p.reflection.clone(), p.transmission.clone().unwrap_or_default())
                });
                let [a, b] = &mut lobes;
                let through = |s: usize| self.points[s].through.as_ref();
                let (Some(forth), Some(back)) = (through(s), through(t)) else { return None };
                let face = |s: usize, through, (reflection, transmission)| Face {
                    reflection,
                    rows: &self.points[s].rows,
                    transmission,
                    through,
                    reflect: reflectance(&self.points[s], material),
                };
                let error = normalise_solid(
                    face(s, forth, (&mut a.0, &mut a.1)),
                    face(t, back, (&mut b.0, &mut b.1)),
                    transmit,
                    material.n2,
                );
                observer.advance(2);
                Some((s, t, lobes, error))
            })
            .collect();
        for (s, t, lobes, error) in scaled {
            for (s, (reflection, transmission)) in [s, t].into_iter().zip(lobes) {
                self.points[s].reflection = reflection;
                self.points[s].transmission = Some(transmission);
            }
            self.points[s].errors.push(error);
        }
    }

    /// Balances the ideal lobes of all mirrors, or of what goes straight `through` panes, unless all of them have been.
    /// Returns their number, and the deviation left.
    fn balance(
        &mut self,
        sample: &SamplePoints,
        through: bool,
        observer: &dyn Observer,
    ) -> (usize, Option<(f64, f64)>) {
        let chosen: Vec<usize> =
            (0..self.points.len()).filter(|&s| self.points[s].straight_lobe(through).is_some()).collect();
        let before = self.balanced[usize::from(through)];
        if chosen.len() == before.0 && chosen.iter().all(|&s| self.points[s].scaled) {
            return before;
        }
        let place = |s: usize| chosen.binary_search(&s).ok();
        let mut groups = std::collections::BTreeMap::new();
        let mut elements: Vec<Element> = Vec::new();
        for (at, &s) in chosen.iter().enumerate() {
            let point = &mut self.points[s];
            let i = point.point as usize;
            let next = groups.len();
            let group = *groups.entry((sample.surface[i], sample.side[i] == Side::Back)).or_insert(next);
            let mut directions = point.straight_lobe(through).map(std::mem::take).unwrap_or_default();
            directions.scale.fill([1.0; LANES]);
            let rows = if through { point.through.as_mut() } else { Some(&mut point.rows) };
            elements.push(Element {
                directions,
                rows: rows.map(std::mem::take).unwrap_or_default(),
                other: if through { point.twin.and_then(|t| place(t as usize)).unwrap_or(at) } else { at },
                group,
                area: sample.area[i],
                members: std::mem::take(&mut point.members),
            });
        }
        let error = (!elements.is_empty()).then(|| balance(&mut elements, sample.len(), observer));
        for (&s, element) in chosen.iter().zip(elements) {
            let point = &mut self.points[s];
            point.members = element.members;
            if through {
                point.transmission = Some(element.directions);
                point.through = Some(element.rows);
            } else {
                point.reflection = element.directions;
                point.rows = element.rows;
            }
        }
        (chosen.len(), error)
    }
}

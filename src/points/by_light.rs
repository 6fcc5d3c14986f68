//! Refinement driven by the light: elements are divided where the radiance of points bends, as it does at the edges of
//! shadows and where things stand on each other.
//!
//! Lamps are divided along with them: an element of a lamp is seen whole or not at all, so that the soft edge of a
//! shadow is a stair of as many steps as the lamp has elements. More points on the edge alone would show the steps
//! more sharply.

use super::{Element, MAX_POINTS, SamplePoints, Sampling};
use crate::geometry::SurfaceId;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// How far refinement by the light goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightRefinement {
    /// An element is divided where the luminance of the points around strays from a linear one by more than this share
    /// of the scene's mean luminance; elements smaller than the mean may stray more, by the root of how much smaller
    /// they are.
    pub tolerance: f64,
    /// Times that an element may be divided.
    pub rounds: u32,
    /// The points become at most so many times as many.
    pub growth: f64,
}

impl Default for LightRefinement {
    fn default() -> Self {
        LightRefinement { tolerance: 0.05, rounds: 3, growth: 4.0 }
    }
}

/// Lamps are divided along as long as their points are no larger a share of all than this.
const LAMPS: f64 = 0.1;

/// A point is at the edge of its surface if the middle of those around it is further away than this, in elements: without
/// those on one side it is half an element away, with larger and smaller elements on either side a tenth.
const ASIDE: f64 = 0.3;

/// How far light strays on the last half of an element, as a share of the change that its slope would make there.
const AT_EDGE: f64 = 0.5;

/// What stays the same from round to round.
pub struct LightRefiner {
    tolerance: f64,
    /// Mean area of the elements at the start, m².
    area: f64,
    /// Most points.
    most: usize,
}

impl LightRefiner {
    /// Starts from `points`.
    pub fn new(settings: &LightRefinement, points: &SamplePoints) -> Self {
        let area = points.area.iter().map(|&a| f64::from(a)).sum::<f64>() / points.len().max(1) as f64;
        let most = (settings.growth * points.len() as f64).min(MAX_POINTS as f64) as usize;
        LightRefiner { tolerance: settings.tolerance, area, most }
    }

    /// One round: the elements of `points`, those divided in four around which `luminance`, by point, bends most.
    /// `around(i)` are the points of the same surface that touch point `i`, and `i`. Elements of surfaces that emit
    /// (`lamp`) are divided along, as long as theirs stay a small share of all. `None` where nothing is to be divided.
    pub fn refine(
        &self,
        sampling: &Sampling,
        points: &SamplePoints,
        luminance: &[f64],
        lamp: impl Fn(SurfaceId) -> bool,
        around: impl Fn(usize) -> Vec<u32> + Sync,
    ) -> Option<Vec<Element>> {
        let area = |i: usize| f64::from(points.area[i]);
        let all: f64 = (0..points.len()).map(area).sum();
        let mean = (0..points.len()).map(|i| area(i) * luminance[i]).sum::<f64>() / all;
        if mean.is_nan() || mean <= 0.0 {
            return None;
        }
        let bends: Vec<f64> = (0..points.len())
            .into_par_iter()
            .map(|i| bend(points, luminance, i, &around(i)) / mean * (area(i) / self.area).sqrt())
            .collect();
        // Of the two sides of an element the one that asks for more decides.
        let mut asked: BTreeMap<Element, (f64, usize)> = BTreeMap::new();
        for (i, &bend) in bends.iter().enumerate() {
            let of = asked.entry((points.surface[i], points.cell[i])).or_default();
            *of = (of.0.max(bend), of.1 + 1);
        }
        let divisible = |(_, cell): &Element| cell.level < sampling.level_limit();
        let mut chosen: Vec<(&Element, f64, usize)> = asked
            .iter()
            .filter(|(element, (bend, _))| *bend > self.tolerance && divisible(element))
            .map(|(element, &(bend, sides))| (element, bend, sides))
            .collect();
        chosen.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(b.0)));
        if chosen.is_empty() {
            return None;
        }
        let lamps: BTreeMap<&Element, usize> = asked
            .iter()
            .filter(|(element, _)| lamp(element.0) && divisible(element))
            .map(|(element, (_, sides))| (element, *sides))
            .collect();
        let of_lamps = 4 * lamps.values().sum::<usize>();
        let along = of_lamps as f64 <= LAMPS * points.len() as f64;
        let mut count = points.len() + if along { of_lamps / 4 * 3 } else { 0 };
        let fits = |(_, _, sides): &&(&Element, f64, usize)| {
            count += 3 * sides;
            count <= self.most
        };
        chosen.retain(|(element, ..)| !along || !lamps.contains_key(element));
        let mut divided: BTreeSet<Element> =
            chosen.iter().take_while(fits).map(|(element, ..)| **element).collect();
        if divided.is_empty() {
            return None;
        }
        if along {
            divided.extend(lamps.keys().copied());
        }
        let mut finer = Vec::with_capacity(points.len() + 3 * divided.len());
        for (id, cell) in points.elements() {
            if divided.contains(&(id, cell)) {
                finer.extend((0..4).map(|c| (id, cell.child(c))));
            } else {
                finer.push((id, cell));
            }
        }
        Some(finer)
    }
}

/// By how much the luminance of the points `around` point `i`, which are on its side of its surface, strays from that
/// linear one which comes nearest; where there are three points or fewer, half of what they differ by. At the edge of
/// a surface no point tells how light bends on the last half of an element, as it does where another surface joins: a
/// share of the slope counts there.
fn bend(points: &SamplePoints, luminance: &[f64], i: usize, around: &[u32]) -> f64 {
    let of = |j: u32| luminance[j as usize];
    if around.len() <= 3 {
        let (low, high) =
            around.iter().fold((of(i as u32), of(i as u32)), |(l, h), &j| (l.min(of(j)), h.max(of(j))));
        return 0.5 * (high - low);
    }
    let size = f64::from(points.area[i]).sqrt();
    let (x, y) = points.normal[i].as_dvec3().any_orthonormal_pair();
    let row = |j: u32| {
        let d = (points.position[j as usize] - points.position[i]).as_dvec3() / size;
        DVec3::new(1.0, x.dot(d), y.dot(d))
    };
    // A little is added for the sake of points in a row.
    let mut normal = DMat3::from_diagonal(DVec3::new(0.0, 1e-9, 1e-9));
    let mut right = DVec3::ZERO;
    for &j in around {
        let row = row(j);
        normal += DMat3::from_cols(row.x * row, row.y * row, row.z * row);
        right += of(j) * row;
    }
    let fit = normal.inverse() * right;
    let stray = around.iter().map(|&j| (of(j) - fit.dot(row(j))).abs()).fold(0.0, f64::max);
    let centroid = around.iter().map(|&j| row(j)).sum::<DVec3>() / around.len() as f64;
    let aside = DVec2::new(centroid.y, centroid.z);
    if aside.length() > ASIDE {
        let over_half = 0.5 * DVec2::new(fit.y, fit.z).dot(aside.normalize()).abs();
        return stray.max(AT_EDGE * over_half);
    }
    stray
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::points::divide_by_area;
    use crate::scene::{Geometry, ObjectId};

    /// A square of 16 x 16 elements.
    fn square() -> (Geometry, SamplePoints) {
        let quad = Shape::Quad([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
        let geometry = Geometry::new(vec![(quad, false, 0, ObjectId(0))], vec!["square".into()]);
        let elements = divide_by_area(&geometry, &Sampling::by_area(1.01 / 256.0));
        let points = SamplePoints::new(&geometry, &elements, 1, |_| 0);
        (geometry, points)
    }

    fn around(points: &SamplePoints, i: usize) -> Vec<u32> {
        let near = |j: &u32| points.position[*j as usize].distance(points.position[i]) < 0.1;
        (0..points.len() as u32).filter(near).collect()
    }

    #[test]
    fn edges_are_divided_and_gradients_are_not() {
        let (_, points) = square();
        let settings = LightRefinement::default();
        let refiner = LightRefiner::new(&settings, &points);
        let refine = |l: &dyn Fn(f64, f64) -> f64| {
            let of = |p: &glam::Vec3| l(f64::from(p.x), f64::from(p.y));
            let luminance: Vec<f64> = points.position.iter().map(of).collect();
            refiner.refine(&Sampling::by_area(1.0), &points, &luminance, |_| false, |i| around(&points, i))
        };
        assert_eq!(refine(&|x, y| 1.0 + 3.0 * x + y), None);
        assert_eq!(refine(&|_, _| 0.0), None);
        let step = refine(&|x, _| if x < 0.01 { 0.0 } else { 1.0 }).expect("an edge");
        // A column on either side of the step.
        assert_eq!(step.len(), 256 + 3 * 2 * 16);
    }

    #[test]
    fn a_slope_is_followed_to_the_edge_of_a_surface_alone() {
        let (_, points) = square();
        let refiner = LightRefiner::new(&LightRefinement { tolerance: 0.015, ..Default::default() }, &points);
        let luminance: Vec<f64> = points.position.iter().map(|p| 1.0 + 1.6 * f64::from(p.x)).collect();
        let finer =
            refiner.refine(&Sampling::by_area(1.0), &points, &luminance, |_| false, |i| around(&points, i));
        // A tenth from element to element: the columns at the edge to which light rises or falls.
        assert_eq!(finer.expect("a slope").len(), 256 + 3 * 2 * 16);
    }

    #[test]
    fn the_points_stay_within_their_bound_and_the_worst_come_first() {
        let (_, points) = square();
        let refiner = LightRefiner::new(&LightRefinement { growth: 1.05, ..Default::default() }, &points);
        let at = |i: usize| points.position[i];
        let luminance: Vec<f64> = (0..points.len())
            .map(|i| {
                if at(i).x > 0.2 {
                    5.0
                } else if at(i).y > 0.2 {
                    1.2
                } else {
                    1.0
                }
            })
            .collect();
        let finer =
            refiner.refine(&Sampling::by_area(1.0), &points, &luminance, |_| false, |i| around(&points, i));
        let finer = finer.expect("two edges");
        assert_eq!(finer.len(), 256 + 3 * 4);
    }
}

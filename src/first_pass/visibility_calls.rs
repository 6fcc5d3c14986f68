//! How often the paper's algorithm, without a graph, would ask whether two points see each other
//! (its Table 2), counted without following every path.

use super::directions::{Directions, Origin, strip_order};
use super::form_factor::plane_distances;
use super::member::Frame;
use super::specular::SpecularSet;
use crate::points::{NO_POINT, SamplePoints};
use rayon::prelude::*;

/// Calls of h by EvaluateEFF and GlobSpecOp for all points: N (N - 1) from point to point, and one for
/// every path j ... l, s and every point k in the cone at s, for chains of up to `longest`
/// reflections. Points in the cone count whether they turn out to be visible or not; only reflection
/// counts, as in the paper.
pub fn count(points: &SamplePoints, specular: &SpecularSet, tolerance: f32, longest: u32) -> f64 {
    let n = points.len() as f64;
    let mut calls = n * (n - 1.0).max(0.0);
    let cones: Vec<Cones> = (0..specular.points.len())
        .into_par_iter()
        .map(|s| Cones::new(points, specular, tolerance, s))
        .collect();
    // Paths that arrive at s from each of its members; at first one from each.
    let mut paths: Vec<Vec<f64>> = (specular.points.iter())
        .map(|p| p.members.iter().map(|&m| f64::from(u8::from(m != NO_POINT))).collect())
        .collect();
    for _ in 0..longest {
        let mut next: Vec<Vec<f64>> = paths.iter().map(|p| vec![0.0; p.len()]).collect();
        for (s, cones) in cones.iter().enumerate() {
            for (member, &arriving) in paths[s].iter().enumerate().filter(|(_, a)| **a > 0.0) {
                calls += arriving * f64::from(cones.size[member]);
                for &link in &cones.links[member] {
                    let link = specular.points[s].links[link as usize];
                    if link.back != NO_POINT {
                        let target = link.point as usize;
                        let place = specular.points[target].links[link.back as usize].member;
                        next[target][place as usize] += arriving;
                    }
                }
            }
        }
        paths = next;
    }
    calls
}

/// The reflection cones of one specular point, one for each member as the previous point.
pub(super) struct Cones {
    /// Points in the cone.
    pub size: Vec<u32>,
    /// Links of the point in the cone.
    pub links: Vec<Vec<u32>>,
}

impl Cones {
    /// Of specular point `s`.
    pub fn new(points: &SamplePoints, specular: &SpecularSet, tolerance: f32, s: usize) -> Self {
        let point = &specular.points[s];
        let facing = all_facing(points, tolerance, point.point as usize, point.reflection.origin);
        let (mut size, mut links) = (Vec::new(), Vec::new());
        for (member, &l) in point.members.iter().enumerate() {
            if l == NO_POINT {
                size.push(0);
                links.push(Vec::new());
                continue;
            }
            let a = point.reflection.get(member);
            let mut count = 0;
            for g in facing.reach(a, 0..facing.groups()) {
                if let Some((b, _)) = facing.lobe(&a, g) {
                    count += b.iter().filter(|b| **b > 0.0).count() as u32;
                }
            }
            size.push(count);
            let within = |link: &u32| {
                let k = point.links[*link as usize].member as usize;
                point.reflection.lobe_at(&a, k).0 > 0.0
            };
            links.push((0..point.links.len() as u32).filter(within).collect());
        }
        Cones { size, links }
    }
}

/// All points that `i` faces, visible or not, as directions.
fn all_facing(points: &SamplePoints, tolerance: f32, i: usize, origin: Origin) -> Directions {
    let frame = Frame::new(points, i);
    let mut list = Vec::new();
    for j in 0..points.len() {
        let (d_i, d_j, r2) = plane_distances(points, i, j);
        if d_i > tolerance && d_j > tolerance {
            list.push(frame.direction(points, (i, j), (d_i, d_j, r2)));
        }
    }
    strip_order(&mut list, |d| d.to);
    Directions::new(origin, &list)
}

//! What a node's radiance is made of: weights on the sample points around it.

use super::lattice::Lattice;
use glam::{DVec2, DVec3};

/// Weights of all nodes, one row a node.
pub(super) struct Stencils {
    starts: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Stencils {
    /// Rows for all nodes of `lattice` that are no halves, whose rows stay empty. `centre` and
    /// `normal` belong to the elements.
    pub fn new(lattice: &Lattice, centre: &[DVec3], normal: &[DVec3]) -> Self {
        let nodes = lattice.position.len();
        let mut half = vec![false; nodes];
        for &(node, ..) in &lattice.halves {
            half[node as usize] = true;
        }
        let mut stencils = Stencils { starts: Vec::with_capacity(nodes + 1), entries: Vec::new() };
        stencils.starts.push(0);
        for (node, half) in half.into_iter().enumerate() {
            if !half {
                add_row(lattice, node, centre, normal, &mut stencils.entries);
            }
            stencils.starts.push(stencils.entries.len() as u32);
        }
        stencils
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// (element, weight) of node `i`.
    pub fn of(&self, i: usize) -> &[(u32, f64)] {
        &self.entries[self.starts[i] as usize..self.starts[i + 1] as usize]
    }
}

/// The mean of the elements that touch the node: in the middle of four equal cells the four
/// closest sample points, as the paper has it. Where the mean of their places is not the node
/// (borders, unequal neighbours) the least change of weights on the elements around makes it so:
/// then every linear field is met exactly.
fn add_row(
    lattice: &Lattice,
    node: usize,
    centre: &[DVec3],
    normal: &[DVec3],
    entries: &mut Vec<(u32, f64)>,
) {
    let at = lattice.position[node];
    let touching = lattice.touching.of(node);
    let share = 1.0 / touching.len() as f64;
    let start = entries.len();
    entries.extend(touching.iter().map(|&e| (e, share)));

    let up: DVec3 = touching.iter().map(|&e| normal[e as usize]).sum();
    let Some(up) = up.try_normalize() else { return };
    let (x, y) = up.any_orthonormal_pair();
    let flat = |e: u32| {
        let d = centre[e as usize] - at;
        DVec2::new(x.dot(d), y.dot(d))
    };
    let places: Vec<DVec2> = touching.iter().map(|&e| flat(e)).collect();
    let missing = -share * places.iter().sum::<DVec2>();
    let size = places.iter().map(|p| p.length()).fold(0.0, f64::max);
    if missing.length() <= 1e-9 * size {
        return;
    }

    let mut around: Vec<u32> = touching
        .iter()
        .flat_map(|&e| lattice.corners[e as usize])
        .flat_map(|corner| lattice.touching.of(corner as usize).iter().copied())
        .collect();
    around.sort_unstable();
    around.dedup();
    let places: Vec<DVec2> = around.iter().map(|&e| flat(e)).collect();
    // Near elements know more about the node than far ones.
    let trust: Vec<f64> = places.iter().map(|p| 1.0 / p.length_squared().max(1e-12 * size * size)).collect();
    let total: f64 = trust.iter().sum();
    let middle = places.iter().zip(&trust).map(|(&p, &t)| p * t).sum::<DVec2>() / total;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (&p, t) in places.iter().zip(&trust) {
        let d = p - middle;
        (xx, xy, yy) = (xx + t * d.x * d.x, xy + t * d.x * d.y, yy + t * d.y * d.y);
    }
    let slope = solve_symmetric(xx, xy, yy, missing);
    for ((e, p), t) in around.into_iter().zip(places).zip(trust) {
        let change = t * (p - middle).dot(slope);
        match entries[start..].iter_mut().find(|(known, _)| *known == e) {
            Some((_, weight)) => *weight += change,
            None => entries.push((e, change)),
        }
    }
}

/// Solves [[xx, xy], [xy, yy]] s = b; along a direction in which the matrix is all but zero (all
/// elements in a line) s is zero.
fn solve_symmetric(xx: f64, xy: f64, yy: f64, b: DVec2) -> DVec2 {
    let mean = 0.5 * (xx + yy);
    let spread = (0.5 * (xx - yy)).hypot(xy);
    let (large, small) = (mean + spread, mean - spread);
    if large.is_nan() || large <= 0.0 {
        return DVec2::ZERO;
    }
    let axis = if xx >= yy { DVec2::new(large - yy, xy) } else { DVec2::new(xy, large - xx) };
    let axis = axis.try_normalize().unwrap_or(DVec2::X);
    let along = axis * (axis.dot(b) / large);
    if small <= 1e-9 * large {
        return along;
    }
    let across = axis.perp();
    along + across * (across.dot(b) / small)
}

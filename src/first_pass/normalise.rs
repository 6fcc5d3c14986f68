//! Scale factors that make every rough lobe return its directional albedo over the members a point has,
//! u_l Σ_k B(l, k) q_k u_k = a(θ_l), and every piece of the surface of a solid return all light: what it reflects and what
//! it lets through together.
//!
//! B stays symmetric, so energy is neither created nor lost and reciprocity holds. What balancing cannot
//! place in a lobe is little; it is spread over the directions whose rows lack it, in proportion to what they lack,
//! which is symmetric too. So rows sum to what they should to rounding, and uniform surroundings stay as they are.

use super::directions::{Directions, LANES, Lanes};
use super::lobe_table::LobeTable;
use super::nodes::Nodes;
use super::rows::Rows;
use super::scaling::{Problem, lower};
use crate::material::AlbedoTable;

/// u_l Σ_k B(l, k) q_k u_k x_k over the members of `to`, for every member l of `from`; B times `table` if there is one.
fn product(
    rows: &Rows,
    (from, to): (&Directions, &Directions),
    table: Option<&LobeTable>,
    x: &[f32],
) -> Vec<f32> {
    let mut sums = rows.product(from, to, table, &weighted(to, Some(x)));
    sums.iter_mut().enumerate().for_each(|(l, sum)| *sum *= from.scale_of(l));
    sums
}

/// [`product`] of a reflection by way of nodes.
fn by_nodes(rows: &Rows, nodes: &Nodes, members: &Directions, x: &[f32]) -> Vec<f32> {
    let light = nodes.gather(1, &weighted(members, Some(x)));
    let sums = rows.product(&nodes.directions, &nodes.directions, None, &light);
    let mut lanes = vec![[0.0; LANES]; nodes.directions.groups()];
    lanes.as_flattened_mut()[..sums.len()].copy_from_slice(&sums);
    let sums = nodes.scatter(1, members.groups(), &lanes);
    let (sums, scales) = (sums.as_flattened(), members.scale.as_flattened());
    sums[..members.len].iter().zip(scales).map(|(sum, u)| sum * u).collect()
}

/// Weight times scale of every direction, times `x`.
pub(super) fn weighted(directions: &Directions, x: Option<&[f32]>) -> Vec<Lanes> {
    let mut product: Vec<Lanes> = (directions.weight.iter().zip(&directions.scale))
        .map(|(w, u)| std::array::from_fn(|lane| w[lane] * u[lane]))
        .collect();
    product.as_flattened_mut().iter_mut().zip(x.into_iter().flatten()).for_each(|(product, x)| *product *= x);
    product
}

/// Weights of all directions.
fn weights(directions: &Directions) -> impl Iterator<Item = f32> {
    directions.weight.iter().flatten().copied().take(directions.len)
}

/// Cosines of all directions.
fn cosines(directions: &Directions) -> impl Iterator<Item = f32> {
    directions.z.iter().flatten().copied().take(directions.len)
}

/// Multiplies the scales of all directions.
fn rescale(directions: &mut Directions, factors: &[f32]) {
    for (l, factor) in factors.iter().enumerate() {
        directions.scale[l / LANES][l % LANES] *= factor;
    }
}

/// What rows lack becomes the part of light that is spread.
fn spread(directions: &mut Directions, lacks: &[f32]) {
    let whole: f64 = weights(directions).zip(lacks).map(|(q, lacks)| f64::from(q) * f64::from(*lacks)).sum();
    let root = whole.sqrt() as f32;
    directions.spread =
        if root > 0.0 { lacks.iter().map(|lacks| lacks / root).collect() } else { Vec::new() };
}

/// Scales the reflection lobe of one point, given its rows, between nodes if it has any, to the directional `albedo`,
/// going on from the scales it has. Returns the (mean, largest) share of the light that balancing did not place in its lobe.
pub fn normalise_reflection(
    directions: &mut Directions,
    (nodes, rows): (Option<&Nodes>, &Rows),
    albedo: &AlbedoTable,
) -> (f64, f64) {
    let again = directions.is_scaled();
    let measure: Vec<f32> = weights(directions).collect();
    let target: Vec<f32> = cosines(directions).map(|z| albedo.eval(z)).collect();
    let problem = Problem {
        product: |x: &[f32]| match nodes {
            None => product(rows, (directions, directions), None, x),
            Some(nodes) => by_nodes(rows, nodes, directions, x),
        },
        measure: &measure,
        target: &target,
    };
    let (factors, lacks, deviation) = lower(&problem, problem.solve(again));
    rescale(directions, &factors);
    spread(directions, &lacks);
    if !again {
        directions.from_nothing = Some((directions.origin.m2, directions.scale.clone()));
    }
    deviation
}

/// One side of a piece of the surface of a solid: what it sees, as directions it reflects to and as directions outside that
/// refract to them.
pub struct Face<'a> {
    /// Of reflection.
    pub reflection: &'a mut Directions,
    /// Its rows.
    pub rows: &'a Rows,
    /// Of transmission.
    pub transmission: &'a mut Directions,
    /// The rows of what goes from here to the other face.
    pub through: &'a Rows,
    /// F
    pub reflect: &'a LobeTable,
}

/// Scales both lobes of both sides of a piece of the surface of a solid, `front` outside, so that all light leaves it
/// again; `transmit` is 1 - F against the cosine outside. Returns the (mean, largest) share of the light that
/// balancing did not place in its lobe.
pub fn normalise_solid(front: Face, back: Face, transmit: &LobeTable, n2: f32) -> (f64, f64) {
    // Rows and columns can both be met only when as much goes in as comes out. A gain on what leaves the
    // back mends that: light that comes in gets its inverse, so a round trip keeps its energy.
    let through = |d: &Directions| -> Vec<f32> {
        cosines(d).map(|z| if z > 0.0 { transmit.value(z, 0) } else { 0.0 }).collect()
    };
    let target = [through(front.transmission), through(back.transmission)];
    let total = |d: &Directions, t: &[f32]| weights(d).zip(t).map(|(w, t)| f64::from(w * t)).sum::<f64>();
    let ratio = (total(front.transmission, &target[0]) / total(back.transmission, &target[1])) as f32;
    let gain = if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 };
    back.transmission.gain = gain;
    back.transmission.weight.iter_mut().flatten().for_each(|w| *w *= gain);

    let (outside, inside) = (front.reflection.len, back.reflection.len);
    let (front_rows, back_rows) = ([front.rows, front.through], [back.rows, back.through]);
    let transmitted = |front: &Directions, back: &Directions, x: &[f32]| {
        let mut sums = product(front_rows[1], (front, back), Some(transmit), &x[outside..]);
        sums.extend(product(back_rows[1], (back, front), Some(transmit), &x[..outside]));
        sums
    };
    let measure: Vec<f32> = weights(front.transmission).chain(weights(back.transmission)).collect();
    let (factors, _) = Problem {
        product: |x: &[f32]| transmitted(front.transmission, back.transmission, x),
        measure: &measure,
        target: &target.concat(),
    }
    .solve(false);
    rescale(front.transmission, &factors[..outside]);
    rescale(back.transmission, &factors[outside..]);

    // Fresnel's shares alone do not sum to 1, for elements reflect and refract light a little differently. Both together
    // are balanced once more, those beyond the critical angle as well.
    let measure: Vec<f32> =
        (weights(front.reflection)).chain(weights(back.reflection).map(|q| q * n2 * gain)).collect();
    let problem = Problem {
        product: |x: &[f32]| {
            let mut sums = transmitted(front.transmission, back.transmission, x);
            let face = |face: &Face, rows: &Rows, x: &[f32]| {
                product(rows, (face.reflection, face.reflection), Some(face.reflect), x)
            };
            let mut reflected = face(&front, front_rows[0], &x[..outside]);
            reflected.extend(face(&back, back_rows[0], &x[outside..]));
            sums.iter_mut().zip(reflected).for_each(|(sum, more)| *sum += more);
            sums
        },
        measure: &measure,
        target: &vec![1.0; outside + inside],
    };
    let (factors, lacks, deviation) = lower(&problem, problem.solve(false));
    for (face, part) in [(front, 0..outside), (back, outside..outside + inside)] {
        rescale(face.reflection, &factors[part.clone()]);
        rescale(face.transmission, &factors[part.clone()]);
        spread(face.reflection, &lacks[part]);
    }
    deviation
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::bounce::reflect;
    use super::super::directions::{Direction, Origin, tile_order};
    use super::super::lobe;
    use super::super::scatter::spread;
    use super::*;
    use crate::material::FresnelTable;
    use std::f32::consts::{PI, TAU};

    /// A hemisphere of `rings` rings of equal projected solid angle, seen from an element of a tenth of their distance.
    pub fn hemisphere(m: f32, rings: usize) -> Directions {
        let mut list = Vec::new();
        for ring in 0..rings {
            let count = 6 * ring + 3;
            let edge = |r: usize| (r as f32 / rings as f32).powi(2);
            let weight = PI * (edge(ring + 1) - edge(ring)) / count as f32;
            let r = (0.5 * (edge(ring) + edge(ring + 1))).sqrt();
            for i in 0..count {
                let (y, x) = (TAU * (i as f32 + 0.3) / count as f32).sin_cos();
                let z = (1.0 - r * r).sqrt();
                list.push(Direction {
                    to: [r * x, r * y, z],
                    weight,
                    rough: lobe::Extent::new(weight / z, 0.1, z),
                    ..Default::default()
                });
            }
        }
        tile_order(&mut list, 0, |d| d.to);
        Directions::new(Origin { m2: m * m, side: [0.1; 2], straight: true }, &list)
    }

    #[test]
    fn rough_lobes_return_their_albedo() {
        let table = LobeTable::new(&FresnelTable::new(1, 20, |_, _| 1.0), 1.0, false);
        let mut by_nodes = 0;
        for m in [0.05, 0.1, 0.3, 0.6, 1.0] {
            for rings in [6, 20] {
                let albedo = AlbedoTable::new(f64::from(m));
                for tolerance in [0.0, 0.1] {
                    let mut members = hemisphere(m, rings);
                    let nodes = Nodes::new(&members, 0, tolerance);
                    if tolerance > 0.0 && nodes.is_none() {
                        continue;
                    }
                    by_nodes += usize::from(nodes.is_some());
                    let ends = nodes.as_ref().map_or(&members, |nodes| &nodes.directions);
                    let rows = Rows::new(ends, ends, true, 3000);
                    let (mean, largest) =
                        normalise_reflection(&mut members, (nodes.as_ref(), &rows), &albedo);
                    println!(
                        "m {m}, {rings} rings: {mean:.1e} of the light is spread, {largest:.1e} at most"
                    );
                    assert!(mean < 3e-4 && largest < 1e-3, "m {m}: {mean} {largest}");
                    let light: Vec<Lanes> = weighted(&members, None);
                    let lobe = (nodes.as_ref(), &rows, &table);
                    let mut radiance = reflect(lobe, &members, 1, &light, members.groups());
                    for (radiance, u) in radiance.iter_mut().zip(&members.scale) {
                        (0..LANES).for_each(|lane| radiance[lane] *= u[lane]);
                    }
                    spread(&members, &table, 1, &members.weight, &mut radiance);
                    for (z, l) in cosines(&members).zip(radiance.iter().flatten()) {
                        assert!((l - albedo.eval(z)).abs() < 2e-5, "m {m}: {l} for {}", albedo.eval(z));
                    }
                }
            }
        }
        assert!(by_nodes >= 3, "{by_nodes} lobes have nodes");
    }
}

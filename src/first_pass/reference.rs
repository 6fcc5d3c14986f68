//! The paper's EvaluateEFF and GlobSpecOp (section 3.3.2) as written: recursive, one source at a time,
//! the whole matrix stored. Slow; it is what the matrix-free operators are tested against.
//!
//! Two slips are mended: the accumulated contribution is a local copy for each k, and h_li is part of
//! the product, else light leaks through walls. Factors, lobes and scale factors are those of the
//! production code, and transmission through glass is added beside reflection.

use super::bounce::reflectance;
use super::directions::Directions;
use super::lobe_table::LobeTable;
use super::nodes::Nodes;
use super::scatter::spread_between;
use super::settings::ChainLimits;
use super::specular::SpecularSet;
use super::system::System;
use super::visibility_calls::Cones;
use crate::points::NO_POINT;
use crate::visibility::VisibilityGraph;
use std::f64::consts::PI;

/// The matrix of extended form factors: EFF_ji is the share of the diffuse radiance of j that becomes
/// diffuse radiance of i.
#[derive(Clone, Debug)]
pub struct ExtendedFormFactors {
    /// `[N (j)][N (i)][W]`.
    pub values: Vec<f64>,
    /// How often the paper's algorithm asked for h (0 from the production operators).
    pub visibility_calls: u64,
}

/// EFF by the production operators, column by column: each point in turn gets radiance 1.
pub fn extended_form_factors(system: &System, limits: &ChainLimits) -> ExtendedFormFactors {
    let (n, w) = (system.points.len(), system.wavelengths());
    let mut values = Vec::with_capacity(n * n * w);
    for j in 0..n {
        let mut unit = vec![0.0; n * w];
        (0..w).for_each(|k| unit[k * n + j] = 1.0);
        let mut irradiance = system.diffuse.irradiance(&unit, |_| true);
        let flow = system.specular.apply(system.points, &unit, limits);
        irradiance.iter_mut().zip(&flow.irradiance).for_each(|(e, c)| *e += c);
        let column = system.reflected(&irradiance);
        values.extend((0..n * w).map(|at| f64::from(column[at % w * n + at / w])));
    }
    ExtendedFormFactors { values, visibility_calls: 0 }
}

/// EFF by the paper's recursion, for chains of up to `lg_max` reflections that carry more than
/// `eff_min`. `tolerance` as for the system.
pub fn evaluate(
    system: &System,
    graph: &VisibilityGraph,
    tolerance: f32,
    lg_max: u32,
    eff_min: f64,
) -> ExtendedFormFactors {
    let (n, w) = (system.points.len(), system.wavelengths());
    let set = &system.specular;
    let cones = (0..set.points.len()).map(|s| Cones::new(system.points, set, tolerance, s)).collect();
    let mut evaluation =
        Evaluation { system, set, cones, lg_max, eff_min, eff: vec![0.0; n * n * w], calls: 0 };
    for j in 0..n {
        for i in (0..n).filter(|&i| i != j) {
            evaluation.calls += 1;
            let (d_i, d_j, _) = super::form_factor::plane_distances(system.points, i, j);
            if !(d_i > tolerance && d_j > tolerance && graph.unblocked(i, j)) {
                continue;
            }
            let factor = f64::from(system.diffuse.factor(i, j));
            for k in 0..w {
                evaluation.eff[(j * n + i) * w + k] +=
                    factor / PI * f64::from(system.response.reflectance[k * n + i]);
            }
            if lg_max > 0
                && let Ok(s) = set.points.binary_search_by_key(&(i as u32), |p| p.point)
            {
                evaluation.specular(j, j as u32, s, &vec![1.0; w], 1);
            }
        }
    }
    ExtendedFormFactors { values: evaluation.eff, visibility_calls: evaluation.calls }
}

struct Evaluation<'a> {
    system: &'a System<'a>,
    set: &'a SpecularSet,
    cones: Vec<Cones>,
    lg_max: u32,
    eff_min: f64,
    eff: Vec<f64>,
    calls: u64,
}

/// A lobe of a specular point: where light comes in, where it goes out, and by which factor.
struct Lobe<'a> {
    from: &'a Directions,
    to: &'a Directions,
    out: usize,
    nodes: Option<&'a Nodes>,
    table: &'a LobeTable,
    gain: f32,
}

impl Evaluation<'_> {
    /// GlobSpecOp(j, l, s, ΔEFF, lg): light of j came to s from l and goes on to all k in the cone.
    fn specular(&mut self, j: usize, l: u32, s: usize, carried: &[f64], lg: u32) {
        let point = &self.set.points[s];
        let (Some(material), Some(from)) =
            (self.set.material(point), point.members.iter().position(|&m| m == l))
        else {
            return;
        };
        self.calls += u64::from(self.cones[s].size[from]);
        let arriving: Vec<f64> = (0..carried.len())
            .map(|c| carried[c] * f64::from(point.q_in[from]) * f64::from(self.set.through(point, from, c)))
            .collect();
        let reflect = reflectance(point, material);
        let mut lobes = vec![Lobe {
            from: &point.reflection,
            to: &point.reflection,
            out: s,
            nodes: point.nodes.as_ref(),
            table: reflect,
            gain: 1.0,
        }];
        if let (Some(twin), Some(table), Some(here)) = (point.twin, &material.transmit, &point.transmission)
            && let Some(there) = &self.set.points[twin as usize].transmission
        {
            let gain = if point.inside { 1.0 } else { material.n2 };
            lobes.push(Lobe { from: here, to: there, out: twin as usize, nodes: None, table, gain });
        }
        for lobe in lobes {
            self.pass_on(j, &lobe, from, &arriving, lg);
        }
    }

    /// The loop of GlobSpecOp over the points in one cone.
    fn pass_on(&mut self, j: usize, lobe: &Lobe, from: usize, arriving: &[f64], lg: u32) {
        let (n, w) = (self.system.points.len(), arriving.len());
        let out = &self.set.points[lobe.out];
        let a = lobe.from.get(from);
        // The (B, cosine) that the lobe is made up of, each with its share.
        let parts = |k: usize| -> Vec<(f32, (f32, f32))> {
            let Some(nodes) = lobe.nodes else { return vec![(1.0, lobe.to.lobe_at(&a, k))] };
            let ends = &nodes.directions;
            let between = |p, q| ends.lobe_at(&ends.get(p), q);
            let towards = nodes.of(k);
            let from = nodes.of(from).into_iter();
            from.flat_map(|(p, u)| towards.iter().map(move |&(q, v)| (u * v, between(p, q)))).collect()
        };
        for (k, &member) in out.members.iter().enumerate().filter(|(_, m)| **m != NO_POINT) {
            let parts = parts(k);
            let spreads = lobe.from.spread.get(from).is_some_and(|h| *h > 0.0);
            if parts.iter().all(|(_, (b, _))| *b == 0.0) && !spreads {
                continue;
            }
            let scale = lobe.from.scale_of(from) * lobe.to.scale_of(k) * lobe.gain * lobe.from.gain;
            let spread =
                |c: usize| if spreads { spread_between(lobe.from, from, k, lobe.table, c) } else { 0.0 };
            let share = |c: usize| {
                let of = |(share, (b, cosine)): &(f32, (f32, f32))| share * b * lobe.table.value(*cosine, c);
                parts.iter().map(of).sum::<f32>()
            };
            let carried: Vec<f64> =
                (0..w).map(|c| arriving[c] * f64::from(scale * share(c) + spread(c))).collect();
            for (c, carried) in carried.iter().enumerate() {
                let reaches = f64::from(out.q_out[k]) * f64::from(self.set.through(out, k, c));
                let rho = f64::from(self.system.response.reflectance[c * n + member as usize]);
                self.eff[(j * n + member as usize) * w + c] += carried * reaches * rho / PI;
            }
            if lg < self.lg_max
                && carried.iter().any(|c| *c > self.eff_min)
                && let Ok(next) = self.set.points.binary_search_by_key(&member, |p| p.point)
            {
                self.specular(j, out.point, next, &carried, lg + 1);
            }
        }
    }
}

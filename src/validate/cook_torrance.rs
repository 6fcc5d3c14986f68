//! The rough specular reflection of section 2.2 against values in high precision.

use super::{Case, Tolerance, expected};
use crate::error::Result;
use crate::material::directional_albedo;
use crate::material::microfacet::{beckmann_d, masking_g, rs_over_f};
use glam::DVec3;
use serde::Deserialize;

const DIGITS: &str = "the paper's section 2.2 in 50 digits";
const INTEGRAL: &str = "adaptive integration of the same over the hemisphere, F = 1";
const RECIPROCITY: &str = "Helmholtz: the same with the directions exchanged";

#[derive(Deserialize)]
struct Points {
    points: Vec<Point>,
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names of the table")]
struct Point {
    theta_i_deg: f64,
    theta_r_deg: f64,
    azimuth_deg: f64,
    m: f64,
    D: f64,
    G: f64,
    Rs_over_F: f64,
}

#[derive(Deserialize)]
struct Albedos {
    values: Vec<Albedo>,
}

#[derive(Deserialize)]
struct Albedo {
    m: f64,
    theta_i_deg: f64,
    albedo: f64,
}

pub fn run() -> Result<Vec<Case>> {
    let points: Points = expected::table(include_str!("data/cook_torrance_points.json"))?;
    let albedos: Albedos = expected::table(include_str!("data/cook_torrance_albedo.json"))?;
    // Where a table has 0 it means less than 1e-300.
    let tolerance = |expected: f64, share: f64| match expected > 1e-290 {
        true => Tolerance::Relative(share),
        false => Tolerance::Absolute(1e-290),
    };
    let mut cases = Vec::new();
    let (mut masking, mut back) = (Vec::new(), Vec::new());
    for p in &points.points {
        let [ti, tr, az] = [p.theta_i_deg, p.theta_r_deg, p.azimuth_deg].map(f64::to_radians);
        let i = DVec3::new(ti.sin(), 0.0, ti.cos());
        let r = DVec3::new(tr.sin() * az.cos(), tr.sin() * az.sin(), tr.cos());
        let h = (i + r).normalize();
        // Rounding of tan²α, relative to m², goes straight into the exponent of D.
        let rounding = 1e-9 + 4e-15 / (p.m * p.m);
        let reflected = rs_over_f(i.z, r.z, h.z, i.dot(h), p.m);
        for (what, expected, found) in
            [("D", p.D, beckmann_d(h.z, p.m)), ("R_s/F, 1/sr", p.Rs_over_F, reflected)]
        {
            let name = format!(
                "{what}, {} to {} at {} degrees, m {}",
                p.theta_i_deg, p.theta_r_deg, p.azimuth_deg, p.m
            );
            let tolerance = tolerance(expected, rounding);
            cases.push(Case { name, source: DIGITS, expected, found, tolerance });
        }
        masking.push((p.G, masking_g(h.z, i.z, r.z, i.dot(h))));
        back.push((reflected, rs_over_f(r.z, i.z, h.z, r.dot(h), p.m)));
    }
    let all = "worst of the pairs of directions above";
    cases.push(Case::worst(format!("G, {all}"), DIGITS, Tolerance::Absolute(1e-10), masking));
    let back = back.into_iter().filter(|(there, _)| *there > 1e-290);
    cases.push(Case::worst(format!("R_s/F, {all}"), RECIPROCITY, Tolerance::Relative(1e-12), back));
    for a in &albedos.values {
        cases.push(Case {
            name: format!("directional albedo, m {}, {} degrees", a.m, a.theta_i_deg),
            source: INTEGRAL,
            expected: a.albedo,
            found: directional_albedo(a.m, a.theta_i_deg.to_radians().cos()),
            tolerance: Tolerance::Relative(1e-8),
        });
    }
    Ok(cases)
}

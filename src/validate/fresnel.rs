//! Fresnel factors of metals and glass against values in high precision.

use super::{Case, Tolerance, expected};
use crate::error::Result;
use crate::material::fresnel::{inside, polarised, unpolarised};
use serde::Deserialize;
use std::collections::BTreeMap;

const DIGITS: &str = "Fresnel's equations in 50 digits (Born and Wolf)";

#[derive(Deserialize)]
struct Table {
    angles_deg: Vec<f64>,
    materials: BTreeMap<String, Vec<Line>>,
    #[serde(rename = "bk7_to_vacuum_589.3nm")]
    from_inside: Inside,
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names of the table")]
struct Line {
    wavelength_nm: f64,
    n: f64,
    #[serde(default)]
    k: f64,
    R_s: Vec<f64>,
    R_p: Vec<f64>,
    R_unpolarised: Vec<f64>,
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names of the table")]
struct Inside {
    n: f64,
    angles_deg: Vec<f64>,
    R_unpolarised: Vec<f64>,
}

pub fn run() -> Result<Vec<Case>> {
    let table: Table = expected::table(include_str!("data/fresnel.json"))?;
    let cosines = |degrees: &[f64]| degrees.iter().map(|d| d.to_radians().cos()).collect::<Vec<f64>>();
    let mut cases = Vec::new();
    for (material, lines) in &table.materials {
        for line in lines {
            let found: Vec<[f64; 3]> = cosines(&table.angles_deg)
                .into_iter()
                .map(|c| {
                    let [s, p] = polarised(c, line.n, line.k);
                    [s, p, unpolarised(c, line.n, line.k)]
                })
                .collect();
            let expected = [("R_s", &line.R_s), ("R_p", &line.R_p), ("unpolarised", &line.R_unpolarised)];
            for (which, (what, values)) in expected.into_iter().enumerate() {
                let name = format!("{material}, {} nm, {what}, worst of 10 angles", line.wavelength_nm);
                let pairs = values.iter().copied().zip(found.iter().map(|f| f[which]));
                cases.push(Case::worst(name, DIGITS, Tolerance::Absolute(1e-12), pairs));
            }
        }
    }
    let glass = &table.from_inside;
    for (i, cosine) in cosines(&glass.angles_deg).into_iter().enumerate() {
        cases.push(Case {
            name: format!("bk7 from inside, 589.3 nm, {} degrees", glass.angles_deg[i]),
            source: DIGITS,
            expected: glass.R_unpolarised[i],
            found: inside(cosine, glass.n),
            tolerance: Tolerance::Absolute(1e-11),
        });
    }
    Ok(cases)
}

//! Random scenes of extreme numbers: an answer or an error, never a crash or what is no radiance.

use super::lit::{all_tracers, light_of, tight};
use luxgraph::error::Error;
use luxgraph::settings::Settings;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::TestRunner;
use std::cell::Cell;

/// A number of any magnitude that a file can hold.
fn magnitude() -> impl Strategy<Value = f64> {
    let exponents =
        select(vec![-320, -160, -45, -40, -20, -9, -6, -3, 0, 0, 0, 0, 3, 6, 9, 12, 17, 18, 40, 300]);
    (exponents, 1.0f64..9.0).prop_map(|(e, x)| x * 10f64.powi(e))
}

fn vector(size: impl Strategy<Value = f64>) -> impl Strategy<Value = [f64; 3]> {
    (size, prop::array::uniform3(select(vec![-1.0, -0.5, 0.0, 0.0, 0.25, 1.0 / 3.0, 1.0])))
        .prop_map(|(s, v)| v.map(|x| s * x))
}

/// A parallelogram, most often about as large as the scene.
fn quad(size: f64) -> impl Strategy<Value = String> {
    let near = prop_oneof![6 => Just(size), 1 => magnitude()];
    let edges = prop_oneof![6 => Just(size), 1 => Just(1e-4 * size), 1 => Just(1e-7 * size)];
    (vector(near), vector(Just(size)), vector(edges), any::<bool>()).prop_map(|(o, u, v, warped)| {
        let add = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let bend = if warped { [0.0, 0.0, 1e-3 * u[0]] } else { [0.0; 3] };
        format!("{:?}", [o, add(o, u), add(add(o, add(u, v)), bend), add(o, v)])
    })
}

fn material() -> impl Strategy<Value = String> {
    let share = || select(vec![0.0, 1e-310, 1e-40, 0.5, 0.999, 1.0]);
    let opaque = (share(), share(), select(vec![0.0, 1e-9, 0.1, 2.0]), magnitude(), magnitude()).prop_map(
        |(rho, s, m, n, k)| {
            format!("reflectance = {rho:?}\nspecular = {s:?}\nroughness = {m:?}\nfresnel = {{ n = {n:?}, k = {k:?} }}\n")
        },
    );
    let pane = (magnitude(), share()).prop_map(|(n, t)| {
        format!("pane = {{ index = {n:?}, thickness_m = 0.01, transmittance = {t:?} }}\n")
    });
    let solid = (magnitude(), magnitude())
        .prop_map(|(n, a)| format!("solid = {{ index = {n:?}, absorption_per_m = {a:?} }}\n"));
    let common =
        (share(), any::<bool>()).prop_map(|(rho, two)| format!("reflectance = {rho:?}\ntwo_sided = {two}\n"));
    let glow = prop_oneof![
        2 => Just(String::new()),
        2 => magnitude().prop_map(|l| format!("emission = {{ spectrum = 1.0, radiance = {l:?} }}\n")),
        1 => magnitude().prop_map(|l| format!("emission = {{ illuminant = \"A\", luminous_flux = {l:?} }}\n")),
    ];
    (prop_oneof![4 => common, 2 => opaque, 1 => pane, 1 => solid], glow).prop_map(|(body, glow)| body + &glow)
}

fn scene() -> impl Strategy<Value = String> {
    magnitude().prop_flat_map(|size| {
        let objects = prop::collection::vec((quad(size), material()), 1..7);
        let eye = (vector(Just(size)), vector(Just(size)));
        let solid_angle = select(vec!["", "refine_solid_angle = 0.3\n", "max_solid_angle = 0.5\n"]);
        (objects, eye, solid_angle).prop_map(move |(objects, (eye, target), solid_angle)| {
            let mut text = format!("format = 1\n[sampling]\nmax_level = 2\n{solid_angle}");
            for (i, (quad, material)) in objects.into_iter().enumerate() {
                text += &format!("[materials.m{i}]\n{material}[[objects]]\nname = \"o{i}\"\nmaterial = \"m{i}\"\nquads = [{quad}]\n");
            }
            text + &format!("[[cameras]]\nname = \"c\"\nposition = {eye:?}\ntarget = {target:?}\nup = [0.1, 0.7, 1.0]\nresolution = [5, 4]\n")
        })
    })
}

#[test]
fn an_answer_or_an_error() {
    let config = ProptestConfig { cases: 2000, failure_persistence: None, ..Default::default() };
    let answers = Cell::new(0);
    TestRunner::new(config)
        .run(&scene(), |toml| {
            for (k, tracer) in all_tracers().into_iter().enumerate() {
                match light_of(&toml, &Settings { tracer, ..tight() }) {
                    Ok(_) => answers.set(answers.get() + u32::from(k == 0)),
                    Err(Error::Scene { .. } | Error::Settings(_) | Error::Numerical(_)) => {}
                    Err(other) => prop_assert!(false, "{other} in\n{toml}"),
                }
            }
            Ok(())
        })
        .unwrap_or_else(|e| panic!("{e}"));
    println!("{} answers from 2000 scenes", answers.get());
    assert!(answers.get() > 100, "the scenes must not all be refused");
}

//! Fresnel factors, glass and mirrors at their limits.

use super::lit::{all_tracers, light};
use super::model::{Model, block};
use super::table::Table;
use glam::{DVec2, DVec3};
use luxgraph::material::fresnel::{inside, polarised, unpolarised};

fn times(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// Power reflectances from the amplitudes, in complex numbers: cos θ against sqrt(N² - sin² θ).
fn by_amplitudes(cos: f64, n: f64, k: f64) -> [f64; 2] {
    let squared = times(DVec2::new(n, k), DVec2::new(n, k));
    let under = squared - DVec2::new(1.0 - cos * cos, 0.0);
    let (modulus, angle) = (under.length(), under.y.atan2(under.x));
    let root = modulus.sqrt() * DVec2::from_angle(0.5 * angle);
    let power = |a: DVec2, b: DVec2| (a - b).length_squared() / (a + b).length_squared();
    let c = DVec2::new(cos, 0.0);
    [power(c, root), power(times(squared, c), root)]
}

#[test]
fn metals_with_k_up_to_ten_and_n_below_one() {
    let mut table =
        Table::new("F against complex amplitudes: largest difference over 0 to 90 degrees, s and p");
    for n in [0.02, 0.05, 0.27, 0.5, 0.9, 1.0, 1.5, 4.0, 10.0] {
        for k in [0.0, 1e-6, 0.1, 1.0, 2.95, 6.0, 10.0] {
            if (n, k) == (1.0, 0.0) {
                continue;
            }
            // At 90 degrees both formulae are 0/0 or 1: the limit is 1.
            let worst = (0..900).map(|i| {
                let cos = (f64::from(i) / 10.0).to_radians().cos();
                let (found, expected) = (polarised(cos, n, k), by_amplitudes(cos, n, k));
                (found[0] - expected[0]).abs().max((found[1] - expected[1]).abs())
            });
            table.absolute(&format!("n {n}, k {k}"), 0.0, worst.fold(0.0, f64::max), 1e-11);
            table.absolute(&format!("n {n}, k {k}, 90 degrees"), 1.0, unpolarised(0.0, n, k), 1e-12);
        }
    }
    table.judge();
}

#[test]
fn total_reflection_begins_at_the_critical_angle() {
    let mut table = Table::new("F inside glass around the critical angle");
    for n in [1.0001, 1.33, 1.5, 2.4, 10.0] {
        let critical = f64::sqrt(1.0 - 1.0 / (n * n));
        table.absolute(&format!("n {n}, at it"), 1.0, inside(critical, n), 2e-7 * n * n);
        table.absolute(&format!("n {n}, 1e-12 beyond"), 1.0, inside(critical * (1.0 - 1e-12), n), 0.0);
        // F = 1 - c sqrt(cos - cos_critical) just before it: a hundredth of the way, a tenth of the loss.
        let loss = |d: f64| 1.0 - inside(critical * (1.0 + d), n);
        table.relative(
            &format!("n {n}, loss 1e-10 before / 1e-8 before"),
            0.1,
            loss(1e-10) / loss(1e-8),
            5e-2,
        );
    }
    table.judge();
}

#[test]
fn mirrors_and_clear_glass_leave_a_furnace_alone() {
    let mut table =
        Table::new("furnace, rho 0.5, with what absorbs nothing: B = 2 E on the walls, mean and worst");
    let thing = |name: &str, rest: &str| format!("[materials.{name}]\n{rest}\n");
    let cube = block(DVec3::splat(-0.2), DVec3::splat(0.2));
    let sheet =
        vec![[[-0.3, -0.3, 0.1], [0.3, -0.3, 0.1], [0.3, 0.3, 0.1], [-0.3, 0.3, 0.1]].map(DVec3::from)];
    let cases = [
        ("a wall is a mirror", thing("wall2", "fresnel = { normal = 1.0 }\nspecular = 1.0"), vec![]),
        (
            "a wall is rough metal, m 0.3",
            thing("wall2", "fresnel = { normal = 1.0 }\nspecular = 1.0\nroughness = 0.3"),
            vec![],
        ),
        ("a mirror cube", thing("thing", "fresnel = { normal = 1.0 }\nspecular = 1.0"), cube.clone()),
        ("glass cube, n 1.0001", thing("thing", "solid = { index = 1.0001 }"), cube.clone()),
        ("glass cube, n 1.33", thing("thing", "solid = { index = 1.33 }"), cube.clone()),
        ("glass cube, n 1.5", thing("thing", "solid = { index = 1.5 }"), cube.clone()),
        ("glass cube, n 2.4", thing("thing", "solid = { index = 2.4 }"), cube.clone()),
        ("glass cube, n 4", thing("thing", "solid = { index = 4.0 }"), cube.clone()),
        ("glass cube, n 10", thing("thing", "solid = { index = 10.0 }"), cube.clone()),
        ("pane, n 1.5", thing("thing", "pane = { index = 1.5, thickness_m = 0.004 }"), sheet.clone()),
        ("pane, n 10", thing("thing", "pane = { index = 10, thickness_m = 0.004 }"), sheet),
    ];
    for tracer in all_tracers() {
        for (name, material, quads) in &cases {
            let mut model = Model::furnace(0.5, 1.0);
            model.materials += material;
            if quads.is_empty() {
                model.quads[0].0 = "wall2";
            }
            model.quads.extend(quads.iter().map(|q| ("thing", *q)));
            let lit = light(&model, tracer).unwrap_or_else(|e| panic!("{name}: {e}"));
            let wall = lit.appearance.materials.iter().position(|m| m.emission[0] > 0.0).expect("walls glow");
            let expected = 2.0 * lit.emission(wall);
            let first = usize::from(quads.is_empty());
            let found = lit.on(|s| (first..6).contains(&s.index()));
            let mean = found.iter().sum::<f64>() / found.len() as f64;
            // Solids are balanced as a whole: what is left is what any block leaves.
            let (bound, worst) = if name.starts_with("glass") { (1e-3, 2e-2) } else { (1e-2, 5e-2) };
            table.relative(&format!("{name}, {tracer:?}, mean"), expected, mean, bound);
            table.all(&format!("{name}, {tracer:?}, worst"), expected, found, worst);
        }
    }
    table.judge();
}

#[test]
fn hard_metals_and_dark_glass_neither_make_nor_lose_light() {
    let mut table =
        Table::new("closed room with a wall of metal or a cube of glass: emitted less absorbed, of emitted");
    for (n, k) in
        [(0.02, 10.0), (0.05, 3.0), (0.27, 2.95), (0.5, 0.0), (1.0, 0.0), (10.0, 10.0), (0.01, 1e-6)]
    {
        for m in [0.0, 0.05, 0.5, 2.0] {
            let mut model = Model::furnace(0.5, 1.0);
            model.quads[0].0 = "metal";
            model.materials += &format!(
                "[materials.metal]\nreflectance = 0.3\nfresnel = {{ n = {n:?}, k = {k:?} }}\n\
                 specular = 0.7\nroughness = {m:?}\n"
            );
            let lit = light(&model, luxgraph::tracers::TracerChoice::Auto).expect("a room of metal");
            table.absolute(&format!("metal n {n}, k {k}, m {m}"), 0.0, lit.stats.flux.error[0], 1e-2);
        }
    }
    for (n, absorption) in [(1.5, 1e-6), (1.5, 10.0), (1.5, 1e6), (2.4, 1e300), (1.0, 1.0)] {
        let mut model = Model::furnace(0.5, 1.0);
        model.quads.extend(block(DVec3::splat(-0.2), DVec3::splat(0.2)).into_iter().map(|q| ("glass", q)));
        model.materials +=
            &format!("[materials.glass]\nsolid = {{ index = {n:?}, absorption_per_m = {absorption:?} }}\n");
        let lit = light(&model, luxgraph::tracers::TracerChoice::Auto).expect("a room with glass");
        let case = format!("glass n {n}, {absorption:e} per m");
        table.absolute(&case, 0.0, lit.stats.flux.error[0], 2e-2);
    }
    let mut model = Model::furnace(0.5, 1.0);
    model.quads.push(("glass", model.quads[0].1));
    model.materials += "[materials.glass]\nsolid = { index = 0.5 }\n";
    table.refused("solid of index 0.5", light(&model, luxgraph::tracers::TracerChoice::Auto), "index");
    table.judge();
}

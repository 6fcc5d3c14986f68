//! Does the first pass conserve light in closed and open scenes?

use crate::small_scenes::*;
use glam::DVec3;
use luxgraph::error::Error;
use luxgraph::first_pass::{FirstPassSettings, Kernel, Solver};

fn tight() -> FirstPassSettings {
    let mut settings = FirstPassSettings { tolerance: 1e-5, ..Default::default() };
    settings.chain.tolerance = 1e-6;
    settings
}

#[test]
fn a_closed_cube_glows_with_e_over_one_minus_rho() {
    for rho in [0.5_f32, 0.95, 0.99] {
        let scene = TestScene::new(&cube([0; 6]), vec![diffuse(rho, 1.0)], 1.0 / 64.0);
        let solution = scene.solve(&tight()).unwrap();
        let expected = 1.0 / (1.0 - rho);
        for &l in &solution.radiance {
            assert!((l / expected - 1.0).abs() < 1e-3, "rho {rho}: {l} for {expected}");
        }
        let rows = solution.stats.row_sum;
        assert!(rows.min > 0.9999 && rows.max < 1.0001, "{rows:?}");
        assert!(solution.stats.sweeps < 20.0 && solution.stats.specular_points == 0);
    }
}

#[test]
fn the_papers_kernel_is_refused_where_it_gains_energy() {
    // Spectral radius 1.143 at 4 x 4 elements a face (VALIDATION, section 1).
    let mut settings = FirstPassSettings { kernel: Kernel::Paper, ..Default::default() };
    let scene = TestScene::new(&cube([0; 6]), vec![diffuse(0.95, 1.0)], 1.0 / 16.0);
    for solver in [Solver::Iterative, Solver::Shooting] {
        settings.solver = solver;
        assert!(matches!(scene.solve(&settings), Err(Error::Numerical(_))), "{solver:?}");
    }
    let scene = TestScene::new(&cube([0; 6]), vec![diffuse(0.5, 1.0)], 1.0 / 16.0);
    let solution = scene.solve(&settings).unwrap();
    assert!(solution.radiance.iter().all(|l| *l > 2.0), "over-estimates, as the paper's kernel does");
}

#[test]
fn shooting_agrees_with_the_iterative_solution() {
    let materials = vec![diffuse(0.7, 0.0), diffuse(0.0, 5.0), glossy(0.8, 0.9, 0.2, 0.1, 0.0)];
    let scene = TestScene::new(&cube([0, 2, 0, 0, 0, 1]), materials, 1.0 / 64.0);
    let settings = tight();
    let iterative = scene.solve(&settings).unwrap();
    let shooting = scene.solve(&FirstPassSettings { solver: Solver::Shooting, ..settings }).unwrap();
    for (a, b) in iterative.radiance.iter().zip(&shooting.radiance) {
        assert!((a - b).abs() < 2e-4 * a.max(0.1), "{a} {b}");
    }
}

#[test]
fn a_furnace_of_mixed_walls_is_uniform() {
    // Every wall returns 0.8 of what falls on it, diffusely, by mirror or by gloss; uniform emission
    // on diffuse walls alone is not uniform light, so each wall emits what keeps L at 1.
    let mirror = glossy(1.0, 1.0, 0.0, 0.0, 0.0);
    let gloss = glossy(0.5, 1.0, 0.1, 0.5, 0.0);
    let materials = vec![diffuse(0.8, 0.2), mirror, gloss];
    let scene = TestScene::new(&cube([1, 0, 2, 0, 0, 0]), materials, 1.0 / 64.0);
    let solution = scene.solve(&tight()).unwrap();
    println!("{:?}", solution.stats);
    for s in [1, 3, 4, 5] {
        for i in scene.of_surface(s) {
            let l = solution.of(i)[0];
            assert!((l - 1.0).abs() < 0.02, "surface {s}: {l}");
        }
    }
    // Diffuse part of the glossy wall: half of what it returns.
    for i in scene.of_surface(2) {
        let l = solution.of(i)[0];
        assert!((l - 0.5).abs() < 0.01, "{l}");
    }
}

#[test]
fn light_is_absorbed_or_escapes() {
    let materials = vec![
        diffuse(0.6, 0.0),
        diffuse(0.0, 3.0),
        glossy(0.9, 0.9, 0.3, 0.1, 0.0),
        glossy(0.9, 0.9, 0.05, 0.1, 0.0),
    ];
    let closed = cube([2, 0, 3, 0, 0, 1]);
    let open: Vec<_> = closed.iter().enumerate().filter(|(i, _)| *i != 3).map(|(_, q)| *q).collect();
    for (name, quads) in [("closed", closed), ("open", open)] {
        let scene = TestScene::new(&quads, materials.clone(), 1.0 / 64.0);
        let stats = scene.solve(&tight()).unwrap().stats;
        println!("{name} {stats:?}");
        let escaped = stats.flux.escaped[0] / stats.flux.emitted[0];
        assert!(stats.flux.error[0].abs() < 0.01, "{name}: {:?}", stats.flux);
        assert!(if name == "closed" { escaped.abs() < 0.01 } else { escaped > 0.1 }, "{name}: {escaped}");
        assert!(stats.residual < 2e-5 && stats.cut_off < 1e-5);
    }
}

#[test]
fn no_light_passes_an_opaque_wall() {
    let mut quads = cube([0, 0, 0, 0, 0, 1]);
    let v = |x, y| DVec3::new(x, y, 0.5);
    // The emitting ceiling is above the wall, the floor below it.
    quads.push(([v(0., 0.), v(1., 0.), v(1., 1.), v(0., 1.)], 2, true));
    let materials = vec![diffuse(0.5, 0.0), diffuse(0.0, 1.0), glossy(0.9, 1.0, 0.1, 0.1, 0.0)];
    let scene = TestScene::new(&quads, materials, 1.0 / 64.0);
    let solution = scene.solve(&tight()).unwrap();
    assert!(scene.of_surface(4).iter().all(|&i| solution.of(i)[0] == 0.0));
    let lit = (0..scene.points.len()).filter(|&i| solution.of(i)[0] > 0.0).count();
    assert!(lit > scene.points.len() / 4);
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let materials = vec![diffuse(0.6, 0.0), diffuse(0.0, 3.0), glossy(0.9, 0.9, 0.1, 0.1, 0.0)];
    let scene = TestScene::new(&cube([2, 2, 0, 0, 0, 1]), materials, 1.0 / 64.0);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| scene.solve(&FirstPassSettings::default()).unwrap().radiance)
    };
    assert_eq!(with(1), with(5));
}

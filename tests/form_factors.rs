//! Are the form factors right, and do they add up?

mod first_pass_support;

use first_pass_support::*;
use luxgraph::first_pass::{FirstPassSettings, Kernel};

#[test]
fn a_closed_cube_glows_with_e_over_one_minus_rho_at_any_refinement() {
    for n in [1, 2, 4, 8, 16] {
        let area = 1.0 / f64::from(n * n);
        for rho in [0.95_f32, 0.99] {
            let scene = TestScene::new(&cube([0; 6]), vec![diffuse(rho, 1.0)], area);
            let solution = scene.solve(&FirstPassSettings::default()).unwrap();
            let expected = f64::from(1.0 / (1.0 - rho));
            let worst =
                solution.radiance.iter().map(|&l| (f64::from(l) / expected - 1.0).abs()).fold(0.0, f64::max);
            println!("{n} x {n}, rho {rho}: worst {worst:.2e}, {:?}", solution.stats.row_sum);
            assert!(worst < 1e-3, "{n} x {n}, rho {rho}: {worst}");
        }
    }
}

#[test]
fn lamps_in_a_bright_cube() {
    for n in [4, 8, 16] {
        for kernel in [Kernel::Analytic] {
            let scene = TestScene::new(&cube([0, 0, 0, 0, 0, 1]), vec![diffuse(0.99, 0.0), diffuse(0.99, 1.0)], 1.0 / f64::from(n * n));
            let at = |tolerance| scene.solve(&FirstPassSettings { kernel, tolerance, ..Default::default() }).unwrap();
            let best = at(1e-6);
            for t in [1e-3, 1e-4] {
                let s = at(t);
                let worst = s.radiance.iter().zip(&best.radiance).map(|(a, b)| (f64::from(*a) / f64::from(*b) - 1.0).abs()).fold(0.0, f64::max);
                println!("{n} {t}: {worst:.2e} sweeps {} residual {:.1e} flux error {:?}", s.stats.sweeps, s.stats.residual, s.stats.flux.error);
            }
        }
    }
}

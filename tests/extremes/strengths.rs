//! Dim, bright and much reflected light.

use super::lit::{all_tracers, light, light_of, tight};
use super::model::{Model, glowing, walls};
use super::table::Table;
use glam::DVec3;
use luxgraph::settings::Settings;
use luxgraph::tracers::TracerChoice;

#[test]
fn a_furnace_of_any_reflectance() {
    let mut table = Table::new("furnace, B = E / (1 - rho): mean, worst point, worst pixel");
    for rho in [0.0, 1e-310, 1e-30, 0.5, 0.9, 0.99, 0.999] {
        let lit =
            light(&Model::furnace(rho, 1.0), TracerChoice::Auto).unwrap_or_else(|e| panic!("{rho}: {e}"));
        let expected = lit.emission(0) / (1.0 - rho);
        // An error of the row sums counts rho / (1 - rho) times.
        let bound = 1e-6 + 5e-5 / (1.0 - rho);
        table.relative(&format!("rho {rho:e}, mean"), expected, lit.mean(), bound);
        table.all(&format!("rho {rho:e}, points"), expected, lit.all(), bound);
        table.all(&format!("rho {rho:e}, pixels"), expected, lit.pixels(), bound);
    }
    let open = Model::furnace(1.0, 1.0);
    table.refused("rho 1", light(&open, TracerChoice::Auto), "must absorb");
    table.judge();
}

#[test]
fn a_furnace_of_any_strength() {
    let mut table = Table::new("furnace, rho 0.5, B = 2 E: worst point and pixel");
    for emission in [1e-42, 1e-40, 1e-38, 1e-30, 1e-12, 1e12, 1e15] {
        let lit = light(&Model::furnace(0.5, emission), TracerChoice::Auto)
            .unwrap_or_else(|e| panic!("{emission:e}: {e}"));
        // Below the normal numbers what is left of f32 is steps of 1.4e-45.
        let bound = 2e-4 + 2.0 * 1.4e-45 / emission;
        let expected = 2.0 * lit.emission(0);
        table.all(&format!("E {emission:e}, points"), expected, lit.all(), bound);
        table.all(&format!("E {emission:e}, pixels"), expected, lit.pixels(), bound);
    }
    for emission in [1e-46, 1e-100, 1e-310] {
        let lit = light(&Model::furnace(0.5, emission), TracerChoice::Auto)
            .unwrap_or_else(|e| panic!("{emission:e}: {e}"));
        table.absolute(&format!("E {emission:e}, points"), 0.0, lit.mean(), 3e-45);
    }
    for emission in [1e16, 3e38, 1e300] {
        let answer = light(&Model::furnace(0.5, emission), TracerChoice::Auto);
        table.refused(&format!("E {emission:e}"), answer, "amount of light");
    }
    table.judge();
}

/// Two closed rooms side by side that know nothing of one another.
fn two_rooms([rho_a, e_a]: [f64; 2], [rho_b, e_b]: [f64; 2]) -> Model {
    let mut model = Model::furnace(0.5, 1.0);
    model.materials = glowing("wall", rho_a, e_a) + &glowing("other", rho_b, e_b);
    let low = DVec3::new(2.0, -0.75, -0.5);
    model.quads.extend(walls(low, low + DVec3::new(2.0, 1.5, 1.0)).into_iter().map(|q| ("other", q)));
    model.max_area *= 2.0;
    model
}

#[test]
fn a_weak_light_is_right_beside_a_strong_one() {
    let mut table =
        Table::new("two closed rooms, 1e12 between their lights: each room's B / (E / (1 - rho))");
    for tracer in all_tracers() {
        for (rho_a, rho_b) in [(0.5, 0.5), (0.1, 0.9), (0.9, 0.1)] {
            for (e_a, e_b) in [(1.0, 1.0), (1e6, 1e-6), (1e-6, 1e6)] {
                for (name, tolerance, bound) in [("default", 1e-3, 1e-3), ("tight", 1e-5, 1e-4)] {
                    let mut settings = Settings { tracer, ..tight() };
                    settings.first_pass.tolerance = tolerance;
                    let model = two_rooms([rho_a, e_a], [rho_b, e_b]);
                    let lit = light_of(&model.toml(), &settings).expect("two rooms");
                    // Materials by name: other, wall.
                    let in_a: Vec<f64> = lit.on(|s| s.index() < 6);
                    let in_b: Vec<f64> = lit.on(|s| s.index() >= 6);
                    let case = format!("rho {rho_a} {rho_b}, E {e_a:e} {e_b:e}, {name}, {tracer:?}");
                    table.all(&format!("{case}, A"), lit.emission(1) / (1.0 - rho_a), in_a, bound);
                    table.all(&format!("{case}, B"), lit.emission(0) / (1.0 - rho_b), in_b, bound);
                }
            }
        }
    }
    table.judge();
}

#[test]
fn a_wavelength_a_trillion_times_weaker_is_as_right() {
    let mut table = Table::new(
        "furnace, rho 0.2 and 0.9 at the ends of a steep spectrum: worst point of each wavelength",
    );
    let mut model = Model::furnace(0.5, 1.0);
    model.materials =
        "[spectra.steep]\nwavelengths_nm = [400, 500, 600, 700]\nvalues = [1e-12, 1e-8, 1e-4, 1]\n\
        [spectra.rho]\nwavelengths_nm = [400, 700]\nvalues = [0.9, 0.2]\n\
        [materials.wall]\nreflectance = \"rho\"\nemission = { spectrum = \"steep\", radiance = 1 }\n"
            .into();
    let mut settings = tight();
    settings.wavelengths = luxgraph::spectrum::Wavelengths::bands(8).expect("eight bands");
    let lit = light_of(&model.toml(), &settings).expect("a furnace");
    let wall = &lit.appearance.materials[0];
    for k in 0..lit.wavelengths {
        let expected = f64::from(wall.emission[k]) / (1.0 - f64::from(wall.diffuse[k]));
        let values = lit.radiance.iter().skip(k).step_by(lit.wavelengths).map(|&l| f64::from(l));
        table.all(&format!("wavelength {k}, E {:.0e}", wall.emission[k]), expected, values, 5e-4);
    }
    table.judge();
}

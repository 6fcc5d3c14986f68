//! Does light reach sensors over mirrors, gloss and glass, from surfaces and from point lights?

use crate::folder::Folder;
use crate::lit::Lit;
use glam::Vec3;
use luxgraph::first_pass::form_factor::exact;
use luxgraph::measure::{Illuminance, Reading};
use luxgraph::scene::load;
use luxgraph::settings::Settings;

/// Reads the sensors of a scene file with the four default wavelengths.
fn readings(text: &str) -> Vec<Reading> {
    let folder = Folder::new();
    let camera = "[[cameras]]\nname = \"c\"\nposition = [0.1, 0, 1]\ntarget = [1, 1, 0]\n";
    let path = folder.write("s.toml", format!("format = 1\n[sampling]\nmax_area = 0.02\n{text}{camera}"));
    let lit = Lit::new(load(&path).unwrap_or_else(|e| panic!("{e}")), Settings::default());
    lit.readings(&lit.scene.sensors)
}

fn lux(part: &[f64]) -> f64 {
    Illuminance::of(part, &Settings::default().wavelengths).illuminance_lx
}

fn sensor(position: [f64; 3], normal: [f64; 3]) -> String {
    format!("[[sensors]]\nname = \"{position:?}{normal:?}\"\nposition = {position:?}\nnormal = {normal:?}\n")
}

/// A horizontal rectangle that looks up or down.
fn plate(name: &str, half: [f64; 2], z: f64, up: bool) -> String {
    let [a, b] = half;
    let mut quad = [[-a, -b, z], [a, -b, z], [a, b, z], [-a, b, z]];
    if !up {
        quad.reverse();
    }
    format!("[[objects]]\nname = \"{name}\"\nmaterial = \"{name}\"\nquads = [{quad:?}]\n")
}

/// A floor that reflects everything specularly, with roughness `m`, 1 m across.
fn mirror(m: f64) -> String {
    let material =
        format!("[materials.mirror]\nfresnel = {{ normal = 1.0 }}\nspecular = 1\nroughness = {m}\n");
    format!("{material}{}", plate("mirror", [0.5, 0.5], 0.0, true))
}

const POINT: &str = "[[lights]]\nname = \"p\"\nposition = [0, 0, 1.5]\ndistribution = \"lambertian\"\n\
                     direction = [0, 0, -1]\nilluminant = \"E\"\nluminous_intensity = 1000\n";

/// An emitter in the place of [`POINT`], `2 half` across, with the same intensity.
fn panel(half: f64) -> String {
    let material = "[materials.panel]\nemission = { illuminant = \"E\", luminous_intensity = 1000 }\n";
    format!("{material}{}", plate("panel", [half, half], 1.5, false))
}

fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    println!("{what}: {found} for {expected}");
    assert!((found / expected - 1.0).abs() < tolerance, "{what}: {found} for {expected}");
}

#[test]
fn a_sensor_over_a_mirror_sees_the_light_in_it() {
    let above = sensor([0.4, 0.1, 1.2], [0.0, 0.0, -1.0]);
    // The image is 1.5 m under the floor and looks up.
    let (d, a) = (Vec3::new(0.4, 0.1, 2.7), 0.04);
    let corners = [[-a, -a], [a, -a], [a, a], [-a, a]].map(|[x, y]| Vec3::new(x, y, 0.0));
    let factor = exact(d, -Vec3::Z, &corners);
    let area = readings(&format!("{}{}{above}", mirror(0.0), panel(0.04)));
    assert!(lux(&area[0].direct) == 0.0);
    assert_close(lux(&area[0].specular), 1000.0 / 0.0064 * factor, 0.02, "a panel in a mirror");
    let point = readings(&format!("{}{POINT}{above}", mirror(0.0)));
    let (cosine, distance) = (2.7 / f64::from(d.length()), f64::from(d.length()));
    let expected = 1000.0 * cosine * cosine / (distance * distance);
    assert_close(lux(&point[0].specular), expected, 1e-3, "a point light in a mirror");
    // Beside the mirror's window the image is hidden.
    let aside = readings(&format!("{}{POINT}{}", mirror(0.0), sensor([1.4, 0.1, 1.2], [0.0, 0.0, -1.0])));
    assert_eq!(lux(&aside[0].specular), 0.0);
}

#[test]
fn gloss_shows_a_point_light_as_it_shows_a_small_panel() {
    for m in [0.05, 0.3] {
        let sensors =
            sensor([0.4, 0.1, 1.2], [0.0, 0.0, -1.0]) + &sensor([-0.2, 0.6, 0.8], [0.0, -0.6, -0.8]);
        let area = readings(&format!("{}{}{sensors}", mirror(m), panel(0.1)));
        let point = readings(&format!("{}{POINT}{sensors}", mirror(m)));
        for (a, p) in area.iter().zip(&point) {
            assert_close(lux(&p.specular), lux(&a.specular), 0.03, &format!("m = {m}"));
        }
    }
}

/// CIE 171 5.5: what a pane of n = 1.52 lets through at normal incidence.
#[test]
fn light_comes_straight_through_a_pane() {
    let pane =
        format!("[materials.pane]\npane = {{ index = 1.52 }}\n{}", plate("pane", [0.5, 0.5], 1.0, true));
    let below = sensor([0.0, 0.0, 0.5], [0.0, 0.0, 1.0]);
    let point = readings(&format!("{pane}{POINT}{below}"));
    assert!(lux(&point[0].direct) == 0.0);
    assert_close(lux(&point[0].specular), 1000.0 * 0.91832, 5e-3, "a point light through a pane");
    let area = readings(&format!("{pane}{}{below}", panel(0.04)));
    let corners =
        [[-0.04, -0.04], [0.04, -0.04], [0.04, 0.04], [-0.04, 0.04]].map(|[x, y]| Vec3::new(x, y, 1.0));
    let factor = exact(Vec3::ZERO, Vec3::Z, &corners);
    assert_close(lux(&area[0].specular), 1000.0 / 0.0064 * factor * 0.91832, 0.02, "a panel through a pane");
}

/// A ceiling that only a mirror lights: the chains of the first pass begin at a point light as they
/// do at a panel, and bring what the image would.
#[test]
fn a_mirror_throws_a_point_light_onto_the_ceiling() {
    let grey = format!("[materials.grey]\nreflectance = 0.5\n{}", plate("grey", [2.0, 2.0], 3.0, false));
    let under = sensor([0.3, 0.2, 2.95], [0.0, 0.0, 1.0]);
    let point = readings(&format!("{}{POINT}{grey}{under}", mirror(0.0)));
    let panel = readings(&format!("{}{}{grey}{under}", mirror(0.0), panel(0.04)));
    // E of the ceiling from the image at z = -1.5; next to it the sensor gets as much times ρ.
    let d2 = 4.5f64.powi(2) + 0.3f64.powi(2) + 0.2f64.powi(2);
    let expected = 0.5 * 1000.0 * 4.5 * 4.5 / (d2 * d2);
    assert_close(lux(&point[0].diffuse), expected, 0.05, "a point light over a mirror");
    assert_close(lux(&panel[0].diffuse), expected, 0.05, "a panel over a mirror");
}

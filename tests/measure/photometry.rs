//! Do sensors read what closed forms and the published cases of CIE 171:2006 say?

use luxgraph::first_pass::FluxBalance;
use luxgraph::measure::{Illuminance, Reading};
use luxgraph::observer::Silent;
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::{pipeline, scene, tracers};

/// Reads all sensors of a scene file, single ones first, with 16 wavelengths: name and reading of each. And
/// where the light of the first pass went.
fn measured(text: &str) -> (Vec<(String, Reading)>, FluxBalance) {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join("s.toml");
    let camera = "[[cameras]]\nname = \"c\"\nposition = [0.1, 0, 1]\ntarget = [1, 1, 0]\n";
    std::fs::write(&path, format!("format = 1\n{text}{camera}")).expect("written");
    let scene = scene::load(&path).unwrap_or_else(|e| panic!("{e}"));
    let mut settings = Settings { wavelengths: wavelengths(), ..Settings::default() };
    settings.first_pass.tolerance = 1e-5;
    let tracer = tracers::choose(settings.tracer, &scene.geometry).expect("a tracer");
    let (geometry, tracer) = (&scene.geometry, tracer.as_ref());
    let prepared =
        pipeline::prepare(geometry, &scene.sampling, &settings, tracer, None, &Silent).expect("prepared");
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).expect("lit");
    let sensors: Vec<_> =
        scene.sensors.iter().cloned().chain(scene.grids.iter().flat_map(|g| g.sensors())).collect();
    let read = pipeline::measure(geometry, &prepared, &lit, &sensors, tracer, &settings.measure, &Silent);
    let readings = sensors.into_iter().map(|s| s.name).zip(read.expect("measured")).collect();
    (readings, lit.1.stats.flux)
}

fn readings(text: &str) -> Vec<(String, Reading)> {
    measured(text).0
}

fn wavelengths() -> Wavelengths {
    Wavelengths::bands(16).expect("16 bands")
}

fn lux(part: &[f64]) -> f64 {
    Illuminance::of(part, &wavelengths()).illuminance_lx
}

fn sensor(name: &str, position: [f64; 3], normal: [f64; 3]) -> String {
    format!("[[sensors]]\nname = \"{name}\"\nposition = {position:?}\nnormal = {normal:?}\n")
}

/// A room of which every wall is of `material`: x and y from -a to a, z from 0 to h.
fn room(a: f64, h: f64, material: &str) -> String {
    let quads = [
        [[-a, -a, 0.0], [a, -a, 0.0], [a, a, 0.0], [-a, a, 0.0]],
        [[-a, -a, h], [-a, a, h], [a, a, h], [a, -a, h]],
        [[-a, -a, 0.0], [-a, a, 0.0], [-a, a, h], [-a, -a, h]],
        [[a, -a, 0.0], [a, -a, h], [a, a, h], [a, a, 0.0]],
        [[-a, -a, 0.0], [-a, -a, h], [a, -a, h], [a, -a, 0.0]],
        [[-a, a, 0.0], [a, a, 0.0], [a, a, h], [-a, a, h]],
    ];
    format!("[[objects]]\nname = \"room\"\nmaterial = \"{material}\"\nquads = {quads:?}\n")
}

const BLACK: &str = "[materials.black]\nreflectance = 0\n";

fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found / expected - 1.0).abs() < tolerance, "{what}: {found} for {expected}");
}

#[test]
fn small_emitters_follow_the_law_of_distances() {
    let lamp = "[materials.lamp]\nemission = { illuminant = \"D65\", luminous_flux = 100 }\n\
                [[objects]]\nname = \"lamp\"\nmaterial = \"lamp\"\n\
                quads = [[[-0.005, -0.005, 1], [-0.005, 0.005, 1], [0.005, 0.005, 1], [0.005, -0.005, 1]]]\n";
    let below = sensor("below", [0.0; 3], [0.0, 0.0, 1.0]);
    let area = readings(&format!("{lamp}{below}"));
    assert_close(lux(&area[0].1.direct), 31.83, 5e-3, "an area of 100 lm at 1 m");
    let edi = Illuminance::of(&area[0].1.total(), &wavelengths()).melanopic_edi_lx;
    assert_close(edi, 31.83, 5e-3, "its melanopic EDI");
    let point = "[[lights]]\nname = \"p\"\nposition = [0, 0, 1]\nilluminant = \"A\"\nluminous_flux = 100\n";
    let floor = room(2.0, 3.0, "black");
    let isotropic = readings(&format!("{BLACK}{point}{floor}{below}"));
    assert_close(lux(&isotropic[0].1.direct), 7.96, 5e-3, "an isotropic point of 100 lm at 1 m");
    let edi = Illuminance::of(&isotropic[0].1.total(), &wavelengths()).melanopic_edi_lx;
    assert_close(edi / lux(&isotropic[0].1.total()), 0.4958, 5e-3, "melanopic EDI of A per lx");
}

#[test]
fn cie_171_5_2_a_lambertian_point() {
    let light = "[[lights]]\nname = \"p\"\nposition = [0, 0, 3]\ndistribution = \"lambertian\"\n\
                 direction = [0, 0, -2]\nilluminant = \"E\"\nluminous_intensity = 1000\n";
    let cases = [
        ([0.0, 0.0], 111.11),
        ([0.5, 0.0], 105.19),
        ([1.0, 0.0], 90.00),
        ([1.5, 0.0], 71.11),
        ([0.5, 0.5], 99.72),
        ([1.0, 0.5], 85.66),
        ([1.5, 0.5], 68.05),
        ([1.0, 1.0], 74.38),
        ([1.5, 1.0], 59.98),
        ([1.5, 1.5], 49.38),
    ];
    let sensors: String = cases
        .iter()
        .enumerate()
        .map(|(i, ([x, y], _))| sensor(&i.to_string(), [*x, *y, 0.0], [0.0, 0.0, 1.0]))
        .collect();
    let found = readings(&format!("{BLACK}{light}{}{sensors}", room(2.0, 3.0, "black")));
    for ((place, expected), (_, reading)) in cases.into_iter().zip(found) {
        assert_close(lux(&reading.total()), expected, 5e-3, &format!("{place:?}"));
    }
}

#[test]
fn cie_171_5_3_an_area_of_a_square_metre() {
    let lamp = "[materials.lamp]\nemission = { illuminant = \"E\", luminous_intensity = 1000 }\n\
                [[objects]]\nname = \"lamp\"\nmaterial = \"lamp\"\n\
                quads = [[[-0.5, -0.5, 2.9999], [-0.5, 0.5, 2.9999], [0.5, 0.5, 2.9999], [0.5, -0.5, 2.9999]]]\n";
    let wall = [32.68, 75.19, 81.32, 69.06, 53.40, 40.00];
    let floor = [61.42, 79.26, 95.67, 105.78];
    let on_wall = |i: usize| sensor(&format!("w{i}"), [2.0, 0.0, 2.75 - 0.5 * i as f64], [-1.0, 0.0, 0.0]);
    let on_floor =
        |i: usize| sensor(&format!("f{i}"), [0.0, 0.25 + 0.5 * i as f64 - 2.0, 0.0], [0.0, 0.0, 1.0]);
    let sensors: String = (0..6).map(on_wall).chain((0..4).map(on_floor)).collect();
    let found = readings(&format!("{BLACK}{lamp}{}{sensors}", room(2.0, 3.0, "black")));
    for (expected, (name, reading)) in wall.into_iter().chain(floor).zip(found) {
        assert_close(lux(&reading.total()), expected, 5e-3, &name);
    }
}

/// The light that falls on all walls is what the lamp gives (CIE 171 5.4): by sensors in fine grids,
/// and, since every element takes exactly the flux it subtends, by the first pass as well.
#[test]
fn cie_171_5_4_all_flux_arrives() {
    let light =
        "[[lights]]\nname = \"p\"\nposition = [0.3, -0.2, 1.7]\nilluminant = \"E\"\nluminous_flux = 10000\n";
    let (n, h) = (24, 3.0);
    let mut grids = String::new();
    for (axis, at) in [(0, -2.0), (0, 2.0), (1, -2.0), (1, 2.0), (2, 0.0), (2, h)] {
        let (mut origin, mut u, mut v, mut normal) = ([-2.0, -2.0, 0.0], [0.0; 3], [0.0; 3], [0.0; 3]);
        let side = |a: usize| if a == 2 { h } else { 4.0 };
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        (origin[axis], u[a], v[b]) = (at, side(a), side(b));
        normal[axis] = if at > 0.5 { -1.0 } else { 1.0 };
        grids.push_str(&format!(
            "[[grids]]\nname = \"{axis} {at}\"\norigin = {origin:?}\nu = {u:?}\nv = {v:?}\nnormal = {normal:?}\ncounts = [{n}, {n}]\n"
        ));
    }
    let (found, balance) = measured(&format!("{BLACK}{light}{}{grids}", room(2.0, h, "black")));
    let area = |name: &str| if name.starts_with('2') { 16.0 } else { 12.0 } / f64::from(n * n);
    let flux: f64 = found.iter().map(|(name, r)| lux(&r.total()) * area(name)).sum();
    assert_close(flux, 10000.0, 5e-3, "flux on all walls");
    for (absorbed, emitted) in balance.absorbed.iter().zip(&balance.emitted) {
        assert_close(*absorbed, *emitted, 1e-5, "flux on all elements");
    }
}

/// CIE 171 5.8: the mean indirect illuminance of a closed cube follows from its energy.
#[test]
fn cie_171_5_8_light_between_the_walls_of_a_cube() {
    let light = "[[lights]]\nname = \"p\"\nposition = [0, 0, 2]\nilluminant = \"E\"\nluminous_flux = 10000\n";
    let grid = "[[grids]]\nname = \"floor\"\norigin = [-2, -2, 0]\nu = [4, 0, 0]\nv = [0, 4, 0]\ncounts = [16, 16]\n";
    for (reflectance, expected) in [(0.5, 104.17), (0.9, 937.5)] {
        let grey = format!("[sampling]\nmax_area = 0.07\n[materials.grey]\nreflectance = {reflectance}\n");
        let found = readings(&format!("{grey}{light}{}{grid}", room(2.0, 4.0, "grey")));
        let mean = found.iter().map(|(_, r)| lux(&r.indirect())).sum::<f64>() / found.len() as f64;
        assert_close(mean, expected, 5e-3, &format!("reflectance {reflectance}"));
    }
}

/// A sensor on a surface reads the same whichever way its place was rounded, and nothing from behind.
#[test]
fn a_sensor_on_a_surface_looks_from_its_front() {
    let light = "[[lights]]\nname = \"p\"\nposition = [0, 0, 3]\nilluminant = \"E\"\nluminous_flux = 1000\n";
    let places = [0.0, 1e-4, -1e-4, -0.01];
    let sensors: String =
        places.iter().map(|z| sensor(&z.to_string(), [0.7, 0.1, *z], [0.0, 0.0, 1.0])).collect();
    let grey = "[sampling]\nmax_area = 0.2\n[materials.grey]\nreflectance = 0.5\n";
    let found = readings(&format!("{grey}{light}{}{sensors}", room(2.0, 3.0, "grey")));
    let lux: Vec<f64> = found.iter().map(|(_, reading)| lux(&reading.total())).collect();
    assert!(lux[0] > 5.0);
    assert_close(lux[1], lux[0], 1e-6, "just above");
    assert_close(lux[2], lux[0], 1e-6, "just below");
    assert_eq!(lux[3], 0.0, "under the floor");
}

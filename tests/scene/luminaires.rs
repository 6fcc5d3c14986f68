//! Do IES luminaires, spots and directional lights shine as their tables and formulas say?

use crate::folder::Folder;
use crate::lit::Lit;
use glam::DVec3;
use luxgraph::error::Error;
use luxgraph::measure::Illuminance;
use luxgraph::scene::{Light, LightLevel, Scene, SceneDescription, Sensor, load};
use luxgraph::settings::Settings;

/// A grey floor around the origin, z = 0.
const FLOOR: &str = "format = 1
[sampling]
max_area = 0.02
[materials.grey]
reflectance = 0.4
[[objects]]
name = \"floor\"
material = \"grey\"
quads = [[[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]]
[[cameras]]
name = \"c\"
position = [0, -1, 2]
target = [0, 0, 0]
";

const LUMINAIRE: &str = "[[lights]]
name = \"l\"
position = [0, 0, 2]
ies = \"l.ies\"
illuminant = \"E\"
";

/// Five vertical angles and three planes, wrapped, with commas, tabs and carriage returns.
const FILE: &str = "IESNA:LM-63-1995\r\n[TEST] made for a test, caf\u{e9}\r\nTILT=NONE\r\n\
2 500, 0.5\t5\r\n3 1 2 0.2 .6 0\r\n1.1 0.9 , 40\r\n0,22.5 45\r\n67.5 90\r\n\
0 90\r\n180\r\n1000 900 600\r\n300 0 1000 800 500 200,100 1000 700 400 100 50\r\n";

/// Candela of [`FILE`]: multiplier and both ballast factors of 1995 are in it.
const FACTOR: f64 = 0.5 * 1.1 * 0.9;

/// Labels are often in Latin-1.
fn write_luminaire(folder: &Folder, ies: &str) {
    folder.write("l.ies", ies.chars().map(|c| c as u8).collect::<Vec<u8>>());
}

/// The scene with this luminaire in a folder.
fn scene(folder: &Folder, more: &str, ies: &str) -> Result<Scene, Error> {
    write_luminaire(folder, ies);
    load(&folder.write("s.toml", format!("{FLOOR}{more}")))
}

fn compiled(more: &str, ies: &str) -> Scene {
    scene(&Folder::new(), more, ies).unwrap_or_else(|e| panic!("{e}"))
}

/// Illuminance at places on the floor, by sensors; the mean over elements nearby, by the first pass; and the share of the
/// flux that the account of the first pass misses.
fn lit(scene: Scene, places: &[[f64; 2]]) -> (Vec<f64>, Vec<f64>, f64) {
    let lit = Lit::new(scene, Settings::default());
    let sensor =
        |[x, y]: &[f64; 2]| Sensor { name: "s".into(), position: DVec3::new(*x, *y, 0.0), normal: DVec3::Z };
    let sensors: Vec<_> = places.iter().map(sensor).collect();
    let wavelengths = &lit.solution().wavelengths;
    let lux = |e: &[f64]| Illuminance::of(e, wavelengths).illuminance_lx;
    let sensors = lit.readings(&sensors).iter().map(|r| lux(&r.total())).collect();
    let points = &lit.prepared.points;
    let nearest = |[x, y]: &[f64; 2]| {
        let to = DVec3::new(*x, *y, 0.0) - lit.scene.geometry.centre;
        let far = |i: &usize| points.position[*i].as_dvec3().distance(to);
        let nearest = (0..points.len()).min_by(|a, b| far(a).total_cmp(&far(b))).expect("points");
        wavelengths.xyz(lit.solution().of(nearest))[1] * std::f64::consts::PI / 0.4
    };
    (sensors, places.iter().map(nearest).collect(), lit.flux_error())
}

fn close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (found - expected).abs() <= tolerance * expected.abs().max(1e-3),
        "{what}: {found} for {expected}"
    );
}

/// E = I(γ, C) cos θ / r², by the table, under a luminaire that hangs and under one that leans.
#[test]
fn illuminance_is_what_the_table_says() {
    let rows = [
        [1000.0, 900.0, 600.0, 300.0, 0.0],
        [1000.0, 800.0, 500.0, 200.0, 100.0],
        [1000.0, 700.0, 400.0, 100.0, 50.0],
    ];
    let table = |gamma: f64, c: f64| {
        let c = if c > 180.0 { 360.0 - c } else { c };
        let (i, k) = (((gamma / 22.5) as usize).min(3), ((c / 90.0) as usize).min(1));
        let (f, g) = (gamma / 22.5 - i as f64, c / 90.0 - k as f64);
        let row = |k: usize| rows[k][i] + f * (rows[k][i + 1] - rows[k][i]);
        FACTOR * (row(k) + g * (row(k + 1) - row(k)))
    };
    // The middles of elements.
    let places =
        [[0.0625, 0.0625], [0.6875, 0.0625], [0.0625, 0.9375], [-0.5625, -0.4375], [1.1875, -1.0625]];
    let leaning = [(DVec3::NEG_Z, DVec3::X), (DVec3::new(0.6, 0.0, -0.8), DVec3::Y)];
    for (down, c0) in leaning {
        let turned = format!("direction = {:?}\nc0 = {:?}\n", down.to_array(), c0.to_array());
        let (sensors, points, error) = lit(compiled(&format!("{LUMINAIRE}{turned}"), FILE), &places);
        assert!(error < 2e-3, "{error}");
        for (([x, y], sensor), point) in places.iter().zip(sensors).zip(points) {
            let way = DVec3::new(*x, *y, -2.0);
            let d = way.normalize();
            let gamma = d.angle_between(down).to_degrees();
            let (ahead, left) = (d.dot(c0), d.dot((-down).cross(c0)));
            let c = left.atan2(ahead).to_degrees().rem_euclid(360.0);
            let intensity = if gamma <= 90.0 { table(gamma, c) } else { 0.0 };
            let expected = intensity * -d.z / way.length_squared();
            close(sensor, expected, 1e-3, &format!("a sensor at {x} {y}"));
            close(point, expected, 0.03, &format!("a sample point near {x} {y}"));
        }
    }
}

#[test]
fn amounts_come_from_the_file_unless_given() {
    let level = |more: &str, ies: &str| {
        let scene = compiled(&format!("{LUMINAIRE}{more}"), ies);
        scene.appearance.lights[0].level
    };
    let intensity = |more: &str, ies: &str| match level(more, ies) {
        LightLevel::LuminousIntensity(cd) => cd,
        other => panic!("{other:?}"),
    };
    close(intensity("", FILE), 1000.0 * FACTOR, 1e-12, "by the file");
    close(intensity("scale = 0.25\n", FILE), 250.0 * FACTOR, 1e-12, "dimmed");
    assert_eq!(level("luminous_flux = 70\n", FILE), LightLevel::LuminousFlux(70.0));
    // What was a ballast-lamp factor until 1995 is reserved from 2002 on.
    let later = FILE.replace("LM-63-1995", "LM-63-2002");
    close(intensity("", &later), 1000.0 * 0.5 * 1.1, 1e-12, "by a file of 2002");
    // Turned to the side it gives what its tilt table says.
    let tilting = FILE.replace("TILT=NONE", "TILT=INCLUDE\r\n1 3\r\n0 60 90\r\n1 .7, .5");
    close(intensity("direction = [0, 1, 0]\n", &tilting), 500.0 * FACTOR, 1e-9, "on its side");
    close(intensity("", &tilting), 1000.0 * FACTOR, 1e-9, "hanging");
}

#[test]
fn a_luminaire_is_spread_over_its_opening() {
    let scene = compiled(&format!("{LUMINAIRE}spread = [3, 2]\n"), FILE);
    let lights: &[Light] = &scene.geometry.lights;
    assert_eq!(lights.len(), 6);
    let total: f64 =
        scene.appearance.lights.iter().zip(lights).map(|(s, l)| s.factor(l) * l.flux_share()).sum();
    let whole = compiled(LUMINAIRE, FILE);
    let one = whole.appearance.lights[0].factor(&whole.geometry.lights[0]) * lights[0].flux_share();
    close(total, one, 1e-9, "flux");
    // 0.6 m along C = 0, 0.2 m across.
    let first = lights[0].place() - whole.geometry.lights[0].place();
    assert!(first.distance(DVec3::new(-0.2, -0.05, 0.0)) < 1e-9, "{first}");
    // Changes scale all points together.
    let folder = Folder::new();
    write_luminaire(&folder, FILE);
    let path = folder.write("s.toml", format!("{FLOOR}{LUMINAIRE}spread = [3, 2]\n"));
    let changes = folder.write("c.toml", "format = 1\n[lights.l]\nluminous_flux = 12\n");
    let changed = SceneDescription::read(&path).and_then(|d| d.changed(&changes)).expect("reads");
    let appearance = changed.appearance(&scene.geometry).expect("fits");
    assert!(appearance.lights.iter().all(|l| l.level == LightLevel::LuminousFlux(2.0)));
}

#[test]
fn mistakes_in_a_file_are_named_where_they_are() {
    let place = |ies: &str, more: &str| match scene(&Folder::new(), &format!("{LUMINAIRE}{more}"), ies) {
        Err(Error::Scene { line, column, message, path }) => {
            (path.extension().map(|e| e == "ies"), line, column, message)
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("no error: {ies} {more}"),
    };
    let cases = [
        ("no luminaire at all\n".to_owned(), (1, 1), "`TILT=`"),
        (FILE.replace("TILT=NONE", "TILT="), (3, 6), "NONE, INCLUDE"),
        (FILE.replace("TILT=NONE", "TILT=lost.tlt"), (3, 6), "cannot read"),
        (FILE.replace("600", "6oo"), (11, 10), "\"6oo\" is no number"),
        (FILE.replace("600", "-600"), (11, 10), "a candela value lies between"),
        (FILE.replace(" 50\r\n", "\r\n"), (13, 1), "the file ends"),
        (FILE.replace("3 1 2", "3 4 2"), (5, 3), "photometric type"),
        (FILE.replace("3 1 2", "3 1 3"), (5, 5), "unit of length"),
        (FILE.replace("3 1 2", "2.5 1 2"), (5, 1), "whole number"),
        (FILE.replace("0,22.5 45", "0,45 22.5"), (7, 1), "increase"),
        (FILE.replace("0 90\r\n180", "0 90\r\n170"), (9, 1), "horizontal angles of type C"),
        (FILE.replace("3 1 2", "3 2 2"), (9, 1), "types A and B"),
    ];
    for (ies, at, part) in cases {
        let (in_file, line, column, message) = place(&ies, "");
        assert!(message.contains(part), "{ies}\n{message}");
        assert_eq!((in_file, line, column), (Some(true), at.0, at.1), "{ies}\n{message}");
    }
    for (more, part) in [
        ("distribution = \"spot\"\n", "no `distribution`"),
        ("up = [1, 0, 0]\n", "give `c0`"),
        ("c0 = [0, 0, 1]\n", "along the light's direction"),
        ("spread = [0, 1]\n", "1 to 64"),
        ("outer_cone_deg = 3\n", "goes with distribution = \"spot\""),
        ("illuminance = 3\n", "directional light"),
        ("luminous_flux = 3\nscale = 2\n", "no other amount"),
    ] {
        let (in_file, _, _, message) = place(FILE, more);
        assert!(in_file == Some(false) && message.contains(part), "{more}\n{message}");
    }
}

/// A file cut short anywhere, or with any of its bytes gone, is read or refused.
#[test]
fn damaged_files_never_do_harm() {
    let folder = Folder::new();
    for cut in (0..FILE.len()).filter(|&cut| FILE.is_char_boundary(cut)) {
        let _ = scene(&folder, LUMINAIRE, &FILE[..cut]);
        let _ = scene(&folder, LUMINAIRE, &FILE[cut..]);
    }
    for word in ["1e308", "-1", "nan", "inf", "1e9", "0"] {
        for (at, _) in FILE.match_indices(|c: char| c.is_ascii_digit()) {
            let _ = scene(&folder, LUMINAIRE, &format!("{}{word} {}", &FILE[..at], &FILE[at + 1..]));
        }
    }
}

#[test]
fn a_spot_falls_off_between_its_cones() {
    let spot = "[[lights]]\nname = \"l\"\nposition = [0, 0, 2]\ndistribution = \"spot\"\ndirection = [0, 0, -3]\n\
                inner_cone_deg = 15\nouter_cone_deg = 35\nilluminant = \"E\"\nluminous_intensity = 1000\n";
    // The middles of elements.
    let places = [[0.0625, 0.0625], [0.4375, 0.0625], [0.0625, 0.8125], [-0.8125, 0.5625], [1.5625, 0.0625]];
    let (sensors, points, error) = lit(compiled(spot, FILE), &places);
    assert!(error < 2e-3, "{error}");
    for (([x, y], sensor), point) in places.iter().zip(sensors).zip(points) {
        let way = DVec3::new(*x, *y, -2.0);
        let cos = -way.normalize().z;
        let (inner, outer) = (15f64.to_radians().cos(), 35f64.to_radians().cos());
        let share = ((cos - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
        let expected = 1000.0 * share * cos / way.length_squared();
        close(sensor, expected, 1e-3, &format!("a sensor at {x} {y}"));
        close(point, expected, 0.03, &format!("a sample point near {x} {y}"));
    }
}

/// E cos θ wherever nothing is in the way, from however far, and a sharp shadow of a plate in the first pass.
#[test]
fn directional_light_is_the_same_everywhere_but_in_shadows() {
    let sun = "[[lights]]\nname = \"sun\"\ndistribution = \"directional\"\ndirection = [0.6, 0, -0.8]\n\
               illuminant = \"D65\"\nilluminance = 50000\n\
               [[objects]]\nname = \"plate\"\nmaterial = \"grey\"\n\
               quads = [[[-1.25, -0.5, 1], [-0.25, -0.5, 1], [-0.25, 0.5, 1], [-1.25, 0.5, 1]]]\n";
    let places = [[0.0, 0.0], [1.7, 1.7], [-1.7, 1.2], [0.45, 0.45], [0.55, 0.0], [-0.55, 0.0]];
    let (sensors, points, error) = lit(compiled(sun, FILE), &places);
    assert!(error < 1e-4, "{error}");
    for (([x, y], sensor), point) in places.iter().zip(sensors).zip(points) {
        // The plate, 0.75 m along the beam above the floor, hides x from -0.5 to 0.5.
        let hidden = x.abs() < 0.5 && y.abs() < 0.5;
        let expected = if hidden { 0.0 } else { 40000.0 };
        assert!((sensor - expected).abs() < if hidden { 4000.0 } else { 40.0 + 4000.0 }, "{x} {y} {sensor}");
        assert!((point - expected).abs() < 4000.0, "{x} {y} {point}");
        assert!(!hidden || point < 4000.0);
    }
    for (more, part) in [
        ("position = [0, 0, 1]\n", "no `position`"),
        ("luminous_flux = 1\n", "`illuminance` (lx)"),
        ("diameter_deg = -1\n", "between 0 and 90"),
    ] {
        let text = sun.replacen("illuminance", &format!("{more}illuminance"), 1);
        match scene(&Folder::new(), &text, FILE) {
            Err(e) => assert!(e.to_string().contains(part), "{e}"),
            Ok(_) => panic!("no error: {more}"),
        }
    }
}

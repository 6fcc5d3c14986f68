//! Do point lights, sensors and grids load as written, change as asked, and fail with their place?

use crate::folder::Folder;
use crate::lit::Lit;
use glam::DVec3;
use luxgraph::error::Error;
use luxgraph::first_pass::Solver;
use luxgraph::scene::{Distribution, LightKind, LightLevel, Scene, SceneDescription, load};
use luxgraph::settings::Settings;

const SCENE: &str = "format = 1
[sampling]
max_area = 0.05
[materials.grey]
reflectance = 0.5
[[objects]]
name = \"floor\"
material = \"grey\"
quads = [[[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]]
[[objects]]
name = \"wall\"
material = \"grey\"
quads = [[[0, 2, 0], [2, 2, 0], [2, 2, 2], [0, 2, 2]]]
[[cameras]]
name = \"c\"
position = [1, 0, 1]
target = [1, 1, 0]
";

const LIGHT: &str = "[[lights]]
name = \"bulb\"
position = [1, 1, 1]
illuminant = \"A\"
luminous_flux = 100
";

fn read(more: &str) -> Result<Scene, Error> {
    load(&Folder::new().write("s.toml", format!("{SCENE}{more}")))
}

/// Line (counted from the first line after [`SCENE`]), column and message of the error.
fn place(more: &str) -> (usize, usize, String) {
    match read(more) {
        Err(Error::Scene { line, column, message, .. }) => (line - SCENE.lines().count(), column, message),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("no error: {more}"),
    }
}

#[test]
fn lights_sensors_and_grids_load_as_written() {
    let scene = read(&format!(
        "{LIGHT}[[lights]]\nname = \"spot\"\nposition = [0, 0, 2]\nspectrum = 2.0\n\
         luminous_intensity = 30\ndistribution = \"lambertian\"\ndirection = [0, 3, -4]\n\
         [[sensors]]\nname = \"s\"\nposition = [1, 1, 0]\nnormal = [0, 0, 2]\n\
         [[grids]]\nname = \"g\"\norigin = [0, 0, 1]\nu = [2, 0, 0]\nv = [0, 1, 0]\ncounts = [4, 2]\noffset = 0.5\n\
         [[grids]]\nname = \"h\"\norigin = [0, 0, 1]\nu = [2, 0, 0]\nv = [4, 0, 0]\ncounts = [1, 1]\nnormal = [0, -9, 0]\n"
    ))
    .expect("loads");
    let [bulb, spot] = &scene.geometry.lights[..] else { panic!("two lights") };
    let LightKind::Point { position, distribution: Distribution::Isotropic } = &bulb.kind else {
        panic!("an isotropic light")
    };
    assert_eq!(*position + scene.geometry.centre, DVec3::ONE);
    let LightKind::Point { distribution: Distribution::Lambertian { axis }, .. } = spot.kind else {
        panic!("a lambertian light")
    };
    assert!((axis - DVec3::new(0.0, 0.6, -0.8)).length() < 1e-15);
    let levels: Vec<LightLevel> = scene.appearance.lights.iter().map(|l| l.level).collect();
    assert_eq!(levels, [LightLevel::LuminousFlux(100.0), LightLevel::LuminousIntensity(30.0)]);
    assert_eq!(scene.sensors[0].normal, DVec3::Z);
    let places: Vec<DVec3> = scene.grids[0].sensors().map(|s| s.position).collect();
    assert_eq!(places.len(), 8);
    assert_eq!(places[1], DVec3::new(0.75, 0.25, 1.5));
    assert_eq!(places[4], DVec3::new(0.25, 0.75, 1.5));
    assert_eq!(scene.grids[1].normal, DVec3::NEG_Y);
}

#[test]
fn mistakes_are_named_where_they_are() {
    let light = |from: &str, to: &str| LIGHT.replace(from, to);
    let grid = "[[grids]]\nname = \"g\"\norigin = [0, 0, 1]\nu = [2, 0, 0]\nv = [0, 1, 0]\ncounts = [4, 2]\n";
    let cases: Vec<(String, (usize, usize), &str)> = vec![
        (format!("{LIGHT}{LIGHT}"), (7, 8), "two lights \"bulb\""),
        (light("\"A\"", "\"AA\""), (4, 14), "unknown illuminant"),
        (light("illuminant = \"A\"\n", ""), (1, 1), "one of `illuminant` and `spectrum`"),
        (light("luminous_flux = 100\n", ""), (1, 1), "one of `luminous_flux`"),
        (light("100", "100\nluminous_intensity = 3"), (1, 1), "one of `luminous_flux`"),
        (light("100", "-1"), (5, 17), "0 to 1e15"),
        (light("100", "nan"), (5, 17), "0 to 1e15"),
        (light("\"A\"", "\"A\"\ndirection = [0, 0, 1]"), (5, 13), "isotropic light has none"),
        (light("\"A\"", "\"A\"\ndistribution = \"lambertian\""), (5, 16), "`direction`; add one"),
        (light("\"A\"", "\"A\"\ndistribution = \"lambert\""), (5, 16), "unknown distribution"),
        (
            light("\"A\"", "\"A\"\ndistribution = \"lambertian\"\ndirection = [0, 0, 0]"),
            (6, 13),
            "cannot be zero",
        ),
        (light("[1, 1, 1]", "[1, inf, 1]"), (3, 12), "finite coordinates"),
        (light("luminous_flux", "luminous_flus"), (5, 1), "did you mean `luminous_flux`"),
        (
            "[[sensors]]\nname = \"s\"\nposition = [1, 1, 0]\nnormal = [0, 0, 0]\n".into(),
            (4, 10),
            "cannot be zero",
        ),
        ("[[sensors]]\nname = \"s\"\nposition = [1, 1, 0]\n".into(), (1, 1), "`normal` is missing"),
        (format!("{grid}{grid}"), (8, 8), "two sensors or grids \"g\""),
        (grid.replace("[4, 2]", "[4, 0]"), (6, 10), "from 1 to 4096"),
        (grid.replace("[4, 2]", "[4096, 4096]"), (6, 10), "more than 262144"),
        (grid.replace("[0, 1, 0]", "[1, 0, 0]"), (5, 5), "span no plane"),
        (format!("{grid}offset = nan\n"), (7, 10), "finite length"),
    ];
    for (text, at, part) in cases {
        let (line, column, message) = place(&text);
        assert!(message.contains(part), "{text}\n{message}");
        assert_eq!((line, column), at, "{text}\n{message}");
    }
}

#[test]
fn changes_give_lights_other_amounts_and_spectra() {
    let folder = Folder::new();
    let scene = folder.write("s.toml", format!("{SCENE}{LIGHT}"));
    let description = SceneDescription::read(&scene).expect("reads");
    let geometry = description.compile().expect("compiles").geometry;
    let changed = |text: &str| {
        let path = folder.write("c.toml", format!("format = 1\n{text}"));
        description.changed(&path)?.appearance(&geometry)
    };
    let brighter = changed("[lights.bulb]\nluminous_intensity = 7\n").expect("fits");
    assert_eq!(brighter.lights[0].level, LightLevel::LuminousIntensity(7.0));
    let bluer = changed("[lights.bulb]\nspectrum = 1.0\n").expect("fits");
    assert_eq!(bluer.lights[0].level, LightLevel::LuminousFlux(100.0));
    assert_ne!(bluer.lights[0].spectrum, brighter.lights[0].spectrum);
    for (text, at, part) in [
        ("[lights.bulp]\nluminous_flux = 1\n", (2, 9), "did you mean \"bulb\""),
        ("[lights.bulb]\nposition = [0, 0, 0]\n", (3, 1), "unknown key `position`"),
        ("[lights.bulb]\nluminous_flux = 1\nluminous_intensity = 1\n", (2, 9), "one of `luminous_flux`"),
        ("[lights.bulb]\nluminous_flux = -1\n", (3, 17), "0 to 1e15"),
    ] {
        match changed(text) {
            Err(Error::Scene { line, column, message, path }) => {
                assert!(message.contains(part), "{text}\n{message}");
                assert_eq!((line, column), at, "{text}\n{message}");
                assert!(path.ends_with("c.toml"));
            }
            other => panic!("{text}: {other:?}"),
        }
    }
}

/// A light that is moved is looked for anew under the same graph file, and a change of its amount scales
/// the solution without anything else.
#[test]
fn lights_change_and_move_over_one_graph() {
    let folder = Folder::new();
    let graph = folder.path().join("graph");
    let lit = |text: &str| {
        let scene = load(&folder.write("s.toml", format!("{SCENE}{text}"))).expect("loads");
        let lit = Lit::over(scene, Settings::default(), Some(&graph));
        assert!(lit.flux_error() < 0.02, "{:?}", lit.solution().stats.flux);
        (lit.prepared.graph_loaded, lit.sum())
    };
    let (loaded, one) = lit(LIGHT);
    assert!(!loaded && one > 0.0);
    let (loaded, twice) = lit(&LIGHT.replace("100", "200"));
    assert!(loaded && (twice / one - 2.0).abs() < 1e-3, "{twice} {one}");
    // Under the floor, which is one-sided and blocks, it lights nothing but the wall's lower edge.
    let (loaded, hidden) = lit(&LIGHT.replace("[1, 1, 1]", "[1, 1, -1]"));
    assert!(loaded && hidden < 0.01 * one, "{hidden}");
    let (_, dark) = lit(&LIGHT.replace("100", "0"));
    assert_eq!(dark, 0.0);
    let (_, none) = lit("");
    assert_eq!(none, 0.0);
}

#[test]
fn both_solvers_agree_on_a_point_light() {
    let folder = Folder::new();
    let mirror = "[materials.mirror]\nfresnel = \"silver\"\nspecular = 0.9\nroughness = 0.2\n\
                  [[objects]]\nname = \"mirror\"\nmaterial = \"mirror\"\nmax_area = 0.02\n\
                  quads = [[[2, 0, 0], [2, 0, 1], [2, 2, 1], [2, 2, 0]]]\n";
    let path = folder.write("s.toml", format!("{SCENE}{LIGHT}{mirror}"));
    let solve = |solver| {
        let mut settings = Settings::default();
        settings.first_pass.tolerance = 1e-4;
        settings.first_pass.solver = solver;
        let lit = Lit::new(load(&path).expect("loads"), settings);
        assert!(lit.solution().stats.longest_chain > 0, "the mirror takes part");
        lit.light.1.radiance
    };
    let (all, shot) = (solve(Solver::Iterative), solve(Solver::Shooting));
    let brightest = all.iter().copied().fold(0.0, f32::max);
    assert!(all.iter().zip(&shot).all(|(a, b)| (a - b).abs() < 1e-3 * brightest));
}

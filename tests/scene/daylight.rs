//! Do sun and sky light rooms through openings and glass as they should, and change without a ray?

use crate::folder::Folder;
use crate::lit::Lit;
use glam::DVec3;
use luxgraph::error::Error;
use luxgraph::material::Transmission;
use luxgraph::measure::Illuminance;
use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::reference::{self, ReferenceSettings};
use luxgraph::scene::{Scene, SceneDescription, Sensor, load};
use luxgraph::second_pass::{Rung, SecondPassSettings, SpectralImage};
use luxgraph::settings::Settings;

/// A box open towards -x, 2 m wide and high and 3 m deep, all of one grey; in front of the camera.
const ROOM: &str = "format = 1
[sampling]
max_area = 0.03
[materials.grey]
reflectance = 0.5
[materials.glass]
pane = { index = 1.5, transmittance = 0.9 }
[[objects]]
name = \"room\"
material = \"grey\"
quads = [[[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0]], [[0, 0, 2], [0, 2, 2], [3, 2, 2], [3, 0, 2]],
    [[3, 0, 0], [3, 0, 2], [3, 2, 2], [3, 2, 0]], [[0, 0, 0], [0, 0, 2], [3, 0, 2], [3, 0, 0]],
    [[0, 2, 0], [3, 2, 0], [3, 2, 2], [0, 2, 2]]]
[[cameras]]
name = \"c\"
position = [2.5, 0.3, 1.4]
target = [0.8, 1.6, 0.2]
resolution = [16, 12]
[[cameras]]
name = \"out\"
position = [1, 1, 1]
target = [0, 1, 1.2]
resolution = [2, 2]
fov_deg = 2
";

const GLASS: &str = "[[objects]]
name = \"window\"
material = \"glass\"
max_area = 0.1
quads = [[[0, 0, 0], [0, 2, 0], [0, 2, 2], [0, 0, 2]]]
";

const SKY: &str = "[sky]
type = \"overcast\"
spectrum = 1.0
zenith_luminance = 1000
ground = 0.3
";

const SUN: &str = "[[lights]]
name = \"sun\"
distribution = \"directional\"
direction = [0.7, 0.1, -0.7]
spectrum = 1.0
illuminance = 20000
";

fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.first_pass.parts = true;
    settings
}

/// The room and `more`.
fn scene(more: &str) -> Scene {
    load(&Folder::new().write("s.toml", format!("{ROOM}{more}"))).unwrap_or_else(|e| panic!("{e}"))
}

fn lit(more: &str) -> Lit {
    Lit::new(scene(more), settings())
}

fn view(lit: &Lit, camera: usize, rung: Rung, samples: u32) -> SpectralImage {
    let second = SecondPassSettings { rung, samples, ..lit.settings.second_pass };
    let (geometry, camera, tracer) = (&lit.scene.geometry, &lit.scene.cameras[camera], lit.tracer());
    pipeline::view(geometry, &lit.prepared, &lit.light, camera, tracer.as_ref(), &second, &Silent)
        .expect("a view")
        .0
}

fn judged(lit: &Lit, samples: u32) -> SpectralImage {
    let judge = ReferenceSettings { samples, seed: 1 };
    let (geometry, camera) = (&lit.scene.geometry, &lit.scene.cameras[0]);
    reference::render(geometry, &lit.light.0, camera, lit.tracer().as_ref(), &judge, &Silent)
        .expect("a reference")
        .image
}

/// Transmittance of the window at a cosine.
fn transmittance(lit: &Lit, cosine: f64) -> f64 {
    let pane = lit.light.0.materials.iter().find_map(|m| match &m.transmission {
        Some(Transmission::Pane { transmit }) => Some(transmit),
        _ => None,
    });
    let mut share = vec![0.0; lit.solution().wavelengths.len()];
    pane.expect("a pane").eval(cosine as f32, &mut share);
    f64::from(share[0])
}

fn mean(image: &SpectralImage) -> f64 {
    let pixels = image.width as usize * image.height as usize;
    (0..pixels).map(|p| image.xyz(p)[1]).sum::<f64>() / pixels as f64
}

/// E cos θ in the sun's patch, less what glass keeps, and nothing of it beside.
#[test]
fn the_sun_makes_a_patch_through_an_opening_and_through_glass() {
    for (glass, kept) in [("", 1.0), (GLASS, 0.0)] {
        let lit = lit(&format!("{SUN}{glass}"));
        let from = DVec3::new(-0.7, -0.1, 0.7).normalize();
        let through = if kept == 1.0 { 1.0 } else { transmittance(&lit, from.x.abs()) };
        let parts = lit.solution().parts.as_ref().expect("parts");
        let (points, w) = (&lit.prepared.points, lit.solution().wavelengths.len());
        let (mut bright, mut dark) = (0, 0);
        for i in 0..points.len() {
            let p = points.position[i].as_dvec3() + lit.scene.geometry.centre;
            if points.normal[i].z < 0.5 || p.z > 0.01 || p.x < 0.01 {
                continue;
            }
            // The floor up to 2 m from the opening sees the sun.
            let found = lit.solution().wavelengths.xyz(&parts.direct[i * w..(i + 1) * w])[1]
                * std::f64::consts::PI
                / 0.5;
            let at = p + p.x / 0.7 * DVec3::new(-0.7, -0.1, 0.7);
            if (0.01..1.99).contains(&at.y) && at.z < 1.99 {
                let expected = 20000.0 * from.z * through;
                assert!((found / expected - 1.0).abs() < 1e-3, "{p}: {found} {expected}");
                bright += 1;
            } else if at.y < -0.01 || at.z > 2.01 {
                assert_eq!(found, 0.0, "{p}");
                dark += 1;
            }
        }
        assert!(bright > 100 && dark > 50);
        assert!(lit.flux_error() < 0.02, "{}", lit.flux_error());
    }
}

/// What a camera sees of the sky is its luminance, through glass less what that keeps.
#[test]
fn views_see_the_sky() {
    let d = DVec3::new(-1.0, 0.0, 0.2).normalize();
    let expected = 1000.0 * (1.0 + 2.0 * d.z) / 3.0;
    let open = lit(SKY);
    assert!((mean(&view(&open, 1, Rung::Interpolate, 4)) / expected - 1.0).abs() < 5e-3);
    let glazed = lit(&format!("{SKY}{GLASS}"));
    let through = transmittance(&glazed, d.x.abs());
    let found = mean(&view(&glazed, 1, Rung::Interpolate, 4));
    // And what the pane mirrors of the room.
    assert!(found > through * expected && found < 1.05 * expected, "{found} {expected}");
}

/// Every rung agrees with the judge, which finds the sky by chance alone and draws the sun by code of its own.
#[test]
fn rooms_under_sun_and_sky_agree_with_the_reference() {
    for (what, more, tolerance) in [
        ("sky", SKY.to_owned(), 0.02),
        ("sky through glass", format!("{SKY}{GLASS}"), 0.03),
        ("sun", SUN.to_owned(), 0.02),
        ("sun through glass", format!("{SUN}{GLASS}"), 0.03),
    ] {
        let lit = lit(&more);
        let judge = mean(&judged(&lit, 1024));
        for rung in [Rung::Interpolate, Rung::Direct, Rung::Gather] {
            let found = mean(&view(&lit, 0, rung, 16));
            assert!((found / judge - 1.0).abs() < tolerance, "{what} {rung:?}: {found} {judge}");
        }
    }
}

/// So do sensors: the judge lets the sun and lamps through panes, by code that measuring has no part in.
#[test]
fn sensors_behind_glass_agree_with_the_reference() {
    let lamp =
        "[[lights]]\nname = \"lamp\"\nposition = [-0.5, 1, 1.5]\nspectrum = 1.0\nluminous_flux = 3000\n";
    for more in [format!("{SUN}{GLASS}"), format!("{lamp}{GLASS}")] {
        let lit = lit(&more);
        let (position, normal) = (DVec3::new(0.5, 1.1, 0.0), DVec3::Z);
        let sensors = [Sensor { name: "s".into(), position, normal }];
        let judge = ReferenceSettings { samples: 1 << 12, seed: 1 };
        let (geometry, tracer) = (&lit.scene.geometry, lit.tracer());
        let found = reference::irradiance(geometry, &lit.light.0, &sensors, tracer.as_ref(), &judge, &Silent)
            .expect("a reference");
        let reading = &lit.readings(&sensors)[0];
        let lux = Illuminance::of(&reading.total(), &lit.light.0.wavelengths).illuminance_lx;
        let judge = found[0].illuminance_lx;
        assert!((lux / judge - 1.0).abs() < 0.03, "{more}: {lux} {judge}");
    }
}

/// Where more points are specular than are followed, what a mirror keeps to itself is no part of its diffuse light.
#[test]
fn parts_make_up_the_light_where_gloss_is_spread_evenly() {
    let gloss = "[materials.mirror]\nfresnel = { normal = 0.9 }\nspecular = 1\nroughness = 0\n\
                 [materials.half]\nreflectance = 0.8\nfresnel = { normal = 0.9 }\nspecular = 0.5\nroughness = 0.2\n\
                 [[objects]]\nname = \"m\"\nmaterial = \"mirror\"\nquads = [[[1, 1, 0.01], [2, 1, 0.01], [2, 2, 0.01], [1, 2, 0.01]]]\n\
                 [[objects]]\nname = \"h\"\nmaterial = \"half\"\nquads = [[[1, 0, 0.01], [2, 0, 0.01], [2, 1, 0.01], [1, 1, 0.01]]]\n";
    let mut settings = settings();
    settings.first_pass.most_specular = 0;
    let lit = Lit::new(scene(&format!("{SKY}{SUN}{gloss}")), settings);
    let (points, solution) = (&lit.prepared.points, lit.solution());
    let (parts, w) = (solution.parts.as_ref().expect("parts"), solution.wavelengths.len());
    let mut mirrors = 0;
    for (i, &surface) in points.surface.iter().enumerate() {
        for at in i * w..(i + 1) * w {
            let known = parts.emission[at] + parts.direct[at] + parts.specular[at];
            assert!(
                known <= solution.radiance[at] * (1.0 + 1e-4),
                "{i}: {known} of {}",
                solution.radiance[at]
            );
        }
        if lit.light.0.of(surface).diffuse[0] == 0.0 {
            assert_eq!(solution.radiance[i * w], 0.0);
            mirrors += 1;
        }
    }
    assert!(mirrors > 10, "{mirrors} points of the mirror");
}

/// Another sky and another sun are another appearance: nothing is looked for again.
#[test]
fn skies_change_without_a_ray() {
    let folder = Folder::new();
    let scene = folder.write("s.toml", format!("{ROOM}{SKY}{SUN}"));
    let lit = lit(&format!("{SKY}{SUN}"));
    let description = SceneDescription::read(&scene).expect("reads");
    let changed = |text: &str| {
        let path = folder.write("c.toml", format!("format = 1\n{text}"));
        let appearance = description.changed(&path)?.appearance(&lit.scene.geometry)?;
        let again = pipeline::light(&lit.scene.geometry, &lit.prepared, &appearance, &settings(), &Silent)?;
        assert_eq!(again.1.stats.rays_cast, 0);
        Ok(again.1.radiance.iter().map(|&l| f64::from(l)).sum::<f64>())
    };
    let sun_off = "[lights.sun]\nilluminance = 0\n";
    let one: Result<f64, Error> = changed(sun_off);
    let (one, twice) =
        (one.expect("fits"), changed(&format!("{sun_off}[sky]\nzenith_luminance = 2000\n")).expect("fits"));
    assert!((twice / one - 2.0).abs() < 1e-3, "{one} {twice}");
    let clear = changed(&format!("{sun_off}[sky]\ntype = \"clear\"\nsun = [-1, 0, 1]\n")).expect("fits");
    assert!(clear > one, "towards the sun it is brighter: {clear} {one}");
    let dark = changed(&format!("{sun_off}[sky]\nzenith_luminance = 0\n")).expect("fits");
    assert_eq!(dark, 0.0);
    for (text, part) in [
        ("[materials.grey]\npane = { index = 1.5 }\n", "both sides"),
        ("[sky]\ntype = \"clear\"\n", "give `sun`"),
        ("[sky]\nup = [0, 1, 0]\n", "stays where the scene file has it"),
        ("[sky]\ntype = 17\n", "1 to 15"),
        ("[sky]\ntype = \"overcst\"\n", "did you mean \"overcast\""),
        ("[sky]\ntype = \"clear\"\nsun = [1, 0, -1]\n", "above the horizon"),
        ("[sky]\nzenith_luminance = 1\nilluminance = 1\n", "one of `zenith_luminance`"),
        ("[sky]\nground = 2\n", "0 to 1"),
    ] {
        match changed(text) {
            Err(Error::Scene { message, path, .. }) => {
                assert!(message.contains(part) && path.ends_with("c.toml"), "{text}\n{message}");
            }
            other => panic!("{text}: {other:?}"),
        }
    }
}

#[test]
fn what_was_no_pane_cannot_become_one_under_the_sky() {
    let folder = Folder::new();
    let blind = "[materials.blind]\nreflectance = 0.5\ntwo_sided = true\n";
    let window = GLASS.replace("\"glass\"", "\"blind\"");
    let changes = folder.write("c.toml", "format = 1\n[assign]\nwindow = \"glass\"\n");
    for (light, refused) in [(SKY, true), (SUN, true), ("", false)] {
        let path = folder.write(
            "s.toml",
            format!("{}{window}{light}", ROOM.replacen("[[objects]]", &format!("{blind}[[objects]]"), 1)),
        );
        let geometry = load(&path).expect("loads").geometry;
        let description = SceneDescription::read(&path).expect("reads");
        let appearance = description.changed(&changes).and_then(|d| d.appearance(&geometry));
        match appearance {
            Ok(_) => assert!(!refused),
            Err(Error::Scene { message, .. }) => assert!(refused && message.contains("no pane"), "{message}"),
            Err(other) => panic!("{other}"),
        }
    }
}

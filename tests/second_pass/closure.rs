//! Does a view through the whole pipeline return the light that closed forms say, no more and no less?

use glam::DVec3;
use luxgraph::material::fresnel::scaled;
use luxgraph::observer::Silent;
use luxgraph::scene::{Camera, Scene, load};
use luxgraph::second_pass::SpectralImage;
use luxgraph::settings::Settings;
use luxgraph::tracers::TracerChoice;
use luxgraph::{pipeline, tracers};

/// Quadrilaterals of an axis-parallel box: x low, x high, y low, y high, z low, z high, facing outwards.
fn faces(lo: [f64; 3], hi: [f64; 3]) -> [[DVec3; 4]; 6] {
    let face = |axis: usize, high: bool| {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let corner = |a: bool, b: bool| {
            let mut p = DVec3::ZERO;
            p[axis] = if high { hi[axis] } else { lo[axis] };
            p[u] = if a { hi[u] } else { lo[u] };
            p[v] = if b { hi[v] } else { lo[v] };
            p
        };
        let turn = [corner(false, false), corner(true, false), corner(true, true), corner(false, true)];
        if high { turn } else { [turn[3], turn[2], turn[1], turn[0]] }
    };
    [face(0, false), face(0, true), face(1, false), face(1, true), face(2, false), face(2, true)]
}

fn object(name: &str, material: &str, quads: &[[DVec3; 4]]) -> String {
    let corner = |p: &DVec3| format!("[{}, {}, {}]", p.x, p.y, p.z);
    let quad = |q: &[DVec3; 4]| format!("[{}]", q.iter().map(corner).collect::<Vec<_>>().join(", "));
    let quads = quads.iter().map(quad).collect::<Vec<_>>().join(", ");
    format!("[[objects]]\nname = \"{name}\"\nmaterial = \"{material}\"\nquads = [{quads}]\n")
}

/// The inside of a box: `faces` the other way round.
fn inside(lo: [f64; 3], hi: [f64; 3]) -> [[DVec3; 4]; 6] {
    faces(lo, hi).map(|[a, b, c, d]| [d, c, b, a])
}

const HEAD: &str = r#"format = 1
[sampling]
max_area = 0.02
[materials.lamp]
emission = { spectrum = 1.0, radiance = 1.0 }
[materials.black]
reflectance = 0.0
[[cameras]]
name = "main"
position = [0.5, 0.5, 0.5]
target = [1, 0.5, 0.5]
"#;

fn scene(rest: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, format!("{HEAD}{rest}")).expect("written");
    load(&path).unwrap_or_else(|error| panic!("{error}"))
}

/// The scene as seen by a camera, by both tracers.
fn views(scene: &Scene, camera: &Camera) -> Vec<SpectralImage> {
    let mut settings = Settings::default();
    settings.second_pass.samples = 4;
    settings.second_pass.max_depth = 63;
    settings.second_pass.tolerance = 0.0;
    let choices = [TracerChoice::Voxel, TracerChoice::Auto];
    let view = |choice| {
        let tracer = tracers::choose(choice, &scene.geometry).unwrap();
        let geometry = &scene.geometry;
        let prepared =
            pipeline::prepare(geometry, &scene.sampling, &settings, tracer.as_ref(), None, &Silent).unwrap();
        let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).unwrap();
        pipeline::view(geometry, &prepared, &lit, camera, tracer.as_ref(), &settings.second_pass, &Silent)
            .unwrap()
            .0
    };
    choices.into_iter().map(view).collect()
}

fn camera(position: [f64; 3], target: [f64; 3], fov_deg: f64) -> Camera {
    let (position, target) = (position.into(), target.into());
    Camera { name: "c".into(), position, target, up: DVec3::Z, fov_deg, resolution: [33, 21] }
}

const LO: [f64; 3] = [0.0; 3];
const HI: [f64; 3] = [1.0; 3];

/// Unfolded at its two mirrors, x = 0 and x = 1, the room is an endless corridor: what the camera sees
/// of the glowing floor, ceiling and ends is dimmed once for every mirror that the straight line crosses.
#[test]
fn mirrors_that_face_each_other_dim_once_a_reflection() {
    let walls = inside(LO, HI);
    let mirror = "[materials.mirror]\nspecular = 1.0\nfresnel = { normal = 0.9 }\n";
    let scene = scene(&format!(
        "{mirror}{}{}",
        object("mirrors", "mirror", &walls[..2]),
        object("others", "lamp", &walls[2..])
    ));
    let view = camera([0.3, 0.5, 0.45], [0.9, 0.52, 0.47], 12.0);
    let index = (1.0 + 0.9_f64.sqrt()) / (1.0 - 0.9_f64.sqrt());
    // How many mirrors the line to image position (x, y) crosses, and its direction.
    let crossed = |x: f64, y: f64| {
        let direction = view.ray(x, y, DVec3::ZERO).direction;
        let reach = |axis: usize| {
            let wall = if direction[axis] > 0.0 { 1.0 } else { 0.0 };
            (wall - view.position[axis]) / direction[axis]
        };
        let x = view.position.x + reach(1).min(reach(2)) * direction.x;
        (x.floor().abs() as i32, direction)
    };
    for image in views(&scene, &view) {
        let (mut seen, mut most) = (0, 0);
        for pixel in 0..image.pixels() {
            let (x, y) = ((pixel % 33) as f64, (pixel / 33) as f64);
            let (count, direction) = crossed(x + 0.5, y + 0.5);
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
            if corners.iter().any(|(dx, dy)| crossed(x + dx, y + dy).0 != count) {
                continue;
            }
            let expected = scaled(direction.x.abs(), 0.9, index, 0.0).powi(count);
            for l in image.spectrum(pixel) {
                assert!((f64::from(*l) / expected - 1.0).abs() < 2e-3, "{count} mirrors: {l} for {expected}");
            }
            (seen, most) = (seen + 1, most.max(count));
        }
        println!("{seen} of {} pixels, up to {most} mirrors", image.pixels());
        assert!(seen > image.pixels() / 3 && most >= 5);
    }
}

/// A glowing wall seen straight through a slab of n = 1.52: (1 - R)² with what is reflected to and
/// fro inside added is (1 - R)/(1 + R) = 0.91832.
#[test]
fn a_slab_of_glass_lets_through_what_fresnel_says() {
    let walls = inside(LO, HI);
    let glass = "[materials.solid]\nsolid = { index = 1.52 }\n[materials.pane]\npane = { index = 1.52, thickness_m = 0.004 }\n";
    let room = object("lamp", "lamp", &[walls[1]])
        + &object("rest", "black", &[walls[0], walls[2], walls[3], walls[4], walls[5]]);
    let sheet = inside([0.6, 0.2, 0.2], [0.6, 0.8, 0.8])[1];
    let slabs = [
        object("slab", "solid", &faces([0.6, 0.2, 0.2], [0.65, 0.8, 0.8])),
        object("sheet", "pane", &[sheet]),
    ];
    for slab in slabs {
        let scene = scene(&format!("{glass}{room}{slab}"));
        for image in views(&scene, &camera([0.1, 0.5, 0.5], [1.0, 0.5, 0.5], 2.0)) {
            let mean =
                image.radiance.iter().map(|l| f64::from(*l)).sum::<f64>() / image.radiance.len() as f64;
            println!("through the slab: {mean:.5}");
            assert!((mean - 0.91832).abs() < 5e-4, "{mean}");
        }
    }
}

/// Every face of a closed box glows with E and reflects ρ, so everything in it is seen at
/// E / (1 - ρ): walls, and whatever takes nothing away, by reflection or by transmission.
#[test]
fn nothing_that_does_not_absorb_is_seen_in_a_furnace() {
    let grey = "[materials.grey]\nreflectance = 0.5\nemission = { spectrum = 1.0, radiance = 0.5 }\n\
                [materials.solid]\nsolid = { index = 1.52 }\n[materials.pane]\npane = { index = 1.52 , thickness_m = 0.004 }\n\
                [materials.mirror]\nspecular = 1.0\nfresnel = { n = 1.0, k = 1e9 }\n";
    let walls = object("walls", "grey", &inside(LO, HI));
    let block = faces([0.5, 0.3, 0.2], [0.8, 0.7, 0.6]);
    for things in [
        object("block", "solid", &block),
        object("sheet", "pane", &[block[0]]),
        object("plate", "mirror", &block),
        object("block", "solid", &block)
            + &object("plate", "mirror", &faces([0.3, 0.1, 0.1], [0.4, 0.2, 0.6])),
    ] {
        let scene = scene(&format!("{grey}{walls}{things}"));
        for image in views(&scene, &camera([0.1, 0.45, 0.6], [0.7, 0.5, 0.4], 70.0)) {
            let error = |l: &f32| (f64::from(*l) - 1.0).abs();
            let worst = image.radiance.iter().map(error).fold(0.0, f64::max);
            let mean = image.radiance.iter().map(error).sum::<f64>() / image.radiance.len() as f64;
            println!("furnace: mean error {mean:.5}, worst {worst:.5}");
            assert!(mean < 0.005 && worst < 0.02, "mean error {mean}, worst {worst}");
        }
    }
}

/// What absorbs nothing shows a mean of what surrounds it, so no pixel may lie outside the range of the walls: not
/// where light enters at grazing angles, is caught by total reflection or meets an edge.
#[test]
fn clear_glass_shows_nothing_but_its_surroundings() {
    let walls = inside(LO, HI);
    for index in [1.52, 2.4, 4.0] {
        let grey = format!(
            "[materials.grey]\nreflectance = 0.5\nemission = {{ spectrum = 1.0, radiance = 0.5 }}\n\
             [materials.solid]\nsolid = {{ index = {index} }}\n"
        );
        let block = faces([0.35, 0.3, 0.3], [0.75, 0.7, 0.7]);
        let scene =
            scene(&format!("{grey}{}{}", object("walls", "grey", &walls), object("block", "solid", &block)));
        let (geometry, mut settings) = (&scene.geometry, Settings::default());
        settings.second_pass.samples = 4;
        let tracer = tracers::choose(TracerChoice::Auto, geometry).unwrap();
        let prepared =
            pipeline::prepare(geometry, &scene.sampling, &settings, tracer.as_ref(), None, &Silent).unwrap();
        let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).unwrap();
        let wall = |i: &usize| prepared.points.surface[*i].index() < walls.len();
        let shown: Vec<f32> =
            (0..prepared.points.len()).filter(wall).flat_map(|i| lit.1.of(i)).copied().collect();
        let least = shown.iter().copied().fold(f32::MAX, f32::min);
        let most = shown.iter().copied().fold(0.0, f32::max);
        println!("n {index}: walls from {least} to {most}");
        assert!(least > 0.98 && most < 1.02, "{least} {most}");
        for (position, target, fov_deg) in [
            ([0.1, 0.45, 0.6], [0.7, 0.5, 0.4], 70.0),
            ([0.1, 0.1, 0.9], [0.55, 0.5, 0.5], 50.0),
            ([0.55, 0.05, 0.72], [0.55, 0.5, 0.6], 60.0),
        ] {
            let view = Camera { resolution: [160, 120], ..camera(position, target, fov_deg) };
            let (image, stats) = pipeline::view(
                geometry,
                &prepared,
                &lit,
                &view,
                tracer.as_ref(),
                &settings.second_pass,
                &Silent,
            )
            .unwrap();
            let low = image.radiance.iter().copied().fold(f32::MAX, f32::min);
            let high = image.radiance.iter().copied().fold(0.0, f32::max);
            println!("  pixels from {low} to {high}, cut {:.1e}", stats.cut_share);
            // Between the outermost points and the edges of a wall its light is extrapolated.
            assert!(low > least - 5e-3 && high < most + 5e-3, "{low} to {high}");
        }
    }
}

//! Do the rungs of the second pass show the same light, each closer to the truth than the one before?

use glam::DVec3;
use luxgraph::error::Error;
use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::scene::{Camera, Scene, load};
use luxgraph::second_pass::{Rung, SpectralImage};
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::{TracerChoice, choose};
use std::path::Path;

const RUNGS: [Rung; 3] = [Rung::Interpolate, Rung::Direct, Rung::Gather];

fn scene(text: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    load(&path).unwrap_or_else(|e| panic!("{e}"))
}

fn settings(rung: Rung, samples: u32) -> Settings {
    let mut settings = Settings { tracer: TracerChoice::Voxel, ..Settings::default() };
    settings.wavelengths = Wavelengths::meyer4();
    settings.second_pass.samples = samples;
    settings.second_pass.rung = rung;
    settings.first_pass.parts = rung != Rung::Interpolate;
    settings
}

fn view(scene: &Scene, camera: &Camera, settings: &Settings) -> SpectralImage {
    let tracer = choose(settings.tracer, &scene.geometry).expect("it is there");
    let (geometry, tracer) = (&scene.geometry, tracer.as_ref());
    let prepared =
        pipeline::prepare(geometry, &scene.sampling, settings, tracer, None, &Silent).expect("prepared");
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, settings, &Silent).expect("lit");
    pipeline::view(geometry, &prepared, &lit, camera, tracer, &settings.second_pass, &Silent).expect("seen").0
}

fn mean(image: &SpectralImage) -> f64 {
    image.radiance.iter().map(|&l| f64::from(l)).sum::<f64>() / image.radiance.len() as f64
}

/// The inside of a box, one object.
fn room(material: &str, size: [f64; 3]) -> String {
    let [x, y, z] = size;
    format!(
        "[[objects]]\nname = \"room\"\nmaterial = \"{material}\"\nquads = [\
         [[0,0,0],[{x},0,0],[{x},{y},0],[0,{y},0]], [[0,0,{z}],[0,{y},{z}],[{x},{y},{z}],[{x},0,{z}]], \
         [[0,0,0],[0,0,{z}],[{x},0,{z}],[{x},0,0]], [[0,{y},0],[{x},{y},0],[{x},{y},{z}],[0,{y},{z}]], \
         [[0,0,0],[0,{y},0],[0,{y},{z}],[0,0,{z}]], [[{x},0,0],[{x},0,{z}],[{x},{y},{z}],[{x},{y},0]]]\n"
    )
}

const CAMERA: &str = "[[cameras]]\nname = \"c\"\nposition = [0.3, 0.4, 1.1]\ntarget = [1.6, 1.5, 0.4]\nresolution = [24, 18]\n";

#[test]
fn a_furnace_is_even_on_every_rung() {
    let scene = scene(&format!(
        "format = 1\n[sampling]\nmax_area = 0.1\n[materials.wall]\nreflectance = 0.6\n\
         emission = {{ spectrum = 1.0, radiance = 1.0 }}\n{}{CAMERA}",
        room("wall", [2.0, 1.8, 1.4])
    ));
    for rung in RUNGS {
        let image = view(&scene, &scene.cameras[0], &settings(rung, 256));
        let found = mean(&image);
        assert!((found / 2.5 - 1.0).abs() < 4e-3, "{rung:?}: {found}");
        // No corner glows and none is dark.
        let worst = image.radiance.iter().map(|&l| (f64::from(l) / 2.5 - 1.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.08, "{rung:?}: {worst}");
    }
}

/// A small shelf over a floor, a point light over both: what the floor shows is known at every place.
#[test]
fn shadows_of_point_lights_are_exact_from_direct_on() {
    let scene = scene(
        "format = 1\n[sampling]\nmax_area = 0.05\n[materials.wall]\nreflectance = 0.5\n[materials.black]\nreflectance = 0.0\n\
         [[objects]]\nname = \"floor\"\nmaterial = \"wall\"\nquads = [[[0,0,0],[2,0,0],[2,2,0],[0,2,0]]]\n\
         [[objects]]\nname = \"shelf\"\nmaterial = \"black\"\n\
         quads = [[[0.8,0.8,0.5],[0.8,1.2,0.5],[1.2,1.2,0.5],[1.2,0.8,0.5]]]\n\
         [[lights]]\nname = \"l\"\nposition = [1, 1, 1.5]\nspectrum = 1.0\nluminous_intensity = 100\n\
         [[cameras]]\nname = \"c\"\nposition = [-0.5, 1, 0.4]\ntarget = [1, 1, 0]\nfov_deg = 50\nresolution = [40, 30]\n",
    );
    let camera = &scene.cameras[0];
    let appearance = scene.appearance.sample(&scene.geometry, &Wavelengths::meyer4(), 20);
    let expected = |p: DVec3| {
        let to_light = DVec3::new(1.0, 1.0, 1.5) - p;
        // The shelf's shadow is 1.5 times its size: 0.7 to 1.3.
        let shaded = (p.x - 1.0).abs() < 0.3 && (p.y - 1.0).abs() < 0.3;
        let intensity = f64::from(appearance.lights[0][0]);
        if shaded {
            0.0
        } else {
            0.5 / std::f64::consts::PI * intensity * to_light.z / to_light.length().powi(3)
        }
    };
    let image = view(&scene, camera, &settings(Rung::Direct, 4));
    let at = camera.view(DVec3::ZERO);
    let (mut compared, mut dark) = (0, 0);
    for y in 0..30 {
        for x in 0..40 {
            // Pixels of which all four corners see the floor, well inside the shadow or well outside.
            let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(dx, dy)| {
                let ray = at.ray(f64::from(x) + dx, f64::from(y) + dy);
                let p = ray.origin + ray.direction * (-ray.origin.z / ray.direction.z);
                let floor =
                    ray.direction.z < 0.0 && p.cmpge(DVec3::ZERO).all() && p.cmple(DVec3::splat(2.0)).all();
                let shelf = ray.origin + ray.direction * ((0.5 - ray.origin.z) / ray.direction.z);
                let hidden =
                    ray.direction.z > 0.0 || (shelf.x - 1.0).abs() < 0.25 && (shelf.y - 1.0).abs() < 0.25;
                let edge = ((p.x - 1.0).abs().max((p.y - 1.0).abs()) - 0.3).abs();
                (floor && !hidden && edge > 0.05).then(|| expected(p))
            });
            let [Some(a), Some(b), Some(c), Some(d)] = corners else { continue };
            let (low, high) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
            let found = f64::from(image.radiance[(y as usize * 40 + x as usize) * 4]);
            if high == 0.0 {
                assert_eq!(found, 0.0, "{x} {y}");
                dark += 1;
            } else if low > 0.0 {
                assert!(found > low * 0.999 && found < high * 1.001, "{x} {y}: {found} in {low}..{high}");
                compared += 1;
            }
        }
    }
    assert!(compared > 300 && dark > 12, "{compared} {dark}");
}

#[test]
fn rungs_show_the_same_light() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    for (name, resolution) in [("cornell_box.toml", [32, 32]), ("sphere_and_disc.toml", [32, 24])] {
        let scene = load(&shipped.join(name)).expect("it ships");
        let camera = Camera { resolution, ..scene.cameras[0].clone() };
        let means = RUNGS.map(|rung| mean(&view(&scene, &camera, &settings(rung, 64))));
        println!("{name}: {means:?}");
        for other in &means[1..] {
            assert!((other / means[0] - 1.0).abs() < 0.02, "{name}: {means:?}");
        }
    }
}

#[test]
fn every_rung_has_the_same_bits_from_any_number_of_threads() {
    let scene =
        load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/sphere_and_disc.toml")).expect("it ships");
    let camera = Camera { resolution: [32, 24], ..scene.cameras[0].clone() };
    for rung in RUNGS {
        let settings = Settings { area_factor: 4.0, ..settings(rung, 4) };
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| view(&scene, &camera, &settings))
        };
        assert!(with(1).radiance == with(3).radiance, "{rung:?}");
    }
}

#[test]
fn a_solution_without_parts_is_refused() {
    let scene =
        load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell_box.toml")).expect("it ships");
    let settings = Settings { area_factor: 16.0, ..settings(Rung::Interpolate, 1) };
    let tracer = choose(settings.tracer, &scene.geometry).expect("it is there");
    let (geometry, tracer) = (&scene.geometry, tracer.as_ref());
    let prepared =
        pipeline::prepare(geometry, &scene.sampling, &settings, tracer, None, &Silent).expect("prepared");
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).expect("lit");
    let mut second = settings.second_pass;
    second.rung = Rung::Direct;
    match pipeline::view(geometry, &prepared, &lit, &scene.cameras[0], tracer, &second, &Silent) {
        Err(Error::Settings(message)) => assert!(message.contains("parts"), "{message}"),
        other => panic!("{:?}", other.map(|_| ())),
    }
}

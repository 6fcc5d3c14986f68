//! Do sensors in the furnished room read what a dense hemisphere of rays reads? Direct light is held against
//! emitters in small pieces, specular light against four times the rays.

use glam::DVec3;
use luxgraph::geometry::{Ray, Side, SurfaceId};
use luxgraph::measure::{Illuminance, MeasureSettings, Reading};
use luxgraph::observer::Silent;
use luxgraph::scene::Sensor;
use luxgraph::second_pass::LitScene;
use luxgraph::settings::Settings;
use luxgraph::tracers::RayTracer;
use luxgraph::{pipeline, scene, tracers};

/// Rays along either axis of the disc onto which the hemisphere is projected.
const RAYS: usize = 1000;
/// Pieces along either edge of an emitter.
const PIECES: usize = 300;

/// E of the diffusely reflected radiance: rays in equal shares of the projected solid angle (Nusselt's
/// disc), each bringing what the first pass has where it hits.
fn reflected(scene: &LitScene, tracer: &dyn RayTracer, sensor: &Sensor) -> Vec<f64> {
    let w = scene.appearance.wavelengths.len();
    let field = scene.interpolator.field(scene.solution);
    let (x, y) = sensor.normal.any_orthonormal_pair();
    let origin = origin(scene, sensor);
    let (mut reflected, mut radiance) = (vec![0.0; w], vec![0.0; w]);
    let share = 4.0 / (RAYS * RAYS) as f64;
    let mut rays = Vec::new();
    for k in 0..RAYS * RAYS {
        let at = |i: usize| (2 * i + 1) as f64 / RAYS as f64 - 1.0;
        let (a, b) = (at(k % RAYS), at(k / RAYS));
        let up2 = 1.0 - a * a - b * b;
        if up2 > 0.0 {
            let direction = a * x + b * y + up2.sqrt() * sensor.normal;
            rays.push(Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY });
        }
    }
    let mut hits = vec![None; rays.len()];
    tracer.closest_batch(&rays, &mut hits);
    for (ray, hit) in rays.iter().zip(hits) {
        let Some(hit) = hit else { continue };
        if hit.side == Side::Back && !scene.geometry.two_sided[hit.surface.index()] {
            continue;
        }
        field.radiance(hit.surface, hit.side, ray.at(hit.t), &mut radiance);
        let emission = &scene.appearance.of(hit.surface).emission;
        for k in 0..w {
            reflected[k] += share * f64::from(radiance[k] - emission[k]);
        }
    }
    reflected
}

/// E of the emitted radiance: emitters in small pieces, a shadow ray to each.
fn emitted(scene: &LitScene, tracer: &dyn RayTracer, sensor: &Sensor) -> Vec<f64> {
    let mut emitted = vec![0.0; scene.appearance.wavelengths.len()];
    let origin = origin(scene, sensor);
    for (i, surface) in scene.geometry.surfaces.iter().enumerate() {
        let emission = &scene.appearance.of(SurfaceId(i as u32)).emission;
        if emission.iter().all(|&l| l == 0.0) {
            continue;
        }
        let share = surface.area / (PIECES * PIECES) as f64;
        for k in 0..PIECES * PIECES {
            let at = |i: usize| (i as f64 + 0.5) / PIECES as f64;
            let place = surface.point_at(at(k % PIECES), at(k / PIECES));
            let normal = surface.normal_at(place);
            let way = place + 1e-5 * normal - origin;
            let cosines = sensor.normal.dot(way).max(0.0) * normal.dot(-way).max(0.0);
            if cosines > 0.0
                && tracer.closest(&Ray { origin, direction: way, t_min: 0.0, t_max: 1.0 }).is_none()
            {
                let factor = share * cosines / way.length_squared().powi(2);
                emitted.iter_mut().zip(emission).for_each(|(e, l)| *e += factor * f64::from(*l));
            }
        }
    }
    emitted
}

fn origin(scene: &LitScene, sensor: &Sensor) -> DVec3 {
    sensor.position - scene.geometry.centre + 1e-5 * sensor.normal
}

#[test]
fn sensors_agree_with_a_dense_hemisphere_of_rays() {
    let room = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/paper_room.toml");
    let scene = scene::load(&room).expect("loads");
    let mut settings = Settings { area_factor: 4.0, ..Settings::default() };
    settings.first_pass.tolerance = 1e-2;
    let tracer = tracers::choose(settings.tracer, &scene.geometry).expect("a tracer");
    let (geometry, tracer) = (&scene.geometry, tracer.as_ref());
    let prepared =
        pipeline::prepare(geometry, &scene.sampling, &settings, tracer, None, &Silent).expect("prepared");
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).expect("lit");
    let lit_scene = pipeline::lit_scene(geometry, &prepared, &lit);
    let sensor = |name: &str, position: [f64; 3], normal: DVec3| Sensor {
        name: name.into(),
        position: DVec3::from(position),
        normal: normal.normalize(),
    };
    let sensors = [
        sensor("on the table", [2.4, 1.8, 0.75], DVec3::Z),
        sensor("on the floor, beside the bench", [2.0, 1.25, 0.0], DVec3::Z),
        sensor("under the table, beside the leg", [2.2, 1.7, 0.0], DVec3::Z),
        sensor("2 cm from a corner of the room", [0.02, 0.02, 0.0], DVec3::Z),
        sensor("on a wall, low", [0.0, 2.0, 0.3], DVec3::X),
        sensor("an eye before the mirror", [4.2, 2.6, 1.5], DVec3::Y),
        sensor("an eye, tilted", [1.0, 2.2, 1.2], DVec3::new(0.8, -0.3, -0.2)),
        sensor("on the ceiling", [3.7, 3.0, 2.8], DVec3::NEG_Z),
    ];
    let measure = |settings: &MeasureSettings| {
        pipeline::measure(geometry, &prepared, &lit, &sensors, tracer, settings, &Silent).expect("measured")
    };
    let read = measure(&settings.measure);
    let many_rays = measure(&MeasureSettings { specular_rays: 16384, ..settings.measure });
    let mut worst = 0.0f64;
    for ((sensor, read), many_rays) in sensors.iter().zip(&read).zip(&many_rays) {
        let Reading { direct, diffuse, specular } = read;
        let (emitted, reflected) =
            (emitted(&lit_scene, tracer, sensor), reflected(&lit_scene, tracer, sensor));
        let lux = |e: &[f64]| Illuminance::of(e, &lit.0.wavelengths).illuminance_lx;
        let parts = [(direct, &emitted), (diffuse, &reflected), (specular, &many_rays.specular)]
            .map(|(found, expected)| (lux(found), lux(expected)));
        let whole: f64 = parts.iter().map(|p| p.1).sum();
        let error = parts.iter().map(|p| p.0).sum::<f64>() / whole - 1.0;
        println!("{}: {parts:.2?} lx: {:+.3} %", sensor.name, 100.0 * error);
        worst = parts.iter().map(|p| (p.0 - p.1).abs() / whole).fold(worst.max(error.abs()), f64::max);
    }
    assert!(worst < 0.01, "{worst}");
}

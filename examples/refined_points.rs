//! What are points worth that are added where the light bends? Error of luminance over the number of points, even and refined,
//! beside the path tracer; docs/accuracy.md has the table.
//!
//!     cargo run --release --features embree --example refined_points -- FOLDER [TOLERANCE ...]
//!
//! FOLDER keeps the judges; one that is there as VIEW.exr, such as cornell_box_main.exr, is taken as it is.

use luxgraph::error::Result;
use luxgraph::observer::Silent;
use luxgraph::points::LightRefinement;
use luxgraph::report::tradeoff::Judge;
use luxgraph::report::tradeoff::judge::JudgeSettings;
use luxgraph::scene::{Camera, Scene};
use luxgraph::second_pass::SecondPassSettings;
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::{self, RayTracer};
use luxgraph::{pipeline, scene, share};
use std::path::Path;

/// Paths a pixel of the judge.
const PATHS: u32 = 4096;

/// Scene, changes, camera, size and factors on its areas.
type View = (&'static str, &'static [&'static str], &'static str, [u32; 2], &'static [f64]);

const VIEWS: [View; 2] = [
    (
        "paper_room",
        &["scenes/paper_room_diffuse.changes.toml"],
        "leg",
        [160, 120],
        &[4.0, 2.0, 1.0, 0.5, 0.25],
    ),
    ("cornell_box", &[], "main", [128, 128], &[4.0, 2.0, 1.0, 0.5, 0.25]),
];

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| "refined_points".into());
    let mut tolerances: Vec<f64> =
        arguments.map(|text| share::parse("TOLERANCE", &text)).collect::<Result<_>>()?;
    if tolerances.is_empty() {
        tolerances = vec![0.05];
    }
    println!("| view | area | tolerance | points | error | processor time |\n|---|---|---|---|---|---|");
    for (name, changes, camera, size, areas) in VIEWS {
        let changes: Vec<_> = changes.iter().map(std::path::PathBuf::from).collect();
        let scene = scene::load_with_changes(format!("scenes/{name}.toml").as_ref(), &changes)?;
        let Some(camera) = scene.cameras.iter().find(|c| c.name == camera) else { continue };
        let camera = Camera { resolution: size, ..camera.clone() };
        let tracer = tracers::choose(Settings::default().tracer, &scene.geometry)?;
        let own = Path::new(&folder).join(format!("{name}_{}", camera.name));
        std::fs::create_dir_all(&own).map_err(|e| luxgraph::error::Error::io(&own, e))?;
        let settings = JudgeSettings { samples: PATHS, sensor_samples: 16, sensors: 0 };
        let given = own.with_extension("exr");
        let given = given.exists().then_some(given.as_path());
        let judge = Judge::of(&own, given, (&scene, &camera), tracer.as_ref(), &settings, &Silent)?;
        for &area in areas {
            let refined = tolerances.iter().map(|&t| Some(t)).filter(|_| area > 0.9);
            for tolerance in std::iter::once(None).chain(refined) {
                let refinement =
                    tolerance.map(|tolerance| LightRefinement { tolerance, ..Default::default() });
                let settings = Settings {
                    area_factor: area,
                    refinement,
                    wavelengths: Wavelengths::parse("16")?,
                    ..Settings::default()
                };
                let title = format!("{name}, {} | {area} | {tolerance:?}", camera.name);
                line(&title, (&scene, &camera), &settings, tracer.as_ref(), &judge)?;
            }
        }
    }
    Ok(())
}

/// One line of the table.
fn line(
    title: &str,
    (scene, camera): (&Scene, &Camera),
    settings: &Settings,
    tracer: &dyn RayTracer,
    judge: &Judge,
) -> Result<()> {
    let (geometry, appearance, sampling) = (&scene.geometry, &scene.appearance, &scene.sampling);
    let clock = luxgraph::report::processor_s();
    let prepared = pipeline::prepare(geometry, sampling, settings, tracer, None, &Silent)?;
    let prepared =
        pipeline::refine_by_light(geometry, prepared, appearance, sampling, settings, tracer, &Silent)?;
    let light = pipeline::light(geometry, &prepared, appearance, settings, &Silent)?;
    let spent = luxgraph::report::processor_s() - clock;
    let view = |seed| -> Result<_> {
        let settings = SecondPassSettings { seed, samples: 64, ..settings.second_pass };
        let image = pipeline::view(geometry, &prepared, &light, camera, tracer, &settings, &Silent)?.0;
        Ok(image.to_linear())
    };
    let found = judge.judged.errors(&[view(0)?, view(1)?])?;
    println!(
        "| {title} | {} | {:.2} % ({:.2} to {:.2}) | {spent:.2} s |",
        prepared.points.len(),
        100.0 * found.systematic,
        100.0 * found.rmse_low,
        100.0 * found.rmse_high,
    );
    Ok(())
}

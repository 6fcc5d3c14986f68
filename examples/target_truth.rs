//! Is the error that `render --error` and `--within` estimate the true one? The views of tests/target_scenes, each
//! asked for several errors and times, beside the path tracer; docs/tradeoff.md has the table.
//!
//!     cargo run --release --features embree --example target_truth -- FOLDER [2% 5% 10s ...]
//!
//! FOLDER keeps the judges.

use luxgraph::error::Result;
use luxgraph::observer::Silent;
use luxgraph::report::tradeoff::Judge;
use luxgraph::report::tradeoff::judge::JudgeSettings;
use luxgraph::settings::Settings;
use luxgraph::target::{self, Fixed, Target};
use luxgraph::{scene, tracers};
use std::path::Path;

/// Paths a pixel of the judge.
const SAMPLES: u32 = 2048;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| "target_truth".into());
    let mut asked: Vec<String> = arguments.collect();
    if asked.is_empty() {
        asked = vec!["5%".into(), "2%".into()];
    }
    let mut files: Vec<_> = std::fs::read_dir("tests/target_scenes")
        .expect("run me where tests/ is")
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    files.sort();
    println!(
        "| view | asked | points | estimated | true | true / estimated | judge | s |\n|---|---|---|---|---|---|---|---|"
    );
    for file in files {
        let scene = scene::load(&file)?;
        for camera in &scene.cameras {
            let name = format!("{}, {}", file.file_stem().unwrap_or_default().display(), camera.name);
            for asked in &asked {
                line(&name, asked, (&scene, camera), Path::new(&folder))?;
            }
        }
    }
    Ok(())
}

/// One line of the table.
fn line(name: &str, asked: &str, view: (&scene::Scene, &scene::Camera), folder: &Path) -> Result<()> {
    let target = if asked.ends_with('%') { Target::parse_error(asked)? } else { Target::parse_time(asked)? };
    let tracer = tracers::choose(Settings::default().tracer, &view.0.geometry)?;
    let own = folder.join(name.replace(", ", "_"));
    std::fs::create_dir_all(&own).map_err(|e| luxgraph::error::Error::io(&own, e))?;
    let settings = JudgeSettings { samples: SAMPLES, sensor_samples: 16, sensors: 0 };
    let judge = Judge::of(&own, None, view, tracer.as_ref(), &settings, &Silent)?;
    let reached =
        target::render(view, tracer.as_ref(), &Settings::default(), (target, Fixed::default()), &Silent)?;
    let image = reached.image.to_linear();
    let truth = judge.judged.errors(&[image.clone(), image])?;
    let estimate = reached.estimate.total;
    println!(
        "| {name} | {asked} | {} | {:.2} % | {:.2} % | {:.2} | {:.2} % | {:.1} |",
        reached.prepared.points.len(),
        100.0 * estimate,
        100.0 * truth.rmse,
        truth.rmse / estimate,
        100.0 * judge.judged.relative_noise(),
        reached.total_s
    );
    Ok(())
}

//! `luxgraph relight`

use super::args::Options;
use super::options::{at_points, camera, exposure, settings};
use super::outputs::{Targets, inputs};
use super::progress::Bars;
use super::run::{Job, prepare, prepare_changed};
use super::say::say;
use clap::Args;
use luxgraph::error::{Error, Result};
use luxgraph::pipeline;
use luxgraph::scene::SceneDescription;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `relight`
#[derive(Debug, Args)]
pub struct Relight {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Other materials, lamps, or places of objects (scenes/FORMAT.md); each file gives an image named after it
    #[arg(long, value_name = "CHANGES.toml", required = true)]
    pub changes: Vec<PathBuf>,
    /// Folder for the images
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Solve every appearance by itself, which gives the bits that `render --changes` gives: else each goes on from
    /// the solutions before it, to the same tolerance
    #[arg(long)]
    pub same_bits: bool,
    /// Options common to render and relight.
    #[command(flatten)]
    pub options: Options,
}

/// Renders one image for each changes file, all over one graph, which is updated where objects moved, came or went.
pub fn run(args: &Relight) -> Result<()> {
    let started = Instant::now();
    let options = &args.options;
    let mut settings = settings(options)?;
    settings.first_pass.recall = !args.same_bits;
    let exposure = exposure(&options.picture.exposure)?;
    let stems: Vec<String> = args.changes.iter().map(|path| stem(path)).collect();
    if let Some(twice) = stems.iter().enumerate().find(|(i, s)| stems[..*i].contains(s)) {
        return Err(Error::Settings(format!(
            "two changes files are called {}, and would give one image: rename one",
            twice.1
        )));
    }

    // Everything that can be wrong is looked at before any work is done.
    let description = SceneDescription::read(&args.scene)?;
    let scene = description.compile()?;
    let changed = (args.changes.iter())
        .map(|path| {
            let description = description.changed(path)?;
            Ok((description.compile_over(&scene)?, description.is_rearranged()))
        })
        .collect::<Result<Vec<_>>>()?;
    let camera = camera(&scene, &options.view)?;
    let settings = at_points(settings, &options.lighting, &scene)?;
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io(&args.output, e))?;
    let targets: Vec<Targets> = stems
        .iter()
        .map(|stem| Targets {
            exr: args.output.join(format!("{stem}.exr")),
            png: args.output.join(format!("{stem}.png")),
            report: options.lighting.report.as_ref().map(|path| numbered(path, stem, stems.len())),
        })
        .collect();
    let inputs = inputs(&args.scene, &args.changes, &options.lighting);
    targets.iter().try_for_each(|t| t.check(&inputs))?;

    let bars = Bars::new();
    let (tracer, prepared) = prepare(&scene, &settings, options.lighting.graph.as_deref(), &bars)?;
    let mut kept = None;
    for (((changed, rearranged), path), targets) in changed.iter().zip(&args.changes).zip(&targets) {
        say!("{}:", path.display());
        let job = Job {
            scene: changed,
            sources: vec![args.scene.display().to_string(), path.display().to_string()],
            prepared: &prepared,
            camera: &camera,
            settings: &settings,
            tracer: tracer.as_ref(),
            exposure,
            spectral: options.picture.spectral,
            checkpoint: None,
            target: None,
            started,
        };
        if !rearranged {
            if kept.is_none() {
                kept = Some(pipeline::first_pass(&scene.geometry, &prepared, &settings, &bars)?);
            }
            if let Some(first_pass) = &mut kept {
                job.run(targets, first_pass.as_mut(), &bars)?;
            }
        } else {
            let before = (&scene.geometry, &prepared);
            let (tracer, prepared) = prepare_changed(before, changed, &settings, &bars)?;
            let mut first_pass = pipeline::first_pass(&changed.geometry, &prepared, &settings, &bars)?;
            let job = Job { prepared: &prepared, tracer: tracer.as_ref(), ..job };
            job.run(targets, first_pass.as_mut(), &bars)?;
        }
    }
    Ok(())
}

/// `dir/lamp_a.changes.toml` gives `lamp_a`.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".toml").unwrap_or(&name);
    name.strip_suffix(".changes").unwrap_or(name).to_owned()
}

/// The report of one of several images: `report.json` becomes `report-lamp_a.json`.
fn numbered(path: &Path, stem: &str, images: usize) -> PathBuf {
    if images == 1 {
        return path.to_owned();
    }
    let own = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{own}-{stem}.json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_named_after_their_changes() {
        assert_eq!(stem(Path::new("a/lamp_a.changes.toml")), "lamp_a");
        assert_eq!(stem(Path::new("gold.toml")), "gold");
    }
}

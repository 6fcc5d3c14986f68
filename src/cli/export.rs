//! `luxgraph export`

use super::args::View;
use super::options::camera;
use super::run::note;
use super::say::{say, tell};
use clap::Args;
use luxgraph::error::Result;
use luxgraph::export::mitsuba;
use luxgraph::scene;
use std::path::PathBuf;

/// `export`
#[derive(Debug, Args)]
pub struct Export {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Folder for scene.xml (Mitsuba 3, spectral variants) and its meshes; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Change the scene first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// The view.
    #[command(flatten)]
    pub view: View,
    /// Samples a pixel that the other renderer is asked for
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..))]
    pub samples: u32,
}

/// Writes a scene for Mitsuba 3.
pub fn run(args: &Export) -> Result<()> {
    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    note(&scene);
    let camera = camera(&scene, &args.view)?;
    for note in mitsuba::export(&scene, &camera, args.samples, &args.output)? {
        tell!("note: {note}");
    }
    say!("wrote {}", args.output.join("scene.xml").display());
    Ok(())
}

//! `luxgraph export`

use super::args::Export;
use super::run::{camera, note};
use super::say::{say, tell};
use luxgraph::error::Result;
use luxgraph::export::mitsuba;
use luxgraph::scene;

/// Writes a scene for Mitsuba 3.
pub fn run(args: &Export) -> Result<()> {
    let scene = scene::load_with_changes(&args.scene, &args.changes)?;
    note(&scene);
    let camera = camera(&scene, args.camera.as_deref(), args.size)?;
    for note in mitsuba::export(&scene, &camera, args.samples, &args.output)? {
        tell!("note: {note}");
    }
    say!("wrote {}", args.output.join("scene.xml").display());
    Ok(())
}

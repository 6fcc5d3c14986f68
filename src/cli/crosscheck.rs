//! `luxgraph crosscheck`

use super::args::Crosscheck;
use super::progress::Bars;
use super::run::note;
use super::say::{say, tell};
use luxgraph::error::{Error, Result};
use luxgraph::report::write_json;
use luxgraph::scene;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::crosscheck::MAX_LISTED;
use luxgraph::tracers::{EmbreeTracer, RayTracer, VoxelTracer, crosscheck, embree};

/// Puts all tracers of this build side by side.
pub fn run(args: &Crosscheck) -> Result<()> {
    let scene = scene::load(&args.scene)?;
    note(&scene);
    let voxel = VoxelTracer::new(&scene.geometry);
    let embree = match embree::available() {
        Some(_) => Some(EmbreeTracer::new(&scene.geometry)?),
        None => {
            tell!(
                "note: this build has no Embree; the voxel tracer is put beside the plain list of surfaces"
            );
            None
        }
    };
    let plain = BruteForce::new(&scene.geometry);
    let other: &dyn RayTracer = match &embree {
        Some(embree) => embree,
        None => &plain,
    };
    let report =
        crosscheck::crosscheck(&scene.geometry, &[other, &voxel], args.rays, args.seed, &Bars::new());
    say!("{}", report.to_string().trim_end());
    match &args.report {
        Some(path) => write_json(path, &report)?,
        None if report.not_shown() > 0 => {
            say!("--report OUT.json writes all, each with the exact verdict")
        }
        None => {}
    }
    let unlisted = report.disagreements - report.listed.len() as u64;
    if unlisted > 0 {
        tell!("note: {unlisted} disagreements beyond the first {MAX_LISTED} are counted but not listed");
    }
    match report.errors {
        0 => Ok(()),
        n => Err(Error::Tracer(format!(
            "{n} questions were answered wrongly beyond rounding; they are listed above"
        ))),
    }
}

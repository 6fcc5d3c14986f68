//! `luxgraph crosscheck`

use super::progress::Bars;
use super::run::note;
use super::say::{say, tell};
use clap::Args;
use luxgraph::error::{Error, Result};
use luxgraph::report::write_json;
use luxgraph::scene;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::crosscheck::MAX_LISTED;
use luxgraph::tracers::{EmbreeTracer, RayTracer, VoxelTracer, crosscheck, embree};
use std::path::PathBuf;

/// `crosscheck`
#[derive(Debug, Args)]
pub struct Crosscheck {
    /// Scene file
    pub scene: PathBuf,
    /// Segments to try, half of them adversarial
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,
    /// Seed of the segments
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write every disagreement as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

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

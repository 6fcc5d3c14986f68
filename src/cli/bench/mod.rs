//! `luxgraph bench`

mod growth;
mod linked;
mod paper;
mod stages;

pub use growth::run as growth;
pub use linked::run as linked;
pub use paper::run as paper;
pub use stages::run as stages;

use super::args::Tracing;
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// `bench`
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Bench {
    /// What else to measure
    #[command(subcommand)]
    pub what: Option<BenchWhat>,
    /// The stages of a scene.
    #[command(flatten)]
    pub stages: BenchStages,
}

/// `bench [SCENE]`
#[derive(Debug, Args)]
pub struct BenchStages {
    /// Scene file
    #[arg(default_value = "scenes/paper_room.toml")]
    pub scene: PathBuf,
    /// Numbers of sample points, about; may be repeated
    #[arg(long, value_name = "N", default_values_t = [4_010, 8_000, 32_000])]
    pub points: Vec<usize>,
    /// Also time the graph after these changes moved, added or removed objects
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Option<PathBuf>,
    /// meyer4, or how many bands from 380 to 780 nm
    #[arg(long, value_name = "meyer4|N", default_value = "meyer4")]
    pub wavelengths: String,
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// What `bench` can measure.
#[derive(Debug, Subcommand)]
pub enum BenchWhat {
    /// The paper's Tables 1 and 2 beside ours
    Paper(BenchPaper),
    /// How time and memory grow with the number of sample points, on a hall of desks
    Hall(BenchHall),
}

/// `bench paper`
#[derive(Debug, Args)]
pub struct BenchPaper {
    /// Scene file
    #[arg(default_value = "scenes/paper_room.toml")]
    pub scene: PathBuf,
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `bench hall`
#[derive(Debug, Args)]
pub struct BenchHall {
    /// Numbers of sample points, about
    #[arg(value_name = "POINTS", default_values_t = [4_000, 16_000, 64_000, 128_000])]
    pub points: Vec<usize>,
    /// Exchange light over links between points and clusters of points, and see how that grows
    #[arg(long)]
    pub links: bool,
    /// Largest form factor of a link to a cluster of points [default: 0.01]
    #[arg(long, value_name = "FORM_FACTOR", requires = "links")]
    pub link_tolerance: Option<f64>,
    /// With --links: also solve over all pairs up to this number of points, and tell the difference
    #[arg(long, value_name = "POINTS", requires = "links", default_value_t = 20_000)]
    pub full: usize,
    /// Rows of desks
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub rows: u16,
    /// Desks in a row: 41 quadrilaterals each, with their lamps
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub columns: u16,
    /// meyer4, or how many bands from 380 to 780 nm
    #[arg(long, value_name = "meyer4|N", default_value = "4")]
    pub wavelengths: String,
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

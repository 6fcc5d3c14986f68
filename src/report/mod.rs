//! What a run did, for people and for machines: field names carry their unit.

pub mod bench;
pub mod machine;
pub mod paper_tables;
pub mod tradeoff;
pub mod wavelength_table;

pub use machine::{Machine, peak_memory_bytes, processor_s, reset_peak_memory};

use crate::atomic_file;
use crate::error::{Error, Result};
use crate::first_pass::FirstPassStats;
use crate::second_pass::{SecondPassSettings, SecondPassStats};
use crate::visibility::{GraphStats, LinkStats};
use serde::Serialize;
use std::path::Path;

/// The report of one rendered image.
#[derive(Clone, Debug, Serialize)]
pub struct RunReport {
    /// Version of luxgraph.
    pub luxgraph: &'static str,
    /// Where it ran.
    pub machine: Machine,
    /// Scene file and changes applied, as named by the user.
    pub scene: Vec<String>,
    /// Name of the ray tracer.
    pub tracer: String,
    /// Wavelengths, nm.
    pub wavelengths_nm: Vec<f64>,
    /// What the scene consists of.
    pub counts: Counts,
    /// Whether the graph came from a file.
    pub graph_loaded: bool,
    /// How the graph was built.
    pub graph: GraphStats,
    /// What the links are, if there are any in place of the graph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub links: Option<LinkStats>,
    /// Memory of the graph, bytes.
    pub graph_memory_bytes: u64,
    /// The first pass.
    pub first_pass: FirstPassStats,
    /// How the second pass sampled.
    pub second_pass_settings: SecondPassSettings,
    /// The second pass.
    pub second_pass: SecondPassStats,
    /// What was asked for in place of settings, and what was reached.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<serde_json::Value>,
    /// Exposure of the preview, EV.
    pub exposure_ev: f64,
    /// Whole run, s.
    pub total_s: f64,
    /// Largest memory the process has used so far, bytes (0 where the system does not tell).
    pub peak_memory_bytes: u64,
}

/// Sizes of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Counts {
    /// Quadrilaterals and triangles.
    pub surfaces: usize,
    /// Sample points, both sides counted.
    pub points: usize,
    /// Points on specular surfaces.
    pub specular_points: usize,
    /// Voxels.
    pub voxels: usize,
    /// Voxels without a point.
    pub empty_voxels: usize,
}

/// Writes any report as JSON; the file appears only when whole.
///
/// # Errors
/// [`Error::Io`] when the file cannot be written.
pub fn write_json(path: &Path, report: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(report).map_err(|e| Error::io(path, e))?;
    atomic_file::write(path, (text + "\n").as_bytes())
}

//! What was measured, as rows of a CSV file that grows row by row and is never seen half written.

use super::front::pareto;
use crate::atomic_file;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One trial: what it took, and what it is wrong by. Errors of luminance are those of pixels that show no lamp, relative to the
/// judge's mean luminance over them; the judge's noise is taken off where nothing else is said.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The knob that differs from the base.
    pub knob: String,
    /// What it is turned to.
    pub value: String,
    /// Whether no other trial is as fast and more accurate.
    pub on_front: bool,
    /// Sample points.
    pub points: usize,
    /// Wavelengths.
    pub wavelengths: usize,
    /// Samples a pixel.
    pub samples: u32,
    /// Wall time of sample points and graph, s.
    pub graph_s: f64,
    /// Wall time of the first pass, s.
    pub first_pass_s: f64,
    /// Wall time of the second pass, s.
    pub second_pass_s: f64,
    /// All three, s.
    pub total_s: f64,
    /// Time of all processors together for all three, s.
    pub processor_s: f64,
    /// Largest memory of the process during any of them, bytes.
    pub peak_memory_bytes: u64,
    /// Root mean square error of luminance.
    pub rmse: f64,
    /// The judge's noise leaves it at least so large
    pub rmse_low: f64,
    /// and at most.
    pub rmse_high: f64,
    /// The part that no other seed changes.
    pub systematic: f64,
    /// The part that is noise of the second pass.
    pub noise: f64,
    /// Mean luminance over the judge's, less 1.
    pub mean: f64,
    /// Root mean square error over all pixels, lamps and the judge's noise included.
    pub rmse_all: f64,
    /// Mean CIEDE2000 to the judge, its noise and all,
    pub delta_e_mean: f64,
    /// the 95th percentile,
    pub delta_e_95: f64,
    /// and what the judge's noise alone makes in the mean.
    pub delta_e_judge: f64,
    /// The judge's noise, relative.
    pub judge_noise: f64,
    /// The sensor that is most wrong, if there are any,
    pub worst_sensor: Option<String>,
    /// what it is wrong by, relative,
    pub worst_sensor_error: Option<f64>,
    /// and the judge's noise there.
    pub worst_sensor_judge_noise: Option<f64>,
    /// Of all that the row depends on: an interrupted run goes on where it was.
    pub key: String,
}

impl Row {
    /// The error to go by: where the judge's noise hides it, what it is at most.
    pub fn known_error(&self) -> f64 {
        if self.rmse_low > 0.0 { self.rmse } else { self.rmse_high }
    }
}

/// Marks the rows on the front of processor time and [`Row::known_error`].
pub fn mark_front(rows: &mut [Row]) {
    let points: Vec<[f64; 2]> = rows.iter().map(|r| [r.processor_s, r.known_error()]).collect();
    rows.iter_mut().zip(pareto(&points)).for_each(|(row, on)| row.on_front = on);
}

/// Writes all rows to `path`.
///
/// # Errors
/// [`Error::Io`] when the file cannot be written.
pub fn write(path: &Path, rows: &[Row]) -> Result<()> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).map_err(|e| Error::io(path, e))?;
    }
    let bytes = writer.into_inner().map_err(|e| Error::io(path, e))?;
    atomic_file::write(path, &bytes)
}

/// The rows in `path`; none where there is no such file, or it is not of this form.
pub fn read(path: &Path) -> Vec<Row> {
    let Ok(mut reader) = csv::Reader::from_path(path) else { return Vec::new() };
    reader.deserialize().collect::<std::result::Result<_, _>>().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_survive_a_file_and_the_front_is_marked() {
        let row = |s: f64, rmse: f64, low: f64| Row {
            knob: "points, rung, samples".into(),
            value: "a \"quoted\" value".into(),
            processor_s: s,
            rmse,
            rmse_low: low,
            rmse_high: 2.0 * rmse,
            worst_sensor_error: Some(-0.1),
            ..Row::default()
        };
        // The last is known to be at most 0.02 only.
        let mut rows = vec![row(1.0, 0.1, 0.09), row(2.0, 0.015, 0.01), row(3.0, 0.01, 0.0)];
        mark_front(&mut rows);
        assert_eq!(rows.iter().map(|r| r.on_front).collect::<Vec<_>>(), [true, true, false]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        assert!(read(&path).is_empty());
        write(&path, &rows).unwrap();
        assert_eq!(read(&path), rows);
        std::fs::write(&path, "something,else\n1,2\n").unwrap();
        assert!(read(&path).is_empty());
    }
}

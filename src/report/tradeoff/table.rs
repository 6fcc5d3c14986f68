//! What was measured, as rows of a CSV file that grows row by row and is never seen half written.

use super::error::Errors;
use super::front::pareto;
use crate::atomic_file;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// One trial: what it took, and what it is wrong by. In the file all its figures are columns, in their order.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// What was tried, and what it took.
    #[serde(flatten)]
    pub took: Took,
    /// What it is wrong by.
    #[serde(flatten)]
    pub errors: Errors,
    /// What it was held against.
    #[serde(flatten)]
    pub against: Against,
}

/// What was tried, and what it took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Took {
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
}

/// What a trial was held against.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Against {
    /// Mean CIEDE2000 that the judge's noise alone makes.
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
        if self.errors.rmse_low > 0.0 { self.errors.rmse } else { self.errors.rmse_high }
    }
}

/// Marks the rows on the front of processor time and [`Row::known_error`].
pub fn mark_front(rows: &mut [Row]) {
    let points: Vec<[f64; 2]> = rows.iter().map(|r| [r.took.processor_s, r.known_error()]).collect();
    rows.iter_mut().zip(pareto(&points)).for_each(|(row, on)| row.took.on_front = on);
}

/// Writes all rows to `path`.
///
/// # Errors
/// [`Error::Io`] when the file cannot be written.
pub fn write(path: &Path, rows: &[Row]) -> Result<()> {
    atomic_file::write(path, &text(rows).map_err(|e| Error::io(path, e))?)
}

/// The rows in `path`; none where there is no such file, or it is not of this form.
pub fn read(path: &Path) -> Vec<Row> {
    let Ok(bytes) = std::fs::read(path) else { return Vec::new() };
    parsed(&bytes).unwrap_or_default()
}

fn text(rows: &[Row]) -> std::result::Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for Row { took, errors, against } in rows {
        writer.serialize((took, errors, against))?;
    }
    writer.into_inner().map_err(|e| e.into_error().into())
}

/// The rows of a file whose columns are the same.
fn parsed(bytes: &[u8]) -> std::result::Result<Vec<Row>, csv::Error> {
    let known = text(&[Row::default()])?;
    let mut reader = csv::Reader::from_reader(bytes);
    if reader.headers()? != csv::Reader::from_reader(&known[..]).headers()? {
        return Ok(Vec::new());
    }
    let row = |record: std::result::Result<csv::StringRecord, csv::Error>| {
        // By place, for the columns of all three parts are in one line.
        let (took, errors, against) = record?.deserialize(None)?;
        Ok(Row { took, errors, against })
    };
    reader.records().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_survive_a_file_and_the_front_is_marked() {
        let row = |s: f64, rmse: f64, low: f64| Row {
            took: Took {
                knob: "points, rung, samples".into(),
                value: "a \"quoted\" value".into(),
                processor_s: s,
                ..Took::default()
            },
            errors: Errors { rmse, rmse_low: low, rmse_high: 2.0 * rmse, ..Errors::default() },
            // A key of digits alone is no number.
            against: Against { worst_sensor_error: Some(-0.1), key: "0123".into(), ..Against::default() },
        };
        // The last is known to be at most 0.02 only.
        let mut rows = vec![row(1.0, 0.1, 0.09), row(2.0, 0.015, 0.01), row(3.0, 0.01, 0.0)];
        mark_front(&mut rows);
        assert_eq!(rows.iter().map(|r| r.took.on_front).collect::<Vec<_>>(), [true, true, false]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        assert!(read(&path).is_empty());
        write(&path, &rows).unwrap();
        assert_eq!(read(&path), rows);
        let json = serde_json::to_value(&rows[0]).unwrap();
        assert!(json["rmse_high"] == 0.2 && json["knob"].is_string() && json["key"] == "0123", "{json}");
        std::fs::write(&path, "something,else\n1,2\n").unwrap();
        assert!(read(&path).is_empty());
    }
}

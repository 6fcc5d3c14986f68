//! Readings as a table.

use super::{Illuminance, Reading};
use crate::atomic_file;
use crate::error::Result;
use crate::scene::Sensor;
use crate::spectrum::Wavelengths;
use std::fmt::Write;
use std::path::Path;

/// One line of the table.
#[derive(Clone, Debug)]
pub struct Row<'a> {
    /// The sensor.
    pub sensor: &'a Sensor,
    /// Its place in a grid, from 0; `None` for a single sensor.
    pub cell: Option<[u32; 2]>,
    /// What it read.
    pub reading: &'a Reading,
}

/// Writes readings as CSV: one header line with units, then a line for each sensor; LF ends lines. The
/// file appears whole or not at all.
///
/// # Errors
/// [`crate::error::Error::Io`] when the file cannot be written.
pub fn write_csv(path: &Path, rows: &[Row], wavelengths: &Wavelengths) -> Result<()> {
    atomic_file::write(path, table(rows, wavelengths).as_bytes())
}

fn table(rows: &[Row], wavelengths: &Wavelengths) -> String {
    let mut text = String::from("name,grid_u,grid_v,x_m,y_m,z_m,normal_x,normal_y,normal_z");
    let parts = ["", "_direct", "_indirect"];
    let quantities =
        parts.iter().flat_map(|p| [format!("illuminance{p}_lx"), format!("melanopic_edi{p}_lx")]);
    let spectra = parts
        .iter()
        .flat_map(|p| wavelengths.nm.iter().map(move |nm| format!("irradiance{p}_{nm:.1}nm_W_m-2_nm-1")));
    for name in quantities.chain(spectra) {
        text.push(',');
        text.push_str(&name);
    }
    text.push('\n');
    for row in rows {
        text.push_str(&quoted(&row.sensor.name));
        match row.cell {
            Some([u, v]) => push(&mut text, format_args!("{u},{v}")),
            None => push(&mut text, format_args!(",")),
        }
        for x in [row.sensor.position, row.sensor.normal].iter().flat_map(|v| v.to_array()) {
            push(&mut text, format_args!("{x}"));
        }
        let parts = [row.reading.total(), row.reading.direct.clone(), row.reading.indirect()];
        for part in &parts {
            let light = Illuminance::of(part, wavelengths);
            push(&mut text, format_args!("{:.6e}", light.illuminance_lx));
            push(&mut text, format_args!("{:.6e}", light.melanopic_edi_lx));
        }
        for e in parts.iter().flatten() {
            push(&mut text, format_args!("{e:.6e}"));
        }
        text.push('\n');
    }
    text
}

/// One more field.
fn push(text: &mut String, field: std::fmt::Arguments) {
    // Writing to a string cannot fail.
    let _ = write!(text, ",{field}");
}

/// A name as a CSV field.
fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn every_line_has_the_fields_of_the_header() {
        let wavelengths = Wavelengths::meyer4();
        let sensor = Sensor { name: "desk, \"left\"".into(), position: DVec3::ONE, normal: DVec3::Z };
        let reading = Reading { direct: vec![1.0; 4], diffuse: vec![0.5; 4], specular: vec![0.25; 4] };
        let rows = [None, Some([3, 7])].map(|cell| Row { sensor: &sensor, cell, reading: &reading });
        let text = table(&rows, &wavelengths);
        assert!(!text.contains('\r') && text.ends_with('\n'));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 3);
        let fields = lines[0].split(',').count();
        assert_eq!(fields, 9 + 6 + 12);
        let (name, rest) = lines[2].split_at(r#""desk, ""left""""#.len());
        assert_eq!(name, r#""desk, ""left""""#);
        let rest: Vec<&str> = rest.split(',').collect();
        assert_eq!(rest.len(), fields);
        assert_eq!(rest[1..3], ["3", "7"]);
        assert_eq!(rest[15].parse::<f64>().unwrap(), 1.75);
        assert_eq!(rest[fields - 1].parse::<f64>().unwrap(), 0.75);
    }
}

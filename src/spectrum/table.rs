//! Reads the built-in tables: one header line, wavelength in column 1, numbers only.

use super::Spectrum;

/// The columns of a built-in table by header name, all against the first. The tables are part of
/// the program: a malformed one is a defect of the build, which the tests of the library exclude.
pub(super) fn columns(csv: &str) -> Vec<(&str, Spectrum)> {
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|x| x.parse().unwrap_or(f64::NAN)).collect()).collect();
    let column =
        |i: usize| rows.iter().map(|row| row.get(i).copied().unwrap_or(f64::NAN)).collect::<Vec<f64>>();
    (1..header.len())
        .map(|i| {
            let spectrum = Spectrum::tabulated(column(0), column(i));
            (header[i], spectrum.expect("built-in tables are finite and increasing"))
        })
        .collect()
}

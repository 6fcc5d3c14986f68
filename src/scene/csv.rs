//! Columns of numbers against wavelength: one header line, the wavelength in nm in column 1.

use super::source::Source;
use super::suggest;

/// Wavelengths, nm, and the values of one column.
pub type Column = (Vec<f64>, Vec<f64>);

/// The column named `wanted`, or the only one there is.
pub fn column(source: &Source, wanted: Option<&str>) -> std::result::Result<Column, ColumnError> {
    let mut lines = source.text.split_inclusive('\n').scan(0, |offset, line| {
        let start = *offset;
        *offset += line.len();
        Some((start, line))
    });
    let header = lines.next().map_or("", |(_, line)| line);
    let names: Vec<&str> = header.split(',').map(str::trim).skip(1).collect();
    let chosen = match wanted {
        Some(name) => names
            .iter()
            .position(|n| *n == name)
            .ok_or_else(|| ColumnError::Choice(suggest::unknown("column", name, &names)))?,
        None if names.len() == 1 => 0,
        None => {
            let message = format!("name a `column` of the file: {}", names.join(", "));
            return Err(ColumnError::Choice(message));
        }
    };
    let (mut nm, mut values) = (Vec::new(), Vec::new());
    for (start, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let mut fields = line.split(',');
        nm.push(number(source, start, line, fields.next())?);
        values.push(number(source, start, line, fields.nth(chosen))?);
    }
    Ok((nm, values))
}

/// Why a column could not be had.
pub enum ColumnError {
    /// The reference names a column that is not there.
    Choice(String),
    /// The file is wrong.
    File(crate::error::Error),
}

fn number(
    source: &Source,
    start: usize,
    line: &str,
    field: Option<&str>,
) -> std::result::Result<f64, ColumnError> {
    let wrong = |offset: usize, message: String| ColumnError::File(source.error(offset, message));
    let field = field.ok_or_else(|| wrong(start, "this line has too few columns".into()))?;
    let text = field.trim();
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => {
            let inside = field.as_ptr() as usize - line.as_ptr() as usize;
            Err(wrong(start + inside, format!("\"{text}\" is not a finite number")))
        }
    }
}

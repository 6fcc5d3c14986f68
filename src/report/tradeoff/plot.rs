//! Error over time, as SVG and as PNG.

use super::table::Row;
use super::text::Lettered;
use crate::atomic_file;
use crate::error::{Error, Result};
use plotters::coord::Shift;
use plotters::prelude::*;
use std::path::Path;

/// Width and height of the SVG; the PNG has twice as many pixels.
const SIZE: (u32, u32) = (960, 600);

/// What the vertical axis shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// [`Row::known_error`], per cent.
    Luminance,
    /// [`Errors::delta_e_mean`](super::Errors::delta_e_mean).
    Colour,
}

impl Quantity {
    fn of(self, row: &Row) -> f64 {
        match self {
            Quantity::Luminance => 100.0 * row.known_error(),
            Quantity::Colour => row.errors.delta_e_mean,
        }
    }

    /// What the judge's noise hides.
    fn floor(self, row: &Row) -> f64 {
        match self {
            Quantity::Luminance => 0.0,
            Quantity::Colour => row.against.delta_e_judge,
        }
    }

    fn label(self) -> &'static str {
        match self {
            Quantity::Luminance => "error of luminance (root mean square), % of the mean",
            Quantity::Colour => "mean CIEDE2000",
        }
    }
}

/// Draws `rows` to `path` with the extensions svg and png.
///
/// # Errors
/// [`Error::Io`] when a file cannot be written.
pub fn write(path: &Path, title: &str, rows: &[Row], quantity: Quantity) -> Result<()> {
    let (svg, png) = (path.with_extension("svg"), path.with_extension("png"));
    let mut text = String::new();
    draw(SVGBackend::with_string(&mut text, SIZE).into_drawing_area(), 1, title, rows, quantity)
        .map_err(|e| Error::io(&svg, e))?;
    atomic_file::write(&svg, text.as_bytes())?;

    let size = (2 * SIZE.0, 2 * SIZE.1);
    let mut pixels = vec![255; 3 * size.0 as usize * size.1 as usize];
    let area = Lettered(BitMapBackend::with_buffer(&mut pixels, size)).into_drawing_area();
    draw(area, 2, title, rows, quantity).map_err(|e| Error::io(&png, e))?;
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, size.0, size.1);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&pixels)?;
        writer.finish()
    });
    written.map_err(|e| Error::io(&png, e))?;
    atomic_file::write(&png, &bytes)
}

/// Smallest and largest of `values`, with some room about them on a logarithmic axis.
fn range(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = values
        .filter(|x| x.is_finite() && *x > 0.0)
        .fold((f64::INFINITY, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    if low > high { 0.1..10.0 } else { 0.8 * low..1.6 * high }
}

/// As few digits as tell a value on a logarithmic axis.
fn digits(x: &f64) -> String {
    let decimals = (1.0 - x.log10()).floor().clamp(0.0, 6.0) as usize;
    let text = format!("{x:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

type Drawn<DB> = std::result::Result<(), DrawingAreaErrorKind<<DB as DrawingBackend>::ErrorType>>;

/// `unit` is the width of a thin line.
fn draw<DB: DrawingBackend>(
    area: DrawingArea<DB, Shift>,
    unit: i32,
    title: &str,
    rows: &[Row],
    quantity: Quantity,
) -> Drawn<DB> {
    area.fill(&WHITE)?;
    let font = |size: i32| ("sans-serif", size * unit).into_font();
    let (plot, legend) = area.split_horizontally((SIZE.0 as i32 - 230) * unit);
    let mut knobs: Vec<&str> = rows.iter().map(|r| r.took.knob.as_str()).collect();
    knobs.sort_unstable();
    knobs.dedup();
    let colour = |knob: &str| {
        let at = knobs.iter().position(|k| *k == knob).unwrap_or(0);
        HSLColor(at as f64 / knobs.len().max(1) as f64, 0.75, if at % 2 == 0 { 0.42 } else { 0.6 }).to_rgba()
    };
    let seconds = range(rows.iter().map(|r| r.took.processor_s));
    let errors = range(rows.iter().map(|r| quantity.of(r)));
    let mut chart = ChartBuilder::on(&plot)
        .margin(12 * unit)
        .caption(title, font(19))
        .x_label_area_size(44 * unit)
        .y_label_area_size(64 * unit)
        .build_cartesian_2d(seconds.clone().log_scale(), errors.clone().log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(238, 238, 238))
        .bold_line_style(RGBColor(215, 215, 215))
        .x_desc("processor time of graph and both passes, s")
        .y_desc(quantity.label())
        .x_label_formatter(&digits)
        .y_label_formatter(&digits)
        .label_style(font(15))
        .axis_desc_style(font(15))
        .draw()?;

    let place = |row: &Row| (row.took.processor_s, quantity.of(row));
    let drawn = |row: &&Row| {
        let (s, error) = place(row);
        seconds.contains(&s) && errors.contains(&error)
    };
    let points: Vec<[f64; 2]> = rows.iter().map(|r| place(r).into()).collect();
    let mut front: Vec<&Row> = rows
        .iter()
        .zip(super::front::pareto(&points))
        .filter_map(|(row, on)| on.then_some(row))
        .filter(drawn)
        .collect();
    front.sort_by(|a, b| a.took.processor_s.total_cmp(&b.took.processor_s));
    let thin = |width: i32| ShapeStyle {
        color: BLACK.to_rgba(),
        filled: false,
        stroke_width: (width * unit) as u32,
    };
    chart.draw_series(LineSeries::new(front.iter().map(|r| place(r)), thin(1)))?;
    for row in rows.iter().filter(drawn) {
        let fill = ShapeStyle { filled: true, ..colour(&row.took.knob).into() };
        chart.draw_series([Circle::new(place(row), 4 * unit, fill)])?;
    }
    for row in &front {
        chart.draw_series([Circle::new(place(row), 6 * unit, thin(1))])?;
    }
    let floor = rows.iter().map(|r| quantity.floor(r)).fold(0.0, f64::max);
    if errors.contains(&floor) {
        let line = [(seconds.start, floor), (seconds.end, floor)];
        chart.draw_series(LineSeries::new(
            line,
            ShapeStyle::from(RGBColor(150, 150, 150)).stroke_width(unit as u32),
        ))?;
    }

    let line = |k: usize| (28 + 22 * k as i32) * unit;
    for (k, knob) in knobs.iter().enumerate() {
        let fill = ShapeStyle { filled: true, ..colour(knob).into() };
        legend.draw(&Circle::new((10 * unit, line(k) + 6 * unit), 4 * unit, fill))?;
        legend.draw(&Text::new(*knob, (22 * unit, line(k)), font(15)))?;
    }
    let k = knobs.len();
    legend.draw(&Circle::new((10 * unit, line(k) + 6 * unit), 6 * unit, thin(1)))?;
    legend.draw(&Text::new("on the Pareto front", (22 * unit, line(k)), font(15)))?;
    if errors.contains(&floor) {
        legend.draw(&Text::new("grey line: the judge's noise", (4 * unit, line(k + 1)), font(15)))?;
    }
    area.present()
}

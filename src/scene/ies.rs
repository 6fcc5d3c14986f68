//! Luminaires from IES LM-63 files of 1986 to 2019.
//!
//! A file is lines of labels up to the one that begins with `TILT=`, then numbers, apart by blanks, commas and line
//! ends wherever those fall.

use super::source::{MAX_IES_BYTES, Source};
use super::web::{Web, WebType};
use crate::error::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Most angles of one kind.
const MAX_ANGLES: f64 = 2000.0;

/// Metres in a foot.
const FOOT: f64 = 0.3048;

/// What a file says of a luminaire.
#[derive(Clone, Debug, PartialEq)]
pub struct Luminaire {
    /// Its intensities as they are emitted: multiplier and ballast factors are in them.
    pub web: Arc<Web>,
    /// The luminous opening along the plane C = 0 (its length), across it (its width) and upright, m. Of round
    /// openings what is negative in the file is a diameter.
    pub opening: [f64; 3],
    /// Whether the opening is round.
    pub round: bool,
    /// Angles from the position of the photometer, degrees, increasing, and the share of light at each.
    pub tilt: Vec<(f64, f64)>,
}

impl Luminaire {
    /// Reads `path`.
    pub fn read(path: &Path) -> Result<Luminaire> {
        let source = Source::read_latin(path, MAX_IES_BYTES)?;
        let (year, tilt_at, tilt_text, rest) = head(&source)?;
        let mut numbers = Numbers { source: &source, at: rest };
        let tilt = match tilt_text {
            t if t.eq_ignore_ascii_case("NONE") => Vec::new(),
            t if t.eq_ignore_ascii_case("INCLUDE") => tilt(&mut numbers)?,
            name => {
                let beside = path.parent().map(Path::to_path_buf).unwrap_or_default().join(name);
                let file = Source::read_latin(&beside, MAX_IES_BYTES).map_err(|e| match e {
                    Error::Io { message, .. } => source.error(
                        tilt_at,
                        format!("cannot read {}, the tilt file: {message}", beside.display()),
                    ),
                    other => other,
                })?;
                tilt(&mut Numbers { source: &file, at: 0 })?
            }
        };
        luminaire(&mut numbers, year, tilt)
    }

    /// The share of light that lamps give when the luminaire is turned so many degrees from where it was measured.
    pub fn at_tilt(&self, degrees: f64) -> f64 {
        let Some(&(_, first)) = self.tilt.first() else { return 1.0 };
        let after = self.tilt.partition_point(|(angle, _)| *angle <= degrees);
        match (after.checked_sub(1).map(|k| self.tilt[k]), self.tilt.get(after)) {
            (Some((a, x)), Some((b, y))) => x + (y - x) * (degrees - a) / (b - a),
            (Some((_, x)), None) => x,
            _ => first,
        }
    }
}

/// Year of the format; where the word after `TILT=` begins, and the word; where numbers begin.
fn head(source: &Source) -> Result<(u32, usize, &str, usize)> {
    let mut year = 1986;
    let mut start = 0;
    for line in source.text.split_inclusive('\n') {
        let text = line.trim();
        if start == 0 {
            let known = [("2019", 2019), ("2002", 2002), ("1995", 1995), ("1991", 1991), ("IESNA91", 1991)];
            let named = text.to_ascii_uppercase();
            if named.starts_with("IES") {
                year = known.iter().find(|(name, _)| named.contains(name)).map_or(2002, |k| k.1);
            }
        }
        if text.get(..4).is_some_and(|t| t.eq_ignore_ascii_case("TILT"))
            && let Some((_, word)) = text.split_once('=')
        {
            let at = start + line.find('=').unwrap_or(0) + 1;
            let word = word.trim();
            if word.is_empty() {
                return Err(source.error(at, "`TILT=` is followed by NONE, INCLUDE or the name of a file"));
            }
            return Ok((year, at, word, start + line.len()));
        }
        start += line.len();
    }
    let message = "there is no line `TILT=`: this is not a luminaire by IES LM-63";
    Err(source.error(0, message))
}

/// What follows `TILT=INCLUDE`: the lamp's place, and pairs of angles and shares.
fn tilt(numbers: &mut Numbers) -> Result<Vec<(f64, f64)>> {
    numbers.choice("the lamp's position in the luminaire", &[1.0, 2.0, 3.0])?;
    let count = numbers.count("the number of tilt angles")?;
    let at = numbers.next_at();
    let angles = numbers.list(count, "a tilt angle", -180.0..=180.0)?;
    let shares = numbers.list(count, "a tilt factor", 0.0..=1e3)?;
    numbers.increasing(at, &angles, "tilt angles")?;
    Ok(angles.into_iter().zip(shares).collect())
}

fn luminaire(numbers: &mut Numbers, year: u32, tilt: Vec<(f64, f64)>) -> Result<Luminaire> {
    let lamps = numbers.within("the number of lamps", 0.0..=1e6)?;
    let lumens = numbers.within("the lumens of a lamp (-1: absolute photometry)", -1.0..=1e9)?;
    let multiplier = numbers.within("the multiplier of the candela values", 0.0..=1e9)?;
    let v_count = numbers.count("the number of vertical angles")?;
    if v_count < 2 {
        return Err(numbers.before("there are at least two vertical angles"));
    }
    let h_count = numbers.count("the number of horizontal angles")?;
    let kind = match numbers.choice("the photometric type (1: C, 2: B, 3: A)", &[1.0, 2.0, 3.0])? {
        1.0 => WebType::C,
        2.0 => WebType::B,
        _ => WebType::A,
    };
    let unit = numbers.choice("the unit of length (1: feet, 2: metres)", &[1.0, 2.0])?;
    let unit = if unit == 1.0 { FOOT } else { 1.0 };
    let mut size = || numbers.within("a dimension of the luminous opening", -1e4..=1e4);
    let [width, length, height] = [size()?, size()?, size()?];
    let ballast = numbers.within("the ballast factor", 0.0..=1e6)?;
    let second = numbers.within("the ballast-lamp factor", 0.0..=1e6)?;
    // From 2002 on it is no factor: reserved, then the kind of test.
    let second = if year < 2002 { second } else { 1.0 };
    numbers.within("the input power, W,", -1e9..=1e9)?;
    let v_at = numbers.next_at();
    let vertical = numbers.list(v_count, "a vertical angle", -90.0..=180.0)?;
    numbers.increasing(v_at, &vertical, "vertical angles")?;
    let h_at = numbers.next_at();
    let horizontal = numbers.list(h_count, "a horizontal angle", -90.0..=360.0)?;
    numbers.increasing(h_at, &horizontal, "horizontal angles")?;
    let factor = multiplier * ballast * second;
    let candela: Vec<f64> = numbers
        .list(v_count * h_count, "a candela value", 0.0..=1e12)?
        .into_iter()
        .map(|i| i * factor)
        .collect();
    let lamps_lm = (lumens >= 0.0).then_some(lamps * lumens);
    let web = Web::new(kind, vertical, horizontal, candela, lamps_lm)
        .map_err(|(message, h)| numbers.source.error(if h { h_at } else { v_at }, message))?;
    // A round opening has diameters below zero; where one is 0 both are the same.
    let round = width < 0.0 || length < 0.0;
    let [mut width, mut length, height] = [width, length, height].map(|x| x.abs() * unit);
    if round {
        (width, length) =
            (if width > 0.0 { width } else { length }, if length > 0.0 { length } else { width });
    }
    Ok(Luminaire { web: Arc::new(web), opening: [length, width, height], round, tilt })
}

/// Numbers one after the other.
struct Numbers<'a> {
    source: &'a Source,
    /// Where the next one is looked for.
    at: usize,
}

impl Numbers<'_> {
    /// Where the next number begins.
    fn next_at(&self) -> usize {
        let apart = |c: char| c.is_whitespace() || c == ',' || c == ';' || c == '\0' || c == '\u{1a}';
        let rest = &self.source.text[self.at..];
        self.at + rest.find(|c| !apart(c)).unwrap_or(rest.len())
    }

    fn next(&mut self, what: &str) -> Result<(f64, usize)> {
        let start = self.next_at();
        let rest = &self.source.text[start..];
        let end = rest.find(|c: char| c.is_whitespace() || ",;\0\u{1a}".contains(c)).unwrap_or(rest.len());
        let word = &rest[..end];
        if word.is_empty() {
            return Err(self.source.error(start, format!("the file ends where {what} should be")));
        }
        self.at = start + end;
        match word.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok((value, start)),
            _ => Err(self
                .source
                .error(start, format!("\"{}\" is no number: {what} was expected", shown(word)))),
        }
    }

    fn within(&mut self, what: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64> {
        let (value, at) = self.next(what)?;
        if range.contains(&value) {
            return Ok(value);
        }
        let message = format!("{what} lies between {} and {}; this is {value}", range.start(), range.end());
        Err(self.source.error(at, message))
    }

    fn choice(&mut self, what: &str, values: &[f64]) -> Result<f64> {
        let (value, at) = self.next(what)?;
        if values.contains(&value) {
            return Ok(value);
        }
        let values: Vec<String> = values.iter().map(f64::to_string).collect();
        Err(self.source.error(at, format!("{what} is one of {}; this is {value}", values.join(", "))))
    }

    fn count(&mut self, what: &str) -> Result<usize> {
        let (value, at) = self.next(what)?;
        if value.fract() == 0.0 && (1.0..=MAX_ANGLES).contains(&value) {
            return Ok(value as usize);
        }
        let message = format!("{what} is a whole number from 1 to {MAX_ANGLES}; this is {value}");
        Err(self.source.error(at, message))
    }

    fn list(&mut self, count: usize, what: &str, range: std::ops::RangeInclusive<f64>) -> Result<Vec<f64>> {
        (0..count).map(|_| self.within(what, range.clone())).collect()
    }

    fn increasing(&self, at: usize, values: &[f64], what: &str) -> Result<()> {
        if values.windows(2).all(|w| w[0] < w[1]) {
            return Ok(());
        }
        Err(self.source.error(at, format!("{what} increase from one to the next")))
    }

    /// An error about the last number.
    fn before(&self, message: &str) -> Error {
        self.source.error(self.at.saturating_sub(1), message)
    }
}

/// The start of a word that may be very long.
fn shown(word: &str) -> String {
    word.chars().take(24).collect()
}

//! A target in place of knobs: an image whose luminance is wrong by no more than asked, or as little wrong as a time
//! allows.
//!
//! Points are refined level by level, four times as many each time. A small image of the view at every level tells by
//! how much the last refinement changed it, and so what a further one would; the error that is left is estimated from that
//! ([`Estimate`]). The image itself is the mean of two of different seeds: what they differ by is its noise.

mod estimate;
mod look;
mod search;

pub use estimate::Estimate;
pub use search::{Reached, Step, render};

use crate::error::{Error, Result};
use crate::share;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A root mean square error of luminance, of the mean luminance, both over the pixels that show no lamp.
    Error(f64),
    /// A wall time, s, from the beginning of [`render`] on.
    Within(f64),
}

/// Knobs that are left as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fixed {
    /// The rung of the second pass.
    pub rung: bool,
    /// The wavelengths.
    pub wavelengths: bool,
}

impl Target {
    /// An error from `2%` or `0.02`.
    ///
    /// # Errors
    /// Those of [`share::parse`].
    pub fn parse_error(text: &str) -> Result<Self> {
        Ok(Target::Error(share::parse("an error", text)?))
    }

    /// A time from `30s`, `2min` or `30`, seconds.
    ///
    /// # Errors
    /// [`Error::Settings`] for anything but a time from 0.1 s to 10 days.
    pub fn parse_time(text: &str) -> Result<Self> {
        let trimmed = text.trim();
        let units = [("min", 60.0), ("h", 3600.0), ("s", 1.0), ("", 1.0)];
        let (number, unit) = units
            .iter()
            .find_map(|(name, unit)| Some((trimmed.strip_suffix(name)?, *unit)))
            .unwrap_or((trimmed, 1.0));
        match number.trim().parse::<f64>().map(|x| x * unit) {
            Ok(s) if (0.1..=864_000.0).contains(&s) => Ok(Target::Within(s)),
            _ => Err(Error::Settings(format!(
                "a time of {text}: give one from 0.1s on, such as 30s, 2min or 1h"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_times_as_typed() {
        assert_eq!(Target::parse_error("2%").unwrap(), Target::Error(0.02));
        assert_eq!(Target::parse_error("0.05").unwrap(), Target::Error(0.05));
        assert_eq!(Target::parse_time("30s").unwrap(), Target::Within(30.0));
        assert_eq!(Target::parse_time("1.5 min").unwrap(), Target::Within(90.0));
        assert_eq!(Target::parse_time("7").unwrap(), Target::Within(7.0));
        for wrong in ["", "s", "0s", "-3s", "nan", "inf h", "soon"] {
            assert!(Target::parse_time(wrong).is_err(), "{wrong}");
        }
    }
}

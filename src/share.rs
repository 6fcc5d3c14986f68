//! Shares as they are typed.

use crate::error::{Error, Result};

/// A share from `2%` or `0.02`; `what` is it of, for the message.
///
/// # Errors
/// [`Error::Settings`] for anything but a share from 0.01 % on and below 100 %.
pub fn parse(what: &str, text: &str) -> Result<f64> {
    let (number, unit) = match text.trim().strip_suffix('%') {
        Some(number) => (number, 0.01),
        None => (text, 1.0),
    };
    match number.trim().parse::<f64>().map(|x| x * unit) {
        Ok(share) if (1e-4..1.0).contains(&share) => Ok(share),
        _ => Err(Error::Settings(format!("{what} of {text}: give a share from 0.01% to 100%, such as 2%"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_as_typed() {
        assert_eq!(parse("an error", "2%").unwrap(), 0.02);
        assert_eq!(parse("an error", " 0.05").unwrap(), 0.05);
        for wrong in ["", "%", "0%", "-1%", "100%", "nan", "inf", "two"] {
            assert!(parse("an error", wrong).is_err(), "{wrong}");
        }
    }
}

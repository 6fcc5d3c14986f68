//! Tables of expected values, made outside this program; `data/README.md` says how.

use crate::error::{Error, Result};
use serde::de::DeserializeOwned;

/// Reads one of the JSON tables that are built in.
pub fn table<T: DeserializeOwned>(text: &str) -> Result<T> {
    serde_json::from_str(text)
        .map_err(|e| Error::Numerical(format!("a built-in table of expected values is damaged: {e}")))
}

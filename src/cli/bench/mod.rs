//! `luxgraph bench`

mod growth;
mod paper;

pub use growth::run as growth;
pub use paper::paper;

//! `luxgraph bench`

mod growth;
mod paper;
mod stages;

pub use growth::run as growth;
pub use paper::paper;
pub use stages::run as stages;

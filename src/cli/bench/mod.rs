//! `luxgraph bench`

mod growth;
mod linked;
mod paper;
mod stages;

pub use growth::run as growth;
pub use linked::run as linked;
pub use paper::paper;
pub use stages::run as stages;

//! Images to files, and images against images.

mod compare;
mod difference;
pub mod exr;
mod linear;
pub mod png;

pub use compare::{Difference, compare};
pub use difference::write_difference;
pub use linear::LinearImage;

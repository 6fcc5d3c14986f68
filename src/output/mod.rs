//! Images to files, and images against images.

mod compare;
pub mod exr;
mod linear;
pub mod png;

pub use compare::{Difference, compare};
pub use linear::LinearImage;

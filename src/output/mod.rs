//! Images to files, and images against images.

pub(crate) mod atomic;
mod compare;
pub mod exr;
mod linear;
pub mod png;

pub use compare::{Difference, compare};
pub use linear::LinearImage;

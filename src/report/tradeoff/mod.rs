//! Accuracy against time: one knob after the other is turned, and what comes out is held against a judge.
//!
//! A [`Trial`] is a setting of the knobs, a [`Row`] what it took and how far it is from the truth. The judge is an
//! image of the unbiased path tracer ([`crate::reference`]) that knows its own noise; [`error`] takes that noise off.

pub mod error;
pub mod front;
pub mod judge;
pub mod knobs;
pub mod plot;
mod sensors;
pub mod table;
mod text;
pub mod trial;

pub use error::{Errors, Judged};
pub use judge::Judge;
pub use knobs::{Trial, trials};
pub use table::{Against, Row, Took};
pub use trial::Bench;

//! Scenes for renderers that we did not write.

pub mod mitsuba;
mod ply;
mod sky;

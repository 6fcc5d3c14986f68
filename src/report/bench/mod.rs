//! Stages beside their ceilings, and how they grow with the number of sample points.

pub mod first_pass;
pub mod graph;
pub mod hall;
pub mod linked;
pub mod moved;
pub mod scale;
pub mod second_pass;
pub mod stages;
pub mod tracers;

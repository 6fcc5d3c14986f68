//! Surfaces that are no polygons, in every stage.

#[path = "../support/furnace.rs"]
mod furnace;
mod patches;
mod round;

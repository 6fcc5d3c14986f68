//! Does the first pass find the diffuse light that physics, and the paper, say?

mod enclosures;
mod form_factors;
#[path = "../support/furnished_room.rs"]
mod furnished_room;
mod lobes;
mod optics;
mod reference;
mod relight;
#[path = "../support/small_scenes.rs"]
mod small_scenes;
mod sweeps;

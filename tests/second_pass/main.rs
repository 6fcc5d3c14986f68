//! Does the view show what the first pass found?

mod closure;
mod cover;
#[path = "../support/folder.rs"]
mod folder;
mod gloss;
mod interpolation;
#[path = "../support/lit.rs"]
mod lit;
mod noise;
mod refine;
mod render;
mod resume;
mod rungs;

//! From a file to a scene: shapes, materials, spectra and lights.

mod daylight;
mod errors;
#[path = "../support/folder.rs"]
mod folder;
mod format;
mod import;
mod lights;
#[path = "../support/lit.rs"]
mod lit;
mod luminaires;
mod materials;
mod paper_room;
mod spectra;

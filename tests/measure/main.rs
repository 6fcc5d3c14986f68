//! What sensors read, and what the path tracer says of the same scenes.

mod brute_force;
#[path = "../support/folder.rs"]
mod folder;
#[path = "../support/lit.rs"]
mod lit;
mod photometry;
mod reference;
#[path = "../support/small_scenes.rs"]
mod small_scenes;
mod specular;

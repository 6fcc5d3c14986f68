//! Who sees whom: the visibility graph, and the links that take its place in large scenes.

mod build;
mod file;
mod links;
#[path = "../support/rooms.rs"]
mod rooms;
#[path = "../support/small_scenes.rs"]
mod small_scenes;
mod update;

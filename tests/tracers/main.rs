//! Do the ray tracers find what is there?

mod adversarial;
mod crosscheck;
mod embree;
mod embree4_sys;
#[path = "../support/furnished_room.rs"]
mod furnished_room;
#[path = "../support/strewn_room.rs"]
mod strewn_room;
mod suite;
mod voxel_margin;
mod voxel_subdivision;

//! Does the whole program keep its answers where arithmetic is strained: huge, tiny and far scenes, thin
//! and long shapes, surfaces that touch, dim and bright light, hard glass, and scenes with hardly anything
//! in them? Each test prints a table with `--nocapture`; every radiance on the way is checked to be a number
//! that is not negative.

mod chaos;
mod glass_and_metal;
mod lit;
mod model;
mod odd_scenes;
mod shapes;
mod sizes;
mod strengths;
mod sums;
mod table;

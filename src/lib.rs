//! luxgraph computes the light in a scene in two passes over a visibility graph, after
//! K. Bouatouch and P. Tellier, *A Two-Pass Physics-Based Global Lighting Model*,
//! Graphics Interface 1992 ("the paper" below).
//!
//! The way the data goes is one line, and [`pipeline`] spells it out:
//!
//! ```text
//! scene file -> Scene {geometry | appearance} -> SamplePoints -> VisibilityGraph
//!   -> first pass -> DiffuseSolution -> second pass -> SpectralImage -> files
//!                                    -> measure -> Readings -> files
//! ```
//!
//! # Conventions
//!
//! * Metres, seconds, nanometres, watts. Radiance is W m⁻² sr⁻¹ nm⁻¹ per wavelength sample;
//!   lux and cd m⁻² use 683 lm/W.
//! * Scene files speak world coordinates. A compiled scene is centred: every vertex, and
//!   every other place that a surface is made of, is stored relative to the centre of the scene's bounds and lies on
//!   the `f32` lattice, so all ray tracers and the exact judge see the very same surfaces.
//! * Normals are unit and point to the front (counter-clockwise) side. Surfaces reflect and emit
//!   from the front and block from both, unless they are `two_sided`: then sample points lie on both.
//! * Directions at a surface point away from it.
//! * Results are the same bits for any number of threads.
//!
//! # Glossary: the paper's symbols and where they live
//!
//! | paper | meaning | here |
//! |---|---|---|
//! | P_i, δS_i | sample point and the area it stands for | [`points::SamplePoints`] |
//! | h_ij | visibility between two points | [`visibility::VisibilityGraph`] |
//! | G_ki, FF | geometric term, form factor | `first_pass::form_factor` |
//! | EFF_ji | extended form factor | `first_pass` |
//! | L^E, L^d | emitted and global diffuse radiance | [`first_pass::DiffuseSolution`] |
//! | R^d, R^s, s, d, m | diffuse and specular reflectance, their shares, roughness | [`material`] |
//! | F(λ, θ) | Fresnel factor | `material::fresnel` |
//! | D, G | Beckmann distribution, masking and shadowing | `material::microfacet` |
//! | SI | spatial index of the voxels | [`voxels`] |
//! | buf-int | the last blocker between two voxels | `visibility::pairs` |
//! | lg, lgmax, EFFMIN | length and limits of specular chains | [`first_pass`] |
#![deny(missing_docs)]
#![deny(unsafe_code)]
#![deny(rustdoc::broken_intra_doc_links)]

mod atomic_file;
pub mod colour;
pub mod error;
pub mod export;
pub mod first_pass;
pub mod geometry;
pub mod material;
pub mod measure;
pub mod observer;
pub mod output;
pub mod pipeline;
pub mod points;
pub mod reference;
pub mod report;
pub mod scene;
pub mod second_pass;
mod sets;
pub mod settings;
pub mod share;
mod simd;
pub mod spectrum;
pub mod target;
pub mod tracers;
pub mod validate;
pub mod visibility;
pub mod voxels;

//! From XYZ to what a screen shows and to what an eye tells apart.
//!
//! All functions are plain formulas on `[f64; 3]`: finite in, finite out.

mod lab;
mod srgb;
mod uplift;

pub use lab::{delta_e_76, delta_e_2000, lab};
pub use srgb::{
    D65_WHITE, decode_srgb, encode_srgb, encode_srgb_u8, linear_srgb_luminance, linear_srgb_to_xyz,
    xyz_to_linear_srgb,
};
pub use uplift::{radiance_of_srgb, reflectance_of_srgb};

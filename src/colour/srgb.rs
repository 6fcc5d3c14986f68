//! The sRGB primaries and transfer function (IEC 61966-2-1).

/// XYZ of the sRGB white, chromaticity (0.3127, 0.3290), Y = 1.
pub const D65_WHITE: [f64; 3] = [0.3127 / 0.3290, 1.0, (1.0 - 0.3127 - 0.3290) / 0.3290];

/// From XYZ to linear sRGB: of the primaries (0.64, 0.33) (0.30, 0.60) (0.15, 0.06) and the white above.
const FROM_XYZ: [[f64; 3]; 3] = [
    [3.2409699419045213, -1.5373831775700932, -0.4986107602930032],
    [-0.9692436362808794, 1.8759675015077202, 0.04155505740717556],
    [0.055630079696993594, -0.20397695888897646, 1.0569715142428784],
];

/// Its inverse.
const TO_XYZ: [[f64; 3]; 3] = [
    [0.41239079926595934, 0.357584339383878, 0.1804807884018343],
    [0.21263900587151027, 0.715168678767756, 0.07219231536073371],
    [0.01933081871559182, 0.11919477979462598, 0.9505321522496607],
];

fn times(matrix: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|r| matrix[r][0] * v[0] + matrix[r][1] * v[1] + matrix[r][2] * v[2])
}

/// Linear sRGB of XYZ, in the same unit: white of Y = 1 is (1, 1, 1). Colours outside the gamut
/// have negative components.
pub fn xyz_to_linear_srgb(xyz: [f64; 3]) -> [f64; 3] {
    times(&FROM_XYZ, xyz)
}

/// XYZ of linear sRGB, in the same unit.
pub fn linear_srgb_to_xyz(rgb: [f64; 3]) -> [f64; 3] {
    times(&TO_XYZ, rgb)
}

/// Y of linear sRGB, in the same unit.
pub fn linear_srgb_luminance(rgb: [f64; 3]) -> f64 {
    linear_srgb_to_xyz(rgb)[1]
}

/// The sRGB transfer function of one linear component; not clamped, odd about 0.
pub fn encode_srgb(linear: f64) -> f64 {
    let x = linear.abs();
    let encoded = if x <= 0.0031308 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    encoded.copysign(linear)
}

/// The linear component of an encoded one; inverse of [`encode_srgb`].
pub fn decode_srgb(encoded: f64) -> f64 {
    let x = encoded.abs();
    let linear = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    linear.copysign(encoded)
}

/// One linear component as a byte: clamped to 0..=255, rounded to nearest.
pub fn encode_srgb_u8(linear: f64) -> u8 {
    (255.0 * encode_srgb(linear)).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_matrices_are_inverse_and_agree_on_white() {
        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, 0.2, 0.9]] {
            let back = xyz_to_linear_srgb(linear_srgb_to_xyz(axis));
            assert!((0..3).all(|c| (back[c] - axis[c]).abs() < 1e-12), "{back:?}");
        }
        let white = linear_srgb_to_xyz([1.0; 3]);
        assert!((0..3).all(|c| (white[c] - D65_WHITE[c]).abs() < 1e-12), "{white:?}");
        // The red primary has its chromaticity.
        let [x, y, z] = linear_srgb_to_xyz([1.0, 0.0, 0.0]);
        assert!((x / (x + y + z) - 0.64).abs() < 1e-12 && (y / (x + y + z) - 0.33).abs() < 1e-12);
    }

    #[test]
    fn encoding_and_decoding_are_inverse() {
        for i in -50..=200 {
            let x = f64::from(i) / 100.0;
            assert!((decode_srgb(encode_srgb(x)) - x).abs() < 1e-6, "{x}");
        }
        assert_eq!([0.0, 1.0, 2.0, -1.0, 0.2158605].map(encode_srgb_u8), [0, 255, 255, 0, 128]);
    }
}

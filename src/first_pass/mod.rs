//! The first pass (section 3.3): the global diffuse radiance of every sample point.

use crate::spectrum::Wavelengths;

/// L^d of every sample point.
#[derive(Clone, Debug)]
pub struct DiffuseSolution {
    /// What the radiances are sampled at.
    pub wavelengths: Wavelengths,
    /// L^d_i, the emitted radiance included, W m⁻² sr⁻¹ nm⁻¹: `[N][W]`.
    pub radiance: Vec<f32>,
}

impl DiffuseSolution {
    /// L^d of point `i`, `[W]`.
    pub fn of(&self, i: usize) -> &[f32] {
        let w = self.wavelengths.len();
        &self.radiance[i * w..(i + 1) * w]
    }
}

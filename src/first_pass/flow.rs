//! What specular chains bring, and where their flux goes.

/// What the chains bring and where their flux goes. All but the bounce count is linear in the
/// radiance put in; fluxes are W nm⁻¹, `[W]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChainFlow {
    /// Irradiance that reaches every point, W m⁻² nm⁻¹: `[W][N]`.
    pub irradiance: Vec<f32>,
    /// Flux that fell on specular points and entered their specular part, all bounces.
    pub entered: Vec<f64>,
    /// Flux that left them specularly.
    pub left: Vec<f64>,
    /// Flux that left through openings of the scene.
    pub escaped: Vec<f64>,
    /// Flux absorbed inside solids on the way.
    pub medium: Vec<f64>,
    /// Flux still in the chains when they were cut off.
    pub cut_off: Vec<f64>,
    /// Reflections in a row.
    pub bounces: u32,
}

impl ChainFlow {
    /// Adds `factor[k]` times another flow at each wavelength k; the operator is linear. Where there are no chains nothing
    /// is added.
    pub fn add_scaled(&mut self, other: &ChainFlow, factor: &[f64]) {
        if other.irradiance.is_empty() {
            return;
        }
        let n = other.irradiance.len() / factor.len().max(1);
        self.irradiance.resize(other.irradiance.len(), 0.0);
        for (k, &f) in factor.iter().enumerate() {
            for i in k * n..(k + 1) * n {
                self.irradiance[i] += f as f32 * other.irradiance[i];
            }
        }
        let pairs = [
            (&mut self.entered, &other.entered),
            (&mut self.left, &other.left),
            (&mut self.escaped, &other.escaped),
            (&mut self.medium, &other.medium),
            (&mut self.cut_off, &other.cut_off),
        ];
        for (sum, more) in pairs {
            sum.resize(factor.len(), 0.0);
            for (k, &f) in factor.iter().enumerate() {
                sum[k] += f * more[k];
            }
        }
        self.bounces = self.bounces.max(other.bounces);
    }
}

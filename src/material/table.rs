//! The appendix's storage of F(λ, θ), and what it costs in accuracy.

/// "20 seem enough" (the paper's appendix). Measured over the built-in metals and dielectrics and 400 to
/// 700 nm, 20 entries are within 0.047 of the exact factor when equally spaced in angle, 0.022 in cos θ and
/// 0.0045 in √cos θ, which is the spacing here; chromium near grazing incidence is the worst.
pub const PAPER_ENTRIES: usize = 20;

/// Entries that keep every built-in metal and dielectric, and panes of them, within 1e-4 of the exact factor.
pub const DEFAULT_ENTRIES: usize = 128;

/// Beyond this many entries a table gains nothing over the `f32` it is stored in.
const MAX_ENTRIES: usize = 1 << 16;

/// A factor tabulated against the angle of incidence, all wavelengths side by side
/// (the paper's appendix, "Storage of F").
#[derive(Clone, Debug)]
pub struct FresnelTable {
    /// Number of wavelengths, W.
    pub wavelengths: usize,
    /// `[entries][W]`, from normal to grazing incidence, equally spaced in √cos θ from 1 to 0.
    pub values: Vec<f32>,
}

impl FresnelTable {
    /// Tabulates `factor(wavelength, cos θ)`, kept within 0 to 1, at `entries` angles (at least 2, at most
    /// 65,536 are used).
    pub fn new(wavelengths: usize, entries: usize, factor: impl Fn(usize, f64) -> f64) -> Self {
        let last = entries.clamp(2, MAX_ENTRIES) - 1;
        let mut values = Vec::with_capacity((last + 1) * wavelengths);
        for entry in 0..=last {
            let cos_theta = (1.0 - entry as f64 / last as f64).powi(2);
            values.extend((0..wavelengths).map(|w| super::bounded(factor(w, cos_theta), 0.0, 1.0) as f32));
        }
        FresnelTable { wavelengths, values }
    }

    /// Entries per wavelength.
    pub fn entries(&self) -> usize {
        self.values.len() / self.wavelengths
    }

    /// The two neighbouring entries for `cos_theta` (clamped to 0..1) are `slot` and `slot + 1`,
    /// and the value is `(1 - f) a + f b`: returns `(slot, f)`.
    #[inline]
    pub fn slot(&self, cos_theta: f32) -> (usize, f32) {
        let last = self.entries() - 1;
        let x = (1.0 - cos_theta.clamp(0.0, 1.0).sqrt()) * last as f32;
        let slot = (x as usize).min(last - 1);
        (slot, x - slot as f32)
    }

    /// The factor at `cos_theta` for every wavelength, into `out[..W]`.
    #[inline]
    pub fn eval(&self, cos_theta: f32, out: &mut [f32]) {
        let (slot, f) = self.slot(cos_theta);
        let w = self.wavelengths;
        let a = &self.values[slot * w..(slot + 1) * w];
        let b = &self.values[(slot + 1) * w..(slot + 2) * w];
        for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
            *o = a + f * (b - a);
        }
    }
}

/// Where a table strays furthest from what it stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableError {
    /// The largest absolute error of the factor.
    pub max_abs: f64,
    /// Where, degrees from the normal.
    pub at_deg: f64,
}

/// The largest error of `table` against the factor `exact(wavelength, cos θ)`, of all wavelengths, on a grid
/// of 0.05 degrees from 0 to 90.
pub fn table_error(table: &FresnelTable, exact: impl Fn(usize, f64) -> f64) -> TableError {
    let mut worst = TableError { max_abs: 0.0, at_deg: 0.0 };
    let mut found = vec![0.0; table.wavelengths];
    for step in 0..=1800 {
        let at_deg = 0.05 * f64::from(step);
        let cos_theta = at_deg.to_radians().cos();
        table.eval(cos_theta as f32, &mut found);
        for (w, &value) in found.iter().enumerate() {
            let max_abs = (f64::from(value) - exact(w, cos_theta)).abs();
            if max_abs > worst.max_abs {
                worst = TableError { max_abs, at_deg };
            }
        }
    }
    worst
}

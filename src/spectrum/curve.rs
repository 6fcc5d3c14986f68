//! A quantity as a function of wavelength.

use super::standard_observer::nanometres;

/// A quantity as a function of wavelength.
#[derive(Clone, Debug, PartialEq)]
pub enum Spectrum {
    /// The same at every wavelength.
    Constant(f64),
    /// Linear between samples, constant beyond the ends.
    Tabulated {
        /// Wavelengths, nm, increasing.
        nm: Vec<f64>,
        /// Value at each.
        value: Vec<f64>,
    },
}

impl Spectrum {
    /// A table: wavelengths in nm, strictly increasing, and a value at each; two samples or more,
    /// all finite. The error says which rule is broken and where.
    pub fn tabulated(nm: Vec<f64>, value: Vec<f64>) -> Result<Self, String> {
        if nm.len() != value.len() {
            return Err(format!("{} wavelengths but {} values", nm.len(), value.len()));
        }
        if nm.len() < 2 {
            return Err("a tabulated spectrum needs at least two samples".to_string());
        }
        if let Some(i) = (0..nm.len()).find(|&i| !nm[i].is_finite() || !value[i].is_finite()) {
            return Err(format!("sample {} is not a finite number ({}, {})", i + 1, nm[i], value[i]));
        }
        if let Some(w) = nm.windows(2).find(|w| w[0] >= w[1]) {
            return Err(format!("wavelengths must increase, but {} nm follows {} nm", w[1], w[0]));
        }
        Ok(Spectrum::Tabulated { nm, value })
    }

    /// The value at wavelength `nm`.
    pub fn at(&self, nm: f64) -> f64 {
        match self {
            Spectrum::Constant(c) => *c,
            Spectrum::Tabulated { nm: knots, value } => {
                let after = knots.partition_point(|&k| k <= nm);
                match (after.checked_sub(1), after < knots.len()) {
                    (Some(before), true) => {
                        let f = (nm - knots[before]) / (knots[after] - knots[before]);
                        (1.0 - f) * value[before] + f * value[after]
                    }
                    (Some(before), false) => value[before],
                    (None, _) => value.first().copied().unwrap_or(0.0),
                }
            }
        }
    }

    /// The mean over `lo..hi` nm: the exact integral of the piecewise-linear curve over the width.
    /// An empty range gives the value at `lo`.
    pub fn mean(&self, lo: f64, hi: f64) -> f64 {
        let knots = match self {
            Spectrum::Constant(c) => return *c,
            _ if lo.partial_cmp(&hi) != Some(std::cmp::Ordering::Less) => return self.at(lo),
            Spectrum::Tabulated { nm, .. } => nm,
        };
        let inside = &knots[knots.partition_point(|&k| k <= lo)..knots.partition_point(|&k| k < hi)];
        let (mut integral, mut x, mut y) = (0.0, lo, self.at(lo));
        for &next in inside.iter().chain([&hi]) {
            let y_next = self.at(next);
            integral += 0.5 * (y + y_next) * (next - x);
            (x, y) = (next, y_next);
        }
        integral / (hi - lo)
    }

    /// The largest value at any wavelength.
    pub fn max(&self) -> f64 {
        match self {
            Spectrum::Constant(c) => *c,
            Spectrum::Tabulated { value, .. } => value.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// The smallest value at any wavelength.
    pub fn min(&self) -> f64 {
        match self {
            Spectrum::Constant(c) => *c,
            Spectrum::Tabulated { value, .. } => value.iter().copied().fold(f64::INFINITY, f64::min),
        }
    }

    /// The wavelengths between which the spectrum is known, nm; `None` when it is known everywhere.
    pub fn range(&self) -> Option<[f64; 2]> {
        match self {
            Spectrum::Constant(_) => None,
            Spectrum::Tabulated { nm, .. } => Some([*nm.first()?, *nm.last()?]),
        }
    }

    /// Σ factor × spectrum over the visible range, sampled at every nanometre of it; what is negative in
    /// the parts counts as 0.
    pub fn sum<'a>(parts: impl Iterator<Item = (&'a Spectrum, f64)>) -> Spectrum {
        let nm: Vec<f64> = nanometres().collect();
        let mut value = vec![0.0; nm.len()];
        for (spectrum, factor) in parts {
            for (sum, &nm) in value.iter_mut().zip(&nm) {
                *sum += factor * spectrum.over_nanometre(nm).max(0.0);
            }
        }
        Spectrum::Tabulated { nm, value }
    }

    /// The product with f(λ) over the visible range, sampled at every nanometre of it.
    pub fn times(&self, f: impl Fn(f64) -> f64) -> Spectrum {
        let nm: Vec<f64> = nanometres().collect();
        let value = nm.iter().map(|&nm| self.over_nanometre(nm) * f(nm)).collect();
        Spectrum::Tabulated { nm, value }
    }

    /// The value that stands for the nanometre around `nm` in a sum by steps of 1 nm: the value
    /// itself, or the mean over that nanometre where the table is finer than the steps, so that a
    /// narrow line falls between no two of them.
    pub(super) fn over_nanometre(&self, nm: f64) -> f64 {
        let fine = match self {
            Spectrum::Constant(_) => false,
            Spectrum::Tabulated { nm: knots, .. } => {
                let from = knots.partition_point(|&k| k < nm - 0.5);
                knots[from..].windows(2).take_while(|w| w[0] <= nm + 0.5).any(|w| w[1] - w[0] < 1.0)
                    || from
                        .checked_sub(1)
                        .is_some_and(|i| i + 1 < knots.len() && knots[i + 1] - knots[i] < 1.0)
            }
        };
        if fine { self.mean(nm - 0.5, nm + 0.5) } else { self.at(nm) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_not_a_curve() {
        for (nm, value) in [
            (vec![400.0], vec![1.0]),
            (vec![400.0, 500.0], vec![1.0]),
            (vec![400.0, 400.0], vec![1.0, 2.0]),
            (vec![500.0, 400.0], vec![1.0, 2.0]),
            (vec![400.0, f64::INFINITY], vec![1.0, 2.0]),
            (vec![400.0, 500.0], vec![1.0, f64::NAN]),
        ] {
            assert!(Spectrum::tabulated(nm, value).is_err());
        }
    }

    #[test]
    fn is_linear_between_samples_and_constant_beyond() {
        let s = Spectrum::tabulated(vec![400.0, 500.0, 520.0], vec![1.0, 3.0, 0.0]).unwrap();
        for (nm, expected) in
            [(300.0, 1.0), (400.0, 1.0), (450.0, 2.0), (500.0, 3.0), (510.0, 1.5), (900.0, 0.0)]
        {
            assert!((s.at(nm) - expected).abs() < 1e-12, "{nm}");
        }
        assert_eq!((s.min(), s.max(), s.range()), (0.0, 3.0, Some([400.0, 520.0])));
    }

    #[test]
    fn mean_is_the_exact_integral() {
        let s = Spectrum::tabulated(vec![400.0, 500.0, 520.0], vec![1.0, 3.0, 0.0]).unwrap();
        // 10 nm at 1, the ramps 200 and 30, 10 nm at 0.
        assert!((s.mean(390.0, 530.0) - 240.0 / 140.0).abs() < 1e-12);
        assert!((s.mean(420.0, 440.0) - 1.6).abs() < 1e-12);
        assert_eq!(s.mean(450.0, 450.0), 2.0);
        let parts = 0.3 * s.mean(440.0, 470.0) + 0.7 * s.mean(470.0, 540.0);
        assert!((parts - s.mean(440.0, 540.0)).abs() < 1e-12);
    }

    #[test]
    fn a_line_narrower_than_a_nanometre_is_not_lost() {
        let line = Spectrum::tabulated(vec![545.9, 546.05, 546.2], vec![0.0, 10.0, 0.0]).unwrap();
        let sum: f64 = (380..=780).map(|nm| line.over_nanometre(f64::from(nm))).sum();
        assert!((sum - 1.5).abs() < 1e-9, "{sum}");
    }
}

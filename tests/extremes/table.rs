//! The figures of a test: printed as they come, judged together at the end.

use luxgraph::error::Error;

/// Lines of case, expected, found, error and bound.
pub struct Table {
    failures: Vec<String>,
}

impl Table {
    pub fn new(title: &str) -> Self {
        println!("\n{title}");
        println!("{:<58} {:>12} {:>12} {:>10} {:>10}", "case", "expected", "found", "error", "bound");
        Table { failures: Vec::new() }
    }

    fn line(&mut self, case: &str, expected: f64, found: f64, error: f64, bound: f64) {
        let line = format!("{case:<58} {expected:>12.6e} {found:>12.6e} {error:>10.1e} {bound:>10.1e}");
        println!("{line}");
        // Not a number is no success.
        if error.is_nan() || error > bound {
            self.failures.push(line);
        }
    }

    /// `found` must lie within `bound` of `expected`, relative to it (which is not 0).
    pub fn relative(&mut self, case: &str, expected: f64, found: f64, bound: f64) {
        self.line(case, expected, found, (found / expected - 1.0).abs(), bound);
    }

    /// `found` must lie within `bound` of `expected`.
    pub fn absolute(&mut self, case: &str, expected: f64, found: f64, bound: f64) {
        self.line(case, expected, found, (found - expected).abs(), bound);
    }

    /// All of `found` must lie within `bound` of `expected`, relative to it; the worst is shown.
    pub fn all(&mut self, case: &str, expected: f64, found: impl IntoIterator<Item = f64>, bound: f64) {
        let off = |x: f64| if x.is_nan() { f64::INFINITY } else { (x / expected - 1.0).abs() };
        let worst = found.into_iter().max_by(|a, b| off(*a).total_cmp(&off(*b)));
        self.relative(case, expected, worst.unwrap_or(f64::NAN), bound);
    }

    /// There must be an error that speaks of `what`.
    pub fn refused<T>(&mut self, case: &str, answer: Result<T, Error>, what: &str) {
        let text = match answer {
            Ok(_) => "no error".to_owned(),
            Err(error) => error.to_string(),
        };
        println!("{case:<58} refused: {text}");
        if !text.contains(what) {
            self.failures.push(format!("{case}: \"{text}\" does not speak of \"{what}\""));
        }
    }

    /// Fails the test if a line was beyond its bound.
    pub fn judge(self) {
        assert!(self.failures.is_empty(), "beyond the bound:\n{}", self.failures.join("\n"));
    }
}

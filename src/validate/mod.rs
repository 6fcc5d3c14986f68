//! The checks that `luxgraph validate` runs: closed forms, published cases and independent
//! computations in high precision, beside what this program finds.
//!
//! Scenes are made and lit through the library as any user's are. What is expected comes from the
//! source that a case names, never from an earlier run.

mod cie171;
mod colours;
mod cook_torrance;
mod daylight;
mod enclosures;
mod expected;
mod form_factors;
mod fresnel;
mod hollow;
mod luminaire;
mod meyer;
mod model;
mod photometry;
mod shapes;

use crate::error::Result;
use crate::observer::Observer;
use crate::tracers::TracerChoice;
use serde::Serialize;
use std::time::Instant;

/// How far a result may be from what is expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tolerance {
    /// A share of what is expected.
    Relative(f64),
    /// In the unit of the case.
    Absolute(f64),
}

/// One check.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(into = "Line")]
pub struct Case {
    /// What is checked, with its unit.
    pub name: String,
    /// Where the expected value comes from.
    pub source: &'static str,
    /// What it should be.
    pub expected: f64,
    /// What this program finds.
    pub found: f64,
    /// How far apart they may be.
    pub tolerance: Tolerance,
}

impl Case {
    /// The distance from what is expected, as the tolerance counts it.
    pub fn error(&self) -> f64 {
        let distance = (self.found - self.expected).abs();
        match self.tolerance {
            Tolerance::Relative(_) => distance / self.expected.abs(),
            Tolerance::Absolute(_) => distance,
        }
    }

    /// The error as a share of the tolerance; what is not a number has failed.
    pub fn share(&self) -> f64 {
        let (Tolerance::Relative(allowed) | Tolerance::Absolute(allowed)) = self.tolerance;
        let share = self.error() / allowed;
        if share.is_nan() { f64::INFINITY } else { share }
    }

    /// Whether the error is within the tolerance.
    pub fn passes(&self) -> bool {
        self.share() <= 1.0
    }

    /// The case among `pairs` of (expected, found) that is furthest off, for checks of many numbers of
    /// one kind.
    fn worst(
        name: impl Into<String>,
        source: &'static str,
        tolerance: Tolerance,
        pairs: impl IntoIterator<Item = (f64, f64)>,
    ) -> Case {
        let name = name.into();
        let case = |(expected, found)| Case { name: name.clone(), source, expected, found, tolerance };
        let none = case((f64::NAN, f64::NAN));
        pairs.into_iter().map(case).reduce(|a, b| if b.share() > a.share() { b } else { a }).unwrap_or(none)
    }
}

/// A case as reports have it.
#[derive(Serialize)]
struct Line {
    name: String,
    source: &'static str,
    expected: f64,
    found: f64,
    error: f64,
    tolerance: f64,
    relative: bool,
    pass: bool,
}

impl From<Case> for Line {
    fn from(case: Case) -> Line {
        let (Tolerance::Relative(tolerance) | Tolerance::Absolute(tolerance)) = case.tolerance;
        Line {
            error: case.error(),
            tolerance,
            relative: matches!(case.tolerance, Tolerance::Relative(_)),
            pass: case.passes(),
            name: case.name,
            source: case.source,
            expected: case.expected,
            found: case.found,
        }
    }
}

/// Checks of one subject.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// The subject.
    pub title: &'static str,
    /// Its checks.
    pub cases: Vec<Case>,
    /// How long they took, s.
    pub wall_s: f64,
}

impl Group {
    /// How many checks pass.
    pub fn passed(&self) -> usize {
        self.cases.iter().filter(|c| c.passes()).count()
    }

    /// The check nearest to its tolerance, or furthest beyond it.
    pub fn worst(&self) -> Option<&Case> {
        self.cases.iter().reduce(|a, b| if b.share() > a.share() { b } else { a })
    }
}

/// Runs all checks with the rays answered by `tracer`; the observer counts the groups.
///
/// # Errors
/// Those of the pipeline: a check that cannot be carried out at all is no check.
pub fn run(tracer: TracerChoice, observer: &dyn Observer) -> Result<Vec<Group>> {
    type Checks = fn(TracerChoice) -> Result<Vec<Case>>;
    let subjects: [(&'static str, Checks); 11] = [
        ("Form factors", form_factors::run),
        ("CIE 171:2006, analytical cases", cie171::run),
        ("Furnaces and enclosures", enclosures::run),
        ("Photometry", photometry::run),
        ("Luminaires by their tables", luminaire::run),
        ("Sun and sky", daylight::run),
        ("Cook-Torrance reflection", |_| cook_torrance::run()),
        ("Fresnel factors", |_| fresnel::run()),
        ("Colours", |_| colours::run()),
        ("Four wavelengths: colour error of Meyer's rule", |_| meyer::run()),
        ("Metals", |_| colours::metals()),
    ];
    observer.begin("validate", subjects.len() as u64);
    let groups = subjects.into_iter().map(|(title, checks)| {
        let clock = Instant::now();
        let cases = checks(tracer)?;
        observer.advance(1);
        Ok(Group { title, cases, wall_s: clock.elapsed().as_secs_f64() })
    });
    let groups = groups.collect();
    observer.end();
    groups
}

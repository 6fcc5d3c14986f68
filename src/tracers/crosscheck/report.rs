//! What a crosscheck found: counts per class of ray, and the disagreements themselves.

use super::probes::{Probe, ProbeClass};
use crate::geometry::Hit;
use crate::tracers::judge::{EDGE_ULPS, END_ULPS};
use serde::Serialize;
use std::fmt;

/// At most this many disagreements are kept, those that are somebody's error first (some 300 MB, however many
/// rays are asked about); all are counted.
pub const MAX_LISTED: usize = 1_000_000;

/// Of the disagreements within rounding, the text of a report shows this many.
const SHOWN: usize = 20;

/// What the tracers were asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// Is the segment blocked?
    Blocked,
    /// Which surface does the ray meet first?
    Closest,
}

/// One question on which the tracers differ, or agree and are certainly wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Disagreement {
    /// Number of the ray.
    pub ray: u64,
    /// Kind of ray.
    pub class: ProbeClass,
    /// What was asked.
    pub question: Question,
    /// Start, local coordinates, m.
    pub from: [f32; 3],
    /// End (for the closest hit: a point on the ray), m.
    pub to: [f32; 3],
    /// What each tracer said.
    pub answers: Vec<String>,
    /// For each tracer, whether it is wrong beyond rounding.
    pub wrong: Vec<bool>,
    /// The judge's answer: what blocks in exact arithmetic, or all defensible closest surfaces. Empty: nothing.
    pub judged: Vec<u32>,
    /// For a segment that grazes: how far the nearest decision is from changing, m.
    pub clearance_m: Option<f64>,
}

impl Disagreement {
    /// About `probe`, with nothing said yet.
    pub(super) fn about(probe: &Probe, question: Question) -> Self {
        Disagreement {
            ray: probe.index,
            class: probe.class,
            question,
            from: probe.segment.from.to_array(),
            to: probe.segment.to.to_array(),
            answers: Vec::new(),
            wrong: Vec::new(),
            judged: Vec::new(),
            clearance_m: None,
        }
    }

    /// Whether some tracer is wrong beyond rounding.
    pub fn is_error(&self) -> bool {
        self.wrong.contains(&true)
    }
}

/// Counts for one class of ray.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClassCounts {
    /// The class.
    pub class: ProbeClass,
    /// Rays asked about, each with both questions.
    pub rays: u64,
    /// Segments on which the tracers differ within rounding.
    pub blocked_grazing: u64,
    /// Closest hits on which the tracers differ within rounding, or that coincide.
    pub closest_grazing: u64,
    /// Per tracer: questions answered wrongly beyond rounding.
    pub errors: Vec<u64>,
}

/// The report of a crosscheck.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CrosscheckReport {
    /// Names of the tracers, in the order of all lists.
    pub tracers: Vec<String>,
    /// The seed.
    pub seed: u64,
    /// Rays asked about.
    pub rays: u64,
    /// All disagreements, listed or not.
    pub disagreements: u64,
    /// Of these, those that are some tracer's error.
    pub errors: u64,
    /// Largest distance, across the surface's plane, between the points that tracers give for the same surface on the
    /// same ray, m.
    pub largest_t_difference_m: f64,
    /// Counts by class.
    pub classes: Vec<ClassCounts>,
    /// All disagreements up to [`MAX_LISTED`], errors first, else in the order of their rays.
    pub listed: Vec<Disagreement>,
}

impl CrosscheckReport {
    /// How many disagreements its text leaves out.
    pub fn not_shown(&self) -> u64 {
        self.disagreements - self.shown().count() as u64
    }

    /// The disagreements that its text shows: the errors, and the first of the others.
    fn shown(&self) -> impl Iterator<Item = &Disagreement> {
        let errors = self.listed.iter().filter(|d| d.is_error()).count();
        self.listed.iter().take(errors + SHOWN)
    }

    /// The report of all that `total` counted.
    pub(super) fn new(tracers: Vec<String>, seed: u64, total: Tally) -> Self {
        let errors_first = total.errors.into_iter().chain(total.grazing);
        CrosscheckReport {
            tracers,
            seed,
            rays: total.classes.iter().map(|c| c.rays).sum(),
            disagreements: total.disagreements,
            errors: total.error_count,
            largest_t_difference_m: total.largest_t_difference,
            listed: errors_first.take(MAX_LISTED).collect(),
            classes: total.classes,
        }
    }
}

/// The counts of some of the rays.
pub(super) struct Tally {
    classes: Vec<ClassCounts>,
    disagreements: u64,
    error_count: u64,
    errors: Vec<Disagreement>,
    grazing: Vec<Disagreement>,
    largest_t_difference: f64,
}

impl Tally {
    pub fn new(tracers: usize) -> Self {
        let counts = |class| ClassCounts {
            class,
            rays: 0,
            blocked_grazing: 0,
            closest_grazing: 0,
            errors: vec![0; tracers],
        };
        Tally {
            classes: ProbeClass::ALL.map(counts).to_vec(),
            disagreements: 0,
            error_count: 0,
            errors: Vec::new(),
            grazing: Vec::new(),
            largest_t_difference: 0.0,
        }
    }

    pub fn count_ray(&mut self, class: ProbeClass) {
        self.classes[class as usize].rays += 1;
    }

    /// Compares where the tracers meet the surface on which they agree; `speed` is how fast the ray parameter
    /// moves away from its plane, m.
    pub fn measure_t(&mut self, answers: &[Option<Hit>], speed: f64) {
        let t = answers.iter().flatten().map(|h| h.t);
        let (low, high) = t.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(t), h.max(t)));
        if high > low {
            self.largest_t_difference = self.largest_t_difference.max((high - low) * speed);
        }
    }

    pub fn count_disagreement(&mut self, disagreement: Disagreement) {
        let counts = &mut self.classes[disagreement.class as usize];
        self.disagreements += 1;
        let list = if disagreement.is_error() {
            self.error_count += 1;
            for (count, &wrong) in counts.errors.iter_mut().zip(&disagreement.wrong) {
                *count += u64::from(wrong);
            }
            &mut self.errors
        } else {
            match disagreement.question {
                Question::Blocked => counts.blocked_grazing += 1,
                Question::Closest => counts.closest_grazing += 1,
            }
            &mut self.grazing
        };
        list.push(disagreement);
    }

    /// Adds the counts of the rays that follow, and as much of their lists as may be kept.
    pub fn add(&mut self, other: Tally) {
        for (mine, its) in self.classes.iter_mut().zip(other.classes) {
            mine.rays += its.rays;
            mine.blocked_grazing += its.blocked_grazing;
            mine.closest_grazing += its.closest_grazing;
            for (mine, its) in mine.errors.iter_mut().zip(its.errors) {
                *mine += its;
            }
        }
        self.disagreements += other.disagreements;
        self.error_count += other.error_count;
        self.errors.extend(other.errors);
        self.errors.truncate(MAX_LISTED);
        self.grazing.extend(other.grazing);
        self.grazing.truncate(MAX_LISTED - self.errors.len());
        self.largest_t_difference = self.largest_t_difference.max(other.largest_t_difference);
    }
}

impl fmt::Display for CrosscheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} rays, each asked twice (blocked? what first?), seed {}", self.rays, self.seed)?;
        let names = self.tracers.join(", ");
        writeln!(f, "tracers: {names}; errors beyond rounding are counted for each in this order")?;
        writeln!(
            f,
            "grazing: hangs on an edge nearer than {EDGE_ULPS} or an end nearer than {END_ULPS} units in the last place (f32); \
             all else is an error"
        )?;
        writeln!(
            f,
            "{:<16} {:>10} {:>14} {:>14}  errors",
            "class", "rays", "grazing block", "grazing first"
        )?;
        for c in &self.classes {
            let class = name(&c.class);
            let errors: Vec<String> = c.errors.iter().map(u64::to_string).collect();
            let errors = errors.join(" ");
            writeln!(
                f,
                "{class:<16} {:>10} {:>14} {:>14}  {errors}",
                c.rays, c.blocked_grazing, c.closest_grazing
            )?;
        }
        for d in self.shown() {
            writeln!(f, "{d}")?;
        }
        if self.not_shown() > 0 {
            writeln!(f, "  ... and {} more", self.not_shown())?;
        }
        writeln!(
            f,
            "{} disagreements, {} of them errors; where tracers agree on the surface their points differ by at most {:.1e} m",
            self.disagreements, self.errors, self.largest_t_difference_m
        )
    }
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = if self.is_error() { "ERROR" } else { "grazing" };
        let judged = match &self.judged[..] {
            [] => "free".to_owned(),
            surfaces => surfaces.iter().map(|s| format!("surface {s}")).collect::<Vec<_>>().join(" or "),
        };
        write!(
            f,
            "  ray {} {} {}: {} | exact: {judged} | {verdict}",
            self.ray,
            name(&self.class),
            name(&self.question),
            self.answers.join(" / ")
        )?;
        if let Some(clearance) = self.clearance_m {
            write!(f, ", decided by {clearance:.1e} m")?;
        }
        write!(f, " | {:?} -> {:?}", self.from, self.to)
    }
}

/// The name a class or question has in the JSON report.
fn name(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

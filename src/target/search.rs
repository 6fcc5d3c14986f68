//! From coarse to fine, until what is left is as small as asked or the time is used.

use super::estimate::{Estimate, fall, left_over};
use super::look::{Finder, Look, counted, luminances, noise_of};
use super::{Fixed, Target};
use crate::error::Result;
use crate::first_pass::DiffuseSolution;
use crate::observer::Observer;
use crate::pipeline::{self, Prepared};
use crate::scene::{Camera, SampledAppearance, Scene};
use crate::second_pass::{Rung, SecondPassSettings, SecondPassStats, SpectralImage};
use crate::settings::Settings;
use crate::spectrum::Wavelengths;
use crate::tracers::RayTracer;
use serde::Serialize;
use std::time::Instant;

/// The first level has thresholds of area so many times the base's.
const COARSEST: f64 = 16.0;
/// No level is begun that is expected to have more points, or to take longer, s.
const MOST_POINTS: f64 = 130_000.0;
const LONGEST_S: f64 = 600.0;
/// Fewest and most samples a pixel of an image, both halves together.
const SAMPLES: (f64, f64) = (4.0, 4096.0);
/// Shares of an error or a time that is asked for that are planned with.
const OF_ERROR: f64 = 0.95;
const OF_TIME: f64 = 0.9;
/// More wavelengths are taken while the error of those that there are is above this share of the error asked for.
const OF_WAVELENGTHS: f64 = 0.3;
/// The error that wavelengths are chosen for where a time is asked for.
const ERROR_WITHIN: f64 = 0.03;
/// Most wavelengths.
const MOST_WAVELENGTHS: usize = 32;
/// How many times longer the first refinement is expected to take than the level before.
const FIRST_GROWTH: f64 = 8.0;
/// An error below this share of what there is anyway is not worth its time.
const ENOUGH: f64 = 0.3;

/// An image, and what it is wrong by.
pub struct Reached {
    /// The settings it was made with; [`SecondPassSettings::samples`] counts both halves.
    pub settings: Settings,
    /// Points and graph.
    pub prepared: Prepared,
    /// What the first pass found.
    pub light: (SampledAppearance, DiffuseSolution),
    /// The image.
    pub image: SpectralImage,
    /// How it was made.
    pub second_pass: SecondPassStats,
    /// What it is wrong by.
    pub estimate: Estimate,
    /// The way there.
    pub steps: Vec<Step>,
    /// Wall time, s.
    pub total_s: f64,
}

/// One level.
#[derive(Clone, Debug, Serialize)]
pub struct Step {
    /// Sample points.
    pub points: usize,
    /// Wall time of graph and first pass, s.
    pub light_s: f64,
    /// On each rung, what this level changed of the one before, of the mean luminance.
    pub changes: Vec<(Rung, f64)>,
}

/// A level that was computed.
struct Level {
    prepared: Prepared,
    light: (SampledAppearance, DiffuseSolution),
    s: f64,
}

/// What is known of one rung.
struct OnRung {
    rung: Rung,
    last: Look,
    changes: Vec<f64>,
}

/// How an image would be made of the last level.
#[derive(Clone, Copy)]
struct Plan {
    rung: Rung,
    samples: f64,
    error: f64,
    s: f64,
}

/// The state of a search.
struct Search<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    tracer: &'a dyn RayTracer,
    observer: &'a dyn Observer,
    finder: Finder<'a>,
    settings: Settings,
    rungs: Vec<OnRung>,
    wavelengths: f64,
    steps: Vec<Step>,
}

/// Renders what `camera` sees, with settings chosen from `base` on so that `target` is met, and says by how much the image
/// is likely to be wrong. A target that cannot be met ends in the best image that was reached.
///
/// # Errors
/// Those of [`pipeline`].
pub fn render(
    (scene, camera): (&Scene, &Camera),
    tracer: &dyn RayTracer,
    base: &Settings,
    (target, fixed): (Target, Fixed),
    observer: &dyn Observer,
) -> Result<Reached> {
    let clock = Instant::now();
    camera.check()?;
    let mut settings = base.clone();
    settings.first_pass.parts = !fixed.rung || base.second_pass.rung != Rung::Interpolate;
    settings.area_factor *= COARSEST;
    let finder = Finder::new(scene, camera, tracer, &base.second_pass);
    let (rungs, steps) = (Vec::new(), Vec::new());
    let mut search =
        Search { scene, camera, tracer, observer, finder, settings, rungs, wavelengths: 0.0, steps };
    let mut level = search.level()?;
    let wanted = if fixed.rung { vec![base.second_pass.rung] } else { vec![Rung::Interpolate, Rung::Direct] };
    for rung in wanted {
        let last = search.finder.look(&level.prepared, &level.light, rung)?;
        search.rungs.push(OnRung { rung, last, changes: Vec::new() });
    }
    search.choose_wavelengths(&mut level, target, fixed.wavelengths)?;
    search.note(&level);
    let mut growth = FIRST_GROWTH;
    let plan = loop {
        let left = |s: f64| s * OF_TIME - clock.elapsed().as_secs_f64();
        let plan = search.plan(target, left, &level, 0.0);
        let next_s = level.s * growth;
        let too_much = next_s > LONGEST_S || 4.0 * level.prepared.points.len() as f64 > MOST_POINTS;
        let enough = match target {
            Target::Error(asked) => {
                plan.is_some_and(|plan| plan.error <= asked) || search.points_are_enough(asked, &level)
            }
            Target::Within(s) => {
                let finer = search.plan(target, left, &level, next_s);
                let gains = finer.zip(plan).is_none_or(|(finer, plan)| finer.error < plan.error);
                next_s > left(s) || !gains
            }
        };
        // One refinement at least: without, nothing is known.
        if let Some(plan) = plan.filter(|_| enough || too_much) {
            break plan;
        }
        search.settings.area_factor /= 4.0;
        let before = level.s;
        level = search.level()?;
        growth = (level.s / before.max(1e-3)).clamp(4.0, 100.0);
        for on in &mut search.rungs {
            let look = search.finder.look(&level.prepared, &level.light, on.rung)?;
            on.changes.push(search.finder.change(&on.last, &look));
            on.last = look;
        }
        search.note(&level);
    };
    search.finish(plan, level, target, clock)
}

impl Search<'_> {
    /// Points, graph and first pass of the settings as they are.
    fn level(&self) -> Result<Level> {
        let clock = Instant::now();
        let (geometry, settings) = (&self.scene.geometry, &self.settings);
        let prepared =
            pipeline::prepare(geometry, &self.scene.sampling, settings, self.tracer, None, self.observer)?;
        let light = pipeline::light(geometry, &prepared, &self.scene.appearance, settings, self.observer)?;
        Ok(Level { prepared, light, s: clock.elapsed().as_secs_f64() })
    }

    fn note(&mut self, level: &Level) {
        let changes = self.rungs.iter().filter_map(|on| Some((on.rung, *on.changes.last()?))).collect();
        self.steps.push(Step { points: level.prepared.points.len(), light_s: level.s, changes });
    }

    /// Finds out what twice as many wavelengths change, and takes them as long as that is too much.
    fn choose_wavelengths(&mut self, level: &mut Level, target: Target, fixed: bool) -> Result<()> {
        let asked = match target {
            Target::Error(asked) => asked,
            Target::Within(_) => ERROR_WITHIN,
        };
        loop {
            let settings = Settings {
                wavelengths: Wavelengths::of_bands(2 * self.settings.wavelengths.len()),
                ..self.settings.clone()
            };
            let (geometry, appearance) = (&self.scene.geometry, &self.scene.appearance);
            let light = pipeline::light(geometry, &level.prepared, appearance, &settings, self.observer)?;
            let rung = self.rungs[0].rung;
            let look = self.finder.look(&level.prepared, &light, rung)?;
            self.wavelengths = self.finder.change(&self.rungs[0].last, &look);
            let many = settings.wavelengths.len() > MOST_WAVELENGTHS;
            if fixed || many || self.wavelengths <= OF_WAVELENGTHS * asked {
                return Ok(());
            }
            (self.settings, level.light) = (settings, light);
            for on in &mut self.rungs {
                on.last = self.finder.look(&level.prepared, &level.light, on.rung)?;
            }
        }
    }

    /// What is known of an image on a rung but for its noise, after `more` refinements that are not yet done.
    fn estimate(&self, on: &OnRung, level: &Level, more: i32) -> Estimate {
        Estimate {
            points: left_over(&on.changes) / fall(&on.changes).powi(more),
            wavelengths: self.wavelengths,
            ..Estimate::of_solution(&level.light.1.stats)
        }
        .summed()
    }

    /// Whether finer points are no use: what they cannot mend is more than the error asked for, and most of all there is.
    fn points_are_enough(&self, asked: f64, level: &Level) -> bool {
        self.rungs.iter().all(|on| {
            let estimate = self.estimate(on, level, 0);
            let rest = Estimate { points: 0.0, ..estimate }.systematic();
            rest > asked && estimate.points < ENOUGH * rest
        })
    }

    /// The best image of this level, or of the next if that takes `next_s`, as far as can be told: `None` where nothing
    /// is known yet, or no number of samples brings the error asked for.
    fn plan(&self, target: Target, left: impl Fn(f64) -> f64, level: &Level, next_s: f64) -> Option<Plan> {
        let [w, h] = self.camera.resolution.map(f64::from);
        let plans = self.rungs.iter().filter(|on| !on.changes.is_empty()).map(|on| {
            let systematic = self.estimate(on, level, i32::from(next_s > 0.0)).systematic();
            let (noise, s) = (self.finder.noise(&on.last), on.last.s * w * h);
            let wanted = match target {
                Target::Error(asked) => {
                    let room = (OF_ERROR * asked).powi(2) - systematic.powi(2);
                    // Without room for noise it may be as large as what there is anyway.
                    (noise / room.max(systematic.powi(2) * 0.1).sqrt().max(1e-9)).powi(2)
                }
                Target::Within(all) => {
                    let enough = (noise / (ENOUGH * systematic).max(1e-9)).powi(2);
                    ((left(all) - next_s) / s).min(enough)
                }
            };
            let samples = 2.0 * (0.5 * wanted).ceil().clamp(0.5 * SAMPLES.0, 0.5 * SAMPLES.1);
            let error = (systematic.powi(2) + noise.powi(2) / samples).sqrt();
            Plan { rung: on.rung, samples, error, s: samples * s }
        });
        match target {
            Target::Error(asked) => {
                let (met, missed): (Vec<Plan>, Vec<Plan>) = plans.partition(|plan| plan.error <= asked);
                let fastest = met.into_iter().min_by(|a, b| a.s.total_cmp(&b.s));
                fastest.or_else(|| missed.into_iter().min_by(|a, b| a.error.total_cmp(&b.error)))
            }
            Target::Within(_) => plans.min_by(|a, b| a.error.total_cmp(&b.error)),
        }
    }

    /// The image of a plan; with more samples where its noise turns out too large for the error asked for.
    fn finish(self, plan: Plan, level: Level, target: Target, clock: Instant) -> Result<Reached> {
        let mut settings = self.settings.clone();
        settings.second_pass.rung = plan.rung;
        let counts = counted(self.scene, self.camera, self.tracer);
        let Some(on) = self.rungs.iter().find(|on| on.rung == plan.rung) else {
            unreachable!("planned on one of the rungs");
        };
        let known = self.estimate(on, &level, 0);
        let mut samples = plan.samples;
        loop {
            settings.second_pass.samples = samples as u32;
            let (image, noise, second_pass) = self.view(&level, &settings.second_pass, &counts)?;
            let chains = known.chains + second_pass.cut_share + second_pass.clamped_share;
            let estimate = Estimate { noise, chains, ..known }.summed();
            let next = match target {
                Target::Error(asked) if estimate.total > asked && samples < SAMPLES.1 => {
                    let room = (OF_ERROR * asked).powi(2) - estimate.systematic().powi(2);
                    (room > 0.0).then(|| samples * (noise * noise / room).clamp(1.2, 16.0))
                }
                _ => None,
            };
            if let Some(next) = next {
                samples = 2.0 * (0.5 * next).ceil().min(0.5 * SAMPLES.1);
                continue;
            }
            return Ok(Reached {
                settings,
                prepared: level.prepared,
                light: level.light,
                image,
                second_pass,
                estimate,
                steps: self.steps,
                total_s: clock.elapsed().as_secs_f64(),
            });
        }
    }

    /// The mean of two images of different seeds, and its noise.
    fn view(
        &self,
        level: &Level,
        settings: &SecondPassSettings,
        counts: &[bool],
    ) -> Result<(SpectralImage, f64, SecondPassStats)> {
        let half = |seed: u32| {
            let settings = SecondPassSettings { samples: settings.samples / 2, seed, ..*settings };
            let (geometry, camera) = (&self.scene.geometry, self.camera);
            pipeline::view(
                geometry,
                &level.prepared,
                &level.light,
                camera,
                self.tracer,
                &settings,
                self.observer,
            )
        };
        let (mut image, mut stats) = half(settings.seed)?;
        let (other, more) = half(settings.seed.wrapping_add(1))?;
        let noise = noise_of(counts, &[luminances(&image), luminances(&other)]);
        image.radiance.iter_mut().zip(&other.radiance).for_each(|(a, b)| *a = 0.5 * (*a + b));
        stats.add(&more);
        stats.cut_share *= 0.5;
        stats.by_chance_share *= 0.5;
        stats.clamped_share *= 0.5;
        stats.second_pass_s += more.second_pass_s;
        Ok((image, noise, stats))
    }
}

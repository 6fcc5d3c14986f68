//! The stages of one scene, each beside its ceiling, measured in one run.

use super::first_pass::{self, FirstPassBench, usual_changes};
use super::graph::{self, GraphBench};
use super::hall::hall;
use super::moved::{MovedBench, moved};
use super::second_pass::{SecondPassRates, second_pass_rates};
use super::tracers::{TracerRates, tracer_rates};
use crate::error::{Error, Result};
use crate::geometry::SurfaceId;
use crate::observer::Observer;
use crate::pipeline;
use crate::points::{Sampling, area_factor_for};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::tracers;
use serde::Serialize;

/// Rays of each kind that a tracer's rate is taken from.
const RAYS: usize = 200_000;
/// Rows and columns of a hall of about 100,000 quadrilaterals.
const LARGE_HALL: [usize; 2] = [48, 51];
/// The ceiling of a sweep multiplies by a stored matrix of N² numbers; more than this is left out, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// Specular points times what they may see: each keeps some 80 bytes of all that it does, and finds its form factors.
const MOST_SEEN: f64 = 3e7;
/// How often a sweep and its ceiling take turns.
const REPEATS: usize = 7;

/// The graph and the first pass at one number of points.
#[derive(Clone, Debug, Serialize)]
pub struct AtPoints {
    /// The graph.
    pub graph: GraphBench,
    /// The first pass, and new appearances over the same graph, unless its specular points see so much that it would
    /// take minutes.
    pub first_pass: Option<FirstPassBench>,
    /// The graph after the changes that were asked for.
    pub moved: Option<MovedBench>,
}

/// All stages.
#[derive(Clone, Debug, Serialize)]
pub struct Stages {
    /// By number of points, in the order asked for.
    pub sizes: Vec<AtPoints>,
    /// Ray tracers on the scene.
    pub tracers: TracerRates,
    /// Ray tracers on a hall of about 100,000 quadrilaterals.
    pub tracers_on_hall: TracerRates,
    /// The second pass of the scene's first camera, at its first number of points.
    pub second_pass: SecondPassRates,
}

/// A part of [`Stages`].
#[derive(Clone, Copy, Debug)]
pub enum Section<'a> {
    /// The graph at one number of points.
    Graph(&'a GraphBench),
    /// The first pass at so many points; `None` where it is left out.
    FirstPass(usize, Option<&'a FirstPassBench>),
    /// The graph after the changes.
    Moved(&'a MovedBench),
    /// The second pass.
    SecondPass(&'a SecondPassRates),
    /// Ray tracers on the scene and on the hall.
    Tracers([&'a TracerRates; 2]),
}

/// Measures all stages of `scene` at about each number of `points`, and the update of its graph to the scene `changed`.
/// `tell` is told each section as soon as it is measured.
///
/// # Errors
/// Those of the stages; [`Error::Settings`] when no number of points is given, or one too small for the scene.
pub fn stages(
    scene: &Scene,
    changed: Option<&Scene>,
    settings: &Settings,
    points: &[usize],
    tell: &mut dyn FnMut(Section),
    observer: &dyn Observer,
) -> Result<Stages> {
    if points.is_empty() {
        return Err(Error::Settings("give at least one number of points".into()));
    }
    let camera = scene.cameras.first().ok_or_else(|| Error::Settings("the scene has no camera".into()))?;
    let geometry = &scene.geometry;
    let tracer = tracers::choose(settings.tracer, geometry)?;
    let changes = usual_changes(&scene.appearance);
    let (mut sizes, mut second_pass) = (Vec::new(), None);
    for &wanted in points {
        let factor = area_factor_for(geometry, &scene.sampling, wanted)?;
        let settings = Settings { area_factor: factor, ..settings.clone() };
        // What the graph itself asks to be refined would make it another number.
        let sampling = Sampling { refine_solid_angle: None, ..scene.sampling };
        let prepared = pipeline::prepare(geometry, &sampling, &settings, tracer.as_ref(), None, observer)?;
        let graph = graph::graph(geometry, &prepared.points, tracer.as_ref(), observer)?;
        tell(Section::Graph(&graph));
        let specular = |s: &SurfaceId| scene.appearance.material(*s).is_specular();
        let n = prepared.points.len() as f64;
        let specular_points = prepared.points.surface.iter().filter(|s| specular(s)).count() as f64;
        let first_pass = (specular_points * n <= MOST_SEEN)
            .then(|| {
                first_pass::measure(scene, &prepared, &settings, &changes, MOST_BYTES, REPEATS, observer)
            })
            .transpose()?;
        tell(Section::FirstPass(prepared.points.len(), first_pass.as_ref()));
        let moved = changed.map(|c| moved((geometry, &prepared), c, &settings, observer)).transpose()?;
        moved.iter().for_each(|moved| tell(Section::Moved(moved)));
        sizes.push(AtPoints { graph, first_pass, moved });
        if second_pass.is_none() {
            let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, observer)?;
            let lit = pipeline::lit_scene(geometry, &prepared, &lit);
            let rates = second_pass_rates(&lit, camera, tracer.as_ref(), &settings.second_pass)?;
            tell(Section::SecondPass(&rates));
            second_pass = Some(rates);
        }
    }
    let Some(second_pass) = second_pass else { unreachable!("there is a first number of points") };
    let [rows, columns] = LARGE_HALL;
    let tracers = tracer_rates(geometry, RAYS)?;
    let tracers_on_hall = tracer_rates(&hall(rows, columns).geometry, RAYS)?;
    tell(Section::Tracers([&tracers, &tracers_on_hall]));
    Ok(Stages { sizes, tracers, tracers_on_hall, second_pass })
}

//! The stages in order, and nothing else: each borrows what it needs and returns one product.

use crate::error::Result;
use crate::first_pass::{DiffuseSolution, Relighter};
use crate::measure::{self, MeasureSettings, Reading};
use crate::observer::Observer;
use crate::points::{self, Element, SamplePoints, Sampling};
use crate::scene::{Appearance, Camera, Geometry, SampledAppearance, Sensor};
use crate::second_pass::{self, Interpolator, LitScene, SecondPassSettings, SecondPassStats, SpectralImage};
use crate::settings::Settings;
use crate::tracers::RayTracer;
use crate::visibility::{VisibilityGraph, file};
use crate::voxels::Voxels;
use std::path::Path;

/// All that depends on geometry alone and survives every change of appearance.
pub struct Prepared {
    /// Space, divided for the graph.
    pub voxels: Voxels,
    /// The sample points.
    pub points: SamplePoints,
    /// What they see of each other.
    pub graph: VisibilityGraph,
    /// How a view reads radiance between them.
    pub interpolator: Interpolator,
    /// Whether the graph was read from a file instead of being built.
    pub graph_loaded: bool,
}

/// Rounds of graph-driven refinement (4.2.2) after which a scene is taken as it is.
const REFINEMENT_ROUNDS: usize = 4;

/// Scene geometry -> sample points -> visibility graph, refined where points that see each
/// other are too close (4.2.2). With `graph_file` the graph is read from there, and the points with
/// it, if the file exists, and written there if not.
///
/// # Errors
/// Those of [`points::sample`], [`VisibilityGraph::build`], [`file::load`] and [`file::save`].
pub fn prepare(
    geometry: &Geometry,
    sampling: &Sampling,
    settings: &Settings,
    tracer: &dyn RayTracer,
    graph_file: Option<&Path>,
    observer: &dyn Observer,
) -> Result<Prepared> {
    let sampling = Sampling { area_factor: settings.area_factor, ..*sampling };
    let voxels = Voxels::build(geometry, &settings.voxels);
    let points = points::sample(geometry, &sampling, &voxels)?;
    let request = points::request_key(geometry, &sampling, &voxels, &points);
    if let Some(path) = graph_file.filter(|p| p.exists()) {
        let (points, mut graph) = file::load(path, &request, geometry, |e| resample(geometry, &voxels, e))?;
        graph.look_at_lights(geometry, &points, tracer);
        let interpolator = Interpolator::new(geometry, &points, tracer);
        return Ok(Prepared { voxels, points, graph, interpolator, graph_loaded: true });
    }
    let build = |points: &SamplePoints| VisibilityGraph::build(geometry, points, tracer, observer);
    let (points, graph) = refined(geometry, &sampling, &voxels, points, build)?;
    if let Some(path) = graph_file {
        file::save(path, &request, &points, &graph)?;
    }
    let interpolator = Interpolator::new(geometry, &points, tracer);
    Ok(Prepared { voxels, points, graph, interpolator, graph_loaded: false })
}

/// What [`prepare`] makes of `geometry`, to the bit, where `before` was prepared of another geometry: what both see alike is
/// taken from its graph. It takes the less time the fewer surfaces have moved, come or gone.
///
/// # Errors
/// Those of [`points::sample`] and [`VisibilityGraph::update`].
pub fn prepare_changed(
    (before, prepared): (&Geometry, &Prepared),
    geometry: &Geometry,
    sampling: &Sampling,
    settings: &Settings,
    tracer: &dyn RayTracer,
    observer: &dyn Observer,
) -> Result<Prepared> {
    let sampling = Sampling { area_factor: settings.area_factor, ..*sampling };
    let voxels = Voxels::build(geometry, &settings.voxels);
    let points = points::sample(geometry, &sampling, &voxels)?;
    let was = (before, &prepared.points);
    let update = |points: &SamplePoints| prepared.graph.update(was, (geometry, points), tracer, observer);
    let (points, graph) = refined(geometry, &sampling, &voxels, points, update)?;
    let interpolator = Interpolator::new(geometry, &points, tracer);
    Ok(Prepared { voxels, points, graph, interpolator, graph_loaded: false })
}

/// The graph of `points`, and both after the rounds of refinement that it asks for; `build` makes the graph of points.
fn refined(
    geometry: &Geometry,
    sampling: &Sampling,
    voxels: &Voxels,
    mut points: SamplePoints,
    build: impl Fn(&SamplePoints) -> Result<VisibilityGraph>,
) -> Result<(SamplePoints, VisibilityGraph)> {
    let mut graph = build(&points)?;
    for _ in 0..REFINEMENT_ROUNDS {
        let finer = points::refine(geometry, sampling, &points, |i, j| graph.unblocked(i, j))?;
        let Some(elements) = finer else { break };
        points = resample(geometry, voxels, &elements);
        graph = build(&points)?;
    }
    Ok((points, graph))
}

/// The sample points of `elements`.
fn resample(geometry: &Geometry, voxels: &Voxels, elements: &[Element]) -> SamplePoints {
    SamplePoints::new(geometry, elements, voxels.len(), |p| voxels.locate(p))
}

/// What the first pass of a scene keeps between one appearance and the next.
///
/// # Errors
/// Those of [`Relighter::new`].
pub fn relighter<'a>(
    geometry: &'a Geometry,
    prepared: &'a Prepared,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<Relighter<'a>> {
    Relighter::new(geometry, &prepared.points, &prepared.graph, &settings.first_pass, observer)
}

/// Graph and appearance -> global diffuse radiance. Casts no ray: it is given no tracer.
///
/// # Errors
/// Those of [`relighter`] and [`relight`].
pub fn light(
    geometry: &Geometry,
    prepared: &Prepared,
    appearance: &Appearance,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(SampledAppearance, DiffuseSolution)> {
    relight(geometry, &mut relighter(geometry, prepared, settings, observer)?, appearance, settings, observer)
}

/// The same, with what `relighter` kept of other appearances: the same bits in less time.
///
/// # Errors
/// Those of [`Relighter::light`].
pub fn relight(
    geometry: &Geometry,
    relighter: &mut Relighter,
    appearance: &Appearance,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(SampledAppearance, DiffuseSolution)> {
    let appearance = appearance.sample(geometry, &settings.wavelengths, settings.fresnel_entries);
    let solution = relighter.light(&appearance, observer)?;
    Ok((appearance, solution))
}

/// What the second pass looks at.
pub fn lit_scene<'a>(
    geometry: &'a Geometry,
    prepared: &'a Prepared,
    (appearance, solution): &'a (SampledAppearance, DiffuseSolution),
) -> LitScene<'a> {
    LitScene { geometry, interpolator: &prepared.interpolator, appearance, solution }
}

/// Diffuse radiance -> image.
///
/// # Errors
/// Those of [`second_pass::render`].
pub fn view(
    geometry: &Geometry,
    prepared: &Prepared,
    lit: &(SampledAppearance, DiffuseSolution),
    camera: &Camera,
    tracer: &dyn RayTracer,
    settings: &SecondPassSettings,
    observer: &dyn Observer,
) -> Result<(SpectralImage, SecondPassStats)> {
    second_pass::render(&lit_scene(geometry, prepared, lit), camera, tracer, settings, observer)
}

/// Diffuse radiance -> spectral irradiance of sensors.
///
/// # Errors
/// Those of [`measure::measure`].
pub fn measure(
    geometry: &Geometry,
    prepared: &Prepared,
    lit: &(SampledAppearance, DiffuseSolution),
    sensors: &[Sensor],
    tracer: &dyn RayTracer,
    settings: &MeasureSettings,
    observer: &dyn Observer,
) -> Result<Vec<Reading>> {
    let scene = lit_scene(geometry, prepared, lit);
    measure::measure(&scene, &prepared.points, tracer, sensors, settings, observer)
}

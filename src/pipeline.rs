//! The stages in order, and nothing else: each borrows what it needs and returns one product.

use crate::error::{Error, Result};
use crate::first_pass::{DiffuseSolution, Evenly, FirstPass, LinkedRelighter, Relighter, Solver};
use crate::measure::{self, MeasureSettings, Reading};
use crate::observer::Observer;
use crate::points::{self, Element, LightRefiner, SamplePoints, Sampling};
use crate::scene::{Appearance, Camera, Geometry, SampledAppearance, Sensor};
use crate::second_pass::{self, Interpolator, LitScene, SecondPassSettings, SecondPassStats, SpectralImage};
use crate::settings::Settings;
use crate::tracers::RayTracer;
use crate::visibility::{LinkSettings, Links, VisibilityGraph, file};
use crate::voxels::Voxels;
use std::path::Path;

/// All that depends on geometry alone and survives every change of appearance.
pub struct Prepared {
    /// Space, divided for the graph.
    pub voxels: Voxels,
    /// The sample points.
    pub points: SamplePoints,
    /// What they see of each other; of no points where there are links.
    pub graph: VisibilityGraph,
    /// What they see of clusters of points, if there are links in place of the graph.
    pub links: Option<Links>,
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
/// With [`Settings::links`], or more points than [`Settings::most_paired`], there are links in place of the graph.
///
/// # Errors
/// Those of [`points::sample`], [`Links::build`], [`VisibilityGraph::build`], [`file::load`] and [`file::save`].
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
    let many = too_many_for_pairs(points.len(), &sampling, settings, graph_file);
    if let Some(links) = settings.links.or(many.then(LinkSettings::default)) {
        return link(geometry, (&sampling, settings, &links), (voxels, points), tracer, graph_file, observer);
    }
    let request = points::request_key(geometry, &sampling, &voxels, &points);
    if let Some(path) = graph_file.filter(|p| p.exists()) {
        let (points, mut graph) = file::load(path, &request, geometry, |e| resample(geometry, &voxels, e))?;
        graph.look_at_lights(geometry, &points, tracer);
        let interpolator = Interpolator::new(geometry, &points, tracer);
        return Ok(Prepared { voxels, points, graph, links: None, interpolator, graph_loaded: true });
    }
    let build = |points: &SamplePoints| VisibilityGraph::build(geometry, points, tracer, observer);
    let (points, graph) = refined(geometry, &sampling, &voxels, points, build)?;
    if let Some(path) = graph_file {
        file::save(path, &request, &points, &graph)?;
    }
    let interpolator = Interpolator::new(geometry, &points, tracer);
    Ok(Prepared { voxels, points, graph, links: None, interpolator, graph_loaded: false })
}

/// Whether [`prepare`] makes links in place of a graph of so many `points` without being asked to.
pub fn too_many_for_pairs(
    points: usize,
    sampling: &Sampling,
    settings: &Settings,
    graph_file: Option<&Path>,
) -> bool {
    let needs_pairs = graph_file.is_some()
        || sampling.refine_solid_angle.is_some()
        || settings.first_pass.solver == Solver::Shooting;
    points > settings.most_paired && !needs_pairs
}

/// What [`prepare`] makes of `geometry`, to the bit, where `before` was prepared of another geometry: what both see
/// alike is taken from its graph. It takes the less time the fewer surfaces have moved, come or gone. Links are built anew.
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
    if prepared.links.is_some() {
        return prepare(geometry, sampling, settings, tracer, None, observer);
    }
    let sampling = Sampling { area_factor: settings.area_factor, ..*sampling };
    let voxels = Voxels::build(geometry, &settings.voxels);
    let points = points::sample(geometry, &sampling, &voxels)?;
    let was = (before, &prepared.points);
    let update = |points: &SamplePoints| prepared.graph.update(was, (geometry, points), tracer, observer);
    let (points, graph) = refined(geometry, &sampling, &voxels, points, update)?;
    let interpolator = Interpolator::new(geometry, &points, tracer);
    Ok(Prepared { voxels, points, graph, links: None, interpolator, graph_loaded: false })
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

/// The same with links in place of the graph.
fn link(
    geometry: &Geometry,
    (sampling, settings, links): (&Sampling, &Settings, &LinkSettings),
    (voxels, points): (Voxels, SamplePoints),
    tracer: &dyn RayTracer,
    graph_file: Option<&Path>,
    observer: &dyn Observer,
) -> Result<Prepared> {
    let refuse = |what: &str| Err(Error::Settings(format!("{what}: leave it out, or compute without links")));
    if graph_file.is_some() {
        return refuse("links cannot be kept in a graph file");
    }
    if sampling.refine_solid_angle.is_some() {
        return refuse("the scene's `refine_solid_angle` needs the visibility of all pairs of points");
    }
    if settings.first_pass.solver == Solver::Shooting {
        return refuse("light cannot be shot over links");
    }
    let links = Links::build(geometry, &points, tracer, &together(links, sampling, settings), observer)?;
    let interpolator = Interpolator::new(geometry, &points, tracer);
    let graph = VisibilityGraph::default();
    Ok(Prepared { voxels, points, graph, links: Some(links), interpolator, graph_loaded: false })
}

/// `links`, for which faces that are smaller than `sampling` asks for ask together for what is far away.
fn together(links: &LinkSettings, sampling: &Sampling, settings: &Settings) -> LinkSettings {
    let sampling = Sampling { area_factor: settings.area_factor, ..*sampling };
    LinkSettings { together: Some(sampling), ..*links }
}

/// `prepared`, with elements divided where the light of `appearance` bends, if [`Settings::refinement`] asks for that:
/// round by round the first pass is solved, points are added where it asks for them, and the graph is brought up to date.
///
/// # Errors
/// Those of [`light`], [`Links::build`] and [`VisibilityGraph::update`].
pub fn refine_by_light(
    geometry: &Geometry,
    mut prepared: Prepared,
    appearance: &Appearance,
    sampling: &Sampling,
    settings: &Settings,
    tracer: &dyn RayTracer,
    observer: &dyn Observer,
) -> Result<Prepared> {
    let Some(refinement) = &settings.refinement else { return Ok(prepared) };
    let refiner = LightRefiner::new(refinement, &prepared.points);
    for _ in 0..refinement.rounds {
        let (appearance, solution) = light(geometry, &prepared, appearance, settings, observer)?;
        let luminance = solution.interpolated_luminance(&appearance, &prepared.points);
        let around = |i| prepared.interpolator.around(i);
        let lamp = |surface| appearance.of(surface).emission.iter().any(|&l| l > 0.0);
        let finer = refiner.refine(sampling, &prepared.points, &luminance, lamp, around);
        let Some(elements) = finer else { break };
        let points = resample(geometry, &prepared.voxels, &elements);
        if prepared.links.is_some() {
            let links = together(&settings.links.unwrap_or_default(), sampling, settings);
            prepared.links = Some(Links::build(geometry, &points, tracer, &links, observer)?);
        } else {
            let was = (geometry, &prepared.points);
            prepared.graph = prepared.graph.update(was, (geometry, &points), tracer, observer)?;
        }
        prepared.interpolator = Interpolator::new(geometry, &points, tracer);
        prepared.points = points;
    }
    Ok(prepared)
}

/// What computes the diffuse light of a scene under one appearance after another: over its links if it has any, over
/// all pairs of points otherwise. Links carry no specular light: there it is spread evenly ([`Evenly`]).
///
/// # Errors
/// Those of [`LinkedRelighter::new`] and [`Relighter::new`].
pub fn first_pass<'a>(
    geometry: &'a Geometry,
    prepared: &'a Prepared,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<Box<dyn FirstPass + 'a>> {
    let points = &prepared.points;
    let first_pass: Box<dyn FirstPass + 'a> = match &prepared.links {
        Some(links) => Box::new(LinkedRelighter::new(geometry, points, links, &settings.first_pass)?),
        None => Box::new(relighter(geometry, prepared, settings, observer)?),
    };
    let most_specular = if prepared.links.is_some() { 0 } else { settings.first_pass.most_specular };
    Ok(Box::new(Evenly { first_pass, points, most_specular }))
}

/// What the first pass of a scene over all pairs of points keeps between one appearance and the next.
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
/// Those of [`first_pass`] and [`relight`].
pub fn light(
    geometry: &Geometry,
    prepared: &Prepared,
    appearance: &Appearance,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(SampledAppearance, DiffuseSolution)> {
    let mut first_pass = first_pass(geometry, prepared, settings, observer)?;
    relight(geometry, first_pass.as_mut(), appearance, settings, observer)
}

/// The same, with what `first_pass` kept of other appearances: the same bits in less time.
///
/// # Errors
/// Those of [`FirstPass::light`].
pub fn relight(
    geometry: &Geometry,
    first_pass: &mut dyn FirstPass,
    appearance: &Appearance,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(SampledAppearance, DiffuseSolution)> {
    let appearance = appearance.sample(geometry, &settings.wavelengths, settings.fresnel_entries);
    let solution = first_pass.light(&appearance, observer)?;
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

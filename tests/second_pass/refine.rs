//! Do points that are added where light bends make it more exact, and is everything else kept?

use luxgraph::geometry::SurfaceId;
use luxgraph::observer::Silent;
use luxgraph::pipeline::{self, Prepared};
use luxgraph::points::LightRefinement;
use luxgraph::scene::{Scene, load};
use luxgraph::second_pass::Rung;
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::{TracerChoice, choose};
use luxgraph::visibility::VisibilityGraph;

/// A shelf close over a floor under a small lamp.
const SHELF: &str = r#"
format = 1
[sampling]
max_area = 0.01
[materials.wall]
reflectance = 0.5
[materials.lamp]
reflectance = 0.0
emission = { spectrum = 1.0, radiance = 10.0 }
[[objects]]
name = "floor"
material = "wall"
quads = [[[0,0,0],[2,0,0],[2,2,0],[0,2,0]]]
[[objects]]
name = "shelf"
material = "wall"
quads = [[[0.55,0.55,0.3],[0.55,1.45,0.3],[1.45,1.45,0.3],[1.45,0.55,0.3]]]
[[objects]]
name = "lamp"
material = "lamp"
quads = [[[0.97,0.97,1.9],[0.97,1.03,1.9],[1.03,1.03,1.9],[1.03,0.97,1.9]]]
[[cameras]]
name = "c"
position = [1, -0.9, 0.25]
target = [1, 1, 0]
fov_deg = 60
resolution = [60, 30]
"#;

fn settings(area_factor: f64, refinement: Option<LightRefinement>) -> Settings {
    let mut settings =
        Settings { tracer: TracerChoice::Voxel, area_factor, refinement, ..Settings::default() };
    settings.wavelengths = Wavelengths::meyer4();
    settings.second_pass.samples = 16;
    settings
}

fn prepare(scene: &Scene, settings: &Settings) -> Prepared {
    let (geometry, sampling) = (&scene.geometry, &scene.sampling);
    let tracer = choose(settings.tracer, geometry).expect("it is there");
    let tracer = tracer.as_ref();
    let prepared = pipeline::prepare(geometry, sampling, settings, tracer, None, &Silent).expect("prepared");
    pipeline::refine_by_light(geometry, prepared, &scene.appearance, sampling, settings, tracer, &Silent)
        .expect("refined")
}

/// Radiance of every pixel, and the number of points.
fn view(scene: &Scene, settings: &Settings) -> (Vec<f32>, usize) {
    let prepared = prepare(scene, settings);
    let geometry = &scene.geometry;
    let tracer = choose(settings.tracer, geometry).expect("it is there");
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, settings, &Silent).expect("lit");
    let (camera, second) = (&scene.cameras[0], &settings.second_pass);
    let (image, _) =
        pipeline::view(geometry, &prepared, &lit, camera, tracer.as_ref(), second, &Silent).expect("seen");
    (image.radiance, prepared.points.len())
}

fn scene() -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("shelf.toml");
    std::fs::write(&path, SHELF).expect("written");
    load(&path).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn a_shadow_is_more_exact_than_with_as_many_even_points() {
    let scene = scene();
    // Lamps themselves are asked for the truth, at the same samples of the same pixels: what differs is what points know.
    let mut exact = settings(0.25, None);
    exact.first_pass.parts = true;
    (exact.second_pass.rung, exact.second_pass.lamp_samples) = (Rung::Direct, 64);
    let (truth, _) = view(&scene, &exact);
    let error = |image: &[f32]| {
        let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
        (image.iter().zip(&truth).map(square).sum::<f64>() / truth.len() as f64).sqrt()
    };
    let refinement = LightRefinement { tolerance: 0.05, ..LightRefinement::default() };
    let (refined, points) = view(&scene, &settings(1.0, Some(refinement)));
    let (even, even_points) = view(&scene, &settings(0.25, None));
    assert!(points < even_points, "{points} refined, {even_points} even");
    let (refined, even) = (error(&refined), error(&even));
    eprintln!("{points} points refined: error {refined}; {even_points} even: {even}");
    assert!(refined < 0.8 * even, "error {refined} refined, {even} even");
}

#[test]
fn lamps_are_divided_along() {
    let scene = scene();
    let of_lamp = |settings: &Settings| {
        let points = prepare(&scene, settings).points;
        let emits = |s: &&SurfaceId| scene.appearance.material(**s).emission.is_some();
        points.surface.iter().filter(emits).count()
    };
    assert_eq!(of_lamp(&settings(1.0, None)), 1);
    let refinement = LightRefinement { rounds: 2, ..LightRefinement::default() };
    assert_eq!(of_lamp(&settings(1.0, Some(refinement))), 16);
}

#[test]
fn the_refined_graph_is_that_of_its_points_and_growth_is_bounded() {
    let scene = scene();
    let coarse = prepare(&scene, &settings(1.0, None));
    let refinement = LightRefinement { tolerance: 1e-3, growth: 1.5, ..LightRefinement::default() };
    let fine = prepare(&scene, &settings(1.0, Some(refinement)));
    let (before, after) = (coarse.points.len(), fine.points.len());
    assert!(after > before && after as f64 <= 1.5 * before as f64, "{before} {after}");
    let area = |p: &Prepared| p.points.area.iter().map(|&a| f64::from(a)).sum::<f64>();
    assert!((area(&fine) / area(&coarse) - 1.0).abs() < 1e-5);
    let tracer = choose(TracerChoice::Voxel, &scene.geometry).expect("it is there");
    let built =
        VisibilityGraph::build(&scene.geometry, &fine.points, tracer.as_ref(), &Silent).expect("built");
    for i in (0..after).step_by(7) {
        assert!((0..after).all(|j| fine.graph.unblocked(i, j) == built.unblocked(i, j)), "point {i}");
    }
}

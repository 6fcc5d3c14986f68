//! Is light that clusters of points exchange as one what all pairs of points exchange?

use crate::rooms;
use crate::small_scenes::*;
use glam::{DMat3, DVec3};
use luxgraph::error::Error;
use luxgraph::first_pass::form_factor::projected_solid_angle;
use luxgraph::first_pass::linked::LinkedOperator;
use luxgraph::first_pass::{DiffuseSolution, FirstPassSettings, Kernel, LinkedRelighter, Solver, solve};
use luxgraph::geometry::{Shape, Sphere};
use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::points::{SamplePoints, Sampling, divide_by_area};
use luxgraph::report::bench::hall::hall;
use luxgraph::report::bench::linked::{Difference, difference};
use luxgraph::scene::{Distribution, Geometry, Light, LightKind, MaterialId, ObjectId, SampledAppearance};
use luxgraph::settings::Settings;
use luxgraph::tracers::{TracerChoice, brute_force::BruteForce, choose};
use luxgraph::visibility::{LinkSettings, LinkStats, Links, VisibilityGraph};
use std::path::Path;

fn of(tolerance: f64) -> LinkSettings {
    LinkSettings { tolerance, ..LinkSettings::default() }
}

/// A scene that is given by its points.
struct Lit {
    geometry: Geometry,
    points: SamplePoints,
    appearance: SampledAppearance,
}

impl Lit {
    fn links(&self, settings: &LinkSettings) -> Links {
        let tracer = choose(TracerChoice::Auto, &self.geometry).unwrap();
        Links::build(&self.geometry, &self.points, tracer.as_ref(), settings, &Silent).unwrap()
    }

    fn over(&self, links: &Links, settings: &FirstPassSettings) -> DiffuseSolution {
        let mut relighter = LinkedRelighter::new(&self.geometry, &self.points, links, settings).unwrap();
        relighter.light(&self.appearance, &Silent).unwrap()
    }

    fn graph(&self) -> VisibilityGraph {
        let tracer = choose(TracerChoice::Auto, &self.geometry).unwrap();
        VisibilityGraph::build(&self.geometry, &self.points, tracer.as_ref(), &Silent).unwrap()
    }

    /// How far light over links is from light between all pairs, for each tolerance.
    fn errors(&self, tolerances: &[f64]) -> Vec<Difference> {
        let settings = tolerances.iter().map(|&tolerance| of(tolerance)).collect::<Vec<_>>();
        self.errors_of(&settings).into_iter().map(|(error, _)| error).collect()
    }

    /// The same for each of some settings, with what the links are.
    fn errors_of(&self, links: &[LinkSettings]) -> Vec<(Difference, LinkStats)> {
        let settings = FirstPassSettings::default();
        let Lit { geometry, points, appearance } = self;
        let all = solve(geometry, points, &self.graph(), appearance, &settings, &Silent).unwrap();
        let error = |of: &LinkSettings| {
            let links = self.links(of);
            let linked = self.over(&links, &settings);
            let error = difference(points, appearance, &all, &linked);
            println!("{}: {:?}, {error:?}", of.tolerance, links.stats);
            (error, links.stats)
        };
        links.iter().map(error).collect()
    }
}

/// A hall of 3 x 4 desks: 498 quadrilaterals.
fn small_hall(max_area: f64) -> Lit {
    let scene = hall(3, 4);
    let geometry = scene.geometry;
    let elements = divide_by_area(&geometry, &Sampling::by_area(max_area));
    let points = rooms::points(&geometry, &elements, 4);
    let appearance = scene.appearance.sample(&geometry, &wavelengths(), 20);
    Lit { geometry, points, appearance }
}

/// A furnished room under a luminaire and a point light.
fn furnished(max_area: f64) -> Lit {
    let mut geometry = rooms::furnished_room(true);
    let position = DVec3::new(1.0, 1.0, 1.0);
    let light = Light {
        name: "bulb".into(),
        kind: LightKind::Point { position, distribution: Distribution::Isotropic },
    };
    geometry.lights.push(light);
    let points = rooms::sample(&geometry, max_area, 4);
    // The quadrilaterals of the luminaire are those of the fifth block, after the room, a table and three more.
    let luminaire = 6 + 30 + 18;
    let material = |s: usize| MaterialId(u32::from((luminaire..luminaire + 6).contains(&s)));
    let appearance = SampledAppearance {
        wavelengths: wavelengths(),
        materials: vec![diffuse(0.6, 0.0), diffuse(0.3, 20.0)],
        surface_material: (0..geometry.surfaces.len()).map(material).collect(),
        lights: vec![vec![1.0; W]],
        sky: None,
    };
    Lit { geometry, points, appearance }
}

/// The sampling of [`bowl_and_ball`].
const COARSE: f64 = 0.08;

/// A bowl of many small faces under a ball of such, in a room with a lamp.
fn bowl_and_ball() -> Lit {
    let mut room = rooms::Furniture::default();
    room.block(DVec3::ONE, DVec3::ONE, DMat3::IDENTITY, true);
    let lamp = [[0.8, 0.8], [0.8, 1.2], [1.2, 1.2], [1.2, 0.8]];
    room.quad(lamp.map(|[x, y]| DVec3::new(x, y, 1.9)), false);
    room.smooth(rooms::ball(DVec3::new(1.1, 1.0, 0.9), 0.2, 4));
    let half = |radius| {
        let below = |t: &[DVec3; 3]| t.iter().all(|v| v.z < 0.7 + 1e-9);
        rooms::ball(DVec3::new(1.0, 1.0, 0.7), radius, 4).into_iter().filter(below)
    };
    room.smooth(half(0.52));
    room.smooth(half(0.5).map(|[a, b, c]| [c, b, a]));
    let geometry = room.geometry();
    let points = rooms::sample(&geometry, COARSE, 4);
    let appearance = SampledAppearance {
        wavelengths: wavelengths(),
        materials: vec![diffuse(0.6, 0.0), diffuse(0.3, 20.0)],
        surface_material: (0..geometry.surfaces.len()).map(|s| MaterialId(u32::from(s == 6))).collect(),
        lights: Vec::new(),
        sky: None,
    };
    Lit { geometry, points, appearance }
}

fn together() -> LinkSettings {
    LinkSettings { together: Some(Sampling::by_area(COARSE)), ..LinkSettings::default() }
}

#[test]
fn small_faces_that_ask_together_are_lit_as_over_all_pairs() {
    let found = bowl_and_ball().errors_of(&[LinkSettings::default(), together()]);
    let [(alone, apart), (grouped, shared)] = &found[..] else { panic!("two of them") };
    assert!(apart.groups > 3 * shared.groups, "{apart:?} {shared:?}");
    assert!(3 * shared.rays_cast < 2 * apart.rays_cast, "{apart:?} {shared:?}");
    assert!(alone.irradiance < 0.01 && grouped.irradiance < 0.01, "{alone:?} {grouped:?}");
    assert!(grouped.bias.abs() < 0.01, "{grouped:?}");
}

#[test]
fn a_closed_cube_glows_with_e_over_one_minus_rho() {
    let tight = FirstPassSettings { tolerance: 1e-5, ..Default::default() };
    let TestScene { geometry, points, appearance, .. } =
        TestScene::new(&cube([0; 6]), vec![diffuse(0.0, 1.0)], 1.0 / 256.0);
    let mut lit = Lit { geometry, points, appearance };
    let links = lit.links(&of(0.02));
    assert!(links.stats.links < 300 * lit.points.len() as u64, "clusters act as one: {:?}", links.stats);
    for rho in [0.5_f32, 0.95, 0.99] {
        lit.appearance.materials = vec![diffuse(rho, 1.0)];
        let solution = lit.over(&links, &tight);
        let expected = 1.0 / (1.0 - rho);
        for &l in &solution.radiance {
            assert!((l / expected - 1.0).abs() < 1e-3, "rho {rho}: {l} for {expected}");
        }
        assert!(solution.stats.flux.error.iter().all(|e| e.abs() < 1e-3), "{:?}", solution.stats.flux);
    }
}

#[test]
fn the_inside_of_a_sphere_glows_as_a_furnace() {
    let sphere = Sphere { centre: DVec3::ZERO, radius: 2.0, inward: false };
    // Seen from both sides: the inside is the one that is closed.
    let shape = (Shape::from(sphere), true, 0, ObjectId(0));
    let geometry = Geometry::new(vec![shape], vec!["sphere".into()]);
    let points = rooms::sample(&geometry, 0.02, 3);
    let appearance = SampledAppearance {
        wavelengths: wavelengths(),
        materials: vec![diffuse(0.9, 1.0)],
        surface_material: vec![MaterialId(0)],
        lights: Vec::new(),
        sky: None,
    };
    let lit = Lit { geometry, points, appearance };
    let solution = lit.over(&lit.links(&of(0.02)), &FirstPassSettings::default());
    let mut inside = 0;
    for i in 0..lit.points.len() {
        let looks_in = lit.points.normal[i].dot(lit.points.position[i]) < 0.0;
        let expected = if looks_in { 10.0 } else { 1.0 };
        inside += usize::from(looks_in);
        assert!((solution.of(i)[0] / expected - 1.0).abs() < 2e-3, "{} for {expected}", solution.of(i)[0]);
    }
    assert!(inside > 1000);
}

#[test]
fn a_hall_is_lit_as_over_all_pairs_and_the_error_falls_with_the_tolerance() {
    let errors = small_hall(0.15).errors(&[0.1, 0.01, 0.001]);
    assert!(errors[1].irradiance < 0.01 && errors[1].bias.abs() < 0.01, "{:?}", errors[1]);
    assert!(errors[1].irradiance < 0.7 * errors[0].irradiance, "{errors:?}");
    assert!(errors[2].irradiance < 0.7 * errors[1].irradiance, "{errors:?}");
}

#[test]
fn a_furnished_room_is_lit_as_over_all_pairs() {
    let errors = furnished(0.05).errors(&[0.03, 0.005]);
    assert!(errors[1].irradiance < 0.01, "{:?}", errors[1]);
    assert!(errors[1].irradiance < errors[0].irradiance, "{errors:?}");
}

#[test]
fn no_link_to_a_cluster_is_wrong_by_more_than_the_tolerance() {
    let (clusters, worst) = worst_link(&small_hall(0.3), &of(0.01));
    assert!(clusters > 10_000 && worst < 0.01);
    let (clusters, worst) = worst_link(&bowl_and_ball(), &together());
    assert!(clusters > 100_000 && worst < 0.01);
}

/// How many links to clusters there are, and by what form factor the worst is wrong.
fn worst_link(lit: &Lit, settings: &LinkSettings) -> (usize, f64) {
    let (points, graph) = (&lit.points, lit.graph());
    let links = lit.links(settings);
    // Any radiance up to 1; the plain kernel leaves nothing to make up for.
    let radiance: Vec<f64> = (0..points.len()).map(|i| (i * 7919 % 1009) as f64 / 1009.0).collect();
    let operator = LinkedOperator::new(points, &links, Kernel::Paper);
    let (mut clusters, mut worst) = (0, 0.0f64);
    for i in 0..points.len() {
        for (c, q) in operator.row(i).filter(|(c, _)| links.hierarchy.clusters[*c].len() > 1) {
            let (mut exchanged, mut power, mut area) = (0.0, 0.0, 0.0);
            for &j in links.hierarchy.points(c) {
                let (j, own) = (j as usize, f64::from(points.area[j as usize]));
                let way = points.position[j] - points.position[i];
                let faces = points.normal[i].dot(way) > 1e-5 && points.normal[j].dot(way) < -1e-5;
                if faces && graph.unblocked(i, j) {
                    exchanged += radiance[j] * f64::from(projected_solid_angle(points, i, j, false));
                }
                power += own * radiance[j];
                area += own;
            }
            let error = (f64::from(q) * power / area - exchanged).abs() / std::f64::consts::PI;
            worst = worst.max(error);
            clusters += 1;
        }
    }
    println!("{clusters} links to clusters, the worst wrong by a form factor of {worst}");
    (clusters, worst)
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for (lit, settings) in [(furnished(0.1), LinkSettings::default()), (bowl_and_ball(), together())] {
        alike_on_any_number_of_threads(&lit, &settings);
    }
}

fn alike_on_any_number_of_threads(lit: &Lit, settings: &LinkSettings) {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let links = lit.links(settings);
            let solution = lit.over(&links, &FirstPassSettings::default());
            (links.cluster, links.share, solution.radiance)
        })
    };
    assert!(run(1) == run(2));
}

#[test]
fn a_new_appearance_over_old_links_gives_the_bits_of_a_fresh_run() {
    let mut lit = furnished(0.1);
    let links = lit.links(&LinkSettings::default());
    let settings = FirstPassSettings::default();
    let (geometry, points) = (lit.geometry.clone(), lit.points.clone());
    let mut relighter = LinkedRelighter::new(&geometry, &points, &links, &settings).unwrap();
    let before = relighter.light(&lit.appearance, &Silent).unwrap();
    assert!(!before.stats.form_factors_reused);
    lit.appearance.materials = vec![diffuse(0.2, 1.0), diffuse(0.8, 0.0)];
    lit.appearance.lights = vec![vec![3.0; W]];
    let relit = relighter.light(&lit.appearance, &Silent).unwrap();
    assert!(relit.stats.form_factors_reused && relit.stats.rays_cast == 0);
    let fresh = lit.over(&lit.links(&LinkSettings::default()), &settings);
    assert!(relit.radiance == fresh.radiance && relit.radiance != before.radiance);
}

#[test]
fn a_dim_room_beside_a_bright_one_is_held_to_its_own_light() {
    let mut quads = cube([0; 6]);
    quads.extend(room(DVec3::new(2.0, 0.0, 0.0), DVec3::new(3.0, 1.0, 1.0), [1; 6]));
    let materials = vec![diffuse(0.5, 1.0), diffuse(0.9, 1e-8)];
    let TestScene { geometry, points, appearance, .. } = TestScene::new(&quads, materials, 1.0 / 64.0);
    let lit = Lit { geometry, points, appearance };
    let solution = lit.over(&lit.links(&of(0.02)), &FirstPassSettings::default());
    for i in 0..lit.points.len() {
        let expected = if lit.points.surface[i].0 < 6 { 2.0 } else { 1e-7 };
        assert!((solution.of(i)[0] / expected - 1.0).abs() < 1e-3, "{} for {expected}", solution.of(i)[0]);
    }
}

#[test]
fn the_pipeline_takes_links_where_the_settings_ask_for_them() {
    let scene = luxgraph::scene::load(Path::new("scenes/cornell_box.toml")).unwrap();
    let geometry = &scene.geometry;
    let tracer = choose(TracerChoice::Auto, geometry).unwrap();
    let tracer = tracer.as_ref();
    let mut settings = Settings::default();
    let lit = |settings: &Settings| {
        let prepared = pipeline::prepare(geometry, &scene.sampling, settings, tracer, None, &Silent).unwrap();
        let (appearance, solution) =
            pipeline::light(geometry, &prepared, &scene.appearance, settings, &Silent).unwrap();
        (prepared, appearance, solution)
    };
    let (prepared, appearance, all) = lit(&settings);
    settings.links = Some(of(0.005));
    let (linked_prepared, _, linked) = lit(&settings);
    assert!(prepared.links.is_none() && linked_prepared.links.is_some() && linked.stats.links > 0);
    let error = difference(&prepared.points, &appearance, &all, &linked);
    assert!(error.irradiance < 0.01, "{error:?}");
    let kept = pipeline::prepare(
        geometry,
        &scene.sampling,
        &settings,
        tracer,
        Some(Path::new("links.graph")),
        &Silent,
    );
    assert!(matches!(kept, Err(Error::Settings(m)) if m.contains("graph file")));
}

#[test]
fn what_links_cannot_do_is_said() {
    let materials = vec![diffuse(0.5, 1.0), glossy(0.5, 0.9, 0.2, 0.1, 0.0)];
    let scene = TestScene::new(&cube([0, 0, 0, 0, 0, 1]), materials, 1.0 / 16.0);
    let (geometry, points) = (&scene.geometry, &scene.points);
    let tracer = BruteForce::new(geometry);
    let build = |settings: &LinkSettings| Links::build(geometry, points, &tracer, settings, &Silent);
    let links = build(&LinkSettings::default()).unwrap();
    let settings = FirstPassSettings::default();
    let mut relighter = LinkedRelighter::new(geometry, points, &links, &settings).unwrap();
    let refused = |result: Result<_, Error>, word: &str| match result {
        Err(Error::Settings(message)) => assert!(message.contains(word), "{message}"),
        _ => panic!("not refused: {word}"),
    };
    refused(relighter.light(&scene.appearance, &Silent).map(|_| ()), "specular");
    for tolerance in [0.0, -1.0, 2.0, f64::NAN] {
        refused(build(&of(tolerance)).map(|_| ()), "tolerance");
    }
    refused(build(&LinkSettings { segments: 0, ..of(0.1) }).map(|_| ()), "segments");
    let shooting = FirstPassSettings { solver: Solver::Shooting, ..settings };
    refused(LinkedRelighter::new(geometry, points, &links, &shooting).map(|_| ()), "iterative");
    let others = TestScene::new(&cube([0; 6]), vec![diffuse(0.5, 1.0)], 1.0 / 64.0).points;
    refused(LinkedRelighter::new(geometry, &others, &links, &settings).map(|_| ()), "other sample points");
    let none = TestScene::new(&[], vec![diffuse(0.5, 1.0)], 1.0);
    let links =
        Links::build(&none.geometry, &none.points, &tracer, &LinkSettings::default(), &Silent).unwrap();
    let mut dark = LinkedRelighter::new(&none.geometry, &none.points, &links, &settings).unwrap();
    assert!(dark.light(&none.appearance, &Silent).unwrap().radiance.is_empty());
}

#[test]
fn what_links_cannot_carry_is_refused_before_they_are_built() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/paper_room.toml");
    let scene = luxgraph::scene::load(&path).expect("a scene that ships");
    let mut settings = Settings { links: Some(of(0.02)), ..Settings::default() };
    settings.first_pass.solver = Solver::Shooting;
    let tracer = choose(TracerChoice::Auto, &scene.geometry).expect("a tracer");
    let prepared =
        pipeline::prepare(&scene.geometry, &scene.sampling, &settings, tracer.as_ref(), None, &Silent);
    assert!(prepared.err().expect("no shooting").to_string().contains("cannot be shot"));
}

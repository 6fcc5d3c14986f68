//! Is the visibility graph right, and does it get there with few rays?

use crate::rooms;
use glam::{DMat3, DVec3};
use luxgraph::error::Error;
use luxgraph::observer::Silent;
use luxgraph::points::SamplePoints;
use luxgraph::points::facing::face_each_other;
use luxgraph::scene::Geometry;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::{RayTracer, Segment};
use luxgraph::visibility::{Edge, GraphSettings, GraphStats, VisibilityGraph};

fn build(geometry: &Geometry, points: &SamplePoints, settings: &GraphSettings) -> VisibilityGraph {
    let tracer = BruteForce::new(geometry);
    VisibilityGraph::build_with(geometry, points, &tracer, settings, &Silent).unwrap()
}

/// The paper's way: no proofs, the last blocker, and rays for the rest.
const PAPER: GraphSettings = GraphSettings { proofs: false, tests: false };

/// All pairs `i < j` that face each other.
fn facing_pairs<'a>(
    geometry: &'a Geometry,
    points: &'a SamplePoints,
) -> impl Iterator<Item = (usize, usize)> + 'a {
    let pairs = (0..points.len()).flat_map(|i| (i + 1..points.len()).map(move |j| (i, j)));
    pairs.filter(|&(i, j)| face_each_other(geometry, points, i, j))
}

/// Whether the tracer's "blocked" comes from one of the two points' own surfaces, which cannot
/// block what faces them: the points lie on the `f32` lattice, up to an ulp behind their surfaces,
/// and a segment almost in the plane may leave through it beyond its margin. Lifting both ends off
/// their surfaces by three plane tolerances must give the graph's answer.
fn grazes_own_surface(
    geometry: &Geometry,
    points: &SamplePoints,
    tracer: &BruteForce,
    (i, j): (usize, usize),
) -> bool {
    let lift = 3.0 * geometry.plane_tolerance() as f32;
    let plain = Segment { from: points.position[i], to: points.position[j] };
    let lifted =
        Segment { from: plain.from + lift * points.normal[i], to: plain.to + lift * points.normal[j] };
    let own = |s| s == points.surface[i] || s == points.surface[j];
    tracer.blocker(&plain).is_some_and(own) && tracer.blocker(&lifted).is_none()
}

#[test]
fn every_facing_pair_agrees_with_brute_force() {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 0.2, 4);
    assert!(points.len() > 1000 && geometry.surfaces.len() > 60);
    let graph = build(&geometry, &points, &GraphSettings::default());
    let tracer = BruteForce::new(&geometry);
    let (mut facing, mut grazing) = (0u64, 0u64);
    for (i, j) in facing_pairs(&geometry, &points) {
        facing += 1;
        let free = tracer.blocker(&Segment { from: points.position[i], to: points.position[j] }).is_none();
        if free != graph.unblocked(i, j) {
            assert!(graph.unblocked(i, j) && grazes_own_surface(&geometry, &points, &tracer, (i, j)));
            grazing += 1;
        }
    }
    assert_eq!(facing, graph.stats.pairs - graph.stats.same_surface - graph.stats.not_facing);
    assert!(grazing * 5000 < facing, "{grazing} of {facing}");
}

#[test]
fn every_pair_is_counted_once_and_few_need_a_ray() {
    let geometry = rooms::furnished_room(true);
    assert_eq!(geometry.surfaces.len(), 134);
    let direct_off = GraphSettings { tests: false, ..GraphSettings::default() };
    let points = rooms::sample(&geometry, 0.06, 5);
    // By rays alone no larger a share of the pairs than the paper's.
    for (settings, most) in [(GraphSettings::default(), 0.001), (direct_off, 0.173)] {
        let n = points.len() as u64;
        let graph = build(&geometry, &points, &settings);
        let s = &graph.stats;
        assert_eq!(s.pairs, n * (n - 1) / 2);
        let classes = [s.same_surface, s.not_facing, s.proved, s.last_blocker, s.direct, s.rays_cast];
        assert_eq!(classes.iter().sum::<u64>(), s.pairs);
        println!("{n} points, share of rays {}", s.ray_fraction());
        assert!(s.ray_fraction() < most, "{}", s.ray_fraction());
        let voxels = graph.voxels() as u64;
        assert_eq!(s.visible_edges + s.hidden_edges + s.partial_edges, voxels * (voxels + 1) / 2);
    }
}

#[test]
fn the_graph_takes_less_than_a_bit_for_every_ordered_pair() {
    let geometry = rooms::furnished_room(true);
    let points = rooms::sample(&geometry, 0.06, 5);
    let n = points.len() as u64;
    let graph = build(&geometry, &points, &GraphSettings::default());
    assert!(graph.memory_bytes() < n * n / 8, "{} bytes for {n} points", graph.memory_bytes());
}

#[test]
fn proofs_and_direct_tests_change_nothing() {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 0.25, 3);
    let tracer = BruteForce::new(&geometry);
    let usual = build(&geometry, &points, &GraphSettings::default());
    let paper = build(&geometry, &points, &PAPER);
    assert_eq!((paper.stats.proved, paper.stats.direct), (0, 0));
    assert!(paper.stats.last_blocker > 0 && paper.stats.rays_cast > usual.stats.rays_cast);
    for (i, j) in facing_pairs(&geometry, &points) {
        if usual.unblocked(i, j) != paper.unblocked(i, j) {
            assert!(usual.unblocked(i, j) && grazes_own_surface(&geometry, &points, &tracer, (i, j)));
        }
    }
}

#[test]
fn edges_mean_what_they_say() {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 0.5, 4);
    let graph = build(&geometry, &points, &GraphSettings::default());
    let mut scratch = Vec::new();
    let mut kinds = [0u64; 3];
    for a in 0..graph.voxels() {
        for b in 0..graph.voxels() {
            let (mut facing, mut seen) = (0, 0);
            let tile = graph.tile(a, b, &mut scratch);
            for (r, i) in graph.voxel(a).enumerate() {
                for (c, j) in graph.voxel(b).enumerate() {
                    let faces = face_each_other(&geometry, &points, i, j);
                    facing += u64::from(faces);
                    seen += u64::from(faces && tile.get(r, c));
                    if matches!(graph.edge(a, b), Edge::Partial(_)) {
                        assert!(faces || !tile.get(r, c), "no bit where points face away");
                    }
                    if i != j {
                        assert_eq!(tile.get(r, c), graph.unblocked(i, j));
                    }
                }
            }
            match graph.edge(a, b) {
                Edge::Visible => assert!(facing > 0 && seen == facing),
                Edge::Hidden => assert_eq!(seen, 0),
                Edge::Partial(_) => assert!(seen > 0 && seen < facing),
            }
            if a <= b {
                let k = match graph.edge(a, b) {
                    Edge::Visible => 0,
                    Edge::Hidden => 1,
                    Edge::Partial(_) => 2,
                };
                kinds[k] += 1;
            }
        }
    }
    let s = &graph.stats;
    assert_eq!(kinds, [s.visible_edges, s.hidden_edges, s.partial_edges]);
}

#[test]
fn any_number_of_threads_gives_the_same_graph() {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 0.25, 4);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| build(&geometry, &points, &PAPER))
    };
    let one = with(1);
    for other in [with(2), with(5)] {
        assert_eq!(GraphStats { build_s: one.stats.build_s, ..other.stats.clone() }, one.stats);
        let mut scratch = (Vec::new(), Vec::new());
        for a in 0..one.voxels() {
            for b in 0..one.voxels() {
                assert_eq!(one.edge(a, b), other.edge(a, b));
                let (x, y) = (one.tile(a, b, &mut scratch.0), other.tile(a, b, &mut scratch.1));
                assert_eq!(format!("{x:?}"), format!("{y:?}"));
            }
        }
    }
}

/// Two unit squares that face each other at distance 2, and halfway a screen that reaches from
/// y = -5 to `edge`, in one voxel each.
fn screened(edge: f64) -> (Geometry, SamplePoints) {
    let mut scene = rooms::Furniture::default();
    let square = |z: f64| [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
    let mut above = square(2.0);
    above.reverse();
    scene.quad(square(0.0), false);
    scene.quad(above, false);
    let screen = [(-5.0, -5.0), (5.0, -5.0), (5.0, edge), (-5.0, edge)];
    scene.quad(screen.map(|(x, y)| DVec3::new(x, y, 1.0)), true);
    let geometry = scene.geometry();
    let elements = luxgraph::points::divide_by_area(&geometry, &luxgraph::points::Sampling::by_area(0.02));
    let points = SamplePoints::new(&geometry, &elements, 3, |p| (p.z.round() + 1.0) as usize);
    (geometry, points)
}

#[test]
fn a_screen_hides_what_it_covers_without_a_ray() {
    for (edge, expected) in [(5.0, Edge::Hidden), (-0.5, Edge::Visible)] {
        let (geometry, points) = screened(edge);
        let graph = build(&geometry, &points, &GraphSettings::default());
        assert_eq!(graph.edge(0, 2), expected);
        assert_eq!((graph.stats.rays_cast, graph.stats.direct, graph.stats.last_blocker), (0, 0, 0));
    }
}

#[test]
fn the_edge_of_a_shadow_falls_where_it_must() {
    let (geometry, points) = screened(0.43);
    let graph = build(&geometry, &points, &GraphSettings::default());
    assert!(matches!(graph.edge(0, 2), Edge::Partial(_)));
    for i in points.voxel(0) {
        for j in points.voxel(2) {
            // The segment passes the screen at the mean of the two heights above y = 0.
            let crossing = geometry.centre.y + 0.5 * f64::from(points.position[i].y + points.position[j].y);
            assert_eq!(graph.unblocked(i, j), crossing > 0.43);
        }
    }
}

#[test]
fn nothing_passes_the_walls_between_two_rooms() {
    let mut rooms = rooms::Furniture::default();
    for x in [0.0, 3.0] {
        let turn = DMat3::from_rotation_z(0.3);
        rooms.block(turn * DVec3::new(x, 0.0, 0.0), DVec3::new(1.4, 1.0, 1.0), turn, true);
    }
    let geometry = rooms.geometry();
    let points = rooms::sample(&geometry, 0.1, 3);
    let graph = build(&geometry, &points, &GraphSettings::default());
    for (i, j) in facing_pairs(&geometry, &points) {
        let same_room = points.surface[i].0 / 6 == points.surface[j].0 / 6;
        assert_eq!(graph.unblocked(i, j), same_room, "{:?} {:?}", points.surface[i], points.surface[j]);
    }
}

#[test]
fn triangles_and_tiny_or_vast_scenes_work() {
    for scale in [1e-3, 1.0, 1e6] {
        let mut scene = rooms::Furniture::default();
        let at = |x: f64, y: f64, z: f64| scale * DVec3::new(x, y, z);
        scene.triangle([at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0), at(0.0, 1.0, 0.0)], false);
        scene.triangle([at(0.0, 0.0, 1.0), at(0.0, 1.0, 1.0), at(1.0, 0.0, 1.0)], false);
        scene.triangle([at(0.1, 0.1, 0.5), at(0.6, 0.1, 0.5), at(0.1, 0.6, 0.45)], true);
        let geometry = scene.geometry();
        let points = rooms::sample(&geometry, 0.003 * scale * scale, 2);
        let graph = build(&geometry, &points, &GraphSettings::default());
        let tracer = BruteForce::new(&geometry);
        let mut blocked = 0;
        for (i, j) in facing_pairs(&geometry, &points) {
            let segment = Segment { from: points.position[i], to: points.position[j] };
            let free = tracer.blocker(&segment).is_none();
            assert!(free == graph.unblocked(i, j) || grazes_own_surface(&geometry, &points, &tracer, (i, j)));
            blocked += u64::from(!free);
        }
        assert!(blocked > 1000);
    }
}

#[test]
fn nothing_makes_an_empty_graph_and_strangers_are_refused() {
    let empty = Geometry::new(Vec::new(), Vec::new());
    let graph = build(&empty, &SamplePoints::default(), &GraphSettings::default());
    assert_eq!((graph.voxels(), graph.stats.pairs), (0, 0));
    assert_eq!(build(&empty, &SamplePoints::new(&empty, &[], 3, |_| 0), &PAPER).voxels(), 3);

    let room = rooms::furnished_room(false);
    let points = rooms::sample(&room, 1.0, 2);
    let tracer = BruteForce::new(&empty);
    let refused = VisibilityGraph::build(&empty, &points, &tracer, &Silent);
    assert!(matches!(refused, Err(Error::Settings(_))));
}

//! Does the crosscheck find what is wrong, and nothing else?

use crate::strewn_room::room;
use glam::DVec3;
use luxgraph::geometry::{Hit, Ray, Shape, Surface, SurfaceId};
use luxgraph::observer::Silent;
use luxgraph::scene::Geometry;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::crosscheck::{CrosscheckReport, ProbeClass, Question, crosscheck};
use luxgraph::tracers::{RayTracer, Segment};

/// Cannot see one surface.
struct Blind<'a>(BruteForce<'a>, SurfaceId);

impl RayTracer for Blind<'_> {
    fn name(&self) -> String {
        "blind".into()
    }

    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.0.closest(ray).filter(|hit| hit.surface != self.1)
    }

    fn blocker(&self, segment: &Segment) -> Option<SurfaceId> {
        self.0.blocker(segment).filter(|&surface| surface != self.1)
    }
}

fn brute_force_alone(geometry: &Geometry, threads: usize) -> CrosscheckReport {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (sound, blind) = (BruteForce::new(geometry), Blind(BruteForce::new(geometry), SurfaceId(0)));
    pool.install(|| crosscheck(geometry, &[&sound, &blind], 6_000, 5, &Silent))
}

#[test]
fn brute_force_is_never_refuted_by_the_judge() {
    for turn in [0.0, 0.4] {
        let geometry = room(6, turn);
        let report = crosscheck(&geometry, &[&BruteForce::new(&geometry)], 20_000, 1, &Silent);
        assert_eq!(report.errors, 0, "{:#?}", report.listed.first());
        assert_eq!(report.rays, 20_000);
        assert!(report.classes.iter().all(|c| c.rays >= 2_000));
    }
}

#[test]
fn a_tracer_that_misses_a_surface_is_found_and_blamed() {
    let geometry = room(6, 0.4);
    let report = brute_force_alone(&geometry, 2);
    let random = report.classes.iter().find(|c| c.class == ProbeClass::Random).unwrap();
    assert!(random.errors[1] > 10, "{random:?}");
    assert!(report.classes.iter().all(|c| c.errors[0] == 0));
    assert!(report.listed[0].is_error());
    assert!(report.listed.iter().any(|d| d.question == Question::Closest && d.judged.contains(&0)));
}

#[test]
fn every_disagreement_is_listed_and_the_text_shows_the_first_and_all_errors() {
    let geometry = room(6, 0.4);
    // The second tracer answers for surfaces moved by no more than rounding.
    let nudged = nudged(&geometry);
    let (sound, off) = (BruteForce::new(&geometry), BruteForce::new(&nudged));
    let report = crosscheck(&geometry, &[&sound, &off], 20_000, 5, &Silent);
    assert!(report.disagreements > 100, "{}", report.disagreements);
    assert_eq!(report.listed.len() as u64, report.disagreements);
    assert!(report.listed.iter().all(|d| d.answers.len() == 2 && d.wrong.len() == 2));
    let text = report.to_string();
    let grazing = text.lines().filter(|l| l.contains("| grazing")).count() as u64;
    assert_eq!(grazing, 20.min(report.disagreements - report.errors));
    assert_eq!(text.lines().filter(|l| l.contains("| ERROR")).count() as u64, report.errors);
    assert_eq!(report.not_shown(), report.disagreements - grazing - report.errors);
    assert!(text.contains(&format!("and {} more", report.not_shown())));

    let report = brute_force_alone(&geometry, 2);
    assert!(report.errors > 100);
    assert_eq!(report.listed.len() as u64, report.disagreements);
    assert_eq!(report.to_string().matches("| ERROR").count() as u64, report.errors);
}

/// The scene with every vertex moved by about a unit in the last place.
fn nudged(geometry: &Geometry) -> Geometry {
    let mut nudged = geometry.clone();
    for (i, surface) in nudged.surfaces.iter_mut().enumerate() {
        let nudge = |v: DVec3| {
            let up =
                |x: f64| f64::from(if i % 2 == 0 { (x as f32).next_up() } else { (x as f32).next_down() });
            DVec3::new(up(v.x), up(v.y), up(v.z))
        };
        *surface = Surface::new(match surface.shape.clone() {
            Shape::Quad(v) => Shape::Quad(v.map(nudge)),
            Shape::Triangle(v) => Shape::Triangle(v.map(nudge)),
            round => round,
        });
    }
    nudged
}

#[test]
fn the_report_does_not_depend_on_the_number_of_threads() {
    let geometry = room(4, 0.3);
    let [one, three] = [1, 3].map(|n| serde_json::to_string(&brute_force_alone(&geometry, n)).unwrap());
    assert_eq!(one, three);
}

#[test]
fn a_scene_without_surfaces_gives_an_empty_report() {
    let geometry = Geometry::new(Vec::new(), Vec::new());
    let report = crosscheck(&geometry, &[&BruteForce::new(&geometry)], 1000, 1, &Silent);
    assert_eq!((report.rays, report.disagreements), (0, 0));
}

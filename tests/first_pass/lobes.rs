//! Are rough lobes that are found from a few directions as good as those between all?

use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::scene::load;
use luxgraph::settings::{Quality, Settings};
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers;
use std::path::PathBuf;

/// The paper's room, whose gold is rough and whose silver nearly smooth.
#[test]
fn the_papers_room_is_the_same_within_a_thousandth() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/paper_room.toml");
    let scene = load(&path).unwrap();
    let geometry = &scene.geometry;
    let mut settings = Settings::preset(Quality::Standard);
    settings.wavelengths = Wavelengths::meyer4();
    let tracer = tracers::choose(settings.tracer, geometry).unwrap();
    let prepared =
        pipeline::prepare(geometry, &scene.sampling, &settings, tracer.as_ref(), None, &Silent).unwrap();
    let lit = |tolerance: f64| {
        let mut settings = settings.clone();
        settings.first_pass.lobe_tolerance = tolerance;
        pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).unwrap()
    };
    let (exact, found) = (lit(0.0).1, lit(settings.first_pass.lobe_tolerance).1);
    let off = |(a, b): (&f32, &f32)| (f64::from(a - b) / f64::from(*a)).powi(2);
    let lit = exact.radiance.iter().zip(&found.radiance).filter(|(a, _)| **a > 0.0);
    let (sum, count) = lit.map(off).fold((0.0, 0), |(sum, count), off| (sum + off, count + 1));
    let off = (sum / f64::from(count)).sqrt();
    println!("{} points: off by {off:.1e}", prepared.points.len());
    assert!(off > 1e-6, "no lobe was found from few directions");
    assert!(off < 1e-3, "{off}");
    for (a, b) in exact.stats.flux.error.iter().zip(&found.stats.flux.error) {
        assert!((a - b).abs() < 1e-5, "no flux may come or go: {a} {b}");
    }
}

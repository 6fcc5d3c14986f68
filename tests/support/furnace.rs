//! Views of closed rooms in which every surface must look alike.

use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::scene::Scene;
use luxgraph::second_pass::SecondPassSettings;
use luxgraph::settings::Settings;
use luxgraph::tracers::{TracerChoice, choose};

/// Holds every pixel of the first camera's view to `radiance` (W m⁻² sr⁻¹ nm⁻¹) within 0.5 %, with both tracers.
pub fn is_even(scene: &Scene, radiance: f64) {
    let settings = Settings::default();
    for choice in [TracerChoice::Voxel, TracerChoice::Auto] {
        let tracer = choose(choice, &scene.geometry).unwrap();
        let (geometry, tracer) = (&scene.geometry, tracer.as_ref());
        let prepared =
            pipeline::prepare(geometry, &scene.sampling, &settings, tracer, None, &Silent).unwrap();
        let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).unwrap();
        let passes = SecondPassSettings { samples: 4, ..Default::default() };
        let (image, _) =
            pipeline::view(geometry, &prepared, &lit, &scene.cameras[0], tracer, &passes, &Silent).unwrap();
        let off = |spectrum: &[f32]| (f64::from(spectrum[0]) / radiance - 1.0).abs();
        let worst = image.radiance.chunks_exact(image.wavelengths.len()).map(off).fold(0.0, f64::max);
        println!("{}: worst {worst}", tracer.name());
        assert!(worst < 0.005, "{}: {worst}", tracer.name());
    }
}

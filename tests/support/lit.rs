//! A scene with its light, as the pipeline makes it.
#![allow(dead_code, reason = "each group of tests uses its share")]

use luxgraph::first_pass::DiffuseSolution;
use luxgraph::measure::Reading;
use luxgraph::observer::Silent;
use luxgraph::pipeline::{self, Prepared};
use luxgraph::scene::{SampledAppearance, Scene, Sensor};
use luxgraph::settings::Settings;
use luxgraph::tracers::{self, RayTracer};
use std::path::Path;

pub struct Lit {
    pub scene: Scene,
    pub settings: Settings,
    pub prepared: Prepared,
    pub light: (SampledAppearance, DiffuseSolution),
}

impl Lit {
    /// Prepares and lights a scene.
    pub fn new(scene: Scene, settings: Settings) -> Lit {
        Lit::over(scene, settings, None)
    }

    /// The same with a file for the graph.
    pub fn over(scene: Scene, settings: Settings, graph: Option<&Path>) -> Lit {
        let geometry = &scene.geometry;
        let tracer = tracers::choose(settings.tracer, geometry).expect("a tracer");
        let prepared =
            pipeline::prepare(geometry, &scene.sampling, &settings, tracer.as_ref(), graph, &Silent)
                .expect("prepared");
        drop(tracer);
        let light = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &Silent).expect("lit");
        assert_eq!(light.1.stats.rays_cast, 0);
        Lit { scene, settings, prepared, light }
    }

    pub fn tracer(&self) -> Box<dyn RayTracer + '_> {
        tracers::choose(self.settings.tracer, &self.scene.geometry).expect("a tracer")
    }

    pub fn solution(&self) -> &DiffuseSolution {
        &self.light.1
    }

    /// Share of the flux that the account of the first pass misses, at the worst wavelength.
    pub fn flux_error(&self) -> f64 {
        self.solution().stats.flux.error.iter().fold(0.0f64, |most, e| most.max(e.abs()))
    }

    /// All radiances together.
    pub fn sum(&self) -> f64 {
        self.solution().radiance.iter().map(|&l| f64::from(l)).sum()
    }

    pub fn readings(&self, sensors: &[Sensor]) -> Vec<Reading> {
        let (tracer, settings) = (self.tracer(), &self.settings.measure);
        let geometry = &self.scene.geometry;
        pipeline::measure(geometry, &self.prepared, &self.light, sensors, tracer.as_ref(), settings, &Silent)
            .expect("measured")
    }
}

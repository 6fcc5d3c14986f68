//! Small scenes, built and lit as any other.

use crate::error::Result;
use crate::first_pass::diffuse::DiffuseOperator;
use crate::first_pass::{DiffuseSolution, Kernel};
use crate::geometry::{Shape, SurfaceId};
use crate::material::{Body, Emission, Fresnel, Level, Material};
use crate::measure::{Illuminance, Reading};
use crate::observer::Silent;
use crate::pipeline::{self, Prepared};
use crate::points::Sampling;
use crate::scene::{
    Appearance, Distribution, Geometry, Light, LightKind, LightLevel, LightSource, MaterialId, ObjectId,
    SampledAppearance, Sensor, Sky, SkyLevel, SkyShape,
};
use crate::settings::Settings;
use crate::spectrum::Spectrum;
use crate::tracers;
use glam::DVec3;
use std::f64::consts::PI;

/// A scene in the making.
#[derive(Default)]
pub struct Model {
    shapes: Vec<Shape>,
    max_area: Vec<f64>,
    worn: Vec<MaterialId>,
    materials: Vec<Material>,
    lights: Vec<(LightKind, LightSource)>,
    sky: Option<Sky>,
}

/// A scene with its light.
pub struct Lit<'a> {
    settings: &'a Settings,
    /// Surfaces in the order in which they were added.
    geometry: Geometry,
    /// Points and graph.
    pub prepared: Prepared,
    /// Materials at the wavelengths of the run, and the first pass.
    lit: (SampledAppearance, DiffuseSolution),
}

impl Model {
    /// A grey diffuse material of this reflectance that emits this luminance, cd/m².
    pub fn diffuse(&mut self, reflectance: f64, luminance: f64) -> MaterialId {
        let grey = |value| Spectrum::Constant(value);
        let emission = Emission { spectrum: grey(1.0), level: Level::Luminance(luminance) };
        self.materials.push(Material {
            name: format!("material {}", self.materials.len()),
            body: Body::Opaque {
                s: 0.0,
                m: 0.0,
                diffuse: Some(grey(reflectance)),
                fresnel: Fresnel::Index { n: grey(1.5), k: grey(0.0) },
            },
            emission: (luminance > 0.0).then_some(emission),
        });
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// A clear pane of this index.
    pub fn pane(&mut self, n: f64) -> MaterialId {
        self.materials.push(Material {
            name: format!("material {}", self.materials.len()),
            body: Body::Pane { n: Spectrum::Constant(n), transmittance: Spectrum::Constant(1.0) },
            emission: None,
        });
        MaterialId(self.materials.len() as u32 - 1)
    }

    /// Adds a surface whose elements are no larger than `max_area`, m².
    pub fn add(&mut self, shape: Shape, material: MaterialId, max_area: f64) {
        self.shapes.push(shape);
        self.max_area.push(max_area);
        self.worn.push(material);
    }

    /// Adds a quadrilateral, corners counter-clockwise from the front, with `max_area` as above.
    pub fn quad(&mut self, corners: [[f64; 3]; 4], material: MaterialId, max_area: f64) {
        self.add(Shape::Quad(corners.map(DVec3::from_array)), material, max_area);
    }

    /// Adds a point light.
    pub fn point(
        &mut self,
        position: [f64; 3],
        distribution: Distribution,
        spectrum: Spectrum,
        level: LightLevel,
    ) {
        let kind = LightKind::Point { position: DVec3::from_array(position), distribution };
        self.lights.push((kind, LightSource { spectrum, level }));
    }

    /// Adds white parallel light of this illuminance that comes from a direction.
    pub fn sun(&mut self, from: DVec3, illuminance: f64) {
        let spectrum = Spectrum::Constant(1.0);
        let kind = LightKind::Directional { from, radius: 0.0, reach: 0.0 };
        self.lights.push((kind, LightSource { spectrum, level: LightLevel::Illuminance(illuminance) }));
    }

    /// Puts the scene under a white sky of a type, with the zenith along z, the sun at an elevation over x, and black
    /// ground.
    pub fn sky(&mut self, kind: u8, elevation_deg: f64, level: SkyLevel) {
        let (sin, cos) = elevation_deg.to_radians().sin_cos();
        let shape = SkyShape { up: DVec3::Z, sun: DVec3::new(cos, 0.0, sin), kind };
        let (spectrum, ground) = (Spectrum::Constant(1.0), Spectrum::Constant(0.0));
        self.sky = Some(Sky { shape, spectrum, level, ground });
    }

    /// Prepares and lights the scene.
    pub fn light(self, settings: &Settings) -> Result<Lit<'_>> {
        // Glass has points on both sides.
        let glass = |m: MaterialId| matches!(self.materials[m.0 as usize].body, Body::Pane { .. });
        let shapes = self.shapes.iter().zip(&self.worn).enumerate();
        let shapes = shapes.map(|(i, (s, m))| (s.clone(), glass(*m), i as u32, ObjectId(0)));
        let mut geometry = Geometry::new(shapes.collect(), vec!["validation".into()]);
        geometry.max_area = self.max_area.iter().map(|&a| Some(a)).collect();
        let mut lights = Vec::new();
        geometry.zenith = self.sky.as_ref().map(|sky| sky.shape.up);
        for (mut kind, source) in self.lights {
            match &mut kind {
                LightKind::Point { position, .. } => *position -= geometry.centre,
                LightKind::Directional { reach, .. } => *reach = 1.01 * geometry.radius,
            }
            let name = format!("light {}", lights.len());
            geometry.lights.push(Light { name, kind });
            lights.push(source);
        }
        let appearance =
            Appearance { materials: self.materials, surface_material: self.worn, lights, sky: self.sky };
        let sampling = Sampling::by_area(f64::MAX);
        let prepared = {
            let tracer = tracers::choose(settings.tracer, &geometry)?;
            pipeline::prepare(&geometry, &sampling, settings, tracer.as_ref(), None, &Silent)?
        };
        let lit = pipeline::light(&geometry, &prepared, &appearance, settings, &Silent)?;
        Ok(Lit { settings, geometry, prepared, lit })
    }
}

impl Lit<'_> {
    /// The first pass.
    pub fn solution(&self) -> &DiffuseSolution {
        &self.lit.1
    }

    /// Luminance of the diffuse light that leaves point `i`, cd/m².
    pub fn luminance(&self, i: usize) -> f64 {
        self.solution().wavelengths.xyz(self.solution().of(i))[1]
    }

    /// Illuminance at point `i` of a grey surface that is not black, lx.
    pub fn illuminance(&self, i: usize) -> f64 {
        let material = self.lit.0.of(self.prepared.points.surface[i]);
        let emitted = self.solution().wavelengths.xyz(&material.emission)[1];
        (self.luminance(i) - emitted) * PI / f64::from(material.diffuse[0])
    }

    /// The points of surface number `s`.
    pub fn on(&self, s: usize) -> impl Iterator<Item = usize> + '_ {
        let points = &self.prepared.points;
        (0..points.len()).filter(move |&i| points.surface[i] == SurfaceId(s as u32))
    }

    /// Mean by area of a quantity of `points`.
    pub fn mean(&self, points: impl Iterator<Item = usize>, value: impl Fn(usize) -> f64) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for i in points {
            let area = f64::from(self.prepared.points.area[i]);
            sum += area * value(i);
            total += area;
        }
        sum / total
    }

    /// Spectral radius of the form factors: by how much light grows from one diffuse bounce between
    /// perfectly white walls to the next.
    pub fn growth(&self, kernel: Kernel) -> f64 {
        let operator = DiffuseOperator::new(
            &self.geometry,
            &self.prepared.points,
            &self.prepared.graph,
            kernel,
            &Silent,
        );
        let mut light = vec![1.0; self.prepared.points.len()];
        let mut growth = 0.0;
        for _ in 0..40 {
            let next: Vec<f32> =
                operator.irradiance(&light, |_| true).iter().map(|e| e / PI as f32).collect();
            let norm = |l: &[f32]| l.iter().map(|&l| f64::from(l).powi(2)).sum::<f64>().sqrt();
            growth = norm(&next) / norm(&light);
            light = next.iter().map(|l| l / growth as f32).collect();
        }
        growth
    }

    /// (j, F_ij) of all pairs of points i and j, 0 for those that do not see each other.
    pub fn factors(&self) -> Vec<(usize, f64)> {
        let (points, graph) = (&self.prepared.points, &self.prepared.graph);
        let operator = DiffuseOperator::new(&self.geometry, points, graph, Kernel::Analytic, &Silent);
        let factor = &|i: usize, j: usize| {
            if graph.unblocked(i, j) { f64::from(operator.factor(i, j)) / PI } else { 0.0 }
        };
        let others = |i: usize| (0..points.len()).filter(move |&j| j != i);
        (0..points.len()).flat_map(|i| others(i).map(move |j| (j, factor(i, j)))).collect()
    }

    /// What sensors at these places with these normals read.
    pub fn read(&self, sensors: impl IntoIterator<Item = ([f64; 3], [f64; 3])>) -> Result<Vec<Reading>> {
        let sensor = |(position, normal)| Sensor {
            name: "validation".into(),
            position: DVec3::from_array(position),
            normal: DVec3::from_array(normal),
        };
        let sensors: Vec<Sensor> = sensors.into_iter().map(sensor).collect();
        let (tracer, measure) =
            (tracers::choose(self.settings.tracer, &self.geometry)?, &self.settings.measure);
        let (prepared, lit) = (&self.prepared, &self.lit);
        pipeline::measure(&self.geometry, prepared, lit, &sensors, tracer.as_ref(), measure, &Silent)
    }

    /// Photopic and melanopic illuminance of an irradiance.
    pub fn lux(&self, irradiance: &[f64]) -> Illuminance {
        Illuminance::of(irradiance, &self.solution().wavelengths)
    }

    /// Illuminance at one sensor, lx.
    pub fn illuminance_at(&self, position: [f64; 3], normal: [f64; 3]) -> Result<f64> {
        let readings = self.read([(position, normal)])?;
        Ok(readings.iter().map(|r| self.lux(&r.total()).illuminance_lx).sum())
    }
}

//! Small scenes for the tests of the first pass.
#![allow(dead_code, reason = "each group of tests uses its share")]

use glam::DVec3;
use luxgraph::first_pass::{DiffuseSolution, FirstPassSettings, solve};
use luxgraph::geometry::{Shape, Side, SurfaceId};
use luxgraph::material::{FresnelTable, SampledMaterial, Transmission};
use luxgraph::observer::Silent;
use luxgraph::points::{SamplePoints, Sampling, divide_by_area};
use luxgraph::scene::{Geometry, MaterialId, ObjectId, SampledAppearance};
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::{RayTracer, Segment, brute_force::BruteForce};
use luxgraph::visibility::VisibilityGraph;

pub const W: usize = 3;

pub fn wavelengths() -> Wavelengths {
    Wavelengths::points(vec![450.0, 550.0, 650.0], vec![[1.0; 3]; W])
}

/// Factor `k` scales the wavelengths apart, so that mixing them up shows.
fn table(value: f32) -> FresnelTable {
    FresnelTable { wavelengths: W, values: vec![value; 20 * W] }
}

pub fn diffuse(rho: f32, emission: f32) -> SampledMaterial {
    SampledMaterial {
        diffuse: vec![rho; W],
        s: 0.0,
        m: 0.0,
        reflect: table(0.0),
        transmission: None,
        spread: None,
        emission: vec![emission; W],
    }
}

/// Specular share `s` with Fresnel factor `f` and roughness `m`, the rest diffuse with `rho`.
pub fn glossy(s: f64, f: f32, m: f64, rho: f32, emission: f32) -> SampledMaterial {
    SampledMaterial { s, m, reflect: table(f), ..diffuse(rho, emission) }
}

pub fn pane(reflect: f32, transmit: f32) -> SampledMaterial {
    SampledMaterial {
        s: 1.0,
        reflect: table(reflect),
        transmission: Some(Transmission::Pane { transmit: table(transmit) }),
        ..diffuse(0.0, 0.0)
    }
}

/// A solid of index `n` with the exact Fresnel factors of a dielectric.
pub fn solid(n: f64, absorption: f32) -> SampledMaterial {
    let fresnel = |n: f64| FresnelTable::new(W, 200, |_, cosine| dielectric(cosine, n));
    SampledMaterial {
        s: 1.0,
        reflect: fresnel(n),
        transmission: Some(Transmission::Solid {
            n,
            inside: fresnel(1.0 / n),
            absorption: vec![absorption; W],
        }),
        ..diffuse(0.0, 0.0)
    }
}

pub fn dielectric(cosine: f64, n: f64) -> f64 {
    let sin2 = (1.0 - cosine * cosine) / (n * n);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let t = (1.0 - sin2).sqrt();
    let (a, b) = ((cosine - n * t) / (cosine + n * t), (n * cosine - t) / (n * cosine + t));
    0.5 * (a * a + b * b)
}

/// A quad, its material and whether it has two sides.
pub type Quad = ([DVec3; 4], usize, bool);

/// The six faces of a box seen from inside: x0 x1 y0 y1 z0 z1.
pub fn room(lo: DVec3, hi: DVec3, materials: [usize; 6]) -> Vec<Quad> {
    let v = |i: usize| {
        DVec3::new(
            if i & 1 == 0 { lo.x } else { hi.x },
            if i & 2 == 0 { lo.y } else { hi.y },
            if i & 4 == 0 { lo.z } else { hi.z },
        )
    };
    let faces = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
    faces.iter().zip(materials).map(|(f, m)| (f.map(v), m, false)).collect()
}

/// The same seen from outside.
pub fn block(lo: DVec3, hi: DVec3, material: usize, two_sided: bool) -> Vec<Quad> {
    let turn = |([a, b, c, d], m, _): Quad| ([d, c, b, a], m, two_sided);
    room(lo, hi, [material; 6]).into_iter().map(turn).collect()
}

pub struct TestScene {
    pub geometry: Geometry,
    pub points: SamplePoints,
    pub graph: VisibilityGraph,
    pub appearance: SampledAppearance,
}

impl TestScene {
    pub fn new(quads: &[Quad], materials: Vec<SampledMaterial>, max_area: f64) -> Self {
        Self::with_areas(quads, materials, max_area, &[])
    }

    /// [`TestScene::new`] with surfaces that have a largest element of their own.
    pub fn with_areas(
        quads: &[Quad],
        materials: Vec<SampledMaterial>,
        max_area: f64,
        areas: &[(usize, f64)],
    ) -> Self {
        let shapes =
            quads.iter().enumerate().map(|(i, (v, _, two))| (Shape::Quad(*v), *two, i as u32, ObjectId(0)));
        let mut geometry = Geometry::new(shapes.collect(), vec!["test".into()]);
        areas.iter().for_each(|&(surface, area)| geometry.max_area[surface] = Some(area));
        let elements = divide_by_area(&geometry, &Sampling::by_area(max_area));
        // Octants, so that tiles of several voxels are met in both orders.
        let octant =
            |p: DVec3| usize::from(p.x > 0.0) + 2 * usize::from(p.y > 0.0) + 4 * usize::from(p.z > 0.0);
        let points = SamplePoints::new(&geometry, &elements, 8, octant);
        let tracer = BruteForce::new(&geometry);
        let faces = |i: usize, j: usize| points.normal[i].dot(points.position[j] - points.position[i]) > 1e-6;
        let graph = VisibilityGraph::from_fn(&points, |i, j| {
            faces(i, j)
                && faces(j, i)
                && tracer.blocker(&Segment { from: points.position[i], to: points.position[j] }).is_none()
        });
        let appearance = SampledAppearance {
            wavelengths: wavelengths(),
            materials,
            surface_material: quads.iter().map(|q| MaterialId(q.1 as u32)).collect(),
            lights: Vec::new(),
            sky: None,
        };
        TestScene { geometry, points, graph, appearance }
    }

    pub fn solve(&self, settings: &FirstPassSettings) -> luxgraph::error::Result<DiffuseSolution> {
        solve(&self.geometry, &self.points, &self.graph, &self.appearance, settings, &Silent)
    }

    /// Points of surface `s` on its front.
    pub fn of_surface(&self, s: u32) -> Vec<usize> {
        let is = |&i: &usize| self.points.surface[i] == SurfaceId(s) && self.points.side[i] == Side::Front;
        (0..self.points.len()).filter(is).collect()
    }

    /// Mean radiance over surface `s` less emission, weighted by area, first wavelength.
    pub fn mean(&self, solution: &DiffuseSolution, s: u32) -> f64 {
        let points = self.of_surface(s);
        let area: f64 = points.iter().map(|&i| f64::from(self.points.area[i])).sum();
        let sum: f64 =
            points.iter().map(|&i| f64::from(self.points.area[i]) * f64::from(solution.of(i)[0])).sum();
        sum / area
    }
}

pub fn cube(materials: [usize; 6]) -> Vec<Quad> {
    room(DVec3::ZERO, DVec3::ONE, materials)
}

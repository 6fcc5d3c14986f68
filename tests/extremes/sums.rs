//! Sums of a million terms.

use super::table::Table;
use glam::DVec3;
use luxgraph::first_pass::{FirstPassSettings, solve};
use luxgraph::geometry::Shape;
use luxgraph::material::{FresnelTable, SampledMaterial};
use luxgraph::observer::Silent;
use luxgraph::points::{Sampling, sample};
use luxgraph::scene::{Geometry, MaterialId, ObjectId, SampledAppearance};
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::VoxelTracer;
use luxgraph::visibility::VisibilityGraph;
use luxgraph::voxels::{VoxelSettings, Voxels};
use std::f64::consts::PI;

fn material(w: usize, rho: f32, emission: f32) -> SampledMaterial {
    SampledMaterial {
        diffuse: vec![rho; w],
        s: 0.0,
        m: 0.0,
        reflect: FresnelTable { wavelengths: w, values: vec![0.0; 20 * w] },
        transmission: None,
        spread: None,
        emission: vec![emission; w],
    }
}

/// A rectangle in the plane z = 0 that looks up.
fn strip(x: [f64; 2], y: [f64; 2]) -> Shape {
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    Shape::Quad([at(x[0], y[0]), at(x[1], y[0]), at(x[1], y[1]), at(x[0], y[1])])
}

/// π F from a point at height 1 over a corner of the rectangle x by y, face to face with it.
fn corner_factor(x: f64, y: f64) -> f64 {
    let (a, b) = (f64::sqrt(1.0 + x * x), f64::sqrt(1.0 + y * y));
    0.5 * (x / a * f64::atan(y / a) + y / b * f64::atan(x / b))
}

#[test]
fn the_light_of_a_million_elements() {
    let mut table = Table::new("irradiance of one point from a floor of 983,040 elements; emitted flux");
    // Three strips in 4^9 elements each and three in 4^8.
    let side = |i: i32| -3.0 + f64::from(i);
    let mut shapes: Vec<_> =
        (0..6).map(|i| (strip([side(i), side(i + 1)], [-3.0, 3.0]), false, i as u32, ObjectId(0))).collect();
    let edge = 1e-3;
    let above = [[-edge, -edge], [-edge, edge], [edge, edge], [edge, -edge]];
    shapes.push((Shape::Quad(above.map(|[x, y]| DVec3::new(x, y, 1.0))), false, 6, ObjectId(0)));
    let mut geometry = Geometry::new(shapes, vec!["all".into()]);
    for i in 0..6 {
        let level = if i % 2 == 0 { 9 } else { 8 };
        geometry.max_area[i] = Some(1.001 * 6.0 / 4f64.powi(level));
    }
    let voxels = Voxels::build(&geometry, &VoxelSettings { max_objects: 0, max_level: 9 });
    let points = sample(&geometry, &Sampling::by_area(1.0), &voxels).expect("within the limit");
    assert_eq!(points.len(), 983_041);
    let tracer = VoxelTracer::new(&geometry);
    let graph = VisibilityGraph::build(&geometry, &points, &tracer, &Silent).expect("a graph");
    let wavelengths = Wavelengths::meyer4();
    let w = wavelengths.len();
    let appearance = SampledAppearance {
        materials: vec![material(w, 0.0, 1.0), material(w, 0.5, 0.0)],
        wavelengths,
        surface_material: (0..7).map(|i| MaterialId(i / 6)).collect(),
        lights: Vec::new(),
        sky: None,
    };
    let solution = solve(&geometry, &points, &graph, &appearance, &FirstPassSettings::default(), &Silent)
        .expect("light");
    let receiver = (0..points.len()).find(|&i| points.surface[i].0 == 6).expect("the point above");
    // L = rho E / π, E = Σ of what the four quarters of the floor subtend.
    let expected = 0.5 * 4.0 * corner_factor(3.0, 3.0) / PI;
    table.relative("radiance of the point above", expected, f64::from(solution.of(receiver)[0]), 1e-6);
    table.relative("emitted flux, W/nm", PI * 36.0, solution.stats.flux.emitted[0], 1e-12);
    table.relative("row sum of the point above", 2.0 * expected, solution.stats.row_sum.max, 1e-6);
    table.judge();
}

#[test]
fn a_dim_sum_beside_a_bright_one() {
    // The view's sums: a pixel of 65536 samples of 0.1 is 0.1.
    let mut table = Table::new("a pixel of 65,536 samples");
    let mut model = super::model::Model::furnace(0.0, 0.1);
    model.max_area = 1.0;
    let toml = model.toml().replace("[8, 6]", "[1, 1]");
    let mut settings = super::lit::tight();
    (settings.second_pass.samples, settings.second_pass.lobe_samples) = (65536, 1);
    let lit = super::lit::light_of(&toml, &settings).expect("one pixel");
    table.all("mean of equal samples", lit.emission(0), lit.pixels(), 1e-7);
    table.judge();
}

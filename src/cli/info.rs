//! `luxgraph info`

use super::say::say;
use clap::Args;
use luxgraph::error::Result;
use luxgraph::geometry::Round;
use luxgraph::material::{Body, Material};
use luxgraph::points::divide_by_area;
use luxgraph::report::{Machine, write_json};
use luxgraph::scene::{self, Distribution, LightKind, Scene};
use luxgraph::spectrum::luminance_of;
use luxgraph::tracers::embree;
use serde::Serialize;
use std::path::PathBuf;

/// `info`
#[derive(Debug, Args)]
pub struct Info {
    /// Scene file; without it, what this build has
    pub scene: Option<PathBuf>,
    /// Write the same as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// What this build has.
#[derive(Serialize)]
struct Build {
    luxgraph: &'static str,
    embree: Option<String>,
    machine: Machine,
}

/// What a scene consists of and requires.
#[derive(Serialize)]
struct Contents {
    centre_m: [f64; 3],
    size_m: [f64; 3],
    objects: usize,
    surfaces: usize,
    discs: usize,
    spheres: usize,
    cylinders: usize,
    cones: usize,
    patches: usize,
    two_sided_surfaces: usize,
    area_m2: f64,
    points: usize,
    specular_points: usize,
    cameras: Vec<String>,
    lights: Vec<LightLine>,
    sky: Option<SkyLine>,
    sensors: usize,
    grids: Vec<String>,
    materials: Vec<MaterialLine>,
    requires: Vec<&'static str>,
    left_out: Vec<&'static str>,
    notes: Vec<String>,
}

/// One material in use.
#[derive(Serialize)]
struct MaterialLine {
    name: String,
    kind: &'static str,
    emits: bool,
    surfaces: usize,
    points: usize,
}

/// The sky.
#[derive(Serialize)]
struct SkyLine {
    /// 1 to 15 of CIE S 011, or 16.
    kind: u8,
    zenith_luminance_cd_m2: f64,
    /// Of a horizontal plane that sees all of it.
    illuminance_lx: f64,
}

/// One light, with all its points.
#[derive(Serialize)]
struct LightLine {
    name: String,
    kind: &'static str,
    points: usize,
    flux_lm: Option<f64>,
    illuminance_lx: Option<f64>,
    /// Flux by the table of its IES file.
    file_lm: Option<f64>,
    /// Flux of the bare lamps by that file.
    lamps_lm: Option<f64>,
}

fn lights(scene: &Scene) -> Vec<LightLine> {
    let mut lines: Vec<LightLine> = Vec::new();
    for (light, source) in scene.geometry.lights.iter().zip(&scene.appearance.lights) {
        // An amount in lm or lx.
        let amount = source.factor(light) * luminance_of(&source.spectrum);
        if let Some(line) = lines.last_mut().filter(|line| line.name == light.name) {
            line.points += 1;
            line.flux_lm = line.flux_lm.map(|flux| flux + amount * light.flux_share());
            continue;
        }
        let name = light.name.clone();
        let LightKind::Point { distribution, .. } = &light.kind else {
            let (kind, illuminance_lx) = ("directional", Some(amount));
            let none = None;
            let line = LightLine {
                name,
                kind,
                points: 1,
                flux_lm: none,
                illuminance_lx,
                file_lm: none,
                lamps_lm: none,
            };
            lines.push(line);
            continue;
        };
        let (kind, web) = match distribution {
            Distribution::Isotropic => ("isotropic", None),
            Distribution::Lambertian { .. } => ("lambertian", None),
            Distribution::Spot { .. } => ("spot", None),
            Distribution::Web { web, .. } => ("ies", Some(web)),
        };
        lines.push(LightLine {
            name,
            kind,
            points: 1,
            flux_lm: Some(amount * light.flux_share()),
            illuminance_lx: None,
            file_lm: web.map(|web| web.largest() * web.solid_angle()),
            lamps_lm: web.and_then(|web| web.lamps_lm()),
        });
    }
    lines
}

/// Prints what the build has, and what a scene requires.
pub fn run(args: &Info) -> Result<()> {
    let build =
        Build { luxgraph: env!("CARGO_PKG_VERSION"), embree: embree::available(), machine: Machine::this() };
    match &args.scene {
        None => {
            say!("luxgraph {}", build.luxgraph);
            match &build.embree {
                Some(version) => say!("ray tracers: embree {version} (default), voxel"),
                None => say!("ray tracers: voxel (build with --features embree to add Intel Embree)"),
            }
            say!("threads: {} on {}", build.machine.threads, build.machine.processor);
            if let Some(path) = &args.report {
                write_json(path, &build)?;
            }
        }
        Some(path) => {
            let contents = contents(&scene::load(path)?);
            print_contents(&contents);
            if let Some(path) = &args.report {
                write_json(path, &contents)?;
            }
        }
    }
    Ok(())
}

fn kind(material: &Material) -> &'static str {
    match material.body {
        Body::Opaque { s: 0.0, .. } => "diffuse",
        Body::Opaque { m: 0.0, .. } => "perfect mirror",
        Body::Opaque { .. } => "glossy",
        Body::Pane { .. } => "glass pane",
        Body::Solid { .. } => "solid glass",
    }
}

fn contents(scene: &Scene) -> Contents {
    let geometry = &scene.geometry;
    let mut points_on = vec![0usize; geometry.surfaces.len()];
    for (surface, _) in divide_by_area(geometry, &scene.sampling) {
        points_on[surface.index()] += if geometry.two_sided[surface.index()] { 2 } else { 1 };
    }
    let described = &scene.appearance.materials;
    // Surfaces and points of each material.
    let mut counts = vec![(0, 0); described.len()];
    for (points, material) in points_on.iter().zip(&scene.appearance.surface_material) {
        let count = &mut counts[material.0 as usize];
        *count = (count.0 + 1, count.1 + points);
    }
    let worn =
        || described.iter().zip(&counts).filter(|(_, count)| count.0 > 0).map(|(material, _)| material);
    let line = |(material, &(surfaces, points)): (&Material, &(usize, usize))| {
        let (name, emits) = (material.name.clone(), material.emission.is_some());
        MaterialLine { name, kind: kind(material), emits, surfaces, points }
    };
    let materials: Vec<MaterialLine> =
        described.iter().zip(&counts).map(line).filter(|line| line.surfaces > 0).collect();
    let glass = worn().any(|m| matches!(m.body, Body::Pane { .. } | Body::Solid { .. }));
    let specular = worn().any(Material::is_specular);
    let (mut requires, mut left_out) = (vec!["diffuse exchange"], Vec::new());
    if specular { &mut requires } else { &mut left_out }.push("specular chains");
    if glass { &mut requires } else { &mut left_out }.push("transmission");
    let size = geometry.bounds().size();
    let rounds = || geometry.surfaces.iter().filter_map(|s| s.round());
    let count = |kind: fn(&Round) -> bool| rounds().filter(|round| kind(round)).count();
    Contents {
        centre_m: geometry.centre.to_array(),
        size_m: if geometry.surfaces.is_empty() { [0.0; 3] } else { size.to_array() },
        objects: geometry.objects.len(),
        surfaces: geometry.surfaces.len(),
        discs: count(|round| matches!(round, Round::Disc(_))),
        spheres: count(|round| matches!(round, Round::Sphere(_))),
        cylinders: count(|round| matches!(round, Round::Cone(cone) if cone.radius == cone.top_radius)),
        patches: count(|round| matches!(round, Round::Patch(_))),
        cones: count(|round| matches!(round, Round::Cone(cone) if cone.radius != cone.top_radius)),
        two_sided_surfaces: geometry.two_sided.iter().filter(|&&t| t).count(),
        area_m2: geometry.surfaces.iter().map(|s| s.area).sum(),
        points: points_on.iter().sum(),
        specular_points: described
            .iter()
            .zip(&counts)
            .filter(|(material, _)| material.is_specular())
            .map(|(_, count)| count.1)
            .sum(),
        cameras: scene.cameras.iter().map(|c| c.name.clone()).collect(),
        lights: lights(scene),
        sky: scene.appearance.sky.as_ref().map(|sky| {
            let zenith_luminance_cd_m2 = sky.factor() * luminance_of(&sky.spectrum);
            let illuminance_lx = zenith_luminance_cd_m2 * sky.shape.horizontal();
            SkyLine { kind: sky.shape.kind, zenith_luminance_cd_m2, illuminance_lx }
        }),
        sensors: scene.sensors.len(),
        grids: scene.grids.iter().map(|g| g.name.clone()).collect(),
        materials,
        requires,
        left_out,
        notes: scene.notes.clone(),
    }
}

fn print_contents(contents: &Contents) {
    let [x, y, z] = contents.size_m;
    say!(
        "{} surfaces ({} two-sided) of {} objects",
        contents.surfaces,
        contents.two_sided_surfaces,
        contents.objects
    );
    let Contents { discs, spheres, cylinders, cones, patches, .. } = contents;
    if discs + spheres + cylinders + cones + patches > 0 {
        say!(
            "discs: {discs}, spheres: {spheres}, cylinders: {cylinders}, cones: {cones}, patches: {patches}"
        );
    }
    say!("{x:.3} x {y:.3} x {z:.3} m, {:.3} m² of surface", contents.area_m2);
    say!("{} sample points by area, {} of them specular", contents.points, contents.specular_points);
    say!("cameras: {}", contents.cameras.join(", "));
    for line in &contents.lights {
        let spread = if line.points > 1 { format!(", {} points", line.points) } else { String::new() };
        let (amount, unit) = match line.illuminance_lx {
            Some(lux) => (lux, "lx"),
            None => (line.flux_lm.unwrap_or(0.0), "lm"),
        };
        let file = match (line.file_lm, line.lamps_lm) {
            // A file may leave its lamps' flux at 0: no share of that can be told.
            (Some(file), Some(0.0)) => format!("; its file: {file:.1} lm"),
            (Some(file), Some(lamps)) => {
                format!("; its file: {file:.1} lm, {:.1} % of its lamps' {lamps:.0} lm", 100.0 * file / lamps)
            }
            (Some(file), None) => format!("; its file: {file:.1} lm, absolute photometry"),
            _ => String::new(),
        };
        say!("light {}: {}{spread}, {amount:.1} {unit}{file}", line.name, line.kind);
    }
    if let Some(sky) = &contents.sky {
        let (zenith, lux) = (sky.zenith_luminance_cd_m2, sky.illuminance_lx);
        say!("sky of type {}: {zenith:.1} cd/m2 at the zenith, {lux:.1} lx on a horizontal plane", sky.kind);
    }
    if contents.sensors > 0 || !contents.grids.is_empty() {
        let grids = if contents.grids.is_empty() { "none".to_owned() } else { contents.grids.join(", ") };
        say!("sensors: {}; grids of sensors: {grids}", contents.sensors);
    }
    say!("{:<24} {:<16} {:>9} {:>9}", "material", "kind", "surfaces", "points");
    for line in &contents.materials {
        let kind = if line.emits { format!("{}, emits", line.kind) } else { line.kind.to_owned() };
        say!("{:<24} {kind:<16} {:>9} {:>9}", line.name, line.surfaces, line.points);
    }
    say!("requires: {}", contents.requires.join(", "));
    if !contents.left_out.is_empty() {
        say!("left out, the scene has no use for it: {}", contents.left_out.join(", "));
    }
    for note in &contents.notes {
        say!("note: {note}");
    }
}

//! A scene for Mitsuba 3: XML, PLY meshes and full spectra, for its spectral variants.

use super::{ply, sky};
use crate::atomic_file;
use crate::error::{Error, Result};
use crate::geometry::Round;
use crate::material::{Body, Fresnel, Material, fresnel};
use crate::scene::{Camera, Distribution, Light, LightKind, LightSource, Scene};
use crate::spectrum::Spectrum;
use glam::DVec3;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Where spectra are written out, nm: every one.
const FIRST_NM: u32 = 360;
const LAST_NM: u32 = 830;

/// Where a glass has the one index that bends directions, nm.
const DIRECTION_NM: f64 = 580.0;

/// Luminance, cd m⁻², of what Mitsuba calls Y = 1: 683 lm/W times the integral of the CIE 1931 y of its tables.
pub const LUMINANCE_OF_Y: f64 = 683.0 * 106.750_259;

/// Writes `scene.xml`, and beside it the meshes, into `folder`, which is made if it is not there. Returns what Mitsuba
/// cannot be told as it is, one sentence each.
///
/// # Errors
/// [`Error::Io`] when a file cannot be written.
pub fn export(scene: &Scene, camera: &Camera, samples: u32, folder: &Path) -> Result<Vec<String>> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    let mut writer = Writer { xml: String::new(), notes: Vec::new() };
    writer.head(scene, camera, samples);
    for (k, material) in scene.appearance.materials.iter().enumerate() {
        writer.bsdf(k, material, scene);
    }
    writer.shapes(scene, folder)?;
    for (light, source) in scene.geometry.lights.iter().zip(&scene.appearance.lights) {
        writer.light(light, source, scene.geometry.centre);
    }
    sky::write(&mut writer, scene, folder)?;
    writer.line(0, "</scene>");
    atomic_file::write(&folder.join("scene.xml"), writer.xml.as_bytes())?;
    Ok(writer.notes)
}

pub(super) struct Writer {
    xml: String,
    notes: Vec<String>,
}

fn point(name: &str, p: DVec3) -> String {
    format!("<point name=\"{name}\" x=\"{}\" y=\"{}\" z=\"{}\"/>", p.x, p.y, p.z)
}

pub(super) fn float(name: &str, value: f64) -> String {
    format!("<float name=\"{name}\" value=\"{value}\"/>")
}

impl Writer {
    pub(super) fn line(&mut self, depth: usize, text: &str) {
        let _ = writeln!(self.xml, "{:1$}{text}", "", 4 * depth);
    }

    pub(super) fn note(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    pub(super) fn spectrum(&mut self, depth: usize, name: &str, of: &dyn Fn(f64) -> f64) {
        let values: Vec<String> =
            (FIRST_NM..=LAST_NM).map(|nm| format!("{:.6e}", of(f64::from(nm)))).collect();
        // A table of nothing but zeros is refused there.
        if values.iter().all(|value| *value == values[0]) {
            self.line(depth, &format!("<spectrum type=\"uniform\" name=\"{name}\">"));
            self.line(depth + 1, &format!("<float name=\"value\" value=\"{}\"/>", values[0]));
            return self.line(depth, "</spectrum>");
        }
        self.line(depth, &format!("<spectrum type=\"regular\" name=\"{name}\">"));
        self.line(depth + 1, &float("wavelength_min", FIRST_NM.into()));
        self.line(depth + 1, &float("wavelength_max", LAST_NM.into()));
        self.line(depth + 1, &format!("<string name=\"values\" value=\"{}\"/>", values.join(", ")));
        self.line(depth, "</spectrum>");
    }

    fn light(&mut self, light: &Light, source: &LightSource, centre: DVec3) {
        let factor = source.factor(light);
        let of = |nm: f64| factor * source.spectrum.at(nm);
        let (position, distribution) = match &light.kind {
            LightKind::Point { position, distribution } => (*position + centre, distribution),
            LightKind::Directional { from, radius, .. } => {
                if *radius > 0.0 {
                    self.note(format!("light \"{}\": casts sharp shadows", light.name));
                }
                let DVec3 { x, y, z } = -*from;
                self.line(1, "<emitter type=\"directional\">");
                self.line(2, &format!("<vector name=\"direction\" x=\"{x}\" y=\"{y}\" z=\"{z}\"/>"));
                self.spectrum(2, "irradiance", &of);
                self.line(1, "</emitter>");
                return;
            }
        };
        if *distribution != Distribution::Isotropic {
            self.note(format!(
                "light \"{}\": shines evenly in all directions, with its largest intensity",
                light.name
            ));
        }
        self.line(1, "<emitter type=\"point\">");
        self.line(2, &point("position", position));
        self.spectrum(2, "intensity", &of);
        self.line(1, "</emitter>");
    }

    fn head(&mut self, scene: &Scene, camera: &Camera, samples: u32) {
        let absorbs =
            |m: &Material| matches!(&m.body, Body::Solid { absorption, .. } if absorption.max() > 0.0);
        let integrator = if scene.appearance.materials.iter().any(absorbs) { "volpath" } else { "path" };
        let [width, height] = camera.resolution;
        self.line(0, "<scene version=\"3.0.0\">");
        self.line(
            1,
            &format!("<!-- Spectral variants only. Luminance in cd/m^2 is {LUMINANCE_OF_Y:.2} times Y. -->"),
        );
        self.line(1, &format!("<integrator type=\"{integrator}\">"));
        self.line(2, "<integer name=\"max_depth\" value=\"-1\"/>");
        self.line(1, "</integrator>");
        self.line(1, "<sensor type=\"perspective\">");
        self.line(2, &float("fov", camera.fov_deg));
        self.line(2, "<string name=\"fov_axis\" value=\"y\"/>");
        self.line(2, &float("near_clip", 1e-5 * scene.geometry.radius));
        self.line(2, &float("far_clip", 1e3 * scene.geometry.radius));
        let text = |p: DVec3| format!("{}, {}, {}", p.x, p.y, p.z);
        let forward = (camera.target - camera.position).normalize_or(DVec3::NEG_Z);
        // As a view does it: an up that is of no use gives way to some direction across.
        let across = forward.cross(camera.up.normalize_or_zero());
        let up =
            if across.length() > 1e-9 { camera.up } else { forward.any_orthonormal_vector().cross(forward) };
        let (origin, target) = (text(camera.position), text(camera.target));
        self.line(2, "<transform name=\"to_world\">");
        self.line(3, &format!("<lookat origin=\"{origin}\" target=\"{target}\" up=\"{}\"/>", text(up)));
        self.line(2, "</transform>");
        self.line(2, "<sampler type=\"independent\">");
        self.line(3, &format!("<integer name=\"sample_count\" value=\"{samples}\"/>"));
        self.line(2, "</sampler>");
        self.line(2, "<film type=\"hdrfilm\">");
        self.line(3, &format!("<integer name=\"width\" value=\"{width}\"/>"));
        self.line(3, &format!("<integer name=\"height\" value=\"{height}\"/>"));
        self.line(3, "<rfilter type=\"box\"/>");
        self.line(2, "</film>");
        self.line(1, "</sensor>");
    }

    /// The BSDF of material `k`, named `m` and the number, and `m` with `two` for surfaces with two sides.
    fn bsdf(&mut self, k: usize, material: &Material, scene: &Scene) {
        let wears = |two: bool| {
            let of = scene.appearance.surface_material.iter().zip(&scene.geometry.two_sided);
            of.filter(|(m, two_sided)| m.0 as usize == k && **two_sided == two).count() > 0
        };
        let glass = !matches!(material.body, Body::Opaque { .. });
        for (two, name) in [(false, format!("m{k}")), (true, format!("m{k}two"))] {
            if !wears(two) {
                continue;
            }
            if two && !glass {
                self.line(1, &format!("<bsdf type=\"twosided\" id=\"{name}\">"));
                self.scattering(2, material, None);
                self.line(1, "</bsdf>");
            } else {
                self.scattering(1, material, Some(&name));
            }
        }
    }

    fn scattering(&mut self, depth: usize, material: &Material, id: Option<&str>) {
        let open = |kind: &str| match id {
            Some(id) => format!("<bsdf type=\"{kind}\" id=\"{id}\">"),
            None => format!("<bsdf type=\"{kind}\">"),
        };
        match &material.body {
            Body::Opaque { s, m, diffuse, fresnel } => {
                let albedo = |nm: f64| match diffuse {
                    Some(albedo) => albedo.at(nm),
                    None => fresnel.at(nm, 1.0),
                };
                if *s <= 0.0 {
                    self.line(depth, &open("diffuse"));
                    self.spectrum(depth + 1, "reflectance", &albedo);
                } else if *s >= 1.0 {
                    self.conductor(depth, &open(kind(*m)), material, *m, fresnel);
                    return;
                } else {
                    self.line(depth, &open("blendbsdf"));
                    self.line(depth + 1, &float("weight", *s));
                    self.line(depth + 1, "<bsdf type=\"diffuse\">");
                    self.spectrum(depth + 2, "reflectance", &albedo);
                    self.line(depth + 1, "</bsdf>");
                    self.conductor(
                        depth + 1,
                        &format!("<bsdf type=\"{}\">", kind(*m)),
                        material,
                        *m,
                        fresnel,
                    );
                }
            }
            Body::Pane { n, transmittance } => {
                self.line(depth, &open("thindielectric"));
                self.index(depth + 1, material, n);
                self.spectrum(depth + 1, "specular_transmittance", &|nm| transmittance.at(nm));
                if transmittance.min() < 1.0 {
                    self.note(format!(
                        "material \"{}\": the sheet absorbs as if light went straight through it once",
                        material.name
                    ));
                }
            }
            Body::Solid { n, .. } => {
                self.line(depth, &open("dielectric"));
                self.index(depth + 1, material, n);
            }
        }
        self.line(depth, "</bsdf>");
    }

    fn conductor(&mut self, depth: usize, open: &str, material: &Material, m: f64, of: &Fresnel) {
        self.line(depth, open);
        if m > 0.0 {
            self.line(depth + 1, "<string name=\"distribution\" value=\"beckmann\"/>");
            self.line(depth + 1, &float("alpha", m));
            self.note(format!(
                "material \"{}\": masking and shadowing are those of Smith, not of Cook and Torrance",
                material.name
            ));
        }
        match of {
            Fresnel::Index { n, k } => {
                self.spectrum(depth + 1, "eta", &|nm| n.at(nm));
                self.spectrum(depth + 1, "k", &|nm| k.at(nm));
            }
            Fresnel::Scaled { normal, n, k } => {
                let whole = fresnel::unpolarised(1.0, *n, *k).max(1e-6);
                self.spectrum(depth + 1, "eta", &|_| *n);
                self.spectrum(depth + 1, "k", &|_| *k);
                self.spectrum(depth + 1, "specular_reflectance", &|nm| normal.at(nm) / whole);
                self.note(format!(
                    "material \"{}\": its Fresnel factor is scaled at all angles as at normal incidence; towards \
                     grazing angles it stays below the paper's",
                    material.name
                ));
            }
        }
        self.line(depth, "</bsdf>");
    }

    fn index(&mut self, depth: usize, material: &Material, n: &Spectrum) {
        self.line(depth, &float("int_ior", n.at(DIRECTION_NM)));
        self.line(depth, &float("ext_ior", 1.0));
        if n.max() - n.min() > 1e-9 {
            self.note(format!("material \"{}\": one refractive index for all wavelengths", material.name));
        }
    }

    fn shapes(&mut self, scene: &Scene, folder: &Path) -> Result<()> {
        let geometry = &scene.geometry;
        let mut meshes: BTreeMap<(u32, u32, bool), Vec<[DVec3; 3]>> = BTreeMap::new();
        let areas = scene.appearance.emitting_areas(geometry);
        for (s, surface) in geometry.surfaces.iter().enumerate() {
            let material = scene.appearance.surface_material[s].0;
            let two_sided = geometry.two_sided[s];
            let mut add = |triangles: Vec<[DVec3; 3]>| {
                let world = triangles.into_iter().map(|t| t.map(|v| v + geometry.centre));
                meshes.entry((geometry.object[s].0, material, two_sided)).or_default().extend(world);
            };
            match surface.round() {
                Some(round) if self.native(round, geometry.centre) => {
                    self.worn(scene, &areas, material, two_sided);
                    self.line(1, "</shape>");
                }
                Some(round) => {
                    let name = &geometry.objects[geometry.object[s].0 as usize];
                    self.note(format!(
                        "object \"{name}\": curved surfaces that Mitsuba lacks go as fine meshes"
                    ));
                    add(fine_mesh(round));
                }
                None => {
                    let (triangles, count) = surface.triangles();
                    add(triangles[..count].to_vec());
                }
            }
        }
        for (k, ((object, material, two_sided), triangles)) in meshes.iter().enumerate() {
            let file = format!("mesh_{k:04}.ply");
            ply::write(&folder.join(&file), triangles)?;
            // A comment must not hold two dashes.
            let name = geometry.objects[*object as usize].replace("--", "- -");
            self.line(1, "<shape type=\"ply\">");
            self.line(2, &format!("<!-- {} -->", name.trim_end_matches('-')));
            self.line(2, &format!("<string name=\"filename\" value=\"{file}\"/>"));
            self.line(2, "<boolean name=\"face_normals\" value=\"true\"/>");
            self.worn(scene, &areas, *material, *two_sided);
            self.line(1, "</shape>");
        }
        Ok(())
    }

    /// Opens a shape of Mitsuba's own for `round` in a scene centred at `scene_centre`, if there is one.
    fn native(&mut self, round: &Round, scene_centre: DVec3) -> bool {
        match round {
            Round::Disc(disc) => {
                let centre = disc.centre + scene_centre;
                let (x, y) = disc.axes();
                let (x, y, z) = (disc.radius * x, disc.radius * y, disc.normal);
                let row = |k: usize| format!("{} {} {} {}", x[k], y[k], z[k], centre[k]);
                let matrix = format!("{} {} {} 0 0 0 1", row(0), row(1), row(2));
                self.line(1, "<shape type=\"disk\">");
                self.line(2, "<transform name=\"to_world\">");
                self.line(3, &format!("<matrix value=\"{matrix}\"/>"));
                self.line(2, "</transform>");
            }
            Round::Sphere(sphere) => {
                self.line(1, "<shape type=\"sphere\">");
                self.line(2, &point("center", sphere.centre + scene_centre));
                self.line(2, &float("radius", sphere.radius));
                if sphere.inward {
                    self.line(2, "<boolean name=\"flip_normals\" value=\"true\"/>");
                }
            }
            Round::Cone(cone) if cone.radius == cone.top_radius => {
                self.line(1, "<shape type=\"cylinder\">");
                self.line(2, &point("p0", cone.base + scene_centre));
                self.line(2, &point("p1", cone.top + scene_centre));
                self.line(2, &float("radius", cone.radius));
                if cone.inward {
                    self.line(2, "<boolean name=\"flip_normals\" value=\"true\"/>");
                }
            }
            Round::Cone(_) | Round::Patch(_) => return false,
        }
        true
    }

    /// What a shape wears: BSDF, light, and what fills it.
    fn worn(&mut self, scene: &Scene, areas: &[f64], material: u32, two_sided: bool) {
        let number = material as usize;
        let material = &scene.appearance.materials[number];
        self.line(2, &format!("<ref id=\"m{number}{}\"/>", if two_sided { "two" } else { "" }));
        if let Body::Solid { absorption, .. } = &material.body
            && absorption.max() > 0.0
        {
            self.line(2, "<medium type=\"homogeneous\" name=\"interior\">");
            self.spectrum(3, "sigma_t", &|nm| absorption.at(nm));
            self.line(3, "<spectrum name=\"albedo\" value=\"0\"/>");
            self.line(2, "</medium>");
        }
        if let Some(emission) = &material.emission {
            let factor = emission.factor(areas[number]);
            self.line(2, "<emitter type=\"area\">");
            self.spectrum(3, "radiance", &|nm| factor * emission.spectrum.at(nm));
            self.line(2, "</emitter>");
            if two_sided {
                self.note(format!(
                    "material \"{}\": surfaces with two sides emit from the front alone",
                    material.name
                ));
            }
        }
    }
}

/// Triangles that stand for a surface, none without area: a thousandth of its size or less beside it.
fn fine_mesh(round: &Round) -> Vec<[DVec3; 3]> {
    let [across, along] = match round {
        // A cone is straight from end to end.
        Round::Cone(_) => [256u32, 1],
        _ => [64, 64],
    };
    let at =
        |i: u32, j: u32| round.point_at(f64::from(i) / f64::from(across), f64::from(j) / f64::from(along));
    let cell = |k: u32| {
        let (i, j) = (k % across, k / across);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    let has_area = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a) != DVec3::ZERO;
    (0..across * along).flat_map(cell).filter(has_area).collect()
}

/// Rough or ideal.
fn kind(m: f64) -> &'static str {
    if m > 0.0 { "roughconductor" } else { "conductor" }
}

//! What `render` and `relight` share: a prepared scene, one lit appearance to files.

use super::outputs::Targets;
use super::say::{say, tell};
use luxgraph::error::Result;
use luxgraph::first_pass::{self, DiffuseSolution, FirstPass};
use luxgraph::observer::Observer;
use luxgraph::output::{self, png::Exposure};
use luxgraph::pipeline::{self, Prepared};
use luxgraph::points::{self, Sampling};
use luxgraph::report::{Counts, Machine, RunReport, peak_memory_bytes, write_json};
use luxgraph::scene::{Camera, Geometry, MaterialId, SampledAppearance, Scene};
use luxgraph::second_pass::{
    self, Checkpoint, NoiseStats, PixelNoise, ROUGH, Rendered, SecondPassStats, SpectralImage,
};
use luxgraph::settings::Settings;
use luxgraph::tracers::{self, RayTracer};
use luxgraph::visibility::Links;
use std::path::Path;
use std::time::Instant;

/// Passes on what the loader had to say about the scene.
pub fn note(scene: &Scene) {
    for note in &scene.notes {
        tell!("note: {note}");
    }
}

/// Notes, tracer, sample points and visibility graph; says in one line what came out.
pub fn prepare<'a>(
    scene: &'a Scene,
    settings: &Settings,
    graph: Option<&Path>,
    observer: &dyn Observer,
) -> Result<(Box<dyn RayTracer + 'a>, Prepared)> {
    note(scene);
    announce_links(scene, settings, graph);
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let prepared =
        pipeline::prepare(&scene.geometry, &scene.sampling, settings, tracer.as_ref(), graph, observer)?;
    say_prepared(scene, &prepared, tracer.as_ref());
    Ok((tracer, prepared))
}

/// Time of one processor that the links of a point take, s: 0.7 ms in a hall of desks, 1.5 ms in a room of 78,000
/// small faces.
const LINKS_S: f64 = 1.5e-3;

/// Less than this share of an image's light is not worth a note.
const LITTLE: f64 = 1e-4;

/// Says before the work begins that light is exchanged over links, if it is and nobody asked for that, and what it takes.
fn announce_links(scene: &Scene, settings: &Settings, graph: Option<&Path>) {
    let geometry = &scene.geometry;
    let sampling = Sampling { area_factor: settings.area_factor, ..scene.sampling };
    let elements = points::divide_by_area(geometry, &sampling);
    let backs = elements.iter().filter(|(id, _)| geometry.two_sided[id.index()]).count();
    let points = elements.len() + backs;
    if settings.links.is_none() && pipeline::too_many_for_pairs(points, &sampling, settings, graph) {
        let minutes = LINKS_S * points as f64 / 60.0 / rayon::current_num_threads() as f64;
        tell!(
            "note: {points} sample points are more than {}: light is exchanged over links to clusters of points in place \
             of all pairs (--most-paired N changes the limit, at a cost that grows with its square); this takes about \
             {minutes:.1} min where {} processors are free, less with --link-tolerance 0.03 or --quality draft",
            settings.most_paired,
            rayon::current_num_threads()
        );
    }
}

/// The same for a scene in which objects have moved, come or gone: what it has in common with the scene that was
/// prepared `before` is taken from there.
pub fn prepare_changed<'a>(
    before: (&Geometry, &Prepared),
    scene: &'a Scene,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<(Box<dyn RayTracer + 'a>, Prepared)> {
    note(scene);
    let tracer = tracers::choose(settings.tracer, &scene.geometry)?;
    let (geometry, sampling) = (&scene.geometry, &scene.sampling);
    let prepared =
        pipeline::prepare_changed(before, geometry, sampling, settings, tracer.as_ref(), observer)?;
    say_prepared(scene, &prepared, tracer.as_ref());
    Ok((tracer, prepared))
}

/// Says in one line what was prepared, and how.
fn say_prepared(scene: &Scene, prepared: &Prepared, tracer: &dyn RayTracer) {
    let lost = prepared.links.as_ref().map_or(prepared.graph.lights(), Links::lights).lost();
    if lost > 0 {
        tell!(
            "note: {lost} ways of the sun or the sky through panes count as blocked: there are more than 65,535 different rows \
             of panes to look through; give finely divided glass the material of a `solid`, or fewer faces"
        );
    }
    let stats = &prepared.graph.stats;
    let (time, name, rays) = (stats.build_s, tracer.name(), stats.rays_cast);
    let how = if let Some(Links { stats, .. }) = &prepared.links {
        format!(
            "none, but {} links over {} clusters, {:.2} s with {name}, {} rays",
            stats.links, stats.clusters, stats.build_s, stats.rays_cast
        )
    } else if prepared.graph_loaded {
        "read from its file".to_owned()
    } else if stats.copied > 0 {
        let share = 100.0 * stats.copied as f64 / stats.pairs.max(1) as f64;
        format!("updated in {time:.2} s with {name}, {rays} rays; {share:.1} % of its pairs copied")
    } else {
        format!("{time:.2} s with {name}, {rays} rays for {} pairs of points", stats.pairs)
    };
    say!(
        "scene: {} surfaces, {} points in {} voxels; graph: {how}",
        scene.geometry.surfaces.len(),
        prepared.points.len(),
        prepared.points.voxels()
    );
}

/// One appearance of a prepared scene, on its way to files.
pub struct Job<'a> {
    /// The scene with the appearance to show.
    pub scene: &'a Scene,
    /// Scene file and changes, for the report.
    pub sources: Vec<String>,
    /// Points and graph.
    pub prepared: &'a Prepared,
    /// The view.
    pub camera: &'a Camera,
    /// The knobs.
    pub settings: &'a Settings,
    /// Answers the rays of the second pass.
    pub tracer: &'a dyn RayTracer,
    /// Exposure of the PNG.
    pub exposure: Exposure,
    /// Whether the EXR carries spectral channels.
    pub spectral: bool,
    /// Where finished rows are kept until the image is written.
    pub checkpoint: Option<Checkpoint>,
    /// What was asked for in place of settings, for the report.
    pub target: Option<serde_json::Value>,
    /// When the run began.
    pub started: Instant,
}

impl Job<'_> {
    /// First pass, second pass, files; prints what came out in three lines.
    pub fn run(
        &self,
        targets: &Targets,
        first_pass: &mut dyn FirstPass,
        observer: &dyn Observer,
    ) -> Result<()> {
        let (geometry, settings) = (&self.scene.geometry, self.settings);
        let lit = pipeline::relight(geometry, first_pass, &self.scene.appearance, settings, observer)?;
        let stats = &lit.1.stats;
        say!(
            "first pass: {:.2} s, {:.0} sweeps, {:.4} % of the flux unabsorbed, {} rays",
            stats.setup_s + stats.solve_s,
            stats.sweeps,
            100.0 * stats.residual,
            stats.rays_cast
        );
        let Rendered { image, stats, noise } = second_pass::render_with_checkpoint(
            &pipeline::lit_scene(geometry, self.prepared, &lit),
            self.camera,
            self.tracer,
            &settings.second_pass,
            self.checkpoint.as_ref(),
            observer,
        )?;
        say!("second pass: {:.2} s, {} rays", stats.second_pass_s, stats.rays());
        if let Some(noise) = &stats.noise {
            say_noise(noise);
        }
        self.write(targets, &lit, (&image, noise.as_ref()), stats)
    }

    /// Says what light the view, or other surfaces, do without.
    fn tell_left_out(&self, appearance: &SampledAppearance) {
        let geometry = &self.scene.geometry;
        let smooth = |m: &MaterialId| {
            let material = &appearance.materials[m.0 as usize];
            material.is_specular() && (material.m < ROUGH || material.transmission.is_some())
        };
        if !geometry.lights.is_empty() && appearance.surface_material.iter().any(smooth) {
            tell!(
                "note: [[lights]] have no body: their light reaches surfaces over mirrors and glass too, but mirrors and \
                 glass show no image of the lights themselves"
            );
        }
        let specular = first_pass::specular_points(&self.prepared.points, appearance);
        let most = self.settings.first_pass.most_specular;
        let evenly = "the light that they pass on to other surfaces is spread evenly; views show mirrors and glass as they are";
        if self.prepared.links.is_some() && specular > 0 {
            tell!("note: {specular} sample points are specular, and links carry diffuse light: {evenly}");
        } else if specular > most {
            tell!(
                "note: {specular} sample points are specular, more than {most}: {evenly} (--most-specular N changes the \
                 limit, at a cost that grows with its cube)"
            );
        }
    }

    /// The files of an image.
    pub fn write(
        &self,
        targets: &Targets,
        lit: &(SampledAppearance, DiffuseSolution),
        (image, noise): (&SpectralImage, Option<&PixelNoise>),
        stats: SecondPassStats,
    ) -> Result<()> {
        self.tell_left_out(&lit.0);
        let layers = output::exr::ExrOptions { xyz: self.spectral, spectral: self.spectral };
        let more = noise
            .iter()
            .flat_map(|of| [(output::exr::NOISE, &of.noise[..]), (output::exr::SAMPLES, &of.samples[..])]);
        output::exr::write_with(&targets.exr, image, &layers, &more.collect::<Vec<_>>())?;
        if let Some(checkpoint) = &self.checkpoint {
            checkpoint.finish()?;
        }
        let ev = output::png::write(&targets.png, image, self.exposure)?;
        say!("wrote {} and {} (exposure {ev:+.2} EV)", targets.exr.display(), targets.png.display());
        self.tell_by_chance(&stats);
        if let Some(why) = darkness(image, &lit.1, &stats) {
            tell!("note: the image is black: {why}");
        }
        if let Some(path) = &targets.report {
            write_json(path, &self.report(lit, stats, ev))?;
        }
        Ok(())
    }

    /// Says how much light of an image only chance found, and how much of that is left out.
    fn tell_by_chance(&self, stats: &SecondPassStats) {
        let light = "of the image's light is that of lamps which gloss shows over mirrors or through glass, where only chance finds it";
        if stats.by_chance_share < LITTLE {
            return;
        }
        let share = 100.0 * stats.by_chance_share;
        if self.settings.second_pass.clamp.is_infinite() {
            tell!(
                "note: {share:.2} % {light}: it may be seen as specks (--clamp 0.25 limits them and tells what that leaves out)"
            );
        } else {
            tell!("note: {share:.2} % {light}; {:.2} % is left out", 100.0 * stats.clamped_share);
        }
    }

    fn report(
        &self,
        (appearance, solution): &(SampledAppearance, DiffuseSolution),
        second_pass: SecondPassStats,
        ev: f64,
    ) -> RunReport {
        RunReport {
            luxgraph: env!("CARGO_PKG_VERSION"),
            machine: Machine::this(),
            scene: self.sources.clone(),
            tracer: self.tracer.name(),
            wavelengths_nm: appearance.wavelengths.nm.clone(),
            counts: counts(self.scene, self.prepared, appearance),
            graph_loaded: self.prepared.graph_loaded,
            graph: self.prepared.graph.stats.clone(),
            links: self.prepared.links.as_ref().map(|links| links.stats.clone()),
            graph_memory_bytes: self.prepared.graph.memory_bytes(),
            first_pass: solution.stats.clone(),
            second_pass_settings: self.settings.second_pass,
            second_pass,
            target: self.target.clone(),
            exposure_ev: ev,
            total_s: self.started.elapsed().as_secs_f64(),
            peak_memory_bytes: peak_memory_bytes(),
        }
    }
}

/// Says how noisy an image is and what it took.
fn say_noise(found: &NoiseStats) {
    say!(
        "noise: {:.2} % of luminance, root mean square over the pixels ({} % asked for); {:.1} samples a pixel, {} at most",
        100.0 * found.noise,
        100.0 * found.asked,
        found.mean_samples,
        found.most_samples
    );
    if found.noise > found.asked {
        tell!("note: the noise asked for was not reached: raise --max-samples");
    }
}

/// Why an image shows nothing at all, if it does.
fn darkness(
    image: &SpectralImage,
    solution: &DiffuseSolution,
    stats: &SecondPassStats,
) -> Option<&'static str> {
    let black = |radiance: &[f32]| radiance.iter().all(|&l| l == 0.0);
    if !black(&image.radiance) {
        None
    } else if black(&solution.radiance) {
        Some(
            "no light falls on any surface, and none emits; give a material `emission`, or the scene [[lights]]",
        )
    } else if stats.missed_rays == stats.camera_rays {
        Some("the camera sees no surface; mind its position and target")
    } else {
        Some("the camera sees unlit surfaces, or their backs; is it inside a wall or outside the room?")
    }
}

/// Sizes of a prepared scene.
pub fn counts(scene: &Scene, prepared: &Prepared, appearance: &SampledAppearance) -> Counts {
    let points = &prepared.points;
    Counts {
        surfaces: scene.geometry.surfaces.len(),
        points: points.len(),
        specular_points: points.surface.iter().filter(|&&s| appearance.of(s).is_specular()).count(),
        voxels: points.voxels(),
        empty_voxels: (0..points.voxels()).filter(|&v| points.voxel(v).is_empty()).count(),
    }
}

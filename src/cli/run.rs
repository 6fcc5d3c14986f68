//! What `render` and `relight` share: options to settings, one lit appearance to files.

use super::args::{KernelArg, Lighting, Options, PassesArg, QualityArg, SecondPassArg, SolverArg, TracerArg};
use super::say::{say, tell};
use luxgraph::error::{Error, Result};
use luxgraph::first_pass::{self, DiffuseSolution, FirstPass, Kernel, Solver};
use luxgraph::observer::Observer;
use luxgraph::output::{self, png::Exposure};
use luxgraph::pipeline::{self, Prepared};
use luxgraph::points::{self, Sampling};
use luxgraph::report::{Counts, Machine, RunReport, peak_memory_bytes, write_json};
use luxgraph::scene::{Camera, Geometry, MaterialId, SampledAppearance, Scene};
use luxgraph::second_pass::{
    self, Checkpoint, NoiseStats, NoiseTarget, Passes, PixelNoise, Rendered, Rung, SecondPassSettings,
    SecondPassStats, SpectralImage,
};
use luxgraph::settings::{Quality, Settings};
use luxgraph::share;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::{self, RayTracer, TracerChoice};
use luxgraph::visibility::{LinkSettings, Links};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The library's name for a choice of tracer.
pub fn tracer_choice(arg: TracerArg) -> TracerChoice {
    match arg {
        TracerArg::Auto => TracerChoice::Auto,
        TracerArg::Embree => TracerChoice::Embree,
        TracerArg::Voxel => TracerChoice::Voxel,
    }
}

/// Settings of an image: the preset, then what was asked for.
pub fn settings(options: &Options) -> Result<Settings> {
    let mut settings = lighting_settings(&options.lighting)?;
    settings.second_pass.seed = options.seed;
    if let Some(samples) = options.samples {
        settings.second_pass.samples = samples;
    }
    if let Some(rung) = options.second_pass {
        settings.second_pass.rung = match rung {
            SecondPassArg::Interpolate => Rung::Interpolate,
            SecondPassArg::Direct => Rung::Direct,
            SecondPassArg::Gather => Rung::Gather,
        };
    }
    ladder_samples(options, &mut settings.second_pass)?;
    if let Some(text) = &options.noise {
        let (noise, most_samples) = (share::parse("a noise", text)?, options.max_samples);
        settings.second_pass.noise = Some(NoiseTarget { noise, most_samples });
        settings.second_pass.check()?;
    }
    settings.first_pass.parts = settings.second_pass.rung != Rung::Interpolate;
    settings.second_pass.passes = match options.passes {
        PassesArg::First => Passes::FirstPassOnly,
        PassesArg::Both => Passes::Both,
    };
    Ok(settings)
}

/// How many rays the upper rungs send at a hit.
fn ladder_samples(options: &Options, settings: &mut SecondPassSettings) -> Result<()> {
    let refuse = |option: &str, rungs: &str| {
        Err(Error::Settings(format!(
            "{option} has no meaning on this rung: add --second-pass {rungs}, or leave it out"
        )))
    };
    if let Some(samples) = options.lamp_samples {
        if settings.rung == Rung::Interpolate {
            return refuse("--lamp-samples", "direct or gather");
        }
        settings.lamp_samples = samples;
    }
    if let Some(samples) = options.gather_samples {
        if settings.rung != Rung::Gather {
            return refuse("--gather-samples", "gather");
        }
        settings.gather_samples = samples;
    }
    Ok(())
}

/// Settings of the light: the preset, then what was asked for.
pub fn lighting_settings(options: &Lighting) -> Result<Settings> {
    let mut settings = Settings::preset(match options.quality {
        QualityArg::Draft => Quality::Draft,
        QualityArg::Paper => Quality::Paper,
        QualityArg::Standard => Quality::Standard,
        QualityArg::High => Quality::High,
    });
    settings.tracer = tracer_choice(options.tracer);
    if let Some(text) = &options.wavelengths {
        settings.wavelengths = Wavelengths::parse(text)?;
    }
    if let Some(tolerance) = options.link_tolerance {
        let links = LinkSettings { tolerance, ..LinkSettings::default() };
        links.validate()?;
        settings.links = Some(links);
    }
    settings.most_paired = options.most_paired;
    let first = &mut settings.first_pass;
    if let Some(kernel) = options.kernel {
        first.kernel = match kernel {
            KernelArg::Analytic => Kernel::Analytic,
            KernelArg::Paper => Kernel::Paper,
        };
    }
    if let Some(solver) = options.solver {
        first.solver = match solver {
            SolverArg::Iterative => Solver::Iterative,
            SolverArg::Shooting => Solver::Shooting,
        };
    }
    if let Some(tolerance) = options.tolerance {
        if !(1e-6..1.0).contains(&tolerance) {
            return Err(Error::Settings(format!("--tolerance {tolerance}: give a share from 1e-6 to 1")));
        }
        first.tolerance = tolerance;
    }
    first.most_specular = options.most_specular;
    if let Some(tolerance) = options.lobe_tolerance {
        if !(0.0..1.0).contains(&tolerance) {
            let message = format!("--lobe-tolerance {tolerance}: give a share from 0 to less than 1");
            return Err(Error::Settings(message));
        }
        first.lobe_tolerance = tolerance;
    }
    if options.lg_max.is_some() {
        first.chain.lg_max = options.lg_max;
    }
    if let Some(eff_min) = options.eff_min {
        if !(0.0..=1.0).contains(&eff_min) {
            return Err(Error::Settings(format!("--eff-min {eff_min}: give a share from 0 to 1")));
        }
        first.chain.eff_min = eff_min;
    }
    Ok(settings)
}

/// `auto` or a number of EV.
pub fn exposure(text: &str) -> Result<Exposure> {
    if text == "auto" {
        return Ok(Exposure::Auto);
    }
    match text.parse::<f64>() {
        Ok(ev) if ev.abs() <= 64.0 => Ok(Exposure::Ev(ev)),
        _ => Err(Error::Settings(format!("--exposure {text}: give auto, or a number of EV from -64 to 64"))),
    }
}

/// The camera asked for, at the size asked for.
pub fn camera(scene: &Scene, name: Option<&str>, size: Option<[u32; 2]>) -> Result<Camera> {
    let mut camera = match name {
        None => scene.cameras.first().cloned(),
        Some(name) => scene.cameras.iter().find(|c| c.name == name).cloned(),
    }
    .ok_or_else(|| {
        let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
        let asked = name.unwrap_or_default();
        let names = names.join(", ");
        Error::Settings(format!("--camera {asked}: the scene has no camera of that name, only {names}"))
    })?;
    if let Some(size) = size {
        camera.resolution = size;
    }
    camera.check()?;
    Ok(camera)
}

/// Files that a run reads and must not overwrite.
pub fn inputs<'a>(scene: &'a Path, changes: &'a [PathBuf], options: &'a Lighting) -> Vec<&'a Path> {
    std::iter::once(scene).chain(changes.iter().chain(&options.graph).map(PathBuf::as_path)).collect()
}

/// Where the files of one image go.
pub struct Targets {
    /// The EXR.
    pub exr: PathBuf,
    /// The PNG.
    pub png: PathBuf,
    /// The JSON report, if asked for.
    pub report: Option<PathBuf>,
}

impl Targets {
    /// [`check_outputs`] of all of them.
    pub fn check(&self, inputs: &[&Path]) -> Result<()> {
        check_outputs(&[Some(&self.exr), Some(&self.png), self.report.as_ref()], inputs)
    }
}

/// Fails now rather than after the work when a folder is missing or read-only, or a name cannot serve:
/// it is a folder's, one of the `inputs` has it, or another output.
pub fn check_outputs(outputs: &[Option<&PathBuf>], inputs: &[&Path]) -> Result<()> {
    let paths: Vec<&Path> = outputs.iter().copied().flatten().map(PathBuf::as_path).collect();
    for (i, &path) in paths.iter().enumerate() {
        if inputs.iter().any(|input| same_file(input, path)) {
            return Err(Error::Settings(format!(
                "{}: this would be overwritten, but it is read; name another output",
                path.display()
            )));
        }
        if paths[..i].iter().any(|other| same_file(other, path)) {
            return Err(Error::Settings(format!(
                "{}: two outputs would have this name; name an image OUT.exr, and other files otherwise",
                path.display()
            )));
        }
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !parent.is_dir() {
            return Err(Error::io(path, format!("there is no folder {}; make it first", parent.display())));
        }
        if path.is_dir() {
            return Err(Error::io(path, "this is a folder; name a file"));
        }
        let trial = parent.join(format!(".luxgraph-{}", std::process::id()));
        match File::create_new(&trial).and_then(|_| std::fs::remove_file(&trial)) {
            Err(e) if e.kind() != ErrorKind::AlreadyExists => {
                return Err(Error::io(path, format!("the folder cannot be written to: {e}")));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Whether two paths name one file, which need not exist.
fn same_file(a: &Path, b: &Path) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

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

/// Time of one processor that the links of a point take, s: 0.7 ms in a hall of desks, 1.5 ms in a room of 78,000 small faces.
const LINKS_S: f64 = 1.5e-3;

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
        let specular = |m: &MaterialId| self.scene.appearance.materials[m.0 as usize].is_specular();
        if !geometry.lights.is_empty() && self.scene.appearance.surface_material.iter().any(specular) {
            tell!(
                "note: [[lights]] have no body: their light reaches surfaces over mirrors and glass too, but \
                 the view shows no reflection and no highlight of the lights themselves"
            );
        }
        let specular = first_pass::specular_points(&self.prepared.points, &lit.0);
        let most = settings.first_pass.most_specular;
        let evenly = "the light that they pass on to other surfaces is spread evenly; views show mirrors and glass as they are";
        if self.prepared.links.is_some() && specular > 0 {
            tell!("note: {specular} sample points are specular, and links carry diffuse light: {evenly}");
        } else if specular > most {
            tell!(
                "note: {specular} sample points are specular, more than {most}: {evenly} (--most-specular N changes the \
                 limit, at a cost that grows with its cube)"
            );
        }
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

    /// The files of an image.
    pub fn write(
        &self,
        targets: &Targets,
        lit: &(SampledAppearance, DiffuseSolution),
        (image, noise): (&SpectralImage, Option<&PixelNoise>),
        stats: SecondPassStats,
    ) -> Result<()> {
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
        if let Some(why) = darkness(image, &lit.1, &stats) {
            tell!("note: the image is black: {why}");
        }
        if let Some(path) = &targets.report {
            write_json(path, &self.report(lit, stats, ev))?;
        }
        Ok(())
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

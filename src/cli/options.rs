//! Options as typed to what the library takes.

use super::args::{
    KernelArg, Lighting, Options, PassesArg, QualityArg, SecondPassArg, SolverArg, TracerArg, View,
};
use luxgraph::error::{Error, Result};
use luxgraph::first_pass::{Kernel, Solver};
use luxgraph::output::png::Exposure;
use luxgraph::points;
use luxgraph::scene::{Camera, Scene};
use luxgraph::second_pass::{NoiseTarget, Passes, Rung, SecondPassSettings};
use luxgraph::settings::{Quality, Settings};
use luxgraph::share;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::TracerChoice;
use luxgraph::visibility::LinkSettings;

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
    if let Some(clamp) = options.clamp {
        settings.second_pass.clamp = clamp;
    }
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
    }
    settings.first_pass.parts = settings.second_pass.rung != Rung::Interpolate;
    settings.second_pass.passes = match options.passes {
        PassesArg::First => Passes::FirstPassOnly,
        PassesArg::Both => Passes::Both,
    };
    settings.second_pass.check()?;
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
    settings.tracer = tracer_choice(options.tracing.tracer);
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

/// The settings with as many sample points as were asked for.
pub fn at_points(settings: Settings, options: &Lighting, scene: &Scene) -> Result<Settings> {
    let Some(wanted) = options.points else { return Ok(settings) };
    let area_factor = points::area_factor_for(&scene.geometry, &scene.sampling, wanted)?;
    Ok(Settings { area_factor, ..settings })
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
pub fn camera(scene: &Scene, view: &View) -> Result<Camera> {
    let mut camera = match view.camera.as_deref() {
        None => scene.cameras.first().cloned(),
        Some(name) => scene.cameras.iter().find(|c| c.name == name).cloned(),
    }
    .ok_or_else(|| {
        let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
        let asked = view.camera.as_deref().unwrap_or_default();
        let names = names.join(", ");
        Error::Settings(format!("--camera {asked}: the scene has no camera of that name, only {names}"))
    })?;
    if let Some(size) = view.size {
        camera.resolution = size;
    }
    camera.check()?;
    Ok(camera)
}

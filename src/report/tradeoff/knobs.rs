//! Which knobs are turned, and how far.

use crate::first_pass::Kernel;
use crate::points::{LightRefinement, Sampling};
use crate::scene::Scene;
use crate::second_pass::Rung;
use crate::settings::{Quality, Settings};
use crate::spectrum::Wavelengths;
use crate::visibility::LinkSettings;

/// One setting of all knobs.
#[derive(Clone, Debug)]
pub struct Trial {
    /// The knob that differs from the base.
    pub knob: String,
    /// What it is turned to.
    pub value: String,
    /// All knobs but those of sampling.
    pub settings: Settings,
    /// How surfaces become points.
    pub sampling: Sampling,
}

/// How much is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// A dozen and a half, of points, wavelengths, kernel, rung and samples.
    Quick,
    /// Every knob, and points, rung and samples jointly.
    Full,
}

/// The trials of a scene from `base` on, those with few points first; what has points and solution in common stands
/// together.
pub fn trials(scene: &Scene, base: &Settings, extent: Extent) -> Vec<Trial> {
    let mut list = List { base, sampling: scene.sampling, trials: Vec::new() };
    list.add("base", "all knobs as they are", |_, _| ());
    list.presets();
    list.points_rungs_and_samples(extent);
    list.light(extent);
    if extent == Extent::Full {
        let specular = scene
            .appearance
            .surface_material
            .iter()
            .any(|m| scene.appearance.materials[m.0 as usize].is_specular());
        if specular {
            list.gloss();
        } else {
            list.links();
        }
        list.rays();
    }
    let mut trials = list.trials;
    let upstream = |t: &Trial| (t.key_of_points(), t.key_of_light());
    // Stable: what has the same points stays together.
    trials.sort_by_cached_key(upstream);
    trials.sort_by(|a, b| b.settings.area_factor.total_cmp(&a.settings.area_factor));
    trials
}

impl Trial {
    /// Tells sample points and graphs apart.
    pub fn key_of_points(&self) -> String {
        let s = &self.settings;
        // Where the light decides on points, they depend on what it depends on.
        let light = s.refinement.map(|refinement| format!("{refinement:?} {}", self.key_of_light()));
        format!("{:?} {} {:?} {:?} {:?} {light:?}", self.sampling, s.area_factor, s.voxels, s.links, s.tracer)
    }

    /// Tells solutions over the same points apart.
    pub fn key_of_light(&self) -> String {
        let s = &self.settings;
        format!("{:?} {} {:?}", s.wavelengths, s.fresnel_entries, s.first_pass)
    }

    /// Tells trials apart.
    pub fn key(&self) -> String {
        format!("{:?} {:?}", self.settings, self.sampling)
    }
}

/// The list as it grows.
struct List<'a> {
    base: &'a Settings,
    sampling: Sampling,
    trials: Vec<Trial>,
}

impl List<'_> {
    /// Adds a trial unless there is one of the same settings.
    fn add(&mut self, knob: &str, value: impl ToString, change: impl FnOnce(&mut Settings, &mut Sampling)) {
        let (mut settings, mut sampling) = (self.base.clone(), self.sampling);
        change(&mut settings, &mut sampling);
        settings.first_pass.parts = settings.second_pass.rung != Rung::Interpolate;
        let trial = Trial { knob: knob.into(), value: value.to_string(), settings, sampling };
        if self.trials.iter().all(|t| t.key() != trial.key()) {
            self.trials.push(trial);
        }
    }

    /// `--quality`, all of it.
    fn presets(&mut self) {
        let presets = [
            (Quality::Draft, "draft"),
            (Quality::Paper, "paper"),
            (Quality::Standard, "standard"),
            (Quality::High, "high"),
        ];
        for (quality, name) in presets {
            self.add("quality", name, |s, _| {
                *s = Settings { tracer: s.tracer, ..Settings::preset(quality) };
            });
        }
    }

    /// One after the other and jointly: they trade with each other.
    fn points_rungs_and_samples(&mut self, extent: Extent) {
        let (areas, samples): (&[f64], &[u32]) = match extent {
            Extent::Quick => (&[4.0, 1.0], &[1, 4, 16]),
            Extent::Full => (&[16.0, 4.0, 2.0, 1.0, 0.5, 0.25], &[1, 4, 16, 64]),
        };
        for &area in areas {
            self.add("points", format!("area x {area}"), |s, _| s.area_factor *= area);
        }
        let rungs = [(Rung::Interpolate, "interpolate"), (Rung::Direct, "direct"), (Rung::Gather, "gather")];
        for (rung, name) in rungs {
            self.add("rung", name, |s, _| s.second_pass.rung = rung);
        }
        for &n in samples {
            self.add("samples", format!("{n} a pixel"), |s, _| s.second_pass.samples = n);
        }
        let joint: &[f64] = if extent == Extent::Quick { &[4.0] } else { &[16.0, 4.0, 1.0, 0.25] };
        for &area in joint {
            for (rung, name) in rungs {
                for &n in samples {
                    self.add("points, rung, samples", format!("area x {area}, {name}, {n}"), |s, _| {
                        s.area_factor *= area;
                        s.second_pass.rung = rung;
                        s.second_pass.samples = n;
                    });
                }
            }
        }
    }

    /// The first pass, of any scene.
    fn light(&mut self, extent: Extent) {
        self.add("kernel", "paper", |s, _| s.first_pass.kernel = Kernel::Paper);
        let full = extent == Extent::Full;
        self.add("wavelengths", "meyer4", |s, _| s.wavelengths = Wavelengths::meyer4());
        let bands: &[usize] = if full { &[4, 8, 16, 32] } else { &[16] };
        for &bands in bands {
            self.add("wavelengths", bands, |s, _| s.wavelengths = Wavelengths::of_bands(bands));
        }
        let tolerances: &[f64] = if full { &[0.1, 1e-2, 1e-3, 1e-5] } else { &[0.1] };
        for &tolerance in tolerances {
            self.add("solver tolerance", tolerance, |s, _| s.first_pass.tolerance = tolerance);
        }
        if full {
            for tolerance in [0.1, 0.05] {
                self.add("refinement by the light", tolerance, |s, _| {
                    s.refinement = Some(LightRefinement { tolerance, ..LightRefinement::default() });
                });
            }
            for angle in [0.1, 0.03] {
                self.add("refinement by solid angle", format!("{angle} sr"), |_, sampling| {
                    sampling.refine_solid_angle = Some(angle);
                });
            }
        }
    }

    /// What specular scenes have.
    fn gloss(&mut self) {
        for n in [0, 1, 2, 4] {
            self.add("chains (lgmax)", n, |s, _| s.first_pass.chain.lg_max = Some(n));
        }
        for share in [0.1, 0.01] {
            self.add("chains (EFFMIN)", share, |s, _| s.first_pass.chain.eff_min = share);
        }
        for tolerance in [1e-2, 1e-3] {
            self.add("chains (tolerance)", tolerance, |s, _| s.first_pass.chain.tolerance = tolerance);
        }
        for entries in [5, 20, 200] {
            self.add("Fresnel table", format!("{entries} entries"), |s, _| s.fresnel_entries = entries);
        }
        for n in [1, 2, 32] {
            self.add("lobe samples", n, |s, _| s.second_pass.lobe_samples = n);
        }
    }

    /// What diffuse scenes have.
    fn links(&mut self) {
        for tolerance in [0.03, 0.01, 0.003] {
            self.add("links", format!("tolerance {tolerance}"), |s, _| {
                s.links = Some(LinkSettings { tolerance, ..LinkSettings::default() });
            });
        }
    }

    /// Rays of the second pass on its upper rungs.
    fn rays(&mut self) {
        for n in [4, 16] {
            self.add("lamp samples", format!("{n} on direct"), |s, _| {
                s.second_pass.rung = Rung::Direct;
                s.second_pass.lamp_samples = n;
            });
        }
        for n in [1, 8, 32] {
            self.add("gather samples", format!("{n} on gather"), |s, _| {
                s.second_pass.rung = Rung::Gather;
                s.second_pass.gather_samples = n;
            });
        }
    }
}

//! The command line as typed: the commands, and the options that several share. What only one has stands with it.

use super::{
    bench, compare, crosscheck, export, info, measure, reference, relight, render, tradeoff, validate,
};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Computes the light in a scene by two passes over a visibility graph.
#[derive(Debug, Parser)]
#[command(name = "luxgraph", version, about, max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene to an EXR and a PNG
    Render(render::Render),
    /// Render many appearances over one visibility graph, without a ray in the first pass; objects may move
    Relight(relight::Relight),
    /// Render by an unbiased path tracer that says how noisy it is: the judge of the two passes
    Reference(reference::Reference),
    /// Tell how far two images of one view are apart
    Compare(compare::Compare),
    /// Write a scene for another renderer, to be checked by it
    Export(export::Export),
    /// Measure illuminance and melanopic EDI at the sensors and grids of a scene
    Measure(measure::Measure),
    /// Put the ray tracers side by side, with an exact judge on every disagreement
    Crosscheck(crosscheck::Crosscheck),
    /// Tell what this build has and what a scene consists of and requires
    Info(info::Info),
    /// Run the checks against closed forms and published cases: expected, found, error
    Validate(validate::Validate),
    /// Time every stage of a scene beside its ceiling
    Bench(bench::Bench),
    /// Turn one knob after the other, and hold time and error against a judge: CSV, plots, the Pareto front
    Tradeoff(tradeoff::Tradeoff),
}

/// Options common to `render` and `relight`.
#[derive(Debug, Args)]
pub struct Options {
    /// The view.
    #[command(flatten)]
    pub view: View,
    /// Options of the light.
    #[command(flatten)]
    pub lighting: Lighting,
    /// Where the second pass takes the diffuse light at a hit from [default: the preset's, interpolate in standard]
    #[arg(long, value_enum)]
    pub second_pass: Option<SecondPassArg>,
    /// Show the first pass alone (the paper's figures 7 and 8) or both (figure 9)
    #[arg(long, value_enum, default_value_t = PassesArg::Both)]
    pub passes: PassesArg,
    /// Samples a pixel; with --noise the fewest [default: the preset's, 16 in standard]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub samples: Option<u32>,
    /// Sample until the standard error of luminance is this, 1% for instance, and put the samples where they are worth
    /// most: root mean square over the pixels, relative to the luminance around or, in the dark, to a tenth of the image's
    /// mean. 32 samples a pixel are taken at least. The EXR gets channels noise.Y (cd/m²) and samples
    #[arg(long, value_name = "SHARE")]
    pub noise: Option<String>,
    /// With --noise: most samples a pixel
    #[arg(long, value_name = "N", requires = "noise", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub max_samples: u32,
    /// Shadow rays sent to lamps at every hit, with --second-pass direct or gather: more make soft shadows less noisy
    /// in place of more samples a pixel, at the price of a shadow ray each [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub lamp_samples: Option<u32>,
    /// Rays sent over the hemisphere of what a pixel sees, with --second-pass gather: more make diffuse light less
    /// noisy, at the price of a ray and often a shadow ray each, of --samples times as many a pixel [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub gather_samples: Option<u32>,
    /// Limit the specks that lamps make which gloss shows over mirrors or through glass: only chance finds their
    /// light. One ray brings a pixel no more than so many times what surfaces reflect in the mean, 0.25 for instance;
    /// what that leaves out is told [default: no limit]
    #[arg(long, value_name = "TIMES")]
    pub clamp: Option<f64>,
    /// Seed of the second pass
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,
    /// How the image is written.
    #[command(flatten)]
    pub picture: Picture,
}

/// Options of all commands that compute light.
#[derive(Debug, Args)]
pub struct Lighting {
    /// Preset that the other options then change
    #[arg(long, value_enum, default_value_t = QualityArg::Standard)]
    pub quality: QualityArg,
    /// About so many sample points [default: as the scene's [sampling] and the preset have it]
    #[arg(long, value_name = "N")]
    pub points: Option<usize>,
    /// meyer4, or how many bands from 380 to 780 nm [default: the preset's, 8 in standard]
    #[arg(long, value_name = "meyer4|N")]
    pub wavelengths: Option<String>,
    /// Form factors [default: the preset's, analytic in standard]
    #[arg(long, value_enum)]
    pub kernel: Option<KernelArg>,
    /// How the first pass is solved [default: iterative]
    #[arg(long, value_enum)]
    pub solver: Option<SolverArg>,
    /// Stop the solution when this share of the emitted flux is not yet absorbed [default: 0.0001]
    #[arg(long, value_name = "SHARE")]
    pub tolerance: Option<f64>,
    /// How near rough lobes between many directions are to be found from few, as a share of their height; 0: exactly
    /// [default: 0.1]
    #[arg(long, value_name = "SHARE")]
    pub lobe_tolerance: Option<f64>,
    /// Exchange light between points and clusters of points with a form factor of this at most, 0.01 for instance, in
    /// place of all pairs; specular materials then spread their light evenly [default: all pairs of up to --most-paired
    /// points, links of 0.01 between more]
    #[arg(long, value_name = "FORM_FACTOR", conflicts_with = "graph")]
    pub link_tolerance: Option<f64>,
    /// Up to so many points light is exchanged between all pairs, whose graph grows with the square of their number;
    /// between more over links
    #[arg(long, value_name = "N", default_value_t = 30_000)]
    pub most_paired: usize,
    /// Up to so many specular points the light that they reflect and transmit to other surfaces keeps its way; of more
    /// it is spread evenly. Views show mirrors and glass in any case
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub most_specular: usize,
    /// Longest specular chain (the paper's lgmax) [default: as long as the tolerance asks]
    #[arg(long, value_name = "N")]
    pub lg_max: Option<u32>,
    /// End specular chains that carry less than this (the paper's EFFMIN) [default: 0]
    #[arg(long, value_name = "SHARE")]
    pub eff_min: Option<f64>,
    /// Who answers rays.
    #[command(flatten)]
    pub tracing: Tracing,
    /// Keep the visibility graph: read it from this file if it exists, write it if not
    #[arg(long, value_name = "FILE")]
    pub graph: Option<PathBuf>,
    /// Write what was done, with times and counts, as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// How an image is written.
#[derive(Debug, Args)]
pub struct Picture {
    /// Exposure of the PNG: auto, or EV (0 shows 100 cd/m² as white, +1 doubles the signal)
    #[arg(long, value_name = "auto|EV", default_value = "auto", allow_hyphen_values = true)]
    pub exposure: String,
    /// Add the spectral channels and CIE XYZ to the EXR
    #[arg(long)]
    pub spectral: bool,
}

/// The view that is shown.
#[derive(Debug, Args)]
pub struct View {
    /// Camera of the scene file [default: its first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height of the image in pixels [default: the camera's]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
}

/// Who answers rays, and on how many threads.
#[derive(Debug, Args)]
pub struct Tracing {
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// `--tracer`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TracerArg {
    /// Embree where it is built in, else voxel
    Auto,
    /// Intel Embree
    Embree,
    /// The paper's walk through voxels
    Voxel,
}

/// `--quality`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum QualityArg {
    /// A quarter of the points, lamps asked for their light (--second-pass direct). Cornell box 0.2 s of processor time
    /// and 2.9 % off in luminance, the paper's room 0.4 s and 12 %
    Draft,
    /// The paper's kernel, four wavelengths, Fresnel tables of 20 entries. Cornell box 0.15 s and 4.1 %, the paper's room
    /// 0.8 s and 11 %
    Paper,
    /// The scene's own sampling, exact near form factors, 16 samples a pixel. Cornell box 0.4 s and 1.7 %, the paper's
    /// room 1.2 s and 10 %
    Standard,
    /// Four times the points, 16 wavelengths, 256 samples a pixel, lamps asked for their light. Cornell box 5.5 s and
    /// 0.5 %, the paper's room 20 s and 2 %
    High,
}

/// `--second-pass`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SecondPassArg {
    /// The paper's: from the four closest sample points on the same surface
    Interpolate,
    /// Straight from lamps by shadow rays, the rest as before
    Direct,
    /// As direct, and one bounce gathered over the hemisphere
    Gather,
}

/// `--passes`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PassesArg {
    /// The global diffuse radiance alone
    First,
    /// With the specular light of the view
    Both,
}

/// `--kernel`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum KernelArg {
    /// Exact point-to-polygon factors where an element subtends much
    Analytic,
    /// Centre to centre everywhere
    Paper,
}

/// `--solver`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SolverArg {
    /// All points at once, to the tolerance
    Iterative,
    /// Brightest first, progressively
    Shooting,
}

/// Reads `640x480`.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    match parsed {
        Some([w, h])
            if (1..=65536).contains(&w)
                && (1..=65536).contains(&h)
                && u64::from(w) * u64::from(h) <= 1 << 28 =>
        {
            Ok([w, h])
        }
        Some(_) => Err("each side must be 1 to 65536 pixels, and the image at most 268 million".into()),
        None => Err("write it as WIDTHxHEIGHT, for example 640x480".into()),
    }
}

//! The command line as typed.

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
    Render(Render),
    /// Render many appearances over one visibility graph, without a ray in the first pass; objects may move
    Relight(Relight),
    /// Render by an unbiased path tracer that says how noisy it is: the judge of the two passes
    Reference(Reference),
    /// Tell how far two images of one view are apart
    Compare(Compare),
    /// Write a scene for another renderer, to be checked by it
    Export(Export),
    /// Measure illuminance and melanopic EDI at the sensors and grids of a scene
    Measure(Measure),
    /// Put the ray tracers side by side, with an exact judge on every disagreement
    Crosscheck(Crosscheck),
    /// Tell what this build has and what a scene consists of and requires
    Info(Info),
    /// Run the checks against closed forms and published cases: expected, found, error
    Validate(Validate),
    /// Time every stage of a scene beside its ceiling
    Bench(Bench),
    /// Turn one knob after the other, and hold time and error against a judge: CSV, plots, the Pareto front
    Tradeoff(Tradeoff),
}

/// `render`
#[derive(Debug, Args)]
pub struct Render {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Image in linear RGB, Y in cd/m²; a PNG of the same name is written beside it
    #[arg(short, long, value_name = "OUT.exr")]
    pub output: Option<PathBuf>,
    /// Where the PNG goes instead
    #[arg(long, value_name = "OUT.png")]
    pub preview: Option<PathBuf>,
    /// Change the scene first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// Add sample points where the light of the first pass bends, above all at the edges of shadows: where the luminance of
    /// neighbours strays from a linear one by more than this share of the scene's mean, 5% for instance
    #[arg(long, value_name = "SHARE", conflicts_with_all = ["graph", "error", "within"])]
    pub refine: Option<String>,
    /// With --refine: at most so many times as many points
    #[arg(long, value_name = "FACTOR", requires = "refine", default_value_t = 4.0)]
    pub refine_growth: f64,
    /// Options common to render and relight.
    #[command(flatten)]
    pub options: Options,
    /// Choose points, rung, wavelengths and samples so that luminance is wrong by this much at most (root mean square
    /// over the pixels that show no lamp, of their mean), 2% for instance; what is reached is estimated and told.
    /// --quality is where the choice begins; --second-pass and --wavelengths stay as they are given
    #[arg(long, value_name = "SHARE", conflicts_with_all = ["within", "samples", "resume", "graph", "noise"])]
    pub error: Option<String>,
    /// The same for a time, 30s or 2min: as little wrong as can be had within it
    #[arg(long, value_name = "TIME", conflicts_with_all = ["samples", "resume", "graph", "noise"])]
    pub within: Option<String>,
    /// Go on with a render of the same scene and settings that was interrupted: its finished rows are in
    /// OUT.exr.partial
    #[arg(long)]
    pub resume: bool,
}

/// `relight`
#[derive(Debug, Args)]
pub struct Relight {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Other materials, lamps, or places of objects (scenes/FORMAT.md); each file gives an image named after it
    #[arg(long, value_name = "CHANGES.toml", required = true)]
    pub changes: Vec<PathBuf>,
    /// Folder for the images
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Solve every appearance by itself, which gives the bits that `render --changes` gives: else each goes on from
    /// the solutions before it, to the same tolerance
    #[arg(long)]
    pub same_bits: bool,
    /// Options common to render and relight.
    #[command(flatten)]
    pub options: Options,
}

/// `reference`
#[derive(Debug, Args)]
pub struct Reference {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Image as `render` writes it, with the standard error of luminance as channel noise.Y, cd/m²; a PNG of the same
    /// name is written beside it
    #[arg(short, long, value_name = "OUT.exr")]
    pub output: PathBuf,
    /// Change the scene first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// Camera of the scene file [default: its first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height of the image in pixels [default: the camera's]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Paths a pixel; more than 16 are rounded up to a multiple of 16
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1048576))]
    pub samples: u32,
    /// meyer4, or how many bands from 380 to 780 nm
    #[arg(long, value_name = "meyer4|N", default_value = "8")]
    pub wavelengths: String,
    /// Seed of the paths
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,
    /// Exposure of the PNG: auto, or EV (0 shows 100 cd/m² as white, +1 doubles the signal)
    #[arg(long, value_name = "auto|EV", default_value = "auto", allow_hyphen_values = true)]
    pub exposure: String,
    /// Add the spectral channels and CIE XYZ to the EXR
    #[arg(long)]
    pub spectral: bool,
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write samples, rays, noise and time as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `export`
#[derive(Debug, Args)]
pub struct Export {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Folder for scene.xml (Mitsuba 3, spectral variants) and its meshes; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Change the scene first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// Camera of the scene file [default: its first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height of the image in pixels [default: the camera's]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Samples a pixel that the other renderer is asked for
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..))]
    pub samples: u32,
}

/// `compare`
#[derive(Debug, Args)]
pub struct Compare {
    /// The image that counts as true, EXR with channels R, G, B
    #[arg(value_name = "REFERENCE.exr")]
    pub reference: PathBuf,
    /// The other, of the same size
    #[arg(value_name = "IMAGE.exr")]
    pub image: PathBuf,
    /// PNG of the relative difference of luminance: white none, red brighter, blue darker, full colour at 20 %
    #[arg(short, long, value_name = "OUT.png")]
    pub output: Option<PathBuf>,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `measure`
#[derive(Debug, Args)]
pub struct Measure {
    /// Scene file with `[[sensors]]` or `[[grids]]` (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Table of all readings, spectral ones included
    #[arg(short, long, value_name = "OUT.csv")]
    pub output: Option<PathBuf>,
    /// Change the scene's materials and lights first, as `relight` would; may be repeated
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Vec<PathBuf>,
    /// Options of the light.
    #[command(flatten)]
    pub lighting: Lighting,
}

/// Options of all commands that compute light.
#[derive(Debug, Args)]
pub struct Lighting {
    /// Preset that the other options then change
    #[arg(long, value_enum, default_value_t = QualityArg::Standard)]
    pub quality: QualityArg,
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
    /// Up to so many points light is exchanged between all pairs, whose graph grows with the square of their number; between
    /// more over links
    #[arg(long, value_name = "N", default_value_t = 30_000)]
    pub most_paired: usize,
    /// Up to so many specular points the light that they reflect and transmit to other surfaces keeps its way; of more it is
    /// spread evenly. Views show mirrors and glass in any case
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub most_specular: usize,
    /// Longest specular chain (the paper's lgmax) [default: as long as the tolerance asks]
    #[arg(long, value_name = "N")]
    pub lg_max: Option<u32>,
    /// End specular chains that carry less than this (the paper's EFFMIN) [default: 0]
    #[arg(long, value_name = "SHARE")]
    pub eff_min: Option<f64>,
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Keep the visibility graph: read it from this file if it exists, write it if not
    #[arg(long, value_name = "FILE")]
    pub graph: Option<PathBuf>,
    /// Write what was done, with times and counts, as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// Options common to `render` and `relight`.
#[derive(Debug, Args)]
pub struct Options {
    /// Camera of the scene file [default: its first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height of the image in pixels [default: the camera's]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
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
    /// Sample until the standard error of luminance is this, 1% for instance, and put the samples where they are worth most:
    /// root mean square over the pixels, relative to the luminance around or, in the dark, to a tenth of the image's
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
    /// Seed of the second pass
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,
    /// Exposure of the PNG: auto, or EV (0 shows 100 cd/m² as white, +1 doubles the signal)
    #[arg(long, value_name = "auto|EV", default_value = "auto", allow_hyphen_values = true)]
    pub exposure: String,
    /// Add the spectral channels and CIE XYZ to the EXR
    #[arg(long)]
    pub spectral: bool,
}

/// `crosscheck`
#[derive(Debug, Args)]
pub struct Crosscheck {
    /// Scene file
    pub scene: PathBuf,
    /// Segments to try, half of them adversarial
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub rays: u64,
    /// Seed of the segments
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write every disagreement as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `info`
#[derive(Debug, Args)]
pub struct Info {
    /// Scene file; without it, what this build has
    pub scene: Option<PathBuf>,
    /// Write the same as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `validate`
#[derive(Debug, Args)]
pub struct Validate {
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write every case as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `bench`
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Bench {
    /// What else to measure
    #[command(subcommand)]
    pub what: Option<BenchWhat>,
    /// The stages of a scene.
    #[command(flatten)]
    pub stages: BenchStages,
}

/// `bench [SCENE]`
#[derive(Debug, Args)]
pub struct BenchStages {
    /// Scene file
    #[arg(default_value = "scenes/paper_room.toml")]
    pub scene: PathBuf,
    /// Numbers of sample points, about; may be repeated
    #[arg(long, value_name = "N", default_values_t = [4_010, 8_000, 32_000])]
    pub points: Vec<usize>,
    /// Also time the graph after these changes moved, added or removed objects
    #[arg(long, value_name = "CHANGES.toml")]
    pub changes: Option<PathBuf>,
    /// meyer4, or how many bands from 380 to 780 nm
    #[arg(long, value_name = "meyer4|N", default_value = "meyer4")]
    pub wavelengths: String,
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// What `bench` can measure.
#[derive(Debug, Subcommand)]
pub enum BenchWhat {
    /// The paper's Tables 1 and 2 beside ours
    Paper {
        /// Scene file
        #[arg(default_value = "scenes/paper_room.toml")]
        scene: PathBuf,
        /// Ray tracer
        #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
        tracer: TracerArg,
        /// Threads [default: one for each processor]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
        threads: Option<u16>,
        /// Write the figures as JSON
        #[arg(long, value_name = "OUT.json")]
        report: Option<PathBuf>,
    },
    /// How time and memory grow with the number of sample points, on a hall of desks
    Hall(BenchHall),
}

/// `bench hall`
#[derive(Debug, Args)]
pub struct BenchHall {
    /// Numbers of sample points, about
    #[arg(value_name = "POINTS", default_values_t = [4_000, 16_000, 64_000, 128_000])]
    pub points: Vec<usize>,
    /// Exchange light over links between points and clusters of points, and see how that grows
    #[arg(long)]
    pub links: bool,
    /// Largest form factor of a link to a cluster of points [default: 0.01]
    #[arg(long, value_name = "FORM_FACTOR", requires = "links")]
    pub link_tolerance: Option<f64>,
    /// With --links: also solve over all pairs up to this number of points, and tell the difference
    #[arg(long, value_name = "POINTS", requires = "links", default_value_t = 20_000)]
    pub full: usize,
    /// Rows of desks
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub rows: u16,
    /// Desks in a row: 41 quadrilaterals each, with their lamps
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub columns: u16,
    /// meyer4, or how many bands from 380 to 780 nm
    #[arg(long, value_name = "meyer4|N", default_value = "4")]
    pub wavelengths: String,
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
}

/// `tradeoff`
#[derive(Debug, Args)]
pub struct Tradeoff {
    /// Scene file (scenes/FORMAT.md describes it)
    pub scene: PathBuf,
    /// Folder for tradeoff.csv, the plots and the judge; made if it is not there. What an earlier run measured there
    /// under the same conditions is not measured again
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Camera of the scene file [default: its first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Width and height of the image in pixels [default: the camera's, scaled to 20,000 pixels, or 5,000 with --quick]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Turn few knobs, on a small image before a noisier judge
    #[arg(long)]
    pub quick: bool,
    /// An image that counts as true but for its channel noise.Y, as `reference` writes it [default: one is made]
    #[arg(long, value_name = "JUDGE.exr", conflicts_with = "judge_samples")]
    pub reference: Option<PathBuf>,
    /// Paths a pixel of the judge [default: 4096, or 512 with --quick]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1048576))]
    pub judge_samples: Option<u32>,
    /// Leave out settings whose graph and first pass are expected to take longer, s
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub longest: f64,
    /// Ray tracer
    #[arg(long, value_enum, default_value_t = TracerArg::Auto)]
    pub tracer: TracerArg,
    /// Threads [default: one for each processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Write the figures as JSON
    #[arg(long, value_name = "OUT.json")]
    pub report: Option<PathBuf>,
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
    /// A quarter of the points, lamps asked for their light (--second-pass direct). Cornell box 0.35 s of processor time
    /// and 2.9 % off in luminance, the paper's room 0.5 s and 12 %
    Draft,
    /// The paper's kernel, four wavelengths, Fresnel tables of 20 entries. Cornell box 0.3 s and 4.1 %, the paper's room
    /// 1.7 s and 11 %
    Paper,
    /// The scene's own sampling, exact near form factors, 16 samples a pixel. Cornell box 0.7 s and 1.7 %, the paper's
    /// room 2 s and 10 %
    Standard,
    /// Four times the points, 16 wavelengths, 64 samples a pixel. Cornell box 7 s and 0.6 %, the paper's room 33 s and 3.5 %
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
fn parse_size(text: &str) -> Result<[u32; 2], String> {
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

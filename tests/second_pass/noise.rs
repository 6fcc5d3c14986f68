//! Is the noise that an image is said to have the noise that it has, and is it as low as asked?

use crate::folder::Folder;
use crate::lit::Lit;
use luxgraph::error::Error;
use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::scene::load;
use luxgraph::second_pass::{NoiseTarget, Rendered, Rung, render_with_checkpoint};
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::TracerChoice;

/// A room with a lamp under its ceiling, a shelf that throws a soft shadow, and a far wall.
fn room(far: &str) -> String {
    format!(
        r#"
format = 1
[sampling]
max_area = 0.3
[materials.wall]
reflectance = 0.5
[materials.shiny]
reflectance = 0.5
fresnel = "gold"
specular = 0.6
roughness = 0.25
[materials.lamp]
reflectance = 0.0
emission = {{ spectrum = 1.0, radiance = 10.0 }}
[[objects]]
name = "walls"
material = "wall"
quads = [[[0,0,0],[2,0,0],[2,2,0],[0,2,0]], [[0,0,2],[0,2,2],[2,2,2],[2,0,2]],
  [[0,0,0],[0,0,2],[2,0,2],[2,0,0]], [[0,2,0],[2,2,0],[2,2,2],[0,2,2]], [[0,0,0],[0,2,0],[0,2,2],[0,0,2]]]
[[objects]]
name = "far"
material = "{far}"
quads = [[[2,0,0],[2,0,2],[2,2,2],[2,2,0]]]
[[objects]]
name = "shelf"
material = "wall"
quads = [[[0.8,0.8,0.5],[0.8,1.4,0.5],[1.4,1.4,0.5],[1.4,0.8,0.5]], [[0.8,0.8,0.52],[1.4,0.8,0.52],[1.4,1.4,0.52],[0.8,1.4,0.52]]]
[[objects]]
name = "lamp"
material = "lamp"
quads = [[[0.8,0.8,1.9],[0.8,1.2,1.9],[1.2,1.2,1.9],[1.2,0.8,1.9]]]
[[cameras]]
name = "c"
position = [0.1, 1, 1.2]
target = [2, 1, 0.6]
fov_deg = 70
resolution = [32, 24]
"#
    )
}

/// The room, lit.
struct LitRoom(Lit);

impl LitRoom {
    fn new(far: &str, rung: Rung) -> Self {
        let scene = load(&Folder::new().write("room.toml", room(far))).unwrap_or_else(|e| panic!("{e}"));
        let mut settings = Settings { tracer: TracerChoice::Voxel, ..Settings::default() };
        settings.wavelengths = Wavelengths::meyer4();
        settings.second_pass.rung = rung;
        settings.second_pass.lobe_samples = 1;
        settings.first_pass.parts = true;
        LitRoom(Lit::new(scene, settings))
    }

    fn view(&self, samples: u32, noise: Option<NoiseTarget>, seed: u32) -> Result<Rendered, Error> {
        let LitRoom(lit) = self;
        let seen = pipeline::lit_scene(&lit.scene.geometry, &lit.prepared, &lit.light);
        let mut settings = lit.settings.second_pass;
        (settings.samples, settings.noise, settings.seed) = (samples, noise, seed);
        render_with_checkpoint(&seen, &lit.scene.cameras[0], lit.tracer().as_ref(), &settings, None, &Silent)
    }

    /// Luminance of every pixel, cd m⁻².
    fn luminance(&self, samples: u32, noise: Option<NoiseTarget>, seed: u32) -> (Vec<f64>, Rendered) {
        let rendered = self.view(samples, noise, seed).expect("rendered");
        ((0..rendered.image.pixels()).map(|p| rendered.image.xyz(p)[1]).collect(), rendered)
    }
}

/// What luminance is relative to in every pixel: its mean over the block of 4 x 4 pixels, or a tenth of that of the image.
fn against(truth: &[f64]) -> Vec<f64> {
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    let block = |p: usize| {
        let (x, y) = (p % 32 / 4 * 4, p / 32 / 4 * 4);
        (0..16).map(|k| truth[(y + k / 4) * 32 + x + k % 4]).sum::<f64>() / 16.0
    };
    (0..truth.len()).map(|p| block(p).max(0.1 * mean)).collect()
}

/// Root mean square relative noise, by what images of different randomness differ by.
fn noise_of(images: &[Vec<f64>], against: &[f64]) -> f64 {
    let n = images.len() as f64;
    let square = |p: usize| {
        let mean = images.iter().map(|l| l[p]).sum::<f64>() / n;
        images.iter().map(|l| (l[p] - mean).powi(2)).sum::<f64>() / (n - 1.0) / against[p].powi(2)
    };
    ((0..against.len()).map(square).sum::<f64>() / against.len() as f64).sqrt()
}

/// Images that were asked for `target`: is the noise as low, is it what they say, and is the mean right? How many
/// times as noisy as many samples are that are spread evenly.
fn is_as_asked(lit: &LitRoom, target: f64) -> f64 {
    const IMAGES: u32 = 8;
    let truth = lit.luminance(4096, None, 1000).0;
    let pixels = truth.len() as f64;
    let mean = truth.iter().sum::<f64>() / pixels;
    let against = against(&truth);
    let noise = Some(NoiseTarget { noise: target, most_samples: 16_384 });
    let images: Vec<_> = (0..IMAGES).map(|seed| lit.luminance(32, noise, seed)).collect();
    let (mut told, mut samples, mut off) = (0.0, 0.0, 0.0);
    for (luminance, rendered) in &images {
        let stats = rendered.stats.noise.as_ref().expect("it was asked for");
        told += stats.noise.powi(2) / f64::from(IMAGES);
        samples += stats.mean_samples / f64::from(IMAGES);
        off += (luminance.iter().sum::<f64>() / pixels / mean - 1.0) / f64::from(IMAGES);
    }
    let told = told.sqrt();
    let found = noise_of(&images.into_iter().map(|(l, _)| l).collect::<Vec<_>>(), &against);
    // As many samples evenly: between the powers of two around, at which Sobol's sequence is best.
    let below = 1 << samples.log2() as u32;
    let evenly = |samples| {
        let images: Vec<_> = (100..100 + IMAGES).map(|seed| lit.luminance(samples, None, seed).0).collect();
        noise_of(&images, &against).ln()
    };
    let (less, more) = (evenly(below), evenly(2 * below));
    let even = (less + (samples / f64::from(below)).log2() * (more - less)).exp();
    eprintln!(
        "asked {target}, told {told:.4}, found {found:.4}, mean off {off:.5}, samples {samples:.1}, as many evenly {even:.4}"
    );
    assert!(samples > 40.0, "more than the first samples are needed: {samples}");
    assert!(found < 1.1 * target && found > 0.5 * target, "asked {target}, found {found}");
    assert!((1.0 / 1.3..1.3).contains(&(found / told)), "told {told}, found {found}");
    assert!(off.abs() < 2e-3, "mean luminance off by {off}");
    even / found
}

#[test]
fn a_glossy_wall_is_as_noisy_as_asked() {
    // Since lobes ask lamps all of the image is much alike here too.
    let even = is_as_asked(&LitRoom::new("shiny", Rung::Direct), 0.008);
    assert!(even > 0.75, "{even} times as noisy spread evenly");
}

#[test]
fn soft_shadows_are_as_noisy_as_asked_with_fewer_samples() {
    let even = is_as_asked(&LitRoom::new("wall", Rung::Direct), 0.006);
    assert!(even > 1.1, "{even} times as noisy spread evenly");
}

#[test]
fn gathered_light_is_as_noisy_as_asked() {
    // All of the image is alike: nothing is to be gained, and two sequences a pixel are a little worse than one.
    let even = is_as_asked(&LitRoom::new("wall", Rung::Gather), 0.01);
    assert!(even > 0.85, "{even} times as noisy spread evenly");
}

#[test]
fn the_same_bits_from_one_and_three_threads() {
    let lit = LitRoom::new("shiny", Rung::Direct);
    let target = Some(NoiseTarget { noise: 0.05, most_samples: 256 });
    let threads = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
        pool.install(|| lit.view(4, target, 3).expect("rendered"))
    };
    let (one, three) = (threads(1), threads(3));
    assert!(one.image.radiance == three.image.radiance && one.noise == three.noise);
    assert_eq!(one.stats.noise, three.stats.noise);
}

#[test]
fn what_cannot_be_asked_for_is_refused() {
    let lit = LitRoom::new("shiny", Rung::Direct);
    for (noise, most_samples) in [(0.0, 64), (f64::NAN, 64), (2.0, 64), (0.1, 8), (0.1, u32::MAX)] {
        let refused = lit.view(16, Some(NoiseTarget { noise, most_samples }), 0);
        assert!(matches!(refused, Err(Error::Settings(_))), "{noise} {most_samples}");
    }
}

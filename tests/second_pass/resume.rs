//! Does an interrupted render go on to the very image that it would have given?

use glam::DVec3;
use luxgraph::error::{Error, Result};
use luxgraph::first_pass::DiffuseSolution;
use luxgraph::geometry::Shape;
use luxgraph::material::{FresnelTable, SampledMaterial};
use luxgraph::observer::{Observer, Silent};
use luxgraph::points::{SamplePoints, Sampling, divide_by_area};
use luxgraph::scene::{Camera, Geometry, MaterialId, ObjectId, SampledAppearance};
use luxgraph::second_pass::{
    Checkpoint, Interpolator, LitScene, NoiseTarget, Rendered, SecondPassSettings, SecondPassStats,
    render_with_checkpoint,
};
use luxgraph::spectrum::Wavelengths;
use luxgraph::tracers::brute_force::BruteForce;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Two facing walls, one of them rough metal.
struct World {
    geometry: Geometry,
    interpolator: Interpolator,
    appearance: SampledAppearance,
    solution: DiffuseSolution,
    camera: Camera,
    settings: SecondPassSettings,
}

impl World {
    fn new() -> World {
        let p = DVec3::new;
        let wall = Shape::Quad([p(0.0, 0.0, 0.0), p(4.0, 0.0, 0.0), p(4.0, 4.0, 0.0), p(0.0, 4.0, 0.0)]);
        let metal = Shape::Quad([p(0.0, 0.0, 2.0), p(0.0, 4.0, 2.0), p(4.0, 4.0, 2.0), p(4.0, 0.0, 2.0)]);
        let shapes = vec![(wall, false, 0, ObjectId(0)), (metal, false, 1, ObjectId(0))];
        let geometry = Geometry::new(shapes, vec!["walls".into()]);
        let points =
            SamplePoints::new(&geometry, &divide_by_area(&geometry, &Sampling::by_area(0.3)), 1, |_| 0);
        let xyz_weights = vec![[10.0, 30.0, 50.0], [90.0, 80.0, 1.0]];
        let wavelengths = Wavelengths::points(vec![480.0, 580.0], xyz_weights);
        let material = |s: f64| SampledMaterial {
            diffuse: vec![0.2; 2],
            s,
            m: 0.3,
            reflect: FresnelTable::new(2, 4, |_, cos| 1.0 - 0.5 * cos),
            transmission: None,
            spread: None,
            emission: vec![0.0; 2],
        };
        World {
            interpolator: Interpolator::new(&geometry, &points, &BruteForce::new(&geometry)),
            appearance: SampledAppearance {
                wavelengths: wavelengths.clone(),
                materials: vec![material(0.0), material(0.9)],
                surface_material: vec![MaterialId(0), MaterialId(1)],
                lights: Vec::new(),
                sky: None,
            },
            solution: DiffuseSolution {
                wavelengths,
                parts: None,
                radiance: (0..2 * points.len()).map(|i| 1.0 + (i * 2654435761 % 97) as f32).collect(),
                stats: Default::default(),
            },
            camera: Camera {
                name: "c".into(),
                position: p(0.3, 0.4, 0.5),
                target: p(3.0, 3.0, 1.5),
                up: DVec3::Z,
                fov_deg: 70.0,
                resolution: [45, 83],
            },
            settings: SecondPassSettings { samples: 2, ..Default::default() },
            geometry,
        }
    }

    fn with<T>(&self, f: impl FnOnce(&LitScene, &BruteForce) -> T) -> T {
        let scene = LitScene {
            geometry: &self.geometry,
            interpolator: &self.interpolator,
            appearance: &self.appearance,
            solution: &self.solution,
        };
        f(&scene, &BruteForce::new(&self.geometry))
    }

    fn keep(&self, out: &Path, resume: bool, observer: &dyn Observer) -> Result<Rendered> {
        let checkpoint = Checkpoint::beside(out, resume);
        self.with(|scene, tracer| {
            render_with_checkpoint(scene, &self.camera, tracer, &self.settings, Some(&checkpoint), observer)
        })
    }
}

fn assert_same(a: &Rendered, b: &Rendered) {
    assert!(a.image.radiance.iter().zip(&b.image.radiance).all(|(a, b)| a.to_bits() == b.to_bits()));
    let timeless = |stats: &SecondPassStats| SecondPassStats { second_pass_s: 0.0, ..stats.clone() };
    assert_eq!(timeless(&a.stats), timeless(&b.stats));
    assert_eq!(a.noise, b.noise);
}

#[test]
fn an_image_cut_off_anywhere_is_completed_to_the_bit() {
    let mut world = World::new();
    is_completed_to_the_bit(&world);
    world.settings.noise = Some(NoiseTarget { noise: 0.004, most_samples: 256 });
    is_completed_to_the_bit(&world);
}

fn is_completed_to_the_bit(world: &World) {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let out = dir.path().join("image.exr");
    let plain = world
        .with(|scene, tracer| {
            render_with_checkpoint(scene, &world.camera, tracer, &world.settings, None, &Silent)
        })
        .expect("renders");
    if let Some(noise) = &plain.noise {
        let few = noise.samples.iter().filter(|&&n| n == 32.0).count();
        assert!(few > 100 && few < noise.samples.len() - 100, "some pixels take more samples, {few} few");
    }
    assert_same(&plain, &world.keep(&out, false, &Silent).expect("renders"));
    let partial = Checkpoint::beside(&out, true).path().to_owned();
    assert_eq!(partial, dir.path().join("image.exr.partial"));
    let whole = std::fs::read(&partial).expect("the file is there");
    let n = whole.len();
    for cut in [0, 1, 39, 40, 41, 44, n / 5, n / 3, n / 2, n - 33, n - 1, n] {
        std::fs::write(&partial, &whole[..cut]).expect("written");
        assert_same(&plain, &world.keep(&out, true, &Silent).expect("goes on"));
        assert_eq!(std::fs::metadata(&partial).expect("the file is there").len(), n as u64, "cut at {cut}");
    }
    // A byte gone wrong costs the rows from there on, and no more than time.
    for at in [40, 50, n / 2, n - 1] {
        let mut spoilt = whole.clone();
        spoilt[at] ^= 1;
        std::fs::write(&partial, &spoilt).expect("written");
        assert_same(&plain, &world.keep(&out, true, &Silent).expect("goes on"));
    }
    Checkpoint::beside(&out, true).finish().expect("removed");
    assert!(!partial.exists());
}

#[test]
fn finished_rows_are_not_rendered_again() {
    /// Counts the bands that were kept: only they come at once, others tile by tile.
    #[derive(Default)]
    struct Kept(AtomicU64);
    impl Observer for Kept {
        fn begin(&self, _what: &str, _total: u64) {}
        fn advance(&self, steps: u64) {
            self.0.fetch_add(u64::from(steps > 1), Ordering::Relaxed);
        }
        fn end(&self) {}
    }
    let world = World::new();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let out = dir.path().join("image.exr");
    let bands = |resume: bool| {
        let kept = Kept::default();
        world.keep(&out, resume, &kept).expect("renders");
        kept.0.into_inner()
    };
    assert_eq!(bands(false), 0);
    assert_eq!(bands(true), 6);
    let partial = dir.path().join("image.exr.partial");
    let whole = std::fs::read(&partial).expect("the file is there");
    std::fs::write(&partial, &whole[..whole.len() - 1]).expect("written");
    assert_eq!(bands(true), 5);
    assert_eq!(bands(false), 0, "without resume everything is new");
}

#[test]
fn a_file_of_another_image_is_refused_and_left_alone() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let out = dir.path().join("image.exr");
    World::new().keep(&out, false, &Silent).expect("renders");
    let partial = dir.path().join("image.exr.partial");
    let before = std::fs::read(&partial).expect("the file is there");
    for spoil in [
        (|w: &mut World| w.settings.seed = 1) as fn(&mut World),
        |w| w.settings.samples = 3,
        |w| w.settings.noise = Some(NoiseTarget { noise: 0.1, most_samples: 16 }),
        |w| w.camera.fov_deg += 1e-9,
        |w| w.camera.resolution = [83, 45],
        |w| w.solution.radiance[5] *= 1.000_001,
        |w| w.appearance.materials[1].m = 0.300_001,
        |w| w.appearance.materials[1].reflect.values[0] += 1e-6,
    ] {
        let mut world = World::new();
        spoil(&mut world);
        let refused = world.keep(&out, true, &Silent).map(|_| ());
        let Err(error @ Error::Settings(_)) = refused else { panic!("{refused:?}") };
        assert!(error.is_input() && error.to_string().contains("--resume"), "{error}");
        assert_eq!(std::fs::read(&partial).expect("the file is there"), before);
    }
    let mut world = World::new();
    world.settings.seed = 1;
    world.keep(&out, false, &Silent).expect("an old file is replaced");
}

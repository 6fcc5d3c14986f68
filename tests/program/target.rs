//! Is an image as right as it says, when an error is asked for in place of settings?

use luxgraph::observer::Silent;
use luxgraph::report::tradeoff::Judge;
use luxgraph::report::tradeoff::judge::JudgeSettings;
use luxgraph::scene::{self, Camera, Scene};
use luxgraph::second_pass::Rung;
use luxgraph::settings::Settings;
use luxgraph::target::{self, Fixed, Reached, Target};
use luxgraph::tracers::{self, TracerChoice};

fn view(file: &str) -> (Scene, Camera) {
    let scene = scene::load(format!("tests/target_scenes/{file}").as_ref()).unwrap();
    let camera = Camera { resolution: [48, 36], ..scene.cameras[0].clone() };
    (scene, camera)
}

fn render((scene, camera): &(Scene, Camera), target: Target, fixed: Fixed) -> Reached {
    let tracer = tracers::choose(TracerChoice::Auto, &scene.geometry).unwrap();
    target::render((scene, camera), tracer.as_ref(), &Settings::default(), (target, fixed), &Silent).unwrap()
}

#[test]
fn the_true_error_is_about_as_large_as_estimated() {
    for file in ["corridor.toml", "stairs.toml", "window.toml"] {
        let view = view(file);
        let reached = render(&view, Target::Error(0.06), Fixed::default());
        let folder = tempfile::tempdir().unwrap();
        let tracer = tracers::choose(TracerChoice::Auto, &view.0.geometry).unwrap();
        let settings = JudgeSettings { samples: 512, sensor_samples: 16, sensors: 0 };
        let (scene, camera) = &view;
        let judge =
            Judge::of(folder.path(), None, (scene, camera), tracer.as_ref(), &settings, &Silent).unwrap();
        let image = reached.image.to_linear();
        let truth = judge.judged.errors(&[image.clone(), image]).unwrap();
        let estimate = reached.estimate;
        println!("{file}: {estimate:?}, true {} to {}", truth.rmse_low, truth.rmse_high);
        assert!(estimate.total <= 0.06, "{file}: {estimate:?}");
        assert!(truth.rmse_low < 1.5 * estimate.total, "{file}: {truth:?} {estimate:?}");
        assert!(truth.rmse_high > 0.2 * estimate.total, "{file}: {truth:?} {estimate:?}");
    }
}

#[test]
fn an_error_gives_the_same_bits_from_any_number_of_threads_and_leaves_what_is_fixed() {
    let view = view("corridor.toml");
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let fixed = Fixed { rung: true, wavelengths: true };
        pool.install(|| render(&view, Target::Error(0.2), fixed))
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.image.radiance, three.image.radiance);
    assert_eq!(one.estimate, three.estimate);
    assert_eq!(one.settings.second_pass.rung, Rung::Interpolate);
    assert_eq!(one.settings.wavelengths, Settings::default().wavelengths);
}

#[test]
fn a_smaller_error_takes_more_and_too_little_time_still_gives_an_image() {
    let view = view("corridor.toml");
    let (coarse, fine) = (
        render(&view, Target::Error(0.3), Fixed::default()),
        render(&view, Target::Error(0.05), Fixed::default()),
    );
    assert!(fine.estimate.total < coarse.estimate.total);
    assert!(fine.second_pass.rays() > coarse.second_pass.rays() || fine.steps.len() > coarse.steps.len());
    let hurried = render(&view, Target::Within(0.1), Fixed::default());
    assert_eq!(hurried.steps.len(), 2);
    assert!(hurried.image.radiance.iter().all(|l| l.is_finite()) && hurried.estimate.total > 0.0);
}

#[test]
fn points_are_not_refined_for_an_error_that_they_cannot_mend() {
    let (scene, camera) = &view("corridor.toml");
    let tracer = tracers::choose(TracerChoice::Auto, &scene.geometry).unwrap();
    let mut settings = Settings::default();
    settings.first_pass.tolerance = 0.3;
    let asked = (Target::Error(0.01), Fixed { rung: true, wavelengths: true });
    let reached = target::render((scene, camera), tracer.as_ref(), &settings, asked, &Silent).unwrap();
    let estimate = reached.estimate;
    assert!(estimate.solver > 0.01, "the solver alone leaves more: {estimate:?}");
    assert!(reached.steps.len() <= 4 && reached.total_s < 100.0, "{:?}", reached.steps);
}

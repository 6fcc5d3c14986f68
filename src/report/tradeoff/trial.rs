//! Running trials, one after the other.

use super::judge::Judge;
use super::knobs::Trial;
use super::sensors::{self, Worst};
use super::table::{Against, Row, Took};
use crate::error::{Error, Result};
use crate::first_pass::DiffuseSolution;
use crate::observer::Observer;
use crate::pipeline::{self, Prepared};
use crate::points;
use crate::report::bench::scale::{Cost, timed};
use crate::scene::{Camera, SampledAppearance, Scene, Sensor};
use crate::second_pass::SecondPassSettings;
use crate::tracers::RayTracer;
use crate::voxels::Voxels;
use std::collections::BTreeMap;

/// Without a measurement, time grows with the points as this power of their number.
const GROWTH: f64 = 2.0;

/// A scene, a camera and a judge; keeps the points and the solution of the last trial for the next.
pub struct Bench<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    tracer: &'a dyn RayTracer,
    judge: &'a Judge,
    sensors: Vec<Sensor>,
    longest_s: f64,
    prepared: Option<Kept<Prepared>>,
    lit: Option<Kept<Lit>>,
    /// How long graph and first pass took at least, s, by the number of points.
    taken: BTreeMap<usize, f64>,
}

/// What a first pass gives, and what sensors read of it.
struct Lit {
    light: (SampledAppearance, DiffuseSolution),
    worst: Option<Worst>,
}

/// A product of an earlier trial.
struct Kept<T> {
    key: String,
    product: T,
    cost: Cost,
}

/// What became of a trial.
#[derive(Debug)]
pub enum Outcome {
    /// It was measured.
    Measured(Box<Row>),
    /// It was left out: it would take about so long, s.
    TooLong(f64),
    /// It was left out: this scene cannot have these settings, and why.
    Refused(String),
}

impl<'a> Bench<'a> {
    /// Trials whose graph and first pass are expected to take more than `longest_s` are left out.
    pub fn new(
        (scene, camera): (&'a Scene, &'a Camera),
        tracer: &'a dyn RayTracer,
        judge: &'a Judge,
        longest_s: f64,
    ) -> Self {
        let all = sensors::all(scene);
        let sensors = judge.sensors.iter().filter_map(|j| all.get(j.number).cloned()).collect();
        Bench {
            scene,
            camera,
            tracer,
            judge,
            sensors,
            longest_s,
            prepared: None,
            lit: None,
            taken: BTreeMap::new(),
        }
    }

    /// Tells rows of this bench from others.
    pub fn key(&self, trial: &Trial) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
        let threads = rayon::current_num_threads();
        hasher.update(format!("{} {} {threads} ", self.judge.key, self.tracer.name()).as_bytes());
        hasher.update(trial.key().as_bytes());
        hasher.finalize().to_hex()[..16].to_owned()
    }

    /// Measures a trial.
    ///
    /// # Errors
    /// Those of [`pipeline`] but for [`Error::Settings`], which is [`Outcome::Refused`].
    pub fn run(&mut self, trial: &Trial, observer: &dyn Observer) -> Result<Outcome> {
        match self.measure(trial, observer) {
            Err(Error::Settings(why)) => Ok(Outcome::Refused(why)),
            outcome => outcome,
        }
    }

    fn measure(&mut self, trial: &Trial, observer: &dyn Observer) -> Result<Outcome> {
        let geometry = &self.scene.geometry;
        if let Some(s) = self.expected(trial)?.filter(|s| *s > self.longest_s) {
            return Ok(Outcome::TooLong(s));
        }
        let key = trial.key_of_points();
        if self.prepared.as_ref().is_none_or(|kept| kept.key != key) {
            (self.prepared, self.lit) = (None, None);
            let mut cost = Cost::default();
            let (sampling, settings) = (&trial.sampling, &trial.settings);
            let (tracer, appearance) = (self.tracer, &self.scene.appearance);
            let product = timed(&mut cost, || {
                let coarse = pipeline::prepare(geometry, sampling, settings, tracer, None, observer)?;
                pipeline::refine_by_light(geometry, coarse, appearance, sampling, settings, tracer, observer)
            })?;
            self.prepared = Some(Kept { key, product, cost });
        }
        let Some(prepared) = &self.prepared else { unreachable!("prepared above") };
        let key = trial.key_of_light();
        if self.lit.as_ref().is_none_or(|kept| kept.key != key) {
            self.lit = None;
            let mut cost = Cost::default();
            let (appearance, settings) = (&self.scene.appearance, &trial.settings);
            let light = timed(&mut cost, || {
                pipeline::light(geometry, &prepared.product, appearance, settings, observer)
            })?;
            let worst = self.worst(trial, &prepared.product, &light, observer)?;
            // Processor time: what else the machine does is no matter.
            let s = (prepared.cost.cpu_s + cost.cpu_s) / rayon::current_num_threads() as f64;
            let least = self.taken.entry(prepared.product.points.len()).or_insert(s);
            *least = least.min(s);
            self.lit = Some(Kept { key, product: Lit { light, worst }, cost });
        }
        let Some(lit) = &self.lit else { unreachable!("lit above") };
        let row = self.view(trial, prepared, lit, observer)?;
        Ok(Outcome::Measured(Box::new(row)))
    }

    /// The second pass under two seeds, and what the images are wrong by.
    fn view(
        &self,
        trial: &Trial,
        prepared: &Kept<Prepared>,
        lit: &Kept<Lit>,
        observer: &dyn Observer,
    ) -> Result<Row> {
        let mut costs = [Cost::default(); 2];
        let mut render = |seed: usize| {
            let settings = SecondPassSettings { seed: seed as u32, ..trial.settings.second_pass };
            let (image, _) = timed(&mut costs[seed], || {
                let (geometry, prepared) = (&self.scene.geometry, &prepared.product);
                let light = &lit.product.light;
                pipeline::view(geometry, prepared, light, self.camera, self.tracer, &settings, observer)
            })?;
            Ok(image.to_linear())
        };
        let errors = self.judge.judged.errors(&[render(0)?, render(1)?])?;
        let second_pass_s = costs[0].s.min(costs[1].s);
        let second_pass_cpu_s = 0.5 * (costs[0].cpu_s + costs[1].cpu_s);
        let worst = lit.product.worst.as_ref();
        let took = Took {
            knob: trial.knob.clone(),
            value: trial.value.clone(),
            on_front: false,
            points: prepared.product.points.len(),
            wavelengths: trial.settings.wavelengths.len(),
            samples: trial.settings.second_pass.samples,
            graph_s: prepared.cost.s,
            first_pass_s: lit.cost.s,
            second_pass_s,
            total_s: prepared.cost.s + lit.cost.s + second_pass_s,
            processor_s: prepared.cost.cpu_s + lit.cost.cpu_s + second_pass_cpu_s,
            peak_memory_bytes: [prepared.cost, lit.cost, costs[0], costs[1]]
                .map(|c| c.peak_memory_bytes)
                .into_iter()
                .fold(0, u64::max),
        };
        let against = Against {
            delta_e_judge: self.judge.judged.delta_e_of_noise(),
            judge_noise: self.judge.judged.relative_noise(),
            worst_sensor: worst.map(|w| w.name.clone()),
            worst_sensor_error: worst.map(|w| w.error),
            worst_sensor_judge_noise: worst.map(|w| w.judge_noise),
            key: self.key(trial),
        };
        Ok(Row { took, errors, against })
    }

    /// The sensor that is most wrong under this light.
    fn worst(
        &self,
        trial: &Trial,
        prepared: &Prepared,
        light: &(SampledAppearance, DiffuseSolution),
        observer: &dyn Observer,
    ) -> Result<Option<Worst>> {
        if self.sensors.is_empty() {
            return Ok(None);
        }
        let (geometry, settings) = (&self.scene.geometry, &trial.settings.measure);
        let readings =
            pipeline::measure(geometry, prepared, light, &self.sensors, self.tracer, settings, observer)?;
        let totals: Vec<Vec<f64>> = readings.iter().map(|r| r.total()).collect();
        let totals = totals.iter().map(Vec::as_slice);
        Ok(sensors::worst(&self.judge.sensors, totals, &light.0.wavelengths))
    }

    /// How long graph and first pass of a trial will take, s, going by earlier ones with fewer points; `None` where as many
    /// were tried already, or nothing.
    fn expected(&self, trial: &Trial) -> Result<Option<f64>> {
        let (geometry, factor) = (&self.scene.geometry, trial.settings.area_factor);
        let sampling = points::Sampling { area_factor: factor, ..trial.sampling };
        let voxels = Voxels::build(geometry, &trial.settings.voxels);
        let n = points::sample(geometry, &sampling, &voxels)?.len();
        let Some((&last, &s)) = self.taken.last_key_value().filter(|(most, _)| **most < n) else {
            return Ok(None);
        };
        let before = self.taken.range(..=2 * last / 3).next_back();
        let growth = before
            .map_or(GROWTH, |(&fewer, &less)| (s / less.max(1e-3)).ln() / (last as f64 / fewer as f64).ln());
        Ok(Some(s * (n as f64 / last as f64).powf(growth.max(GROWTH))))
    }
}

#[cfg(test)]
mod tests {
    use super::super::Judged;
    use super::*;
    use crate::observer::Silent;
    use crate::output::LinearImage;
    use crate::report::bench::hall::hall;
    use crate::settings::Settings;
    use crate::tracers::{self, TracerChoice};
    use crate::visibility::LinkSettings;

    #[test]
    fn what_a_scene_cannot_have_is_left_out_with_its_reason() {
        let mut scene = hall(1, 1);
        scene.sampling.refine_solid_angle = Some(1.0);
        let camera = Camera { resolution: [4, 3], ..scene.cameras[0].clone() };
        let tracer = tracers::choose(TracerChoice::Auto, &scene.geometry).unwrap();
        let judged = Judged {
            image: LinearImage { width: 4, height: 3, rgb: vec![1.0; 36] },
            noise: vec![0.0; 12],
            counts: vec![true; 12],
        };
        let judge = Judge { judged, sensors: Vec::new(), key: String::new(), kept: false };
        let mut bench = Bench::new((&scene, &camera), tracer.as_ref(), &judge, f64::INFINITY);
        let trial = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings { area_factor: 16.0, ..Settings::default() };
            change(&mut settings);
            Trial { knob: "k".into(), value: "v".into(), settings, sampling: scene.sampling }
        };
        let mut refused = |change: &dyn Fn(&mut Settings)| match bench.run(&trial(change), &Silent).unwrap() {
            Outcome::Refused(why) => Some(why),
            Outcome::Measured(_) => None,
            other => panic!("{other:?}"),
        };
        let links = refused(&|s| s.links = Some(LinkSettings::default()));
        assert!(links.unwrap().contains("refine_solid_angle"));
        assert!(refused(&|s| s.area_factor = 1e-9).unwrap().contains("sample points"));
        assert_eq!(refused(&|_| ()), None);
    }
}

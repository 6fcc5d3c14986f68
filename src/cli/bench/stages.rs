//! `luxgraph bench [SCENE]`

use super::BenchStages;
use crate::cli::options::tracer_choice;
use crate::cli::progress::Bars;
use crate::cli::say::say;
use luxgraph::error::Result;
use luxgraph::report::bench::first_pass::FirstPassBench;
use luxgraph::report::bench::graph::GraphBench;
use luxgraph::report::bench::moved::MovedBench;
use luxgraph::report::bench::second_pass::SecondPassRates;
use luxgraph::report::bench::stages::{Section, Stages, stages};
use luxgraph::report::bench::tracers::TracerRates;
use luxgraph::report::paper_tables::group;
use luxgraph::report::{Machine, peak_memory_bytes, write_json};
use luxgraph::scene::SceneDescription;
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use serde::Serialize;

/// What `bench` measured.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    scene: String,
    peak_memory_bytes: u64,
    #[serde(flatten)]
    stages: Stages,
}

/// Times every stage of a scene beside its ceiling.
pub fn run(args: &BenchStages) -> Result<()> {
    let description = SceneDescription::read(&args.scene)?;
    let scene = description.compile()?;
    let changed = match &args.changes {
        Some(path) => Some(description.changed(path)?.compile_over(&scene)?),
        None => None,
    };
    let settings = Settings {
        tracer: tracer_choice(args.tracing.tracer),
        wavelengths: Wavelengths::parse(&args.wavelengths)?,
        ..Settings::default()
    };
    let bars = Bars::new();
    let stages = stages(&scene, changed.as_ref(), &settings, &args.points, &mut print, &bars)?;
    let (machine, peak_memory_bytes) = (Machine::this(), peak_memory_bytes());
    say!("peak memory {:.0} MB", peak_memory_bytes as f64 / 1e6);
    say!("on {}, {} threads, tracer {}", machine.processor, machine.threads, stages.second_pass.tracer);
    if let Some(path) = &args.report {
        let scene = args.scene.display().to_string();
        write_json(path, &Report { machine, scene, peak_memory_bytes, stages })?;
    }
    Ok(())
}

fn print(section: Section) {
    match section {
        Section::Graph(graph) => print_graph(graph),
        Section::FirstPass(points, first_pass) => print_first_pass(points, first_pass),
        Section::Moved(moved) => print_moved(moved),
        Section::SecondPass(rates) => print_second_pass(rates),
        Section::Tracers(on) => {
            say!("\nray tracers, million rays a second on one thread");
            say!(" surfaces  query     voxel  Embree single  ratio  Embree packets  voxel build s");
            on.into_iter().for_each(rates);
        }
    }
}

fn print_graph(graph: &GraphBench) {
    say!("\ngraph: time over that of a plain loop over the facing pairs ({})", graph.ceiling);
    say!("   points   graph s    loop s   ratio   Msegments/s    graph MB        rays");
    let GraphBench {
        points, graph_s, ceiling_s, ratio, ceiling_segments_per_s, memory_bytes, rays_cast, ..
    } = graph;
    say!(
        "{:>9}{graph_s:>10.3}{ceiling_s:>10.3}{ratio:>8.3}{:>14.1}{:>12.1}{:>12}",
        group(*points),
        ceiling_segments_per_s / 1e6,
        *memory_bytes as f64 / 1e6,
        group(*rays_cast)
    );
    say!(
        "pairs decided: same surface {}, not facing {}, proved {}, tested {}, last blocker {}, ray {}; see each other {} \
         (loop {})",
        group(graph.same_surface),
        group(graph.not_facing),
        group(graph.proved),
        group(graph.direct),
        group(graph.last_blocker),
        group(graph.rays_cast),
        group(graph.graph_seen),
        group(graph.ceiling_seen)
    );
}

fn print_moved(moved: &MovedBench) {
    let MovedBench { points, update_s, build_s, ratio, copied_share, different_pairs } = moved;
    say!(
        "changed scene, {} points: graph updated in {update_s:.3} s, {:.1} % of the {build_s:.3} s that a new one takes; \
         {:.1} % of the pairs copied, {} different",
        group(*points),
        100.0 * ratio,
        100.0 * copied_share,
        group(*different_pairs)
    );
}

fn print_first_pass(points: usize, first_pass: Option<&FirstPassBench>) {
    let points = group(points as u64);
    let Some(first_pass) = first_pass else {
        say!("first pass at {points} points: left out, the lobes of so many specular points take minutes");
        return;
    };
    say!("first pass: a sweep over the dense product of a stored matrix; relights over graph and first pass");
    say!("   points   W   sweep s  product s   ratio  set-up s  solve s  sweeps");
    let FirstPassBench { wavelengths, sweep_s, ceiling_s, ratio, setup_s, solve_s, sweeps, .. } = first_pass;
    let or_none = |x: &Option<f64>| x.map_or("-".into(), |x| format!("{x:.3}"));
    say!(
        "{points:>9}{wavelengths:>4}{sweep_s:>10.3}{:>11}{:>8}{setup_s:>10.3}{solve_s:>9.3}{sweeps:>8.0}",
        or_none(ceiling_s),
        or_none(ratio)
    );
    for relight in &first_pass.relights {
        say!(
            "relight, {}: {:.3} s, {:.1} % of graph and first pass",
            relight.change,
            relight.total_s,
            100.0 * relight.share_of_full
        );
    }
}

fn print_second_pass(view: &SecondPassRates) {
    let [width, height] = view.resolution;
    say!(
        "second pass, {width} x {height}, {} samples a pixel, {} rays: rate over that of a bare loop over its rays",
        view.samples,
        group(view.rays as u64)
    );
    say!("  threads       s   Mrays/s   bare   ratio  speed-up");
    for rate in &view.by_threads {
        let or_none = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.2}"));
        say!(
            "{:>9}{:>8.2}{:>10.2}{:>7}{:>8}{:>10.2}",
            rate.threads,
            rate.second_pass_s,
            rate.rays_per_s / 1e6,
            or_none(rate.bare_rays_per_s.map(|r| r / 1e6)),
            or_none(rate.ratio),
            rate.speedup
        );
    }
}

fn rates(of: &TracerRates) {
    let surfaces = group(of.surfaces as u64);
    let Some(embree) = &of.embree else {
        say!("{surfaces:>9}  closest {:>7.2}  no Embree in this build", of.voxel_closest_per_s / 1e6);
        say!("{surfaces:>9}  blocked {:>7.2}", of.voxel_occluded_per_s / 1e6);
        return;
    };
    let line = |query: &str, voxel: f64, single: f64, packets: f64| {
        say!(
            "{surfaces:>9}  {query} {:>7.2}{:>15.2}{:>7.2}{:>16.2}{:>15.3}",
            voxel / 1e6,
            single / 1e6,
            voxel / single,
            packets / 1e6,
            of.voxel_build_s
        );
    };
    line("closest", of.voxel_closest_per_s, embree.closest_per_s, embree.closest_packets_per_s);
    line("blocked", of.voxel_occluded_per_s, embree.occluded_per_s, embree.occluded_packets_per_s);
}

//! `luxgraph bench paper`

use super::BenchPaper;
use crate::cli::options::tracer_choice;
use crate::cli::progress::Bars;
use crate::cli::run::{counts, prepare};
use crate::cli::say::say;
use luxgraph::error::{Error, Result};
use luxgraph::report::paper_tables::{
    PAPER, PaperTables, SideBySide, duration, group, specular_points, time_visibility_calls,
};
use luxgraph::report::{Machine, peak_memory_bytes, write_json};
use luxgraph::second_pass::Passes;
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;
use luxgraph::visibility::{GraphSettings, GraphStats, VisibilityGraph};
use luxgraph::{pipeline, scene};
use serde::Serialize;

/// All that `bench paper` measured.
#[derive(Serialize)]
struct Report {
    machine: Machine,
    tracer: String,
    paper: PaperTables,
    luxgraph: PaperTables,
    graph_by_rays: GraphStats,
    visibility_rays_without_graph: u64,
    graph_memory_bytes: u64,
    graph_memory_budget_bytes: u64,
    second_pass_s: f64,
    second_pass_rays: u64,
    peak_memory_bytes: u64,
}

/// The paper's tables beside ours, and the second pass at 640 x 480 with 16 samples a pixel.
pub fn run(args: &BenchPaper) -> Result<()> {
    let scene = scene::load(&args.scene)?;
    let mut settings = Settings {
        tracer: tracer_choice(args.tracing.tracer),
        wavelengths: Wavelengths::meyer4(),
        ..Settings::default()
    };
    settings.second_pass.passes = Passes::Both;
    settings.second_pass.samples = 16;
    settings.first_pass.count_visibility_calls = true;
    let bars = Bars::new();
    let geometry = &scene.geometry;
    let (tracer, prepared) = prepare(&scene, &settings, None, &bars)?;
    let lit = pipeline::light(geometry, &prepared, &scene.appearance, &settings, &bars)?;
    let mut camera =
        scene.cameras.first().cloned().ok_or_else(|| Error::Settings("the scene has no camera".into()))?;
    camera.resolution = [640, 480];
    let (_, second_pass) =
        pipeline::view(geometry, &prepared, &lit, &camera, tracer.as_ref(), &settings.second_pass, &bars)?;
    let (appearance, solution) = &lit;

    let points = &prepared.points;
    let n = points.len() as u64;
    let stats = &prepared.graph.stats;
    let sizes = counts(&scene, &prepared, appearance);
    let direct_calls = n * n.saturating_sub(1);
    let all_calls = solution.stats.visibility_calls_without_graph.unwrap_or(0.0) as u64;
    let everyone: Vec<usize> = (0..points.len()).collect();
    let shiny = specular_points(points, |s| appearance.of(s).is_specular());
    let (direct_s, direct_rays) =
        time_visibility_calls(geometry, points, tracer.as_ref(), &everyone, direct_calls);
    let chain_calls = all_calls.saturating_sub(direct_calls);
    let (chain_s, chain_rays) = time_visibility_calls(geometry, points, tracer.as_ref(), &shiny, chain_calls);
    let eff_s = solution.stats.setup_s + solution.stats.solve_s;
    let ours = PaperTables {
        surfaces: sizes.surfaces as u64,
        points: n,
        specular_points: sizes.specular_points as u64,
        voxels: sizes.voxels as u64,
        empty_voxels: sizes.empty_voxels as u64,
        ordered_pairs: direct_calls,
        visible_edges: stats.visible_edges,
        hidden_edges: stats.hidden_edges,
        partial_edges: stats.partial_edges,
        pairs_stored: stats.pairs_stored,
        graph_s: stats.build_s,
        rays_cast: stats.rays_cast,
        eff_with_graph_s: eff_s,
        eff_without_graph_s: eff_s + direct_s + chain_s,
        calls_with_graph: stats.pairs,
        calls_without_graph: all_calls,
    };
    say!("\n{}", SideBySide(&ours));
    let budget = n * n / 8;
    let memory = prepared.graph.memory_bytes();
    say!("graph memory {} bytes, {:.2} of N²/8", group(memory), memory as f64 / budget.max(1) as f64);
    say!(
        "pairs decided: same surface {}, not facing {}, proved {}, candidates {}, last blocker {}, ray {}",
        group(stats.same_surface),
        group(stats.not_facing),
        group(stats.proved),
        group(stats.direct),
        group(stats.last_blocker),
        group(stats.rays_cast)
    );
    // The same graph the paper's way: what proofs leave open goes to the last blocker and to rays.
    let by_rays = GraphSettings { tests: false, ..GraphSettings::default() };
    let by_rays = VisibilityGraph::build_with(geometry, points, tracer.as_ref(), &by_rays, &bars)?.stats;
    say!(
        "with rays in place of the test of candidates: {} rays ({:.1} %), last blocker {}, {}",
        group(by_rays.rays_cast),
        100.0 * by_rays.ray_fraction(),
        group(by_rays.last_blocker),
        duration(by_rays.build_s)
    );
    say!(
        "second pass 640 x 480, 16 samples a pixel: {}, {} rays",
        duration(second_pass.second_pass_s),
        group(second_pass.rays())
    );
    say!("time without the graph: the calls were really made, {} rays", group(direct_rays + chain_rays));
    let machine = Machine::this();
    say!("on {}, {} threads, tracer {}", machine.processor, machine.threads, tracer.name());
    if let Some(path) = &args.report {
        let report = Report {
            machine,
            tracer: tracer.name(),
            paper: PAPER,
            luxgraph: ours,
            graph_by_rays: by_rays,
            visibility_rays_without_graph: direct_rays + chain_rays,
            graph_memory_bytes: memory,
            graph_memory_budget_bytes: budget,
            second_pass_s: second_pass.second_pass_s,
            second_pass_rays: second_pass.rays(),
            peak_memory_bytes: peak_memory_bytes(),
        };
        write_json(path, &report)?;
    }
    Ok(())
}

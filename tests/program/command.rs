//! Does the command do what its help says, and fail as it should?

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn luxgraph(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_luxgraph"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(args)
        .output()
        .expect("the command starts")
}

fn succeed(args: &[&str]) -> String {
    let output = luxgraph(args);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "luxgraph {args:?}: {error}");
    assert_eq!(
        error.matches("note:").count(),
        error.lines().count(),
        "only notes on standard error: {error}"
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Runs a command that must fail with `status`; returns what it said.
fn fail(status: i32, args: &[&str]) -> String {
    let output = luxgraph(args);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "luxgraph {args:?}: {error}");
    assert!(!error.contains("panicked"), "{error}");
    error
}

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary folders have plain names")
}

const SMALL: [&str; 6] = ["--quality", "draft", "--size", "48x36", "--samples", "2"];

fn render(scene: &str, out: &Path, more: &[&str]) -> Vec<u8> {
    let mut args = vec!["render", scene, "-o", text(out)];
    args.extend(SMALL);
    args.extend(more);
    succeed(&args);
    assert!(out.with_extension("png").is_file(), "a PNG stands beside the EXR");
    std::fs::read(out).expect("the EXR is there")
}

#[test]
fn the_same_bits_from_one_and_two_threads() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let one = render("scenes/paper_room.toml", &dir.path().join("one.exr"), &["--threads", "1"]);
    let two = render("scenes/paper_room.toml", &dir.path().join("two.exr"), &["--threads", "2"]);
    assert_eq!(one, two);
    let leftovers: Vec<PathBuf> = std::fs::read_dir(dir.path())
        .expect("the folder is there")
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| !matches!(path.extension().and_then(|e| e.to_str()), Some("exr" | "png")))
        .collect();
    assert!(leftovers.is_empty(), "nothing but the images stays: {leftovers:?}");
}

#[test]
fn relighting_casts_no_ray_and_equals_a_full_run() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let scene = "scenes/paper_room.toml";
    let changes = ["gold_to_sand", "chair", "lamp_a"].map(|c| format!("scenes/paper_room_{c}.changes.toml"));
    let mut args = vec!["relight", scene, "-o", text(dir.path()), "--same-bits"];
    args.extend(changes.iter().flat_map(|c| ["--changes", c.as_str()]));
    args.extend(SMALL);
    let said = succeed(&args);
    // By what is known of the images before, the same light to the first pass's tolerance.
    let quick = tempfile::tempdir().expect("a temporary folder");
    let quick_args: Vec<&str> = args.iter().copied().filter(|a| *a != "--same-bits").collect();
    let quick_args: Vec<&str> =
        quick_args.into_iter().map(|a| if a == text(dir.path()) { text(quick.path()) } else { a }).collect();
    succeed(&quick_args);
    let first_passes = said.lines().filter(|line| line.starts_with("first pass:"));
    assert_eq!(first_passes.filter(|line| line.ends_with(" 0 rays")).count(), 3, "{said}");
    assert_eq!(said.matches("graph: updated").count(), 1, "{said}");
    for change in &changes {
        let stem = Path::new(change).file_name().and_then(|n| n.to_str()).expect("a plain name");
        let relit = dir.path().join(stem.replace(".changes.toml", ".exr"));
        let relit = std::fs::read(&relit).unwrap_or_else(|e| panic!("{}: {e}", relit.display()));
        let full = render(scene, &dir.path().join("full.exr"), &["--changes", change]);
        assert!(relit == full, "{change}: other bytes");
        let name = stem.replace(".changes.toml", ".exr");
        let compared = succeed(&["compare", text(&dir.path().join(&name)), text(&quick.path().join(&name))]);
        let share = compared.split("luminance ").nth(1).and_then(|rest| rest.split(' ').next());
        let share: f64 = share.and_then(|s| s.parse().ok()).unwrap_or_else(|| panic!("{compared}"));
        assert!(share < 0.03, "{change}: {share} %");
    }
}

#[test]
fn a_kept_graph_gives_the_same_image_and_fits_its_scene_only() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let graph = dir.path().join("room.graph");
    let built = render("scenes/paper_room.toml", &dir.path().join("a.exr"), &["--graph", text(&graph)]);
    let read = render("scenes/paper_room.toml", &dir.path().join("b.exr"), &["--graph", text(&graph)]);
    assert_eq!(built, read);
    let out = dir.path().join("c.exr");
    let error = fail(2, &["render", "scenes/cornell_box.toml", "-o", text(&out), "--graph", text(&graph)]);
    assert!(error.contains("room.graph"), "{error}");
    assert!(!out.exists());
}

#[test]
fn both_tracers_agree_where_both_are_built() {
    let said = succeed(&["crosscheck", "scenes/paper_room.toml", "--rays", "20000"]);
    assert!(said.contains("20000") || said.contains("20,000"), "{said}");
    let dir = tempfile::tempdir().expect("a temporary folder");
    let report = dir.path().join("report.json");
    succeed(&["crosscheck", "scenes/cornell_box.toml", "--rays", "20000", "--report", text(&report)]);
    let json = std::fs::read_to_string(&report).expect("the report is there");
    let json: serde_json::Value = serde_json::from_str(&json).expect("it is JSON");
    let listed = json["listed"].as_array().map(Vec::len);
    assert_eq!(listed, json["disagreements"].as_u64().map(|n| n as usize), "every disagreement is listed");
    succeed(&["info"]);
    assert!(succeed(&["info", "scenes/paper_room.toml"]).contains("134 surfaces"));
}

#[test]
fn a_report_is_json_with_units_in_its_names() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let report = dir.path().join("report.json");
    render("scenes/cornell_box.toml", &dir.path().join("a.exr"), &["--report", text(&report)]);
    let text = std::fs::read_to_string(&report).expect("the report is there");
    let json: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    assert_eq!(json["first_pass"]["rays_cast"], 0);
    assert!(json["graph"]["build_s"].is_number());
    assert!(json["peak_memory_bytes"].is_u64());

    let more = ["--second-pass", "gather", "--lamp-samples", "3", "--gather-samples", "4"];
    render(
        "scenes/cornell_box.toml",
        &dir.path().join("b.exr"),
        &[&more[..], &["--report", self::text(&report)]].concat(),
    );
    let text = std::fs::read_to_string(&report).expect("the report is there");
    let json: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    let asked = &json["second_pass_settings"];
    assert_eq!((&asked["rung"], &asked["samples"]), (&"gather".into(), &2.into()));
    assert_eq!((&asked["lamp_samples"], &asked["gather_samples"]), (&3.into(), &4.into()));
    let (cameras, gathered) = (&json["second_pass"]["camera_rays"], &json["second_pass"]["gather_rays"]);
    assert!(gathered.as_u64() > cameras.as_u64().map(|n| 2 * n), "{json}");
    assert!(json["second_pass"]["noise"].is_null());

    let noise = ["--noise", "20%", "--max-samples", "64", "--report", self::text(&report)];
    let exr = render("scenes/cornell_box.toml", &dir.path().join("c.exr"), &noise);
    assert!(exr.windows(8).any(|bytes| bytes == b"samples\0"), "a channel tells the samples");
    let text = std::fs::read_to_string(&report).expect("the report is there");
    let json: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    let noise = &json["second_pass"]["noise"];
    assert!(noise["noise"].as_f64() < Some(0.2) && noise["mean_samples"].as_f64() >= Some(32.0), "{json}");
}

#[test]
fn wrong_input_is_named_with_its_place() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let scene = dir.path().join("bad.toml");
    std::fs::write(&scene, "format = 1\nnonsense = 3\n").expect("written");
    let error = fail(2, &["render", text(&scene)]);
    assert!(error.contains("bad.toml:2:1") && error.contains("nonsense"), "{error}");

    fail(2, &["render", "scenes/paper_room.toml", "--samples", "0"]);
    fail(2, &["render", "scenes/paper_room.toml", "--second-pass", "guess"]);
    let error = fail(2, &["render", "scenes/paper_room.toml", "--noise", "loud"]);
    assert!(error.contains("such as 2%"), "{error}");
    let few = ["render", "scenes/paper_room.toml", "--noise", "1%", "--max-samples", "8"];
    assert!(fail(2, &few).contains("16"));
    let error = fail(2, &["render", "scenes/paper_room.toml", "--refine", "none"]);
    assert!(error.contains("--refine of none"), "{error}");
    let error = fail(2, &["render", "scenes/paper_room.toml", "--lamp-samples", "2"]);
    assert!(error.contains("--second-pass direct"), "{error}");
    let direct = ["render", "scenes/paper_room.toml", "--second-pass", "direct", "--gather-samples", "2"];
    assert!(fail(2, &direct).contains("--second-pass gather"));
    let error = fail(2, &["render", "scenes/paper_room.toml", "--camera", "nowhere"]);
    assert!(error.contains("main"), "the cameras there are: {error}");
    let error = fail(2, &["render", "scenes/paper_room.toml", "--exposure", "bright"]);
    assert!(error.contains("bright"), "{error}");
    let error = fail(2, &["render", "scenes/paper_room.toml", "--wavelengths", "3"]);
    assert!(error.contains('3'), "{error}");
    let error = fail(1, &["render", "scenes/paper_room.toml", "-o", "no/such/folder/x.exr"]);
    assert!(error.contains("no/such/folder"), "{error}");
    let error = fail(1, &["render", "scenes/not_there.toml"]);
    assert!(error.contains("not_there.toml"), "{error}");
}

#[test]
fn no_output_overwrites_an_input_or_another_output() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let scene = dir.path().join("scene.toml");
    std::fs::write(&scene, "not read").expect("written");
    let png = dir.path().join("a.png");
    let beside = dir.path().join(".").join("scene.toml");
    for output in [&scene, &beside, &png] {
        let error = fail(2, &["render", text(&scene), "-o", text(output)]);
        assert!(error.contains(text(output)), "{error}");
    }
    assert!(!png.exists());
    assert_eq!(std::fs::read_to_string(&scene).expect("still there"), "not read");
}

#[test]
fn measure_writes_a_table_and_a_report() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let (csv, json) = (dir.path().join("m.csv"), dir.path().join("m.json"));
    let scene = "scenes/paper_room.toml";
    let measure = |threads: &str| {
        let args = ["measure", scene, "--quality", "draft", "--threads", threads];
        let shown = succeed(&[&args[..], &["-o", text(&csv), "--report", text(&json)]].concat());
        assert!(shown.contains("working plane") && shown.contains("estimate"), "{shown}");
        std::fs::read_to_string(&csv).expect("the table is there")
    };
    let table = measure("1");
    assert_eq!(table, measure("2"), "the same readings from one and two threads");
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines.len(), 1 + 4 + 8 * 6 + 10 * 8);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&json).expect("the report is there")).expect("JSON");
    let lux: f64 = lines[1].split(',').nth(9).and_then(|x| x.parse().ok()).expect("a number");
    let reported = report["sensors"][0]["total"]["illuminance_lx"].as_f64().expect("a number");
    assert!(lux > 100.0 && (lux / reported - 1.0).abs() < 1e-6, "{lux} {reported}");
    assert_eq!(report["first_pass"]["rays_cast"], 0);

    let error = fail(1, &["measure", scene, "-o", text(&dir.path().join("no/m.csv"))]);
    assert!(error.contains("no folder"), "{error}");
    let blind = dir.path().join("blind.toml");
    let quads = "quads = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]";
    let camera = "[[cameras]]\nname = \"c\"\nposition = [0, 0, 3]\ntarget = [1, 1, 0]\n";
    let object = format!("[[objects]]\nname = \"o\"\nmaterial = \"m\"\n{quads}\n");
    std::fs::write(&blind, format!("format = 1\n[materials.m]\nreflectance = 0.5\n{object}{camera}"))
        .expect("written");
    let error = fail(2, &["measure", text(&blind)]);
    assert!(error.contains("[[sensors]]"), "{error}");
}

#[test]
fn a_reader_that_leaves_early_does_no_harm() {
    use std::process::Stdio;
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("cross.json");
    let mut child = Command::new(env!("CARGO_BIN_EXE_luxgraph"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["crosscheck", "scenes/paper_room.toml", "--rays", "1000", "--report", text(&report)])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the command starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !error.contains("panicked"), "{error}");
    assert!(report.exists(), "what was asked for is written all the same");
}

#[test]
fn tradeoff_measures_once_and_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (out, report) = (folder.path().join("t"), folder.path().join("t.json"));
    // The box in elements ten times as large.
    let scene = std::fs::read_to_string("scenes/cornell_box.toml").unwrap();
    let spectra = std::fs::canonicalize("scenes/spectra").unwrap();
    let scene = scene.replace("max_area = 0.0", "max_area = 0.");
    let scene = scene.replace("\"spectra/", &format!("\"{}/", text(&spectra)));
    let coarse = folder.path().join("coarse.toml");
    std::fs::write(&coarse, scene).unwrap();
    let args = [
        "tradeoff",
        text(&coarse),
        "--quick",
        "--size",
        "12x12",
        "--judge-samples",
        "32",
        "--report",
        text(&report),
        "-o",
        text(&out),
    ];
    let said = succeed(&args);
    assert!(said.contains("judge: noise") && said.contains("Pareto"), "{said}");
    let csv = std::fs::read_to_string(out.join("tradeoff.csv")).unwrap();
    let rows = csv.lines().count() - 1;
    assert!(rows > 12 && csv.contains(",true,"), "{csv}");
    for name in ["judge.exr", "luminance.svg", "luminance.png", "colour.svg", "colour.png"] {
        assert!(out.join(name).metadata().unwrap().len() > 100, "{name}");
    }
    let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), rows);

    // A run that was interrupted after five rows keeps them, with the times they took.
    let lines: Vec<&str> = csv.lines().collect();
    std::fs::write(out.join("tradeoff.csv"), lines[..6].join("\n")).unwrap();
    let again = succeed(&args);
    assert!(again.contains("judge of an earlier run"), "{again}");
    let after = std::fs::read_to_string(out.join("tradeoff.csv")).unwrap();
    assert_eq!(after.lines().count() - 1, rows);
    let times = |line: &str| line.split(',').rev().take(12).map(str::to_owned).collect::<Vec<_>>();
    for (before, after) in lines[1..6].iter().zip(after.lines().skip(1)) {
        assert_eq!(times(before), times(after));
    }

    let wrong = fail(
        2,
        &[
            "tradeoff",
            text(&coarse),
            "-o",
            text(&out),
            "--size",
            "8x9",
            "--reference",
            text(&out.join("judge.exr")),
        ],
    );
    assert!(wrong.contains("12 x 12"), "{wrong}");
    fail(1, &["tradeoff", "scenes/cornell_box.toml", "-o", text(&out.join("tradeoff.csv"))]);
}

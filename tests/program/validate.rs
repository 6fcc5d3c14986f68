//! Do all checks of `luxgraph validate` pass, whichever tracer answers?

use luxgraph::tracers::embree;
use luxgraph::validate::{Case, Tolerance};
use serde_json::Value;
use std::process::Command;

/// Where it is not the only tracer: then the command's own run below is this.
#[cfg(feature = "embree")]
#[test]
fn all_checks_pass_with_the_voxel_tracer() {
    use luxgraph::observer::Silent;
    use luxgraph::tracers::TracerChoice;
    use luxgraph::validate;

    let groups = validate::run(TracerChoice::Voxel, &Silent).unwrap();
    let failed: Vec<&Case> = groups.iter().flat_map(|g| &g.cases).filter(|c| !c.passes()).collect();
    assert!(failed.is_empty(), "{failed:#?}");
    assert!(groups.iter().all(|g| !g.cases.is_empty()));
}

/// The tracer that is chosen by default, through the command.
#[test]
fn the_command_says_that_all_checks_pass() {
    let dir = tempfile::tempdir().unwrap();
    let report = dir.path().join("report.json");
    let output = Command::new(env!("CARGO_BIN_EXE_luxgraph"))
        .args(["validate", "--report"])
        .arg(&report)
        .output()
        .expect("the command starts");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let cases = report["groups"].as_array().unwrap().iter().flat_map(|g| g["cases"].as_array().unwrap());
    let (all, passed) = (cases.clone().count(), cases.filter(|c| c["pass"] == true).count());
    assert!(all > 400 && passed == all);
    assert_eq!(said.lines().last(), Some(format!("{all} of {all} pass").as_str()));
    assert_eq!(report["tracer"], if embree::available().is_some() { "embree" } else { "voxel" });
    assert_eq!(report["cases"], all);
}

#[test]
fn a_report_that_cannot_be_written_is_refused_before_the_work() {
    let output = Command::new(env!("CARGO_BIN_EXE_luxgraph"))
        .args(["validate", "--report", "no/such/folder/report.json"])
        .output()
        .expect("the command starts");
    assert!(!output.status.success() && output.stdout.is_empty());
}

#[test]
fn a_case_fails_beyond_its_tolerance_and_where_there_is_no_number() {
    let case =
        |expected, found, tolerance| Case { name: "test".into(), source: "", expected, found, tolerance };
    assert!(case(100.0, 100.4, Tolerance::Relative(0.005)).passes());
    assert!(!case(100.0, 100.6, Tolerance::Relative(0.005)).passes());
    assert!(!case(-2.0, 2.0, Tolerance::Relative(0.5)).passes());
    assert!(case(0.0, 0.01, Tolerance::Absolute(0.02)).passes());
    assert!(!case(0.0, f64::NAN, Tolerance::Absolute(1.0)).passes());
    assert!(!case(1.0, f64::INFINITY, Tolerance::Relative(1.0)).passes());
}

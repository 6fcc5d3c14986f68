//! Do all checks of `luxgraph validate` pass, whichever tracer answers?

use luxgraph::observer::Silent;
use luxgraph::tracers::{TracerChoice, embree};
use luxgraph::validate::{self, Case, Tolerance};

fn all_pass(choice: TracerChoice) {
    let groups = validate::run(choice, &Silent).unwrap();
    let failed: Vec<&Case> = groups.iter().flat_map(|g| &g.cases).filter(|c| !c.passes()).collect();
    for group in &groups {
        println!(
            "{}: {} cases, {:.1} s, worst {:?}",
            group.title,
            group.cases.len(),
            group.wall_s,
            group.worst()
        );
    }
    assert!(failed.is_empty(), "{failed:#?}");
    assert!(groups.iter().all(|g| !g.cases.is_empty()));
}

#[test]
fn all_checks_pass_with_the_voxel_tracer() {
    all_pass(TracerChoice::Voxel);
}

#[test]
fn all_checks_pass_with_embree() {
    if embree::available().is_some() {
        all_pass(TracerChoice::Embree);
    }
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

//! How many sweeps does the first pass need?

use crate::furnished_room;
use crate::small_scenes::*;
use luxgraph::first_pass::FirstPassSettings;
use luxgraph::first_pass::diffuse::DiffuseOperator;
use luxgraph::first_pass::system::System;
use luxgraph::material::SampledMaterial;
use luxgraph::observer::Silent;

/// The furnished room; `of` picks the material of each of its 134 quadrilaterals, of which 113 to 124 are lamps.
fn furnished(materials: Vec<SampledMaterial>, of: impl Fn(usize) -> usize) -> TestScene {
    let quads = furnished_room::quads();
    let quads: Vec<Quad> = quads.iter().enumerate().map(|(i, q)| (*q, of(i), false)).collect();
    TestScene::new(&quads, materials, 0.25)
}

fn is_lamp(quad: usize) -> bool {
    (113..=124).contains(&quad)
}

/// The walls stay diffuse; cupboard and mirror are ideal mirrors, the chairs are glossy.
fn shiny_room() -> TestScene {
    let materials = vec![
        diffuse(0.8, 0.0),
        diffuse(0.8, 10.0),
        glossy(0.7, 0.9, 0.2, 0.17, 0.0),
        glossy(0.9, 0.85, 0.0, 0.035, 0.0),
    ];
    furnished(materials, |i| match i {
        i if is_lamp(i) => 1,
        28..=83 => 2,
        84..=88 | 132 => 3,
        _ => 0,
    })
}

#[test]
fn twelve_sweeps_are_enough_for_a_bright_furnished_room() {
    let bright = vec![diffuse(0.8, 0.0), diffuse(0.8, 10.0)];
    let scene = furnished(bright, |i| usize::from(is_lamp(i)));
    let stats = scene.solve(&FirstPassSettings { tolerance: 1e-3, ..Default::default() }).unwrap().stats;
    println!("{} points: {} sweeps, residual {:.1e}", stats.points, stats.sweeps, stats.residual);
    assert!(stats.sweeps <= 12.0 && stats.residual <= 1e-3, "{stats:?}");
}

#[test]
fn mirrors_and_glossy_chairs_ask_for_few_more_sweeps() {
    let scene = shiny_room();
    let stats = scene.solve(&FirstPassSettings { tolerance: 1e-3, ..Default::default() }).unwrap().stats;
    println!(
        "{} points, {} specular: {} sweeps, {} rounds, residual {:.1e}",
        stats.points, stats.specular_points, stats.sweeps, stats.rounds, stats.residual
    );
    assert!(stats.specular_points > 100, "{stats:?}");
    assert!(stats.sweeps <= 14.0 && stats.rounds <= 4 && stats.residual <= 1e-3, "{stats:?}");
}

#[test]
fn a_wavelength_that_nothing_reflects_asks_for_no_more_sweeps() {
    let mut scene = shiny_room();
    scene.appearance.materials.iter_mut().for_each(|material| material.diffuse[0] = 0.0);
    let stats = scene.solve(&FirstPassSettings { tolerance: 1e-3, ..Default::default() }).unwrap().stats;
    println!("{} sweeps, {} rounds, residual {:.1e}", stats.sweeps, stats.rounds, stats.residual);
    assert!(stats.sweeps <= 14.0 && stats.residual <= 1e-3, "{stats:?}");
}

#[test]
fn chains_cost_what_specular_points_and_their_lobes_ask_for() {
    let scene = shiny_room();
    let settings = FirstPassSettings::default();
    let diffuse =
        DiffuseOperator::new(&scene.geometry, &scene.points, &scene.graph, settings.kernel, &Silent);
    let system = System::new(&scene.geometry, &diffuse, &scene.appearance, &settings, &Silent);
    // Groups of directions looked at: in a bounce from specular point to specular point, when all is delivered at the
    // end, and if lobes had no limits; and how few there could be.
    let (mut bounce, mut deliver, mut all, mut needed) = (0, 0, 0, 0);
    for point in &system.specular.points {
        let lobe = &point.reflection;
        all += lobe.len * lobe.groups();
        for l in 0..lobe.len {
            let a = lobe.get(l);
            for group in lobe.reach(a, 0..lobe.groups()) {
                deliver += 1;
                needed += usize::from(lobe.lobe(&a, group).is_some());
            }
        }
        bounce += (point.links.iter())
            .map(|link| lobe.reach(lobe.get(link.member as usize), 0..point.link_groups).count())
            .sum::<usize>();
    }
    let n = scene.points.len();
    println!(
        "{n} points, {} specular: {bounce} groups a bounce, {deliver} to deliver, {needed} of them in a lobe, \
         {all} without lobes",
        system.specular.points.len()
    );
    assert!(deliver * 2 < all && needed * 2 > deliver && bounce * 10 < deliver);
}

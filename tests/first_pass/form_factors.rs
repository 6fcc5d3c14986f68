//! Are the form factors right, and do they add up?

use crate::small_scenes::*;
use glam::{DVec3, Vec3};
use luxgraph::first_pass::diffuse::DiffuseOperator;
use luxgraph::first_pass::{FirstPassSettings, Kernel, form_factor};
use luxgraph::observer::Silent;

#[test]
fn the_elements_of_a_surface_have_the_factor_of_the_whole() {
    // Two walls of the cube are missing, and on one side a strip hides part of what is left.
    let mut quads: Vec<_> = cube([0; 6]).into_iter().take(4).collect();
    let v = |x: f64, z: f64| DVec3::new(x, 0.5, z);
    quads.push(([v(0.5, 0.3), v(1.0, 0.3), v(1.0, 0.4), v(0.5, 0.4)], 0, true));
    let scene = TestScene::new(&quads, vec![diffuse(0.5, 1.0)], 1.0 / 256.0);
    let points = &scene.points;
    let operator = DiffuseOperator::new(&scene.geometry, points, &scene.graph, Kernel::Analytic, &Silent);
    let facing = |i: usize, j: usize| {
        let d = points.position[j] - points.position[i];
        points.normal[i].dot(d) > 1e-5 && points.normal[j].dot(d) < -1e-5
    };
    let (mut open, mut hidden) = (0, 0);
    for i in 0..points.len() {
        for s in 0..4 {
            let all: Vec<usize> = scene.of_surface(s).into_iter().filter(|&j| facing(i, j)).collect();
            let seen: Vec<usize> = all.iter().copied().filter(|&j| scene.graph.unblocked(i, j)).collect();
            let sum: f64 = seen.iter().map(|&j| f64::from(operator.factor(i, j))).sum();
            let corners = quads[s as usize].0.map(|c| (c - scene.geometry.centre).as_vec3());
            let whole = form_factor::exact(points.position[i], points.normal[i], &corners);
            // The points of the strip lie across the horizon of some elements: those are not whole.
            if all.len() < 256 || points.surface[i].0 == 4 {
                continue;
            }
            if seen.len() == all.len() {
                open += 1;
                assert!((sum - whole).abs() < 1e-4 * whole.max(0.1), "{i} {s}: {sum} {whole}");
            } else {
                hidden += 1;
                assert!(sum < whole, "{i} {s}: {sum} {whole}");
            }
        }
    }
    assert!(open > 1000 && hidden > 100, "{open} {hidden}");
}

#[test]
fn long_elements_are_as_good_as_square_ones() {
    // Elements 256 times as long as they are wide.
    let quads = room(DVec3::ZERO, DVec3::new(1.0, 256.0, 1.0), [0; 6]);
    let scene = TestScene::new(&quads, vec![diffuse(0.9, 1.0)], 1.0);
    let solution = scene.solve(&FirstPassSettings::default()).unwrap();
    assert!(solution.radiance.iter().all(|&l| (l / 10.0 - 1.0).abs() < 1e-3));
    assert!(solution.stats.closure_error_max < 1e-4, "{:?}", solution.stats);
}

#[test]
fn the_stop_criterion_bounds_the_error_of_the_answer() {
    // Little light comes from the walls' own emission here, nearly all from the lamp over and over.
    let materials = vec![diffuse(0.99, 0.0), diffuse(0.99, 1.0)];
    let scene = TestScene::new(&cube([0, 0, 0, 0, 0, 1]), materials, 1.0 / 64.0);
    let solve = |tolerance| scene.solve(&FirstPassSettings { tolerance, ..Default::default() }).unwrap();
    let (best, default) = (solve(1e-6), scene.solve(&FirstPassSettings::default()).unwrap());
    for (a, b) in default.radiance.iter().zip(&best.radiance) {
        assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
    }
    assert!(default.stats.residual < 1e-4, "{}", default.stats.residual);
}

#[test]
fn the_report_says_what_the_factors_are_wrong_by() {
    let scene = TestScene::new(&cube([0; 6]), vec![diffuse(0.5, 1.0)], 1.0 / 16.0);
    let analytic = scene.solve(&FirstPassSettings::default()).unwrap().stats;
    assert!(analytic.closure_error_mean < 1e-6 && analytic.closure_error_max < 1e-5);
    // From a point to an element is not as from an element to a point; the neighbours are the worst.
    assert!((1e-3..0.1).contains(&analytic.reciprocity_error_mean), "{}", analytic.reciprocity_error_mean);
    assert!((1e-3..0.5).contains(&analytic.reciprocity_error_max), "{}", analytic.reciprocity_error_max);
    let settings = FirstPassSettings { kernel: Kernel::Paper, ..Default::default() };
    let paper = scene.solve(&settings).unwrap().stats;
    // Spectral radius 1.143 at 4 x 4 elements a face.
    assert!((paper.row_sum.mean - 1.14).abs() < 0.02 && paper.closure_error_max > 0.2, "{:?}", paper.row_sum);
    assert!(paper.reciprocity_error_max == 0.0 && paper.near_pairs == 0 && paper.summed_surfaces == 0);
}

/// Error of the plain kernel for a `u` x `v` element at distance `r` whose normal and the receiver's are
/// tilted by these angles from the line between them, relative to the factor were both 0.
fn plain_error(u: f64, v: f64, r: f64, [receiver, element]: [f64; 2]) -> f64 {
    let turned = |angle: f64| Vec3::new(angle.sin() as f32, 0.0, angle.cos() as f32);
    let (n_i, n_j) = (turned(receiver), -turned(element));
    let centre = Vec3::Z * r as f32;
    let (u_axis, v_axis) = (n_j.cross(Vec3::Y) * 0.5 * u as f32, Vec3::Y * 0.5 * v as f32);
    let corners = [
        centre - u_axis - v_axis,
        centre + u_axis - v_axis,
        centre + u_axis + v_axis,
        centre - u_axis + v_axis,
    ];
    let (d_i, d_j) = (n_i.dot(centre), -n_j.dot(centre));
    let plain = form_factor::plain(d_i, d_j, (r * r) as f32, (u * v) as f32);
    (f64::from(plain) - form_factor::exact(Vec3::ZERO, n_i, &corners)) / (u * v / (r * r))
}

#[test]
fn the_threshold_of_the_plain_kernel_is_measured() {
    // The table in the comment on NEAR: per cent, the worst of both ways to turn the element.
    let placements =
        [("parallel", [0.0, 0.0]), ("element tilted", [0.0, 60.0]), ("perpendicular", [45.0, 45.0])];
    let near = f64::from(form_factor::NEAR);
    let mut table = Vec::new();
    for (name, degrees) in placements {
        let tilt = degrees.map(f64::to_radians);
        let mut row = Vec::new();
        for ratio in [1.0, 10.0, 1e4_f64] {
            // Sides with u² + v² = 2, so that extent² is 1.
            let short = (2.0 / (1.0 + ratio * ratio)).sqrt();
            let long = ratio * short;
            let r = near.sqrt().recip();
            let error = |u, v| plain_error(u, v, r, tilt).abs();
            row.push(100.0 * error(long, short).max(error(short, long)));
        }
        // The longest judged by its area, as a square of the same area would be.
        let area: f64 = 2.0 / (1e4 + 1e-4);
        let (long, short, r) = ((area * 1e4).sqrt(), (area * 1e-4).sqrt(), (area / near).sqrt());
        row.push(
            100.0 * plain_error(long, short, r, tilt).abs().max(plain_error(short, long, r, tilt).abs()),
        );
        println!("{name:15} {}", row.iter().map(|e| format!("{e:8.2}")).collect::<String>());
        table.push(row);
    }
    for row in &table {
        assert!(row[..3].iter().all(|&e| e < 1.0), "{row:?}");
        assert!(row[3] > 20.0, "{row:?}");
    }
}

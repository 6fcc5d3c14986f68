//! Do the voxels tile the scene, list what meets them, and walk in order?

use crate::furnished_room;
use glam::DVec3;
use luxgraph::geometry::Ray;
use luxgraph::points::{Sampling, sample};
use luxgraph::scene::Geometry;
use luxgraph::voxels::{VoxelSettings, Voxels, Walk};

fn volume(voxels: &Voxels, v: usize) -> f64 {
    voxels.bounds(v).size().element_product()
}

#[test]
fn voxels_tile_the_room_and_list_what_meets_them() {
    let geometry = furnished_room::geometry(&furnished_room::quads());
    assert_eq!(geometry.surfaces.len(), 134);
    for max_level in [0, 8, 14] {
        let voxels = Voxels::build(&geometry, &VoxelSettings { max_objects: 4, max_level });
        let total: f64 = (0..voxels.len()).map(|v| volume(&voxels, v)).sum();
        let scene = voxels.scene_bounds().size().element_product();
        assert!((total / scene - 1.0).abs() < 1e-12);
        for v in 0..voxels.len() {
            assert_eq!(voxels.locate(voxels.bounds(v).centre()), v);
            let finest = scene / f64::from(1u32 << max_level);
            assert!(voxels.surfaces_of(v).len() <= 4 || volume(&voxels, v) < 1.01 * finest);
        }
        for (s, surface) in geometry.surfaces.iter().enumerate() {
            for i in 0..=16 {
                for j in 0..=16 {
                    let p = surface.point_at(f64::from(i) / 16.0, f64::from(j) / 16.0);
                    let v = voxels.locate(p);
                    assert!(voxels.surfaces_of(v).iter().any(|id| id.index() == s), "{p} of {s} in {v}");
                }
            }
        }
    }
}

#[test]
fn the_default_gives_about_the_voxels_of_the_paper() {
    let geometry = furnished_room::geometry(&furnished_room::quads());
    let voxels = Voxels::build(&geometry, &VoxelSettings::default());
    let points = sample(&geometry, &Sampling::by_area(0.05), &voxels).unwrap();
    let stats = voxels.stats(&points);
    assert!((70..=140).contains(&stats.voxels), "{stats:?}");
    assert!(stats.empty_of_points < stats.voxels / 5, "{stats:?}");
}

#[test]
fn a_walk_follows_the_ray() {
    let geometry = furnished_room::geometry(&furnished_room::quads());
    let voxels = Voxels::build(&geometry, &VoxelSettings { max_objects: 2, max_level: 13 });
    let corners: Vec<DVec3> = geometry.surfaces.iter().flat_map(|s| s.vertices().to_vec()).collect();
    for (n, &origin) in corners.iter().enumerate() {
        let target = corners[(7 * n + 3) % corners.len()] + DVec3::splat(0.01);
        let ray = Ray { origin, direction: target - origin, t_min: 0.0, t_max: 1.0 };
        let walk = Walk::new(&voxels, &ray).expect("begins in the box");
        let end = walk.limits().1;
        let steps: Vec<_> = walk.collect();
        let mut t = 0.0;
        for step in &steps {
            assert!(step.t_exit > t - 1e-12);
            let middle = ray.at(0.5 * (t + step.t_exit.min(end)));
            let b = voxels.bounds(step.voxel);
            assert!((middle - middle.clamp(b.min, b.max)).length() < 1e-9);
            t = step.t_exit;
        }
        assert!(t > end - 1e-12, "the walk ends at {t}, the ray at {end}");
    }
}

#[test]
fn flat_empty_and_single_point_scenes_have_a_box() {
    let flat = vec![[DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y]; 3];
    let point = vec![[DVec3::ONE; 4]];
    let scenes =
        [furnished_room::geometry(&flat), furnished_room::geometry(&point), Geometry::new(vec![], vec![])];
    for geometry in scenes {
        let voxels = Voxels::build(&geometry, &VoxelSettings { max_objects: 0, max_level: 8 });
        assert!(voxels.scene_bounds().size().min_element() > 0.0);
        for p in [DVec3::ZERO, DVec3::MAX, DVec3::MIN, DVec3::INFINITY, DVec3::NAN] {
            assert!(voxels.locate(p) < voxels.len());
        }
    }
}

#[test]
fn memory_is_bounded_whatever_the_settings() {
    // Two thousand large quads through one place: no depth thins them out.
    let quads: Vec<_> = (0..2000)
        .map(|i| {
            let (s, c) = (f64::from(i) * 0.01).sin_cos();
            let (x, y) = (DVec3::new(c, s, 0.0), DVec3::new(-0.3 * s, 0.3 * c, 1.0));
            [-x - y, x - y, x + y, y - x]
        })
        .collect();
    let geometry = furnished_room::geometry(&quads);
    let voxels = Voxels::build(&geometry, &VoxelSettings { max_objects: 0, max_level: u8::MAX });
    let entries: usize = (0..voxels.len()).map(|v| voxels.surfaces_of(v).len()).sum();
    assert!(entries < 1 << 23, "{entries}");
}

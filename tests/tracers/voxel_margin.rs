//! Does a segment between two points of a convex room ever read as blocked? Nothing stands there but
//! the walls the points lie on, and rounding must not make them block.

use crate::furnished_room;
use glam::{DMat3, DVec3};
use luxgraph::points::{Sampling, sample};
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::voxel::VoxelTracer;
use luxgraph::tracers::{RayTracer, Segment};
use luxgraph::voxels::{VoxelSettings, Voxels};

#[test]
fn nothing_blocks_in_an_empty_room_however_it_is_turned() {
    for (angle, size, low) in
        [(0.0, 1.0, -1.4), (0.7, 1.0, -1.4), (2.1, 1e-3, -1.4), (1.3, 1e6, -1.4), (0.4, 1.0, 1.399)]
    {
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), angle);
        // The last is a slit of a millimetre, all angles flat.
        let quads: Vec<_> = furnished_room::walls([-2.5, -2.0, low], [2.5, 2.0, 1.4])
            .iter()
            .map(|q| q.map(|v| size * (turn * v)))
            .collect();
        let geometry = furnished_room::geometry(&quads);
        let voxels = Voxels::build(&geometry, &VoxelSettings::default());
        let points = sample(&geometry, &Sampling::by_area(0.4 * size * size), &voxels).unwrap();
        let (voxel, brute) = (VoxelTracer::new(&geometry), BruteForce::new(&geometry));
        let above = |i: usize, j: usize| {
            geometry.surface(points.surface[i]).distance(points.position[j].as_dvec3())
                > geometry.plane_tolerance()
        };
        let mut pairs = 0;
        for i in 0..points.len() {
            for j in (0..points.len()).filter(|&j| above(i, j) && above(j, i)) {
                let segment = Segment { from: points.position[i], to: points.position[j] };
                pairs += 1;
                assert_eq!(voxel.blocker(&segment), None, "{segment:?}");
                assert_eq!(brute.blocker(&segment), None, "{segment:?}");
            }
        }
        assert!(pairs > 1000);
    }
}

#[test]
fn the_margin_is_a_fraction_whatever_the_segment() {
    for from in [0.0f32, 1.0, 1e30, f32::NAN, f32::INFINITY] {
        for to in [0.0f32, 1.0, 1.0 + f32::EPSILON, f32::NEG_INFINITY] {
            let segment = Segment { from: glam::Vec3::splat(from), to: glam::Vec3::splat(to) };
            assert!((1e-6..=1e-2).contains(&segment.margin()), "{segment:?}: {}", segment.margin());
        }
    }
}

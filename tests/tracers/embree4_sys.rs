//! Do the raw bindings of embree4-sys and our interface give the same hits on the same scene?
#![cfg(feature = "embree4-sys")]
#![allow(unsafe_code)]

use crate::strewn_room::room;
use embree4_sys::*;
use glam::{DVec3, Vec3};
use luxgraph::geometry::Ray;
use luxgraph::scene::Geometry;
use luxgraph::tracers::{EmbreeTracer, RayTracer, Segment};
use std::ptr::null_mut;

/// The crate's headers are of 4.2; from 4.3 on Embree writes one more word behind each hit.
#[repr(C, align(64))]
struct RoomyHit {
    of: RTCRayHit,
    room: [u32; 16],
}

struct RawScene {
    device: RTCDevice,
    scene: RTCScene,
}

impl RawScene {
    fn new(geometry: &Geometry) -> Self {
        // SAFETY: handles are checked where Embree can refuse; the buffers are Embree's own, of the sizes asked for.
        unsafe {
            let device = rtcNewDevice(std::ptr::null());
            assert!(!device.is_null());
            let scene = rtcNewScene(device);
            rtcSetSceneFlags(scene, RTCSceneFlags::ROBUST);
            let mesh = rtcNewGeometry(device, RTCGeometryType::QUAD);
            let count = geometry.surfaces.len();
            let (vertex, index) = (RTCBufferType::VERTEX, RTCBufferType::INDEX);
            let v: *mut f32 =
                rtcSetNewGeometryBuffer(mesh, vertex, 0, RTCFormat::FLOAT3, 12, 4 * count).cast();
            let q: *mut u32 = rtcSetNewGeometryBuffer(mesh, index, 0, RTCFormat::UINT4, 16, count).cast();
            assert!(!v.is_null() && !q.is_null());
            for (i, surface) in geometry.surfaces.iter().enumerate() {
                let corners = surface.vertices();
                for k in 0..4 {
                    let p = corners[k.min(corners.len() - 1)].as_vec3().to_array();
                    v.add(12 * i + 3 * k).copy_from_nonoverlapping(p.as_ptr(), 3);
                    q.add(4 * i + k).write((4 * i + k) as u32);
                }
            }
            rtcSetGeometryMask(mesh, u32::MAX);
            rtcCommitGeometry(mesh);
            rtcAttachGeometry(scene, mesh);
            rtcReleaseGeometry(mesh);
            rtcCommitScene(scene);
            RawScene { device, scene }
        }
    }

    /// The quad met first and where.
    fn closest(&self, from: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<(u32, f32)> {
        // SAFETY: plain data for which all zeros is a value.
        let mut hit: RoomyHit = unsafe { std::mem::zeroed() };
        let ray = &mut hit.of.ray;
        (ray.org_x, ray.org_y, ray.org_z) = from.into();
        (ray.dir_x, ray.dir_y, ray.dir_z) = direction.into();
        (ray.tnear, ray.tfar, ray.mask) = (t_min, t_max, u32::MAX);
        hit.of.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        hit.of.hit.instID = [RTC_INVALID_GEOMETRY_ID];
        // SAFETY: the scene is committed, the ray finite, the hit aligned and with room behind it.
        unsafe { rtcIntersect1(self.scene, &mut hit.of, null_mut()) };
        assert_eq!(hit.room[1..], [0; 15]);
        (hit.of.hit.geomID != RTC_INVALID_GEOMETRY_ID).then_some((hit.of.hit.primID, hit.of.ray.tfar))
    }
}

impl Drop for RawScene {
    fn drop(&mut self) {
        // SAFETY: both came from Embree and are released once.
        unsafe {
            rtcReleaseScene(self.scene);
            rtcReleaseDevice(self.device);
        }
    }
}

#[test]
fn raw_crate_and_interface_return_the_same_hits() {
    let geometry = room(22, 0.4);
    let (raw, ours) = (RawScene::new(&geometry), EmbreeTracer::new(&geometry).unwrap());
    let point =
        |i: u32| Vec3::new((i * 37 % 101) as f32, (i * 53 % 97) as f32, (i * 29 % 89) as f32) * 0.03 - 1.4;
    let mut met = 0;
    for i in 0..5000 {
        let segment = Segment { from: point(i), to: point(3 * i + 31) };
        let (direction, margin) = (segment.to - segment.from, segment.margin());
        let blocker = raw.closest(segment.from, direction, margin, 1.0 - margin).map(|hit| hit.0);
        assert_eq!(ours.blocker(&segment).map(|s| s.0), blocker, "segment {i}");

        let unit = DVec3::from(direction).normalize_or(DVec3::X).as_vec3();
        let ray =
            Ray { origin: segment.from.into(), direction: unit.into(), t_min: 1e-3, t_max: f64::INFINITY };
        let expected = raw.closest(segment.from, ray.direction.normalize().as_vec3(), 1e-3, f32::INFINITY);
        let found = ours.closest(&ray);
        assert_eq!(found.map(|h| h.surface.0), expected.map(|e| e.0), "ray {i}");
        if let (Some(found), Some(expected)) = (found, expected) {
            assert!((found.t - f64::from(expected.1)).abs() < 1e-4, "ray {i}");
            met += 1;
        }
    }
    assert!(met > 4000, "{met} rays met something");
}

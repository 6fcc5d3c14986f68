//! Safe calls over `ffi/embree.h`: an owning scene handle and batches as slices.

use crate::geometry::{Ray, Round};
use glam::DVec3;
use std::ffi::{CStr, c_char, c_void};
use std::ptr::NonNull;

#[allow(dead_code, missing_docs, non_camel_case_types, non_upper_case_globals)]
mod ffi {
    include!(concat!(env!("OUT_DIR"), "/embree.rs"));
}

pub use ffi::{
    LUX_EDGE_ULPS, LUX_GRAZING2, LUX_MISS, lux_hit, lux_hits, lux_packet, lux_query, lux_ray, lux_round,
};

/// Rays in a packet.
pub const LANES: usize = ffi::LUX_PACKET as usize;

/// Rays in Embree's own layout, where Embree wants them.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Packet(pub lux_packet);

/// The same with room for what Embree finds.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Query(pub lux_query);

impl Query {
    /// No ray.
    pub const EMPTY: Query = Query(lux_query {
        rays: EMPTY_PACKET.0,
        normal: [[0.0; LANES]; 3],
        u: [0.0; LANES],
        v: [0.0; LANES],
        primitive: [0; LANES],
        geometry: [0; LANES],
        instance: [0; LANES],
        room: [[0; LANES]; 2],
    });
}

/// Rays that hit nothing, safe to hand over.
pub const EMPTY_PACKET: Packet = Packet(lux_packet {
    origin: [[0.0; LANES]; 3],
    t_min: [0.0; LANES],
    direction: [[1.0; LANES]; 3],
    time: [0.0; LANES],
    t_max: [-1.0; LANES],
    mask: [u32::MAX; LANES],
    limit: [-1.0; LANES],
    flags: [0; LANES],
});

/// The header's limit on coordinates, m: Embree refuses what is larger.
pub const LARGEST: f32 = 1.8e18;

/// A ray that hits nothing and is safe to hand over.
pub const EMPTY_RAY: lux_ray =
    lux_ray { origin: [0.0; 3], t_min: 0.0, direction: [0.0, 0.0, 1.0], t_max: -1.0 };

/// What [`Scene::closest`] gives for a ray that hits nothing.
pub const NO_HIT: lux_hit = lux_hit { t: 0.0, surface: LUX_MISS, part: 0 };

/// The same for the rays of a packet.
pub const NO_HITS: lux_hits = lux_hits { t: [0.0; LANES], surface: [LUX_MISS; LANES], part: [0; LANES] };

/// The version of the loaded library, 10000 major + 100 minor + patch, or `None` if it refuses to start.
pub fn version() -> Option<u32> {
    // SAFETY: takes nothing, and the device it makes is released before it returns.
    let version = unsafe { ffi::lux_version() };
    (version != 0).then_some(version)
}

/// A committed Embree scene.
pub struct Scene {
    handle: NonNull<ffi::lux_scene>,
    /// What the C side calls [`meet`] with, for as long as it lives: boxed, so that it stays where it is.
    _rounds: Box<Rounds>,
}

/// The parts of the surfaces that are no quads, in the order of their numbers.
pub struct Rounds {
    /// At their own size, each with the number of a part.
    pub shapes: Vec<(Round, usize)>,
    /// Lengths in Embree's scene over lengths in ours: a power of two.
    pub scale: f64,
}

/// The header's `lux_meet`.
extern "C" fn meet(rounds: *const c_void, index: u64, ray: *const lux_ray, t: *mut f32) -> u32 {
    // SAFETY: `Scene::new` alone hands this function to the C side, together with a pointer to the `Rounds` that the
    // scene owns and nothing changes; the C side calls it while the scene lives, with the address of a ray and of a
    // float of its own.
    let (rounds, ray, t) = unsafe { (&*rounds.cast::<Rounds>(), &*ray, &mut *t) };
    let place = |v: [f32; 3]| DVec3::from_array(v.map(f64::from)) / rounds.scale;
    let ray = Ray {
        origin: place(ray.origin),
        direction: place(ray.direction),
        t_min: f64::from(ray.t_min),
        t_max: f64::from(ray.t_max),
    };
    match rounds.shapes.get(index as usize).and_then(|(round, part)| round.intersect_part(*part, &ray)) {
        Some(met) => {
            *t = met as f32;
            1
        }
        None => 0,
    }
}

// SAFETY: the handle owns its device and scene alone, and Embree ties neither to the thread that made it.
unsafe impl Send for Scene {}
// SAFETY: nothing changes the scene after `new`, and Embree documents queries on a committed scene as thread safe;
// the C side keeps all state of a query on its stack.
unsafe impl Sync for Scene {}

impl Scene {
    /// Builds a scene of `quads` (indices into `vertices`), whose surfaces are `ids`, and of `rounds`, boxes and
    /// shapes; with `confirm` one that confirms in `f64` that a quad blocks a ray. The error is Embree's message.
    pub fn new(
        vertices: &[[f32; 3]],
        quads: &[[u32; 4]],
        ids: &[u32],
        (rounds, shapes): (&[lux_round], Rounds),
        confirm: bool,
    ) -> Result<Self, String> {
        assert_eq!(quads.len(), ids.len());
        assert_eq!(rounds.len(), shapes.shapes.len());
        let shapes = Box::new(shapes);
        debug_assert!(quads.iter().flatten().all(|&i| (i as usize) < vertices.len()));
        let mut message = [0 as c_char; ffi::LUX_MESSAGE_BYTES as usize];
        // SAFETY: all arrays are valid for the counts given and are only read during the call; `message` has the
        // length the header asks for; `shapes` is kept by the scene, which frees the C side before it.
        let handle = unsafe {
            ffi::lux_scene_new(
                vertices.as_ptr().cast(),
                vertices.len() as u64,
                quads.as_ptr().cast(),
                ids.as_ptr(),
                quads.len() as u64,
                rounds.as_ptr(),
                rounds.len() as u64,
                Some(meet),
                std::ptr::from_ref(&*shapes).cast(),
                confirm.into(),
                message.as_mut_ptr(),
            )
        };
        NonNull::new(handle).map(|handle| Scene { handle, _rounds: shapes }).ok_or_else(|| {
            // SAFETY: the header promises a terminated string in `message`, which outlives this borrow.
            unsafe { CStr::from_ptr(message.as_ptr()) }.to_string_lossy().into_owned()
        })
    }

    /// The closest hit of each ray, in packets of 16 as far as there are so many. Rays that Embree must not see become
    /// empty.
    pub fn closest(&self, rays: &mut [lux_ray], hits: &mut [lux_hit]) {
        let count = rays.len().min(hits.len());
        empty_unsafe(rays);
        // SAFETY: the handle is live until `drop`; both slices hold at least `count` items; every float is within
        // the header's limits after `empty_unsafe`.
        unsafe {
            ffi::lux_closest(self.handle.as_ptr(), rays.as_ptr(), count as u64, hits.as_mut_ptr());
        }
    }

    /// The closest hit of each ray of `packets`, whose rays are then spent, and which must be safe to hand over: every
    /// float within the header's limits.
    pub fn closest_packets(&self, packets: &mut [Query], hits: &mut [lux_hits]) {
        let count = packets.len().min(hits.len());
        debug_assert!(packets.iter().all(|packet| is_safe(&packet.0.rays)));
        // SAFETY: as in `closest`, but that the caller has seen to the floats, without which Embree would stop the process
        // and not corrupt it; a `Query` has the layout and the alignment that the header asks for.
        unsafe {
            ffi::lux_closest_packets(
                self.handle.as_ptr(),
                packets.as_mut_ptr().cast(),
                count as u64,
                hits.as_mut_ptr(),
            );
        }
    }

    /// Whether something blocks each ray, 1 or 0. Rays that Embree must not see become empty.
    pub fn occluded(&self, rays: &mut [lux_ray], blocked: &mut [u8]) {
        let count = rays.len().min(blocked.len());
        empty_unsafe(rays);
        // SAFETY: as in `closest`.
        unsafe {
            ffi::lux_occluded(self.handle.as_ptr(), rays.as_ptr(), count as u64, blocked.as_mut_ptr());
        }
    }

    /// Whether something blocks each ray of a packet, a bit each. Rays that Embree must not see become empty.
    pub fn occluded_packets(&self, packets: &mut [Packet], blocked: &mut [u16]) {
        let count = packets.len().min(blocked.len());
        packets.iter_mut().for_each(empty_unsafe_lanes);
        // SAFETY: as in `closest`; a `Packet` has the layout and the alignment that the header asks for.
        unsafe {
            ffi::lux_occluded_packets(
                self.handle.as_ptr(),
                packets.as_mut_ptr().cast(),
                count as u64,
                blocked.as_mut_ptr(),
            );
        }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the handle came from `lux_scene_new` and is freed here once.
        unsafe { ffi::lux_scene_free(self.handle.as_ptr()) }
    }
}

/// Debian's Embree 3 is built with assertions: one NaN or infinity in a ray would end the process.
fn empty_unsafe(rays: &mut [lux_ray]) {
    for ray in rays {
        let small = |v: [f32; 3]| v.iter().all(|x| x.abs() <= LARGEST);
        let sound = small(ray.origin) & small(ray.direction) & (ray.t_min >= 0.0) & (ray.t_min <= ray.t_max);
        if !sound {
            *ray = EMPTY_RAY;
        }
    }
}

/// Whether Embree may see all rays of a packet.
fn is_safe(rays: &lux_packet) -> bool {
    let [x, y, z] = &rays.origin;
    let [u, v, w] = &rays.direction;
    [x, y, z, u, v, w].into_iter().flatten().all(|x| x.abs() <= LARGEST)
        && (rays.t_min.iter().zip(&rays.t_max)).all(|(from, to)| *from >= 0.0 && !to.is_nan())
}

/// [`empty_unsafe`] for the rays of a packet.
#[inline]
fn empty_unsafe_lanes(Packet(rays): &mut Packet) {
    for i in 0..LANES {
        let small = |column: &[f32; LANES]| column[i].abs() <= LARGEST;
        let [x, y, z] = &rays.origin;
        let [u, v, w] = &rays.direction;
        let sound = small(x) & small(y) & small(z) & small(u) & small(v) & small(w);
        let sound = sound & (rays.t_min[i] >= 0.0) & (rays.t_min[i] <= rays.t_max[i]);
        // Lanes that do not take part are not traversed, but Embree looks at their floats all the same.
        let keep = |column: &mut [f32; LANES], or: f32| column[i] = if sound { column[i] } else { or };
        rays.origin.iter_mut().for_each(|column| keep(column, 0.0));
        rays.direction.iter_mut().for_each(|column| keep(column, 1.0));
        keep(&mut rays.t_min, 0.0);
        keep(&mut rays.t_max, -1.0);
    }
}

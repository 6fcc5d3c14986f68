//! The rays of a crosscheck: random ones, and those that tracers find hard.

use crate::geometry::{Ray, Round, Shape, Surface};
use crate::scene::Geometry;
use crate::tracers::Segment;
use glam::{DVec2, DVec3, Vec3};
use serde::Serialize;

/// Of so many rays the judge is asked about two, a random and a hard one, although the tracers agree: it
/// tests all surfaces.
const SPOT_CHECK: u64 = 64;

/// What makes a ray hard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbeClass {
    /// Between random points of two random surfaces.
    Random,
    /// Through a corner; of what is no polygon through a corner of its parameters.
    Vertex,
    /// Through a point of an edge or a rim, or along a tangent.
    Edge,
    /// Within the plane of a surface, or a plane that touches it.
    InPlane,
    /// Within an axis-aligned plane through a corner, where boxes of hierarchies and voxels end.
    BoxPlane,
    /// Nearly parallel to a surface, and crossing it.
    NearParallel,
}

impl ProbeClass {
    /// All classes.
    pub const ALL: [ProbeClass; 6] = [
        ProbeClass::Random,
        ProbeClass::Vertex,
        ProbeClass::Edge,
        ProbeClass::InPlane,
        ProbeClass::BoxPlane,
        ProbeClass::NearParallel,
    ];
}

/// One ray of the crosscheck.
pub struct Probe {
    /// Its number, which with the seed fixes everything about it.
    pub index: u64,
    pub class: ProbeClass,
    pub segment: Segment,
}

impl Probe {
    /// Ray number `index`: every second one is random, the others take turns.
    pub fn new(geometry: &Geometry, seed: u64, index: u64) -> Self {
        let class = match index % 10 {
            1 => ProbeClass::Vertex,
            3 => ProbeClass::Edge,
            5 => ProbeClass::InPlane,
            7 => ProbeClass::BoxPlane,
            9 => ProbeClass::NearParallel,
            _ => ProbeClass::Random,
        };
        let mut random = Random::new(seed, index);
        let from = random.surface(geometry);
        let a = random.point_on(from);
        let b = match class {
            ProbeClass::Random => random.point_beyond(geometry),
            ProbeClass::Vertex => beyond(a, random.corner(geometry), &mut random),
            ProbeClass::Edge => {
                let through = random.point_on_edge(geometry, a);
                beyond(a, through, &mut random)
            }
            ProbeClass::InPlane => random.point_in_plane(from, a),
            ProbeClass::BoxPlane => return random.in_box_plane(geometry, index),
            ProbeClass::NearParallel => return random.near_parallel(geometry, index),
        };
        Probe { index, class, segment: segment(a, b) }
    }

    /// The ray that the segment lies on, beyond its end too.
    pub fn ray(&self) -> Ray {
        let origin = self.segment.from.as_dvec3();
        let direction = self.segment.to.as_dvec3() - origin;
        Ray { origin, direction, t_min: f64::from(self.segment.margin()), t_max: f64::INFINITY }
    }

    /// Whether the judge looks at this ray in any case.
    pub fn is_spot_check(&self) -> bool {
        matches!(self.index % SPOT_CHECK, 0 | 9)
    }
}

fn segment(a: DVec3, b: DVec3) -> Segment {
    Segment { from: a.as_vec3(), to: b.as_vec3() }
}

/// The point as far beyond `through` as `a` is before it, or less.
fn beyond(a: DVec3, through: DVec3, random: &mut Random) -> DVec3 {
    a + (1.0 + random.unit()) * (through - a)
}

/// A stream of numbers fixed by seed and ray: SplitMix64 (Steele, Lea and Flood, *Fast Splittable
/// Pseudorandom Number Generators*, 2014).
struct Random(u64);

impl Random {
    fn new(seed: u64, index: u64) -> Self {
        let mut random = Random(seed);
        let start = random.bits() ^ index.wrapping_mul(0xD1B5_4A32_D192_ED03);
        let mut random = Random(start);
        random.bits();
        random
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }

    /// In [-1, 1).
    fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Below `count`, which is not 0.
    fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    fn surface<'g>(&mut self, geometry: &'g Geometry) -> &'g Surface {
        &geometry.surfaces[self.below(geometry.surfaces.len())]
    }

    fn point_on(&mut self, surface: &Surface) -> DVec3 {
        let (u, v) = (self.unit(), self.unit());
        match surface.shape {
            Shape::Triangle(_) if u + v > 1.0 => surface.point_at(1.0 - u, 1.0 - v),
            _ => surface.point_at(u, v),
        }
    }

    fn point_beyond(&mut self, geometry: &Geometry) -> DVec3 {
        let to = self.surface(geometry);
        self.point_on(to)
    }

    fn corner(&mut self, geometry: &Geometry) -> DVec3 {
        let surface = self.surface(geometry);
        let vertices = surface.vertices();
        if vertices.is_empty() {
            // Poles and seams, and for a disc its middle and four points of the rim.
            let at = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.5], [0.5, 1.0], [0.0, 0.5], [0.5, 0.0]][self.below(6)];
            return surface.point_at(at[0], at[1]);
        }
        vertices[self.below(vertices.len())]
    }

    /// Where a ray from `a` may just pass an edge.
    fn point_on_edge(&mut self, geometry: &Geometry, a: DVec3) -> DVec3 {
        let surface = self.surface(geometry);
        let vertices = surface.vertices();
        match surface.round() {
            Some(Round::Disc(_)) => return self.point_on_border(surface),
            Some(round @ (Round::Cone(_) | Round::Patch(_))) => {
                let touching = if self.below(2) == 0 { None } else { self.touching_point(round, a) };
                return touching.unwrap_or_else(|| self.point_on_border(surface));
            }
            Some(Round::Sphere(sphere)) => {
                // The circle in which the tangents from `a` touch; from within, any point.
                let (axis, distance) = ((a - sphere.centre).normalize_or_zero(), a.distance(sphere.centre));
                let height = sphere.radius / distance;
                let p = self.point_on(surface);
                let across = (p - sphere.centre).reject_from_normalized(axis).normalize_or_zero();
                let touching = height * axis + (1.0 - height * height).max(0.0).sqrt() * across;
                return if height < 1.0 { sphere.centre + sphere.radius * touching } else { p };
            }
            None => {}
        }
        let k = self.below(vertices.len());
        vertices[k].lerp(vertices[(k + 1) % vertices.len()], self.unit())
    }

    /// A point of a curved surface where a line from `a` touches it, if it is soon found: between two points of which
    /// one faces `a` and one does not.
    fn touching_point(&mut self, round: &Round, a: DVec3) -> Option<DVec3> {
        let at = |uv: DVec2| round.point_at(uv.x, uv.y);
        let faces = |uv: DVec2| round.normal_at(at(uv)).dot(a - at(uv)) > 0.0;
        let mut any = || DVec2::new(self.unit(), self.unit());
        let (mut p, mut q) = (0..8).map(|_| (any(), any())).find(|&(p, q)| faces(p) && !faces(q))?;
        for _ in 0..50 {
            let middle = 0.5 * (p + q);
            *if faces(middle) { &mut p } else { &mut q } = middle;
        }
        Some(at(p))
    }

    /// A point of the edge of the square of (u, v).
    fn point_on_border(&mut self, surface: &Surface) -> DVec3 {
        let side = self.unit();
        [(side, 0.0), (1.0, side), (side, 1.0), (0.0, side)].map(|(u, v)| surface.point_at(u, v))
            [self.below(4)]
    }

    /// A point in the plane of the surface, or in the plane that touches it at its point `a`.
    fn point_in_plane(&mut self, surface: &Surface, a: DVec3) -> DVec3 {
        if let Some(round) = surface.round() {
            let (x, y) = round.normal_at(a).any_orthonormal_pair();
            return a + 3.0 * round.radius() * (self.signed() * x + self.signed() * y);
        }
        let v = surface.vertices();
        v[0] + 3.0 * self.signed() * (v[1] - v[0]) + 3.0 * self.signed() * (v[2] - v[0])
    }

    /// Both ends share one coordinate with a corner of the scene.
    fn in_box_plane(&mut self, geometry: &Geometry, index: u64) -> Probe {
        let axis = self.below(3);
        let plane = self.corner(geometry)[axis] as f32;
        let mut end = || {
            let mut p: Vec3 = self.point_beyond(geometry).as_vec3();
            p[axis] = plane;
            p
        };
        let segment = Segment { from: end(), to: end() };
        Probe { index, class: ProbeClass::BoxPlane, segment }
    }

    /// Crosses a surface at an angle between about 1e-7 and 0.1 radian.
    fn near_parallel(&mut self, geometry: &Geometry, index: u64) -> Probe {
        let surface = self.surface(geometry);
        let through = self.point_on(surface);
        let along = self.point_in_plane(surface, through) - through;
        let lift = along.length() * 10f64.powf(-1.0 - 6.0 * self.unit()) * surface.normal_at(through);
        let segment = segment(through - along - lift, through + along + lift);
        Probe { index, class: ProbeClass::NearParallel, segment }
    }
}

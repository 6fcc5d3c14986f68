//! What a specular point sees, as directions in the frame of its element.

use super::directions::{Direction, Directions, Origin, tile_order};
use super::form_factor::{plane_distances, projected_solid_angle};
use super::openings::openings;
use super::settings::Kernel;
use super::{ideal, lobe};
use crate::points::{NO_POINT, SamplePoints};
use crate::visibility::VisibilityGraph;
use glam::Vec3;
use std::f32::consts::PI;

/// Openings stand this many sides of the specular element away.
const FAR: f32 = 100.0;

/// Elements of a larger depth (they stand near the plane and rise from it) are reached under widely different
/// slopes. They are put in groups of their own, or no group with one of them could be passed over.
const DEEP: f32 = 0.2;

/// A sample point that a specular point sees, or an opening of the scene.
pub struct Member {
    /// The point, or [`NO_POINT`] for an opening.
    pub point: u32,
    /// q of the member as seen from the specular point.
    pub q_in: f32,
    /// q of the specular element as seen from the member; 0 for an opening.
    pub q_out: f32,
    /// Distance, m.
    pub distance: f32,
    /// Where it stands.
    pub direction: Direction,
}

/// The frame of a specular element: x and y along its sides, the same for both sides of a surface, z its
/// normal; and its extent along x and y, m.
pub struct Frame {
    x: Vec3,
    y: Vec3,
    z: Vec3,
    /// As [`Origin::side`].
    pub side: [f32; 2],
}

impl Frame {
    /// Of point `i`.
    pub fn new(points: &SamplePoints, i: usize) -> Self {
        let base = if points.twin[i] == NO_POINT { i } else { i.min(points.twin[i] as usize) };
        let n = points.normal[base];
        let across = sides(&points.corners[base])[0];
        let x = (across - across.dot(n) * n).normalize_or(n.any_orthonormal_vector());
        let width = across.length().max(1e-3 * points.area[i].sqrt());
        Frame { x, y: n.cross(x), z: points.normal[i], side: [width, points.area[i] / width] }
    }

    /// A vector in this frame.
    fn local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }

    /// Point `j` as a direction of point `i`, whose frame this is, without a weight. The two face
    /// each other, and `d_i`, `d_j`, `r2` are their [`plane_distances`].
    pub fn direction(
        &self,
        points: &SamplePoints,
        (i, j): (usize, usize),
        (d_i, d_j, r2): (f32, f32, f32),
    ) -> Direction {
        let distance = r2.sqrt();
        let cosine = d_i / distance;
        let to = self.local((points.position[j] - points.position[i]) / distance).with_z(cosine);
        let omega = (points.area[j] * d_j / (r2 * distance)).min(2.0 * PI);
        let normal = self.local(points.normal[j]);
        let across = sides(&points.corners[j]).map(|side| self.local(side));
        Direction {
            to: to.to_array(),
            weight: 0.0,
            rough: lobe::Extent::new(omega, self.longer_side(points, i) / distance, cosine),
            ideal: ideal::Extent::new(to, d_i, across, normal, d_j / distance),
        }
    }

    /// A place without extent as a direction of point `i`, whose frame this is and which it is in front of; and
    /// its distance, m.
    pub fn place(&self, points: &SamplePoints, i: usize, place: Vec3) -> (Direction, f32) {
        let d = place - points.position[i];
        let distance = d.length();
        let to = self.local(d / distance);
        let direction = Direction {
            to: to.to_array(),
            weight: 1.0,
            rough: lobe::Extent::new(0.0, self.longer_side(points, i) / distance, to.z),
            ideal: ideal::Extent::new(to, distance * to.z, [Vec3::ZERO; 2], -to, 1.0),
        };
        (direction, distance)
    }

    /// The longer of the two mean sides of the element of point `i`, m.
    fn longer_side(&self, points: &SamplePoints, i: usize) -> f32 {
        let [u, v] = sides(&points.corners[i]);
        u.length().max(v.length())
    }
}

/// The two mean sides of an element.
fn sides([a, b, c, d]: &[Vec3; 4]) -> [Vec3; 2] {
    [0.5 * (*b + *c - *a - *d), 0.5 * (*c + *d - *a - *b)]
}

/// All that point `i` sees: first the points that are `linked`, then other points, and openings as members
/// without a point; each kind in the order of directions. Also the number of those that are linked.
pub fn members(
    points: &SamplePoints,
    graph: &VisibilityGraph,
    kernel: Kernel,
    tolerance: f32,
    i: usize,
    linked: impl Fn(u32) -> bool,
) -> (Vec<Member>, usize) {
    let analytic = kernel == Kernel::Analytic;
    let frame = Frame::new(points, i);
    let mut members = Vec::new();
    for j in 0..points.len() {
        let (d_i, d_j, r2) = plane_distances(points, i, j);
        if !(d_i > tolerance && d_j > tolerance && graph.unblocked(i, j)) {
            continue;
        }
        let q_in = projected_solid_angle(points, i, j, analytic);
        let q_out = projected_solid_angle(points, j, i, analytic);
        let mut direction = Direction { weight: q_in, ..frame.direction(points, (i, j), (d_i, d_j, r2)) };
        // What the plain kernel gives over what is used, the mean of both ways.
        let plain = d_i * d_j / (r2 * r2);
        let used = (q_in * q_out / (points.area[i] * points.area[j])).sqrt();
        direction.ideal.tilt = direction.ideal.tilt.map(|t| t * plain / used);
        members.push(Member { point: j as u32, q_in, q_out, distance: r2.sqrt(), direction });
    }
    add_openings(points, i, &frame, &mut members);
    let kind = |m: &Member| (!linked(m.point), m.direction.ideal.depth > DEEP);
    members.sort_by_key(kind);
    let mut before = 0;
    for alike in members.chunk_by_mut(|a, b| kind(a) == kind(b)) {
        tile_order(alike, before, |m| m.direction.to);
        before += alike.len();
    }
    let linked = members.partition_point(|m| linked(m.point));
    (members, linked)
}

/// Adds the openings of the hemisphere of `i`.
fn add_openings(points: &SamplePoints, i: usize, frame: &Frame, members: &mut Vec<Member>) {
    let seen: f32 = members.iter().map(|m| m.q_in).sum();
    let local = |c: Vec3| frame.local(c - points.position[i]);
    let found = openings(seen, members.iter().map(|m| points.corners[m.point as usize].map(local)));
    let far = FAR * frame.side[0].max(frame.side[1]);
    members.extend(found.into_iter().map(|opening| {
        let (to, z) = (opening.to, opening.to.z);
        let omega = opening.weight / z;
        // A square that faces the point.
        let u = to.any_orthonormal_vector() * omega.sqrt() * far;
        Member {
            point: NO_POINT,
            q_in: opening.weight,
            q_out: 0.0,
            distance: 0.0,
            direction: Direction {
                to: to.to_array(),
                weight: opening.weight,
                rough: lobe::Extent::new(omega, 0.0, z),
                ideal: ideal::Extent::new(to, far * z, [u, u.cross(to)], -to, 1.0),
            },
        }
    }));
}

/// Directions inside a medium of index squared `n2` as the directions outside that refract into
/// them; those beyond the critical angle get no weight.
pub fn outside(origin: Origin, directions: &[Direction], n2: f32) -> Directions {
    let n = n2.sqrt();
    let refracted: Vec<Direction> = directions
        .iter()
        .map(|d| {
            let from = Vec3::from(d.to);
            let cosine = (1.0 - n2 * from.truncate().length_squared()).max(0.0).sqrt();
            if cosine == 0.0 {
                return Direction { to: [0.0; 3], weight: 0.0, ..*d };
            }
            let to = (n * from.truncate()).extend(cosine);
            // Towards the critical angle directions spread without end.
            let held = to.with_z(cosine.max(0.1));
            let ideal = d.ideal.refracted(from, held, n);
            Direction {
                to: to.to_array(),
                weight: n2 * d.weight,
                ideal: ideal::Extent { slope: (to / cosine).truncate().to_array(), ..ideal },
                ..*d
            }
        })
        .collect();
    Directions::new(origin, &refracted)
}

//! Surfaces that are no polygons: discs, spheres, the sides of cylinders and cones, bicubic patches; never taken apart
//! into facets.
//!
//! Their parameters (u, v) fill the unit square and, but for patches, keep areas, so that all cells of a level of the
//! quadtree are equally large. Counter-clockwise in (u, v) is counter-clockwise as seen from the front.

mod cone;
mod disc;
pub(crate) mod net;
mod patch;
mod patch_crossings;
mod patch_part;
mod sphere;

pub use cone::Cone;
pub(crate) use cone::Profile;
pub use disc::Disc;
pub use patch::Patch;
pub(crate) use patch_crossings::turns_one_way;
pub use sphere::Sphere;

use super::{Aabb, Ray, Side};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// A surface that is no polygon.
#[derive(Clone, Debug, PartialEq)]
pub enum Round {
    /// A disc.
    Disc(Disc),
    /// A sphere.
    Sphere(Sphere),
    /// The side of a cylinder or a cone.
    Cone(Cone),
    /// A bicubic patch.
    Patch(Arc<Patch>),
}

impl From<Patch> for Round {
    fn from(patch: Patch) -> Round {
        Round::Patch(Arc::new(patch))
    }
}

impl From<Disc> for Round {
    fn from(disc: Disc) -> Round {
        Round::Disc(disc)
    }
}

impl From<Sphere> for Round {
    fn from(sphere: Sphere) -> Round {
        Round::Sphere(sphere)
    }
}

impl From<Cone> for Round {
    fn from(cone: Cone) -> Round {
        Round::Cone(cone)
    }
}

/// From -1..1 each way to 0..1, whatever rounding did.
fn unit_square(at: DVec2) -> DVec2 {
    (0.5 * (at + 1.0)).clamp(DVec2::ZERO, DVec2::ONE)
}

impl Round {
    /// The fewest divisions: fewer make no elements worth the name.
    pub fn least_level(&self) -> u8 {
        match self {
            Round::Disc(_) | Round::Sphere(_) | Round::Patch(_) => 2,
            Round::Cone(_) => 3,
        }
    }

    /// The point at `(u, v)`, m.
    pub fn point_at(&self, u: f64, v: f64) -> DVec3 {
        match self {
            Round::Disc(disc) => disc.point_at(u, v),
            Round::Sphere(sphere) => sphere.point_at(u, v),
            Round::Cone(cone) => cone.point_at(u, v),
            Round::Patch(patch) => patch.point_at(u, v),
        }
    }

    /// The parameters of the point of the surface nearest to `p`, in the unit square.
    pub fn uv_of(&self, p: DVec3) -> DVec2 {
        match self {
            Round::Disc(disc) => disc.uv_of(p),
            Round::Sphere(sphere) => sphere.uv_of(p),
            Round::Cone(cone) => cone.uv_of(p),
            Round::Patch(patch) => patch.uv_of(p),
        }
    }

    /// Unit normal, on the front, at the point of the surface nearest to `p`.
    pub fn normal_at(&self, p: DVec3) -> DVec3 {
        match self {
            Round::Disc(disc) => disc.normal,
            Round::Sphere(sphere) => sphere.turn() * (p - sphere.centre).normalize_or(DVec3::Z),
            Round::Cone(cone) => cone.turn() * cone.outwards(p),
            Round::Patch(patch) => patch.normal(patch.uv_of(p)),
        }
    }

    /// Unit normal, on the front, at `(u, v)`.
    pub fn normal_of(&self, uv: DVec2) -> DVec3 {
        match self {
            Round::Patch(patch) => patch.normal(uv),
            _ => self.normal_at(self.point_at(uv.x, uv.y)),
        }
    }

    /// Signed distance of `p` from the plane, the sphere, or the endless cone or cylinder, positive in front, m.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Round::Disc(disc) => disc.normal.dot(p - disc.centre),
            Round::Sphere(sphere) => sphere.turn() * (p.distance(sphere.centre) - sphere.radius),
            Round::Cone(cone) => cone.turn() * cone.outside(p),
            Round::Patch(patch) => {
                let at = patch.uv_of(p);
                let way = p - patch.point_at(at.x, at.y);
                way.length().copysign(patch.normal(at).dot(way))
            }
        }
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        match self {
            Round::Disc(disc) => PI * disc.radius * disc.radius,
            Round::Sphere(sphere) => 4.0 * PI * sphere.radius * sphere.radius,
            Round::Cone(cone) => cone.area(),
            Round::Patch(patch) => patch.area(),
        }
    }

    /// Area of the square of (u, v) from `low` on, m².
    pub fn cell_area(&self, low: DVec2, size: f64) -> f64 {
        match self {
            Round::Patch(patch) => patch.cell_area(low, size),
            _ => self.area() * (size * size),
        }
    }

    /// Area per unit of (u, v) at a place, m²; the same everywhere but on a patch.
    pub fn stretch(&self, uv: DVec2) -> f64 {
        match self {
            Round::Patch(patch) => patch.stretch(uv),
            _ => self.area(),
        }
    }

    /// Whether it lies in a plane.
    pub fn is_planar(&self) -> bool {
        matches!(self, Round::Disc(_))
    }

    /// The middle of a ball around it, m; of a disc or a sphere its own.
    pub fn centre(&self) -> DVec3 {
        match self {
            Round::Disc(disc) => disc.centre,
            Round::Sphere(sphere) => sphere.centre,
            Round::Cone(cone) => 0.5 * (cone.base + cone.top),
            Round::Patch(patch) => patch.bounds().centre(),
        }
    }

    /// The radius of that ball, m; of a disc or a sphere its own.
    pub fn radius(&self) -> f64 {
        match self {
            Round::Disc(disc) => disc.radius,
            Round::Sphere(sphere) => sphere.radius,
            Round::Cone(cone) => cone.widest().hypot(0.5 * cone.height()),
            Round::Patch(patch) => 0.5 * patch.bounds().size().length(),
        }
    }

    /// How large it is where it is smallest, m: the radius, or what it is long.
    pub fn least_size(&self) -> f64 {
        match self {
            Round::Disc(disc) => disc.radius,
            Round::Sphere(sphere) => sphere.radius,
            Round::Cone(cone) => cone.widest().min(cone.height()),
            Round::Patch(patch) => patch.lengths().min_element(),
        }
    }

    /// Mean lengths along u and v, m: cells are about as wide and as high as these, divided.
    pub fn lengths(&self) -> DVec2 {
        match self {
            Round::Disc(_) | Round::Sphere(_) => DVec2::splat(self.area().sqrt()),
            Round::Cone(cone) => DVec2::new(PI * (cone.radius + cone.top_radius), cone.slant()),
            Round::Patch(patch) => patch.lengths(),
        }
    }

    /// The smallest box around it; a little more than that around a patch.
    pub fn bounds(&self) -> Aabb {
        match self {
            Round::Disc(disc) => disc.bounds(),
            Round::Sphere(Sphere { centre, radius, .. }) => {
                Aabb { min: *centre - *radius, max: *centre + *radius }
            }
            Round::Cone(cone) => cone.bounds(),
            Round::Patch(patch) => patch.bounds(),
        }
    }

    /// The first crossing within the ray's limits.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<f64> {
        let crossings = match self {
            Round::Disc(disc) => disc.crossings(ray),
            Round::Sphere(sphere) => sphere.crossings(ray),
            Round::Cone(cone) => cone.crossings(ray),
            Round::Patch(patch) => return patch.intersect(ray),
        };
        crossings.into_iter().find(|&t| t > ray.t_min && t < ray.t_max)
    }

    /// How many parts rays are asked of one by one: a patch is cut into many, all else is one.
    pub fn parts(&self) -> usize {
        match self {
            Round::Patch(patch) => patch.parts().len(),
            _ => 1,
        }
    }

    /// The smallest box around part number `part`; a little more than that of a patch.
    pub fn part_bounds(&self, part: usize) -> Aabb {
        match self {
            Round::Patch(patch) => patch.parts()[part].bounds,
            _ => self.bounds(),
        }
    }

    /// The first crossing of part number `part` within the ray's limits. What is met first of all the parts is what
    /// [`Round::intersect`] finds.
    #[inline]
    pub fn intersect_part(&self, part: usize, ray: &Ray) -> Option<f64> {
        match self {
            Round::Patch(patch) => patch.intersect_part(part, ray),
            _ => self.intersect(ray),
        }
    }

    /// Whether `side` is the outside of a convex surface: it hides nothing from points of that side that face it.
    pub fn looks_out(&self, side: Side) -> bool {
        match self {
            Round::Disc(_) | Round::Patch(_) => false,
            Round::Sphere(Sphere { inward, .. }) | Round::Cone(Cone { inward, .. }) => {
                *inward == (side == Side::Back)
            }
        }
    }

    /// Whether `p` lies in the convex body that the surface bounds, the ball of a sphere or an endless cone or
    /// cylinder: the surface hides nothing in it from anything else in it.
    pub fn encloses(&self, p: DVec3) -> bool {
        match self {
            Round::Disc(_) | Round::Patch(_) => false,
            Round::Sphere(sphere) => p.distance(sphere.centre) <= sphere.radius,
            Round::Cone(cone) => cone.outside(p) <= 0.0,
        }
    }

    /// Whether all of a box lies in that body.
    pub fn encloses_box(&self, bounds: &Aabb) -> bool {
        !self.is_planar()
            && (0..8).all(|k| {
                let at = |axis: usize| if k >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
                self.encloses(DVec3::new(at(0), at(1), at(2)))
            })
    }

    /// The same surface moved by `local`, its radii as the lattice holds them.
    pub fn placed(&self, local: impl Fn(DVec3) -> DVec3) -> Round {
        let stored = |radius: f64| f64::from(radius as f32);
        match *self {
            Round::Patch(ref patch) => Patch::new(patch.net().map(|row| row.map(&local))).into(),
            Round::Disc(Disc { centre, normal, radius }) => {
                Round::Disc(Disc { centre: local(centre), normal, radius: stored(radius) })
            }
            Round::Sphere(Sphere { centre, radius, inward }) => {
                Round::Sphere(Sphere { centre: local(centre), radius: stored(radius), inward })
            }
            Round::Cone(Cone { base, top, radius, top_radius, inward }) => Round::Cone(Cone {
                base: local(base),
                top: local(top),
                radius: stored(radius),
                top_radius: stored(top_radius),
                inward,
            }),
        }
    }

    /// The same surface turned by `rotation` about the origin and then moved by `offset`, m.
    pub fn moved(&self, rotation: DMat3, offset: DVec3) -> Round {
        let place = |p: DVec3| rotation * p + offset;
        match *self {
            Round::Patch(ref patch) => Patch::new(patch.net().map(|row| row.map(place))).into(),
            Round::Disc(Disc { centre, normal, radius }) => {
                Round::Disc(Disc { centre: place(centre), normal: (rotation * normal).normalize(), radius })
            }
            Round::Sphere(sphere) => Round::Sphere(Sphere { centre: place(sphere.centre), ..sphere }),
            Round::Cone(cone) => Round::Cone(Cone { base: place(cone.base), top: place(cone.top), ..cone }),
        }
    }

    /// All that tells it from others, for a hash.
    pub fn bytes(&self) -> Vec<u8> {
        let (kind, places, radii) = match self {
            Round::Disc(disc) => (0xd0, vec![disc.centre, disc.normal], vec![disc.radius]),
            Round::Sphere(sphere) => {
                (0xe0 + u8::from(sphere.inward), vec![sphere.centre, DVec3::ZERO], vec![sphere.radius])
            }
            Round::Cone(cone) => {
                (0xc0 + u8::from(cone.inward), vec![cone.base, cone.top], vec![cone.radius, cone.top_radius])
            }
            Round::Patch(patch) => (0xb0, patch.net().concat(), Vec::new()),
        };
        let numbers = places.into_iter().flat_map(|v| v.to_array()).chain(radii);
        std::iter::once(kind).chain(numbers.flat_map(f64::to_le_bytes)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> [Round; 7] {
        let centre = DVec3::new(0.3, -1.2, 2.0);
        let normal = DVec3::new(1.0, -2.0, 0.7).normalize();
        [
            Round::Disc(Disc { centre, normal, radius: 1.7 }),
            Round::Sphere(Sphere { centre, radius: 1.7, inward: false }),
            Round::Sphere(Sphere { centre, radius: 1.7, inward: true }),
            cone(centre, 0.7, 0.7, false),
            cone(centre, 0.7, 0.2, true),
            cone(centre, 0.9, 0.0, false),
            cone(centre, 0.0, 0.5, true),
        ]
    }

    fn cone(middle: DVec3, radius: f64, top_radius: f64, inward: bool) -> Round {
        let half = DVec3::new(0.3, -0.4, 0.5);
        Round::Cone(Cone { base: middle - half, top: middle + half, radius, top_radius, inward })
    }

    #[test]
    fn parameters_invert_and_lie_on_the_surface() {
        for round in shapes() {
            for i in 0..=64 {
                for j in 0..=64 {
                    let (u, v) = (f64::from(i) / 64.0, f64::from(j) / 64.0);
                    let p = round.point_at(u, v);
                    assert!(round.distance(p).abs() < 1e-14 && p.distance(round.centre()) < 1.7 + 1e-14);
                    let back = round.uv_of(p);
                    assert!(round.point_at(back.x, back.y).distance(p) < 1e-14, "{round:?} {u} {v}: {back}");
                    let border = [0, 64].contains(&i) || [0, 64].contains(&j);
                    assert!(border || back.distance(DVec2::new(u, v)) < 1e-12, "{round:?} {u} {v}: {back}");
                }
            }
        }
    }

    #[test]
    fn cells_have_equal_areas_and_turn_the_right_way() {
        for round in shapes() {
            // 16 x 16 cells, each by 32 x 32 flat pieces.
            const FINE: u32 = 512;
            let at = |i: u32, j: u32| {
                round.point_at(f64::from(i) / f64::from(FINE), f64::from(j) / f64::from(FINE))
            };
            let mut cells = vec![0.0; 256];
            for i in 0..FINE {
                for j in 0..FINE {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    let cross = 0.5 * (c - a).cross(d - b);
                    assert!(cross.dot(round.normal_at(0.25 * (a + b + c + d))) > 0.0, "{round:?} {i} {j}");
                    cells[(i / 32 * 16 + j / 32) as usize] += cross.length();
                }
            }
            for area in cells {
                assert!((256.0 * area / round.area() - 1.0).abs() < 2e-4, "{round:?}: {area}");
            }
        }
    }

    #[test]
    fn the_border_of_the_octahedral_square_folds() {
        for round in &shapes()[1..3] {
            for k in 0..=32 {
                let s = f64::from(k) / 32.0;
                for end in [0.0, 1.0] {
                    assert!(round.point_at(s, end).distance(round.point_at(1.0 - s, end)) < 1e-14);
                    assert!(round.point_at(end, s).distance(round.point_at(end, 1.0 - s)) < 1e-14);
                }
            }
        }
    }

    #[test]
    fn tangents_and_near_misses_keep_their_digits() {
        let sphere = Round::Sphere(Sphere { centre: DVec3::ZERO, radius: 1.0, inward: false });
        for far in [2.0, 1e3, 1e6] {
            for miss in [-1e-6, -1e-9, 1e-9, 1e-6] {
                let origin = DVec3::new(-far, 1.0 + miss, 0.0);
                let ray = Ray { origin, direction: 3.0 * DVec3::X, t_min: 0.0, t_max: f64::INFINITY };
                let half = (-miss * (2.0 + miss)).max(0.0).sqrt();
                match sphere.intersect(&ray) {
                    Some(t) => {
                        assert!(miss < 0.0 && (3.0 * t - (far - half)).abs() < 1e-9 * far, "{far} {miss}")
                    }
                    None => assert!(miss > 0.0, "{far} {miss}"),
                }
            }
        }
        // Leaving from just inside and just outside: the far side, and nothing.
        let out = |y: f64| Ray { origin: y * DVec3::Y, direction: DVec3::NEG_Y, t_min: 1e-6, t_max: 9.0 };
        assert!((sphere.intersect(&out(1.0 - 1e-12)).unwrap() - 2.0).abs() < 1e-11);
        assert!((sphere.intersect(&out(1.0 + 1e-12)).unwrap() - 2.0).abs() < 1e-11);
    }

    #[test]
    fn boxes_are_exact() {
        for round in shapes() {
            let bounds = round.bounds();
            let mut found = Aabb::EMPTY;
            for i in 0..=400 {
                for j in 0..=400 {
                    let p = round.point_at(f64::from(i) / 400.0, f64::from(j) / 400.0);
                    assert!(p.cmpge(bounds.min - 1e-14).all() && p.cmple(bounds.max + 1e-14).all());
                    found = found.union(Aabb { min: p, max: p });
                }
            }
            assert!(found.min.distance(bounds.min) < 1e-3 && found.max.distance(bounds.max) < 1e-3);
        }
    }
}

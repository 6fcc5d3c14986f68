//! Surfaces that are no polygons: discs and spheres, never taken apart into facets.
//!
//! Their parameters (u, v) fill the unit square and keep areas, so that all cells of a level of the quadtree
//! are equally large: a disc by the concentric map (P. Shirley and K. Chiu, *A Low Distortion Map Between Disk
//! and Square*, 1997), a sphere by the octahedral map (P. Clarberg, *Fast Equal-Area Mapping of the
//! (Hemi)Sphere Using SIMD*, 2008), whose square folds onto itself along its border. Counter-clockwise in
//! (u, v) is counter-clockwise as seen from the front.

use super::{Aabb, Ray, Side};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// A flat disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Middle, m.
    pub centre: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Radius, m.
    pub radius: f64,
}

/// A whole sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Middle, m.
    pub centre: DVec3,
    /// Radius, m.
    pub radius: f64,
    /// Whether the front is the inside.
    pub inward: bool,
}

/// A surface that is no polygon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Round {
    /// A disc.
    Disc(Disc),
    /// A sphere.
    Sphere(Sphere),
}

/// A disc's place may stray from its plane by so much, as a share of the largest coordinate: rounding of a ray that
/// runs along the plane makes more, and proves nothing.
const IN_PLANE: f64 = 1e-7;

impl Disc {
    /// Two unit directions that make a right-handed frame with the normal.
    pub fn axes(&self) -> (DVec3, DVec3) {
        let x = self.normal.any_orthonormal_vector();
        (x, self.normal.cross(x))
    }

    fn point_at(&self, u: f64, v: f64) -> DVec3 {
        let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let (r, angle) = if a.abs() > b.abs() {
            (a, FRAC_PI_4 * b / a)
        } else if b != 0.0 {
            (b, FRAC_PI_2 - FRAC_PI_4 * a / b)
        } else {
            (0.0, 0.0)
        };
        let (x, y) = self.axes();
        let (sin, cos) = angle.sin_cos();
        self.centre + self.radius * r * (cos * x + sin * y)
    }

    fn uv_of(&self, p: DVec3) -> DVec2 {
        let (x, y) = self.axes();
        let d = (p - self.centre) / self.radius;
        let (x, y) = (x.dot(d), y.dot(d));
        let r = x.hypot(y).min(1.0);
        let at = if r == 0.0 || !r.is_finite() {
            DVec2::ZERO
        } else if x.abs() > y.abs() {
            let a = r.copysign(x);
            DVec2::new(a, a * (y / x).atan() / FRAC_PI_4)
        } else {
            let b = r.copysign(y);
            DVec2::new(b * (x / y).atan() / FRAC_PI_4, b)
        };
        unit_square(at)
    }

    fn bounds(&self) -> Aabb {
        let reach = (DVec3::ONE - self.normal * self.normal).max(DVec3::ZERO).map(f64::sqrt) * self.radius;
        Aabb { min: self.centre - reach, max: self.centre + reach }
    }

    fn crossings(&self, ray: &Ray) -> [f64; 2] {
        let t = self.normal.dot(self.centre - ray.origin) / self.normal.dot(ray.direction);
        let d = ray.at(t) - self.centre;
        let scale = ray.origin.abs().max(self.centre.abs()).max_element() + self.radius;
        let inside = d.length_squared() <= self.radius * self.radius;
        let flat = self.normal.dot(d).abs() <= IN_PLANE * scale;
        [if inside && flat { t } else { f64::NAN }, f64::NAN]
    }
}

impl Sphere {
    fn point_at(&self, u: f64, v: f64) -> DVec3 {
        let (a, b) = (self.turn() * (2.0 * u - 1.0), 2.0 * v - 1.0);
        let d = 1.0 - a.abs() - b.abs();
        let r = 1.0 - d.abs();
        let angle = if r > 0.0 { FRAC_PI_4 * ((b.abs() - a.abs()) / r + 1.0) } else { 0.0 };
        let flat = r * (2.0 - r * r).max(0.0).sqrt();
        let (sin, cos) = angle.sin_cos();
        let z = (1.0 - r * r).copysign(d);
        let direction = DVec3::new((flat * cos).copysign(a), (flat * sin).copysign(b), z);
        self.centre + self.radius * direction
    }

    fn uv_of(&self, p: DVec3) -> DVec2 {
        let d = (p - self.centre).normalize_or(DVec3::Z);
        let (x, y, z) = (d.x.abs(), d.y.abs(), d.z.abs());
        // sqrt(1 - z) that keeps its digits near the poles.
        let r = ((x * x + y * y) / (1.0 + z)).sqrt();
        let b = r * y.atan2(x) / FRAC_PI_2;
        let a = r - b;
        let (a, b) = if d.z < 0.0 { (1.0 - b, 1.0 - a) } else { (a, b) };
        unit_square(DVec2::new(self.turn() * a.copysign(d.x), b.copysign(d.y)))
    }

    /// Seen from within, left and right change places.
    fn turn(&self) -> f64 {
        if self.inward { -1.0 } else { 1.0 }
    }

    /// Both roots, by a form that neither loses the digits of a small discriminant nor of a near root (E. Haines,
    /// J. Günther and T. Akenine-Möller, *Precision Improvements for Ray/Sphere Intersection*, Ray Tracing Gems, 2019).
    fn crossings(&self, ray: &Ray) -> [f64; 2] {
        let (from, d) = (ray.origin - self.centre, ray.direction);
        let (a, b) = (d.length_squared(), -from.dot(d));
        let nearest = from + (b / a) * d;
        let below = self.radius * self.radius - nearest.length_squared();
        if below.is_nan() || below < 0.0 {
            return [f64::NAN; 2];
        }
        let distance = from.length();
        let c = (distance - self.radius) * (distance + self.radius);
        let q = b + (a * below).sqrt().copysign(b);
        let (s, t) = (c / q, q / a);
        if s < t { [s, t] } else { [t, s] }
    }
}

/// From -1..1 each way to 0..1, whatever rounding did.
fn unit_square(at: DVec2) -> DVec2 {
    (0.5 * (at + 1.0)).clamp(DVec2::ZERO, DVec2::ONE)
}

impl Round {
    /// The fewest divisions: fewer make no elements worth the name.
    pub const LEAST_LEVEL: u8 = 2;

    /// The point at `(u, v)`, m.
    pub fn point_at(&self, u: f64, v: f64) -> DVec3 {
        match self {
            Round::Disc(disc) => disc.point_at(u, v),
            Round::Sphere(sphere) => sphere.point_at(u, v),
        }
    }

    /// The parameters of the point of the surface nearest to `p`, in the unit square.
    pub fn uv_of(&self, p: DVec3) -> DVec2 {
        match self {
            Round::Disc(disc) => disc.uv_of(p),
            Round::Sphere(sphere) => sphere.uv_of(p),
        }
    }

    /// Unit normal, on the front, at the point of the surface nearest to `p`.
    pub fn normal_at(&self, p: DVec3) -> DVec3 {
        match self {
            Round::Disc(disc) => disc.normal,
            Round::Sphere(sphere) => sphere.turn() * (p - sphere.centre).normalize_or(DVec3::Z),
        }
    }

    /// Signed distance of `p` from the plane or the sphere, positive in front, m.
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Round::Disc(disc) => disc.normal.dot(p - disc.centre),
            Round::Sphere(sphere) => sphere.turn() * (p.distance(sphere.centre) - sphere.radius),
        }
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        match self {
            Round::Disc(disc) => PI * disc.radius * disc.radius,
            Round::Sphere(sphere) => 4.0 * PI * sphere.radius * sphere.radius,
        }
    }

    /// The middle, m.
    pub fn centre(&self) -> DVec3 {
        match self {
            Round::Disc(disc) => disc.centre,
            Round::Sphere(sphere) => sphere.centre,
        }
    }

    /// The radius, m.
    pub fn radius(&self) -> f64 {
        match self {
            Round::Disc(disc) => disc.radius,
            Round::Sphere(sphere) => sphere.radius,
        }
    }

    /// The smallest box around it.
    pub fn bounds(&self) -> Aabb {
        match self {
            Round::Disc(disc) => disc.bounds(),
            Round::Sphere(Sphere { centre, radius, .. }) => {
                Aabb { min: *centre - *radius, max: *centre + *radius }
            }
        }
    }

    /// The ray parameters at which the line of `ray` crosses the surface, the first one first; NaN for those that
    /// there are not.
    pub fn crossings(&self, ray: &Ray) -> [f64; 2] {
        match self {
            Round::Disc(disc) => disc.crossings(ray),
            Round::Sphere(sphere) => sphere.crossings(ray),
        }
    }

    /// The first crossing within the ray's limits.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<f64> {
        self.crossings(ray).into_iter().find(|&t| t > ray.t_min && t < ray.t_max)
    }

    /// Whether `side` looks out of a sphere.
    pub fn looks_out(&self, side: Side) -> bool {
        matches!(self, Round::Sphere(sphere) if sphere.inward == (side == Side::Back))
    }

    /// Whether `p` lies in the ball of a sphere, which is convex: the sphere hides nothing in it from anything else in it.
    pub fn encloses(&self, p: DVec3) -> bool {
        matches!(self, Round::Sphere(sphere) if p.distance(sphere.centre) <= sphere.radius)
    }

    /// Whether all of a box lies in the ball of a sphere.
    pub fn encloses_box(&self, bounds: &Aabb) -> bool {
        let away = (bounds.min - self.centre()).abs().max((bounds.max - self.centre()).abs());
        matches!(self, Round::Sphere(sphere) if away.length() <= sphere.radius)
    }

    /// The same surface moved by `local`, its radius as the lattice holds it.
    pub fn placed(&self, local: impl Fn(DVec3) -> DVec3) -> Round {
        let stored = |radius: f64| f64::from(radius as f32);
        match *self {
            Round::Disc(Disc { centre, normal, radius }) => {
                Round::Disc(Disc { centre: local(centre), normal, radius: stored(radius) })
            }
            Round::Sphere(Sphere { centre, radius, inward }) => {
                Round::Sphere(Sphere { centre: local(centre), radius: stored(radius), inward })
            }
        }
    }

    /// All that tells it from others, for a hash.
    pub fn bytes(&self) -> Vec<u8> {
        let (kind, normal) = match self {
            Round::Disc(disc) => (0xd0, disc.normal),
            Round::Sphere(sphere) => (0xe0 + u8::from(sphere.inward), DVec3::ZERO),
        };
        let numbers = [self.centre(), normal].into_iter().flat_map(|v| v.to_array());
        let numbers = numbers.chain([self.radius()]);
        std::iter::once(kind).chain(numbers.flat_map(f64::to_le_bytes)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> [Round; 3] {
        let centre = DVec3::new(0.3, -1.2, 2.0);
        let normal = DVec3::new(1.0, -2.0, 0.7).normalize();
        [
            Round::Disc(Disc { centre, normal, radius: 1.7 }),
            Round::Sphere(Sphere { centre, radius: 1.7, inward: false }),
            Round::Sphere(Sphere { centre, radius: 1.7, inward: true }),
        ]
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
        for round in &shapes()[1..] {
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

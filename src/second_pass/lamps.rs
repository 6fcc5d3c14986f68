//! What gives light, and how a place asks it: the light comes straight from an emitting surface, drawn by the solid angle
//! that it subtends, or from a light without a body. The path tracer that judges this pass draws its lights by code of
//! its own.

use crate::geometry::{Round, Side, SurfaceId};
use crate::scene::{Geometry, SampledAppearance};
use glam::DVec3;

/// Of more lamps than these one is drawn by its strength alone: what may be expected of each at every place would cost
/// too much.
const FEW: usize = 256;

/// Below this a triangle is drawn by area: its cosines and distances are all but the same, sr.
const SMALL: f64 = 1e-3;

/// Everything that emits.
pub(super) struct Lamps {
    lamps: Vec<Lamp>,
    /// Of the strengths of more than [`FEW`], sums up to each.
    strengths: Vec<f64>,
    /// The lamp on the front and on the back of each surface, or [`NO_LAMP`].
    on: Vec<[u32; 2]>,
}

/// Nothing emits there.
const NO_LAMP: u32 = u32::MAX;

struct Lamp {
    body: Body,
    /// Unit normal on the emitting side at the middle; zero for what emits all around.
    normal: DVec3,
    middle: DVec3,
    /// How bright it is from afar and from the front, at 1 m, or wherever a directional light falls.
    strength: f64,
    /// Radius of a ball around it, m.
    reach: f64,
    source: Source,
}

enum Body {
    /// One or two triangles.
    Flat([[DVec3; 3]; 2], usize),
    Round(Round, Side),
    /// None: the light of this number.
    Light(usize),
}

/// Whose light it is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    /// That of an emitting surface.
    Surface(SurfaceId),
    /// That of the light of this number.
    Light(usize),
}

/// Light that would come from a place on a lamp, were nothing in between.
pub(super) struct Ask {
    /// The place, m.
    pub to: DVec3,
    /// Towards it, unit.
    pub direction: DVec3,
    /// Whose light.
    pub source: Source,
    /// Irradiance of a plane that faces it per radiance of the surface, or per amount of the light.
    pub share: f64,
    /// Directions were drawn there about so densely, 1/sr: [`Lamps::density`]; infinite for a light without a body.
    pub density: f64,
}

impl Lamps {
    /// Of a scene.
    pub fn new(geometry: &Geometry, appearance: &SampledAppearance, bright: impl Fn(&[f32]) -> f64) -> Self {
        let mut lamps = Vec::new();
        let mut on = vec![[NO_LAMP; 2]; geometry.surfaces.len()];
        for (s, surface) in geometry.surfaces.iter().enumerate() {
            let id = SurfaceId(s as u32);
            let strength = bright(&appearance.of(id).emission) * surface.area;
            if strength <= 0.0 {
                continue;
            }
            let sides = if geometry.two_sided[s] { &[Side::Front, Side::Back][..] } else { &[Side::Front] };
            for &side in sides {
                let body = match surface.round() {
                    Some(round) => Body::Round(round.clone(), side),
                    None => {
                        let (mut triangles, count) = surface.triangles();
                        if side == Side::Back {
                            triangles.iter_mut().for_each(|t| t.swap(1, 2));
                        }
                        Body::Flat(triangles, count)
                    }
                };
                let front = surface.plane().map_or(DVec3::ZERO, |plane| plane.normal);
                let bounds = surface.bounds();
                on[s][side as usize] = lamps.len() as u32;
                lamps.push(Lamp {
                    body,
                    normal: if side == Side::Front { front } else { -front },
                    middle: bounds.centre(),
                    strength,
                    reach: 0.5 * bounds.size().length(),
                    source: Source::Surface(id),
                });
            }
        }
        for (k, (light, amount)) in geometry.lights.iter().zip(&appearance.lights).enumerate() {
            let strength = bright(amount);
            if strength > 0.0 {
                lamps.push(Lamp {
                    body: Body::Light(k),
                    normal: DVec3::ZERO,
                    middle: light.place(),
                    strength,
                    reach: 0.0,
                    source: Source::Light(k),
                });
            }
        }
        Lamps::of(lamps, on)
    }

    /// Of these, which stand `on` surfaces as it says.
    fn of(lamps: Vec<Lamp>, on: Vec<[u32; 2]>) -> Self {
        let strengths =
            if lamps.len() > FEW { sums(lamps.iter().map(|lamp| lamp.strength)) } else { Vec::new() };
        Lamps { lamps, strengths, on }
    }

    /// Whether nothing emits.
    pub fn is_empty(&self) -> bool {
        self.lamps.is_empty()
    }

    /// Asks one lamp for its light at `x` on a surface with unit normal `n`, or, where that is `None`, on one of any
    /// normal, for three uniform numbers in [0, 1). `None` where none can come from there. `chances` is room to work in.
    pub fn ask(
        &self,
        geometry: &Geometry,
        (x, n): (DVec3, Option<DVec3>),
        u: [f64; 3],
        chances: &mut Vec<f64>,
    ) -> Option<Ask> {
        let sums = self.sums(geometry, (x, n), chances);
        let total = *sums.last()?;
        if total <= 0.0 {
            return None;
        }
        let wanted = u[0] * total;
        let at = sums.partition_point(|&c| c <= wanted).min(self.lamps.len() - 1);
        let (below, chance) = chance(sums, at);
        // What the choice left over is uniform too.
        let rest = ((wanted - below) / (chance * total)).clamp(0.0, 1.0 - f64::EPSILON);
        self.lamps[at].ask(geometry, x, [rest, u[1], u[2]], chance)
    }

    /// About how densely [`Lamps::ask`] draws the direction from `x`, on a surface of any normal, to a `place` on one that
    /// may emit, 1/sr: enough to weigh one way to find light against another, as long as both are weighed by it.
    pub fn density(
        &self,
        geometry: &Geometry,
        x: DVec3,
        (surface, side, place): (SurfaceId, Side, DVec3),
        chances: &mut Vec<f64>,
    ) -> f64 {
        let Some(lamp) = self.lamps.get(self.on[surface.index()][side as usize] as usize) else { return 0.0 };
        let sums = self.sums(geometry, (x, None), chances);
        let (_, chance) = chance(sums, self.on[surface.index()][side as usize] as usize);
        let over = match &lamp.body {
            Body::Light(_) => return 0.0,
            Body::Flat(triangles, count) => triangles[..*count].iter().map(|t| solid_angle(x, *t)).sum(),
            Body::Round(round, side) => {
                let uv = round.uv_of(place);
                let normal = round.normal_of(uv);
                let normal = if *side == Side::Front { normal } else { -normal };
                geometric(place - x, normal) * round.stretch(uv)
            }
        };
        if over > 0.0 { chance / over } else { 0.0 }
    }

    /// Sums, up to each lamp, of what may be expected of them.
    fn sums<'s>(
        &'s self,
        geometry: &Geometry,
        (x, n): (DVec3, Option<DVec3>),
        room: &'s mut Vec<f64>,
    ) -> &'s [f64] {
        if !self.strengths.is_empty() {
            return &self.strengths;
        }
        room.clear();
        let mut total = 0.0;
        room.extend(self.lamps.iter().map(|lamp| {
            total += lamp.promise(geometry, x, n);
            total
        }));
        room
    }
}

/// Sums up to each of some numbers.
fn sums(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    numbers
        .scan(0.0, |sum, x| {
            *sum += x;
            Some(*sum)
        })
        .collect()
}

/// The sum below number `at`, and its share in all.
fn chance(sums: &[f64], at: usize) -> (f64, f64) {
    let below = if at == 0 { 0.0 } else { sums[at - 1] };
    let total = sums.last().copied().unwrap_or(0.0);
    (below, if total > 0.0 { (sums[at] - below) / total } else { 0.0 })
}

impl Lamp {
    /// What may be expected of it at a place with unit normal `n`, or any normal: 0 where nothing can come from.
    fn promise(&self, geometry: &Geometry, x: DVec3, n: Option<DVec3>) -> f64 {
        if let Body::Light(k) = self.body {
            let light = &geometry.lights[k];
            let (way, radius) = (light.seen_from(x), light.radius());
            let height = n.map_or(1.0, |n| n.dot(way.direction));
            let lit = height > -radius && way.share.is_finite();
            return if lit { self.strength * way.share * height.max(radius) } else { 0.0 };
        }
        let way = self.middle - x;
        let distance2 = way.length_squared();
        let distance = distance2.sqrt().max(f64::MIN_POSITIVE);
        let height = n.map_or(distance, |n| n.dot(way));
        if height < -self.reach {
            return 0.0;
        }
        let at_place = (height / distance).max(0.1);
        let at_lamp = if self.normal == DVec3::ZERO {
            1.0
        } else {
            let front = -self.normal.dot(way);
            if front <= 0.0 {
                return 0.0;
            }
            (front / distance).max(0.1)
        };
        self.strength * at_place * at_lamp / (distance2 + self.reach * self.reach)
    }

    fn ask(&self, geometry: &Geometry, x: DVec3, u: [f64; 3], chance: f64) -> Option<Ask> {
        // The place, how many steradians the draw of it stands for, and for how many a draw from all of the body does
        // about.
        let (to, drawn, about) = match &self.body {
            Body::Light(k) => {
                let way = geometry.lights[*k].drawn_from(x, u[0], u[1]);
                let (to, direction, share) = (way.end, way.direction, way.share / chance);
                let (source, density) = (self.source, f64::INFINITY);
                let lit = share > 0.0 && share.is_finite();
                return lit.then_some(Ask { to, direction, source, share, density });
            }
            Body::Flat(triangles, count) => {
                let angles = triangles.map(|t| solid_angle(x, t));
                let all: f64 = angles[..*count].iter().sum();
                if all <= 0.0 {
                    return None;
                }
                let first = angles[0] / all;
                let (t, angle, u0) = if *count == 1 || u[0] < first {
                    (triangles[0], angles[0], u[0] / if *count == 1 { 1.0 } else { first })
                } else {
                    (triangles[1], angles[1], (u[0] - first) / (1.0 - first))
                };
                if angle > SMALL {
                    let direction = in_spherical_triangle(t.map(|p| (p - x).normalize()), angle, [u0, u[1]]);
                    let height = -self.normal.dot(self.middle - x);
                    let distance = height / -self.normal.dot(direction);
                    // Solid angle was drawn evenly over all of it.
                    (x + distance * direction, all, all)
                } else {
                    let to = in_triangle(t, [u0, u[1]]);
                    let way = to - x;
                    let area = 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
                    let share = angle / all;
                    (to, geometric(way, self.normal) * area / share, all)
                }
            }
            Body::Round(round, side) => {
                let to = round.point_at(u[0], u[1]);
                let normal = round.normal_of([u[0], u[1]].into());
                let normal = if *side == Side::Front { normal } else { -normal };
                let angle = geometric(to - x, normal) * round.stretch([u[0], u[1]].into());
                (to, angle, angle)
            }
        };
        let direction = (to - x).normalize_or_zero();
        let (source, share, density) = (self.source, drawn / chance, chance / about);
        let reaches = share > 0.0 && share.is_finite() && density.is_finite();
        reaches.then_some(Ask { to, direction, source, share, density })
    }
}

/// Solid angle per area of a surface with this normal at the end of a way.
fn geometric(way: DVec3, normal: DVec3) -> f64 {
    let distance2 = way.length_squared();
    (-normal.dot(way)).max(0.0) / (distance2 * distance2.sqrt())
}

/// Solid angle of a triangle seen from `x` on its front, sr; 0 from behind (Van Oosterom and Strackee 1983).
fn solid_angle(x: DVec3, triangle: [DVec3; 3]) -> f64 {
    let [a, b, c] = triangle.map(|p| (p - x).normalize_or_zero());
    let volume = -a.dot(b.cross(c));
    let below = 1.0 + a.dot(b) + b.dot(c) + c.dot(a);
    if volume > 0.0 { 2.0 * volume.atan2(below) } else { 0.0 }
}

/// A direction drawn evenly from a spherical triangle of this solid angle (Arvo 1995).
fn in_spherical_triangle([a, b, c]: [DVec3; 3], angle: f64, u: [f64; 2]) -> DVec3 {
    let tangent = |from: DVec3, to: DVec3| to.reject_from_normalized(from).normalize_or_zero();
    let cos_alpha = tangent(a, b).dot(tangent(a, c)).clamp(-1.0, 1.0);
    let alpha = cos_alpha.acos();
    let cos_c = a.dot(b);
    let (s, t) = (u[0] * angle - alpha).sin_cos();
    let (p, q) = (t - cos_alpha, s + alpha.sin() * cos_c);
    let below = (q * s + p * t) * alpha.sin();
    let along = if below == 0.0 { 1.0 } else { ((q * t - p * s) * cos_alpha - q) / below };
    let along = along.clamp(-1.0, 1.0);
    let third = along * a + (1.0 - along * along).sqrt() * tangent(a, c);
    let z = 1.0 - u[1] * (1.0 - third.dot(b));
    z * b + (1.0 - z * z).max(0.0).sqrt() * tangent(b, third)
}

/// A place drawn evenly from a triangle.
fn in_triangle([a, b, c]: [DVec3; 3], u: [f64; 2]) -> DVec3 {
    let root = u[0].sqrt();
    a + root * (1.0 - u[1]) * (b - a) + root * u[1] * (c - a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::scene::ObjectId;

    /// The middles of `n` x `n` cells of the unit square.
    fn lattice(n: usize) -> impl Iterator<Item = [f64; 2]> {
        (0..n * n).map(move |k| [k / n, k % n].map(|k| (k as f64 + 0.5) / n as f64))
    }

    #[test]
    fn spherical_triangles_are_drawn_evenly() {
        let triangle = [DVec3::new(1.0, 0.1, 0.0), DVec3::new(-0.2, 1.0, 0.3), DVec3::new(0.1, -0.2, 1.0)];
        let x = DVec3::ZERO;
        let flipped = [triangle[0], triangle[2], triangle[1]];
        let angle = solid_angle(x, triangle).max(solid_angle(x, flipped));
        assert!(angle > 1.0 && solid_angle(x, triangle).min(solid_angle(x, flipped)) == 0.0);
        let corners = triangle.map(|p| p.normalize());
        // The mean direction of a spherical polygon: half the sum of its edges' normals times their lengths.
        let mut expected = DVec3::ZERO;
        for k in 0..3 {
            let (p, q) = (corners[k], corners[(k + 1) % 3]);
            expected += 0.5 * p.angle_between(q) * p.cross(q).normalize();
        }
        let n = 200;
        let mut sum = DVec3::ZERO;
        for u in lattice(n) {
            let d = in_spherical_triangle(corners, angle, u);
            assert!((d.length() - 1.0).abs() < 1e-9);
            sum += d;
        }
        let mean = sum * angle / (n * n) as f64;
        assert!(mean.distance(expected) < 1e-4 * angle, "{mean} {expected}");
    }

    /// A square of 2 m in so many lamps each way, 1 m over a floor: F = 4 times that of a quarter, a corner over a
    /// parallel square. Few lamps are chosen by what may be expected of them, many by their strength.
    #[test]
    fn what_is_asked_for_is_the_irradiance_of_a_rectangle() {
        for parts in [1, 3, 18] {
            let corner = |x: usize, y: usize| {
                let at = |k: usize| 2.0 * k as f64 / parts as f64 - 1.0;
                DVec3::new(at(x), at(y), 1.0)
            };
            let quad = |k: usize| {
                let (x, y) = (k % parts, k / parts);
                Shape::Quad([corner(x, y), corner(x, y + 1), corner(x + 1, y + 1), corner(x + 1, y)])
            };
            let floor = Shape::Quad(
                [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(|(x, y)| DVec3::new(x, y, 0.0)),
            );
            let all = parts * parts;
            let shapes =
                (0..all).map(quad).chain([floor]).map(|shape| (shape, false, 0, ObjectId(0))).collect();
            let geometry = Geometry::new(shapes, vec!["all".into()]);
            let x = geometry.surfaces[all].middle();
            let height = geometry.surfaces[0].middle().z - x.z;
            let half = 1.0 / (1.0f64 + height * height).sqrt();
            let exact = 4.0 * half * half.atan() / (2.0 * std::f64::consts::PI) * 2.0;
            let lamp = |k: usize| {
                let surface = &geometry.surfaces[k];
                let (triangles, count) = surface.triangles();
                Lamp {
                    body: Body::Flat(triangles, count),
                    normal: surface.plane().map_or(DVec3::ZERO, |p| p.normal),
                    middle: surface.middle(),
                    strength: surface.area,
                    reach: 0.5 * surface.bounds().size().length(),
                    source: Source::Surface(SurfaceId(k as u32)),
                }
            };
            let on = (0..=all).map(|k| [if k < all { k as u32 } else { NO_LAMP }, NO_LAMP]).collect();
            let lamps = Lamps::of((0..all).map(lamp).collect(), on);
            assert_eq!(lamps.strengths.is_empty(), all <= FEW);
            let mut chances = Vec::new();
            for n in [Some(DVec3::Z), None] {
                let (mut sum, cells) = (0.0, 300);
                for [u, v] in lattice(cells) {
                    let Some(ask) = lamps.ask(&geometry, (x, n), [u, v, 0.0], &mut chances) else { continue };
                    sum += ask.direction.z.max(0.0) * ask.share / (cells * cells) as f64;
                    let Source::Surface(id) = ask.source else { panic!("no light has no body") };
                    // Where a path meets the place a lamp must be known to have been asked as often as it was.
                    if n.is_none() {
                        let density = lamps.density(&geometry, x, (id, Side::Front, ask.to), &mut chances);
                        assert!((density / ask.density - 1.0).abs() < 1e-9, "{density} {}", ask.density);
                    }
                }
                let found = sum / std::f64::consts::PI;
                assert!((found - exact).abs() < 1e-3 * exact, "{parts} parts, {n:?}: {found} {exact}");
            }
        }
    }
}

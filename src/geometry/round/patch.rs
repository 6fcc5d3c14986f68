//! Bicubic Bézier patches.

use super::net::{Net, Spread, evaluate, part, spread};
use super::patch_crossings::crossings;
use super::patch_part::{Met, Part, cut};
use crate::geometry::{Aabb, Ray};
use glam::{DVec2, DVec3};

/// A bicubic Bézier patch: P(u, v) = Σ B_i(u) B_j(v) p_ji with the cubic Bernstein polynomials B.
///
/// An edge may be one point, as at the tip of a lid. Its parameters keep no areas. The area is within 1e-9 of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    net: Net,
    area: f64,
    bounds: Aabb,
    lengths: DVec2,
    parts: Vec<Part>,
}

/// Abscissas and weights of Gauss and Legendre's rule with four points, on 0..1.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// Squares are quartered until their areas are within this of the area of the patch over the same share of (u, v), or
/// so often.
const AREA_ERROR: f64 = 1e-9;
const QUARTERED: u32 = 7;

/// Lines, and places along each, of which the lengths are measured.
const LINES: usize = 8;

impl Patch {
    /// The patch of these control points, m: row j along v, and in it i along u.
    pub fn new(net: [[DVec3; 4]; 4]) -> Self {
        let node = |k: usize| k as f64 / LINES as f64;
        let at = |i: usize, j: usize| evaluate(&net, node(i), node(j))[0];
        let mut lengths = DVec2::ZERO;
        for a in 0..=LINES {
            for b in 0..LINES {
                let steps = DVec2::new(at(b, a).distance(at(b + 1, a)), at(a, b).distance(at(a, b + 1)));
                lengths += steps / (LINES + 1) as f64;
            }
        }
        let mut patch = Patch { net, area: 0.0, bounds: Aabb::EMPTY, lengths, parts: Vec::new() };
        // What is not finite is refused by its bounds.
        if !net.iter().flatten().all(|p| p.is_finite()) {
            patch.bounds = Aabb { min: DVec3::NAN, max: DVec3::NAN };
            return patch;
        }
        patch.parts = cut(&net, patch.collapsed());
        // The hulls of the parts fit closer than that of the whole.
        patch.bounds = patch.parts.iter().fold(Aabb::EMPTY, |all, part| all.union(part.bounds));
        patch.area = patch.rule(DVec2::ZERO, 1.0);
        patch.area = patch.cell_area(DVec2::ZERO, 1.0);
        patch
    }

    /// The control points, m.
    pub fn net(&self) -> &[[DVec3; 4]; 4] {
        &self.net
    }

    pub(super) fn area(&self) -> f64 {
        self.area
    }

    pub(super) fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Mean lengths along u and v, m.
    pub(super) fn lengths(&self) -> DVec2 {
        self.lengths
    }

    /// Control points of the square of (u, v) from `low` on: the cell lies in their hull.
    pub(crate) fn part(&self, low: DVec2, size: f64) -> Net {
        part(&self.net, low, low + size)
    }

    /// A cone around all normals over the square of (u, v) from `low` on, if one was found.
    pub(crate) fn normals(&self, low: DVec2, size: f64) -> Option<Spread> {
        spread(&self.part(low, size))
    }

    /// What rays are asked of.
    pub(crate) fn parts(&self) -> &[Part] {
        &self.parts
    }

    pub(super) fn point_at(&self, u: f64, v: f64) -> DVec3 {
        evaluate(&self.net, u, v)[0]
    }

    /// Area per unit of (u, v), m².
    pub(super) fn stretch(&self, uv: DVec2) -> f64 {
        let [_, along_u, along_v] = evaluate(&self.net, uv.x, uv.y);
        along_u.cross(along_v).length()
    }

    /// Area of a square of (u, v), m².
    pub(super) fn cell_area(&self, low: DVec2, size: f64) -> f64 {
        fn quartered(patch: &Patch, low: DVec2, size: f64, whole: f64, left: u32) -> f64 {
            let half = 0.5 * size;
            let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(|step| low + half * step);
            let quarters = corners.map(|corner| patch.rule(corner, half));
            let sum: f64 = quarters.iter().sum();
            // The rule is of order eight: the sum of the quarters is closer by far.
            if (sum - whole).abs() <= 64.0 * AREA_ERROR * patch.area * size * size || left == 0 {
                return sum;
            }
            (0..4).map(|k| quartered(patch, corners[k], half, quarters[k], left - 1)).sum()
        }
        quartered(self, low, size, self.rule(low, size), QUARTERED)
    }

    /// [`Patch::cell_area`] by one rule of 16 points.
    fn rule(&self, low: DVec2, size: f64) -> f64 {
        let mut sum = 0.0;
        for (u, a) in GAUSS {
            for (v, b) in GAUSS {
                sum += a * b * self.stretch(low + size * DVec2::new(u, v));
            }
        }
        sum * size * size
    }

    /// Unit normal at (u, v), on the front. Where an edge is one point, or the patch has a cusp, that of a place beside.
    pub(crate) fn normal(&self, uv: DVec2) -> DVec3 {
        let scale = self.lengths.x * self.lengths.y;
        for beside in [0.0, 1e-4, 1e-3, 1e-2, 1e-1] {
            let at = uv.lerp(DVec2::splat(0.5), beside);
            let [_, along_u, along_v] = evaluate(&self.net, at.x, at.y);
            let cross = along_u.cross(along_v);
            if cross.length() > 1e-10 * scale {
                return cross.normalize();
            }
        }
        DVec3::Z
    }

    /// (u, v) of the place nearest to `p`: Gauss and Newton's method from the middles of the parts, the nearest first, as
    /// far as their boxes may hold a nearer place.
    pub(crate) fn uv_of(&self, p: DVec3) -> DVec2 {
        let away = |part: &Part| {
            let Aabb { min, max } = part.bounds;
            (min - p).max(p - max).max(DVec3::ZERO).length_squared()
        };
        let enough = 1e-12 * self.lengths.max_element();
        let mut best = (f64::INFINITY, DVec2::ZERO);
        let mut search = |part: &Part| {
            let (at, distance) = self.descend(p, part.low + 0.5 * part.size, enough);
            if distance < best.0 {
                best = (distance, at);
            }
            best.0
        };
        let nearest = |(least, k): (f64, usize), (i, part): (usize, &Part)| {
            let distance = away(part);
            if distance < least { (distance, i) } else { (least, k) }
        };
        let (_, first) = self.parts.iter().enumerate().fold((f64::INFINITY, 0), nearest);
        let Some(part) = self.parts.get(first) else { return DVec2::ZERO };
        let mut least = search(part);
        for (k, part) in self.parts.iter().enumerate() {
            if least <= enough {
                break;
            }
            if k != first && away(part) < least * least {
                least = search(part);
            }
        }
        best.1
    }

    /// From `at` down to where the distance from `p` is least near by, or `enough`, and that distance, m.
    fn descend(&self, p: DVec3, mut at: DVec2, enough: f64) -> (DVec2, f64) {
        let [mut place, mut along_u, mut along_v] = evaluate(&self.net, at.x, at.y);
        let mut distance = place.distance(p);
        for _ in 0..24 {
            if distance <= enough {
                break;
            }
            let away = p - place;
            // What would lead out of the square does not count.
            let free = |x: f64, slope: f64| !(x <= 0.0 && slope < 0.0 || x >= 1.0 && slope > 0.0);
            let (mut a, mut b) = (along_u.dot(away), along_v.dot(away));
            let [free_u, free_v] = [free(at.x, a), free(at.y, b)];
            let (uu, mut uv, vv) = (along_u.length_squared(), along_u.dot(along_v), along_v.length_squared());
            if !free_u || !free_v {
                uv = 0.0;
                a *= f64::from(u8::from(free_u));
                b *= f64::from(u8::from(free_v));
            }
            let damping = 1e-14 * (uu + vv) + f64::MIN_POSITIVE;
            let (uu, vv) = (uu + damping, vv + damping);
            let below = uu * vv - uv * uv;
            let step = DVec2::new(vv * a - uv * b, uu * b - uv * a) / below;
            if !step.is_finite() {
                break;
            }
            let mut share = 1.0;
            let mut moved = false;
            for _ in 0..6 {
                let next = (at + share * step).clamp(DVec2::ZERO, DVec2::ONE);
                let [q, qu, qv] = evaluate(&self.net, next.x, next.y);
                let new = q.distance(p);
                if new < distance {
                    moved = (next - at).abs().max_element() > 1e-15;
                    (at, place, along_u, along_v, distance) = (next, q, qu, qv, new);
                    break;
                }
                share *= 0.25;
            }
            if !moved {
                break;
            }
        }
        (at, distance)
    }

    /// Where `ray` meets part number `k` first, within its limits.
    #[inline]
    pub(crate) fn intersect_part(&self, k: usize, ray: &Ray) -> Option<f64> {
        let part = &self.parts[k];
        match part.meet(ray) {
            Met::Once(t) => (t > ray.t_min && t < ray.t_max).then_some(t),
            Met::Not => None,
            Met::Unknown => {
                let mut first = None;
                crossings(&part.net, part.size, ray, |t| {
                    first = Some(t);
                    t
                });
                first
            }
        }
    }

    /// The first crossing within the ray's limits.
    pub(crate) fn intersect(&self, ray: &Ray) -> Option<f64> {
        let mut rest = *ray;
        let mut first = None;
        let inverse = ray.direction.recip();
        for (k, part) in self.parts.iter().enumerate() {
            let Aabb { min, max } = part.bounds;
            let (a, b) = ((min - ray.origin) * inverse, (max - ray.origin) * inverse);
            // What is not a number, for a line in the plane of a face, decides nothing; the box has room around it.
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            if enter > leave || leave < rest.t_min || enter > rest.t_max {
                continue;
            }
            if let Some(t) = self.intersect_part(k, &rest) {
                rest.t_max = t;
                first = Some(t);
            }
        }
        first
    }

    /// Whether it may meet the box: never false where it does.
    pub(crate) fn may_meet_box(&self, bounds: &Aabb) -> bool {
        let meets = |part: &Part| {
            let Aabb { min, max } = part.bounds;
            min.cmple(bounds.max).all() && max.cmpge(bounds.min).all()
        };
        self.parts.iter().any(meets)
    }

    /// Whether an edge is one point: those of v = 0, u = 1, v = 1 and u = 0.
    pub(crate) fn collapsed(&self) -> [bool; 4] {
        self.edges().map(|edge| edge.iter().all(|p| *p == edge[0]))
    }

    /// Control points of the edges v = 0, u = 1, v = 1 and u = 0, each with u or v growing.
    pub fn edges(&self) -> [[DVec3; 4]; 4] {
        let column = |i: usize| [0, 1, 2, 3].map(|j| self.net[j][i]);
        [self.net[0], column(3), self.net[3], column(0)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    /// A hill, a fold that overhangs, and a cap of which one edge is a point.
    pub(crate) fn patches() -> [Patch; 3] {
        let net = |of: &dyn Fn(f64, f64) -> DVec3| -> Net {
            std::array::from_fn(|j| std::array::from_fn(|i| of(i as f64 / 3.0, j as f64 / 3.0)))
        };
        let hill =
            net(&|u, v| DVec3::new(u, v, if (0.2..0.8).contains(&u) && v > 0.5 { 1.0 } else { 0.1 * u * v }));
        let fold =
            net(&|u, v| DVec3::new([0.0, 1.6, -0.6, 1.0][(3.0 * u).round() as usize], v, u + 0.2 * v * v));
        let cap = net(&|u, v| {
            let (sin, cos) = (1.5 * u).sin_cos();
            DVec3::new(v * cos, v * sin, 0.5 - 0.5 * v * v)
        });
        [hill, fold, cap].map(Patch::new)
    }

    /// The patch as very many triangles.
    fn mesh(patch: &Patch, n: u32) -> Vec<[DVec3; 3]> {
        let at = |i: u32, j: u32| patch.point_at(f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
        let cell = |k: u32| {
            let (i, j) = (k % n, k / n);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        (0..n * n).flat_map(cell).collect()
    }

    #[test]
    fn areas_are_those_of_closed_forms_and_of_fine_meshes() {
        for patch in patches() {
            let mesh: f64 =
                mesh(&patch, 400).iter().map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).length()).sum();
            assert!((patch.area() / mesh - 1.0).abs() < 2e-5, "{} {mesh}", patch.area());
            // Cells of a level add up, and twice as fine a rule says the same.
            for level in [2u32, 4] {
                let size = 0.5f64.powi(level as i32);
                let corner = |k: u32| size * DVec2::new(f64::from(k % (1 << level)), f64::from(k >> level));
                let sum: f64 = (0..1 << (2 * level)).map(|k| patch.cell_area(corner(k), size)).sum();
                let error = (sum / patch.area() - 1.0).abs();
                assert!(error < if level == 2 { 1e-4 } else { 1e-8 }, "{level}: {error}");
            }
        }
        // z = x y over the unit square: ∫∫ √(1 + x² + y²).
        let saddle = std::array::from_fn(|j| {
            std::array::from_fn(|i| {
                let (x, y) = (i as f64 / 3.0, j as f64 / 3.0);
                DVec3::new(x, y, x * y)
            })
        });
        let root = 3f64.sqrt();
        let exact = root / 3.0 + 4.0 / 3.0 * ((1.0 + root) / 2f64.sqrt()).ln() - std::f64::consts::PI / 18.0;
        assert!(
            (Patch::new(saddle).area() / exact - 1.0).abs() < 1e-10,
            "{} {exact}",
            Patch::new(saddle).area()
        );
    }

    #[test]
    fn places_lead_back_to_their_parameters_and_normals_are_unit() {
        for patch in patches() {
            for i in 0..=50 {
                for j in 0..=50 {
                    let uv = DVec2::new(f64::from(i), f64::from(j)) / 50.0;
                    let p = patch.point_at(uv.x, uv.y);
                    let back = patch.uv_of(p);
                    let q = patch.point_at(back.x, back.y);
                    assert!(p.distance(q) < 1e-9, "{uv} {back}: {}", p.distance(q));
                    let normal = patch.normal(uv);
                    assert!((normal.length() - 1.0).abs() < 1e-12 && normal.is_finite(), "{uv}");
                    let Aabb { min, max } = patch.bounds();
                    assert!(p.cmpge(min - 1e-12).all() && p.cmple(max + 1e-12).all());
                }
            }
        }
    }

    /// All crossings, by halving alone.
    fn all_crossings(patch: &Patch, ray: &Ray) -> Vec<f64> {
        let mut all: Vec<f64> = Vec::new();
        crossings(&patch.net, DVec2::ONE, ray, |t| {
            // On a border of two pieces a crossing is found in both.
            if !all.iter().any(|known| (known - t).abs() < 1e-9) {
                all.push(t);
            }
            ray.t_max
        });
        all.sort_unstable_by(f64::total_cmp);
        all
    }

    #[test]
    fn lines_cross_where_fine_meshes_say() {
        let mut state = 3u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for patch in patches() {
            let mesh = mesh(&patch, 200);
            let (mut met, mut several, mut other) = (0, 0, 0);
            for _ in 0..2000 {
                let mut place = || DVec3::new(next(), next(), next()) * 3.0 - 1.0;
                let (origin, towards) = (place(), patch.point_at(next(), next()));
                let ray = Ray { origin, direction: towards - origin, t_min: 0.0, t_max: 10.0 };
                let found = all_crossings(&patch, &ray);
                assert!(found.iter().any(|t| (t - 1.0).abs() < 1e-7), "what was aimed at: {ray:?} {found:?}");
                let first = patch.intersect(&ray).expect("met");
                assert!((first - found[0]).abs() < 1e-12, "{first} {found:?}");
                for t in &found {
                    let uv = patch.uv_of(ray.at(*t));
                    assert!(patch.point_at(uv.x, uv.y).distance(ray.at(*t)) < 1e-9);
                }
                let hits = mesh
                    .par_iter()
                    .filter(|t| crate::tracers::brute_force::intersect_triangle(&ray, t).is_some());
                other += usize::from(hits.count() != found.len());
                met += found.len();
                several += usize::from(found.len() > 1);
            }
            // The mesh is not the patch: tangents and borders differ, and lines through its edges are met twice.
            assert!(other < 60 && met >= 2000 && several > 50, "{other} {met} {several}");
        }
    }
}

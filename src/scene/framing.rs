//! A camera for a scene that has none.
//!
//! Places around the scene and inside it are tried, each by a coarse picture of which surface shows where. The one
//! that shows most of what is lit wins: so it looks in through the open side of a box, not at the back of a wall, and
//! stands inside a closed room. There it looks to where there is most to see, by the entropy of what a picture shows
//! (P.-P. Vázquez et al.,
//! *Viewpoint Selection using Viewpoint Entropy*, 2001).

use super::{Appearance, Camera, Geometry, LightKind};
use crate::geometry::{Shape, SurfaceId};
use crate::material::Body;
use glam::DVec3;
use rayon::prelude::*;

/// Pixels of the coarse pictures.
const WIDTH: usize = 64;
const HEIGHT: usize = 48;
/// Vertical angle of view outside and inside, degrees.
const OUTSIDE_DEG: f64 = 40.0;
const INSIDE_DEG: f64 = 65.0;
/// A place inside must show so much more than the best outside,
const INSIDE_GAIN: f64 = 1.6;
/// see surfaces almost everywhere in the picture, and in most directions around.
const INSIDE_COVER: f64 = 0.95;
const AROUND_COVER: f64 = 0.7;
/// Surfaces that no light reaches straight count so much of those that one does.
const UNLIT: f64 = 0.1;
/// So many lights are asked what they reach.
const MOST_LIGHTS: usize = 4;
/// Light from infinity is looked at from so many radii of the scene.
const FAR: f64 = 50.0;
/// So many pixels of facets are looked at for a picture; what is drawn later in a scene of more is left out.
const MOST_TESTS: usize = 4_000_000;
/// What is round is drawn by squares of its parameters, so many along each.
const FACETS: usize = 8;

const AXES: [DVec3; 6] = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];

/// A triangle of the coarse pictures; its front is counter-clockwise.
struct Facet {
    corners: [DVec3; 3],
    surface: u32,
}

/// A camera of the coarse pictures.
struct Eye {
    at: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half of the height and of the width at distance 1.
    half: [f64; 2],
}

/// The camera that shows most of `geometry`, whose materials are `appearance`'s, with `up` upwards.
pub fn camera(geometry: &Geometry, appearance: &Appearance, up: DVec3) -> Camera {
    let facets = facets(geometry, appearance);
    let two_sided = |s: u32| geometry.two_sided[s as usize];
    let lit = lit(geometry, appearance, &facets);
    let worth =
        |(surface, front): (u32, bool)| match (front || two_sided(surface), lit[sheet(surface, front)]) {
            (false, _) => 0.0,
            (true, false) => UNLIT,
            (true, true) => 1.0,
        };
    let total: f64 = geometry.surfaces.iter().map(|s| s.area).sum();
    // The share of all surfaces that a picture shows something of.
    let area_seen = |shown: &[Option<(u32, bool)>]| {
        let mut seen: Vec<u32> = shown.iter().flatten().filter(|&&p| worth(p) > 0.0).map(|p| p.0).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.iter().map(|&s| geometry.surfaces[s as usize].area).sum::<f64>() / total
    };
    let bounds = geometry.bounds();
    let (middle, size) = (bounds.centre(), bounds.size());
    let flat = up.cross(if up == DVec3::Y { DVec3::X } else { DVec3::Y }).normalize();
    let heading = |k: usize| {
        // Opposite `flat` × `up` first: the side that faces the viewer where models are drawn.
        let angle = std::f64::consts::FRAC_PI_4 * k as f64;
        -(angle.cos() * flat.cross(up) + angle.sin() * flat)
    };
    let outside = (0..24).map(|k| {
        // Level, from above, and last from below, where lamps are open.
        let rise = [0.0, 0.5, -0.5][k / 8];
        let forward = (heading(k % 8) - rise * up).normalize();
        let eye = Eye::new(DVec3::ZERO, forward, up, OUTSIDE_DEG);
        let corners = bounds_corners(middle, size);
        let away = corners.iter().map(|c| eye.distance_to_hold(*c - middle)).fold(0.0, f64::max);
        let at = middle - 1.02 * away.max(1e-9 * geometry.radius) * forward;
        (at, middle, OUTSIDE_DEG)
    });
    let inside = (0..8).map(|k| {
        let way = heading(k);
        let along = |share: f64, height: f64| {
            let level = middle + share * (size * way) - share * (size * way).dot(up) * up;
            level + height * size.dot(up.abs()) * up
        };
        (along(-0.42, 0.08), along(0.3, -0.06), INSIDE_DEG)
    });
    let candidates: Vec<(DVec3, DVec3, f64)> = outside.chain(inside).collect();
    // Of each what it is worth, and inside how various.
    let scores: Vec<(f64, f64)> = candidates
        .par_iter()
        .map(|&(at, target, degrees)| {
            let eye = Eye::new(at, target - at, up, degrees);
            let shown = eye.picture(&facets);
            let sum: f64 = shown.iter().flatten().map(|&pixel| worth(pixel)).sum();
            let sum = sum * area_seen(&shown).sqrt();
            if degrees == OUTSIDE_DEG {
                let held = eye.pixels_of(&bounds_corners(middle, size));
                return (sum / held.max(1.0), 1.0);
            }
            let cover = |shown: &[Option<(u32, bool)>]| {
                shown.iter().flatten().count() as f64 / (WIDTH * HEIGHT) as f64
            };
            let around = || AXES.iter().map(|&way| cover(&Eye::square(at, way, 1.0).picture(&facets)));
            if cover(&shown) < INSIDE_COVER || around().sum::<f64>() < 6.0 * AROUND_COVER {
                return (0.0, 0.0);
            }
            (sum / (WIDTH * HEIGHT) as f64 / INSIDE_GAIN, entropy(&shown))
        })
        .collect();
    // The first of the best, so that rounding alone never decides between equals.
    let best = |of: &dyn Fn(usize) -> f64| {
        let most = (0..scores.len()).map(of).fold(0.0, f64::max);
        (0..scores.len()).find(|&k| of(k) >= 0.999 * most).unwrap_or(0)
    };
    let inside = |k: usize| candidates[k].2 == INSIDE_DEG;
    let worthiest = best(&|k| scores[k].0);
    let chosen = best(&|k| if inside(k) == inside(worthiest) { scores[k].0 * scores[k].1 } else { 0.0 });
    let (at, target, fov_deg) = candidates[chosen];
    let world = |p: DVec3| p + geometry.centre;
    Camera {
        name: "default".into(),
        position: world(at),
        target: world(target),
        up,
        fov_deg,
        resolution: [640, 480],
    }
}

/// How various a picture is: the entropy of the surfaces that it shows by the pixels that they take.
fn entropy(shown: &[Option<(u32, bool)>]) -> f64 {
    let mut pixels = std::collections::BTreeMap::new();
    for (surface, _) in shown.iter().flatten() {
        *pixels.entry(*surface).or_insert(0.0) += 1.0 / shown.len() as f64;
    }
    -pixels.values().map(|share: &f64| share * share.ln()).sum::<f64>()
}

fn bounds_corners(middle: DVec3, size: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 0.5 } else { -0.5 };
        middle + size * DVec3::new(sign(0), sign(1), sign(2))
    })
}

/// All surfaces as triangles, but for glass, through which one looks.
fn facets(geometry: &Geometry, appearance: &Appearance) -> Vec<Facet> {
    let mut facets = Vec::new();
    for (i, surface) in geometry.surfaces.iter().enumerate() {
        if matches!(appearance.material(SurfaceId(i as u32)).body, Body::Pane { .. } | Body::Solid { .. }) {
            continue;
        }
        let mut add = |corners: [DVec3; 3]| facets.push(Facet { corners, surface: i as u32 });
        match surface.shape {
            Shape::Triangle(t) => add(t),
            Shape::Quad([a, b, c, d]) => {
                add([a, b, c]);
                add([a, c, d]);
            }
            _ => {
                let at = |k: usize| k as f64 / FACETS as f64;
                for (j, k) in (0..FACETS).flat_map(|j| (0..FACETS).map(move |k| (j, k))) {
                    let corner = |u: usize, v: usize| surface.point_at(at(j + u), at(k + v));
                    let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    let outwards = (c - a).cross(d - b).dot(surface.normal_at((a + c) / 2.0)) >= 0.0;
                    for [p, q, r] in [[a, b, c], [a, c, d]] {
                        add(if outwards { [p, q, r] } else { [p, r, q] });
                    }
                }
            }
        }
    }
    facets
}

/// A side of a surface as one number.
fn sheet(surface: u32, front: bool) -> usize {
    2 * surface as usize + usize::from(!front)
}

/// Per [`sheet`] whether a light shines on it straight, or it is one; all are where there is no light to ask.
fn lit(geometry: &Geometry, appearance: &Appearance, facets: &[Facet]) -> Vec<bool> {
    let count = geometry.surfaces.len();
    let emits = |&s: &usize| appearance.material(SurfaceId(s as u32)).emission.is_some();
    let emitters: Vec<usize> = (0..count).filter(emits).collect();
    let step = emitters.len().div_ceil(MOST_LIGHTS).max(1);
    let bodies = emitters.iter().step_by(step).map(|&s| {
        let surface = &geometry.surfaces[s];
        let middle = surface.middle();
        let normal = surface.normal_at(surface.point_at(1.0 / 3.0, 1.0 / 3.0));
        let normal = (!geometry.two_sided[s]).then_some(normal);
        (middle + 1e-4 * geometry.radius * normal.unwrap_or(DVec3::ZERO), normal)
    });
    let around = bodies.flat_map(|(at, normal)| AXES.map(|way| (at, normal, way, 1.0)));
    let mut views: Vec<(DVec3, Option<DVec3>, DVec3, f64)> = around.collect();
    for light in geometry.lights.iter().take(MOST_LIGHTS) {
        match &light.kind {
            LightKind::Point { position, .. } => views.extend(AXES.map(|way| (*position, None, way, 1.0))),
            // From far away, just wide enough for the scene.
            LightKind::Directional { from, .. } => {
                views.push((FAR * geometry.radius * *from, None, -*from, 1.0 / FAR));
            }
        }
    }
    if views.is_empty() {
        return vec![true; 2 * count];
    }
    let mut lit = vec![false; 2 * count];
    emitters.iter().for_each(|&s| lit[2 * s..2 * s + 2].fill(true));
    let seen: Vec<Vec<usize>> = views
        .par_iter()
        .map(|&(at, normal, way, half)| {
            let eye = Eye::square(at, way, half);
            let picture = eye.picture(facets).into_iter().enumerate();
            let shines = |pixel: usize| normal.is_none_or(|n| n.dot(eye.ray(pixel)) > 0.0);
            let reached = |(pixel, shown): (usize, Option<(u32, bool)>)| {
                shown.filter(|&(s, front)| (front || geometry.two_sided[s as usize]) && shines(pixel))
            };
            let mut sheets: Vec<usize> =
                picture.filter_map(reached).map(|(s, front)| sheet(s, front)).collect();
            sheets.sort_unstable();
            sheets.dedup();
            sheets
        })
        .collect();
    seen.iter().flatten().for_each(|&s| lit[s] = true);
    lit
}

impl Eye {
    fn new(at: DVec3, forward: DVec3, up: DVec3, degrees: f64) -> Eye {
        let forward = forward.normalize_or(DVec3::NEG_Z);
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        let height = (0.5 * degrees.to_radians()).tan();
        let half = [height, height * WIDTH as f64 / HEIGHT as f64];
        Eye { at, right, up: right.cross(forward), forward, half }
    }

    /// One whose picture is square: `half` is the tangent of half its angle.
    fn square(at: DVec3, forward: DVec3, half: f64) -> Eye {
        Eye { half: [half, half], ..Eye::new(at, forward, forward.any_orthonormal_vector(), 90.0) }
    }

    /// Along `right`, `up` and `forward`, the first two such that the border of the picture is at 1.
    fn seen(&self, p: DVec3) -> DVec3 {
        let d = p - self.at;
        DVec3::new(d.dot(self.right) / self.half[1], d.dot(self.up) / self.half[0], d.dot(self.forward))
    }

    /// How far before the origin an eye must stand to have `p` in its picture.
    fn distance_to_hold(&self, p: DVec3) -> f64 {
        let p = self.seen(p + self.at);
        p.x.abs().max(p.y.abs()) - p.z
    }

    /// Direction through the middle of a pixel, in the scene's coordinates.
    fn ray(&self, pixel: usize) -> DVec3 {
        let d = middle_of(pixel % WIDTH, pixel / WIDTH);
        d.x * self.half[1] * self.right + d.y * self.half[0] * self.up + self.forward
    }

    /// Pixels within the box around `corners` as seen, all of which are before the eye.
    fn pixels_of(&self, corners: &[DVec3]) -> f64 {
        let flat = corners.iter().map(|&c| self.seen(c)).map(|p| (p.x / p.z, p.y / p.z));
        let (low, high) = flat.fold(([1.0f64; 2], [-1.0f64; 2]), |(low, high), (x, y)| {
            ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)])
        });
        let share = |axis: usize| (high[axis].min(1.0) - low[axis].max(-1.0)).max(0.0) / 2.0;
        share(0) * share(1) * (WIDTH * HEIGHT) as f64
    }

    /// Per pixel the nearest surface, and whether it shows its front.
    fn picture(&self, facets: &[Facet]) -> Vec<Option<(u32, bool)>> {
        let mut shown = vec![None; WIDTH * HEIGHT];
        let mut depth = vec![f64::INFINITY; WIDTH * HEIGHT];
        let mut left = MOST_TESTS;
        for facet in facets {
            let v = facet.corners.map(|c| self.seen(c));
            let before = v.iter().filter(|p| p.z > 0.0).count();
            if before == 0 {
                continue;
            }
            let (columns, rows) = if before == 3 {
                (range(v.map(|p| p.x / p.z), WIDTH), range(v.map(|p| -p.y / p.z), HEIGHT))
            } else {
                (0..WIDTH, 0..HEIGHT)
            };
            if columns.is_empty() || rows.is_empty() {
                continue;
            }
            let Some(rest) = usize::checked_sub(left, columns.len() * rows.len()) else { break };
            left = rest;
            let edges = [v[1].cross(v[2]), v[2].cross(v[0]), v[0].cross(v[1])];
            let volume = v[0].dot(edges[0]);
            for row in rows {
                for column in columns.clone() {
                    let way = middle_of(column, row);
                    let inside = edges.map(|e| e.dot(way));
                    let (all_in, all_out) =
                        (inside.iter().all(|e| *e >= 0.0), inside.iter().all(|e| *e <= 0.0));
                    let distance = volume / inside.iter().sum::<f64>();
                    let pixel = row * WIDTH + column;
                    if (all_in || all_out) && distance > 0.0 && distance < depth[pixel] {
                        depth[pixel] = distance;
                        // (right, up, forward) is left-handed.
                        shown[pixel] = Some((facet.surface, all_in));
                    }
                }
            }
        }
        shown
    }
}

/// Direction through the middle of a pixel as [`Eye::seen`] measures; rows go downwards.
fn middle_of(column: usize, row: usize) -> DVec3 {
    let at = |i: usize, count: usize| (2 * i + 1) as f64 / count as f64 - 1.0;
    DVec3::new(at(column, WIDTH), -at(row, HEIGHT), 1.0)
}

/// The pixels of `count` whose middles may lie between the least and the largest of `at`, -1 to 1 across the picture.
fn range(at: [f64; 3], count: usize) -> std::ops::Range<usize> {
    let pixel = |x: f64| ((0.5 * x + 0.5) * count as f64).clamp(0.0, count as f64);
    let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
    (pixel(low).floor() as usize)..(pixel(high).ceil() as usize)
}

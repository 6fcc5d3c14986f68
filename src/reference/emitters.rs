//! What gives light, and how a place on it is drawn.

use crate::geometry::{Side, SurfaceId};
use crate::scene::{Geometry, SampledAppearance};
use glam::DVec3;

/// All that emits: sides of surfaces, and lights without a body.
pub struct Emitters {
    list: Vec<Emitter>,
    /// Sums of the chances, the last 1.
    cumulative: Vec<f64>,
    /// Chance of each surface's front and back.
    chance: Vec<[f64; 2]>,
}

/// Something that emits.
#[derive(Clone, Copy, Debug)]
enum Emitter {
    Surface(SurfaceId, Side),
    Light(usize),
}

/// What is asked for its light.
#[derive(Clone, Copy, Debug)]
pub enum Source {
    /// A place on a surface.
    Surface {
        /// The surface.
        id: SurfaceId,
        /// The place, m.
        position: DVec3,
        /// Unit, on the emitting side.
        normal: DVec3,
        /// Density of the place, 1/m².
        density: f64,
    },
    /// A light without a body.
    Light {
        /// Its number.
        k: usize,
        /// Chance with which it is asked.
        chance: f64,
    },
}

/// Front 0, back 1.
fn index(side: Side) -> usize {
    usize::from(side == Side::Back)
}

impl Emitters {
    /// Of a scene; each is drawn in proportion to its power.
    pub fn new(geometry: &Geometry, appearance: &SampledAppearance) -> Self {
        let y: Vec<f64> = appearance.wavelengths.xyz_weights.iter().map(|w| w[1].abs() + 1e-9).collect();
        let bright = |l: &[f32]| l.iter().zip(&y).map(|(l, y)| f64::from(*l) * y).sum::<f64>();
        let (mut list, mut power) = (Vec::new(), Vec::new());
        for s in 0..geometry.surfaces.len() {
            let id = SurfaceId(s as u32);
            let luminance = bright(&appearance.of(id).emission);
            let sides = if geometry.two_sided[s] { &[Side::Front, Side::Back][..] } else { &[Side::Front] };
            for &side in sides.iter().filter(|_| luminance > 0.0) {
                list.push(Emitter::Surface(id, side));
                power.push(luminance * geometry.surfaces[s].area * std::f64::consts::PI);
            }
        }
        for (k, (light, intensity)) in geometry.lights.iter().zip(&appearance.lights).enumerate() {
            if intensity.iter().any(|&i| i > 0.0) {
                list.push(Emitter::Light(k));
                power.push(bright(intensity) * light.flux_share());
            }
        }
        let total: f64 = power.iter().sum();
        // Half by power, half evenly: what is weak may still be all that a place sees.
        let even = 1.0 / list.len().max(1) as f64;
        let mut emitters =
            Emitters { list, cumulative: Vec::new(), chance: vec![[0.0; 2]; geometry.surfaces.len()] };
        let mut sum = 0.0;
        for (emitter, power) in emitters.list.iter().zip(&power) {
            let chance = 0.5 * (power / total + even);
            sum += chance;
            emitters.cumulative.push(sum);
            if let Emitter::Surface(id, side) = emitter {
                emitters.chance[id.index()][index(*side)] = chance;
            }
        }
        emitters
    }

    /// Whether nothing emits.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// One of them, and a place on it if it has a body, for three uniform numbers in [0, 1).
    pub fn draw(&self, geometry: &Geometry, u: [f64; 3]) -> Source {
        let last = self.list.len() - 1;
        let at = self.cumulative.partition_point(|&c| c <= u[0] * self.cumulative[last]).min(last);
        match self.list[at] {
            Emitter::Light(k) => {
                let below = if at == 0 { 0.0 } else { self.cumulative[at - 1] };
                Source::Light { k, chance: self.cumulative[at] - below }
            }
            Emitter::Surface(id, side) => {
                let position = place(geometry, id, u[1], u[2]);
                let front = geometry.surface(id).normal_at(position);
                let normal = if side == Side::Front { front } else { -front };
                let density = self.density(geometry, id, side, position);
                Source::Surface { id, position, normal, density }
            }
        }
    }

    /// Density of a place on a side of a surface, 1/m².
    pub fn density(&self, geometry: &Geometry, surface: SurfaceId, side: Side, place: DVec3) -> f64 {
        let of = geometry.surface(surface);
        // Drawn evenly over the parameters, which keep no areas on a patch.
        let area = of.round().map_or(of.area, |round| round.stretch(round.uv_of(place)));
        if area > 0.0 { self.chance[surface.index()][index(side)] / area } else { 0.0 }
    }
}

/// A place on a surface, uniform over its area, or over the parameters of what is no polygon.
fn place(geometry: &Geometry, id: SurfaceId, u: f64, v: f64) -> DVec3 {
    let surface = geometry.surface(id);
    match surface.round() {
        Some(round) => round.point_at(u, v),
        None => {
            let (triangles, count) = surface.triangles();
            let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
            let first =
                if count == 1 { 1.0 } else { area(triangles[0]) / (area(triangles[0]) + area(triangles[1])) };
            let ([a, b, c], u) = if u < first {
                (triangles[0], u / first)
            } else {
                (triangles[1], (u - first) / (1.0 - first))
            };
            let root = u.sqrt();
            a + root * (1.0 - v) * (b - a) + root * v * (c - a)
        }
    }
}

//! How a path goes on from a surface that it met.

use super::direct::carried;
use super::film::Film;
use super::lobe::{lobe_weight, reflect, refract, sample_facet};
use super::scatter::Scatterer;
use super::sequence::{TOGETHER, draw, draw_several};
use super::wave::{NO_MEDIUM, Path, Wave};
use crate::geometry::{Hit, Ray, Side};
use crate::material::{SampledMaterial, Transmission};
use glam::DVec3;

/// Events at glass at which both branches are followed; later ones follow one by chance.
const SPLITS: u32 = 2;

/// A place on a surface as a path meets it.
struct Meeting {
    position: DVec3,
    /// Towards where the path comes from, unit.
    i: DVec3,
    /// Unit normal on the side met, by which light is reflected and refracted.
    n: DVec3,
    /// That of the surface itself.
    facet: DVec3,
    cos: f64,
    side: Side,
    /// How far above the surface the path goes on, m; negative on the other side.
    offset: f64,
    /// By how much it starts aside, m.
    aside: DVec3,
    /// Index of the surface's material.
    material: u32,
    /// Whether lamps were asked for what its lobe reflects.
    asked: bool,
    path: Path,
    /// Uniform numbers of this event, in [0, 1): lobe (2), facet or branch, roulette.
    u: [f32; 4],
}

impl Scatterer<'_> {
    /// Sends on to `next` what leaves the surface that a path met.
    pub fn go_on(
        &self,
        ray: &Ray,
        hit: &Hit,
        path: Path,
        throughput: &[f32],
        film: &mut Film,
        next: &mut Wave,
    ) {
        let surface = self.geometry.surface(hit.surface);
        let material = self.appearance.of(hit.surface);
        let met = ray.at(hit.t);
        let normal = surface.normal_at(met);
        let facet = if hit.side == Side::Front { normal } else { -normal };
        let position = met - surface.distance(met) * normal;
        let glass = material.transmission.is_some();
        let i = -ray.direction;
        let eta = match &material.transmission {
            Some(Transmission::Solid { n, .. }) => Some(if hit.side == Side::Front { 1.0 / n } else { *n }),
            _ => None,
        };
        let n = self.shading.normal((surface, hit.surface, hit.side), position, (facet, i), eta);
        let seed = film.seeds[path.pixel as usize];
        // The rays of a rough lobe draw their own.
        let rough = !glass && material.m > 0.0;
        let u = if rough { [0.0; 4] } else { self.uniform(&path, seed) };
        let meeting = Meeting {
            position,
            i,
            n,
            facet,
            cos: n.dot(i).clamp(0.0, 1.0),
            side: hit.side,
            offset: self.offset[hit.surface.index()],
            aside: {
                let (centre, share) = self.inset[hit.surface.index()];
                share * (centre - position)
            },
            material: self.appearance.surface_material[hit.surface.index()].0,
            asked: self.manners[hit.surface.index()].gloss && path.medium == NO_MEDIUM,
            path: Path {
                density: f32::INFINITY,
                by_chance: path.by_chance || path.density < f32::INFINITY,
                ..path
            },
            u,
        };
        match &material.transmission {
            None if rough => self.lobe(&meeting, material, throughput, seed, film, next),
            None => {
                material.reflect.eval(meeting.cos as f32, &mut film.reflected);
                scale(&mut film.reflected, throughput, material.s as f32);
                self.send_reflected(&meeting, reflect(i, n), film, next);
            }
            Some(glass) => self.glass(&meeting, material, glass, throughput, film, next),
        }
    }

    /// Beer-Lambert along a segment inside a solid: the one the path entered, or, for a path
    /// that began inside, the one whose back it meets.
    #[cold]
    pub fn absorb(&self, hit: &Hit, path: &Path, met: DVec3, throughput: &mut [f32]) {
        let inside = match self.appearance.materials.get(path.medium as usize) {
            Some(entered) => entered,
            None if hit.side == Side::Back => self.appearance.of(hit.surface),
            None => return,
        };
        if let Some(Transmission::Solid { absorption, .. }) = &inside.transmission {
            let length = path.start.distance(self.geometry.surface(hit.surface).project(met));
            for (t, a) in throughput.iter_mut().zip(absorption) {
                *t *= (-f64::from(*a) * length).exp() as f32;
            }
        }
    }

    /// Rays that a rough lobe sends on.
    pub fn lobe_rays(&self, path: &Path) -> u32 {
        if path.glossy { 1 } else { self.settings.lobe_samples }
    }

    /// The normal by which a rough surface reflects, where it was hit at `position` from direction `i` on the side of
    /// `facet`.
    pub fn smooth(&self, hit: &Hit, position: DVec3, facet: DVec3, i: DVec3) -> DVec3 {
        let surface = self.geometry.surface(hit.surface);
        self.shading.normal((surface, hit.surface, hit.side), position, (facet, i), None)
    }

    /// Distributed rays in the Beckmann lobe.
    fn lobe(
        &self,
        at: &Meeting,
        material: &SampledMaterial,
        throughput: &[f32],
        seed: u32,
        film: &mut Film,
        next: &mut Wave,
    ) {
        let rays = self.lobe_rays(&at.path);
        let first = at.path.index * rays;
        let mut numbers = [[0.0; 4]; TOGETHER];
        for k in 0..rays {
            let mut path = Path { index: first + k, glossy: true, ..at.path };
            let which = k as usize % TOGETHER;
            if which == 0 {
                let count = TOGETHER.min((rays - k) as usize);
                draw_several(path.index, path.depth + 1, seed, &mut numbers[..count]);
            }
            let u = numbers[which];
            let about = |n: DVec3| {
                let h = sample_facet(at.i, n, material.m, [u[0], u[1], u[2]]);
                (n, h, reflect(at.i, h))
            };
            let (n, h, r) = match Some(about(at.n)).filter(|drawn| drawn.2.dot(at.facet) > 0.0) {
                Some(drawn) => {
                    if at.asked {
                        path.density = carried(at.i, drawn.1, drawn.0, material.m, rays);
                        path.by_chance = false;
                    }
                    drawn
                }
                None => about(at.facet),
            };
            let weight = lobe_weight(at.i, r, h, n);
            if weight > 0.0 {
                material.reflect.eval(at.i.dot(h) as f32, &mut film.reflected);
                let share = material.s * weight / f64::from(rays);
                scale(&mut film.reflected, throughput, share as f32);
                self.send_reflected(&Meeting { path, u, ..*at }, r, film, next);
            }
        }
    }

    /// Reflection and transmission at glass: both at the first [`SPLITS`] events of a path, then
    /// one, chosen by brightness.
    fn glass(
        &self,
        at: &Meeting,
        material: &SampledMaterial,
        glass: &Transmission,
        throughput: &[f32],
        film: &mut Film,
        next: &mut Wave,
    ) {
        let cos = at.cos as f32;
        let mut beyond = at.path;
        let onward = match glass {
            Transmission::Pane { transmit } => {
                material.reflect.eval(cos, &mut film.reflected);
                transmit.eval(cos, &mut film.transmitted);
                scale(&mut film.transmitted, throughput, 1.0);
                Some(-at.i)
            }
            Transmission::Solid { n: index, .. } => {
                let entering = at.side == Side::Front;
                let eta = if entering { 1.0 / index } else { *index };
                let onward = refract(at.i, at.n, eta);
                // The factor is the same both ways; against the cosine outside it is smooth, where
                // against the one inside it is vertical at the critical angle.
                let outside = if entering { Some(at.cos) } else { onward.map(|d| -at.n.dot(d)) };
                match outside {
                    Some(cos) => material.reflect.eval(cos as f32, &mut film.reflected),
                    None => film.reflected.fill(1.0),
                }
                // Radiance over n² is what stays on the way through.
                let squeeze = (eta * eta) as f32;
                for ((out, r), t) in film.transmitted.iter_mut().zip(&film.reflected).zip(throughput) {
                    *out = t * squeeze * (1.0 - r).max(0.0);
                }
                beyond.medium = if entering { at.material } else { NO_MEDIUM };
                onward
            }
        };
        scale(&mut film.reflected, throughput, 1.0);
        let Some(onward) = onward else {
            self.send_reflected(at, reflect(at.i, at.n), film, next);
            return;
        };
        let both = at.path.splits < SPLITS;
        let path = Path { splits: at.path.splits + 1, ..at.path };
        beyond.splits += 1;
        // What a path brings home is its radiance over n²: by radiance alone, chances and weights would not go together,
        // and even uniform light would look noisy through glass.
        let bright = self.importance(&film.reflected, path.medium);
        let through = self.importance(&film.transmitted, beyond.medium);
        let chance = if both { 1.0 } else { bright / (bright + through) };
        if both || at.u[2] < chance {
            film.reflected.iter_mut().for_each(|r| *r /= chance);
            self.send_reflected(&Meeting { path, ..*at }, reflect(at.i, at.n), film, next);
        }
        if both || at.u[2] >= chance {
            let chance = if both { 1.0 } else { 1.0 - chance };
            film.transmitted.iter_mut().for_each(|t| *t /= chance);
            let transmitted = std::mem::take(&mut film.transmitted);
            let met = Meeting { path: beyond, offset: -at.offset, ..*at };
            film.stats.transmitted_rays += u64::from(self.send(&met, onward, &transmitted, film, next));
            film.transmitted = transmitted;
        }
    }

    fn send_reflected(&self, at: &Meeting, direction: DVec3, film: &mut Film, next: &mut Wave) {
        let reflected = std::mem::take(&mut film.reflected);
        film.stats.reflected_rays += u64::from(self.send(at, direction, &reflected, film, next));
        film.reflected = reflected;
    }

    /// Sends a path on unless it ends here; says whether it did.
    fn send(
        &self,
        at: &Meeting,
        direction: DVec3,
        throughput: &[f32],
        film: &mut Film,
        next: &mut Wave,
    ) -> bool {
        let bright = self.importance(throughput, at.path.medium);
        if bright.is_nan() || bright <= 0.0 {
            return false;
        }
        if at.path.depth >= self.settings.max_depth {
            film.stats.paths_cut += 1;
            film.stats.cut_share += f64::from(bright);
            return false;
        }
        let survival = if f64::from(bright) < self.settings.tolerance {
            bright / self.settings.tolerance as f32
        } else {
            1.0
        };
        if at.u[3] >= survival {
            film.stats.paths_ended += 1;
            return false;
        }
        let origin = at.position + at.aside + at.offset * at.facet;
        let ray = Ray { origin, direction, t_min: 0.0, t_max: f64::INFINITY };
        let path = Path { start: at.position, depth: at.path.depth + 1, ..at.path };
        next.push(ray, path, throughput.iter().map(|t| t / survival));
        true
    }

    /// The numbers of a path's next event.
    fn uniform(&self, path: &Path, seed: u32) -> [f32; 4] {
        draw(path.index, path.depth + 1, seed)
    }
}

fn scale(values: &mut [f32], throughput: &[f32], factor: f32) {
    for (v, t) in values.iter_mut().zip(throughput) {
        *v *= t * factor;
    }
}

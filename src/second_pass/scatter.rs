//! What becomes of a path where it meets a surface.

use super::direct::{Direct, Shadows, carried};
use super::interpolate::Apart;
use super::ladder::{Ladder, NEARBY};
use super::lobe::{lobe_weight, reflect, refract, sample_facet};
use super::parted::Weights;
use super::sequence::{TOGETHER, draw, draw_several};
use super::settings::{Passes, SecondPassSettings, SecondPassStats};
use super::shading::Shading;
use super::take::{Manner, Take};
use super::wave::{NO_MEDIUM, Path, Wave, inset, ray_offset};
use crate::geometry::{Hit, Ray, Side, SurfaceId};
use crate::material::{SampledMaterial, Transmission};
use crate::scene::{Geometry, SampledAppearance};
use crate::simd::widest;
use glam::DVec3;

/// Events at glass at which both branches are followed; later ones follow one by chance.
const SPLITS: u32 = 2;

/// A lobe of less slope than this asks no lamps: its own rays meet what it shows.
pub const ROUGH: f64 = 0.01;

/// The parts of a render that all tiles share.
pub(super) struct Scatterer<'a> {
    pub geometry: &'a Geometry,
    pub appearance: &'a SampledAppearance,
    pub ladder: Ladder<'a>,
    pub settings: &'a SecondPassSettings,
    /// By surface.
    pub manners: Vec<Manner>,
    /// Smooth normals of what is specular.
    shading: Shading,
    /// Hemisphere rays that end on a surface after no more than this end nearby, by surface, m.
    nearby: Vec<f64>,
    /// How far above a surface rays start, by surface, m.
    offset: Vec<f64>,
    /// Towards which place rays start aside, and by which share of the way, by surface: what is met just beyond an edge would
    /// else begin on the wrong side of the surface that joins there.
    inset: Vec<(DVec3, f64)>,
    /// Share of each wavelength in the brightness by which paths are chosen, sum 1.
    brightness: Vec<f32>,
}

/// Where a tile gathers its light, and room to work in.
pub(super) struct Film {
    /// Sum over the samples, `[pixels][W]`.
    pub radiance: Vec<f64>,
    /// Counts of the tile.
    pub stats: SecondPassStats,
    /// Sobol' seed of each pixel.
    pub seeds: Vec<u32>,
    pub value: Vec<f32>,
    reflected: Vec<f32>,
    transmitted: Vec<f32>,
    pub weights: Weights,
    /// Which paths of the wave may go on.
    pub going_on: Vec<u32>,
    /// Those whose place is parted from some of what is around it.
    pub parted: Vec<(u32, bool, Apart)>,
    /// Paths at places that ask lamps.
    pub lit: Vec<u32>,
    /// Those among them that gather, on a rung that does.
    pub gathering: Vec<u32>,
    /// Paths at places whose emission is still to be added.
    pub glowing: Vec<u32>,
    /// Paths that left the scene and see the sky.
    pub missed: Vec<u32>,
    /// Room for what lamps are asked.
    pub shadows: Shadows,
}

impl Film {
    /// An unlit film of `pixels` with `w` wavelengths.
    pub fn new(seeds: Vec<u32>, w: usize) -> Self {
        Film {
            radiance: vec![0.0; seeds.len() * w],
            stats: SecondPassStats::default(),
            seeds,
            value: vec![0.0; w],
            reflected: vec![0.0; w],
            transmitted: vec![0.0; w],
            weights: Weights::default(),
            going_on: Vec::new(),
            parted: Vec::new(),
            lit: Vec::new(),
            gathering: Vec::new(),
            glowing: Vec::new(),
            missed: Vec::new(),
            shadows: Shadows::default(),
        }
    }
}

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

impl<'a> Scatterer<'a> {
    pub fn new(
        geometry: &'a Geometry,
        appearance: &'a SampledAppearance,
        ladder: Ladder<'a>,
        spacing: impl Fn(SurfaceId) -> f64,
        settings: &'a SecondPassSettings,
    ) -> Self {
        let surfaces = || (0..geometry.surfaces.len()).map(|s| SurfaceId(s as u32));
        let offset: Vec<f64> = surfaces().map(|s| ray_offset(geometry, s)).collect();
        let inset = surfaces().zip(&offset).map(|(s, offset)| inset(geometry, s, *offset)).collect();
        let asks = ladder.direct.is_some();
        let manners = surfaces().map(|s| {
            let material = appearance.of(s);
            let glass = &material.transmission;
            let diffuse = material.diffuse.iter().any(|&d| d > 0.0);
            Manner {
                black_behind: glass.is_none() && !geometry.two_sided[s.index()],
                solid: matches!(glass, Some(Transmission::Solid { .. })),
                goes_on: settings.passes == Passes::Both && material.is_specular(),
                asks: asks && ladder.lamps_apart && diffuse,
                gathers: ladder.far.is_some() && diffuse,
                gloss: asks
                    && settings.passes == Passes::Both
                    && glass.is_none()
                    && material.is_specular()
                    && material.m >= ROUGH,
                glows: material.emission.iter().any(|&l| l > 0.0),
                glows_apart: ladder.lamps_apart,
            }
        });
        let manners: Vec<Manner> = manners.collect();
        Scatterer {
            shading: Shading::new(geometry, |s| manners[s.index()].goes_on),
            manners,
            geometry,
            appearance,
            nearby: surfaces().map(|s| NEARBY * spacing(s)).collect(),
            ladder,
            settings,
            offset,
            inset,
            brightness: brightness(&appearance.wavelengths.xyz_weights),
        }
    }

    /// Adds what the paths of `wave` see at `hits` to the film, and fills `next` with what they send on. Rays are
    /// unit; throughputs are spent.
    pub fn meet(&self, wave: &mut Wave, hits: &[Option<Hit>], film: &mut Film, next: &mut Wave) {
        next.clear();
        film.going_on.clear();
        film.lit.clear();
        film.gathering.clear();
        film.glowing.clear();
        film.missed.clear();
        widest(Take { scatterer: self, wave, hits, film });
        let w = film.value.len();
        self.see_sky(wave, film);
        if let Some(direct) = &self.ladder.direct {
            self.glow(direct, wave, hits, film);
            direct.add(self, wave, hits, film);
        }
        if self.ladder.far.is_some() {
            wave.spell_out(w);
            self.gather(wave, hits, film, next);
        }
        let going_on = std::mem::take(&mut film.going_on);
        let whole = vec![1.0; w];
        for k in going_on.iter().map(|&k| k as usize) {
            let throughput = wave.throughput.get(k * w..(k + 1) * w).unwrap_or(&whole);
            if let Some(hit) = &hits[k] {
                self.go_on(&wave.rays[k], hit, wave.path(k), throughput, film, next);
            }
        }
        film.going_on = going_on;
    }

    /// Adds to the film what paths see that leave the scene.
    fn see_sky(&self, wave: &Wave, film: &mut Film) {
        let Some(sky) = &self.appearance.sky else { return };
        let w = film.value.len();
        for k in film.missed.iter().map(|&k| k as usize) {
            let sums = film.radiance[wave.pixel(k) * w..][..w].iter_mut();
            let seen = sums.zip(sky.radiance(wave.rays[k].direction));
            match wave.throughput.get(k * w..(k + 1) * w) {
                None => seen.for_each(|(sum, l)| *sum += f64::from(l)),
                Some(t) => seen.zip(t).for_each(|((sum, l), t)| *sum += f64::from(t * l)),
            }
        }
    }

    /// Adds to the film what the places emit that paths meet, as far as it is to be found so and not there yet.
    fn glow(&self, direct: &Direct, wave: &Wave, hits: &[Option<Hit>], film: &mut Film) {
        let w = film.value.len();
        for k in film.glowing.iter().map(|&k| k as usize) {
            let Some(hit) = &hits[k] else { continue };
            let met = (&wave.rays[k], wave.density(k));
            let by_ray = direct.share_by_ray(met, hit, &mut film.shadows.chances);
            let share = if self.ladder.lamps_apart { by_ray } else { by_ray - 1.0 };
            let emission = self.appearance.of(hit.surface).emission.iter();
            let sums = film.radiance[wave.pixel(k) * w..][..w].iter_mut().zip(emission);
            match wave.throughput.get(k * w..(k + 1) * w) {
                None => sums.for_each(|(sum, l)| *sum += f64::from(share * l)),
                Some(t) => sums.zip(t).for_each(|((sum, l), t)| *sum += f64::from(share * t * l)),
            }
        }
    }

    /// Sends on to `next` what leaves the surface that a path met.
    fn go_on(&self, ray: &Ray, hit: &Hit, path: Path, throughput: &[f32], film: &mut Film, next: &mut Wave) {
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
            path: Path { density: f32::INFINITY, ..path },
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

    /// The normal by which a rough surface reflects, where it was hit at `position` from direction `i` on the side of `facet`.
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

    /// [`Scatterer::bright`] of what a path in a medium would carry outside it.
    fn importance(&self, throughput: &[f32], medium: u32) -> f32 {
        let solid = self.appearance.materials.get(medium as usize).and_then(|m| m.transmission.as_ref());
        let n2 = match solid {
            Some(Transmission::Solid { n, .. }) => (n * n) as f32,
            _ => 1.0,
        };
        n2 * self.bright(throughput)
    }

    fn bright(&self, throughput: &[f32]) -> f32 {
        throughput.iter().zip(&self.brightness).map(|(t, b)| t * b).sum()
    }

    /// [`Scatterer::bright`] of what is left of a throughput where this share is reflected.
    pub fn bright_of(&self, throughput: &[f32], share: &[f32]) -> f32 {
        throughput.iter().zip(share).zip(&self.brightness).map(|((t, s), b)| t * s * b).sum()
    }

    /// By how much a ray starts beside a place on a surface, on the side of `n`.
    pub fn start(&self, surface: SurfaceId, position: DVec3, n: DVec3) -> DVec3 {
        let (centre, share) = self.inset[surface.index()];
        share * (centre - position) + self.offset[surface.index()] * n
    }

    /// No longer hemisphere ray that ends on a surface ends nearby, m.
    #[inline(always)]
    pub fn nearby(&self, surface: SurfaceId) -> f64 {
        self.nearby[surface.index()]
    }
}

fn scale(values: &mut [f32], throughput: &[f32], factor: f32) {
    for (v, t) in values.iter_mut().zip(throughput) {
        *v *= t * factor;
    }
}

/// Weights by which the brightness of a throughput is judged: how much each wavelength matters to
/// X, Y and Z together, and for none nothing, so that no light can be dropped.
pub(super) fn brightness(xyz: &[[f64; 3]]) -> Vec<f32> {
    let matter: Vec<f64> = xyz.iter().map(|w| w.iter().map(|x| x.abs()).sum()).collect();
    let total: f64 = matter.iter().sum();
    let even = 1.0 / matter.len() as f64;
    let share = |m: f64| if total > 0.0 { m / total } else { even };
    matter.into_iter().map(|m| (0.9 * share(m) + 0.1 * even) as f32).collect()
}

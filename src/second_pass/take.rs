//! The diffuse light that the paths of a wave meet.

use super::interpolate::Found;
use super::scatter::{Film, Scatterer};
use super::shares::Mix;
use super::wave::{Fresh, NO_MEDIUM, Wave};
use crate::geometry::{Hit, Side};
use crate::simd::HotLoop;

/// Hits that are looked up before the spectra of any are blended: two loops, each on one subject.
const BLOCK: usize = 64;

/// What a path that meets a surface may have to do besides taking its diffuse light.
#[derive(Clone, Copy)]
pub(super) struct Manner {
    /// Whether its back is black, and only blocks.
    pub black_behind: bool,
    /// Whether what is behind it absorbs.
    pub solid: bool,
    /// Whether the path may go on.
    pub goes_on: bool,
    /// Whether it asks lamps for light, and gathers.
    pub asks: bool,
    /// Whether its lobe is rough, and asks lamps for light.
    pub gloss: bool,
    /// Whether it emits.
    pub glows: bool,
    /// Whether that is not part of the field at a hit.
    pub glows_apart: bool,
}

/// Adds to the film what all paths of a wave meet, and notes which may go on.
pub(super) struct Take<'a, 'b> {
    pub scatterer: &'a Scatterer<'b>,
    pub wave: &'a mut Wave,
    pub hits: &'a [Option<Hit>],
    pub film: &'a mut Film,
}

/// What a path takes to its pixel.
#[derive(Clone, Copy, Default)]
struct Taken {
    path: u32,
    pixel: u32,
    /// Whether from the field for hemisphere rays that end far away.
    far: bool,
    mix: Mix,
}

impl HotLoop for Take<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let w = self.film.value.len();
        let mut taken = [Taken::default(); BLOCK];
        for first in (0..self.hits.len()).step_by(BLOCK) {
            let count = self.look_up(first, &mut taken);
            let (wave, film) = (&*self.wave, &mut *self.film);
            for Taken { path, pixel, far, mix } in &taken[..count] {
                let sums = &mut film.radiance[*pixel as usize * w..][..w];
                let field = self.scatterer.ladder.field(*far);
                if wave.fresh.is_some() {
                    field.blend(mix, |at, group| {
                        for (sum, l) in sums[at..at + group.len()].iter_mut().zip(group) {
                            *sum += f64::from(*l);
                        }
                    });
                } else {
                    let throughput = &wave.throughput[*path as usize * w..][..w];
                    field.blend(mix, |at, group| {
                        let end = at + group.len();
                        for ((sum, t), l) in sums[at..end].iter_mut().zip(&throughput[at..end]).zip(group) {
                            *sum += f64::from(t * l);
                        }
                    });
                }
            }
        }
        self.parted();
    }
}

impl Take<'_, '_> {
    /// What the paths from `first` on take, and how many take something.
    #[inline(always)]
    fn look_up(&mut self, first: usize, taken: &mut [Taken; BLOCK]) -> usize {
        let Take { scatterer, wave, hits, film } = self;
        let w = film.value.len();
        let end = hits.len().min(first + BLOCK);
        let (mut pixel, mut point) = match wave.fresh {
            Some(Fresh { count, .. }) => (first as u32 / count, first as u32 % count),
            None => (0, 0),
        };
        let mut count = 0;
        for k in first..end {
            let (mut medium, mut bounces) = (NO_MEDIUM, 0);
            let own = match wave.fresh {
                Some(fresh) => {
                    let own = pixel;
                    point += 1;
                    if point == fresh.count {
                        (pixel, point) = (pixel + 1, 0);
                    }
                    own
                }
                None => {
                    (medium, bounces) = (wave.paths[k].medium, wave.paths[k].bounces);
                    wave.paths[k].pixel
                }
            };
            let Some(hit) = &hits[k] else {
                film.stats.missed_rays += 1;
                // What hemisphere rays would see of the sky is part of the field at their start.
                if scatterer.appearance.sky.is_some() && bounces == 0 {
                    film.missed.push(k as u32);
                }
                continue;
            };
            let manner = scatterer.manners[hit.surface.index()];
            let (back, met) = (hit.side == Side::Back, wave.rays[k].at(hit.t));
            if medium != NO_MEDIUM || (back && manner.solid) {
                wave.spell_out(w);
                scatterer.absorb(hit, &wave.path(k), met, &mut wave.throughput[k * w..][..w]);
            }
            if back && manner.black_behind {
                continue;
            }
            if manner.goes_on && bounces == 0 {
                film.going_on.push(k as u32);
            }
            let far = bounces > 0 && scatterer.is_far(bounces, hit);
            if manner.asks || manner.gloss && bounces == 0 {
                film.lit.push(k as u32);
            }
            if manner.asks && !far {
                film.gathering.push(k as u32);
            }
            if manner.glows && bounces == 0 && (manner.glows_apart || wave.density(k) < f32::INFINITY) {
                film.glowing.push(k as u32);
            }
            match scatterer.ladder.near.find(hit.surface, hit.side, met) {
                Found::Black => {}
                Found::Whole(mix) => {
                    taken[count] = Taken { path: k as u32, pixel: own, far, mix };
                    count += 1;
                }
                Found::Parted(apart) => film.parted.push((k as u32, far, apart)),
            }
        }
        count
    }

    /// What the paths take whose places something may part from some of what is around them.
    #[inline(always)]
    fn parted(&mut self) {
        let Take { scatterer, wave, film, .. } = self;
        let w = film.value.len();
        for (k, far, apart) in film.parted.drain(..) {
            let k = k as usize;
            scatterer.ladder.field(far).part(&apart, &mut film.value, &mut film.weights);
            let sums = &mut film.radiance[wave.pixel(k) * w..][..w];
            match wave.throughput.get(k * w..(k + 1) * w) {
                None => sums.iter_mut().zip(&film.value).for_each(|(sum, l)| *sum += f64::from(*l)),
                Some(throughput) => {
                    for ((sum, t), l) in sums.iter_mut().zip(throughput).zip(&film.value) {
                        *sum += f64::from(t * l);
                    }
                }
            }
        }
    }
}

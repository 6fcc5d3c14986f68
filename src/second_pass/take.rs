//! The diffuse light that the paths of a wave meet.

use super::chart::LANES;
use super::film::Film;
use super::interpolate::{Found, Taken};
use super::scatter::Scatterer;
use super::shares::Shares;
use super::wave::{NO_MEDIUM, Wave};
use crate::geometry::{Hit, Side};
use crate::simd::HotLoop;
use glam::{DVec2, DVec3};
use std::ops::Range;

/// What a path that meets a surface may have to do besides taking its diffuse light.
#[derive(Clone, Copy)]
pub(super) struct Manner {
    /// Whether its back is black, and only blocks.
    pub black_behind: bool,
    /// Whether what is behind it absorbs.
    pub solid: bool,
    /// Whether the path may go on.
    pub goes_on: bool,
    /// Whether it asks lamps for what it reflects diffusely.
    pub asks: bool,
    /// Whether it gathers what falls on it.
    pub gathers: bool,
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

/// What several paths take to their pixel, all of the same element's centre and nodes.
#[derive(Default)]
struct Sum {
    pixel: usize,
    element: u32,
    nodes: [u32; 3],
    /// On the centre and the nodes; all zero for nothing.
    weights: [f64; 4],
}

impl HotLoop for Take<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let mut sum = Sum::default();
        let mut from = 0;
        while let Some(first) = self.hits.get(from) {
            let of = |hit: &Option<Hit>| hit.map(|hit| (hit.surface, hit.side));
            let alike = self.hits[from..].iter().take(LANES).take_while(|hit| of(hit) == of(first));
            let run = from..from + alike.count();
            from = run.end;
            match first {
                Some(hit) if self.goes_by_run(hit) => self.take_run(run, hit, &mut sum),
                _ => {
                    for k in run {
                        self.take(k);
                    }
                }
            }
        }
        self.add(&sum);
        self.parted();
    }
}

impl Take<'_, '_> {
    /// Whether paths that meet the side of the surface that `hit` is on all do the same there.
    #[inline(always)]
    fn goes_by_run(&self, hit: &Hit) -> bool {
        self.wave.fresh.is_some()
            && !(hit.side == Side::Back && self.scatterer.manners[hit.surface.index()].solid)
    }

    /// What the fresh paths of `run` take, which all meet the side of the surface that `hit` is on.
    #[inline(always)]
    fn take_run(&mut self, run: Range<usize>, hit: &Hit, sum: &mut Sum) {
        let manner = self.scatterer.manners[hit.surface.index()];
        if hit.side == Side::Back && manner.black_behind {
            return;
        }
        let film = &mut *self.film;
        let numbers = run.start as u32..run.end as u32;
        if manner.goes_on {
            film.going_on.extend(numbers.clone());
        }
        if manner.asks || manner.gloss {
            film.lit.extend(numbers.clone());
        }
        if manner.gathers {
            film.gathering.extend(numbers.clone());
        }
        if manner.glows && manner.glows_apart {
            film.glowing.extend(numbers);
        }
        let mut places = [[0.0; LANES]; 3];
        let met = self.wave.rays[run.clone()].iter().zip(&self.hits[run.clone()]);
        for (lane, (ray, hit)) in met.enumerate().take(LANES) {
            let at = ray.at(hit.map_or(0.0, |hit| hit.t));
            [places[0][lane], places[1][lane], places[2][lane]] = at.to_array();
        }
        let near = self.scatterer.ladder.near;
        let (chart, sheet) = near.side(hit.surface, hit.side);
        let uv = chart.uv_of_all(&places);
        let per_pixel = self.wave.fresh.map_or(1, |fresh| fresh.count as usize);
        let mut pixel = self.wave.pixel(run.start);
        let mut left = per_pixel - run.start % per_pixel;
        if left >= run.len()
            && let Some((element, nodes, weights)) = near.find_alike(sheet, &uv, run.len())
        {
            self.sum_up(sum, (pixel, element, nodes), weights);
            return;
        }
        for lane in 0..run.len() {
            if left == 0 {
                (pixel, left) = (pixel + 1, per_pixel);
            }
            left -= 1;
            let at = DVec3::new(places[0][lane], places[1][lane], places[2][lane]);
            match near.find_at(chart, sheet, at, DVec2::new(uv[0][lane], uv[1][lane])) {
                Found::Black => {}
                Found::Parted(apart) => self.film.parted.push(((run.start + lane) as u32, false, apart)),
                Found::Whole(taken) => {
                    let Taken { element, shares: Shares { centre, nodes, weights: [a, b, c] } } = taken;
                    self.sum_up(sum, (pixel, element, nodes), [centre, a, b, c].map(f64::from));
                }
            }
        }
    }

    /// Adds these weights to a sum, if it is of these pixel, element and nodes; else the sum to the film, and begins
    /// one of these.
    #[inline(always)]
    fn sum_up(&mut self, sum: &mut Sum, of: (usize, u32, [u32; 3]), weights: [f64; 4]) {
        if of != (sum.pixel, sum.element, sum.nodes) {
            self.add(sum);
            let (pixel, element, nodes) = of;
            *sum = Sum { pixel, element, nodes, weights: [0.0; 4] };
        }
        sum.weights.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
    }

    /// Adds a sum to the film.
    #[inline(always)]
    fn add(&mut self, sum: &Sum) {
        let Sum { pixel, element, nodes, weights } = *sum;
        let [centre, weights @ ..] = weights.map(|weight| weight as f32);
        let taken = Taken { element, shares: Shares { centre, nodes, weights } };
        if sum.weights == [0.0; 4] {
            return;
        }
        let w = self.film.value.len();
        let sums = &mut self.film.radiance[pixel * w..][..w];
        self.scatterer.ladder.near.blend(&taken, |at, group| {
            for (sum, l) in sums[at..at + group.len()].iter_mut().zip(group) {
                *sum += f64::from(*l);
            }
        });
    }

    /// What path `k` takes.
    #[inline(always)]
    fn take(&mut self, k: usize) {
        let Take { scatterer, wave, hits, film } = self;
        let w = film.value.len();
        let (medium, bounces) = match wave.fresh {
            Some(_) => (NO_MEDIUM, 0),
            None => (wave.paths[k].medium, wave.paths[k].bounces),
        };
        let Some(hit) = &hits[k] else {
            film.stats.missed_rays += 1;
            // What hemisphere rays would see of the sky is part of the field at their start.
            if scatterer.appearance.sky.is_some() && bounces == 0 {
                film.missed.push(k as u32);
            }
            return;
        };
        let manner = scatterer.manners[hit.surface.index()];
        let (back, met) = (hit.side == Side::Back, wave.rays[k].at(hit.t));
        if medium != NO_MEDIUM || (back && manner.solid) {
            wave.spell_out(w);
            scatterer.absorb(hit, &wave.path(k), met, &mut wave.throughput[k * w..][..w]);
        }
        if back && manner.black_behind {
            return;
        }
        if manner.goes_on && bounces == 0 {
            film.going_on.push(k as u32);
        }
        let far = bounces > 0 && scatterer.is_far(bounces, hit);
        if manner.asks || manner.gloss && bounces == 0 {
            film.lit.push(k as u32);
        }
        if manner.gathers && !far {
            film.gathering.push(k as u32);
        }
        // The field has the whole of it where a lobe's ray may bring less.
        let less = || wave.density(k) < f32::INFINITY || wave.by_chance(k);
        if manner.glows && bounces == 0 && (manner.glows_apart || less()) {
            film.glowing.push(k as u32);
        }
        match scatterer.ladder.near.find(hit.surface, hit.side, met) {
            Found::Black => {}
            Found::Whole(taken) => {
                // Fresh paths come here only where they meet nothing, or have just been spelled out.
                let throughput = &wave.throughput[k * w..][..w];
                let sums = &mut film.radiance[wave.pixel(k) * w..][..w];
                scatterer.ladder.field(far).blend(&taken, |at, group| {
                    let end = at + group.len();
                    for ((sum, t), l) in sums[at..end].iter_mut().zip(&throughput[at..end]).zip(group) {
                        *sum += f64::from(t * l);
                    }
                });
            }
            Found::Parted(apart) => film.parted.push((k as u32, far, apart)),
        }
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

//! Light asked of emitters: one drawn, a segment to it, and whether that is free.

use super::emitters::Source;
use super::path::Tracing;
use crate::second_pass::power_heuristic;
use crate::tracers::Segment;
use crate::visibility::Passages;
use glam::DVec3;

/// An emitter as a place asks it.
pub struct Ask<'a> {
    /// What must be free up to here for the light to arrive, m.
    pub end: DVec3,
    /// Unit, from the place towards it.
    pub direction: DVec3,
    /// Radiance, or the amount of a light without a body: `[W]`.
    pub emission: &'a [f32],
    from: From,
}

/// How likely it is to be found.
enum From {
    /// A place on a surface, of this density of directions, 1/sr.
    Surface(f64),
    /// A light without a body, which no ray meets: irradiance of a plane that faces it over its amount and the chance
    /// with which it is asked.
    Light(f64),
}

impl Ask<'_> {
    /// What the emission counts for where a path would have been sent this way with a `density`, 1/sr.
    pub fn factor(&self, density: f64) -> f64 {
        match self.from {
            From::Surface(own) => power_heuristic(own, density) / own,
            From::Light(share) => share,
        }
    }
}

/// Segments to emitters, and what would come along them.
#[derive(Default)]
pub struct Asks {
    segments: Vec<Segment>,
    /// Whose light it is.
    targets: Vec<u32>,
    /// `[segments][W]`.
    pub light: Vec<f64>,
    /// Segments to lights without a body, their number and both ends: panes may let these through.
    beams: Vec<(usize, DVec3, DVec3)>,
}

impl Asks {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.segments.clear();
        self.targets.clear();
        self.light.clear();
        self.beams.clear();
    }

    /// Adds the way from a place to what it asked; its light must be there already.
    pub fn push(&mut self, from: DVec3, ask: &Ask, target: u32) {
        if let From::Light(_) = ask.from {
            self.beams.push((self.segments.len(), from, ask.end));
        }
        self.segments.push(Segment { from: from.as_vec3(), to: ask.end.as_vec3() });
        self.targets.push(target);
    }

    /// Adds what arrives to the sums of the targets, `[targets][W]`. Returns how many rays it took.
    pub fn arrive(&mut self, tracing: &Tracing, sums: &mut [f64]) -> u64 {
        let w = tracing.wavelengths();
        let mut blocked = vec![false; self.segments.len()];
        tracing.tracer.occluded_batch(&self.segments, &mut blocked);
        for &(k, from, to) in &self.beams {
            if blocked[k]
                && let Some(through) =
                    Passages::light(tracing.geometry, tracing.appearance, tracing.tracer, from, to)
            {
                self.light[k * w..][..w].iter_mut().zip(through).for_each(|(l, t)| *l *= f64::from(t));
                blocked[k] = false;
            }
        }
        for ((target, light), _) in
            self.targets.iter().zip(self.light.chunks_exact(w)).zip(&blocked).filter(|(_, b)| !**b)
        {
            let sum = &mut sums[*target as usize * w..][..w];
            sum.iter_mut().zip(light).for_each(|(sum, l)| *sum += l);
        }
        self.segments.len() as u64
    }
}

impl Tracing<'_> {
    /// Draws an emitter, and a place on it, for a place that looks along `normal`; `None` where it shows that place
    /// nothing.
    pub fn draw(&self, position: DVec3, normal: DVec3, u: [f64; 4]) -> Option<Ask<'_>> {
        if self.emitters.is_empty() {
            return None;
        }
        let source = self.emitters.draw(self.geometry, [u[0], u[1], u[2]]);
        let (end, direction) = match source {
            Source::Surface { position: place, .. } => (place, (place - position).normalize_or_zero()),
            Source::Light { k, .. } => {
                let way = self.geometry.lights[k].drawn_from(position, u[1], u[2]);
                (way.end, way.direction)
            }
        };
        let cosine = normal.dot(direction);
        if cosine.is_nan() || cosine <= 0.0 {
            return None;
        }
        let (emission, from) = match source {
            Source::Surface { id, normal, density, .. } => {
                let cosine = -normal.dot(direction);
                if cosine <= 0.0 {
                    return None;
                }
                let distance = end.distance(position);
                (&self.appearance.of(id).emission, From::Surface(density * distance * distance / cosine))
            }
            Source::Light { k, chance } => {
                let share = self.geometry.lights[k].seen_from(position).share;
                (&self.appearance.lights[k], From::Light(share / chance))
            }
        };
        Some(Ask { end, direction, emission, from })
    }
}

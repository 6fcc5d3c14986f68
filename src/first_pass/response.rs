//! What points make of the light that falls on them, but for lobes.

use crate::geometry::Side;
use crate::points::{NO_POINT, SamplePoints};
use crate::scene::SampledAppearance;
use std::f32::consts::FRAC_1_PI;

/// What points make of the light that falls on them, but for lobes.
pub struct Response {
    /// ρ: the share that goes back evenly from the same side, `[W][N]`.
    pub reflectance: Vec<f32>,
    /// Whether it matters what falls on a point.
    pub active: Vec<bool>,
    /// The share that leaves evenly from the other side, `[W][N]`; empty where there is no such point.
    through: Vec<f32>,
    /// The point on the other side of each, or [`NO_POINT`].
    twin: Vec<u32>,
}

impl Response {
    /// Of `points` under `appearance`.
    pub fn new(points: &SamplePoints, appearance: &SampledAppearance) -> Response {
        let (n, w) = (points.len(), appearance.wavelengths.len());
        let spreads = appearance.materials.iter().any(|m| m.spread.is_some());
        let mut reflectance = vec![0.0; n * w];
        let mut through = vec![0.0; if spreads { n * w } else { 0 }];
        for i in 0..n {
            let material = appearance.of(points.surface[i]);
            let (mut back, mut on) = (&material.diffuse, None);
            if let Some(spread) = &material.spread {
                match points.side[i] {
                    Side::Front => on = Some(&spread.inwards),
                    Side::Back => (back, on) = (&spread.inside, Some(&spread.outwards)),
                }
            }
            for k in 0..w {
                reflectance[k * n + i] = back[k];
                if let Some(on) = on.filter(|_| points.twin[i] != NO_POINT) {
                    through[k * n + i] = on[k];
                }
            }
        }
        let matters = |at: usize| reflectance[at] > 0.0 || through.get(at).is_some_and(|&t| t > 0.0);
        let active = (0..n).map(|i| (0..w).any(|k| matters(k * n + i))).collect();
        Response { reflectance, active, through, twin: points.twin.clone() }
    }

    /// What leaves points by the irradiance `[W][N]` of all, W m⁻² sr⁻¹ nm⁻¹: `[W][N]`.
    pub fn leaving(&self, irradiance: &[f32]) -> Vec<f32> {
        let back = irradiance.iter().zip(&self.reflectance).map(|(e, rho)| e * rho * FRAC_1_PI);
        let mut leaving: Vec<f32> = back.collect();
        let n = self.twin.len();
        for (at, (on, e)) in self.through.iter().zip(irradiance).enumerate().filter(|(_, (on, _))| **on > 0.0)
        {
            leaving[at - at % n + self.twin[at % n] as usize] += e * on * FRAC_1_PI;
        }
        leaving
    }

    /// The share of what falls on point `i` that leaves again at wavelength `k`.
    pub fn turned(&self, k: usize, i: usize) -> f64 {
        let at = k * self.twin.len() + i;
        f64::from(self.reflectance[at]) + self.through.get(at).map_or(0.0, |&on| f64::from(on))
    }

    /// The point on the other side of `i` and the share of what falls on `i` that leaves there at wavelength `k`; `None`
    /// where nothing does.
    pub fn passed(&self, k: usize, i: usize) -> Option<(usize, f32)> {
        let on = *self.through.get(k * self.twin.len() + i)?;
        (on > 0.0).then(|| (self.twin[i] as usize, on))
    }
}

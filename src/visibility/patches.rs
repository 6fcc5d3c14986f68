//! The directions around a scene, divided into patches (after C. F. Reinhart's division of the sky in 577, itself a
//! finer one of P. R. Tregenza's in 145), and each patch into cells of equal solid angle.

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Rows of patches from the horizon to the cap at the zenith.
const ROWS: [u32; 14] = [60, 60, 60, 60, 48, 48, 48, 48, 36, 36, 24, 24, 12, 12];

/// All directions: the upper half, then the lower one, its mirror image.
#[derive(Clone, Debug, PartialEq)]
pub struct Patches {
    x: DVec3,
    y: DVec3,
    up: DVec3,
    patches: Vec<Patch>,
}

/// A range of sines of altitude and one of azimuth.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    sine: [f64; 2],
    azimuth: [f64; 2],
    /// Towards the mean direction, unit.
    pub middle: DVec3,
    /// ∫ ω dω, sr.
    pub vector: DVec3,
    /// Nothing of it is further from the middle, rad.
    pub radius: f64,
    /// Those that it touches.
    pub neighbours: Vec<u16>,
}

impl Patches {
    /// About a zenith.
    pub fn new(up: DVec3) -> Self {
        let (x, y) = up.any_orthonormal_pair();
        let step = FRAC_PI_2 / (ROWS.len() as f64 + 0.5);
        let mut patches = Patches { x, y, up, patches: Vec::new() };
        for side in [1.0, -1.0] {
            for row in 0..=ROWS.len() {
                let count = ROWS.get(row).copied().unwrap_or(1);
                let sine =
                    [row as f64 * step, ((row + 1) as f64 * step).min(FRAC_PI_2)].map(|a| side * a.sin());
                for k in 0..count {
                    let azimuth = [k, k + 1].map(|k| TAU * f64::from(k) / f64::from(count));
                    patches.add(sine, azimuth);
                }
            }
        }
        patches.join();
        patches
    }

    fn add(&mut self, sine: [f64; 2], azimuth: [f64; 2]) {
        let [low, high] = [sine[0].min(sine[1]), sine[0].max(sine[1])];
        let turn = azimuth[1] - azimuth[0];
        // ∫ cos² a da over the altitudes, and ∫ sin a cos a da.
        let flat = |s: f64| 0.5 * (s.asin() + s * (1.0 - s * s).max(0.0).sqrt());
        let out = flat(high) - flat(low);
        let [a, b] = azimuth;
        let vector = out * (b.sin() - a.sin()) * self.x
            + out * (a.cos() - b.cos()) * self.y
            + 0.5 * turn * (high * high - low * low) * self.up;
        let mut patch = Patch {
            sine: [low, high],
            azimuth,
            middle: vector.normalize(),
            vector,
            radius: 0.0,
            neighbours: Vec::new(),
        };
        let corners = [(low, a), (low, b), (high, a), (high, b)];
        let far = |(s, t): (f64, f64)| self.at(s, t).angle_between(patch.middle);
        patch.radius = corners.map(far).into_iter().fold(0.0, f64::max);
        self.patches.push(patch);
    }

    fn at(&self, sine: f64, azimuth: f64) -> DVec3 {
        let (s, c) = azimuth.sin_cos();
        (1.0 - sine * sine).max(0.0).sqrt() * (c * self.x + s * self.y) + sine * self.up
    }

    fn join(&mut self) {
        let near = |a: &Patch, b: &Patch| a.middle.angle_between(b.middle) < 1.05 * (a.radius + b.radius);
        let all: Vec<Vec<u16>> = (self.patches.iter().enumerate())
            .map(|(i, a)| {
                let others = self.patches.iter().enumerate().filter(|(j, b)| *j != i && near(a, b));
                others.map(|(j, _)| j as u16).collect()
            })
            .collect();
        self.patches.iter_mut().zip(all).for_each(|(patch, near)| patch.neighbours = near);
    }

    /// All of them.
    pub fn all(&self) -> &[Patch] {
        &self.patches
    }

    /// The middles of `n` x `n` cells of patch `p`, all of the same solid angle.
    pub fn cells(&self, p: usize, n: u32) -> impl Iterator<Item = DVec3> + '_ {
        let Patch { sine, azimuth, .. } = &self.patches[p];
        let share = move |k: u32| (f64::from(k) + 0.5) / f64::from(n);
        (0..n * n).map(move |k| {
            let (s, t) = (share(k / n), share(k % n));
            self.at(sine[0] + s * (sine[1] - sine[0]), azimuth[0] + t * (azimuth[1] - azimuth[0]))
        })
    }

    /// Solid angle of patch `p`, sr.
    pub fn solid_angle(&self, p: usize) -> f64 {
        let Patch { sine, azimuth, .. } = &self.patches[p];
        (sine[1] - sine[0]) * (azimuth[1] - azimuth[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn patches_fill_the_sphere() {
        let patches = Patches::new(DVec3::new(0.6, 0.0, 0.8));
        assert_eq!(patches.all().len(), 2 * 577);
        let total: f64 = (0..patches.all().len()).map(|p| patches.solid_angle(p)).sum();
        assert!((total - 4.0 * PI).abs() < 1e-9);
        let upper: DVec3 = patches.all()[..577].iter().map(|p| p.vector).sum();
        assert!(upper.distance(PI * patches.up) < 1e-9, "{upper}");
        for (p, patch) in patches.all().iter().enumerate() {
            let mean = patches.cells(p, 40).sum::<DVec3>() / 1600.0 * patches.solid_angle(p);
            assert!(mean.distance(patch.vector) < 1e-4 * patches.solid_angle(p));
            assert!(patches.cells(p, 40).all(|d| d.angle_between(patch.middle) <= 1.01 * patch.radius));
            assert!(
                (2..=20).contains(&patch.neighbours.len())
                    || patch.vector.normalize().dot(patches.up).abs() > 0.99
            );
        }
    }
}

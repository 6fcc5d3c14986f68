//! What an opaque surface does with light: the diffuse part and the Beckmann lobe of section 2.2 together.

use crate::material::{SampledMaterial, microfacet};
use crate::second_pass::{lobe_density, lobe_weight, reflect, sample_facet};
use glam::DVec3;
use std::f64::consts::PI;

/// A place on an opaque surface, seen from direction `i`.
pub struct Opaque<'a> {
    /// What it is of.
    pub material: &'a SampledMaterial,
    /// Towards where the path comes from, unit.
    pub i: DVec3,
    /// Unit normal on that side.
    pub n: DVec3,
    /// Chance that a direction is drawn from the specular part.
    pub specular: f64,
}

/// A direction drawn, and what it is worth.
pub struct Drawn {
    /// Unit, away from the surface.
    pub direction: DVec3,
    /// Density, 1/sr; infinite where no other direction could have been drawn.
    pub density: f64,
}

impl Opaque<'_> {
    /// Whether light from a direction chosen elsewhere is scattered at all: not by an ideal mirror.
    pub fn scatters(&self) -> bool {
        self.specular < 1.0 || self.material.m > 0.0
    }

    /// f cos θ_r, 1/sr, of the parts that scatter, into `value`, and the density with which [`Opaque::draw`] would
    /// draw `r`.
    pub fn eval(&self, r: DVec3, value: &mut [f64], fresnel: &mut [f32]) -> f64 {
        let (ni, nr) = (self.n.dot(self.i), self.n.dot(r));
        if ni <= 0.0 || nr <= 0.0 {
            value.fill(0.0);
            return 0.0;
        }
        for (value, diffuse) in value.iter_mut().zip(&self.material.diffuse) {
            *value = f64::from(*diffuse) * nr / PI;
        }
        let mut density = (1.0 - self.specular) * nr / PI;
        let m = self.material.m;
        if self.material.s > 0.0 && m > 0.0 {
            let h = (self.i + r).normalize();
            let (nh, ih) = (self.n.dot(h), self.i.dot(h));
            let lobe = self.material.s * microfacet::rs_over_f(ni, nr, nh, ih, m) * nr;
            self.material.reflect.eval(ih as f32, fresnel);
            for (value, f) in value.iter_mut().zip(&*fresnel) {
                *value += lobe * f64::from(*f);
            }
            density += self.specular * lobe_density(self.i, h, self.n, m);
        }
        density
    }

    /// A direction for four uniform numbers in [0, 1), and f cos θ_r over its density in `value`. `None` where the path
    /// ends.
    pub fn draw(&self, u: [f64; 4], value: &mut [f64], fresnel: &mut [f32]) -> Option<Drawn> {
        let facets = u[0] < self.specular;
        if facets && self.material.m == 0.0 {
            self.material.reflect.eval(self.n.dot(self.i) as f32, fresnel);
            for (value, f) in value.iter_mut().zip(&*fresnel) {
                *value = self.material.s * f64::from(*f) / self.specular;
            }
            return Some(Drawn { direction: reflect(self.i, self.n), density: f64::INFINITY });
        }
        let direction = if facets {
            let h = sample_facet(self.i, self.n, self.material.m, [u[1], u[2], u[3]].map(|u| u as f32));
            let r = reflect(self.i, h);
            if lobe_weight(self.i, r, h, self.n) <= 0.0 {
                return None;
            }
            r
        } else {
            let (x, y) = self.n.any_orthonormal_pair();
            let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
            let radius = u[2].sqrt();
            radius * (cos * x + sin * y) + (1.0 - u[2]).max(0.0).sqrt() * self.n
        };
        let density = self.eval(direction, value, fresnel);
        if density.is_nan() || density <= 0.0 {
            return None;
        }
        value.iter_mut().for_each(|v| *v /= density);
        Some(Drawn { direction, density })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::FresnelTable;

    /// The mean of what draws are worth is the integral of the values over the hemisphere, taken with evenly spread
    /// directions: density and value belong together.
    #[test]
    fn draws_and_values_agree() {
        for (s, m) in [(0.0, 0.0), (0.6, 0.3), (1.0, 0.5), (0.4, 0.15)] {
            let material = SampledMaterial {
                diffuse: vec![0.8 * (1.0 - s) as f32],
                s,
                m,
                reflect: FresnelTable::new(1, 64, |_, cos| 0.4 + 0.6 * (1.0 - cos).powi(5)),
                transmission: None,
                spread: None,
                emission: vec![0.0],
            };
            for degrees in [0.0f64, 50.0, 80.0] {
                let i = DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
                let at =
                    Opaque { material: &material, i, n: DVec3::Z, specular: if s > 0.0 { 0.5 } else { 0.0 } };
                let (mut value, mut fresnel) = ([0.0], [0.0]);
                let count = 1 << 16;
                let (mut drawn, mut even, mut total) = (0.0, 0.0, 0.0);
                for k in 0..count {
                    let a = sobol_burley::sample_4d(k, 0, 7).map(f64::from);
                    if at.draw(a, &mut value, &mut fresnel).is_some() {
                        drawn += value[0] / f64::from(count);
                    }
                    let (sin, cos) = (2.0 * PI * a[0]).sin_cos();
                    let z = a[1];
                    let r = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
                    total += 2.0 * PI * at.eval(r, &mut value, &mut fresnel) / f64::from(count);
                    even += 2.0 * PI * value[0] / f64::from(count);
                }
                assert!((drawn / even - 1.0).abs() < 5e-3, "s {s} m {m} at {degrees}: {drawn} {even}");
                // What would leave through the surface is drawn and lost: the densities above it add up to less.
                assert!(total < 1.005 && total > 0.5, "s {s} m {m} at {degrees}: {total}");
            }
        }
    }
}

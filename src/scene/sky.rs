//! The light of the sky: standard general skies (CIE S 011/E:2003, ISO 15469:2004).

use crate::spectrum::{Spectrum, Wavelengths, luminance_of};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Gradation a, b and indicatrix c, d, e of the fifteen standard skies.
const STANDARD: [[f64; 5]; 15] = [
    [4.0, -0.70, 0.0, -1.0, 0.0],
    [4.0, -0.70, 2.0, -1.5, 0.15],
    [1.1, -0.8, 0.0, -1.0, 0.0],
    [1.1, -0.8, 2.0, -1.5, 0.15],
    [0.0, -1.0, 0.0, -1.0, 0.0],
    [0.0, -1.0, 2.0, -1.5, 0.15],
    [0.0, -1.0, 5.0, -2.5, 0.30],
    [0.0, -1.0, 10.0, -3.0, 0.45],
    [-1.0, -0.55, 2.0, -1.5, 0.15],
    [-1.0, -0.55, 5.0, -2.5, 0.30],
    [-1.0, -0.55, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 24.0, -2.8, 0.15],
];

/// How luminance is spread over a sky, 1 at the zenith.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyShape {
    /// Towards the zenith, unit.
    pub up: DVec3,
    /// Towards the sun, unit, above the horizon; what depends on it is the same without for some skies.
    pub sun: DVec3,
    /// 1 to 15, the standard general skies; 16, the traditional overcast sky (P. Moon and D. E. Spencer, 1942).
    pub kind: u8,
}

impl SkyShape {
    /// Whether the sky of this kind is brighter around the sun.
    pub fn needs_sun(kind: u8) -> bool {
        STANDARD.get(usize::from(kind).wrapping_sub(1)).is_some_and(|s| s[2] != 0.0 || s[4] != 0.0)
    }

    /// Luminance towards `d` (unit) over that of the zenith; 0 below the horizon.
    pub fn towards(&self, d: DVec3) -> f64 {
        let sine = self.up.dot(d);
        if sine <= 0.0 {
            return 0.0;
        }
        let Some([a, b, c, index, e]) = STANDARD.get(usize::from(self.kind).wrapping_sub(1)) else {
            return (1.0 + 2.0 * sine) / 3.0;
        };
        let gradation = |sine: f64| 1.0 + a * (b / sine).exp();
        let indicatrix = |cos: f64| {
            let away = cos.clamp(-1.0, 1.0).acos();
            1.0 + c * ((index * away).exp() - (index * FRAC_PI_2).exp()) + e * cos * cos
        };
        let zenith = indicatrix(self.sun.dot(self.up)) * gradation(1.0);
        (indicatrix(self.sun.dot(d)) * gradation(sine) / zenith).max(0.0)
    }

    /// Horizontal illuminance over the luminance of the zenith, sr: π for an even sky.
    pub fn horizontal(&self) -> f64 {
        // Midpoints in azimuth and in the sine of the altitude, by the cosine law.
        const STEPS: u32 = 400;
        let (x, y) = self.up.any_orthonormal_pair();
        let mut sum = 0.0;
        for i in 0..STEPS {
            let sine = (f64::from(i) + 0.5) / f64::from(STEPS);
            let flat = (1.0 - sine * sine).sqrt();
            let of_row = (0..STEPS).map(|k| {
                let (s, c) = (2.0 * PI * (f64::from(k) + 0.5) / f64::from(STEPS)).sin_cos();
                self.towards(flat * (c * x + s * y) + sine * self.up)
            });
            sum += 2.0 * sine * of_row.sum::<f64>();
        }
        sum * PI / f64::from(STEPS * STEPS)
    }
}

/// What a sky gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    /// How its luminance is spread.
    pub shape: SkyShape,
    /// Spectral shape, the same all over.
    pub spectrum: Spectrum,
    /// How much.
    pub level: SkyLevel,
    /// Reflectance of the ground, which fills the half space below and is as bright as it is under the open sky.
    pub ground: Spectrum,
}

/// How much light a sky gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SkyLevel {
    /// Luminance of the zenith, cd m⁻².
    ZenithLuminance(f64),
    /// Illuminance of a horizontal plane that sees all of it, lx.
    Illuminance(f64),
}

impl Sky {
    /// What makes the spectrum the radiance of the zenith, W m⁻² sr⁻¹ nm⁻¹; not negative.
    pub fn factor(&self) -> f64 {
        let zenith = match self.level {
            SkyLevel::ZenithLuminance(luminance) => luminance,
            SkyLevel::Illuminance(illuminance) => illuminance / self.shape.horizontal(),
        };
        let factor = zenith / luminance_of(&self.spectrum);
        if factor.is_finite() { factor.max(0.0) } else { 0.0 }
    }

    /// At `wavelengths`, with the ground under it and under `beams`: irradiances of a plane that faces a directional
    /// light, `[W]`, and where it comes from.
    pub fn sample(&self, wavelengths: &Wavelengths, beams: &[(DVec3, &[f32])]) -> SampledSky {
        let factor = self.factor();
        let zenith: Vec<f32> = (wavelengths.sample_emission(&self.spectrum).into_iter())
            .map(|s| ((factor * s).max(0.0) as f32).min(f32::MAX))
            .collect();
        let (horizontal, ground) = (self.shape.horizontal(), wavelengths.sample(&self.ground));
        let of_ground = |k: usize| {
            let beams = beams.iter().map(|(from, e)| self.shape.up.dot(*from).max(0.0) * f64::from(e[k]));
            let irradiance = horizontal * f64::from(zenith[k]) + beams.sum::<f64>();
            (irradiance * ground[k].clamp(0.0, 1.0) / PI) as f32
        };
        SampledSky { shape: self.shape, ground: (0..zenith.len()).map(of_ground).collect(), zenith }
    }
}

/// A sky at the wavelengths of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledSky {
    /// How its luminance is spread.
    pub shape: SkyShape,
    /// Radiance of the zenith, W m⁻² sr⁻¹ nm⁻¹: `[W]`.
    pub zenith: Vec<f32>,
    /// Radiance of the ground, W m⁻² sr⁻¹ nm⁻¹: `[W]`.
    pub ground: Vec<f32>,
}

impl SampledSky {
    /// The mean of what is seen in some directions, `[W]`.
    pub fn mean(&self, directions: impl Iterator<Item = DVec3>) -> Vec<f32> {
        let (mut sum, mut count) = (vec![0.0f64; self.zenith.len()], 0.0);
        for d in directions {
            sum.iter_mut().zip(self.radiance(d)).for_each(|(sum, l)| *sum += f64::from(l));
            count += 1.0;
        }
        sum.into_iter().map(|l| (l / count) as f32).collect()
    }

    /// What is seen towards `d` (unit), W m⁻² sr⁻¹ nm⁻¹: `[W]`.
    #[inline]
    pub fn radiance(&self, d: DVec3) -> impl Iterator<Item = f32> + '_ {
        let relative = self.shape.towards(d) as f32;
        let below = self.shape.up.dot(d) <= 0.0;
        self.zenith.iter().zip(&self.ground).map(move |(z, g)| if below { *g } else { relative * z })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(kind: u8, elevation_deg: f64) -> SkyShape {
        let (sin, cos) = elevation_deg.to_radians().sin_cos();
        SkyShape { up: DVec3::Z, sun: DVec3::new(cos, 0.0, sin), kind }
    }

    /// An even sky gives π L, the traditional overcast one 7/9 π of its zenith's luminance.
    #[test]
    fn horizontal_illuminance_is_the_closed_form() {
        assert!((shape(5, 30.0).horizontal() - PI).abs() < 1e-12);
        assert!((shape(16, 30.0).horizontal() - 7.0 / 9.0 * PI).abs() < 1e-5);
    }

    #[test]
    fn every_sky_is_positive_and_one_at_its_zenith() {
        for kind in 1..=16 {
            for elevation in [0.0, 10.0, 45.0, 90.0] {
                let sky = shape(kind, elevation);
                assert!((sky.towards(DVec3::Z) - 1.0).abs() < 1e-12, "{kind}");
                for k in 0..90 {
                    let gamma = (f64::from(k) + 0.5).to_radians();
                    for turn in 0..12 {
                        let (s, c) = (f64::from(turn) * PI / 6.0).sin_cos();
                        let l = sky.towards(DVec3::new(gamma.cos() * c, gamma.cos() * s, gamma.sin()));
                        assert!(l.is_finite() && l > 0.0, "{kind} {elevation} {k} {turn}: {l}");
                    }
                }
            }
        }
    }

    /// The standard overcast sky is three times as bright above as at the horizon, all but; a clear one is brightest
    /// around the sun.
    #[test]
    fn skies_look_as_they_are_called() {
        let low = DVec3::new(1.0, 0.0, 1e-3).normalize();
        assert!((shape(16, 30.0).towards(low) - 1.0 / 3.0).abs() < 1e-3);
        assert!((shape(1, 30.0).towards(low) - 1.0 / (1.0 + 4.0 * (-0.7f64).exp())).abs() < 1e-3);
        let clear = shape(12, 40.0);
        assert!(
            clear.towards(clear.sun) > 5.0 && clear.towards(-clear.sun + 2.0 * clear.sun.z * DVec3::Z) < 2.0
        );
    }
}

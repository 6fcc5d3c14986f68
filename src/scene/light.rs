//! Lights without a body: where they stand belongs to the geometry, how much they give to the appearance.

use super::web::{Web, WebType};
use crate::spectrum::{Spectrum, Wavelengths, luminance_of};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// A light without a body: nothing sees it but what it lights.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Its name in the scene file.
    pub name: String,
    /// Where its light comes from.
    pub kind: LightKind,
}

/// Where light comes from that no surface emits.
#[derive(Clone, Debug, PartialEq)]
pub enum LightKind {
    /// From a place.
    Point {
        /// Relative to the scene's centre, m.
        position: DVec3,
        /// How the intensity depends on direction.
        distribution: Distribution,
    },
    /// From infinity, as the sun's does.
    Directional {
        /// Where it comes from, unit.
        from: DVec3,
        /// Half the angle that the light fills, rad; 0 casts sharp shadows.
        radius: f64,
        /// All surfaces lie within this of the scene's centre, m.
        reach: f64,
    },
}

/// How the intensity of a point light depends on direction, 1 where it is largest.
#[derive(Clone, Debug, PartialEq)]
pub enum Distribution {
    /// The same everywhere.
    Isotropic,
    /// I = I₀ cos θ about an axis, nothing behind.
    Lambertian {
        /// Where I₀ goes, unit.
        axis: DVec3,
    },
    /// I₀ within an inner cone, nothing beyond an outer one, and between them I₀ times the square of what falls
    /// evenly with cos θ from 1 to 0 (glTF, KHR_lights_punctual).
    Spot {
        /// The axis of both cones, unit.
        axis: DVec3,
        /// Cosine of half the angle of the inner one.
        inner: f64,
        /// Cosine of half the angle of the outer one, not larger.
        outer: f64,
    },
    /// A luminaire as a goniophotometer measured it.
    Web {
        /// Its intensities.
        web: Arc<Web>,
        /// From directions of the scene to those of the web.
        frame: DMat3,
    },
}

/// The way from a place to a light.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Unit, from the place to the light.
    pub direction: DVec3,
    /// What must be free up to here for the light to arrive.
    pub end: DVec3,
    /// Irradiance of a plane that faces the light over the light's amount.
    pub share: f64,
}

impl Light {
    /// The way from `x` (relative to the scene's centre) to its middle. Where `x` is the light's own place nothing is
    /// finite.
    #[inline]
    pub fn seen_from(&self, x: DVec3) -> Way {
        match &self.kind {
            LightKind::Point { position, distribution } => {
                let way = *position - x;
                let distance2 = way.length_squared();
                let direction = way / distance2.sqrt();
                Way { direction, end: *position, share: distribution.towards(-direction) / distance2 }
            }
            LightKind::Directional { from, reach, .. } => parallel(*from, x, *reach),
        }
    }

    /// The way from `x` to a place of it, evenly over the directions in which it shines, for two uniform numbers in [0, 1).
    #[inline]
    pub fn drawn_from(&self, x: DVec3, u: f64, v: f64) -> Way {
        match self.kind {
            LightKind::Directional { from, radius, reach } if radius > 0.0 => {
                let height = 2.0 * (0.5 * radius).sin().powi(2) * u;
                let out = (height * (2.0 - height)).sqrt();
                let (sin, cos) = (2.0 * PI * v).sin_cos();
                let (a, b) = from.any_orthonormal_pair();
                parallel((1.0 - height) * from + out * (cos * a + sin * b), x, reach)
            }
            _ => self.seen_from(x),
        }
    }

    /// Its image in a plane through `foot` with unit `normal`.
    pub fn mirrored(&self, foot: DVec3, normal: DVec3) -> Light {
        let turned = |d: DVec3| d - 2.0 * d.dot(normal) * normal;
        let kind = match &self.kind {
            LightKind::Point { position, distribution } => LightKind::Point {
                position: foot + turned(*position - foot),
                distribution: distribution.mirrored(normal),
            },
            LightKind::Directional { from, radius, reach } => {
                LightKind::Directional { from: turned(*from), radius: *radius, reach: *reach }
            }
        };
        Light { name: self.name.clone(), kind }
    }

    /// Half the angle that it fills, rad.
    pub fn radius(&self) -> f64 {
        match self.kind {
            LightKind::Point { .. } => 0.0,
            LightKind::Directional { radius, .. } => radius,
        }
    }

    /// Where it stands, m: one from infinity as good as there.
    pub fn place(&self) -> DVec3 {
        const FAR: f64 = 1e4;
        match &self.kind {
            LightKind::Point { position, .. } => *position,
            LightKind::Directional { from, reach, .. } => FAR * *reach * *from,
        }
    }

    /// How far it is over a plane through `foot` with unit `normal`, m; of a light from infinity how far the end of its
    /// way is.
    pub fn height(&self, foot: DVec3, normal: DVec3) -> f64 {
        normal.dot(self.seen_from(foot).end - foot)
    }

    /// Flux over amount: for a point light over its largest intensity, sr; for a directional one what falls on a disc as
    /// wide as the scene, m².
    pub fn flux_share(&self) -> f64 {
        match &self.kind {
            LightKind::Point { distribution, .. } => distribution.solid_angle(),
            LightKind::Directional { reach, .. } => PI * reach * reach,
        }
    }
}

/// The way from `x` along a parallel beam that comes `from` infinity, past all that is within `reach` of the centre.
fn parallel(from: DVec3, x: DVec3, reach: f64) -> Way {
    Way { direction: from, end: x + (x.length() + reach) * from, share: 1.0 }
}

impl Distribution {
    /// That of a luminaire whose nadir (γ = 0 of type C) or beam (types A and B) goes along `axis`, and whose half
    /// plane C = 0 or upright lies where `aside` points, as far as that is across the axis. Both unit.
    pub fn web(web: Arc<Web>, axis: DVec3, aside: DVec3) -> Distribution {
        let aside = aside.reject_from_normalized(axis).normalize_or(axis.any_orthonormal_vector());
        let [x, z] = match web.kind() {
            WebType::C => [aside, -axis],
            WebType::A | WebType::B => [axis, aside],
        };
        Distribution::Web { web, frame: DMat3::from_cols(x, z.cross(x), z).transpose() }
    }

    /// What it looks like in a mirror with unit `normal`.
    fn mirrored(&self, normal: DVec3) -> Distribution {
        let turned = |d: &DVec3| *d - 2.0 * d.dot(normal) * normal;
        match self {
            Distribution::Isotropic => Distribution::Isotropic,
            Distribution::Lambertian { axis } => Distribution::Lambertian { axis: turned(axis) },
            Distribution::Spot { axis, inner, outer } => {
                Distribution::Spot { axis: turned(axis), inner: *inner, outer: *outer }
            }
            Distribution::Web { web, frame } => {
                let mirror = DMat3::from_cols(turned(&DVec3::X), turned(&DVec3::Y), turned(&DVec3::Z));
                Distribution::Web { web: web.clone(), frame: *frame * mirror }
            }
        }
    }

    /// Intensity towards `to` (unit) over the largest.
    pub fn towards(&self, to: DVec3) -> f64 {
        match self {
            Distribution::Isotropic => 1.0,
            Distribution::Lambertian { axis } => axis.dot(to).max(0.0),
            Distribution::Spot { axis, inner, outer } => {
                let cos = axis.dot(to);
                if cos >= *inner { 1.0 } else { ((cos - outer) / (inner - outer)).max(0.0).powi(2) }
            }
            Distribution::Web { web, frame } => web.towards(*frame * to),
        }
    }

    /// Flux over the largest intensity, sr.
    pub fn solid_angle(&self) -> f64 {
        match self {
            Distribution::Isotropic => 4.0 * PI,
            Distribution::Lambertian { .. } => PI,
            Distribution::Spot { inner, outer, .. } => 2.0 * PI * ((1.0 - inner) + (inner - outer) / 3.0),
            Distribution::Web { web, .. } => web.solid_angle(),
        }
    }
}

/// What a light gives.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSource {
    /// Spectral shape.
    pub spectrum: Spectrum,
    /// How much.
    pub level: LightLevel,
}

/// How much light a light gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightLevel {
    /// Luminous flux in all directions together, lm.
    LuminousFlux(f64),
    /// Largest luminous intensity, cd.
    LuminousIntensity(f64),
    /// Illuminance of a plane that faces a directional light, lx.
    Illuminance(f64),
}

impl LightLevel {
    /// So many times as much.
    pub fn scaled(self, by: f64) -> LightLevel {
        match self {
            LightLevel::LuminousFlux(flux) => LightLevel::LuminousFlux(by * flux),
            LightLevel::LuminousIntensity(intensity) => LightLevel::LuminousIntensity(by * intensity),
            LightLevel::Illuminance(illuminance) => LightLevel::Illuminance(by * illuminance),
        }
    }
}

impl LightSource {
    /// What makes the spectrum the amount of `light`: its largest intensity, W sr⁻¹ nm⁻¹, or the irradiance of a plane that
    /// faces it, W m⁻² nm⁻¹; not negative.
    pub fn factor(&self, light: &Light) -> f64 {
        let amount = match self.level {
            LightLevel::LuminousFlux(flux) => flux / light.flux_share(),
            LightLevel::LuminousIntensity(amount) | LightLevel::Illuminance(amount) => amount,
        };
        let factor = amount / luminance_of(&self.spectrum);
        if factor.is_finite() { factor.max(0.0) } else { 0.0 }
    }

    /// The same at `wavelengths`: `[W]`, finite and not negative. The luminous amount is met exactly by the weights of
    /// `wavelengths`.
    pub fn sample(&self, light: &Light, wavelengths: &Wavelengths) -> Vec<f32> {
        let factor = self.factor(light);
        let stored = |s: f64| ((factor * s).max(0.0) as f32).min(f32::MAX);
        wavelengths.sample_emission(&self.spectrum).into_iter().map(stored).collect()
    }
}

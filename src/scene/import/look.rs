//! What other formats say about a material, in terms of ours.

use super::super::description::{
    EmissionTable, FresnelRef, FresnelTable, MaterialTable, PaneTable, SolidTable, SpectrumRef,
};
use super::shell::Shell;
use crate::colour::linear_srgb_luminance;
use toml::Spanned;

/// Linear sRGB.
pub type Rgb = [f64; 3];

/// A material as other formats describe it.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// What it does with light.
    pub body: Body,
    /// Luminance, cd/m², as a colour.
    pub emission: Rgb,
    /// Whether both sides reflect.
    pub two_sided: bool,
}

/// No opaque surface turns more of the light back at normal incidence: white paint is at 0.85 to 0.9, and where files say
/// 1 light would go round for ever.
pub const LIGHTEST: f64 = 0.95;

/// A lobe as rough as this, m, is as good as diffuse.
pub const WIDE: f64 = 0.5;

/// What it does with light.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// A diffuse body under a specular surface.
    Opaque {
        /// Diffuse albedo.
        diffuse: Rgb,
        /// Specular reflectance at normal incidence.
        specular: Rgb,
        /// Real index that gives the course towards grazing incidence; by `specular` if not known.
        index: Option<f64>,
        /// Beckmann's roughness, 0 for a mirror.
        m: f64,
    },
    /// Glass.
    Glass {
        /// Real index.
        index: f64,
        /// What it lets through, surfaces not included.
        filter: Rgb,
        /// The length over which it does; the mean chord of the body if not known, m.
        over: Option<f64>,
    },
}

impl Look {
    /// The table of a material that looks so, written at `place`. `shell` is what glass makes.
    pub fn table(&self, shell: Shell, place: usize) -> MaterialTable {
        let at = Place(place);
        let mut table = MaterialTable::default();
        match self.body {
            Body::Opaque { diffuse, specular, index, m } => {
                opaque(&mut table, diffuse, specular, index, m, at)
            }
            Body::Glass { index, filter, over } => {
                let index = at.number(index);
                let filter = Some(at.colour(filter));
                match shell {
                    Shell::Solid { mean_chord } | Shell::InsideOut { mean_chord } => {
                        let over_m = Some(at.here(over.unwrap_or(mean_chord).clamp(1e-9, 1e6)));
                        let absorption_per_m = None;
                        let solid = SolidTable { index, absorption_per_m, transmittance: filter, over_m };
                        table.solid = Some(at.here(solid));
                    }
                    Shell::Bulb | Shell::Sheet => {
                        let pane = PaneTable { index, thickness_m: None, transmittance: filter };
                        table.pane = Some(at.here(pane));
                    }
                }
            }
        }
        let luminance = linear_srgb_luminance(self.emission);
        if luminance > 0.0 {
            table.emission = Some(at.here(EmissionTable {
                illuminant: None,
                spectrum: Some(at.colour(self.emission.map(|x| x / luminance))),
                radiance: None,
                luminance: Some(at.here(luminance.min(1e15))),
                luminous_flux: None,
                luminous_intensity: None,
            }));
        }
        if self.two_sided {
            table.two_sided = Some(at.here(true));
        }
        table
    }

    /// Whether it reflects more than anything does, and is taken for less.
    pub fn is_too_light(&self) -> bool {
        matches!(self.body, Body::Opaque { diffuse, specular, .. } if excess(diffuse, specular) > 1.0)
    }

    /// Whether it reflects by a lobe that is as good as diffuse, and is taken for that.
    pub fn is_wide(&self) -> bool {
        matches!(self.body, Body::Opaque { specular, m, .. } if m >= WIDE && specular != [0.0; 3])
    }

    /// Whether it is glass.
    pub fn is_glass(&self) -> bool {
        matches!(self.body, Body::Glass { .. })
    }
}

/// Grey, half of the light: what is worn and nowhere defined.
pub const PLAIN: f64 = 0.5;

/// A table for a material that is nowhere defined.
pub fn plain(place: usize) -> MaterialTable {
    MaterialTable { reflectance: Some(Place(place).number(PLAIN)), ..MaterialTable::default() }
}

/// Where all of a table is written.
#[derive(Clone, Copy)]
struct Place(usize);

impl Place {
    fn here<T>(self, value: T) -> Spanned<T> {
        Spanned::new(self.0..self.0, value)
    }

    fn number(self, x: f64) -> Spanned<SpectrumRef> {
        self.here(SpectrumRef::Constant(x))
    }

    fn colour(self, rgb: Rgb) -> Spanned<SpectrumRef> {
        self.here(SpectrumRef::Rgb(rgb))
    }
}

fn largest(rgb: Rgb) -> f64 {
    rgb[0].max(rgb[1]).max(rgb[2])
}

/// By how much too much is reflected; 1 where it is not.
fn excess(diffuse: Rgb, specular: Rgb) -> f64 {
    ((largest(diffuse) + largest(specular)) / LIGHTEST).max(1.0)
}

/// A diffuse body under a specular surface. Our model is s F R^s + (1 - s) R^d: the specular share s is as large as the
/// diffuse albedo leaves room for, and F at normal incidence as much larger than `specular`. So what
/// the surface reflects at normal incidence and what the body scatters are both what the file says, no more than
/// [`LIGHTEST`] comes back, and only the rise towards grazing incidence ends at s instead of 1.
fn opaque(table: &mut MaterialTable, diffuse: Rgb, specular: Rgb, index: Option<f64>, m: f64, at: Place) {
    let excess = excess(diffuse, specular);
    let (diffuse, specular) = (diffuse.map(|x| x / excess), specular.map(|x| x / excess));
    if largest(specular) <= 0.0 || m >= WIDE {
        let both = [0, 1, 2].map(|c| diffuse[c] + specular[c]);
        table.reflectance = Some(at.colour(both));
        return;
    }
    let body = largest(diffuse);
    let s = 1.0 - body;
    let share = |x: f64, of: f64| if of > 0.0 { (x / of).clamp(0.0, 1.0) } else { 0.0 };
    table.reflectance = Some(at.colour(diffuse.map(|x| share(x, body))));
    table.specular = Some(at.here(s));
    table.roughness = Some(at.here(m.clamp(0.0, 1.0)));
    table.fresnel = Some(at.here(FresnelRef::Table(Box::new(FresnelTable {
        index: None,
        normal: Some(at.colour(specular.map(|x| share(x, s)))),
        n: index.map(|n| at.number(n.clamp(1.0001, 100.0))),
        k: None,
    }))));
}

/// m of the Beckmann distribution whose lobe is as wide as Blinn's and Phong's with exponent `ns`: sqrt(2/(Ns + 2)).
pub fn beckmann_of_exponent(ns: f64) -> f64 {
    (2.0 / (ns.max(0.0) + 2.0)).sqrt()
}

/// Reflectance at normal incidence of a transparent body of index n.
pub fn normal_reflectance(index: f64) -> f64 {
    ((index - 1.0) / (index + 1.0)).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gloss_over_a_diffuse_body_keeps_what_the_file_says_at_normal_incidence() {
        let look = |diffuse, specular| Look {
            body: Body::Opaque { diffuse, specular, index: Some(1.5), m: 0.1 },
            emission: [0.0; 3],
            two_sided: false,
        };
        let table = look([0.6, 0.3, 0.0], [0.04; 3]).table(Shell::Sheet, 0);
        let s = *table.specular.expect("it is glossy").get_ref();
        assert!((s - 0.4).abs() < 1e-15);
        let Some(SpectrumRef::Rgb(body)) = table.reflectance.map(Spanned::into_inner) else { panic!() };
        assert!((0..3).all(|c| ((1.0 - s) * body[c] - [0.6, 0.3, 0.0][c]).abs() < 1e-15));
        let Some(FresnelRef::Table(fresnel)) = table.fresnel.map(Spanned::into_inner) else { panic!() };
        let Some(SpectrumRef::Rgb(normal)) = fresnel.normal.map(Spanned::into_inner) else { panic!() };
        assert!((s * normal[0] - 0.04).abs() < 1e-15);
        // What reflects more than anything does is brought down.
        let light = look([0.9; 3], [0.6; 3]);
        let table = light.table(Shell::Sheet, 0);
        assert!(light.is_too_light() && !look([0.6; 3], [0.04; 3]).is_too_light());
        assert!((table.specular.expect("it is glossy").get_ref() - (1.0 - LIGHTEST * 0.6)).abs() < 1e-15);
    }

    #[test]
    fn wide_lobes_are_diffuse_and_reflect_as_much() {
        let body = Body::Opaque { diffuse: [0.6, 0.3, 0.0], specular: [0.04; 3], index: None, m: WIDE };
        let look = Look { body, emission: [0.0; 3], two_sided: false };
        assert!(look.is_wide());
        let table = look.table(Shell::Sheet, 0);
        assert!(table.specular.is_none());
        let Some(SpectrumRef::Rgb(body)) = table.reflectance.map(Spanned::into_inner) else { panic!() };
        assert!((0..3).all(|c| (body[c] - [0.64, 0.34, 0.04][c]).abs() < 1e-15));
    }
}

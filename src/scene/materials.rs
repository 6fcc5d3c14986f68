//! From `[materials.NAME]` to [`Material`].

use super::description::{FresnelRef, MaterialTable, Name, PaneTable, SolidTable, SpectrumRef};
use super::emission::of_material;
use super::source::Sources;
use super::spectra::{Spectra, Use, map, range};
use super::suggest;
use crate::error::{Error, Result};
use crate::material::{Body, Fresnel, Material};
use crate::spectrum::{Spectrum, library};
use toml::Spanned;

/// The sodium D lines, at which the first method of the paper's appendix takes its index, nm.
const SODIUM_D_NM: f64 = 589.3;

/// An absorption beyond this cannot be told from opaque, 1/m.
const MAX_ABSORPTION: f64 = 1e9;

/// What compiling materials needs.
pub struct Materials<'a> {
    pub sources: &'a Sources,
    pub spectra: Spectra<'a>,
}

impl Materials<'_> {
    /// Compiles one material.
    pub fn compile(&self, name: &Name, table: &MaterialTable) -> Result<Material> {
        let body = match (&table.pane, &table.solid) {
            (None, None) => self.opaque(name, table)?,
            (Some(pane), None) => self.pane(pane.get_ref())?,
            (None, Some(solid)) => self.solid(solid.get_ref())?,
            (Some(_), Some(solid)) => {
                return Err(self.error(solid, "a material is a `pane` or a `solid`, not both"));
            }
        };
        if table.pane.is_some() || table.solid.is_some() {
            self.refuse_opaque_keys(table)?;
        }
        let emission = table.emission.as_ref();
        let emission = emission.map(|e| of_material(self.sources, &self.spectra, e)).transpose()?;
        Ok(Material { name: name.get_ref().clone(), body, emission })
    }

    fn error<T>(&self, at: &Spanned<T>, message: impl Into<String>) -> Error {
        self.sources.error(at.span().start, message)
    }

    /// The number `at`, or `default`; it lies in `low..=high`.
    fn number(
        &self,
        at: &Option<Spanned<f64>>,
        default: f64,
        low: f64,
        high: f64,
        what: &str,
    ) -> Result<f64> {
        match at {
            None => Ok(default),
            Some(x) if (low..=high).contains(x.get_ref()) => Ok(*x.get_ref()),
            Some(x) => Err(self.error(x, format!("{what} lies in {low} to {high}; this is {}", x.get_ref()))),
        }
    }

    fn refuse_opaque_keys(&self, table: &MaterialTable) -> Result<()> {
        let places = [
            table.reflectance.as_ref().map(Spanned::span),
            table.fresnel.as_ref().map(Spanned::span),
            table.specular.as_ref().map(Spanned::span),
            table.roughness.as_ref().map(Spanned::span),
        ];
        let message = "glass takes no `reflectance`, `fresnel`, `specular` or `roughness`: \
                       its index says all; remove the key";
        match places.into_iter().flatten().next() {
            Some(span) => Err(self.sources.error(span.start, message)),
            None => Ok(()),
        }
    }

    fn opaque(&self, name: &Name, table: &MaterialTable) -> Result<Body> {
        let s = self.number(&table.specular, 0.0, 0.0, 1.0, "the specular share s")?;
        let m = self.number(&table.roughness, 0.0, 0.0, 2.0, "the roughness m")?;
        let diffuse = table.reflectance.as_ref().map(|r| self.spectra.get(r, Use::Share)).transpose()?;
        let fresnel = table.fresnel.as_ref().map(|f| self.fresnel(f)).transpose()?;
        match (fresnel, diffuse) {
            (Some(fresnel), diffuse) => Ok(Body::Opaque { s, m, diffuse, fresnel }),
            (None, _) if s > 0.0 => {
                let message = format!(
                    "material \"{}\" has a specular share and no `fresnel`; add one, such as \
                     fresnel = \"gold\" or fresnel = {{ index = \"bk7\" }}",
                    name.get_ref()
                );
                Err(self
                    .error(table.specular.as_ref().map_or(&Spanned::new(name.span(), 0.0), |x| x), message))
            }
            (None, Some(reflectance)) => Ok(perfectly_diffuse(reflectance, m)),
            // A luminaire of which nothing else is known reflects nothing.
            (None, None) if table.emission.is_some() => Ok(perfectly_diffuse(Spectrum::Constant(0.0), m)),
            (None, None) => {
                let message = format!(
                    "material \"{}\" says nothing about light; give it `reflectance`, `fresnel`, \
                     `pane`, `solid` or `emission`",
                    name.get_ref()
                );
                Err(self.error(name, message))
            }
        }
    }

    fn fresnel(&self, at: &Spanned<FresnelRef>) -> Result<Fresnel> {
        let by_name = |name: &str, place: usize| {
            let (n, k) = library::refractive_index(name).ok_or_else(|| {
                let known = library::refractive_index_names();
                self.sources.error(place, suggest::unknown("refractive index", name, &known))
            })?;
            Ok(Fresnel::Index { n, k })
        };
        let table = match at.get_ref() {
            FresnelRef::Named(name) => return by_name(name, at.span().start),
            FresnelRef::Table(table) => table,
        };
        match (&table.index, &table.normal, &table.n, &table.k) {
            (Some(index), None, None, None) => by_name(index.get_ref(), index.span().start),
            (None, Some(normal), n, k) => {
                let normal = self.spectra.get(normal, Use::Share)?;
                let (n, k) = match (n, k) {
                    (Some(n), k) => (self.constant(n, Use::IndexN)?, match k {
                        Some(k) => self.constant(k, Use::Absorption)?,
                        None => 0.0,
                    }),
                    (None, Some(k)) => return Err(self.error(k, "`k` goes with `n`")),
                    (None, None) => (index_from_reflectance(&normal), 0.0),
                };
                Ok(Fresnel::Scaled { normal, n, k })
            }
            (None, None, Some(n), k) => {
                let k = match k {
                    Some(k) => self.spectra.get(k, Use::Absorption)?,
                    None => Spectrum::Constant(0.0),
                };
                Ok(Fresnel::Index { n: self.spectra.get(n, Use::IndexN)?, k })
            }
            _ => Err(self.error(
                at,
                "`fresnel` is one of { index = NAME }, { n = N, k = K } and { normal = REFLECTANCE, n = N, k = K }",
            )),
        }
    }

    /// A number where the first method needs the index at 589 nm alone.
    fn constant(&self, at: &Spanned<SpectrumRef>, as_what: Use) -> Result<f64> {
        Ok(self.spectra.get(at, as_what)?.at(SODIUM_D_NM))
    }

    fn pane(&self, table: &PaneTable) -> Result<Body> {
        let (n, k) = self.spectra.index(&table.index)?;
        let thickness = self.number(&table.thickness_m, 0.0, 0.0, 1e3, "the thickness in m")?;
        let transmittance = match (&table.transmittance, &table.thickness_m) {
            (Some(t), Some(_)) => {
                return Err(self.error(t, "a pane has a `transmittance` or a `thickness_m`, not both"));
            }
            (Some(t), None) => self.spectra.get(t, Use::Share)?,
            (None, _) => map(&absorption(&k), |_, a| (-a * thickness).exp()),
        };
        Ok(Body::Pane { n, transmittance })
    }

    fn solid(&self, table: &SolidTable) -> Result<Body> {
        let (n, k) = self.spectra.index(&table.index)?;
        let absorption = match (&table.absorption_per_m, &table.transmittance, &table.over_m) {
            (None, None, None) => absorption(&k),
            (Some(a), None, None) => {
                let a = self.spectra.get(a, Use::Absorption)?;
                map(&a, |_, a| a.min(MAX_ABSORPTION))
            }
            (None, Some(t), over @ Some(_)) => {
                let over = self.number(over, 1.0, 1e-9, 1e6, "the length in m")?;
                let t = self.spectra.get(t, Use::Share)?;
                map(&t, |_, t| (-t.ln() / over).clamp(0.0, MAX_ABSORPTION))
            }
            _ => {
                let message = "a solid absorbs by its index, or by `absorption_per_m`, or by \
                               `transmittance` together with `over_m`";
                return Err(self.error(&table.index, message));
            }
        };
        Ok(Body::Solid { n, absorption })
    }
}

/// s = 0. The Fresnel factor then counts for nothing; that of common glass is as good as any.
fn perfectly_diffuse(reflectance: Spectrum, m: f64) -> Body {
    let fresnel = Fresnel::Index { n: Spectrum::Constant(1.5), k: Spectrum::Constant(0.0) };
    Body::Opaque { s: 0.0, m, diffuse: Some(reflectance), fresnel }
}

/// The real index that has this reflectance at normal incidence at 589 nm (Cook and Torrance
/// 1982, section 4): n = (1 + sqrt F) / (1 - sqrt F). F is kept below 0.98, n below 200.
fn index_from_reflectance(normal: &Spectrum) -> f64 {
    let root = normal.at(SODIUM_D_NM).clamp(0.0, 0.98).sqrt();
    // An index of exactly 1 would make the first method divide nothing by nothing.
    ((1.0 + root) / (1.0 - root)).max(1.0001)
}

/// a = 4 pi k / lambda, 1/m.
fn absorption(k: &Spectrum) -> Spectrum {
    if range(k) == (0.0, 0.0) {
        return Spectrum::Constant(0.0);
    }
    map(k, |nm, k| (4.0 * std::f64::consts::PI * k / (nm * 1e-9)).min(MAX_ABSORPTION))
}

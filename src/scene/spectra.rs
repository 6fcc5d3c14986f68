//! From the names and tables of a scene file to spectra.

use super::csv::{self, ColumnError};
use super::description::{Name, SpectrumRef, SpectrumTable};
use super::source::{MAX_CSV_BYTES, Source, Sources};
use super::suggest;
use crate::colour::{radiance_of_srgb, reflectance_of_srgb};
use crate::error::Result;
use crate::spectrum::{Spectrum, library};
use std::collections::BTreeMap;
use toml::Spanned;

/// What a spectrum is used as: decides its range and which built-in names may stand for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Use {
    /// A reflectance or transmittance, 0 to 1.
    Share,
    /// Emitted power, not negative.
    Power,
    /// Real part of an index, at least 0.01.
    IndexN,
    /// Imaginary part of an index or an absorption, not negative.
    Absorption,
}

/// The spectra of a scene: its own, then the built-in ones.
pub struct Spectra<'a> {
    sources: &'a Sources,
    own: BTreeMap<&'a str, Spectrum>,
}

impl<'a> Spectra<'a> {
    /// Resolves every `[spectra.NAME]`.
    pub fn new(sources: &'a Sources, tables: &'a BTreeMap<Name, SpectrumTable>) -> Result<Self> {
        let mut own = BTreeMap::new();
        for (name, table) in tables {
            own.insert(name.get_ref().as_str(), tabulate(sources, name, table)?);
        }
        Ok(Spectra { sources, own })
    }

    /// The spectrum that `reference` names, within the range of its use.
    pub fn get(&self, reference: &Spanned<SpectrumRef>, as_what: Use) -> Result<Spectrum> {
        let error = |message: String| self.sources.error(reference.span().start, message);
        let spectrum = match reference.get_ref() {
            SpectrumRef::Constant(value) => Spectrum::Constant(*value),
            SpectrumRef::Named(name) => self.named(name, as_what).map_err(error)?,
            SpectrumRef::Rgb(rgb) => of_colour(*rgb, as_what).map_err(error)?,
        };
        let (lowest, highest) = range(&spectrum);
        let fits = match as_what {
            Use::Share => lowest >= 0.0 && highest <= 1.0,
            Use::Power | Use::Absorption => lowest >= 0.0 && highest.is_finite(),
            Use::IndexN => lowest >= 0.01 && highest <= 1e3,
        };
        if fits {
            return Ok(spectrum);
        }
        let wanted = match as_what {
            Use::Share => "a reflectance or transmittance lies in 0 to 1",
            Use::Power => "emitted power is finite and not negative",
            Use::IndexN => "a refractive index lies in 0.01 to 1000",
            Use::Absorption => "absorption and k are finite and not negative",
        };
        Err(error(format!("{wanted}; this goes from {lowest} to {highest}")))
    }

    /// n and k by a number, the name of a spectrum (n alone) or a built-in name.
    pub fn index(&self, reference: &Spanned<SpectrumRef>) -> Result<(Spectrum, Spectrum)> {
        if let SpectrumRef::Named(name) = reference.get_ref()
            && !self.own.contains_key(name.as_str())
            && let Some(both) = library::refractive_index(name)
        {
            return Ok(both);
        }
        Ok((self.get(reference, Use::IndexN)?, Spectrum::Constant(0.0)))
    }

    fn named(&self, name: &str, as_what: Use) -> std::result::Result<Spectrum, String> {
        if let Some(spectrum) = self.own.get(name) {
            return Ok(spectrum.clone());
        }
        let (built_in, names) = match as_what {
            Use::Share => (library::reflectance(name), library::reflectance_names()),
            Use::Power => (library::illuminant(name), library::illuminant_names()),
            Use::IndexN => (None, library::refractive_index_names()),
            Use::Absorption => (None, Vec::new()),
        };
        built_in.ok_or_else(|| {
            let candidates: Vec<&str> = self.own.keys().copied().chain(names).collect();
            suggest::unknown("spectrum", name, &candidates)
        })
    }
}

/// A reflectance or transmittance of this colour under D65, or the light of this colour whose luminance is that of
/// `rgb` in cd/m².
fn of_colour(rgb: [f64; 3], as_what: Use) -> std::result::Result<Spectrum, String> {
    let most = match as_what {
        Use::Share => 1.0,
        Use::Power => 1e15,
        Use::IndexN | Use::Absorption => {
            return Err(
                "an index or an absorption has no colour; write a number or the name of a spectrum".into()
            );
        }
    };
    if !rgb.iter().all(|x| (0.0..=most).contains(x)) {
        return Err(format!("the components of this colour lie in 0 to {most}; these are {rgb:?}"));
    }
    Ok(if as_what == Use::Share { reflectance_of_srgb(rgb) } else { radiance_of_srgb(rgb) })
}

/// The spectrum of a `[spectra.NAME]` table.
fn tabulate(sources: &Sources, name: &Name, table: &SpectrumTable) -> Result<Spectrum> {
    let here = |message: String| sources.error(name.span().start, message);
    let inline = table.wavelengths_nm.is_some() || table.values.is_some();
    let ways = [table.file.is_some(), inline, table.constant.is_some()];
    if ways.iter().filter(|w| **w).count() != 1 {
        let message = "a spectrum is given by `file`, or by `wavelengths_nm` with `values`, or by `constant`";
        return Err(here(message.into()));
    }
    let scale = table.scale.as_ref().map_or(1.0, |s| *s.get_ref());
    if !scale.is_finite() {
        return Err(here("the scale of a spectrum is finite".into()));
    }
    if let Some(column) = table.column.as_ref().filter(|_| table.file.is_none()) {
        return Err(sources.error(column.span().start, "`column` goes with `file`"));
    }
    if let Some(constant) = &table.constant {
        let value = scale * constant.get_ref();
        let error = || sources.error(constant.span().start, "the value of a spectrum is finite");
        return if value.is_finite() { Ok(Spectrum::Constant(value)) } else { Err(error()) };
    }
    let (place, (nm, mut values)) = match (&table.file, &table.wavelengths_nm, &table.values) {
        (Some(file), ..) => (file.span().start, read_file(sources, file, table.column.as_ref())?),
        (None, Some(nm), Some(values)) => {
            (values.span().start, (nm.get_ref().clone(), values.get_ref().clone()))
        }
        _ => return Err(here("`wavelengths_nm` and `values` go together".into())),
    };
    if nm.iter().any(|x| *x <= 0.0) {
        return Err(sources.error(place, "wavelengths are positive, in nm"));
    }
    values.iter_mut().for_each(|v| *v *= scale);
    Spectrum::tabulated(nm, values).map_err(|message| sources.error(place, message))
}

fn read_file(sources: &Sources, file: &Name, column: Option<&Name>) -> Result<csv::Column> {
    let path = sources.directory(file.span().start).join(file.get_ref());
    let source = Source::read(&path, MAX_CSV_BYTES).map_err(|e| sources.blame(file, &path, e))?;
    let place = column.unwrap_or(file).span().start;
    csv::column(&source, column.map(|c| c.get_ref().as_str())).map_err(|e| match e {
        ColumnError::Choice(message) => sources.error(place, message),
        ColumnError::File(error) => error,
    })
}

/// Lowest and highest value.
pub fn range(spectrum: &Spectrum) -> (f64, f64) {
    match spectrum {
        Spectrum::Constant(value) => (*value, *value),
        Spectrum::Tabulated { value, .. } => value
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v))),
    }
}

/// `f(wavelength in nm, value)` at the samples of the spectrum; a constant is sampled every 5 nm.
pub fn map(spectrum: &Spectrum, f: impl Fn(f64, f64) -> f64) -> Spectrum {
    match spectrum {
        Spectrum::Constant(c) => {
            let nm: Vec<f64> = (0..=90).map(|i| 380.0 + 5.0 * f64::from(i)).collect();
            let value = nm.iter().map(|&x| f(x, *c)).collect();
            Spectrum::Tabulated { nm, value }
        }
        Spectrum::Tabulated { nm, value } => {
            let value = nm.iter().zip(value).map(|(&x, &v)| f(x, v)).collect();
            Spectrum::Tabulated { nm: nm.clone(), value }
        }
    }
}

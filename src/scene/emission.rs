//! From the `emission` of a material and the like keys of a light to spectra and amounts.

use super::description::{EmissionTable, Name, SpectrumRef};
use super::source::Sources;
use super::spectra::{Spectra, Use};
use super::suggest;
use crate::error::Result;
use crate::material::{Emission, Level};
use crate::spectrum::{Spectrum, library};
use toml::Spanned;

/// Amounts that may be given, and what each means.
pub type Ways<'a, L, const N: usize> = [(&'a Option<Spanned<f64>>, fn(f64) -> L); N];

/// The emission of a material.
pub fn of_material(sources: &Sources, spectra: &Spectra, at: &Spanned<EmissionTable>) -> Result<Emission> {
    let (table, place) = (at.get_ref(), at.span().start);
    let spectrum = spectrum(sources, spectra, (&table.illuminant, &table.spectrum), "emission", place)?;
    let ways: Ways<Level, 4> = [
        (&table.radiance, Level::Radiance),
        (&table.luminance, Level::Luminance),
        (&table.luminous_flux, Level::LuminousFlux),
        (&table.luminous_intensity, Level::LuminousIntensity),
    ];
    let message = "emission has one of `radiance` (a factor on the spectrum), `luminance` (cd/m2), \
                   `luminous_flux` (lm) and `luminous_intensity` (cd)";
    let level = level(sources, ways, &spectrum, place, message)?;
    Ok(Emission { spectrum: spectrum.0, level })
}

/// The spectrum by one of the two keys, and where it is written.
pub fn spectrum(
    sources: &Sources,
    spectra: &Spectra,
    keys: (&Option<Name>, &Option<Spanned<SpectrumRef>>),
    what: &str,
    place: usize,
) -> Result<(Spectrum, usize)> {
    match keys {
        (Some(name), None) => {
            let spectrum = library::illuminant(name.get_ref()).ok_or_else(|| {
                let known = library::illuminant_names();
                sources.error(name.span().start, suggest::unknown("illuminant", name.get_ref(), &known))
            })?;
            Ok((spectrum, name.span().start))
        }
        (None, Some(s)) => Ok((spectra.get(s, Use::Power)?, s.span().start)),
        _ => Err(sources.error(place, format!("{what} has one of `illuminant` and `spectrum`"))),
    }
}

/// The one amount that is given.
pub fn level<L, const N: usize>(
    sources: &Sources,
    ways: Ways<L, N>,
    (spectrum, written): &(Spectrum, usize),
    place: usize,
    choice: &str,
) -> Result<L> {
    let mut given = ways.into_iter().filter_map(|(value, level)| Some((value.as_ref()?, level)));
    let (Some((value, level)), None) = (given.next(), given.next()) else {
        return Err(sources.error(place, choice));
    };
    let amount = *value.get_ref();
    if !(0.0..=1e15).contains(&amount) {
        return Err(sources.error(value.span().start, "the amount of light lies in 0 to 1e15"));
    }
    visible(sources, (spectrum, *written), amount)?;
    Ok(level(amount))
}

/// Refuses to make an amount of light from a spectrum that has none; `written` is where that stands.
pub fn visible(sources: &Sources, (spectrum, written): (&Spectrum, usize), amount: f64) -> Result<()> {
    let visible = (380..=780).any(|nm| spectrum.at(f64::from(nm)) > 0.0);
    if !visible && amount > 0.0 {
        return Err(sources.error(written, "this spectrum has no power between 380 and 780 nm"));
    }
    Ok(())
}

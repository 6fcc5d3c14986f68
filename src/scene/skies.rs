//! From `[sky]` to a sky.

use super::SceneDescription;
use super::description::{SkyTable, SpectrumRef};
use super::emission::{self, Ways};
use super::places::direction;
use super::sky::{Sky, SkyLevel, SkyShape};
use super::source::Sources;
use super::spectra::{Spectra, Use};
use super::suggest;
use crate::error::Result;
use crate::spectrum::Spectrum;
use glam::DVec3;

/// Names of skies, and their numbers.
const NAMED: [(&str, u8); 4] = [("overcast", 16), ("standard_overcast", 1), ("uniform", 5), ("clear", 12)];

/// Where the zenith of the scene's sky is, if it has one.
pub fn zenith(description: &SceneDescription) -> Result<Option<DVec3>> {
    let Some(at) = &description.document.sky else { return Ok(None) };
    up(&description.sources, at.get_ref()).map(Some)
}

fn up(sources: &Sources, table: &SkyTable) -> Result<DVec3> {
    table.up.as_ref().map_or(Ok(DVec3::Z), |up| direction(sources, up, "the zenith, `up`,"))
}

/// What the sky gives over a geometry with this zenith.
pub fn sky(description: &SceneDescription, spectra: &Spectra, zenith: Option<DVec3>) -> Result<Option<Sky>> {
    let sources = &description.sources;
    let Some(at) = &description.document.sky else { return Ok(None) };
    let (table, place) = (at.get_ref(), at.span().start);
    let shape = shape(sources, table, place)?;
    if zenith != Some(shape.up) {
        let place = table.up.as_ref().map_or(place, |up| up.span().start);
        return Err(sources.error(place, "the zenith of a sky stays where the scene file has it"));
    }
    let keys = (&table.illuminant, &table.spectrum);
    let spectrum = emission::spectrum(sources, spectra, keys, "a sky", place)?;
    let ways: Ways<SkyLevel, 2> =
        [(&table.zenith_luminance, SkyLevel::ZenithLuminance), (&table.illuminance, SkyLevel::Illuminance)];
    let message = "a sky has one of `zenith_luminance` (cd/m2) and `illuminance` (lx, on a horizontal plane)";
    let level = emission::level(sources, ways, &spectrum, place, message)?;
    let ground = match &table.ground {
        Some(ground) => spectra.get(ground, Use::Share)?,
        None => Spectrum::Constant(0.0),
    };
    Ok(Some(Sky { shape, spectrum: spectrum.0, level, ground }))
}

fn shape(sources: &Sources, table: &SkyTable, place: usize) -> Result<SkyShape> {
    let names: Vec<&str> = NAMED.iter().map(|(name, _)| *name).collect();
    let kind = match &table.kind {
        None => {
            let message = format!("a sky has a `type`: {}, or 1 to 16", names.join(", "));
            return Err(sources.error(place, message));
        }
        Some(kind) => match kind.get_ref() {
            SpectrumRef::Constant(number) if number.fract() == 0.0 && (1.0..=16.0).contains(number) => {
                *number as u8
            }
            SpectrumRef::Constant(_) | SpectrumRef::Rgb(_) => {
                let message =
                    "types of sky are 1 to 15, those of CIE S 011, and 16, the traditional overcast sky";
                return Err(sources.error(kind.span().start, message));
            }
            SpectrumRef::Named(name) => match NAMED.iter().find(|(known, _)| known == name) {
                Some((_, number)) => *number,
                None => {
                    let message = suggest::unknown("type of sky", name, &names);
                    return Err(sources.error(kind.span().start, message));
                }
            },
        },
    };
    let up = up(sources, table)?;
    let sun = match &table.sun {
        Some(at) => {
            let sun = direction(sources, at, "`sun`, where the sun is,")?;
            if sun.dot(up) < 0.0 {
                return Err(sources.error(at.span().start, "the sun of a sky is above the horizon"));
            }
            sun
        }
        None if SkyShape::needs_sun(kind) => {
            let message = "this sky is brighter around the sun: give `sun`, the direction towards it";
            return Err(sources.error(place, message));
        }
        None => up,
    };
    Ok(SkyShape { up, sun, kind })
}

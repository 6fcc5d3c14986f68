//! From `[[lights]]` to lights and what they give.

use super::description::LightTable;
use super::emission::{self, Ways};
use super::ies::Luminaire;
use super::light::{Distribution, Light, LightKind, LightLevel, LightSource};
use super::places::{direction, unique, vector};
use super::source::Sources;
use super::spectra::Spectra;
use super::web::WebType;
use super::{Geometry, SceneDescription, suggest};
use crate::error::Result;
use glam::{DVec2, DVec3};
use std::collections::BTreeSet;
use toml::Spanned;

/// More lights than this are refused: each asks something of every sample point.
const MAX_LIGHTS: usize = 4096;
/// Most points along an edge of a luminous opening.
const MAX_SPREAD: u32 = 64;
/// Directional lights shine over all that lies within so many times the scene's radius.
const REACH: f64 = 1.01;

/// The lights in a scene of `radius` centred at `centre`. A luminaire that is spread over its opening is several.
pub fn lights(description: &SceneDescription, centre: DVec3, radius: f64) -> Result<Vec<Light>> {
    let sources = &description.sources;
    let mut names = BTreeSet::new();
    let mut lights = Vec::new();
    for (i, at) in description.document.lights.iter().enumerate() {
        let table = at.get_ref();
        unique(sources, &mut names, &table.name, "lights")?;
        let name = table.name.get_ref().clone();
        if chosen(table) == "directional" {
            lights.push(Light { name, kind: directional(sources, table, at.span().start, radius)? });
        } else {
            let Some(position) = &table.position else {
                return Err(sources.error(at.span().start, "the key `position` is missing here; add it"));
            };
            let position = vector(sources, position, "a light's position")? - centre;
            let distribution = distribution(sources, table, description.luminaires.get(&i))?;
            let offsets = offsets(sources, table, description.luminaires.get(&i), &distribution)?;
            lights.extend(offsets.into_iter().map(|offset| Light {
                name: name.clone(),
                kind: LightKind::Point { position: position + offset, distribution: distribution.clone() },
            }));
        }
        if lights.len() > MAX_LIGHTS {
            let message = format!(
                "there are more than {MAX_LIGHTS} lights, all points of spread luminaires counted; leave some out"
            );
            return Err(sources.error(at.span().start, message));
        }
    }
    Ok(lights)
}

/// What each light of `geometry` gives, which [`lights`] made of this description.
pub fn sources(
    description: &SceneDescription,
    spectra: &Spectra,
    geometry: &Geometry,
) -> Result<Vec<LightSource>> {
    let document = &description.document;
    let mut all = Vec::with_capacity(geometry.lights.len());
    for (i, at) in document.lights.iter().enumerate() {
        let name = at.get_ref().name.get_ref();
        let own = geometry.lights[all.len()..].iter().take_while(|light| light.name == *name);
        let parts: Vec<&Light> = own.collect();
        let Some(first) = parts.first() else { break };
        let source = source(&description.sources, spectra, at, description.luminaires.get(&i), first)?;
        let share = source.level.scaled(1.0 / parts.len() as f64);
        all.extend(parts.iter().map(|_| LightSource { level: share, ..source.clone() }));
    }
    if all.len() != geometry.lights.len() || document.lights.is_empty() != geometry.lights.is_empty() {
        let message = "this geometry was not compiled with the lights of this scene file";
        return Err(description.sources.error(0, message));
    }
    Ok(all)
}

/// What one of `[[lights]]` gives, all of its points together; `light` is one of these.
fn source(
    sources: &Sources,
    spectra: &Spectra,
    at: &Spanned<LightTable>,
    luminaire: Option<&Luminaire>,
    light: &Light,
) -> Result<LightSource> {
    let (table, place) = (at.get_ref(), at.span().start);
    let keys = (&table.illuminant, &table.spectrum);
    let spectrum = emission::spectrum(sources, spectra, keys, "a light", place)?;
    let points: Ways<LightLevel, 2> = [
        (&table.luminous_flux, LightLevel::LuminousFlux),
        (&table.luminous_intensity, LightLevel::LuminousIntensity),
    ];
    let of_file = match luminaire {
        Some(luminaire) if points.iter().all(|(key, _)| key.is_none()) => Some(luminaire),
        _ => None,
    };
    let scale = match &table.scale {
        None => 1.0,
        Some(scale) if of_file.is_none() => {
            let message =
                "`scale` is a factor on the candela values of an IES file: give no other amount with it";
            return Err(sources.error(scale.span().start, message));
        }
        Some(scale) if (0.0..=1e9).contains(scale.get_ref()) => *scale.get_ref(),
        Some(scale) => return Err(sources.error(scale.span().start, "a scale lies in 0 to 1e9")),
    };
    let level = if let LightKind::Directional { .. } = light.kind {
        let ways = [(&table.illuminance, LightLevel::Illuminance as fn(f64) -> LightLevel)];
        only(
            sources,
            points.map(|(key, _)| key),
            "a directional light has `illuminance` (lx), on a plane that faces it",
        )?;
        let message = "a directional light has `illuminance` (lx), on a plane that faces it; add it";
        emission::level(sources, ways, &spectrum, place, message)?
    } else {
        only(
            sources,
            [&table.illuminance],
            "`illuminance` is that of a directional light; this has `luminous_flux` (lm) or `luminous_intensity` (cd)",
        )?;
        match (of_file, &light.kind) {
            (Some(luminaire), LightKind::Point { distribution, .. }) => {
                let tilted = luminaire.at_tilt(tilt(distribution));
                let amount = luminaire.web.largest() * tilted * scale;
                emission::visible(sources, (&spectrum.0, spectrum.1), amount)?;
                LightLevel::LuminousIntensity(amount)
            }
            _ => {
                let message = "a light has one of `luminous_flux` (lm) and `luminous_intensity` (cd)";
                emission::level(sources, points, &spectrum, place, message)?
            }
        }
    };
    Ok(LightSource { spectrum: spectrum.0, level })
}

/// Refuses keys that are not for this kind of light.
fn only<const N: usize>(sources: &Sources, keys: [&Option<Spanned<f64>>; N], message: &str) -> Result<()> {
    match keys.into_iter().flatten().next() {
        Some(key) => Err(sources.error(key.span().start, message)),
        None => Ok(()),
    }
}

/// By how much a luminaire is turned from hanging straight down, degrees.
fn tilt(distribution: &Distribution) -> f64 {
    match distribution {
        Distribution::Web { frame, .. } => (*frame * DVec3::NEG_Z).angle_between(DVec3::NEG_Z).to_degrees(),
        _ => 0.0,
    }
}

const DISTRIBUTIONS: [&str; 4] = ["isotropic", "lambertian", "spot", "directional"];

fn chosen(table: &LightTable) -> &str {
    let plain = if table.ies.is_some() { "ies" } else { "isotropic" };
    table.distribution.as_ref().map_or(plain, |d| d.get_ref().as_str())
}

fn directional(sources: &Sources, table: &LightTable, place: usize, radius: f64) -> Result<LightKind> {
    if let Some(position) = &table.position {
        let message = "a directional light comes from infinity and has no `position`";
        return Err(sources.error(position.span().start, message));
    }
    allow(sources, table, &["direction", "diameter_deg"], "directional")?;
    let Some(towards) = &table.direction else {
        let message = "a directional light has a `direction`, the way its light goes; add one";
        return Err(sources.error(place, message));
    };
    let diameter = degrees(
        sources,
        &table.diameter_deg,
        0.0,
        0.0..=90.0,
        "diameter_deg, the angle that the light fills,",
    )?;
    Ok(LightKind::Directional {
        from: -direction(sources, towards, "a light's direction")?,
        radius: 0.5 * diameter.to_radians(),
        reach: REACH * radius,
    })
}

fn distribution(
    sources: &Sources,
    table: &LightTable,
    luminaire: Option<&Luminaire>,
) -> Result<Distribution> {
    let axis = |what: &str| match &table.direction {
        Some(axis) => direction(sources, axis, "a light's direction"),
        None => {
            let at = table.distribution.as_ref().map_or(0, |d| d.span().start);
            Err(sources.error(at, format!("{what} light has a `direction`; add one")))
        }
    };
    match chosen(table) {
        "ies" if table.ies.is_some() => {
            allow(sources, table, &["direction", "ies", "c0", "up", "spread"], "ies")?;
            luminaire.map_or(Ok(Distribution::Isotropic), |l| web(sources, table, l))
        }
        "isotropic" => {
            allow(sources, table, &[], "isotropic")?;
            Ok(Distribution::Isotropic)
        }
        "lambertian" => {
            allow(sources, table, &["direction"], "lambertian")?;
            Ok(Distribution::Lambertian { axis: axis("a lambertian")? })
        }
        "spot" => {
            allow(sources, table, &["direction", "inner_cone_deg", "outer_cone_deg"], "spot")?;
            let axis = axis("a spot")?;
            let half = "half the angle of a spot's outer cone,";
            let outer = degrees(sources, &table.outer_cone_deg, 45.0, 0.01..=180.0, half)?;
            let half = "half the angle of a spot's inner cone, no wider than the outer one,";
            let inner = degrees(sources, &table.inner_cone_deg, 0.0, 0.0..=outer, half)?;
            Ok(Distribution::Spot { axis, inner: inner.to_radians().cos(), outer: outer.to_radians().cos() })
        }
        other => {
            let at = table.distribution.as_ref().map_or(0, |d| d.span().start);
            Err(sources.error(at, suggest::unknown("distribution", other, &DISTRIBUTIONS)))
        }
    }
}

/// Refuses keys that say how light is distributed and are not among those `allowed` for `kind`.
fn allow(sources: &Sources, table: &LightTable, allowed: &[&str], kind: &str) -> Result<()> {
    let start = |span: Option<std::ops::Range<usize>>| span.map(|s| s.start);
    let keys = [
        (
            "direction",
            start(table.direction.as_ref().map(Spanned::span)),
            "lambertian, spot and directional lights and IES files",
        ),
        (
            "inner_cone_deg",
            start(table.inner_cone_deg.as_ref().map(Spanned::span)),
            "distribution = \"spot\"",
        ),
        (
            "outer_cone_deg",
            start(table.outer_cone_deg.as_ref().map(Spanned::span)),
            "distribution = \"spot\"",
        ),
        (
            "diameter_deg",
            start(table.diameter_deg.as_ref().map(Spanned::span)),
            "distribution = \"directional\"",
        ),
        ("ies", start(table.ies.as_ref().map(Spanned::span)), "no `distribution`: it is one itself"),
        ("c0", start(table.c0.as_ref().map(Spanned::span)), "`ies`"),
        ("up", start(table.up.as_ref().map(Spanned::span)), "`ies`"),
        ("spread", start(table.spread.as_ref().map(Spanned::span)), "`ies`"),
    ];
    for (key, at, with) in keys {
        if let Some(at) = at.filter(|_| !allowed.contains(&key)) {
            let kind = match kind {
                "isotropic" => "an isotropic light has none".into(),
                other => format!("this light is {other}"),
            };
            return Err(sources.error(at, format!("`{key}` goes with {with}; {kind}")));
        }
    }
    Ok(())
}

fn degrees(
    sources: &Sources,
    key: &Option<Spanned<f64>>,
    plain: f64,
    range: std::ops::RangeInclusive<f64>,
    what: &str,
) -> Result<f64> {
    match key {
        None => Ok(plain.min(*range.end())),
        Some(value) if range.contains(value.get_ref()) => Ok(*value.get_ref()),
        Some(value) => {
            let message = format!("{what} lies between {} and {} degrees", range.start(), range.end());
            Err(sources.error(value.span().start, message))
        }
    }
}

/// The distribution of a luminaire as it is turned.
fn web(sources: &Sources, table: &LightTable, luminaire: &Luminaire) -> Result<Distribution> {
    let axis = match &table.direction {
        Some(axis) => direction(sources, axis, "a light's direction")?,
        None => DVec3::NEG_Z,
    };
    let vertical = luminaire.web.kind() == WebType::C;
    let (own, other) = if vertical { (&table.c0, &table.up) } else { (&table.up, &table.c0) };
    if let Some(other) = other {
        let message = if vertical {
            "`up` turns files of types A and B; this one is of type C: give `c0`"
        } else {
            "`c0` turns files of type C; this one is of type A or B: give `up`"
        };
        return Err(sources.error(other.span().start, message));
    }
    let usual = if vertical { [DVec3::X, DVec3::Z] } else { [DVec3::Z, DVec3::X] };
    let aside = match own {
        Some(given) => {
            let aside = direction(sources, given, "`c0` or `up`")?;
            if aside.cross(axis).length() < 1e-6 {
                let message =
                    "this lies along the light's direction, which it is to turn about; give one across it";
                return Err(sources.error(given.span().start, message));
            }
            aside
        }
        None => usual.into_iter().find(|u| u.cross(axis).length() > 1e-3).unwrap_or(DVec3::X),
    };
    Ok(Distribution::web(luminaire.web.clone(), axis, aside))
}

/// Where the points of a light stand about its position: one, or those that are spread over the luminous opening.
fn offsets(
    sources: &Sources,
    table: &LightTable,
    luminaire: Option<&Luminaire>,
    distribution: &Distribution,
) -> Result<Vec<DVec3>> {
    let (Some(spread), Some(luminaire), Distribution::Web { frame, .. }) =
        (&table.spread, luminaire, distribution)
    else {
        return Ok(vec![DVec3::ZERO]);
    };
    let wrong = |message: &str| Err(sources.error(spread.span().start, message));
    let [nx, ny] = *spread.get_ref();
    if !(1..=MAX_SPREAD).contains(&nx) || !(1..=MAX_SPREAD).contains(&ny) {
        return wrong(
            "`spread` is how many points stand along the luminaire's length and width, 1 to 64 each",
        );
    }
    if luminaire.web.kind() != WebType::C {
        return wrong("only luminaires of type C are spread over their opening");
    }
    let [length, width, _] = luminaire.opening;
    if length == 0.0 && width == 0.0 {
        return wrong("the IES file gives no luminous opening to be spread over; leave `spread` out");
    }
    let share = |k: u32, n: u32| (f64::from(k) + 0.5) / f64::from(n) - 0.5;
    let cells = (0..ny).flat_map(|j| (0..nx).map(move |i| DVec2::new(share(i, nx), share(j, ny))));
    let inside = cells.filter(|at| !luminaire.round || at.length() <= 0.5);
    let place = |at: DVec2| frame.transpose() * DVec3::new(at.x * length, at.y * width, 0.0);
    Ok(inside.map(place).collect())
}

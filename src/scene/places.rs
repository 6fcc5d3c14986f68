//! From `[[sensors]]` and `[[grids]]` to places in the scene.

use super::SceneDescription;
use super::compile::MAX_COORDINATE;
use super::description::{GridTable, Name, SensorTable};
use super::sensor::{Grid, Sensor};
use super::source::Sources;
use crate::error::Result;
use glam::DVec3;
use std::collections::BTreeSet;
use toml::Spanned;

/// Most sensors along an edge of a grid.
const MAX_COUNT: u32 = 4096;
/// Most sensors, those of grids included.
const MAX_SENSORS: usize = 1 << 18;

/// A vector whose coordinates a scene can hold. `what` is a noun: "a light's position".
pub fn vector(sources: &Sources, at: &Spanned<[f64; 3]>, what: &str) -> Result<DVec3> {
    if at.get_ref().iter().all(|x| x.abs() <= MAX_COORDINATE) {
        return Ok(DVec3::from_array(*at.get_ref()));
    }
    Err(sources.error(at.span().start, format!("{what} has finite coordinates of at most 1e18")))
}

/// A direction, made unit.
pub fn direction(sources: &Sources, at: &Spanned<[f64; 3]>, what: &str) -> Result<DVec3> {
    let error = || sources.error(at.span().start, format!("{what} is a direction and cannot be zero"));
    vector(sources, at, what)?.try_normalize().ok_or_else(error)
}

/// Refuses a name that was met before.
pub fn unique<'a>(
    sources: &Sources,
    names: &mut BTreeSet<&'a String>,
    name: &'a Name,
    what: &str,
) -> Result<()> {
    if names.insert(name.get_ref()) {
        return Ok(());
    }
    let message = format!("there are two {what} \"{}\"; rename one", name.get_ref());
    Err(sources.error(name.span().start, message))
}

/// The sensors and the grids, whose names differ from each other.
pub fn sensors(description: &SceneDescription) -> Result<(Vec<Sensor>, Vec<Grid>)> {
    let (sources, document) = (&description.sources, &description.document);
    let mut names = BTreeSet::new();
    let mut sensors = Vec::new();
    for table in document.sensors.iter().map(Spanned::get_ref) {
        unique(sources, &mut names, &table.name, "sensors or grids")?;
        sensors.push(sensor(sources, table)?);
    }
    let mut grids = Vec::new();
    let mut total = sensors.len();
    if let Some(first) = document.sensors.get(MAX_SENSORS) {
        let message = format!("there are more than {MAX_SENSORS} sensors; leave some out");
        return Err(sources.error(first.span().start, message));
    }
    for table in document.grids.iter().map(Spanned::get_ref) {
        unique(sources, &mut names, &table.name, "sensors or grids")?;
        let grid = grid(sources, table)?;
        total += grid.len();
        if total > MAX_SENSORS {
            let message =
                format!("there are more than {MAX_SENSORS} sensors with those of the grids; count fewer");
            return Err(sources.error(table.counts.span().start, message));
        }
        grids.push(grid);
    }
    Ok((sensors, grids))
}

fn sensor(sources: &Sources, table: &SensorTable) -> Result<Sensor> {
    Ok(Sensor {
        name: table.name.get_ref().clone(),
        position: vector(sources, &table.position, "a sensor's position")?,
        normal: direction(sources, &table.normal, "a sensor's normal")?,
    })
}

fn grid(sources: &Sources, table: &GridTable) -> Result<Grid> {
    let counts = *table.counts.get_ref();
    if !counts.iter().all(|n| (1..=MAX_COUNT).contains(n)) {
        let message = format!("counts are two numbers from 1 to {MAX_COUNT}");
        return Err(sources.error(table.counts.span().start, message));
    }
    let [origin, u, v] = [&table.origin, &table.u, &table.v].map(|at| vector(sources, at, "a grid"));
    let (origin, u, v) = (origin?, u?, v?);
    let normal = match &table.normal {
        Some(normal) => direction(sources, normal, "a grid's normal")?,
        None => u.normalize_or_zero().cross(v.normalize_or_zero()).try_normalize().ok_or_else(|| {
            let message = "the edges u and v span no plane; change one, or give the grid a `normal`";
            sources.error(table.v.span().start, message)
        })?,
    };
    let offset = table.offset.as_ref().map_or(0.0, |o| *o.get_ref());
    if offset.is_nan() || offset.abs() > MAX_COORDINATE {
        let at = table.offset.as_ref().map_or(0, |o| o.span().start);
        return Err(sources.error(at, "an offset is a finite length in m"));
    }
    Ok(Grid { name: table.name.get_ref().clone(), origin, u, v, counts, normal, offset })
}

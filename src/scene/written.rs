//! Shapes as an entry of `[[objects]]` writes them.

use super::compile::MAX_COORDINATE;
use super::description::{ConeTable, CylinderTable, DiscTable, ObjectTable, SphereTable};
use super::places::{direction, vector};
use super::source::Sources;
use crate::error::Result;
use crate::geometry::{Cone, Disc, Patch, Shape, Sphere};
use glam::DVec3;
use toml::Spanned;

/// Whether the entry has shapes of its own.
pub fn is_drawn(table: &ObjectTable) -> bool {
    !(table.quads.is_empty()
        && table.triangles.is_empty()
        && table.discs.is_empty()
        && table.spheres.is_empty()
        && table.cylinders.is_empty()
        && table.cones.is_empty()
        && table.patches.is_empty())
}

/// Its shapes, in world coordinates, each with its place in the file. Corners are taken as they are.
pub fn shapes(sources: &Sources, table: &ObjectTable) -> Result<Vec<(Shape, usize)>> {
    let mut shapes = Vec::new();
    for quad in &table.quads {
        shapes.push((Shape::Quad(quad.get_ref().map(DVec3::from_array)), quad.span().start));
    }
    for triangle in &table.triangles {
        shapes.push((Shape::Triangle(triangle.get_ref().map(DVec3::from_array)), triangle.span().start));
    }
    for table in &table.discs {
        shapes.push((disc(sources, table.get_ref())?, table.span().start));
    }
    for table in &table.spheres {
        shapes.push((sphere(sources, table.get_ref())?, table.span().start));
    }
    for table in &table.cylinders {
        shapes.push((cylinder(sources, table.get_ref())?, table.span().start));
    }
    for table in &table.cones {
        shapes.push((cone(sources, table.get_ref())?, table.span().start));
    }
    for table in &table.patches {
        let net = table.get_ref().map(|row| row.map(DVec3::from_array));
        if !net.iter().flatten().all(|p| p.abs().max_element() <= MAX_COORDINATE) {
            let message = "the control points of a patch have finite coordinates of at most 1e18";
            return Err(sources.error(table.span().start, message));
        }
        shapes.push((Patch::new(net).into(), table.span().start));
    }
    Ok(shapes)
}

fn disc(sources: &Sources, table: &DiscTable) -> Result<Shape> {
    let centre = vector(sources, &table.centre, "the centre of a disc")?;
    let normal = direction(sources, &table.normal, "the normal of a disc")?;
    Ok(Disc { centre, normal, radius: radius(sources, &table.radius)? }.into())
}

fn sphere(sources: &Sources, table: &SphereTable) -> Result<Shape> {
    let centre = vector(sources, &table.centre, "the centre of a sphere")?;
    Ok(Sphere { centre, radius: radius(sources, &table.radius)?, inward: table.inward }.into())
}

fn cylinder(sources: &Sources, table: &CylinderTable) -> Result<Shape> {
    let (base, top) = ends(sources, &table.base, &table.top)?;
    let radius = radius(sources, &table.radius)?;
    Ok(Cone { base, top, radius, top_radius: radius, inward: table.inward }.into())
}

fn cone(sources: &Sources, table: &ConeTable) -> Result<Shape> {
    let (base, top) = ends(sources, &table.base, &table.top)?;
    let end = |at: &Spanned<f64>| if *at.get_ref() == 0.0 { Ok(0.0) } else { radius(sources, at) };
    let (radius, top_radius) = (end(&table.radius)?, table.top_radius.as_ref().map_or(Ok(0.0), end)?);
    if radius == 0.0 && top_radius == 0.0 {
        let message = "a cone has a radius at one end at least; give `radius` or `top_radius`";
        return Err(sources.error(table.radius.span().start, message));
    }
    Ok(Cone { base, top, radius, top_radius, inward: table.inward }.into())
}

/// The middles of both ends of an axis.
fn ends(sources: &Sources, base: &Spanned<[f64; 3]>, top: &Spanned<[f64; 3]>) -> Result<(DVec3, DVec3)> {
    let at = top.span().start;
    let (base, top) = (vector(sources, base, "the base")?, vector(sources, top, "the top")?);
    if base == top {
        return Err(sources.error(at, "base and top are one place; a cylinder or a cone has a height"));
    }
    Ok((base, top))
}

fn radius(sources: &Sources, at: &Spanned<f64>) -> Result<f64> {
    match *at.get_ref() {
        radius if radius > 0.0 && radius <= MAX_COORDINATE => Ok(radius),
        _ => Err(sources.error(at.span().start, "a radius is a positive number of metres, at most 1e18")),
    }
}

//! From shapes as written and the faces of models to the geometry of a scene.

use super::compile::{MAX_COORDINATE, MIN_RADIUS};
use super::import;
use super::parts::{FacePlace, Part};
use super::{Geometry, ObjectId, SceneDescription, joined, written};
use crate::error::Result;
use crate::geometry::{Aabb, QuadKind, Round, Shape, Surface, classify_quad, is_triangle};
use glam::DVec3;

/// More surfaces than this are refused.
const MAX_SURFACES: usize = 4_000_000;

/// Geometry, and what had to be mended in it.
pub struct Shaped {
    /// The geometry.
    pub geometry: Geometry,
    /// One sentence for each kind of mending and object.
    pub notes: Vec<String>,
}

/// A face as written, in world coordinates.
struct Face {
    shape: Shape,
    part: usize,
    /// Faces with the same number are pieces of one smooth surface.
    patch: u32,
    place: FacePlace,
}

/// What became of the faces of a part.
#[derive(Clone, Copy, Default)]
struct Mended {
    warped: usize,
    not_convex: usize,
    without_area: usize,
}

/// Makes the geometry of `parts`. `both_sides` tells whether a part has sample points on both.
pub fn shape(
    description: &SceneDescription,
    parts: &[Part],
    both_sides: impl Fn(&Part) -> bool,
) -> Result<Shaped> {
    let faces = faces(description, parts)?;
    // Faces are judged as they will be stored: relative to the centre and on the f32 lattice.
    let bounds = faces.iter().fold(Aabb::EMPTY, |b, f| b.union(f.shape.bounds()));
    let centre = bounds.centre();
    let stored = |p: DVec3| (p - centre).as_vec3().as_dvec3();
    let mut shapes = Vec::with_capacity(faces.len());
    let mut places = Vec::with_capacity(faces.len());
    let mut mended = vec![Mended::default(); parts.len()];
    let joined = joined::first_of_each(faces.iter().map(|face| (&face.shape, face.part)));
    for (face, &first) in faces.iter().zip(&joined) {
        let from_model = matches!(face.place, FacePlace::Model(..));
        let pieces = match pieces(&face.shape, stored) {
            Ok(pieces) => {
                mended[face.part].warped += pieces.len() - 1;
                pieces
            }
            Err(Fault::NoArea) if from_model => {
                mended[face.part].without_area += 1;
                continue;
            }
            Err(Fault::NotConvex(corner)) if from_model => {
                mended[face.part].not_convex += 1;
                cut(&face.shape, corner, stored)
            }
            Err(fault) => return Err(face.place.error(description, fault.message())),
        };
        let two_sided = both_sides(&parts[face.part]);
        for shape in pieces {
            shapes.push((shape, two_sided, faces[first as usize].patch, ObjectId(face.part as u32)));
            places.push(face.place);
        }
    }
    if shapes.is_empty() {
        let message = "there is no surface; add [[objects]] with quads, triangles, discs, spheres, cylinders, cones, \
                       patches, or an obj or gltf file";
        return Err(description.sources.error(0, message));
    }
    let mut geometry = Geometry::new(shapes, parts.iter().map(|p| p.name.clone()).collect());
    if let Some(i) = geometry.surfaces.iter().position(|s| is_too_small(s, &geometry)) {
        let message = "this surface is too small next to the size of the scene";
        return Err(places[i].error(description, message));
    }
    if geometry.radius < MIN_RADIUS {
        let message = format!(
            "the whole scene has a radius of {:.1e} m, less than {MIN_RADIUS:e} m; coordinates are in metres",
            geometry.radius
        );
        return Err(places[0].error(description, message));
    }
    for (object, max_area) in geometry.object.iter().zip(&mut geometry.max_area) {
        let table = description.document.objects[parts[object.0 as usize].object].get_ref();
        *max_area = table.max_area.as_ref().map(|a| *a.get_ref());
    }
    Ok(Shaped { geometry, notes: notes(description, parts, &mended) })
}

/// Whether the `f32` lattice leaves nothing of a surface: no area, or less of what is no polygon than points must be
/// apart to face each other.
fn is_too_small(surface: &Surface, geometry: &Geometry) -> bool {
    let flat = surface.plane().is_some_and(|plane| plane.normal == DVec3::ZERO);
    let lost = |round: &Round| round.least_size() < 16.0 * geometry.plane_tolerance();
    surface.area <= 0.0 || !surface.area.is_finite() || flat || surface.round().is_some_and(lost)
}

/// All faces in the order of the parts; numbers are finite and in range.
fn faces(description: &SceneDescription, parts: &[Part]) -> Result<Vec<Face>> {
    let mut faces = Vec::new();
    let (mut part, mut patches) = (0, 0);
    for (i, object) in description.document.objects.iter().enumerate() {
        check_object(description, i)?;
        let table = object.get_ref();
        let first = part;
        while parts.get(part).is_some_and(|p| p.object == i) {
            part += 1;
        }
        let drawn = written::shapes(&description.sources, table)?;
        for (shape, at) in drawn {
            faces.push(Face { shape, part: first, patch: patches, place: FacePlace::Toml(at) });
            patches += 1;
        }
        let Some(model) = description.models.get(&i) else { continue };
        let scale = table.scale.as_ref().map_or(1.0, |s| *s.get_ref());
        let translate = table.translate.as_ref().map_or(DVec3::ZERO, |t| DVec3::from_array(*t.get_ref()));
        let left_out = |face: &&import::Face| {
            let worn = model.parts[face.part as usize].material.as_deref();
            table.leave_out.iter().any(|name| worn == Some(name.get_ref().as_str()))
        };
        let kept = || model.faces.iter().filter(|face| !left_out(face));
        let count = faces.len() + kept().count();
        if count > MAX_SURFACES {
            let message = format!("there are {count} surfaces, more than {MAX_SURFACES}; leave some out");
            return Err(description.sources.error(0, message));
        }
        for face in kept() {
            let [a, b, c, d] = face.corners.map(|v| scale * model.vertices[v as usize] + translate);
            let shape = if face.count == 4 { Shape::Quad([a, b, c, d]) } else { Shape::Triangle([a, b, c]) };
            let (part, patch) = (first + face.part as usize, patches + face.patch);
            faces.push(Face { shape, part, patch, place: FacePlace::Model(i, face.place) });
        }
        patches += model.patches;
    }
    faces.retain_mut(|face| {
        let part = &parts[face.part];
        if let Some(motion) = &part.motion {
            face.shape = motion.moved(&face.shape);
        }
        !part.removed
    });
    for face in &faces {
        let shape = &face.shape;
        let Aabb { min, max } = shape.round().map_or(Aabb::EMPTY, Round::bounds);
        let ends = if shape.round().is_some() { &[min, max][..] } else { &[] };
        if !shape
            .vertices()
            .iter()
            .chain(ends)
            .all(|p| p.abs().max_element() <= MAX_COORDINATE && p.is_finite())
        {
            let message = "a corner is not finite or beyond 1e18 m; mend the coordinates";
            return Err(face.place.error(description, message));
        }
    }
    Ok(faces)
}

/// Refuses an entry of `[[objects]]` whose keys do not go together.
fn check_object(description: &SceneDescription, i: usize) -> Result<()> {
    let object = &description.document.objects[i];
    let (table, sources) = (object.get_ref(), &description.sources);
    let files = usize::from(table.obj.is_some()) + usize::from(table.gltf.is_some());
    let is_model = description.models.contains_key(&i);
    if written::is_drawn(table) == is_model || files > 1 {
        let message = format!(
            "object \"{}\" needs `quads`, `triangles`, `discs`, `spheres`, `cylinders`, `cones` or `patches`, or else \
             `obj` or `gltf`; give one or the other",
            table.name.get_ref()
        );
        return Err(sources.error(object.span().start, message));
    }
    if let Some(model) = description.models.get(&i)
        && let Some(wrong) = table
            .leave_out
            .iter()
            .find(|name| model.parts.iter().all(|p| p.material.as_deref() != Some(name.get_ref().as_str())))
    {
        let message =
            format!("no face of the file wears the material \"{}\"; mind the name", wrong.get_ref());
        return Err(sources.error(wrong.span().start, message));
    }
    let with_obj = [
        table.scale.as_ref().map(toml::Spanned::span),
        table.translate.as_ref().map(toml::Spanned::span),
        table.materials.keys().next().map(toml::Spanned::span),
        table.leave_out.first().map(toml::Spanned::span),
    ];
    if let Some(span) = with_obj.into_iter().flatten().next().filter(|_| !is_model) {
        let message = "`scale`, `translate`, `materials` and `leave_out` go with `obj` and `gltf`";
        return Err(sources.error(span.start, message));
    }
    for (number, what) in [(&table.scale, "`scale`"), (&table.max_area, "`max_area`, m2,")] {
        if let Some(x) = number
            && !(x.get_ref().is_finite() && *x.get_ref() > 0.0)
        {
            return Err(sources.error(x.span().start, format!("{what} is a positive number")));
        }
    }
    Ok(())
}

/// Why a face cannot be used.
enum Fault {
    NoArea,
    NotConvex(usize),
}

impl Fault {
    fn message(self) -> String {
        match self {
            Fault::NoArea => "this surface has no area; remove it or mend its corners".into(),
            Fault::NotConvex(corner) => format!(
                "this quadrilateral is not convex: corner {} turns inwards or lies straight between its \
                 neighbours; split it into triangles or order its corners around the edge",
                corner + 1
            ),
        }
    }
}

/// The triangles on both sides of the diagonal from the corner that spoils a quadrilateral; those that have an area.
fn cut(quad: &Shape, corner: usize, stored: impl Fn(DVec3) -> DVec3) -> Vec<Shape> {
    let Shape::Quad(v) = quad else { return Vec::new() };
    let triangle = |steps: [usize; 3]| steps.map(|s| v[(corner + s) % 4]);
    let triangles = [triangle([0, 1, 2]), triangle([0, 2, 3])];
    triangles.into_iter().filter(|t| is_triangle(&t.map(&stored))).map(Shape::Triangle).collect()
}

/// The surfaces that stand for a face: itself, or the two triangles of a warped quadrilateral.
/// `stored` gives a corner as the geometry will hold it.
fn pieces(shape: &Shape, stored: impl Fn(DVec3) -> DVec3) -> std::result::Result<Vec<Shape>, Fault> {
    let triangle = |t: [DVec3; 3]| {
        if is_triangle(&t.map(&stored)) { Ok(Shape::Triangle(t)) } else { Err(Fault::NoArea) }
    };
    let [a, b, c, d] = match *shape {
        Shape::Triangle(t) => return Ok(vec![triangle(t)?]),
        Shape::Quad(quad) => quad,
        Shape::Round(_) => return Ok(vec![shape.clone()]),
    };
    match classify_quad(&[a, b, c, d].map(&stored)) {
        QuadKind::Flat => Ok(vec![shape.clone()]),
        QuadKind::Warped => Ok(vec![triangle([a, b, d])?, triangle([c, d, b])?]),
        QuadKind::NotConvex(corner) => Err(Fault::NotConvex(corner)),
        QuadKind::Degenerate => Err(Fault::NoArea),
    }
}

/// What was mended, by object; all that came from one model together.
fn notes(description: &SceneDescription, parts: &[Part], mended: &[Mended]) -> Vec<String> {
    let mut of_object: Vec<(&str, Mended)> = Vec::new();
    for (part, mended) in parts.iter().zip(mended) {
        let name = match part.model_part {
            Some(_) => description.document.objects[part.object].get_ref().name.get_ref(),
            None => &part.name,
        };
        match of_object.last_mut().filter(|(last, _)| last == name) {
            Some((_, sum)) => {
                sum.warped += mended.warped;
                sum.not_convex += mended.not_convex;
                sum.without_area += mended.without_area;
            }
            None => of_object.push((name, *mended)),
        }
    }
    let mut notes = Vec::new();
    for (name, Mended { warped, not_convex, without_area }) in of_object {
        if warped > 0 {
            let are = if warped == 1 { "quadrilateral is" } else { "quadrilaterals are" };
            notes.push(format!(
                "object \"{name}\": {warped} {are} out of plane, each is taken as two triangles"
            ));
        }
        if not_convex > 0 {
            let are = if not_convex == 1 { "quadrilateral is" } else { "quadrilaterals are" };
            notes.push(format!(
                "object \"{name}\": {not_convex} {are} not convex, each is cut in two triangles"
            ));
        }
        if without_area > 0 {
            let faces = if without_area == 1 { "face" } else { "faces" };
            notes.push(format!("object \"{name}\": {without_area} {faces} without area left out"));
        }
    }
    notes
}

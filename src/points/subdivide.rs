//! Dividing surfaces into elements, and elements into sample points.

use super::{Cell, NO_POINT, SamplePoints, Sampling};
use crate::geometry::{Round, Side, Surface, SurfaceId};
use crate::scene::Geometry;
use glam::{DVec3, Vec3};

/// An element: a cell of a surface.
pub type Element = (SurfaceId, Cell);

/// Divides every surface until no element is larger than `sampling.max_area`, or than the area
/// that the scene sets for the surface's object (section 3.1.2).
pub fn divide_by_area(geometry: &Geometry, sampling: &Sampling) -> Vec<Element> {
    let mut elements = Vec::new();
    let mut open: Vec<Element> = Vec::new();
    for s in 0..geometry.surfaces.len() {
        open.push((SurfaceId(s as u32), Cell::ROOT));
        let max_area = geometry.max_area_of(SurfaceId(s as u32), sampling);
        while let Some((id, cell)) = open.pop() {
            let least = geometry.surface(id).round().map_or(0, Round::least_level);
            let large = cell.level < least || element_area(geometry, (id, cell)) > max_area;
            if large && cell.level < sampling.max_level.min(Cell::MAX_LEVEL) {
                open.extend((0..4).rev().map(|c| (id, cell.child(c))));
            } else {
                elements.push((id, cell));
            }
        }
    }
    elements
}

/// Area of an element, m².
pub fn element_area(geometry: &Geometry, (id, cell): Element) -> f64 {
    if let Some(round) = geometry.surface(id).round() {
        let (low, size) = cell.square();
        return round.cell_area(low, size);
    }
    let c = cell.corners(geometry.surface(id));
    0.5 * (c[2] - c[0]).cross(c[3] - c[1]).length()
}

/// `p` on the `f32` lattice, and not behind the surface as seen from `side`: rounding (and the fold
/// of a quadrilateral that is not quite planar) may put a point beyond its own surface, which would
/// then block all segments that leave the point at a flat angle, however they are shortened.
fn place_on_side(surface: &Surface, p: DVec3, side: Side) -> Vec3 {
    let sign = if side == Side::Front { 1.0 } else { -1.0 };
    let rounded = p.as_vec3();
    let (triangles, count) = surface.triangles();
    let depth = triangles[..count]
        .iter()
        .map(|[a, b, c]| -sign * (*b - *a).cross(*c - *a).normalize_or_zero().dot(rounded.as_dvec3() - *a))
        .fold(0.0, f64::max);
    let depth = match surface.round() {
        Some(round) => (-sign * round.distance(rounded.as_dvec3())).max(0.0),
        None => depth,
    };
    if depth == 0.0 {
        return rounded;
    }
    let rounding = f64::from(f32::EPSILON) * p.abs().max_element();
    (p + sign * (depth + rounding) * surface.normal_at(p)).as_vec3()
}

impl SamplePoints {
    /// One point at the centre of each element, two where the surface is two-sided, sorted by
    /// voxel. `voxel_of` gives the voxel, below `voxels`, of a place in local coordinates, m; the
    /// order of `elements` does not matter.
    ///
    /// # Panics
    /// If an element is not on a surface of `geometry`, or a voxel is not below `voxels`.
    pub fn new(
        geometry: &Geometry,
        elements: &[Element],
        voxels: usize,
        voxel_of: impl Fn(DVec3) -> usize,
    ) -> SamplePoints {
        struct Draft {
            voxel: usize,
            element: Element,
            side: Side,
            position: Vec3,
        }
        let mut drafts = Vec::with_capacity(elements.len());
        for &(id, cell) in elements {
            let surface = geometry.surface(id);
            let uv = cell.centre_uv(&surface.shape);
            let centre = surface.point_at(uv.x, uv.y);
            let position = place_on_side(surface, centre, Side::Front);
            // The voxel is that of the front point as stored, for both: twins stay together.
            let voxel = voxel_of(position.as_dvec3());
            drafts.push(Draft { voxel, element: (id, cell), side: Side::Front, position });
            if geometry.two_sided[id.index()] {
                let position = place_on_side(surface, centre, Side::Back);
                drafts.push(Draft { voxel, element: (id, cell), side: Side::Back, position });
            }
        }
        drafts.sort_by_key(|d| (d.voxel, d.element.0, d.side, d.element.1.place()));

        let mut points = SamplePoints { voxel_starts: vec![0; voxels + 1], ..Default::default() };
        let mut front = std::collections::HashMap::new();
        let mut hasher = blake3::Hasher::new();
        hasher.update(&geometry.hash());
        for (i, draft) in drafts.iter().enumerate() {
            let (id, cell) = draft.element;
            let surface = geometry.surface(id);
            let mut corners = cell.corners(surface).map(|c| c.as_vec3());
            let uv = cell.centre_uv(&surface.shape);
            let mut normal = surface.normal_at(surface.point_at(uv.x, uv.y)).as_vec3();
            let mut twin = NO_POINT;
            match draft.side {
                Side::Front => {
                    front.insert(draft.element, i as u32);
                }
                Side::Back => {
                    normal = -normal;
                    corners.reverse();
                    if let Some(&other) = front.get(&draft.element) {
                        twin = other;
                        points.twin[other as usize] = i as u32;
                    }
                }
            }
            if let Some(round) = surface.round() {
                points.rounds.entry(id).or_insert_with(|| round.clone());
            }
            points.position.push(draft.position);
            points.normal.push(normal);
            points.area.push(element_area(geometry, draft.element) as f32);
            points.corners.push(corners);
            points.surface.push(id);
            points.side.push(draft.side);
            points.twin.push(twin);
            points.cell.push(cell);
            points.voxel_starts[draft.voxel + 1] += 1;
            hasher.update(&id.0.to_le_bytes());
            hasher.update(&cell.path.to_le_bytes());
            hasher.update(&[cell.level, draft.side as u8]);
            hasher.update(&(draft.voxel as u32).to_le_bytes());
        }
        for v in 0..voxels {
            points.voxel_starts[v + 1] += points.voxel_starts[v];
        }
        points.key = *hasher.finalize().as_bytes();
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::scene::ObjectId;

    #[test]
    fn areas_add_up_and_twins_meet() {
        let shape = Shape::Quad([DVec3::ZERO, 2.0 * DVec3::X, DVec3::new(2.0, 3.0, 0.0), 3.0 * DVec3::Y]);
        let geometry = Geometry::new(vec![(shape, true, 0, ObjectId(0))], vec!["pane".into()]);
        let elements = divide_by_area(&geometry, &Sampling::by_area(0.1));
        let points = SamplePoints::new(&geometry, &elements, 1, |_| 0);
        assert_eq!(points.len(), 2 * 64);
        let total: f64 = points.area.iter().map(|&a| f64::from(a)).sum();
        assert!((total - 12.0).abs() < 1e-5);
        for i in 0..points.len() {
            let t = points.twin[i] as usize;
            assert_eq!(points.twin[t] as usize, i);
            assert_eq!(points.position[t], points.position[i]);
            assert_eq!(points.normal[t], -points.normal[i]);
        }
    }
}

//! Groups of small faces that lie together: what is far away is seen alike from all of them.

use super::{SamplePoints, Sampling};
use crate::geometry::Side;
use crate::scene::Geometry;
use glam::Vec3;

/// A group is no larger than this share of the largest area that the sampling allows an element: the least that
/// dividing in four makes of one.
const SHARE: f64 = 0.25;
/// No two normals of a group are further apart than twice this, rad.
const SPREAD: f32 = 0.3;

/// Points of one smooth surface, each with a whole face of its own, that lie together and look nearly the same way; or
/// one point of any kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The points.
    pub points: Vec<u32>,
    /// Around them, m.
    pub low: Vec3,
    /// The other corner.
    pub high: Vec3,
    /// A unit vector.
    pub normal: Vec3,
    /// No normal is further from it, rad.
    pub spread: f32,
}

impl Group {
    /// Of some points, at least one.
    fn new(points: &SamplePoints, of: &[u32]) -> Group {
        let places = || of.iter().map(|&i| points.position[i as usize]);
        let normals = || of.iter().map(|&i| points.normal[i as usize]);
        let alone = of.len() == 1;
        let normal = if alone { points.normal[of[0] as usize] } else { mean(points, of) };
        Group {
            points: of.to_vec(),
            low: places().fold(Vec3::INFINITY, Vec3::min),
            high: places().fold(Vec3::NEG_INFINITY, Vec3::max),
            normal,
            spread: if alone { 0.0 } else { normals().map(|n| between(n, normal)).fold(0.0, f32::max) },
        }
    }
}

/// All `points` in groups of faces that are smaller than `sampling` asks for; each alone without one.
pub fn groups(geometry: &Geometry, points: &SamplePoints, sampling: Option<&Sampling>) -> Vec<Group> {
    let all: Vec<u32> = (0..points.len() as u32).collect();
    let Some(sampling) = sampling else { return all.chunks(1).map(|of| Group::new(points, of)).collect() };
    let surface = |i: u32| points.surface[i as usize];
    // A face that was divided is as large as it should be.
    let whole = |i: &u32| points.cell[*i as usize].level == 0 && points.round(*i as usize).is_none();
    let (mut whole, divided): (Vec<u32>, Vec<u32>) = all.into_iter().partition(whole);
    let most = |i: u32| SHARE * geometry.max_area_of(surface(i), sampling);
    let sheet = |i: u32| (geometry.patch[surface(i).index()], points.side[i as usize] == Side::Back);
    whole.sort_by_key(|&i| sheet(i));
    let mut groups = Vec::new();
    for sheet in whole.chunk_by_mut(|&a, &b| sheet(a) == sheet(b)) {
        let most = sheet.iter().map(|&i| most(i)).fold(f64::INFINITY, f64::min);
        divide(points, sheet, most, &mut groups);
    }
    groups.extend(divided.chunks(1).map(|of| Group::new(points, of)));
    groups
}

/// Adds the groups of a sheet. None of several points has more area than `most`, m², or is wider than a square of it.
fn divide(points: &SamplePoints, of: &mut [u32], most: f64, groups: &mut Vec<Group>) {
    let group = Group::new(points, of);
    let area: f64 = of.iter().map(|&i| f64::from(points.area[i as usize])).sum();
    let width2 = f64::from(group.high.distance_squared(group.low));
    if of.len() == 1 || (area <= most && width2 <= 2.0 * most && group.spread <= SPREAD) {
        groups.push(group);
        return;
    }
    let reach = (2.0 * most).sqrt() as f32;
    let axes = |i: u32| -> [f32; 6] {
        let (p, n) = (points.position[i as usize] / reach, points.normal[i as usize] / (2.0 * SPREAD));
        [p.x, p.y, p.z, n.x, n.y, n.z]
    };
    let (mut low, mut high) = ([f32::INFINITY; 6], [f32::NEG_INFINITY; 6]);
    for axes in of.iter().map(|&i| axes(i)) {
        low = std::array::from_fn(|k| low[k].min(axes[k]));
        high = std::array::from_fn(|k| high[k].max(axes[k]));
    }
    let axis = (1..6).fold(0, |best, k| if high[k] - low[k] > high[best] - low[best] { k } else { best });
    of.sort_by(|&a, &b| axes(a)[axis].total_cmp(&axes(b)[axis]));
    let middle = 0.5 * (low[axis] + high[axis]);
    let at = of.partition_point(|&i| axes(i)[axis] < middle);
    let at = if at == 0 || at == of.len() { of.len() / 2 } else { at };
    let (below, above) = of.split_at_mut(at);
    divide(points, below, most, groups);
    divide(points, above, most, groups);
}

/// Direction of the mean normal by area.
fn mean(points: &SamplePoints, of: &[u32]) -> Vec3 {
    of.iter().map(|&i| points.area[i as usize] * points.normal[i as usize]).sum::<Vec3>().normalize_or_zero()
}

/// The angle between two unit vectors, rad; the largest where one is none.
fn between(a: Vec3, b: Vec3) -> f32 {
    if b == Vec3::ZERO { std::f32::consts::PI } else { a.cross(b).length().atan2(a.dot(b)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::geometry::SurfaceId;
    use crate::points::{Cell, Element, divide_by_area};
    use crate::scene::ObjectId;
    use glam::DVec3;

    /// A half cylinder of `n` flat strips in `n` pieces each, one smooth surface, and a square apart from it.
    fn pipe(n: usize) -> Geometry {
        let at = |k: usize, l: usize| {
            let angle = std::f64::consts::PI * k as f64 / n as f64;
            DVec3::new(angle.cos(), angle.sin(), l as f64 / n as f64)
        };
        let strip = |(k, l)| Shape::Quad([at(k, l), at(k + 1, l), at(k + 1, l + 1), at(k, l + 1)]);
        let mut shapes: Vec<_> = (0..n)
            .flat_map(|k| (0..n).map(move |l| (k, l)))
            .map(|at| (strip(at), false, 0, ObjectId(0)))
            .collect();
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Z, DVec3::Z].map(|v| v - 2.0 * DVec3::Y);
        shapes.push((Shape::Quad(square), true, 1, ObjectId(0)));
        Geometry::new(shapes, vec!["pipe".into()])
    }

    #[test]
    fn groups_are_small_smooth_and_hold_each_point_once() {
        let geometry = pipe(40);
        let sampling = Sampling::by_area(0.2);
        let elements: Vec<Element> = divide_by_area(&geometry, &sampling);
        let points = SamplePoints::new(&geometry, &elements, 1, |_| 0);
        let found = groups(&geometry, &points, Some(&sampling));
        let mut all: Vec<u32> = found.iter().flat_map(|g| g.points.iter().copied()).collect();
        all.sort_unstable();
        assert!(all.iter().copied().eq(0..points.len() as u32));
        assert!(found.len() < points.len() / 8, "{} groups of {} points", found.len(), points.len());
        for group in &found {
            let area: f32 = group.points.iter().map(|&i| points.area[i as usize]).sum();
            let patch = |i: u32| geometry.patch[points.surface[i as usize].index()];
            assert!(group.points.len() == 1 || area <= 0.05);
            for &i in &group.points {
                let (p, n) = (points.position[i as usize], points.normal[i as usize]);
                assert!(p.cmpge(group.low).all() && p.cmple(group.high).all());
                assert!(between(n, group.normal) <= group.spread + 1e-6 && group.spread <= SPREAD);
                assert_eq!(patch(i), patch(group.points[0]));
            }
        }
        // The square is divided, and what is divided stays.
        let divided = |i: &u32| points.surface[*i as usize] == SurfaceId(1600);
        assert!(found.iter().filter(|g| g.points.iter().any(divided)).all(|g| g.points.len() == 1));
        assert!(points.cell.iter().any(|c| *c != Cell::ROOT));
        assert_eq!(groups(&geometry, &points, None).len(), points.len());
    }
}

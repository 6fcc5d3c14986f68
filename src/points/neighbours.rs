//! Which elements subtend too much from a point that faces them.

use super::{Element, Sampling, element_area};
use crate::scene::Geometry;
use glam::DVec3;
use rayon::prelude::*;

/// How many times an element may be divided for the sake of solid angles beyond what the area
/// threshold asks for. Where two walls adjoin, neighbouring elements subtend as much from each other
/// at every level (equal squares on a common edge: 1.4 sr), so no threshold would end the division;
/// two levels (1/16 of the area) keep it to a rim.
pub const MAX_EXTRA_LEVELS: u8 = 2;

/// An element with what the test of solid angles asks for.
struct Station {
    centre: DVec3,
    normal: DVec3,
    offset: f64,
    area: f64,
    two_sided: bool,
    divisible: bool,
}

/// The elements of a scene and a grid to find the near ones by.
pub(super) struct Neighbourhood {
    stations: Vec<Station>,
    /// Distances from a plane up to this are none, m.
    tolerance: f64,
    grid: Grid,
}

impl Neighbourhood {
    pub(super) fn new(geometry: &Geometry, sampling: &Sampling, elements: &[Element]) -> Self {
        let stations: Vec<Station> = elements
            .par_iter()
            .map(|&(id, cell)| {
                let surface = geometry.surface(id);
                let uv = cell.centre_uv(&surface.shape);
                let centre = surface.point_at(uv.x, uv.y);
                let normal = surface.normal_at(centre);
                Station {
                    centre,
                    normal,
                    offset: surface.plane().map_or(normal.dot(centre), |plane| plane.offset),
                    area: element_area(geometry, (id, cell)),
                    two_sided: geometry.two_sided[id.index()],
                    divisible: cell.level < deepest_level(geometry, sampling, (id, cell)),
                }
            })
            .collect();
        let grid = Grid::new(stations.iter().map(|s| s.centre).collect());
        Neighbourhood { stations, tolerance: geometry.plane_tolerance(), grid }
    }

    /// Per element: whether it may be divided and subtends more than `threshold` sr from the centre
    /// of an element that it faces and that `sees` it (given their numbers).
    ///
    /// The solid angle is taken as A cos θ / r², the `G δS` of the form factor without the
    /// receiver's cosine: it needs only be right where it is small.
    pub(super) fn too_large(&self, threshold: f64, sees: impl Fn(usize, usize) -> bool + Sync) -> Vec<bool> {
        (0..self.stations.len())
            .into_par_iter()
            .map(|j| {
                let target = &self.stations[j];
                // cos θ is at most 1, so nobody beyond this can mind.
                let reach = (target.area / threshold).sqrt();
                target.divisible
                    && self.grid.any_within(target.centre, reach, |i| {
                        i != j && self.subtends(j, i, threshold) && sees(i, j)
                    })
            })
            .collect()
    }

    /// Whether element `j` subtends more than `threshold` from the centre of `i`, facing it.
    fn subtends(&self, j: usize, i: usize, threshold: f64) -> bool {
        let (target, viewer) = (&self.stations[j], &self.stations[i]);
        let height = |of: &Station, above: &Station| above.normal.dot(of.centre) - above.offset;
        let faced = |side: &Station, h: f64| h > self.tolerance || side.two_sided && h < -self.tolerance;
        let from_target = height(viewer, target);
        let r2 = target.centre.distance_squared(viewer.centre);
        target.area * from_target.abs() > threshold * r2 * r2.sqrt()
            && faced(target, from_target)
            && faced(viewer, height(target, viewer))
    }
}

/// The deepest level an element may be divided to for the sake of solid angles.
fn deepest_level(geometry: &Geometry, sampling: &Sampling, element: Element) -> u8 {
    let (id, cell) = element;
    let limit = sampling.level_limit();
    // The level at which the area threshold alone left this part of the surface.
    let by_area = (0..cell.level)
        .find(|&level| {
            element_area(geometry, (id, cell.ancestor(level))) <= geometry.max_area_of(id, sampling)
        })
        .unwrap_or(cell.level);
    (by_area + MAX_EXTRA_LEVELS).min(limit)
}

/// Places in cubes of equal size, some few in each.
struct Grid {
    places: Vec<DVec3>,
    min: DVec3,
    /// Edge of a cube, m.
    edge: f64,
    counts: [usize; 3],
    /// First entry of each cube in `members`; `[cubes + 1]`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Grid {
    fn new(places: Vec<DVec3>) -> Self {
        let bounds = crate::geometry::Aabb::around(places.iter().copied());
        let size = if places.is_empty() { DVec3::ZERO } else { bounds.size() };
        // Elements lie on surfaces: as many cubes along the longest side as there would be places
        // along the side of a square.
        let along = (places.len() as f64).sqrt().clamp(1.0, 128.0);
        let edge = (size.max_element() / along).max(f64::MIN_POSITIVE);
        let counts = [0, 1, 2].map(|a| (size[a] / edge) as usize + 1);
        let mut grid =
            Grid { places, min: bounds.min, edge, counts, starts: Vec::new(), members: Vec::new() };
        let cubes: Vec<usize> = grid.places.iter().map(|&p| grid.number(grid.cube(p))).collect();
        grid.starts = vec![0; counts.iter().product::<usize>() + 1];
        for &c in &cubes {
            grid.starts[c + 1] += 1;
        }
        for c in 1..grid.starts.len() {
            grid.starts[c] += grid.starts[c - 1];
        }
        let mut free = grid.starts.clone();
        grid.members = vec![0; cubes.len()];
        for (i, &c) in cubes.iter().enumerate() {
            grid.members[free[c] as usize] = i as u32;
            free[c] += 1;
        }
        grid
    }

    fn cube(&self, p: DVec3) -> [usize; 3] {
        [0, 1, 2].map(|a| (((p[a] - self.min[a]) / self.edge) as usize).min(self.counts[a] - 1))
    }

    fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.counts[1] + j) * self.counts[0] + i
    }

    /// Whether `test` holds for a place that may be within `reach` of `p`.
    fn any_within(&self, p: DVec3, reach: f64, mut test: impl FnMut(usize) -> bool) -> bool {
        let (low, high) = (self.cube(p - reach), self.cube(p + reach));
        (low[2]..=high[2]).any(|k| {
            (low[1]..=high[1]).any(|j| {
                // Cubes along x follow one another.
                let first = self.starts[self.number([low[0], j, k])] as usize;
                let end = self.starts[self.number([high[0], j, k]) + 1] as usize;
                self.members[first..end].iter().any(|&i| test(i as usize))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Shape, SurfaceId};
    use crate::points::divide_by_area;
    use crate::scene::ObjectId;

    /// A floor of 4 by 4 m, a wall beside it and a small two-sided pane above it.
    pub(crate) fn scene(pane_height: f64) -> Geometry {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        let at = pane_height * z;
        let shapes = vec![
            (
                Shape::Quad([-2.0 * (x + y), 2.0 * (x - y), 2.0 * (x + y), 2.0 * (y - x)]),
                false,
                0,
                ObjectId(0),
            ),
            (
                Shape::Quad([2.0 * (x - y), 2.0 * (x - y + z), 2.0 * (x + y + z), 2.0 * (x + y)]),
                false,
                1,
                ObjectId(0),
            ),
            (Shape::Quad([at, at + 0.1 * y, at + 0.1 * (x + y), at + 0.1 * x]), true, 2, ObjectId(0)),
        ];
        Geometry::new(shapes, vec!["all".into()])
    }

    #[test]
    fn the_grid_finds_what_a_search_of_all_pairs_finds() {
        let geometry = scene(0.3);
        let sampling = Sampling::by_area(0.1);
        let elements = divide_by_area(&geometry, &sampling);
        let near = Neighbourhood::new(&geometry, &sampling, &elements);
        for threshold in [0.003, 0.05, 0.3, 1.0, 2.0] {
            let found = near.too_large(threshold, |_, _| true);
            for (j, &large) in found.iter().enumerate() {
                assert_eq!(large, (0..elements.len()).any(|i| i != j && near.subtends(j, i, threshold)));
            }
            assert_eq!(found.contains(&true), threshold < 1.4, "1.4 sr where floor and wall adjoin");
            assert!(near.too_large(threshold, |_, _| false).iter().all(|large| !large));
        }
    }

    #[test]
    fn solid_angles_are_seen_from_the_front_and_from_both_sides_of_a_pane() {
        let geometry = scene(0.3);
        let elements: Vec<Element> = (0..3).map(|s| (SurfaceId(s), crate::points::Cell::ROOT)).collect();
        let near = Neighbourhood::new(&geometry, &Sampling::by_area(100.0), &elements);
        // The floor from the pane: A cos / r^2 with r along (0.05, 0.05, 0.3).
        let r2 = 2.0 * 0.05f64.powi(2) + 0.09;
        let expected = 16.0 * 0.3 / r2.powf(1.5);
        assert!(near.subtends(0, 2, 0.999 * expected) && !near.subtends(0, 2, 1.001 * expected));
        assert!(near.subtends(2, 0, 0.01), "the pane has a face on either side");
        let below = Neighbourhood::new(&scene(-0.3), &Sampling::by_area(100.0), &elements);
        assert!(!below.subtends(0, 2, 1e-6), "the floor's back has no points");
    }
}

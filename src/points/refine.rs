//! Sampling a scene (3.1.2) and refining the samples where they see each other from close (4.2.2).

use super::neighbours::Neighbourhood;
use super::{Cell, Element, SamplePoints, Sampling, divide_by_area};
use crate::error::{Error, Result};
use crate::geometry::{Side, SurfaceId};
use crate::scene::Geometry;
use crate::voxels::Voxels;

/// The most sample points a scene may have: the graph of this many takes some 60 GB.
pub const MAX_POINTS: usize = 1_000_000;

/// The sample points of a scene, sorted by voxel: surfaces are divided until no element is larger
/// than [`Sampling::max_area`], and then, if [`Sampling::max_solid_angle`] is set, every element that
/// a facing one sees under a larger solid angle is divided, whatever stands between them, until none
/// is left or can be divided ([`MAX_EXTRA_LEVELS`](super::MAX_EXTRA_LEVELS)).
///
/// # Errors
/// [`Error::Settings`] if a threshold is not a positive number or asks for more than [`MAX_POINTS`].
pub fn sample(geometry: &Geometry, sampling: &Sampling, voxels: &Voxels) -> Result<SamplePoints> {
    check(sampling)?;
    let limit = sampling.level_limit();
    let most_per_surface = 4f64.powi(i32::from(limit));
    let least: f64 = geometry
        .surfaces
        .iter()
        .enumerate()
        .map(|(i, surface)| {
            let id = SurfaceId(i as u32);
            let elements = (surface.area / geometry.max_area_of(id, sampling)).min(most_per_surface);
            elements * if geometry.two_sided[i] { 2.0 } else { 1.0 }
        })
        .sum();
    if least > MAX_POINTS as f64 {
        return Err(too_many("max_area"));
    }
    let mut elements = divide_by_area(geometry, sampling);
    check_count(geometry, &elements, "max_area")?;
    if let Some(threshold) = sampling.max_solid_angle {
        while let Some(finer) = divide_once(geometry, sampling, &elements, threshold, |_, _| true) {
            check_count(geometry, &finer, "max_solid_angle")?;
            elements = finer;
        }
    }
    Ok(SamplePoints::new(geometry, &elements, voxels.len(), |p| voxels.locate(p)))
}

/// One round of graph-driven refinement (section 4.2.2): the elements of `points`, those divided in
/// four that subtend more than [`Sampling::refine_solid_angle`] from a point that faces and, by
/// `sees(i, j)`, sees them. `None` when there is nothing to divide or no threshold is set. Rounds
/// end: an element is divided at most [`MAX_EXTRA_LEVELS`](super::MAX_EXTRA_LEVELS) times.
///
/// # Errors
/// [`Error::Settings`] if the threshold is not a positive number or asks for more than [`MAX_POINTS`].
pub fn refine(
    geometry: &Geometry,
    sampling: &Sampling,
    points: &SamplePoints,
    sees: impl Fn(usize, usize) -> bool + Sync,
) -> Result<Option<Vec<Element>>> {
    check(sampling)?;
    let Some(threshold) = sampling.refine_solid_angle else { return Ok(None) };
    let order = points.fronts();
    let elements = points.elements();
    let sides = |e: usize| [Some(order[e]), points.back_of(order[e])].into_iter().flatten();
    let sees = |a: usize, b: usize| sides(a).any(|i| sides(b).any(|j| sees(i, j)));
    let finer = divide_once(geometry, sampling, &elements, threshold, sees);
    if let Some(finer) = &finer {
        check_count(geometry, finer, "refine_solid_angle")?;
    }
    Ok(finer)
}

/// A hash of all that fixes the refined points before any refinement is done: the `unrefined`
/// points, the voxels, and every threshold that [`refine`] looks at. A saved graph answers to it.
pub fn request_key(
    geometry: &Geometry,
    sampling: &Sampling,
    voxels: &Voxels,
    unrefined: &SamplePoints,
) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&unrefined.key);
    for v in 0..voxels.len() {
        let bounds = voxels.bounds(v);
        for x in bounds.min.to_array().into_iter().chain(bounds.max.to_array()) {
            hasher.update(&x.to_le_bytes());
        }
    }
    if let Some(threshold) = sampling.refine_solid_angle {
        hasher.update(&threshold.to_le_bytes());
        hasher.update(&[sampling.level_limit()]);
        for i in 0..geometry.surfaces.len() {
            hasher.update(&geometry.max_area_of(SurfaceId(i as u32), sampling).to_le_bytes());
        }
    }
    *hasher.finalize().as_bytes()
}

/// Divides every element that subtends too much, once; `None` if there is none.
fn divide_once(
    geometry: &Geometry,
    sampling: &Sampling,
    elements: &[Element],
    threshold: f64,
    sees: impl Fn(usize, usize) -> bool + Sync,
) -> Option<Vec<Element>> {
    let too_large = Neighbourhood::new(geometry, sampling, elements).too_large(threshold, sees);
    if !too_large.contains(&true) {
        return None;
    }
    let mut finer = Vec::with_capacity(2 * elements.len());
    for (&(id, cell), divide) in elements.iter().zip(too_large) {
        if divide {
            finer.extend((0..4).map(|c| (id, cell.child(c))));
        } else {
            finer.push((id, cell));
        }
    }
    Some(finer)
}

fn check(sampling: &Sampling) -> Result<()> {
    let named = [
        ("max_area", Some(sampling.max_area)),
        ("max_solid_angle", sampling.max_solid_angle),
        ("refine_solid_angle", sampling.refine_solid_angle),
    ];
    for (name, value) in named {
        if let Some(value) = value
            && (value.is_nan() || value <= 0.0)
        {
            return Err(Error::Settings(format!("{name} is {value}; it must be a positive number")));
        }
    }
    Ok(())
}

fn check_count(geometry: &Geometry, elements: &[Element], cause: &str) -> Result<()> {
    let backs = elements.iter().filter(|(id, _)| geometry.two_sided[id.index()]).count();
    if elements.len() + backs > MAX_POINTS { Err(too_many(cause)) } else { Ok(()) }
}

fn too_many(cause: &str) -> Error {
    Error::Settings(format!("{cause} asks for more than {MAX_POINTS} sample points; raise it"))
}

impl Cell {
    /// The cell at `level` that holds this one; itself when it is no deeper.
    pub(super) fn ancestor(self, level: u8) -> Cell {
        let up = self.level.saturating_sub(level);
        Cell { path: self.path.checked_shr(2 * u32::from(up)).unwrap_or(0), level: self.level - up }
    }

    /// Orders the cells that tile a surface as a walk through its quadtree meets them.
    pub(super) fn place(self) -> u64 {
        u64::from(self.path) << (2 * u32::from(Cell::MAX_LEVEL.saturating_sub(self.level)))
    }
}

impl Sampling {
    /// The deepest level that cells may have.
    pub(super) fn level_limit(&self) -> u8 {
        self.max_level.min(Cell::MAX_LEVEL)
    }
}

impl SamplePoints {
    /// The elements that the points stand for, in the order of their surfaces.
    pub fn elements(&self) -> Vec<Element> {
        self.fronts().into_iter().map(|i| (self.surface[i], self.cell[i])).collect()
    }

    /// The points on the fronts of the elements, in the order of [`SamplePoints::elements`].
    fn fronts(&self) -> Vec<usize> {
        let mut fronts: Vec<usize> = (0..self.len()).filter(|&i| self.side[i] == Side::Front).collect();
        fronts.sort_by_key(|&i| (self.surface[i], self.cell[i].place()));
        fronts
    }

    /// The twin of point `i`, if it has one.
    fn back_of(&self, i: usize) -> Option<usize> {
        (self.twin[i] != super::NO_POINT).then_some(self.twin[i] as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::points::MAX_EXTRA_LEVELS;
    use crate::scene::ObjectId;
    use crate::voxels::VoxelSettings;
    use glam::DVec3;

    /// Two squares of a metre, face to face, `gap` apart.
    fn facing_squares(gap: f64) -> (Geometry, Voxels) {
        let (x, y, z) = (DVec3::X, DVec3::Y, gap * DVec3::Z);
        let low = Shape::Quad([DVec3::ZERO, x, x + y, y]);
        let high = Shape::Quad([z, z + y, z + x + y, z + x]);
        let shapes = vec![(low, false, 0, ObjectId(0)), (high, true, 1, ObjectId(0))];
        let geometry = Geometry::new(shapes, vec!["squares".into()]);
        let voxels = Voxels::build(&geometry, &VoxelSettings::default());
        (geometry, voxels)
    }

    /// The largest A cos / r^2 of any element from one on the other square.
    fn largest(points: &SamplePoints, gap: f64) -> f64 {
        let pairs = (0..points.len()).flat_map(|i| (0..points.len()).map(move |j| (i, j)));
        pairs
            .filter(|&(i, j)| points.surface[i] != points.surface[j])
            .map(|(i, j)| {
                let r = f64::from(points.position[i].distance(points.position[j]));
                f64::from(points.area[j]) * gap / r.powi(3)
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn division_ends_below_the_threshold_and_no_sooner_than_needed() {
        let (geometry, voxels) = facing_squares(0.5);
        let mut sampling = Sampling::by_area(0.3);
        let coarse = sample(&geometry, &sampling, &voxels).unwrap();
        assert!(largest(&coarse, 0.5) > 0.9);
        sampling.max_solid_angle = Some(0.3);
        let fine = sample(&geometry, &sampling, &voxels).unwrap();
        assert!(largest(&fine, 0.5) <= 0.3);
        assert_eq!(fine.len(), 4 * coarse.len(), "1/16 m2 at 0.5 m is 0.25 sr: one division does");
        let total: f64 = fine.area.iter().map(|&a| f64::from(a)).sum();
        assert!((total - 3.0).abs() < 1e-5);
    }

    #[test]
    fn refinement_follows_sight_and_ends() {
        let (geometry, voxels) = facing_squares(0.05);
        let mut sampling = Sampling::by_area(0.3);
        let mut points = sample(&geometry, &sampling, &voxels).unwrap();
        assert_eq!(refine(&geometry, &sampling, &points, |_, _| true).unwrap(), None);
        sampling.refine_solid_angle = Some(0.1);
        assert_eq!(refine(&geometry, &sampling, &points, |_, _| false).unwrap(), None);
        // One pair that sees each other: its two elements, and no others, are divided.
        let i = (0..points.len()).find(|&i| points.surface[i].0 == 0).unwrap();
        let j = (0..points.len())
            .filter(|&j| points.surface[j].0 == 1 && points.side[j] == Side::Front)
            .min_by(|&a, &b| {
                let d = |j: usize| points.position[i].distance(points.position[j]);
                d(a).total_cmp(&d(b))
            })
            .unwrap();
        let only = |a: usize, b: usize| (a, b) == (i, j) || (a, b) == (j, i);
        let divided = refine(&geometry, &sampling, &points, only).unwrap().unwrap();
        assert_eq!(divided.len(), 8 + 2 * 3);
        let mut rounds = 0;
        while let Some(elements) = refine(&geometry, &sampling, &points, |_, _| true).unwrap() {
            points = SamplePoints::new(&geometry, &elements, voxels.len(), |p| voxels.locate(p));
            rounds += 1;
        }
        assert_eq!(rounds, MAX_EXTRA_LEVELS);
        assert!(points.cell.iter().all(|c| c.level == 1 + MAX_EXTRA_LEVELS));
    }

    #[test]
    fn what_cannot_be_sampled_is_refused() {
        let (geometry, voxels) = facing_squares(1.0);
        for area in [0.0, -1.0, f64::NAN, 1e-9, 2e-6] {
            let sampling = Sampling::by_area(area);
            let error = sample(&geometry, &sampling, &voxels).expect_err("no such sampling");
            assert!(error.is_input() && error.to_string().contains("max_area"), "{error}");
        }
        let sampling = Sampling { max_solid_angle: Some(f64::NAN), ..Sampling::by_area(0.1) };
        assert!(sample(&geometry, &sampling, &voxels).is_err());
        let shallow = Sampling { max_level: 2, ..Sampling::by_area(1e-12) };
        assert_eq!(sample(&geometry, &shallow, &voxels).unwrap().len(), 3 * 16);
    }
}

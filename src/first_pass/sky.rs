//! The light of the sky where it falls.

use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance};
use crate::visibility::{SkyGaze, SkySight};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Irradiance of all points, W m⁻² nm⁻¹: `[W][N]`; `None` without a sky. No ray is cast.
pub(super) fn irradiance(
    geometry: &Geometry,
    points: &SamplePoints,
    sight: &SkySight,
    appearance: &SampledAppearance,
) -> Option<Vec<f32>> {
    let (sky, patches) = (appearance.sky.as_ref()?, sight.patches.as_ref()?);
    let (n, w) = (points.len(), appearance.wavelengths.len());
    let radiance: Vec<Vec<f32>> = (0..patches.all().len())
        .into_par_iter()
        .map(|p| sky.mean(patches.cells(p, SkyGaze::CELLS)))
        .collect();
    // What is seen through glass, by patch and by the panes that stand in the way.
    let mut behind: BTreeMap<(u16, u16), Option<Vec<f32>>> = BTreeMap::new();
    for part in (0..n).flat_map(|i| sight.of(i)).filter(|part| part.passage > 0) {
        behind.entry((part.patch, part.passage)).or_insert_with(|| {
            let list = &sight.passages.lists()[usize::from(part.passage)];
            let p = usize::from(part.patch);
            let through = appearance.through(geometry, list, patches.all()[p].middle)?;
            Some(through.iter().zip(&radiance[p]).map(|(t, l)| t * l).collect())
        });
    }
    let of = |i: usize| -> Vec<f32> {
        let mut sum = vec![0.0f64; w];
        for part in sight.of(i) {
            let seen = match part.passage {
                0 => Some(&radiance[usize::from(part.patch)]),
                passage => behind.get(&(part.patch, passage)).and_then(Option::as_ref),
            };
            for (sum, l) in sum.iter_mut().zip(seen.into_iter().flatten()) {
                *sum += f64::from(part.factor * l);
            }
        }
        sum.into_iter().map(|e| e as f32).collect()
    };
    let by_point: Vec<Vec<f32>> = (0..n).into_par_iter().map(of).collect();
    Some((0..n * w).map(|at| by_point[at % n][at / n]).collect())
}

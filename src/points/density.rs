//! As many sample points as are asked for.

use super::{MAX_POINTS, Sampling, divide_by_area};
use crate::error::{Error, Result};
use crate::scene::Geometry;

/// The factor on all thresholds of area ([`Sampling::area_factor`]) that gives about `points` sample
/// points. Surfaces are divided in four, so the count is met as closely as their sizes allow.
///
/// # Errors
/// [`Error::Settings`] when even undivided surfaces give twice as many, or for more than [`MAX_POINTS`].
pub fn area_factor_for(geometry: &Geometry, sampling: &Sampling, points: usize) -> Result<f64> {
    if points > MAX_POINTS {
        return Err(Error::Settings(format!(
            "{points} points are more than {MAX_POINTS}, the most there can be"
        )));
    }
    let count = |factor: f64| {
        let sampling = Sampling { area_factor: factor, ..*sampling };
        let sides = |two_sided: bool| if two_sided { 2 } else { 1 };
        let elements = divide_by_area(geometry, &sampling);
        elements.iter().map(|(id, _)| sides(geometry.two_sided[id.index()])).sum::<usize>()
    };
    // Starting where the count is about right keeps far too fine samplings from being tried.
    let now = count(1.0).max(1) as f64 / points.max(1) as f64;
    let (mut fine, mut coarse) = (0.2 * now, 5.0 * now);
    for _ in 0..40 {
        let middle = (fine * coarse).sqrt();
        if count(middle) > points { fine = middle } else { coarse = middle }
    }
    let off = |factor: f64| count(factor).abs_diff(points);
    let best = if off(fine) < off(coarse) { fine } else { coarse };
    if count(best) > 2 * points {
        return Err(Error::Settings(format!(
            "{points} points are too few for this scene: its surfaces alone take {}",
            count(best)
        )));
    }
    Ok(best)
}

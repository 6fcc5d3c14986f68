//! What an image is wrong by, as far as it can be told without knowing better.

use crate::first_pass::FirstPassStats;
use serde::Serialize;

/// Fewest and most times that the error falls when the distance between points is halved, whatever three levels say:
/// the edge of a shadow gains √2 at least, what is smooth four at most.
const FALL: (f64, f64) = (1.6, 4.0);

/// Estimated root mean square errors of luminance, of the mean luminance, over the pixels that show no lamp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// Of the sample points: what finer and finer ones would change together.
    pub points: f64,
    /// Of the wavelengths: what twice as many change, on few points.
    pub wavelengths: f64,
    /// Of the solver: flux not yet absorbed.
    pub solver: f64,
    /// Of what was cut off the ends of specular chains and paths, and left out of gloss.
    pub chains: f64,
    /// Noise of the second pass, from two images of different seeds.
    pub noise: f64,
    /// All of them, as independent of each other.
    pub total: f64,
}

impl Estimate {
    /// With `total` as its parts say.
    pub fn summed(self) -> Self {
        let parts = [self.points, self.wavelengths, self.solver, self.chains, self.noise];
        Estimate { total: parts.iter().map(|x| x * x).sum::<f64>().sqrt(), ..self }
    }

    /// All but noise.
    pub fn systematic(&self) -> f64 {
        Estimate { noise: 0.0, ..*self }.summed().total
    }

    /// What a solution says of itself.
    pub fn of_solution(stats: &FirstPassStats) -> Self {
        Estimate { solver: stats.residual, chains: stats.cut_off, ..Estimate::default() }
    }
}

/// How many times the error falls from one level to the next: `changes` are what the refinements so far have changed.
pub fn fall(changes: &[f64]) -> f64 {
    match changes {
        [.., before, last] if *last > 0.0 => (before / last).clamp(FALL.0, FALL.1),
        _ => 2.0,
    }
}

/// What all further refinements would change together: a falling series, c / f + c / f² + ... = c / (f - 1).
pub fn left_over(changes: &[f64]) -> f64 {
    changes.last().map_or(f64::INFINITY, |last| last / (fall(changes) - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_falling_series_is_summed() {
        // Errors 9, 3, 1: changes 6 and 2.
        assert!((left_over(&[6.0, 2.0]) - 1.0).abs() < 1e-12);
        assert_eq!(left_over(&[0.5]), 0.5);
        assert_eq!(left_over(&[1.0, 0.0]), 0.0);
        assert!(left_over(&[]).is_infinite());
        // What does not fall is not taken for converged.
        assert!(left_over(&[1.0, 1.0]) > 1.5);
        let estimate = Estimate { points: 0.03, noise: 0.04, ..Estimate::default() }.summed();
        assert!((estimate.total - 0.05).abs() < 1e-12 && (estimate.systematic() - 0.03).abs() < 1e-12);
    }
}

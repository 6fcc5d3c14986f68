//! What one first pass did, and where the light went.

use super::diffuse::DiffuseOperator;
use super::flow::ChainFlow;
use super::lights::PointLighting;
use super::response::Response;
use super::specular::SpecularSet;
use crate::points::SamplePoints;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::PI;

/// Where the emitted flux went, W nm⁻¹, `[W]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FluxBalance {
    /// π Σ A L^E and the flux of lights without a body; of those from infinity and of the sky what falls on the scene.
    pub emitted: Vec<f64>,
    /// Absorbed by surfaces and inside solids.
    pub absorbed: Vec<f64>,
    /// Left through openings, and what the sums of form factors lack to 1.
    pub escaped: Vec<f64>,
    /// Still in specular chains when they were cut off.
    pub cut_off: Vec<f64>,
    /// Emitted less all of the above, of the emitted flux: what is not yet absorbed, and what form
    /// factors that are not exactly reciprocal gain or lose.
    pub error: Vec<f64>,
}

/// Smallest, mean and largest of a quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Range {
    /// Smallest.
    pub min: f64,
    /// Mean, weighted by area.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// Counters and errors of one first pass.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FirstPassStats {
    /// N.
    pub points: u64,
    /// Points that carry directional radiance.
    pub specular_points: u64,
    /// Those whose lobes an earlier appearance of the scene left behind.
    pub specular_points_reused: u64,
    /// Whether the form factors were there from an earlier appearance.
    pub form_factors_reused: bool,
    /// Ordered pairs whose factor is the exact one.
    pub near_pairs: u64,
    /// Pairs of a point and a surface whose elements together have the exact factor.
    pub summed_surfaces: u64,
    /// Links between points and clusters of points, where light is exchanged over such.
    pub links: u64,
    /// Σ_j h_ij F_ij over the points: 1 everywhere in a closed scene.
    pub row_sum: Range,
    /// Mean (by area) of |Σ_j h_ij F_ij - 1|: where a scene is closed, what visibility from centre to
    /// centre and the kernel are wrong by; where it is not, its openings as well.
    pub closure_error_mean: f64,
    /// Largest such deviation of a point.
    pub closure_error_max: f64,
    /// Σ |A_i F_ij - A_j F_ji| / Σ A_i F_ij over all pairs that see each other. The plain kernel has
    /// none; factors that are exact from a point to an element differ from those of the way back.
    pub reciprocity_error_mean: f64,
    /// Largest |A_i F_ij - A_j F_ji| of a pair, of the larger of the two.
    pub reciprocity_error_max: f64,
    /// Of ideal lobes the mean relative deviation from their directional albedo; of rough lobes and of solids the mean
    /// share of the light that balancing could not place in its lobe and spread over the hemisphere.
    pub lobe_error_mean: f64,
    /// The largest of a direction.
    pub lobe_error_max: f64,
    /// Black cells that stand for openings around specular points.
    pub opening_cells: u64,
    /// Sweeps over all pairs of points (shots: N are one sweep).
    pub sweeps: f64,
    /// Applications of the specular operator.
    pub rounds: u32,
    /// Most specular reflections in a row that were followed.
    pub longest_chain: u32,
    /// Flux not yet absorbed, of the flux emitted, at the worst wavelength.
    pub residual: f64,
    /// Flux cut off the ends of specular chains, of the flux emitted, at the worst wavelength.
    pub cut_off: f64,
    /// Where the light went.
    pub flux: FluxBalance,
    /// Rays cast: none, whatever the appearance.
    pub rays_cast: u64,
    /// Calls of h that the paper's algorithm makes without a graph, if asked for (Table 2).
    pub visibility_calls_without_graph: Option<f64>,
    /// Wall time of preparing form factors and lobes, s.
    pub setup_s: f64,
    /// Wall time of solving, s.
    pub solve_s: f64,
}

impl Range {
    /// Of `values`, the mean weighted by `weight`. Zero when there is none.
    pub fn of(values: &[f32], weight: &[f32]) -> Self {
        if values.is_empty() {
            return Range::default();
        }
        let pairs = || values.iter().zip(weight).map(|(&v, &a)| (f64::from(v), f64::from(a)));
        let total: f64 = pairs().map(|(_, a)| a).sum();
        Range {
            min: pairs().map(|(v, _)| v).fold(f64::INFINITY, f64::min),
            mean: pairs().map(|(v, a)| v * a).sum::<f64>() / total,
            max: pairs().map(|(v, _)| v).fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// Mean by area and largest |Σ_j h_ij F_ij - 1|.
pub fn closure_error(row_sums: &[f32], area: &[f32]) -> (f64, f64) {
    let error: Vec<f32> = row_sums.iter().map(|sum| (sum - 1.0).abs()).collect();
    let range = Range::of(&error, area);
    (range.mean, range.max)
}

/// Σ |A_i F_ij - A_j F_ji| / Σ A_i F_ij, and the largest |A_i F_ij - A_j F_ji| relative to the larger
/// of the two, over all pairs that see each other.
pub fn reciprocity_error(points: &SamplePoints, diffuse: &DiffuseOperator) -> (f64, f64) {
    let corrections = diffuse.corrections();
    let back = corrections.transposed();
    // Pairs that neither way corrects are the plain kernel's, which is reciprocal.
    let of_row = |i: usize| {
        let (mut sum, mut largest) = (0.0, 0.0f64);
        let mut ways_back = back.row(i).peekable();
        for (j, forth) in corrections.row(i) {
            while ways_back.next_if(|(k, _)| *k < j).is_some() {}
            let found = ways_back.next_if(|(k, _)| *k == j);
            let power = |i: usize, j: usize, more: f32| {
                f64::from(points.area[i]) * f64::from(diffuse.plain_factor(i, j) + more)
            };
            let (there, back) = (power(i, j, forth), power(j, i, found.map_or(0.0, |f| f.1)));
            let met_again = found.is_some_and(|f| f.1 != 0.0);
            sum += (there - back).abs() * if met_again { 1.0 } else { 2.0 };
            largest = largest.max((there - back).abs() / there.max(back));
        }
        (sum, largest)
    };
    let rows: Vec<(f64, f64)> = (0..points.len()).into_par_iter().map(of_row).collect();
    let total = PI * over_area(points, |i| f64::from(diffuse.row_sums()[i]));
    let sum: f64 = rows.iter().map(|r| r.0).sum();
    let largest = rows.iter().fold(0.0, |most, r| r.1.max(most));
    (if total > 0.0 { sum / total } else { 0.0 }, largest)
}

/// Σ over points of area times `value(i)`.
pub fn over_area(points: &SamplePoints, value: impl Fn(usize) -> f64) -> f64 {
    points.area.iter().enumerate().map(|(i, &a)| f64::from(a) * value(i)).sum()
}

/// Follows the flux through a solution. `emission`, `radiance` and `irradiance` of all points are `[W][N]`; the
/// irradiance includes that of `lights` and of the chains, which are `flow`.
pub fn balance(
    points: &SamplePoints,
    diffuse: &DiffuseOperator,
    specular: &SpecularSet,
    response: &Response,
    [emission, radiance, irradiance]: [&[f32]; 3],
    flow: &ChainFlow,
    lights: &PointLighting,
) -> FluxBalance {
    let n = points.len();
    let w = specular.wavelengths;
    let mut is_specular = vec![false; n];
    for p in &specular.points {
        is_specular[p.point as usize] = true;
    }
    let at = |plane: &[f32], k: usize, i: usize| f64::from(plane[k * n + i]);
    let mut flux = FluxBalance::default();
    for k in 0..w {
        let emitted = PI * over_area(points, |i| at(emission, k, i)) + lights.flux[k];
        // A specular point turns ρ E back diffusely; what else it got is in the chains' account.
        let kept = over_area(points, |i| {
            let falls = if is_specular[i] { 0.0 } else { at(irradiance, k, i) };
            falls - response.turned(k, i) * at(irradiance, k, i)
        });
        let openings =
            PI * over_area(points, |i| at(radiance, k, i) * (1.0 - f64::from(diffuse.row_sums()[i])));
        let share = |values: &[f64]| values.get(k).copied().unwrap_or(0.0);
        let cut_off = share(&flow.cut_off);
        // What is cut off never entered the specular point it was going to.
        let absorbed = kept + share(&flow.entered) - share(&flow.left) + share(&flow.medium);
        let escaped = openings + share(&flow.escaped) + lights.flux[k] - lights.caught[k];
        let missing = emitted - absorbed - escaped - cut_off;
        flux.emitted.push(emitted);
        flux.absorbed.push(absorbed);
        flux.escaped.push(escaped);
        flux.cut_off.push(cut_off);
        flux.error.push(if emitted > 0.0 { missing / emitted } else { 0.0 });
    }
    flux
}

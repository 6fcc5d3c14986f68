//! Scale factors that make every rough lobe, and every refraction, return its directional albedo over the members a point has:
//! u_l Σ_k B(l, k) q_k u_k = a(θ_l). Sinkhorn's balancing with square roots keeps B symmetric, so
//! energy is neither created nor lost and reciprocity holds.

use super::directions::{Directions, LANES, Lanes};
use crate::material::AlbedoTable;
use crate::simd::{HotLoop, wide};

/// Rounds of balancing at most; the error left falls slowly after the first few.
const ROUNDS: usize = 12;
/// Good enough: largest relative deviation of a row.
const GOOD: f64 = 1e-3;
/// Groups of lanes kept for one lobe at most (72 MB); rows beyond are recomputed in each round.
const KEPT: usize = 2 << 20;

/// Group of lanes and B there, where it is not 0.
type Entry = (u32, Lanes);

/// B between two sets of directions, by rows, as far as it is kept. It does not depend on weights and scales.
pub struct Rows {
    /// The first rows, one after the other.
    kept: Vec<Entry>,
    /// Where each ends.
    ends: Vec<usize>,
}

impl Rows {
    /// Computes rows until about `most` entries are kept.
    pub fn new(from: &Directions, to: &Directions, most: usize) -> Self {
        wide(Keep { from, to, most })
    }

    /// Σ_k B(l, k) q_k u_k over the members of `to`, for every member l of `from`.
    pub fn sums(&self, from: &Directions, to: &Directions) -> Vec<f32> {
        wide(Sums { rows: self, from, to, x: &weighted(to) })
    }
}

/// Appends B(l, ·) to `row`.
#[inline(always)]
fn append(from: &Directions, to: &Directions, l: usize, row: &mut Vec<Entry>) {
    let a = from.get(l);
    if a.to[2] > 0.0 {
        for g in to.reach(a, 0..to.groups()) {
            if let Some((b, _)) = to.lobe(&a, g) {
                row.push((g as u32, b));
            }
        }
    }
}

/// [`Rows::new`].
struct Keep<'a> {
    from: &'a Directions,
    to: &'a Directions,
    most: usize,
}

impl HotLoop for Keep<'_> {
    type Output = Rows;

    #[inline(always)]
    fn run(self) -> Rows {
        let (mut kept, mut ends) = (Vec::new(), Vec::new());
        while kept.len() < self.most && ends.len() < self.from.len {
            append(self.from, self.to, ends.len(), &mut kept);
            ends.push(kept.len());
        }
        Rows { kept, ends }
    }
}

/// [`Rows::sums`].
struct Sums<'a> {
    rows: &'a Rows,
    from: &'a Directions,
    to: &'a Directions,
    /// q u of every member of `to`.
    x: &'a [Lanes],
}

impl HotLoop for Sums<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run(self) -> Vec<f32> {
        let Sums { rows, from, to, x } = self;
        let mut sums = Vec::with_capacity(from.len);
        let mut start = 0;
        for &end in &rows.ends {
            sums.push(dot(&rows.kept[start..end], x));
            start = end;
        }
        let mut row = Vec::new();
        for l in rows.ends.len()..from.len {
            row.clear();
            append(from, to, l, &mut row);
            sums.push(dot(&row, x));
        }
        sums
    }
}

/// Σ_k B(l, k) x_k.
#[inline(always)]
fn dot(row: &[Entry], x: &[Lanes]) -> f32 {
    let mut sum = [0.0; LANES];
    for (g, b) in row {
        let x = &x[*g as usize];
        for lane in 0..LANES {
            sum[lane] += b[lane] * x[lane];
        }
    }
    sum.iter().sum()
}

/// Weight times scale of every direction.
fn weighted(directions: &Directions) -> Vec<Lanes> {
    let product = |(w, u): (&Lanes, &Lanes)| std::array::from_fn(|lane| w[lane] * u[lane]);
    directions.weight.iter().zip(&directions.scale).map(product).collect()
}

/// One half step: scales `directions` towards `albedo`, given Σ_k B q_k u_k; `root` for the symmetric
/// case. Returns (weighted mean, largest) deviation before the step.
fn step(directions: &mut Directions, sums: &[f32], albedo: impl Fn(f32) -> f32, root: bool) -> (f64, f64) {
    let (mut error, mut weight, mut largest) = (0.0, 0.0, 0.0f64);
    for (i, &sum) in sums.iter().enumerate() {
        let (g, lane) = (i / LANES, i % LANES);
        if directions.weight[g][lane] <= 0.0 {
            continue;
        }
        let (target, scale) = (albedo(directions.z[g][lane]), directions.scale[g][lane]);
        let w = f64::from(directions.weight[g][lane]);
        weight += w;
        if sum > 0.0 && scale > 0.0 {
            let ratio = target / (scale * sum);
            let deviation = f64::from((1.0 / ratio - 1.0).abs());
            error += w * deviation;
            largest = largest.max(deviation);
            let next = scale * if root { ratio.sqrt() } else { ratio };
            directions.scale[g][lane] = if next.is_finite() { next } else { scale };
        } else {
            error += w;
            largest = 1.0;
        }
    }
    (if weight > 0.0 { error / weight } else { 0.0 }, largest)
}

/// Scales the reflection lobe of one point to the directional `albedo`. Returns the (mean, largest)
/// relative deviation left.
pub fn normalise_reflection(directions: &mut Directions, albedo: &AlbedoTable) -> (f64, f64) {
    let rows = Rows::new(directions, directions, KEPT);
    let mut error = (0.0, 0.0);
    for _ in 0..ROUNDS {
        let sums = rows.sums(directions, directions);
        let before = directions.scale.clone();
        error = step(directions, &sums, |z| albedo.eval(z), true);
        if error.1 < GOOD {
            directions.scale = before;
            break;
        }
    }
    error
}

/// Scales the transmission lobe between the two sides of a glass point: what enters from any
/// direction leaves on the other side, unless it is reflected. Returns the deviation left.
pub fn normalise_transmission(front: &mut Directions, back: &mut Directions) -> (f64, f64) {
    // Rows and columns can both be met only when both sides weigh the same. A gain on what leaves the
    // back mends that: light that comes in gets its inverse, so a round trip keeps its energy.
    let total = |d: &Directions| d.weight.iter().flatten().sum::<f32>();
    let ratio = total(front) / total(back);
    if ratio.is_finite() && ratio > 0.0 {
        back.gain = ratio;
        back.weight.iter_mut().flatten().for_each(|w| *w *= ratio);
    }
    let (forth, backwards) = (Rows::new(front, back, KEPT), Rows::new(back, front, KEPT));
    let mut error = (0.0, 0.0);
    for _ in 0..ROUNDS {
        error = step(front, &forth.sums(front, back), |_| 1.0, false);
        step(back, &backwards.sums(back, front), |_| 1.0, false);
        if error.1 < GOOD {
            break;
        }
    }
    error
}

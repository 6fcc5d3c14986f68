//! Nets of control points: what de Casteljau's construction makes of them.

use glam::{DVec2, DVec3};

/// The control points of a bicubic Bézier surface: row j along v, and in it i along u. The surface lies in their hull.
pub(crate) type Net = [[DVec3; 4]; 4];

/// Both halves of a cubic curve.
#[inline(always)]
fn halves([a, b, c, d]: [DVec3; 4]) -> [[DVec3; 4]; 2] {
    let mean = |p: DVec3, q: DVec3| 0.5 * (p + q);
    let (ab, bc, cd) = (mean(a, b), mean(b, c), mean(c, d));
    let (abc, bcd) = (mean(ab, bc), mean(bc, cd));
    let middle = mean(abc, bcd);
    [[a, ab, abc, middle], [middle, bcd, cd, d]]
}

/// Rows become columns.
pub(crate) fn transposed(net: &Net) -> Net {
    std::array::from_fn(|j| std::array::from_fn(|i| net[i][j]))
}

/// The halves of lower and of higher u.
#[inline(always)]
pub(crate) fn halves_in_u(net: &Net) -> [Net; 2] {
    let mut both = [[[DVec3::ZERO; 4]; 4]; 2];
    for (j, row) in net.iter().enumerate() {
        let [low, high] = halves(*row);
        (both[0][j], both[1][j]) = (low, high);
    }
    both
}

/// The halves of lower and of higher v.
#[inline(always)]
pub(crate) fn halves_in_v(net: &Net) -> [Net; 2] {
    let mut both = [[[DVec3::ZERO; 4]; 4]; 2];
    for i in 0..4 {
        let [low, high] = halves([net[0][i], net[1][i], net[2][i], net[3][i]]);
        for j in 0..4 {
            (both[0][j][i], both[1][j][i]) = (low[j], high[j]);
        }
    }
    both
}

/// Weights of the four control points of a cubic curve at `t`, and what they change by.
#[inline(always)]
pub(crate) fn weights(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    (
        [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t],
        [-3.0 * s * s, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t * t],
    )
}

/// The place at (u, v) and its derivatives along u and v.
#[inline(always)]
pub(crate) fn evaluate(net: &Net, u: f64, v: f64) -> [DVec3; 3] {
    let ((bu, du), (bv, dv)) = (weights(u), weights(v));
    let [mut place, mut along_u, mut along_v] = [DVec3::ZERO; 3];
    for (j, row) in net.iter().enumerate() {
        let sum = |w: &[f64; 4]| w[0] * row[0] + w[1] * row[1] + w[2] * row[2] + w[3] * row[3];
        let at = sum(&bu);
        place += bv[j] * at;
        along_u += bv[j] * sum(&du);
        along_v += dv[j] * at;
    }
    [place, along_u, along_v]
}

/// Lowest and highest coordinates of the control points.
#[inline(always)]
pub(crate) fn extent(net: &Net) -> (DVec3, DVec3) {
    net.iter().flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)))
}

/// The part of a cubic curve between the parameters `a` and `b`, which may lie beyond its ends.
fn stretch(curve: [DVec3; 4], [a, b]: [f64; 2]) -> [DVec3; 4] {
    // The polar form: de Casteljau's construction with another parameter in each round.
    let polar = |parameters: [f64; 3]| {
        let [p, q, r, s] = curve;
        let [x, y, z] = parameters;
        let [p, q, r] = [p.lerp(q, x), q.lerp(r, x), r.lerp(s, x)];
        p.lerp(q, y).lerp(q.lerp(r, y), z)
    };
    [polar([a, a, a]), polar([a, a, b]), polar([a, b, b]), polar([b, b, b])]
}

/// The part of a surface over the rectangle of (u, v) from `low` to `high`, which may go beyond the unit square.
pub(crate) fn part(net: &Net, low: DVec2, high: DVec2) -> Net {
    let in_u = net.map(|row| stretch(row, [low.x, high.x]));
    transposed(&transposed(&in_u).map(|column| stretch(column, [low.y, high.y])))
}

/// A third of the control vectors of the derivatives along u and along v: differences of neighbours.
#[inline(always)]
pub(crate) fn differences(net: &Net) -> [[DVec3; 12]; 2] {
    let mut of = [[DVec3::ZERO; 12]; 2];
    for j in 0..4 {
        for i in 0..3 {
            of[0][3 * j + i] = net[j][i + 1] - net[j][i];
            of[1][3 * j + i] = net[i + 1][j] - net[i][j];
        }
    }
    of
}

/// A cone around directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    /// Its axis, a unit vector.
    pub axis: DVec3,
    /// The sine of the angle of its sides with the axis, less than 1.
    pub sine: f64,
}

/// A difference of control points below this share of the largest is none.
const NOTHING: f64 = 1e-12;

/// A cone that holds a × b for all derivatives a along u and b along v, at one place of the net or at two; none where no
/// half-space does.
///
/// All derivatives are sums, with weights that are not negative, of their control vectors, and so are the products of
/// those. Those that are nothing, as along an edge that is one point, add nothing to such a sum.
pub(crate) fn spread(net: &Net) -> Option<Spread> {
    let [along_u, along_v] = differences(net).map(|of| {
        let largest = of.iter().fold(0.0f64, |most, d| most.max(d.length_squared()));
        of.map(|d| if d.length_squared() > NOTHING * NOTHING * largest { d } else { DVec3::ZERO })
    });
    let mut products = [DVec3::ZERO; 144];
    let mut count = 0;
    for a in along_u.iter().filter(|a| **a != DVec3::ZERO) {
        for b in along_v.iter().filter(|b| **b != DVec3::ZERO) {
            let product = a.cross(*b);
            if product.length_squared() <= NOTHING * NOTHING * a.length_squared() * b.length_squared() {
                return None;
            }
            products[count] = product.normalize();
            count += 1;
        }
    }
    let products = &products[..count];
    let axis = products.iter().sum::<DVec3>().try_normalize()?;
    let cosine = products.iter().fold(1.0f64, |least, p| least.min(p.dot(axis)));
    (cosine > 1e-3).then(|| Spread { axis, sine: ((1.0 - cosine * cosine).max(0.0)).sqrt() + 1e-9 })
}

/// How far neighbouring control points are apart at most, along u and along v, by a measure of differences.
#[inline(always)]
pub(crate) fn steps(net: &Net, measure: impl Fn(DVec3) -> f64) -> [f64; 2] {
    differences(net).map(|of| of.iter().fold(0.0f64, |most, d| most.max(measure(*d))))
}

/// Whether what is seen of the net, x and y, certainly keeps further than `band` away from zero: a box holds it, and a
/// strip along its longer diagonal, which is narrow where it is seen from the side.
#[inline(always)]
pub(crate) fn is_beside(net: &Net, (least, most): (DVec3, DVec3), band: f64) -> bool {
    if least.x > band || least.y > band || most.x < -band || most.y < -band {
        return true;
    }
    let [one, other] = [net[3][3] - net[0][0], net[3][0] - net[0][3]].map(DVec3::truncate);
    let along = if one.length_squared() > other.length_squared() { one } else { other };
    let across = along.perp().normalize_or_zero();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for p in net.as_flattened() {
        let height = across.dot(p.truncate());
        low = low.min(height);
        high = high.max(height);
    }
    // The strip's own rounding is that of the coordinates.
    low > 2.0 * band || high < -2.0 * band
}

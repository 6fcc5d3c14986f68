//! Cells of directions in which a rough lobe is a polynomial, as nearly as asked: the lobe between two cells is then known
//! from what it is between a few nodes of each.
//!
//! A cell is a box of directions, in tangential coordinates near the normal and in (azimuth, polar angle) elsewhere,
//! with up to [`SIDE`] Gauss points a side as nodes. Lobes are Gaussians of the half vector's slope, so the box may
//! be as wide as a share of their deviation: the residual of interpolation of a Gaussian at n Gauss points falls
//! with the n-th power of it.

use super::directions::{Direction, Directions};
use super::lobe::Extent;
use std::f32::consts::FRAC_PI_2;

/// Nodes of a cell along a side at most.
pub const SIDE: usize = 4;

/// Gauss points of 1 to [`SIDE`] nodes.
const GAUSS: [[f32; SIDE]; SIDE] = [
    [0.0; SIDE],
    [-0.577_350_26, 0.577_350_26, 0.0, 0.0],
    [-0.774_596_7, 0.0, 0.774_596_7, 0.0],
    [-0.861_136_3, -0.339_981_04, 0.339_981_04, 0.861_136_3],
];

/// Root mean square of what interpolation at 1 to [`SIDE`] Gauss points leaves of a Gaussian of deviation 1 and height 1 in
/// a box of half-width x: this number times x^n.
const RESIDUAL: [f32; SIDE] = [0.35, 0.15, 0.035, 0.0095];

/// Cosine from which on tangential coordinates are used.
const TOP: f32 = 0.6;

/// Lobes narrow with the cosine; below this one directions carry so little that they need not be told apart as well.
const LOW: f32 = 0.15;

/// A cell pays when it has fewer nodes than this share of its directions.
const PAYS: f32 = 0.7;

/// How far the width of a lobe may be from what its cell takes it to be, over the tolerance: the lobe is off by no
/// more than its width, and few elements by as much as the worst.
const WIDTH: f32 = 2.0;

/// Some directions and the nodes that stand for them.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Number of its directions.
    pub members: usize,
    /// Nodes along both sides.
    pub count: [usize; 2],
}

/// What becomes of a set of directions.
#[derive(Clone, Debug, Default)]
pub struct Division {
    /// Cells.
    pub cells: Vec<Cell>,
    /// The directions of all cells, one cell after the other,
    pub members: Vec<u32>,
    /// and how each is made up of the nodes: shares along both sides.
    pub shares: Vec<[[f32; SIDE]; 2]>,
    /// The nodes of all cells, `[count[0]][count[1]]` of each.
    pub nodes: Vec<Direction>,
    /// Directions that are their own nodes.
    pub single: Vec<u32>,
}

/// A direction on its way into a cell.
#[derive(Clone, Copy)]
struct Place {
    member: u32,
    at: [f32; 2],
    z: f32,
    rough: Extent,
}

impl Place {
    /// What the element adds to m² of a lobe by itself.
    fn own(&self) -> f32 {
        self.rough.spread + self.rough.blur * self.rough.blur
    }
}

/// Divides directions `range` of the rough lobe of `all` into cells that leave no more than about `tolerance` of a
/// lobe's height.
pub fn divide(all: &Directions, range: std::ops::Range<usize>, tolerance: f32) -> Division {
    let mut division = Division::default();
    let mut places = [Vec::new(), Vec::new()];
    for member in range {
        let d = all.get(member);
        let [x, y, z] = d.to;
        if z > 0.0 {
            let polar = z < TOP;
            let at = if polar { [y.atan2(x), z.acos()] } else { [x, y] };
            places[usize::from(polar)].push(Place { member: member as u32, at, z, rough: d.rough });
        }
    }
    for (polar, places) in [false, true].into_iter().zip(&mut places) {
        Divider { m2: all.origin.m2, tolerance, polar, division: &mut division }.divide(places);
    }
    division
}

struct Divider<'a> {
    m2: f32,
    tolerance: f32,
    /// Whether coordinates are (azimuth, polar angle).
    polar: bool,
    division: &'a mut Division,
}

impl Divider<'_> {
    fn divide(&mut self, places: &mut [Place]) {
        if places.len() as f32 * PAYS <= 1.0 {
            return self.keep(places);
        }
        let bounds = Bounds::new(places);
        let Bounds { low, high, .. } = bounds;
        let wide = [0, 1].map(|axis| 0.5 * (high[axis] - low[axis]));
        let deviation = self.deviation(&bounds);
        let nodes = [0, 1].map(|axis| self.nodes_for(wide[axis] / deviation[axis]));
        let [Some(a), Some(b)] = nodes else {
            let axis = usize::from(wide[1] / deviation[1] > wide[0] / deviation[0]);
            return self.split(places, 0.5 * (low[axis] + high[axis]), |p| p.at[axis]);
        };
        if (a * b) as f32 > PAYS * places.len() as f32 {
            return self.keep(places);
        }
        let middle = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]));
        let local = |p: &Place| {
            [0, 1].map(|axis| if wide[axis] > 0.0 { (p.at[axis] - middle[axis]) / wide[axis] } else { 0.0 })
        };
        let fits = Fit::new(places.iter().map(|p| (local(p), [p.rough.spread, p.rough.blur])));
        let misfit = |p: &Place| {
            let [spread, blur] = [0, 1].map(|k| fits[k].at(local(p)));
            let off = (p.rough.spread - spread).abs() + 4.0 * p.rough.blur * (p.rough.blur - blur).abs();
            off > WIDTH * self.tolerance * (self.m2 + p.own())
        };
        if places.iter().any(misfit) {
            let [least, most] = bounds.own;
            return self.split(places, 0.5 * (least + most), Place::own);
        }
        for (i, j) in (0..a).flat_map(|i| (0..b).map(move |j| (i, j))) {
            let local = [GAUSS[a - 1][i], GAUSS[b - 1][j]];
            let at = [0, 1].map(|axis| middle[axis] + local[axis] * wide[axis]);
            let [spread, blur] = [0, 1].map(|k| fits[k].at(local));
            let (to, rough) = (self.to(at), Extent { spread, blur });
            self.division.nodes.push(Direction { to, rough, ..Default::default() });
        }
        let Division { cells, members, shares: all, .. } = self.division;
        cells.push(Cell { members: places.len(), count: [a, b] });
        members.extend(places.iter().map(|p| p.member));
        all.extend(places.iter().map(local).map(|[u, v]| [shares(a, u), shares(b, v)]));
    }

    /// Deviation of the narrowest lobe of some places along both coordinates, where it looks into the lobe's own mirror.
    fn deviation(&self, bounds: &Bounds) -> [f32; 2] {
        let m2 = self.m2 + bounds.own[0];
        let lowest = bounds.z[0].max(LOW);
        let slope = (2.0 * m2.min(1.0)).sqrt();
        if self.polar {
            let radius = (1.0 - bounds.z[1] * bounds.z[1]).sqrt().max(lowest);
            [slope * lowest / radius.max(0.1), slope.min(lowest)]
        } else {
            [slope * lowest; 2]
        }
    }

    /// Nodes along a side of half-width `x` in deviations, if there are enough.
    fn nodes_for(&self, x: f32) -> Option<usize> {
        (1..=SIDE).find(|&n| RESIDUAL[n - 1] * x.powi(n as i32) <= self.tolerance)
    }

    fn keep(&mut self, places: &[Place]) {
        self.division.single.extend(places.iter().map(|p| p.member));
    }

    /// Divides what is below `limit` and what is above apart.
    fn split(&mut self, places: &mut [Place], limit: f32, key: impl Fn(&Place) -> f32) {
        let mut count = 0;
        for i in 0..places.len() {
            if key(&places[i]) < limit {
                places.swap(i, count);
                count += 1;
            }
        }
        if count == 0 || count == places.len() {
            return self.keep(places);
        }
        let (below, above) = places.split_at_mut(count);
        self.divide(below);
        self.divide(above);
    }

    /// The unit vector at coordinates.
    fn to(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        if self.polar {
            let ((sin, cos), (y, x)) = (v.min(FRAC_PI_2).sin_cos(), u.sin_cos());
            [sin * x, sin * y, cos.max(1e-6)]
        } else {
            [u, v, (1.0 - u * u - v * v).max(0.01).sqrt()]
        }
    }
}

/// Smallest and largest values of some places.
struct Bounds {
    /// Of the coordinates.
    low: [f32; 2],
    high: [f32; 2],
    /// Of the cosine,
    z: [f32; 2],
    /// and of what elements add to m².
    own: [f32; 2],
}

impl Bounds {
    fn new(places: &[Place]) -> Self {
        let ends = [f32::MAX, f32::MIN];
        let mut bounds = Bounds { low: [f32::MAX; 2], high: [f32::MIN; 2], z: ends, own: ends };
        let widened = |[low, high]: [f32; 2], value: f32| [low.min(value), high.max(value)];
        for place in places {
            for axis in 0..2 {
                [bounds.low[axis], bounds.high[axis]] =
                    widened([bounds.low[axis], bounds.high[axis]], place.at[axis]);
            }
            bounds.z = widened(bounds.z, place.z);
            bounds.own = widened(bounds.own, place.own());
        }
        bounds
    }
}

/// Lagrange's polynomials of `n` Gauss points at `u`.
fn shares(n: usize, u: f32) -> [f32; SIDE] {
    let mut shares = [0.0; SIDE];
    for i in 0..n {
        shares[i] = BARYCENTRIC[n - 1][i];
        for j in (0..n).filter(|j| *j != i) {
            shares[i] *= u - GAUSS[n - 1][j];
        }
    }
    shares
}

/// The barycentric weights of Gauss points, 1 / Π (u_i - u_j) over all others.
const BARYCENTRIC: [[f32; SIDE]; SIDE] = {
    let mut weights = [[1.0; SIDE]; SIDE];
    let mut at = 0;
    while at < SIDE * SIDE * SIDE {
        let (n, i, j) = (at / (SIDE * SIDE), at / SIDE % SIDE, at % SIDE);
        if i <= n && j <= n && i != j {
            weights[n][i] /= GAUSS[n][i] - GAUSS[n][j];
        }
        at += 1;
    }
    weights
};

/// Coefficients of 1, u, v, u², uv and v².
const TERMS: usize = 6;

/// A polynomial of second degree, by least squares, held within the values it was made of.
struct Fit {
    coefficients: [f64; TERMS],
    range: [f32; 2],
}

fn terms([u, v]: [f32; 2]) -> [f64; TERMS] {
    let [u, v] = [u, v].map(f64::from);
    [1.0, u, v, u * u, u * v, v * v]
}

impl Fit {
    /// Of two values of each place.
    fn new(places: impl Iterator<Item = ([f32; 2], [f32; 2])>) -> [Self; 2] {
        let (mut matrix, mut right) = ([[0.0; TERMS]; TERMS], [[0.0; TERMS]; 2]);
        let mut range = [[f32::MAX, f32::MIN]; 2];
        for (at, values) in places {
            let terms = terms(at);
            for i in 0..TERMS {
                (0..TERMS).for_each(|j| matrix[i][j] += terms[i] * terms[j]);
            }
            for ((value, right), range) in values.into_iter().zip(&mut right).zip(&mut range) {
                right.iter_mut().zip(terms).for_each(|(right, term)| *right += term * f64::from(value));
                *range = [range[0].min(value), range[1].max(value)];
            }
        }
        // A little of the identity where the places do not tell the terms apart.
        let little = 1e-9 * matrix[0][0];
        (0..TERMS).for_each(|i| matrix[i][i] += little);
        [0, 1].map(|k| Fit { coefficients: solve(matrix, right[k]), range: range[k] })
    }

    fn at(&self, at: [f32; 2]) -> f32 {
        let value: f64 = terms(at).iter().zip(&self.coefficients).map(|(t, c)| t * c).sum();
        (value as f32).clamp(self.range[0], self.range[1])
    }
}

/// Solves a symmetric, positive system by elimination.
pub(super) fn solve<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> [f64; N] {
    for k in 0..N {
        for i in k + 1..N {
            let factor = a[i][k] / a[k][k];
            (k..N).for_each(|j| a[i][j] -= factor * a[k][j]);
            b[i] -= factor * b[k];
        }
    }
    for k in (0..N).rev() {
        let known: f64 = (k + 1..N).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - known) / a[k][k];
    }
    b
}

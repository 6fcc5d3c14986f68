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
#[derive(Clone, Debug, Default)]
pub struct Cell {
    /// The directions.
    pub members: Vec<u32>,
    /// How each is made up of the nodes: shares along both sides.
    pub shares: Vec<[[f32; SIDE]; 2]>,
    /// Nodes along both sides.
    pub count: [usize; 2],
    /// The nodes, `[count[0]][count[1]]`.
    pub nodes: Vec<Direction>,
}

/// What becomes of a set of directions.
#[derive(Clone, Debug, Default)]
pub struct Division {
    /// Cells.
    pub cells: Vec<Cell>,
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
    let shown = range.map(|member| (member, all.get(member))).filter(|(_, d)| d.to[2] > 0.0);
    let (top, low): (Vec<_>, Vec<_>) = shown.partition(|(_, d)| d.to[2] >= TOP);
    for (polar, list) in [(false, top), (true, low)] {
        let place = |(member, d): (usize, Direction)| {
            let [x, y, z] = d.to;
            let at = if polar { [y.atan2(x), z.min(1.0).acos()] } else { [x, y] };
            Place { member: member as u32, at, z, rough: d.rough }
        };
        let places: Vec<Place> = list.into_iter().map(place).collect();
        Divider { m2: all.origin.m2, tolerance, polar, division: &mut division }.divide(&places);
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
    fn divide(&mut self, places: &[Place]) {
        if places.is_empty() {
            return;
        }
        let [low, high] = bounds(places, |p| p.at);
        let wide = [0, 1].map(|axis| 0.5 * (high[axis] - low[axis]));
        let deviation = self.deviation(places);
        let nodes = [0, 1].map(|axis| self.nodes_for(wide[axis] / deviation[axis]));
        if places.len() as f32 * PAYS <= 1.0 {
            return self.keep(places);
        }
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
        let fits = [
            Fit::new(places.iter().map(|p| (local(p), p.rough.spread))),
            Fit::new(places.iter().map(|p| (local(p), p.rough.blur))),
        ];
        let misfit = |p: &Place| {
            let [spread, blur] = [0, 1].map(|k| fits[k].at(local(p)));
            let off = (p.rough.spread - spread).abs() + 4.0 * p.rough.blur * (p.rough.blur - blur).abs();
            off > WIDTH * self.tolerance * (self.m2 + p.own())
        };
        if places.iter().any(misfit) {
            let [least, most] = bounds(places, |p| [p.own(); 2]).map(|own| own[0]);
            return self.split(places, 0.5 * (least + most), Place::own);
        }
        let node = |(i, j): (usize, usize)| {
            let local = [GAUSS[a - 1][i], GAUSS[b - 1][j]];
            let at = [0, 1].map(|axis| middle[axis] + local[axis] * wide[axis]);
            let [spread, blur] = [0, 1].map(|k| fits[k].at(local));
            Direction { to: self.to(at), rough: Extent { spread, blur }, ..Default::default() }
        };
        self.division.cells.push(Cell {
            members: places.iter().map(|p| p.member).collect(),
            shares: places.iter().map(local).map(|[u, v]| [shares(a, u), shares(b, v)]).collect(),
            count: [a, b],
            nodes: (0..a).flat_map(|i| (0..b).map(move |j| (i, j))).map(node).collect(),
        });
    }

    /// Deviation of the narrowest lobe of `places` along both coordinates, where it looks into the lobe's own mirror.
    fn deviation(&self, places: &[Place]) -> [f32; 2] {
        let m2 = self.m2 + places.iter().map(Place::own).fold(f32::MAX, f32::min);
        let lowest = places.iter().map(|p| p.z).fold(f32::MAX, f32::min).max(LOW);
        let slope = (2.0 * m2.min(1.0)).sqrt();
        if self.polar {
            let highest = places.iter().map(|p| p.z).fold(0.0, f32::max);
            let radius = (1.0 - highest * highest).sqrt().max(lowest);
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
    fn split(&mut self, places: &[Place], limit: f32, key: impl Fn(&Place) -> f32) {
        let (below, above): (Vec<Place>, Vec<Place>) = places.iter().partition(|p| key(p) < limit);
        if below.is_empty() || above.is_empty() {
            return self.keep(places);
        }
        self.divide(&below);
        self.divide(&above);
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

/// Smallest and largest values.
fn bounds(places: &[Place], of: impl Fn(&Place) -> [f32; 2]) -> [[f32; 2]; 2] {
    places.iter().map(of).fold([[f32::MAX; 2], [f32::MIN; 2]], |[low, high], at| {
        [[0, 1].map(|k| low[k].min(at[k])), [0, 1].map(|k| high[k].max(at[k]))]
    })
}

/// Lagrange's polynomials of `n` Gauss points at `u`.
fn shares(n: usize, u: f32) -> [f32; SIDE] {
    let nodes = &GAUSS[n - 1][..n];
    std::array::from_fn(|i| {
        let Some(own) = nodes.get(i) else { return 0.0 };
        let others = nodes.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, other)| (u - other) / (own - other)).product()
    })
}

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
    fn new(values: impl Iterator<Item = ([f32; 2], f32)>) -> Self {
        let (mut matrix, mut right) = ([[0.0; TERMS]; TERMS], [0.0; TERMS]);
        let mut range = [f32::MAX, f32::MIN];
        for (at, value) in values {
            let terms = terms(at);
            for i in 0..TERMS {
                right[i] += terms[i] * f64::from(value);
                (0..TERMS).for_each(|j| matrix[i][j] += terms[i] * terms[j]);
            }
            range = [range[0].min(value), range[1].max(value)];
        }
        // A little of the identity where the places do not tell the terms apart.
        let little = 1e-9 * matrix[0][0];
        (0..TERMS).for_each(|i| matrix[i][i] += little);
        Fit { coefficients: solve(matrix, right), range }
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

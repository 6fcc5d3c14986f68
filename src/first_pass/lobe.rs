//! The specular lobe B = R_s / F between two directions of a sample point (section 2.2), spread by
//! the sizes of the elements it connects.

use crate::material::FresnelTable;
use std::f32::consts::PI;

/// Directions handled side by side.
pub const LANES: usize = 8;
/// Wavelengths handled side by side.
pub const BAND: usize = 4;
/// Values of up to [`BAND`] wavelengths.
pub type Band = [f32; BAND];
type Lanes = [f32; LANES];

/// The cone of section 3.2 ends where exp(-tan²α / m²) is 1e-2: tan²α = 4.6 m². The share of
/// the facets beyond is 1e-2 as well, and the normalisation puts it back.
const CUT: f32 = 4.605_17;

/// How much wider than its own variance the specular element makes the lobe. Mirror elements stand in
/// a raster of pitch h; Gaussians of deviation σ at that pitch ripple by 2 exp(-2 π² σ² / h²), and
/// σ² / h² is this number / 4π: 3 leaves 2 %, where equal variances (1) would leave 40 %.
const BLUR: f32 = 3.0;

/// Directions of what a point sees on one side of its surface, in structure of arrays. Neighbours in
/// the list should be neighbours in direction ([`strip_order`]), so that groups can be passed over whole.
/// The frame's x and y lie in the surface and are shared by both sides, z is the side's normal.
#[derive(Clone, Debug, Default)]
pub struct Directions {
    /// First tangential coordinate.
    pub x: Vec<Lanes>,
    /// Second tangential coordinate.
    pub y: Vec<Lanes>,
    /// Cosine with the normal; 0 where there is nothing (padding, beyond the critical angle).
    pub z: Vec<Lanes>,
    /// Slope variance (as m²) from the size of the element.
    pub spread: Vec<Lanes>,
    /// Square root of the slope variance from the size of the specular element.
    pub blur: Vec<Lanes>,
    /// Projected solid angle that the direction stands for.
    pub weight: Vec<Lanes>,
    /// Scale factor u of the normalisation.
    pub scale: Vec<Lanes>,
    /// Factor on what comes in from these directions; 1 but inside solids, where it makes up for a
    /// critical cone that the elements do not fill exactly.
    pub gain: f32,
    /// Number of directions; the rest is padding.
    pub len: usize,
    /// What holds for all directions of a group, [`LANES`] groups side by side.
    bounds: Vec<Bounds>,
}

/// What holds for all directions of each of [`LANES`] groups.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [Lanes; 2],
    high: [Lanes; 2],
    z: Lanes,
    spread: Lanes,
    blur: Lanes,
}

impl Bounds {
    /// Of groups that hold nothing.
    const NONE: Bounds = Bounds {
        low: [[f32::MAX; LANES]; 2],
        high: [[f32::MIN; LANES]; 2],
        z: [0.0; LANES],
        spread: [0.0; LANES],
        blur: [0.0; LANES],
    };

    /// Takes in a direction of the group in `lane`.
    fn include(&mut self, lane: usize, direction: &Direction) {
        for axis in 0..2 {
            self.low[axis][lane] = self.low[axis][lane].min(direction.to[axis]);
            self.high[axis][lane] = self.high[axis][lane].max(direction.to[axis]);
        }
        self.z[lane] = self.z[lane].max(direction.to[2]);
        self.spread[lane] = self.spread[lane].max(direction.spread);
        self.blur[lane] = self.blur[lane].max(direction.blur);
    }

    /// A bit for each group that the lobe of `a` may reach.
    #[inline(always)]
    fn reached(&self, a: &Direction, m2: f32) -> u32 {
        let mut reached = [0u32; LANES];
        for (l, reached) in reached.iter_mut().enumerate() {
            // Distance of the mirrored direction from the group's box.
            let gap =
                |axis: usize| (self.low[axis][l] + a.to[axis]).max(-a.to[axis] - self.high[axis][l]).max(0.0);
            let (x, y, z) = (gap(0), gap(1), a.to[2] + self.z[l]);
            let widest = effective(m2, a, self.spread[l], self.blur[l]);
            *reached = u32::from(x * x + y * y <= 1.001 * CUT * widest * z * z) << l;
        }
        reached.iter().fold(0, |all, bit| all | bit)
    }
}

/// The groups that a lobe may reach, ascending.
pub struct Reach<'a> {
    bounds: &'a [Bounds],
    a: Direction,
    m2: f32,
    /// The bounds looked at, and the bits of them that are left.
    next: usize,
    left: u32,
}

impl Iterator for Reach<'_> {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        while self.left == 0 {
            self.left = self.bounds.get(self.next)?.reached(&self.a, self.m2);
            self.next += 1;
        }
        let lane = self.left.trailing_zeros() as usize;
        self.left &= self.left - 1;
        Some((self.next - 1) * LANES + lane)
    }
}

/// Sorts anything that has a direction into strips of x and by y within a strip, so that groups of
/// [`LANES`] are compact.
pub fn strip_order<T>(list: &mut [T], to: impl Fn(&T) -> [f32; 3]) {
    let strips = (list.len() as f32 / LANES as f32).sqrt().ceil();
    let strip = |t: &T| ((to(t)[0] + 1.0) * 0.5 * strips).floor();
    list.sort_by(|a, b| strip(a).total_cmp(&strip(b)).then(to(a)[1].total_cmp(&to(b)[1])));
}

/// One direction.
#[derive(Clone, Copy, Debug)]
pub struct Direction {
    /// Unit vector in the frame of [`Directions`].
    pub to: [f32; 3],
    /// As [`Directions::spread`].
    pub spread: f32,
    /// As [`Directions::blur`].
    pub blur: f32,
    /// As [`Directions::weight`].
    pub weight: f32,
}

/// Slope variance of the half vector, as m², that an element of solid angle `omega` causes: a disc of
/// that size has the variance Ω / 4π along either axis, the half vector turns half as much, and m² is
/// twice the variance of the slope along an axis. Across the plane of incidence the slope varies
/// 1 / cos θ times as much; the lobe is round, so the mean of both counts (cos θ no less than 0.1).
pub fn slope_spread(omega: f32, cosine: f32) -> f32 {
    omega / (8.0 * PI) * oblique(cosine)
}

/// The same, as a square root, for the specular element itself, whose longer side is seen under
/// `angle` (side / distance).
pub fn slope_blur(angle: f32, cosine: f32) -> f32 {
    angle * (BLUR / (8.0 * PI) * oblique(cosine)).sqrt()
}

fn oblique(cosine: f32) -> f32 {
    0.5 * (1.0 + 1.0 / (cosine * cosine).max(0.01))
}

impl Directions {
    /// Directions in the order given.
    pub fn new(list: &[Direction]) -> Self {
        let mut d = Directions { len: list.len(), gain: 1.0, ..Default::default() };
        for group in list.chunks(LANES) {
            let lanes = |padding: f32, of: &dyn Fn(&Direction) -> f32| {
                let mut lanes = [padding; LANES];
                for (lane, direction) in lanes.iter_mut().zip(group) {
                    *lane = of(direction);
                }
                lanes
            };
            d.x.push(lanes(0.0, &|l| l.to[0]));
            d.y.push(lanes(0.0, &|l| l.to[1]));
            d.z.push(lanes(0.0, &|l| l.to[2]));
            d.spread.push(lanes(0.0, &|l| l.spread));
            d.blur.push(lanes(0.0, &|l| l.blur));
            d.weight.push(lanes(0.0, &|l| l.weight));
            d.scale.push(lanes(0.0, &|_| 1.0));
            let (of, lane) = ((d.x.len() - 1) / LANES, (d.x.len() - 1) % LANES);
            if lane == 0 {
                d.bounds.push(Bounds::NONE);
            }
            group.iter().for_each(|direction| d.bounds[of].include(lane, direction));
        }
        d
    }

    /// Direction `i`.
    pub fn get(&self, i: usize) -> Direction {
        let (g, l) = (i / LANES, i % LANES);
        Direction {
            to: [self.x[g][l], self.y[g][l], self.z[g][l]],
            spread: self.spread[g][l],
            blur: self.blur[g][l],
            weight: self.weight[g][l],
        }
    }

    /// Scale factor of direction `i`.
    pub fn scale_of(&self, i: usize) -> f32 {
        self.scale[i / LANES][i % LANES]
    }

    /// The groups of lanes from `first` on that the lobe of `a` may reach, ascending.
    #[inline(always)]
    pub fn reach(&self, a: Direction, m2: f32, first: usize) -> Reach<'_> {
        let mut reach = Reach { bounds: &self.bounds, a, m2, next: first / LANES, left: 0 };
        if let Some(bounds) = self.bounds.get(reach.next) {
            reach.left = bounds.reached(&a, m2) & (u32::MAX << (first % LANES));
            reach.next += 1;
        }
        reach
    }

    /// The lobe between `a` and the directions of group `g`: (B, cos of the angle of incidence on
    /// the facet). B is 0 outside the cone, 1/sr.
    #[inline(always)]
    pub fn lobe(&self, a: &Direction, g: usize, m2: f32) -> Option<(Lanes, Lanes)> {
        let (x, y, z) = (&self.x[g], &self.y[g], &self.z[g]);
        let (spread, blur) = (&self.spread[g], &self.blur[g]);
        let [ax, ay, az] = a.to;
        let mut t2 = [0.0; LANES];
        let mut z2 = [0.0; LANES];
        let mut width = [0.0; LANES];
        let mut inside = [0u32; LANES];
        for l in 0..LANES {
            let (sx, sy, sz) = (x[l] + ax, y[l] + ay, z[l] + az);
            t2[l] = sx * sx + sy * sy;
            z2[l] = sz * sz;
            width[l] = effective(m2, a, spread[l], blur[l]);
            inside[l] = u32::from((t2[l] <= CUT * width[l] * z2[l]) & (z[l] > 0.0));
        }
        if inside.iter().sum::<u32>() == 0 || az <= 0.0 {
            return None;
        }
        let mut b = [0.0; LANES];
        let mut cosine = [0.0; LANES];
        for l in 0..LANES {
            // D G / (4 pi cos cos) with tan² = t2 / z2, 1 / cos⁴ = (v2 / z2)², arranged to divide twice.
            let v2 = t2[l] + z2[l];
            let slope = 1.0 / (z2[l] * width[l]);
            let d_g = exp_minus(t2[l] * slope) * v2 * v2.min(4.0 * (z[l] + az) * z[l].min(az));
            let value = d_g * slope / (4.0 * PI * az * z[l] * z2[l]);
            b[l] = if inside[l] != 0 { value } else { 0.0 };
            // Only the roughness tilts facets; the width that elements add does not.
            cosine[l] = 0.5 * (z2[l] + t2[l] * m2 * z2[l] * slope).sqrt();
        }
        Some((b, cosine))
    }

    /// [`Directions::lobe`] for one direction: (B, cosine).
    pub fn lobe_at(&self, a: &Direction, i: usize, m2: f32) -> (f32, f32) {
        match self.lobe(a, i / LANES, m2) {
            Some((b, cosine)) => (b[i % LANES], cosine[i % LANES]),
            None => (0.0, 0.0),
        }
    }
}

/// m² of the lobe between `a` and an element of the given spread and blur, at most 1.
#[inline(always)]
fn effective(m2: f32, a: &Direction, spread: f32, blur: f32) -> f32 {
    let both = a.blur + blur;
    (m2 + a.spread + spread + both * both).min(1.0)
}

/// exp(-x) for x from 0 to [`CUT`] to a relative 2e-5, in a form that compilers vectorise.
#[inline(always)]
fn exp_minus(x: f32) -> f32 {
    let y = -x * (1.0 / 16.0);
    let p = 1.0 + y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y * (1.0 / 120.0 + y / 720.0)))));
    let p2 = p * p;
    let p4 = p2 * p2;
    let p8 = p4 * p4;
    p8 * p8
}

/// Directional albedo of the lobe of roughness `m` with F = 1, at equal steps of cos θ from 0 to 1.
/// 1 for a perfect mirror.
pub fn directional_albedo(m: f64) -> Vec<f32> {
    const STEPS: usize = 64;
    const SAMPLES: usize = 64;
    if m == 0.0 {
        return vec![1.0; STEPS + 1];
    }
    let albedo = |cos_i: f64| {
        let sin_i = (1.0 - cos_i * cos_i).max(0.0).sqrt();
        let mut sum = 0.0;
        // Facets in proportion to D cos α: tan²α = -m² ln(1 - u).
        for a in 0..SAMPLES {
            let u = (a as f64 + 0.5) / SAMPLES as f64;
            let cos_a = (1.0 / (1.0 - m * m * (1.0 - u).ln())).sqrt();
            let sin_a = (1.0 - cos_a * cos_a).max(0.0).sqrt();
            for b in 0..SAMPLES {
                let phi = std::f64::consts::PI * (b as f64 + 0.5) / SAMPLES as f64;
                let cos_h = sin_i * sin_a * phi.cos() + cos_i * cos_a;
                let cos_r = 2.0 * cos_h * cos_a - cos_i;
                if cos_h > 0.0 && cos_r > 0.0 {
                    let g = (2.0 * cos_a * cos_i.min(cos_r) / cos_h).min(1.0);
                    sum += g * cos_h / (cos_i * cos_a);
                }
            }
        }
        (sum / (SAMPLES * SAMPLES) as f64).min(1.0) as f32
    };
    (0..=STEPS).map(|i| albedo((i as f64 / STEPS as f64).max(1e-3))).collect()
}

/// Linear interpolation in a table of [`directional_albedo`].
pub fn interpolate(table: &[f32], cosine: f32) -> f32 {
    let x = cosine.clamp(0.0, 1.0) * (table.len() - 1) as f32;
    let slot = (x as usize).min(table.len() - 2);
    table[slot] + (x - slot as f32) * (table[slot + 1] - table[slot])
}

/// A [`FresnelTable`] times a share, its wavelengths in bands of [`BAND`].
#[derive(Clone, Debug)]
pub struct LobeTable {
    bands: usize,
    last: usize,
    /// Each entry and its difference from the next, `[entries - 1][bands]`.
    values: Vec<(Band, Band)>,
}

impl LobeTable {
    /// The table times `share`; `complement` takes 1 - F instead of F.
    pub fn new(table: &FresnelTable, share: f32, complement: bool) -> Self {
        let w = table.wavelengths;
        let bands = w.div_ceil(BAND);
        let last = table.entries() - 1;
        let value = |entry: usize, k: usize| {
            let value = if k < w { table.values[entry * w + k] } else { 0.0 };
            if complement && k < w { share * (1.0 - value) } else { share * value }
        };
        let values = (0..last * bands)
            .map(|i| {
                let (entry, first) = (i / bands, i % bands * BAND);
                let here: Band = std::array::from_fn(|c| value(entry, first + c));
                (here, std::array::from_fn(|c| value(entry + 1, first + c) - here[c]))
            })
            .collect();
        LobeTable { bands, last, values }
    }

    /// The entry before each cosine, and how far each is towards the next.
    #[inline(always)]
    pub fn slots(&self, cosine: &Lanes) -> ([i32; LANES], Lanes) {
        let (mut slot, mut f) = ([0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let x = (1.0 - cosine[l].clamp(0.0, 1.0)) * self.last as f32;
            slot[l] = (x as i32).min(self.last as i32 - 1);
            f[l] = x - slot[l] as f32;
        }
        (slot, f)
    }

    /// A band of an entry, and its difference from the next entry.
    #[inline(always)]
    pub fn entry(&self, slot: i32, band: usize) -> &(Band, Band) {
        &self.values[slot as usize * self.bands + band]
    }

    /// The value at a cosine for wavelength `k`.
    pub fn value(&self, cosine: f32, k: usize) -> f32 {
        let (slot, f) = self.slots(&[cosine; LANES]);
        let (here, step) = self.entry(slot[0], k / BAND);
        here[k % BAND] + f[0] * step[k % BAND]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedo_agrees_with_published_quadrature() {
        // VALIDATION: Cook-Torrance with F = 1, at 0, 30, 60, 80 degrees.
        let cases = [
            (0.1, [1.0, 1.0, 0.9991, 0.9417]),
            (0.3, [0.9956, 0.9812, 0.9248, 0.9449]),
            (0.6, [0.7976, 0.8042, 0.8735, 0.9552]),
            (1.0, [0.4534, 0.5296, 0.7917, 0.9385]),
        ];
        for (m, expected) in cases {
            let table = directional_albedo(m);
            for (angle, expected) in [0.0_f32, 30.0, 60.0, 80.0].into_iter().zip(expected) {
                let found = interpolate(&table, angle.to_radians().cos());
                assert!((found - expected).abs() < 0.01, "m {m}, {angle} degrees: {found} for {expected}");
            }
        }
    }

    #[test]
    fn the_exponential_holds_over_the_cone() {
        for i in 0..=100 {
            let x = CUT * i as f32 / 100.0;
            assert!((exp_minus(x) / (-x).exp() - 1.0).abs() < 2e-5);
        }
    }

    #[test]
    fn the_lobe_is_reciprocal_and_is_the_papers() {
        let direction = |x: f32, y: f32| Direction {
            to: [x, y, (1.0 - x * x - y * y).sqrt()],
            spread: 0.0,
            blur: 0.0,
            weight: 1.0,
        };
        let (a, b) = (direction(-0.5, 0.2), direction(0.3, -0.1));
        let both = Directions::new(&[a, b]);
        let m: f32 = 0.3;
        let (forth, cos_h) = both.lobe_at(&a, 1, m * m);
        let (back, _) = both.lobe_at(&b, 0, m * m);
        assert!((forth / back - 1.0).abs() < 1e-5);
        let h = glam::Vec3::new(a.to[0] + b.to[0], a.to[1] + b.to[1], a.to[2] + b.to[2]).normalize();
        let tan2 = 1.0 / (h.z * h.z) - 1.0;
        let d = (-tan2 / (m * m)).exp() / (m * m * h.z.powi(4));
        let wh = h.dot(glam::Vec3::from(a.to));
        let g = (2.0 * h.z * a.to[2].min(b.to[2]) / wh).min(1.0);
        let expected = d * g / (4.0 * PI * a.to[2] * b.to[2]);
        assert!((cos_h - wh).abs() < 1e-5);
        assert!((forth / expected - 1.0).abs() < 1e-4, "{forth} {expected}");
    }
}

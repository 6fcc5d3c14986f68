//! A photometric web: the luminous intensity of a luminaire, tabulated over directions.

use glam::DVec3;
use std::f64::consts::PI;

/// How the two angles of a web give a direction (IES LM-75). Each type has a frame of its own: x, y and z below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WebType {
    /// Vertical angle γ from nadir, -z; horizontal angle C about z from x towards y.
    C,
    /// Beam along x, up z: horizontal angle H from the plane that V turns about y. Floodlights.
    B,
    /// Beam along x, up z: horizontal angle H about z, then V up from there. Vehicles.
    A,
}

/// Intensities over the largest one, linear in both angles between them, 0 beyond the vertical ones (type C) or
/// both (types A and B).
#[derive(Clone, Debug, PartialEq)]
pub struct Web {
    kind: WebType,
    /// Vertical angles, increasing, rad.
    vertical: Vec<f64>,
    /// Horizontal angles, increasing, rad; all around for type C, unless it is one alone, for all.
    horizontal: Vec<f64>,
    /// `[horizontal][vertical]`, 0 to 1.
    intensity: Vec<f64>,
    /// Luminous intensity that 1 stands for, cd.
    largest: f64,
    /// Its integral over all directions, sr.
    solid_angle: f64,
    /// Flux of the bare lamps as rated, lm; `None` with absolute photometry.
    lamps_lm: Option<f64>,
}

impl Web {
    /// Of a table in degrees and candela, `[horizontal][vertical]`, with its symmetry still to be unfolded. Angles
    /// increase, and there are two vertical ones at least.
    ///
    /// # Errors
    /// What is wrong with the angles, and whether the horizontal ones are to blame.
    pub fn new(
        kind: WebType,
        vertical: Vec<f64>,
        horizontal: Vec<f64>,
        candela: Vec<f64>,
        lamps_lm: Option<f64>,
    ) -> Result<Web, (&'static str, bool)> {
        check_vertical(kind, &vertical).map_err(|m| (m, false))?;
        let rows: Vec<&[f64]> = candela.chunks(vertical.len()).collect();
        let (horizontal, order) = unfold(kind, &horizontal).map_err(|m| (m, true))?;
        let mut rows: Vec<Vec<f64>> = order.iter().map(|&k| rows[k].to_vec()).collect();
        let mut vertical = vertical;
        if kind != WebType::C && vertical[0] == 0.0 {
            // What is given on one side is the same on the other.
            let mirror = |v: &[f64], sign: f64| -> Vec<f64> {
                v.iter().rev().map(|x| sign * x).chain(v[1..].iter().copied()).collect()
            };
            rows = rows.iter().map(|row| mirror(row, 1.0)).collect();
            vertical = mirror(&vertical, -1.0);
        }
        let largest = candela.iter().copied().fold(0.0, f64::max);
        let scale = if largest > 0.0 { 1.0 / largest } else { 0.0 };
        let mut web = Web {
            kind,
            vertical: vertical.into_iter().map(f64::to_radians).collect(),
            horizontal: horizontal.into_iter().map(f64::to_radians).collect(),
            intensity: rows.concat().into_iter().map(|i| i * scale).collect(),
            largest,
            solid_angle: 0.0,
            lamps_lm,
        };
        web.solid_angle = web.integral();
        Ok(web)
    }

    /// Its type.
    pub fn kind(&self) -> WebType {
        self.kind
    }

    /// Largest luminous intensity, cd.
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// Flux of the bare lamps as rated, lm; `None` with absolute photometry.
    pub fn lamps_lm(&self) -> Option<f64> {
        self.lamps_lm
    }

    /// Flux over the largest intensity, sr: the exact integral of what [`Self::towards`] returns.
    pub fn solid_angle(&self) -> f64 {
        self.solid_angle
    }

    /// Intensity over the largest in the unit direction `d` of the web's own frame.
    pub fn towards(&self, d: DVec3) -> f64 {
        let (v, h) = match self.kind {
            WebType::C => {
                let around = d.y.atan2(d.x);
                (d.truncate().length().atan2(-d.z), if around < 0.0 { around + 2.0 * PI } else { around })
            }
            WebType::B => (d.z.atan2(d.x), (-d.y).atan2(d.x.hypot(d.z))),
            WebType::A => (d.z.atan2(d.x.hypot(d.y)), (-d.y).atan2(d.x)),
        };
        let Some((i, f)) = find(&self.vertical, v) else { return 0.0 };
        let row = |k: usize| {
            let row = &self.intensity[k * self.vertical.len()..][..self.vertical.len()];
            row[i] + f * (row[i + 1] - row[i])
        };
        if self.horizontal.len() == 1 {
            return row(0);
        }
        let Some((k, g)) = find(&self.horizontal, h) else { return 0.0 };
        let (a, b) = (row(k), row(k + 1));
        a + g * (b - a)
    }

    fn integral(&self) -> f64 {
        let n = self.vertical.len();
        let step = |x: &[f64], i: usize| x[i + 1] - x[i];
        // The weight of a direction is the sine of γ, or the cosine of the angle from the equator.
        let linear = |x: &[f64], i: usize, weight: Weight| weight.linear(x[i], x[i + 1]);
        let (over_v, over_h) = match self.kind {
            WebType::C => (Weight::Sine, Weight::One),
            WebType::B => (Weight::One, Weight::Cosine),
            WebType::A => (Weight::Cosine, Weight::One),
        };
        let row = |k: usize| -> f64 {
            let row = &self.intensity[k * n..][..n];
            (0..n - 1)
                .map(|i| {
                    let [low, high] = linear(&self.vertical, i, over_v);
                    low * row[i] + high * row[i + 1]
                })
                .sum()
        };
        if self.horizontal.len() == 1 {
            return 2.0 * PI * row(0);
        }
        (0..self.horizontal.len() - 1)
            .filter(|&k| step(&self.horizontal, k) > 0.0)
            .map(|k| {
                let [low, high] = linear(&self.horizontal, k, over_h);
                low * row(k) + high * row(k + 1)
            })
            .sum()
    }
}

/// What the angle of a table weighs in a solid angle.
#[derive(Clone, Copy)]
enum Weight {
    One,
    Sine,
    Cosine,
}

impl Weight {
    /// The integrals from `a` to `b` of the weight times what falls from 1 to 0, and times what rises from 0 to 1, evenly.
    fn linear(self, a: f64, b: f64) -> [f64; 2] {
        let step = b - a;
        let (whole, rising) = match self {
            Weight::One => (step, 0.5 * step),
            Weight::Sine => (a.cos() - b.cos(), (b.sin() - a.sin()) / step - b.cos()),
            Weight::Cosine => (b.sin() - a.sin(), b.sin() + (b.cos() - a.cos()) / step),
        };
        [whole - rising, rising]
    }
}

/// The interval of `x` that holds `at`, and which share of it is below.
fn find(x: &[f64], at: f64) -> Option<(usize, f64)> {
    // Directions straight up and down, and back where a turn ends, may miss the table by a rounding.
    const SLACK: f64 = 1e-9;
    let last = x.len() - 1;
    if at < x[0] - SLACK || at > x[last] + SLACK {
        return None;
    }
    let i = x.partition_point(|&x| x <= at).clamp(1, last) - 1;
    Some((i, ((at - x[i]) / (x[i + 1] - x[i])).clamp(0.0, 1.0)))
}

fn check_vertical(kind: WebType, vertical: &[f64]) -> Result<(), &'static str> {
    let (first, last) = (vertical[0], vertical[vertical.len() - 1]);
    match kind {
        WebType::C if first >= 0.0 && last <= 180.0 => Ok(()),
        WebType::C => Err("vertical angles of type C lie between 0 and 180 degrees"),
        _ if (first == 0.0 || first == -90.0) && last == 90.0 => Ok(()),
        _ => Err("vertical angles of types A and B go from 0 or -90 to 90 degrees"),
    }
}

/// All horizontal angles that those of a table stand for by its symmetry, and the row that serves each.
fn unfold(kind: WebType, given: &[f64]) -> Result<(Vec<f64>, Vec<usize>), &'static str> {
    let (first, last) = (given[0], given[given.len() - 1]);
    let rows = || 0..given.len();
    let straight = || given.iter().copied().zip(rows());
    let back = |about: f64| given.iter().map(move |h| 2.0 * about - h).zip(rows()).rev().skip(1);
    let all: Vec<(f64, usize)> = if kind != WebType::C {
        match () {
            _ if given.len() < 2 || last != 90.0 => {
                return Err("horizontal angles of types A and B go from 0 or -90 to 90 degrees");
            }
            _ if first == -90.0 => straight().collect(),
            _ if first == 0.0 => {
                given.iter().map(|h| -h).zip(rows()).rev().chain(straight().skip(1)).collect()
            }
            _ => return Err("horizontal angles of types A and B go from 0 or -90 to 90 degrees"),
        }
    } else if first == 0.0 && last == 0.0 {
        straight().collect()
    } else if first == 0.0 && last == 90.0 {
        let half: Vec<(f64, usize)> = straight().chain(back(90.0)).collect();
        let other = half.iter().rev().skip(1).map(|&(h, row)| (360.0 - h, row));
        half.iter().copied().chain(other).collect()
    } else if first == 0.0 && last == 180.0 {
        straight().chain(back(180.0)).collect()
    } else if first == 0.0 && last == 360.0 {
        straight().collect()
    } else if first == 0.0 && last > 180.0 && last < 360.0 {
        // The plane where the turn ends is the one where it began.
        straight().chain([(360.0, 0)]).collect()
    } else if first == 90.0 && last == 270.0 {
        // The same on either side of the plane through 90 and 270: a turn from -90, then moved to begin at 0.
        let other = given.iter().map(|h| 180.0 - h).zip(rows()).rev();
        let turn: Vec<(f64, usize)> = other.chain(straight().skip(1)).collect();
        let up = turn.iter().copied().filter(|&(h, _)| h >= 0.0);
        let down = turn.iter().filter(|&&(h, _)| h < 0.0).map(|&(h, row)| (h + 360.0, row));
        let mut all: Vec<(f64, usize)> = up.chain(down).collect();
        all.dedup_by(|a, b| a.0 == b.0);
        return around(all, &turn);
    } else {
        return Err(
            "horizontal angles of type C are 0 alone, or go from 0 to 90, 180 or 360, or from 90 to 270 degrees",
        );
    };
    Ok(all.into_iter().unzip())
}

/// A turn that was cut at 0: both ends need a row there.
fn around(mut all: Vec<(f64, usize)>, turn: &[(f64, usize)]) -> Result<(Vec<f64>, Vec<usize>), &'static str> {
    match turn.iter().find(|(h, _)| *h == 0.0) {
        Some(&(_, row)) => {
            all.push((360.0, row));
            Ok(all.into_iter().unzip())
        }
        None => Err("a table from 90 to 270 degrees has the plane at 180"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean over a lattice of directions, times 4 π.
    fn summed(web: &Web) -> f64 {
        let (n, m) = (720, 1440);
        let mut sum = 0.0;
        for i in 0..n {
            let gamma = PI * (f64::from(i) + 0.5) / f64::from(n);
            for k in 0..m {
                let c = 2.0 * PI * (f64::from(k) + 0.5) / f64::from(m);
                let d = DVec3::new(gamma.sin() * c.cos(), gamma.sin() * c.sin(), -gamma.cos());
                sum += web.towards(d) * gamma.sin();
            }
        }
        sum * (PI / f64::from(n)) * (2.0 * PI / f64::from(m))
    }

    fn table(vertical: &[f64], horizontal: &[f64]) -> Vec<f64> {
        let value = |h: &f64, v: &f64| 1.0 + (0.03 * h).sin() * 0.4 + 0.5 * (0.02 * v).cos();
        horizontal.iter().flat_map(|h| vertical.iter().map(move |v| value(h, v))).collect()
    }

    #[test]
    fn the_integral_is_that_of_what_is_interpolated() {
        let (down, all) = (vec![0.0, 10.0, 45.0, 90.0], vec![0.0, 20.0, 90.0, 150.0, 180.0]);
        let cases = [
            (WebType::C, &down, vec![0.0]),
            (WebType::C, &all, vec![0.0, 30.0, 90.0]),
            (WebType::C, &all, vec![0.0, 45.0, 135.0, 180.0]),
            (WebType::C, &down, vec![0.0, 45.0, 135.0, 200.0, 360.0]),
            (WebType::C, &down, vec![0.0, 90.0, 180.0, 270.0]),
            (WebType::C, &all, vec![90.0, 120.0, 180.0, 270.0]),
            (WebType::B, &down, vec![0.0, 30.0, 90.0]),
            (WebType::B, &down, vec![-90.0, 30.0, 90.0]),
            (WebType::A, &down, vec![-90.0, 30.0, 90.0]),
        ];
        for (kind, vertical, horizontal) in cases {
            let candela = table(vertical, &horizontal);
            let web = Web::new(kind, vertical.clone(), horizontal.clone(), candela, None).expect("sound");
            let found = summed(&web);
            assert!((found / web.solid_angle() - 1.0).abs() < 2e-3, "{kind:?} {horizontal:?} {found}");
        }
    }

    #[test]
    fn symmetries_unfold_where_they_should() {
        let at = |web: &Web, c: f64| web.towards(DVec3::new(c.to_radians().cos(), c.to_radians().sin(), 0.0));
        let of = |horizontal: Vec<f64>, candela: &[f64]| {
            let candela = candela.iter().flat_map(|i| [*i, *i]).collect();
            Web::new(WebType::C, vec![0.0, 90.0], horizontal, candela, None).expect("sound")
        };
        let quarter = of(vec![0.0, 90.0], &[0.2, 1.0]);
        for c in [45.0, 135.0, 225.0, 315.0] {
            assert!((at(&quarter, c) - 0.6).abs() < 1e-12, "{c}");
        }
        let half = of(vec![0.0, 90.0, 180.0], &[0.2, 1.0, 0.4]);
        for (c, expected) in [(135.0, 0.7), (225.0, 0.7), (315.0, 0.6), (359.999_999_999, 0.2)] {
            assert!((at(&half, c) - expected).abs() < 1e-9, "{c}");
        }
        let across = of(vec![90.0, 180.0, 270.0], &[0.2, 1.0, 0.4]);
        for (c, expected) in [(90.0, 0.2), (0.0, 1.0), (45.0, 0.6), (225.0, 0.7), (315.0, 0.7), (180.0, 1.0)]
        {
            assert!((at(&across, c) - expected).abs() < 1e-9, "{c}: {}", at(&across, c));
        }
    }

    /// Type B turns V about the axis across the beam, type A turns H about the upright.
    #[test]
    fn beams_of_types_a_and_b_lie_where_their_angles_say() {
        let candela = vec![0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        let web = |kind| {
            Web::new(kind, vec![-90.0, 60.0, 90.0], vec![-90.0, 30.0, 90.0], candela.clone(), None)
                .expect("sound")
        };
        let (sin30, cos30) = 30f64.to_radians().sin_cos();
        let (sin60, cos60) = 60f64.to_radians().sin_cos();
        // Right of the beam, looking along it, is -y.
        let a = DVec3::new(cos60 * cos30, -cos60 * sin30, sin60);
        let b = DVec3::new(cos30 * cos60, -sin30, cos30 * sin60);
        assert!((web(WebType::A).towards(a) - 1.0).abs() < 1e-9);
        assert!((web(WebType::B).towards(b) - 1.0).abs() < 1e-9);
        assert!(web(WebType::A).towards(b) < 0.9);
    }
}

//! Where the hemisphere of a specular point shows nothing: black cells, so that light leaves through
//! openings instead of being pushed onto what is visible.

use glam::Vec3;
use std::f32::consts::PI;

/// Pixels along the diameter of the unit disc onto which the hemisphere is projected.
const PIXELS: usize = 64;
/// Pixels along the edge of a cell.
const CELL: usize = 4;
/// A hemisphere covered to this share by what a point sees has no openings: elements whose centre is
/// hidden, though part of them is not, leave gaps of a few per cent in closed scenes.
const COVERED: f32 = 0.97;

/// A black part of the hemisphere: direction in the point's frame, and projected solid angle.
pub struct Opening {
    /// Unit vector.
    pub to: Vec3,
    /// Projected solid angle, sr.
    pub weight: f32,
}

/// The openings that elements (corners in the point's frame, relative to it; `seen` is the sum of their
/// projected solid angles) leave. Equal areas of the disc are equal projected solid angles
/// (Nusselt), so an element covers the pixels whose directions lie in its polygon.
pub fn openings(seen: f32, elements: impl Iterator<Item = [Vec3; 4]>) -> Vec<Opening> {
    if seen >= COVERED * PI {
        return Vec::new();
    }
    let mut covered = vec![false; PIXELS * PIXELS];
    for corners in elements {
        cover(&mut covered, &corners);
    }
    let mut found = Vec::new();
    for cell_y in 0..PIXELS / CELL {
        for cell_x in 0..PIXELS / CELL {
            let (mut sum, mut count) = (Vec3::ZERO, 0);
            for y in cell_y * CELL..(cell_y + 1) * CELL {
                for x in cell_x * CELL..(cell_x + 1) * CELL {
                    if let Some(w) = direction(x, y).filter(|_| !covered[y * PIXELS + x]) {
                        sum += w;
                        count += 1;
                    }
                }
            }
            if count > 0 {
                let pixel = 4.0 / (PIXELS * PIXELS) as f32;
                found.push(Opening { to: sum.normalize(), weight: count as f32 * pixel });
            }
        }
    }
    found
}

/// The direction of a pixel, if it lies in the disc.
fn direction(x: usize, y: usize) -> Option<Vec3> {
    let at = |i: usize| (2 * i + 1) as f32 / PIXELS as f32 - 1.0;
    let (x, y) = (at(x), at(y));
    let z2 = 1.0 - x * x - y * y;
    (z2 > 0.0).then(|| Vec3::new(x, y, z2.sqrt()))
}

/// Marks the pixels whose directions pass through the polygon.
fn cover(covered: &mut [bool], corners: &[Vec3; 4]) {
    let planes: [Vec3; 4] = std::array::from_fn(|i| corners[i].cross(corners[(i + 1) % 4]));
    // Seen from its front a polygon turns one way; which one depends on the handedness of the frame.
    let middle: Vec3 = corners.iter().sum();
    let turn = planes.iter().map(|p| p.dot(middle)).sum::<f32>().signum();
    let (mut low, mut high) = (glam::Vec2::ONE, -glam::Vec2::ONE);
    for corner in corners {
        let w = corner.normalize_or_zero();
        // What lies below the horizon ends on it, in any direction.
        let p = w.truncate();
        let p = if w.z < 0.0 { p.normalize_or_zero() } else { p };
        (low, high) = (low.min(p), high.max(p));
    }
    // Edges are arcs of ellipses, which bulge beyond their ends; so does the horizon.
    let bulge =
        glam::Vec2::splat(if corners.iter().any(|c| c.z < 0.0) { 2.0 } else { 0.3 * (high - low).length() });
    let pixel = |x: f32| ((x + 1.0) * 0.5 * PIXELS as f32).clamp(0.0, PIXELS as f32) as usize;
    let (low, high) = (low - bulge, high + bulge);
    for y in pixel(low.y)..(pixel(high.y) + 1).min(PIXELS) {
        for x in pixel(low.x)..(pixel(high.x) + 1).min(PIXELS) {
            if !covered[y * PIXELS + x]
                && let Some(w) = direction(x, y)
                && planes.iter().all(|p| turn * p.dot(w) >= 0.0)
            {
                covered[y * PIXELS + x] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_leaves_its_own_solid_angle() {
        // A ceiling of radius much larger than its height, with a hole: the weight of the openings
        // is what the elements do not cover.
        let strip = |x0: f32, x1: f32| {
            [
                Vec3::new(x0, -50.0, 1.0),
                Vec3::new(x1, -50.0, 1.0),
                Vec3::new(x1, 50.0, 1.0),
                Vec3::new(x0, 50.0, 1.0),
            ]
        };
        let elements = [strip(-50.0, -0.5), strip(0.5, 50.0)];
        let seen: f32 =
            elements.iter().map(|e| super::super::form_factor::exact(Vec3::ZERO, Vec3::Z, e) as f32).sum();
        let found: f32 = openings(seen, elements.into_iter()).iter().map(|o| o.weight).sum();
        assert!((found + seen - PI).abs() < 0.03, "{found} {seen}");
        assert!(openings(PI, std::iter::empty()).is_empty());
    }
}

//! Glass that touches: a solid whose face lies in another surface.

use super::{Appearance, Geometry};
use crate::geometry::{Surface, SurfaceId};
use crate::material::Body;

/// More pairs of surfaces than this are not looked at: what is said is a help, not a check.
const MOST_PAIRS: usize = 20_000_000;

/// One note for each object of solid glass that has a face in the plane of a surface of another object and
/// over it. A ray that leaves the solid there starts beyond both and misses what the solid stands on.
pub fn notes(geometry: &Geometry, appearance: &Appearance) -> Vec<String> {
    let solid = |i: usize| matches!(appearance.material(SurfaceId(i as u32)).body, Body::Solid { .. });
    let count = geometry.surfaces.len();
    let glass: Vec<usize> = (0..count).filter(|&i| solid(i)).collect();
    if glass.len().saturating_mul(count) > MOST_PAIRS {
        return Vec::new();
    }
    let mut notes = Vec::new();
    for i in glass {
        let touched = (0..count).find(|&j| {
            geometry.object[j] != geometry.object[i]
                && coincide(&geometry.surfaces[i], &geometry.surfaces[j], geometry.plane_tolerance())
        });
        let Some(j) = touched else { continue };
        let name = |i: usize| &geometry.objects[geometry.object[i].0 as usize];
        let note = format!(
            "the glass of object \"{}\" lies in a surface of object \"{}\": what is seen there is noise; \
             leave a gap between them, a thousandth of the glass's size will do",
            name(i),
            name(j)
        );
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    notes
}

/// Whether two surfaces lie in one plane and their boxes share more than an edge.
fn coincide(a: &Surface, b: &Surface, tolerance: f64) -> bool {
    let (Some(own), Some(its)) = (a.plane(), b.plane()) else { return false };
    if !a.vertices().iter().all(|&p| b.distance(p).abs() <= tolerance) {
        return false;
    }
    // A disc has no corners to tell.
    if a.round().is_some()
        && (b.distance(a.middle()).abs() > tolerance || own.normal.dot(its.normal).abs() < 1.0 - 1e-9)
    {
        return false;
    }
    let (a_box, b_box) = (a.bounds(), b.bounds());
    let shared = a_box.max.min(b_box.max) - a_box.min.max(b_box.min);
    let flat = own.normal.abs().max_position();
    (0..3).all(|axis| axis == flat || shared[axis] > tolerance)
}

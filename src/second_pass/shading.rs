//! Normals that go on smoothly across the facets of one patch, for what mirrors and glass show.
//!
//! At a corner the normals of the facets that meet there are averaged by their angles (G. Thürmer and C. A. Wüthrich,
//! *Computing Vertex Normals from Polygonal Facets*, 1998), and between corners they are linear. Where light would so
//! be reflected into a surface or refracted out of it, the facet's own normal stays.

use super::lobe::{reflect, refract};
use crate::geometry::{Side, Surface, SurfaceId};
use crate::scene::Geometry;
use glam::DVec3;
use std::collections::{HashMap, HashSet};

/// The surface is by itself, or flat with all that it goes on into.
const PLAIN: u32 = u32::MAX;

/// Cosine between facets that make a patch bend.
const BENT: f64 = 1.0 - 1e-9;

/// Smooth normals of some surfaces.
pub(super) struct Shading {
    /// By surface: index into `corners`, or [`PLAIN`].
    of: Vec<u32>,
    /// Unit normals at the corners, on the front.
    corners: Vec<[DVec3; 4]>,
}

impl Shading {
    /// Of the surfaces of `geometry` that are `wanted`.
    pub fn new(geometry: &Geometry, wanted: impl Fn(SurfaceId) -> bool) -> Self {
        let surfaces = || (0..geometry.surfaces.len()).map(|s| SurfaceId(s as u32));
        let patches: HashSet<u32> =
            surfaces().filter(|&s| wanted(s)).map(|s| geometry.patch[s.index()]).collect();
        let members = || surfaces().filter(|s| patches.contains(&geometry.patch[s.index()]));
        let key =
            |s: SurfaceId, v: DVec3| (geometry.patch[s.index()], (v + 0.0).to_array().map(f64::to_bits));
        let mut sums: HashMap<_, DVec3> = HashMap::new();
        for s in members() {
            let surface = geometry.surface(s);
            let v = surface.vertices();
            for k in 0..v.len() {
                let (before, after) = (v[(k + v.len() - 1) % v.len()] - v[k], v[(k + 1) % v.len()] - v[k]);
                *sums.entry(key(s, v[k])).or_default() +=
                    after.angle_between(before) * surface.normal_at(v[k]);
            }
        }
        let mut shading = Shading { of: vec![PLAIN; geometry.surfaces.len()], corners: Vec::new() };
        for s in members().filter(|&s| wanted(s)) {
            let surface = geometry.surface(s);
            let v = surface.vertices();
            let Some(last) = v.len().checked_sub(1) else { continue };
            let facet = surface.normal_at(v[0]);
            let smooth = |k: usize| sums[&key(s, v[k.min(last)])].try_normalize().unwrap_or(facet);
            let corners = [0, 1, 2, 3].map(smooth);
            if corners.iter().any(|n| n.dot(facet) < BENT) {
                shading.of[s.index()] = shading.corners.len() as u32;
                shading.corners.push(corners);
            }
        }
        shading
    }

    /// The normal by which light is reflected and refracted at `p` on `surface`, number `id`, on the side met: the
    /// smooth one where that keeps it on its sides of the facet, whose normal on that side is `facet`. Light comes
    /// from `i`; `eta` is the index on its side over the other, for a solid.
    pub fn normal(
        &self,
        (surface, id, side): (&Surface, SurfaceId, Side),
        p: DVec3,
        (facet, i): (DVec3, DVec3),
        eta: Option<f64>,
    ) -> DVec3 {
        let Some(corners) = self.corners.get(self.of[id.index()] as usize) else { return facet };
        let front = interpolated(surface, corners, p);
        let n = if side == Side::Front { front } else { -front };
        let enters = |eta: f64| refract(i, n, eta).is_none_or(|d| d.dot(facet) < 0.0);
        let sound =
            n.is_normalized() && n.dot(i) > 0.0 && reflect(i, n).dot(facet) > 0.0 && eta.is_none_or(enters);
        if sound { n } else { facet }
    }
}

/// Between the normals at the corners, by the triangle that `p` is in.
fn interpolated(surface: &Surface, corners: &[DVec3; 4], p: DVec3) -> DVec3 {
    let (triangles, count) = surface.triangles();
    let which = [[0, 1, if count == 2 { 3 } else { 2 }], [2, 3, 1]];
    let shares = |[a, b, c]: [DVec3; 3]| {
        let whole = (b - a).cross(c - a);
        let of = |from: DVec3, to: DVec3| (from - p).cross(to - p).dot(whole) / whole.length_squared();
        [of(b, c), of(c, a), of(a, b)]
    };
    let first = shares(triangles[0]);
    // Beyond the diagonal, which is across from its first corner.
    let k = usize::from(count == 2 && first[0] < 0.0);
    let shares = if k == 1 { shares(triangles[1]) } else { first };
    which[k]
        .iter()
        .zip(shares)
        .map(|(&corner, share)| share.max(0.0) * corners[corner])
        .sum::<DVec3>()
        .normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Shape;
    use crate::scene::ObjectId;
    use std::f64::consts::PI;

    /// A ball of 12 by 24 quadrilaterals and triangles, all of one patch or each of its own.
    fn ball(smooth: bool) -> Geometry {
        let at = |j: u32, k: u32| {
            let (sin, cos) = (PI * f64::from(j) / 12.0).sin_cos();
            let (s, c) = (2.0 * PI * f64::from(k % 24) / 24.0).sin_cos();
            // All that meet at a pole meet there to the bit.
            let sin = if j.is_multiple_of(12) { 0.0 } else { sin };
            DVec3::new(sin * c, sin * s, cos)
        };
        let facet = |i: u32| {
            let (j, k) = (i / 24, i % 24);
            let [a, b, c, d] = [at(j, k), at(j + 1, k), at(j + 1, k + 1), at(j, k + 1)];
            let shape = match j {
                0 => Shape::Triangle([a, b, c]),
                11 => Shape::Triangle([a, b, d]),
                _ => Shape::Quad([a, b, c, d]),
            };
            (shape, true, if smooth { 0 } else { i }, ObjectId(0))
        };
        Geometry::new((0..288).map(facet).collect(), vec!["ball".into()])
    }

    fn places(geometry: &Geometry) -> impl Iterator<Item = (SurfaceId, DVec3)> + '_ {
        let shares = [[0.1, 0.1], [0.3, 0.4], [0.7, 0.2], [0.05, 0.9]];
        (0..288).flat_map(move |s| {
            shares.map(|[u, v]| (SurfaceId(s), geometry.surface(SurfaceId(s)).point_at(u, v)))
        })
    }

    #[test]
    fn facets_of_a_ball_reflect_as_a_ball() {
        let geometry = ball(true);
        let shading = Shading::new(&geometry, |_| true);
        let (mut smooth, mut facets) = (0.0f64, 0.0f64);
        for (id, p) in places(&geometry) {
            let surface = geometry.surface(id);
            let (facet, true_normal) = (surface.normal_at(p), p.normalize());
            let n = shading.normal((surface, id, Side::Front), p, (facet, facet), None);
            smooth = smooth.max(n.angle_between(true_normal));
            facets = facets.max(facet.angle_between(true_normal));
            let behind = shading.normal((surface, id, Side::Back), p, (-facet, -facet), None);
            assert!(behind.distance(-n) < 1e-12);
        }
        assert!(smooth < 0.25 * facets && facets > 0.1, "{smooth} {facets}");
    }

    #[test]
    fn flat_and_single_surfaces_keep_their_normals() {
        let geometry = ball(false);
        let shading = Shading::new(&geometry, |_| true);
        assert!(shading.of.iter().all(|&of| of == PLAIN) && shading.corners.is_empty());
        let unwanted = Shading::new(&ball(true), |_| false);
        assert!(unwanted.of.iter().all(|&of| of == PLAIN));
    }

    /// However flat light comes in, it leaves on its own side or goes through to the other.
    #[test]
    fn light_stays_on_its_side_of_a_facet() {
        let geometry = ball(true);
        let shading = Shading::new(&geometry, |_| true);
        let mut kept = 0;
        for (id, p) in places(&geometry) {
            let surface = geometry.surface(id);
            let facet = surface.normal_at(p);
            let (x, y) = facet.any_orthonormal_pair();
            for (turn, height) in (0..12).flat_map(|t| [1e-3, 0.05, 0.2, 0.8].map(|h| (f64::from(t), h))) {
                let (s, c) = (turn * PI / 6.0).sin_cos();
                let i = (c * x + s * y + height * facet).normalize();
                for (side, eta) in [(Side::Front, 1.0 / 1.5), (Side::Back, 1.5)] {
                    let facet = if side == Side::Front { facet } else { -facet };
                    let i = if side == Side::Front { i } else { -i };
                    let n = shading.normal((surface, id, side), p, (facet, i), Some(eta));
                    assert!(n.dot(i) > 0.0 && reflect(i, n).dot(facet) > 0.0);
                    assert!(refract(i, n, eta).is_none_or(|d| d.dot(facet) < 0.0));
                    kept += u32::from(n == facet);
                }
            }
        }
        assert!(kept > 0, "flat light asks for the facet's normal somewhere");
    }
}

//! Pieces of surfaces as a sensor sees them.

use super::place::Place;
use crate::first_pass::form_factor::exact;
use crate::first_pass::round::of_piece;
use crate::geometry::{Side, SurfaceId};
use crate::points::Piece;
use crate::scene::Geometry;
use glam::{DVec3, Vec3};

/// A convex piece of a polygon, or a piece of a disc or a sphere; a triangle repeats its last corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell<'a> {
    pub corners: [Vec3; 4],
    /// What is no polygon: its true shape, whose corners are only corners.
    pub piece: Option<Piece<'a>>,
    pub surface: SurfaceId,
    pub side: Side,
    /// How often it was divided.
    pub depth: u8,
}

impl<'a> Cell<'a> {
    /// A whole surface.
    pub fn whole(geometry: &'a Geometry, surface: SurfaceId, side: Side) -> Cell<'a> {
        if let Some(round) = geometry.surface(surface).round() {
            return Cell::round(Piece::whole(round, side), surface, 0);
        }
        let v = geometry.surface(surface).vertices();
        let corners = std::array::from_fn(|i| v[i.min(v.len() - 1)].as_vec3());
        Cell { corners, piece: None, surface, side, depth: 0 }
    }

    fn round(piece: Piece<'a>, surface: SurfaceId, depth: u8) -> Cell<'a> {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[s, t]| piece.at(s, t).as_vec3());
        Cell { corners, piece: Some(piece), surface, side: piece.side, depth }
    }

    /// The place at (u, v): of the bilinear patch over the corners, or of the true surface.
    pub fn at(&self, u: f32, v: f32) -> Vec3 {
        if let Some(piece) = &self.piece {
            return piece.at(f64::from(u), f64::from(v)).as_vec3();
        }
        let [a, b, c, d] = self.corners;
        a.lerp(b, u).lerp(d.lerp(c, u), v)
    }

    /// The middle.
    pub fn centre(&self) -> Vec3 {
        self.at(0.5, 0.5)
    }

    /// The `k`th of a sequence of places that spread evenly over cells and within each (M. Roberts's
    /// additive sequence by the plastic number).
    pub fn spread(&self, k: usize) -> Vec3 {
        let at = |step: f64| (0.5 + step * k as f64).fract() as f32;
        self.at(at(0.754_877_666_246_693), at(0.569_840_290_998_053))
    }

    /// Four pieces.
    pub fn divide(&self) -> [Cell<'a>; 4] {
        if let Some(piece) = &self.piece {
            return piece.quarters().map(|quarter| Cell::round(quarter, self.surface, self.depth + 1));
        }
        let at = |u: u8, v: u8| self.at(0.5 * f32::from(u), 0.5 * f32::from(v));
        let piece = |u: u8, v: u8| Cell {
            corners: [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)],
            depth: self.depth + 1,
            ..*self
        };
        [piece(0, 0), piece(1, 0), piece(1, 1), piece(0, 1)]
    }

    /// The longer diagonal as a share of the distance from `place`.
    pub fn extent(&self, place: &Place) -> f64 {
        let [a, b, c, d] = self.corners;
        let diagonal = match &self.piece {
            // The corners of a whole sphere are one place.
            Some(piece) => (2.0 * piece.area()).sqrt() as f32,
            None => (c - a).length().max((d - b).length()),
        };
        f64::from(diagonal) / (self.centre().as_dvec3() - place.position).length().max(f64::MIN_POSITIVE)
    }

    /// Whether `place` is in front of the cell's side of its surface, and part of the cell in front of
    /// the sensor.
    pub fn faces(&self, geometry: &Geometry, place: &Place) -> bool {
        if let Some(piece) = &self.piece {
            return piece.may_face(place.position) && place.height(piece.at(0.5, 0.5)) > -piece.reach();
        }
        let distance = geometry.surface(self.surface).distance(place.position);
        let in_front = if self.side == Side::Front { distance } else { -distance };
        in_front > geometry.plane_tolerance()
            && self.corners.iter().any(|&c| place.height(c.as_dvec3()) > 0.0)
    }

    /// Whether the sensor's plane cuts the cell.
    pub fn is_cut(&self, place: &Place) -> bool {
        let below = |c: &Vec3| place.height(c.as_dvec3()) <= 0.0;
        self.corners.iter().any(below) && !self.corners.iter().all(below)
    }

    /// Projected solid angle of what is in front of the sensor, sr.
    pub fn factor(&self, place: &Place) -> f64 {
        // Relative to the sensor, so that rounding to `f32` costs nothing close by.
        if let Some(piece) = &self.piece {
            return of_piece(place.position.as_vec3(), place.normal.as_vec3(), piece, &[]);
        }
        let near = self.corners.map(|c| (c.as_dvec3() - place.position).as_vec3());
        exact(Vec3::ZERO, place.normal.as_vec3(), &near)
    }
}

/// The sides of a surface that have sample points.
pub(super) fn sides(geometry: &Geometry, surface: SurfaceId) -> impl Iterator<Item = Side> {
    let two_sided = geometry.two_sided[surface.index()];
    [Side::Front, Side::Back].into_iter().take(if two_sided { 2 } else { 1 })
}

/// A place on a cell in the scene's coordinates, on the plane of its surface, or on the disc or sphere.
pub(super) fn on_surface(geometry: &Geometry, cell: &Cell, p: Vec3) -> DVec3 {
    let surface = geometry.surface(cell.surface);
    surface.project(p.as_dvec3())
}

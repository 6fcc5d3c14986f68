//! Pieces of surfaces that are no polygons.

use super::Cell;
use crate::geometry::{Round, Side};
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// A cell of one side of a surface that is no polygon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece<'a> {
    /// The whole surface.
    pub round: &'a Round,
    /// The side.
    pub side: Side,
    /// The cell.
    pub cell: Cell,
}

impl<'a> Piece<'a> {
    /// All of one side.
    pub fn whole(round: &'a Round, side: Side) -> Piece<'a> {
        Piece { round, side, cell: Cell::ROOT }
    }

    /// Whether it may be hollow, as the inside of a sphere is: then it sees some of itself.
    pub fn faces_itself(&self) -> bool {
        !self.round.is_planar() && !self.round.looks_out(self.side)
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        self.round.area() * 0.25f64.powi(i32::from(self.cell.level))
    }

    /// The place at `(s, t)` of the unit square over the piece, m.
    pub fn at(&self, s: f64, t: f64) -> DVec3 {
        let (low, size) = self.cell.square();
        let uv = low + size * DVec2::new(s, t);
        self.round.point_at(uv.x, uv.y)
    }

    /// Unit normal of the side, at the point of the surface nearest to `p`.
    pub fn normal_at(&self, p: DVec3) -> DVec3 {
        let normal = self.round.normal_at(p);
        if self.side == Side::Front { normal } else { -normal }
    }

    /// No point of the piece is further from its middle, m.
    pub fn reach(&self) -> f64 {
        if self.cell.level < 2 {
            return 2.0 * self.round.radius();
        }
        let middle = self.at(0.5, 0.5);
        let rim = |k: u32| middle.distance(self.at(0.5 * f64::from(k % 3), 0.5 * f64::from(k / 3)));
        // The rim bulges between these eight points.
        1.2 * (0..9).map(rim).fold(0.0, f64::max)
    }

    /// Whether `p` may be in front of some of the piece: never false where it is.
    pub fn may_face(&self, p: DVec3) -> bool {
        let middle = self.at(0.5, 0.5);
        let way = p - middle;
        let turn = self.turn();
        self.normal_at(middle).dot(way) + turn * (way.length() + self.reach()) > 0.0
    }

    /// The normal is nowhere on the piece further from that of its middle.
    fn turn(&self) -> f64 {
        match self.round {
            Round::Disc(_) => 0.0,
            // By no more than the width over the radius.
            Round::Sphere(sphere) => self.reach() / sphere.radius,
            Round::Cone(_) => PI * self.cell.square().1,
        }
    }

    /// Half the square of the angle by which the normal turns over the piece, one way and the other together: of a
    /// piece of a sphere, its area over the square of the radius.
    pub fn bend2(&self) -> f64 {
        match self.round {
            Round::Disc(_) => 0.0,
            Round::Sphere(sphere) => self.area() / (sphere.radius * sphere.radius),
            Round::Cone(_) => {
                let turn = |a: DVec3, b: DVec3| self.normal_at(a).angle_between(self.normal_at(b)).powi(2);
                let at = |s: f64, t: f64| self.at(s, t);
                0.5 * (turn(at(0.0, 0.5), at(1.0, 0.5)) + turn(at(0.5, 0.0), at(0.5, 1.0)))
            }
        }
    }

    /// The four quarters.
    pub fn quarters(&self) -> [Piece<'a>; 4] {
        [0, 1, 2, 3].map(|child| Piece { cell: self.cell.child(child), ..*self })
    }

    /// Adds up `value(place, normal, area)` over pieces small enough that `fine(place, area)` holds, or
    /// divided `deepest` times: a midpoint sum that follows the true surface.
    pub fn sum(
        &self,
        deepest: u8,
        fine: impl Fn(DVec3, f64) -> bool,
        mut value: impl FnMut(DVec3, DVec3, f64) -> f64,
    ) -> f64 {
        let last = (self.cell.level + deepest).min(Cell::MAX_LEVEL);
        let mut sum = 0.0;
        let mut left = vec![*self];
        while let Some(piece) = left.pop() {
            let (place, area) = (piece.at(0.5, 0.5), piece.area());
            if piece.cell.level < last && !fine(place, area) {
                left.extend(piece.quarters().into_iter().rev());
            } else {
                sum += value(place, piece.normal_at(place), area);
            }
        }
        sum
    }
}

//! Pieces of discs and spheres.

use super::Cell;
use crate::geometry::{Round, Side};
use glam::DVec3;

/// A cell of one side of a disc or a sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// The whole surface.
    pub round: Round,
    /// The side.
    pub side: Side,
    /// The cell.
    pub cell: Cell,
}

impl Piece {
    /// All of one side.
    pub fn whole(round: Round, side: Side) -> Piece {
        Piece { round, side, cell: Cell::ROOT }
    }

    /// Whether it is of the inside of a sphere, of which every element sees all others and itself.
    pub fn faces_itself(&self) -> bool {
        matches!(self.round, Round::Sphere(_)) && !self.round.looks_out(self.side)
    }

    /// Area, m²: the same for all pieces of a level.
    pub fn area(&self) -> f64 {
        self.round.area() * 0.25f64.powi(i32::from(self.cell.level))
    }

    /// The place at `(s, t)` of the unit square over the piece, m.
    pub fn at(&self, s: f64, t: f64) -> DVec3 {
        let [low, _, high, _] = self.cell.corners_uv(&self.round.into());
        let uv = low + (high - low) * glam::DVec2::new(s, t);
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
        let turn =
            if matches!(self.round, Round::Sphere(_)) { self.reach() / self.round.radius() } else { 0.0 };
        // Over the piece the normal turns by no more than its width over the radius.
        self.normal_at(middle).dot(way) + turn * (way.length() + self.reach()) > 0.0
    }

    /// The four quarters.
    pub fn quarters(&self) -> [Piece; 4] {
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

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
        let (low, size) = self.cell.square();
        self.round.cell_area(low, size)
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

    /// Unit normal of the side at `(s, t)` of the unit square over the piece.
    fn normal_of(&self, s: f64, t: f64) -> DVec3 {
        let (low, size) = self.cell.square();
        let normal = self.round.normal_of(low + size * DVec2::new(s, t));
        if self.side == Side::Front { normal } else { -normal }
    }

    /// No point of the piece is further from its middle, m.
    pub fn reach(&self) -> f64 {
        if let Round::Patch(patch) = self.round {
            let (low, size) = self.cell.square();
            let middle = self.at(0.5, 0.5);
            return patch
                .part(low, size)
                .as_flattened()
                .iter()
                .map(|p| p.distance(middle))
                .fold(0.0, f64::max);
        }
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
        self.normal_of(0.5, 0.5).dot(way) + turn * (way.length() + self.reach()) > 0.0
    }

    /// The normal is nowhere on the piece further from that of its middle.
    fn turn(&self) -> f64 {
        match self.round {
            Round::Disc(_) => 0.0,
            // By no more than the width over the radius.
            Round::Sphere(sphere) => self.reach() / sphere.radius,
            Round::Cone(_) => PI * self.cell.square().1,
            Round::Patch(patch) => {
                let (low, size) = self.cell.square();
                // From one side of the cone to the other; no normals are further apart than 2.
                patch.normals(low, size).map_or(2.0, |cone| 2.0 * cone.sine)
            }
        }
    }

    /// Half the square of the angle by which the normal turns over the piece, one way and the other together: of a
    /// piece of a sphere, its area over the square of the radius.
    pub fn bend2(&self) -> f64 {
        match self.round {
            Round::Disc(_) => 0.0,
            Round::Sphere(sphere) => self.area() / (sphere.radius * sphere.radius),
            Round::Cone(_) | Round::Patch(_) => {
                let turn = |[a, b]: [f64; 2], [c, d]: [f64; 2]| {
                    self.normal_of(a, b).angle_between(self.normal_of(c, d)).powi(2)
                };
                0.5 * (turn([0.0, 0.5], [1.0, 0.5]) + turn([0.5, 0.0], [0.5, 1.0]))
            }
        }
    }

    /// The four quarters.
    pub fn quarters(&self) -> [Piece<'a>; 4] {
        [0, 1, 2, 3].map(|child| Piece { cell: self.cell.child(child), ..*self })
    }

    /// The middles of the piece, of its quarters, of theirs and so on, `levels` deep, for [`Piece::sum`] to look up where
    /// it is asked for often. The quarters of the `k`th are number 4 k + 1 and following.
    pub fn middles(&self, levels: u8) -> Vec<Middle> {
        let mut pieces = vec![*self];
        let mut middles = Vec::new();
        let deepest = (self.cell.level + levels).min(Cell::MAX_LEVEL);
        while let Some(&piece) = pieces.get(middles.len()) {
            let (place, area) = piece.middle(self);
            middles.push(Middle { place, normal: piece.normal_of(0.5, 0.5), area });
            if piece.cell.level < deepest {
                pieces.extend(piece.quarters());
            }
        }
        middles
    }

    /// The middle of this piece, which is a part of `whole` or all of it, and the area that it stands for.
    fn middle(&self, whole: &Piece) -> (DVec3, f64) {
        let (low, size) = self.cell.square();
        let middle = low + 0.5 * size;
        // The element itself has the area that it stands for.
        let is_whole = self.cell.level == whole.cell.level;
        let area = if is_whole { self.area() } else { self.round.stretch(middle) * (size * size) };
        (self.round.point_at(middle.x, middle.y), area)
    }

    /// Adds up `value(place, normal, area)` over pieces small enough that `fine(place, area)` holds, or
    /// divided `deepest` times: a midpoint sum that follows the true surface. Some or none of the [`Piece::middles`] are
    /// `known`.
    pub fn sum(
        &self,
        known: &[Middle],
        deepest: u8,
        fine: impl Fn(DVec3, f64) -> bool,
        mut value: impl FnMut(DVec3, DVec3, f64) -> f64,
    ) -> f64 {
        let last = (self.cell.level + deepest).min(Cell::MAX_LEVEL);
        let mut sum = 0.0;
        let mut left = vec![(*self, 0)];
        while let Some((piece, k)) = left.pop() {
            let known = known.get(k);
            let (place, area) = known.map_or_else(|| piece.middle(self), |m| (m.place, m.area));
            if piece.cell.level < last && !fine(place, area) {
                let quarters = piece.quarters().into_iter().enumerate();
                left.extend(quarters.rev().map(|(child, quarter)| (quarter, 4 * k + 1 + child)));
            } else {
                sum += value(place, known.map_or_else(|| piece.normal_of(0.5, 0.5), |m| m.normal), area);
            }
        }
        sum
    }
}

/// The middle of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Middle {
    /// Where it is, m.
    pub place: DVec3,
    /// Unit normal of the side there.
    pub normal: DVec3,
    /// The area that it stands for, m².
    pub area: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Cone, Disc, Sphere};

    #[test]
    fn sums_have_the_same_bits_whatever_is_known() {
        let (centre, radius) = (DVec3::new(0.2, -0.1, 0.4), 0.7);
        let rounds = [
            Round::Disc(Disc { centre, normal: DVec3::new(0.6, 0.0, 0.8), radius }),
            Round::Sphere(Sphere { centre, radius, inward: true }),
            Round::Cone(Cone {
                base: centre,
                top: centre + DVec3::Z,
                radius,
                top_radius: 0.2,
                inward: false,
            }),
        ];
        let from = DVec3::new(1.5, 0.3, -0.2);
        for round in &rounds {
            for piece in [Piece::whole(round, Side::Back), Piece::whole(round, Side::Front).quarters()[2]] {
                let sum = |known: &[Middle]| {
                    let fine = |place: DVec3, area: f64| area < 1e-3 * place.distance_squared(from);
                    let mut pieces = 0;
                    let sum = piece.sum(known, 6, fine, |place, normal, area| {
                        pieces += 1;
                        area * normal.dot(from - place)
                    });
                    (sum.to_bits(), pieces)
                };
                let (bits, pieces) = sum(&[]);
                assert!(pieces > 64, "deeper than what is known, {pieces}");
                for levels in 0..4 {
                    let known = piece.middles(levels);
                    assert_eq!(known.len(), 4usize.pow(u32::from(levels) + 1) / 3);
                    assert_eq!(sum(&known), (bits, pieces), "{round:?}, {levels} levels");
                }
            }
        }
    }
}

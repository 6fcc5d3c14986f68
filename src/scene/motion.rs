//! `[[moves]]` of a changes file: where objects go.

use super::description::MoveTable;
use super::places::{direction, vector};
use super::source::Sources;
use crate::error::Result;
use crate::geometry::Shape;
use glam::{DMat3, DVec3};

/// A rigid motion, x to `rotation` x + `offset`, in world coordinates, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    rotation: DMat3,
    offset: DVec3,
}

impl Motion {
    /// What `table` says: first the rotation, then the translation.
    pub fn of(sources: &Sources, table: &MoveTable) -> Result<Motion> {
        if table.rotate.is_none() && table.translate.is_none() {
            let at = table.objects.span().start;
            return Err(sources.error(at, "nothing is said of where they go; add `translate` or `rotate`"));
        }
        let mut motion = Motion { rotation: DMat3::IDENTITY, offset: DVec3::ZERO };
        if let Some(rotate) = &table.rotate {
            let degrees = *rotate.degrees.get_ref();
            if !degrees.is_finite() {
                return Err(
                    sources.error(rotate.degrees.span().start, "an angle is a finite number of degrees")
                );
            }
            let axis = match &rotate.axis {
                Some(axis) => direction(sources, axis, "the axis of a rotation")?,
                None => DVec3::Z,
            };
            let about = vector(sources, &rotate.about, "what an object is rotated about")?;
            motion.rotation = DMat3::from_axis_angle(axis, degrees.to_radians());
            motion.offset = about - motion.rotation * about;
        }
        if let Some(translate) = &table.translate {
            motion.offset += vector(sources, translate, "a translation")?;
        }
        Ok(motion)
    }

    /// This motion and then `next`.
    pub fn then(&self, next: &Motion) -> Motion {
        Motion { rotation: next.rotation * self.rotation, offset: next.rotation * self.offset + next.offset }
    }

    /// `shape` where the motion takes it.
    pub fn moved(&self, shape: &Shape) -> Shape {
        let place = |p: DVec3| self.rotation * p + self.offset;
        match shape {
            Shape::Quad(corners) => Shape::Quad(corners.map(place)),
            Shape::Triangle(corners) => Shape::Triangle(corners.map(place)),
            Shape::Round(round) => Shape::Round(round.moved(self.rotation, self.offset)),
        }
    }
}

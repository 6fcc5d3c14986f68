//! How the sides of blocks lie against surfaces, kept from block to block: blocks that come one after the other have
//! sides in common.

use super::against::Against;
use std::ops::Range;

/// So many sides are remembered,
const SIDES: usize = 8;

/// and for each as many surfaces, by the last digits of the surface's number.
const SURFACES: usize = 256;

/// What is known of the sides that were the rows, or the columns, of the last blocks.
#[derive(Debug)]
pub(super) struct Known {
    /// First point and number of points.
    sides: [[usize; 2]; SIDES],
    /// The side at hand.
    at: usize,
    /// The side that another takes the place of.
    oldest: usize,
    /// By side and surface.
    found: Vec<Option<Box<Entry>>>,
}

#[derive(Debug)]
struct Entry {
    /// First point and number of points, and number of the surface.
    key: [usize; 3],
    against: Against,
}

impl Known {
    /// Nothing.
    pub fn new() -> Known {
        Known {
            sides: [[usize::MAX; 2]; SIDES],
            at: 0,
            oldest: 0,
            found: (0..SIDES * SURFACES).map(|_| None).collect(),
        }
    }

    /// Takes the side of these points at hand.
    pub fn begin(&mut self, points: &Range<usize>) {
        let side = [points.start, points.len()];
        self.at = self.sides.iter().position(|s| *s == side).unwrap_or_else(|| {
            let at = self.oldest;
            self.sides[at] = side;
            self.oldest = (at + 1) % SIDES;
            at
        });
    }

    /// How the side at hand lies against `surface`; `find` is asked if that is not known.
    pub fn against(&mut self, surface: u32, find: impl FnOnce(&mut Against)) -> &Against {
        let ([first, count], surface) = (self.sides[self.at], surface as usize);
        let key = [first, count, surface];
        let entry = self.found[self.at * SURFACES + surface % SURFACES]
            .get_or_insert_with(|| Box::new(Entry { key: [usize::MAX; 3], against: Against::NONE }));
        if entry.key != key {
            find(&mut entry.against);
            entry.key = key;
        }
        &entry.against
    }
}

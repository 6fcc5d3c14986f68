//! Which element holds a place of a surface.

use crate::points::Cell;
use glam::DVec2;

/// No element.
const NONE: u32 = u32::MAX;
/// Several elements: the place has to be looked for among the cells.
const DIVIDED: u32 = u32::MAX - 1;

/// The cells of every sheet (surface and side), by the squares of a grid over its (u, v).
pub(super) struct Cells {
    sheets: Vec<Sheet>,
    /// By square: the element that fills it, [`DIVIDED`] or [`NONE`].
    squares: Vec<u32>,
    /// Start of the cell on the Morton curve at the deepest level, and its element; sorted
    /// within a sheet.
    starts: Vec<(u32, u32)>,
}

#[derive(Clone, Copy)]
struct Sheet {
    /// First of its squares.
    squares: u32,
    /// Divisions of its grid.
    level: u32,
    triangle: bool,
    /// Its cells among all.
    first: u32,
    end: u32,
}

impl Cells {
    /// A sheet's grid has no more squares than this for each of its cells, and this many.
    const MOST: u64 = 16;

    /// From the cells of all elements, `(sheet, cell, element)`; `triangle` tells the shape of every sheet.
    pub fn new(triangle: &[bool], of: impl Iterator<Item = (usize, Cell, u32)>) -> Self {
        let mut keyed: Vec<(usize, u32, u32, u32)> = of
            .map(|(sheet, cell, element)| {
                let level = u32::from(cell.level);
                (sheet, (u64::from(cell.path) << (32 - 2 * level)) as u32, element, level)
            })
            .collect();
        keyed.sort_unstable();
        let mut cells =
            Cells { sheets: Vec::with_capacity(triangle.len()), squares: Vec::new(), starts: Vec::new() };
        let mut rest = &keyed[..];
        for (number, &triangle) in triangle.iter().enumerate() {
            let (own, others) = rest.split_at(rest.partition_point(|(sheet, ..)| *sheet == number));
            rest = others;
            cells.add(triangle, own);
        }
        cells
    }

    /// Adds a sheet with the cells `own`.
    fn add(&mut self, triangle: bool, own: &[(usize, u32, u32, u32)]) {
        let deepest = own.iter().map(|(.., level)| *level).max().unwrap_or(0);
        let most = Self::MOST * (own.len() as u64 + 1);
        let level = deepest.min(most.ilog2() / 2);
        let first = self.starts.len() as u32;
        self.starts.extend(own.iter().map(|&(_, start, element, _)| (start, element)));
        let squares = self.squares.len() as u32;
        self.sheets.push(Sheet { squares, level, triangle, first, end: self.starts.len() as u32 });
        self.squares.extend((0..1u32 << (2 * level)).map(|square| {
            let code = if triangle { square } else { morton(square & ((1 << level) - 1), square >> level) };
            let start = (u64::from(code) << (32 - 2 * level)) as u32;
            match own.partition_point(|(_, from, ..)| *from <= start).checked_sub(1).map(|at| own[at]) {
                None => NONE,
                Some((.., deep)) if deep > level => DIVIDED,
                Some((_, _, element, _)) => element,
            }
        }));
    }

    /// The element at a place of a sheet, each of whose coordinates lies between 0 and 1, if the sheet has any.
    #[inline(always)]
    pub fn find(&self, sheet: usize, uv: DVec2) -> Option<usize> {
        let of = &self.sheets[sheet];
        let square = if of.triangle {
            triangle_code(uv, of.level)
        } else {
            let [x, y] = steps(uv, of.level);
            y << of.level | x
        };
        match self.squares[(of.squares + square) as usize] {
            NONE => None,
            DIVIDED => Some(self.search(of, uv)),
            element => Some(element as usize),
        }
    }

    /// The same by bisection.
    #[cold]
    fn search(&self, of: &Sheet, uv: DVec2) -> usize {
        let code = if of.triangle {
            triangle_code(uv, 16)
        } else {
            let [x, y] = steps(uv, 16);
            morton(x, y)
        };
        let own = &self.starts[of.first as usize..of.end as usize];
        let after = own.partition_point(|(start, _)| *start <= code);
        own[after.saturating_sub(1)].1 as usize
    }

    /// Feeds where all cells lie to `hasher`.
    pub fn hash(&self, hasher: &mut blake3::Hasher) {
        for (start, element) in &self.starts {
            hasher.update(&[start.to_le_bytes(), element.to_le_bytes()].concat());
        }
    }
}

/// The square of a grid of 2^level by 2^level that holds `uv`.
#[inline(always)]
fn steps(uv: DVec2, level: u32) -> [u32; 2] {
    let count = 1u32 << level;
    [uv.x, uv.y].map(|x| ((x * f64::from(count)) as u32).min(count - 1))
}

/// The place on the Morton curve of a square, as the path of [`Cell`]; coordinates of 16 bits.
fn morton(x: u32, y: u32) -> u32 {
    let spread = |x: u32| {
        let x = (x | x << 8) & 0x00ff_00ff;
        let x = (x | x << 4) & 0x0f0f_0f0f;
        let x = (x | x << 2) & 0x3333_3333;
        (x | x << 1) & 0x5555_5555
    };
    spread(x) | spread(y) << 1
}

/// The same for a place of a triangle: the weights of the corners become those in the child that holds them.
#[inline]
fn triangle_code(uv: DVec2, levels: u32) -> u32 {
    let mut w = [1.0 - uv.x - uv.y, uv.x, uv.y];
    let mut code = 0;
    for _ in 0..levels {
        let corner = w.iter().position(|&x| x >= 0.5);
        w = match corner {
            Some(0) => [w[0] - w[1] - w[2], 2.0 * w[1], 2.0 * w[2]],
            Some(1) => [2.0 * w[0], w[1] - w[0] - w[2], 2.0 * w[2]],
            Some(_) => [2.0 * w[0], 2.0 * w[1], w[2] - w[0] - w[1]],
            None => [w[1] + w[2] - w[0], w[0] + w[2] - w[1], w[0] + w[1] - w[2]],
        };
        code = code << 2 | corner.map_or(3, |c| c as u32);
    }
    code
}

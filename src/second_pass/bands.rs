//! The image as bands of tiles: who works on what, and what is kept of an interrupted run.

use super::checkpoint::{Band, Writer};
use super::settings::SecondPassStats;
use super::tile::Room;
use crate::error::Result;
use crate::observer::Observer;
use rayon::prelude::*;
use std::collections::HashMap;

/// Pixels along the edge of a tile.
const TILE: usize = 16;

/// An image that is made in one stage or several.
pub(super) struct Bands<'a> {
    /// Pixels in a row, and rows.
    pub size: [usize; 2],
    /// Numbers of a pixel.
    pub layers: usize,
    /// What an earlier run has left, by number.
    pub kept: HashMap<u32, Band>,
    /// Where finished bands are kept.
    pub writer: Option<Writer>,
    /// Is told of every tile.
    pub observer: &'a dyn Observer,
}

/// How many numbers band `number` holds, of an image of this size and these layers that is made in up to `stages` stages.
pub(super) fn floats(
    [width, height]: [usize; 2],
    layers: usize,
    stages: usize,
    number: u32,
) -> Option<usize> {
    let bands = height.div_ceil(TILE);
    let first = number as usize % bands * TILE;
    ((number as usize) < stages * bands).then(|| TILE.min(height - first) * width * layers)
}

impl Bands<'_> {
    /// One stage: `tile` makes the numbers of the pixels at these places (column and row), `[places][layers]`. All of
    /// the image, `[height][width][layers]`, and the sum of the counts. The bits do not depend on the number of
    /// threads, nor on what is kept.
    pub fn stage(
        &mut self,
        stage: u32,
        tile: impl Fn(&[[u32; 2]], &mut Room) -> (Vec<f64>, SecondPassStats) + Sync,
    ) -> Result<(Vec<f32>, SecondPassStats)> {
        let ([width, height], layers) = (self.size, self.layers);
        let (columns, bands) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let (observer, writer) = (self.observer, self.writer.as_ref());
        observer.begin("second pass", (columns * bands) as u64);
        let mut image = vec![0.0f32; width * height * layers];
        let rows: Vec<_> = image
            .chunks_mut(TILE * width * layers)
            .enumerate()
            .map(|(band, rows)| (band, rows, self.kept.remove(&(stage * bands as u32 + band as u32))))
            .collect();
        let make = |band: usize, rows: &mut [f32]| -> Result<SecondPassStats> {
            let tiles: Vec<_> = (0..columns)
                .into_par_iter()
                .map_init(Room::default, |room, column| {
                    let x = column * TILE..width.min((column + 1) * TILE);
                    let y = band * TILE..height.min((band + 1) * TILE);
                    let places: Vec<[u32; 2]> =
                        y.flat_map(|y| x.clone().map(move |x| [x as u32, y as u32])).collect();
                    let made = tile(&places, room);
                    observer.advance(1);
                    (places, made)
                })
                .collect();
            let mut stats = SecondPassStats::default();
            for (places, (numbers, of)) in tiles {
                for ([x, y], numbers) in places.into_iter().zip(numbers.chunks_exact(layers)) {
                    let to = ((y as usize - band * TILE) * width + x as usize) * layers;
                    rows[to..to + layers].iter_mut().zip(numbers).for_each(|(out, of)| *out = *of as f32);
                }
                stats.add(&of);
            }
            if let Some(writer) = writer {
                writer.add(stage * bands as u32 + band as u32, rows, &stats)?;
            }
            Ok(stats)
        };
        let stats: Result<Vec<SecondPassStats>> = rows
            .into_par_iter()
            .map(|(band, rows, kept)| match kept {
                Some(kept) => {
                    rows.copy_from_slice(&kept.floats);
                    observer.advance(columns as u64);
                    Ok(kept.stats)
                }
                None => make(band, rows),
            })
            .collect();
        observer.end();
        let mut total = SecondPassStats::default();
        stats?.iter().for_each(|band| total.add(band));
        Ok((image, total))
    }
}

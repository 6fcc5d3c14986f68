//! Finished bands of rows on disk, so that an interrupted render can go on.
//!
//! The file begins with a key, a hash of all that the image depends on. Records follow, one a band in any
//! order: its number, its counts and floats, and a hash of these. What a crash left half written
//! fails its hash and is rendered again, and so is all behind it.

use super::settings::SecondPassStats;
use crate::error::{Error, Result};
use std::collections::HashMap;
use std::fs::{self, File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Says what the file is; the digit is the format's version.
const MAGIC: &[u8; 8] = b"luxpart2";

/// Bytes of a hash.
const HASH: usize = 32;

/// Numbers of [`SecondPassStats`] that are kept.
const COUNTS: usize = 11;

/// A band of rows as it was rendered.
pub(super) struct Band {
    /// What there is of its rows, `[rows][width][layers]`.
    pub floats: Vec<f32>,
    /// Its counts.
    pub stats: SecondPassStats,
}

/// The file beside the image that keeps finished bands.
pub struct Checkpoint {
    path: PathBuf,
    resume: bool,
}

impl Checkpoint {
    /// For the image `output`: `OUT.exr` has `OUT.exr.partial`. With `resume` the bands of an earlier
    /// run are used, without it they are thrown away.
    pub fn beside(output: &Path, resume: bool) -> Self {
        let mut name = output.file_name().unwrap_or_default().to_owned();
        name.push(".partial");
        Checkpoint { path: output.with_file_name(name), resume }
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the file: the image is safe.
    pub fn finish(&self) -> Result<()> {
        fs::remove_file(&self.path).map_err(|e| Error::io(&self.path, e))
    }

    /// Bands of an earlier run, and where to add more. `floats(band)` is the number of floats in a
    /// band, `None` where there is no such band. Errors: [`Error::Settings`] for a file of another image.
    pub(super) fn open(
        &self,
        key: &[u8; HASH],
        floats: impl Fn(u32) -> Option<usize>,
    ) -> Result<(HashMap<u32, Band>, Writer)> {
        let io = |e: std::io::Error| Error::io(&self.path, e);
        let mut bands = HashMap::new();
        let mut good = 0;
        if self.resume && self.path.exists() {
            let bytes = fs::read(&self.path).map_err(io)?;
            let head = MAGIC.len() + HASH;
            // A file cut off within its head holds nothing yet.
            if bytes.len() >= head {
                if &bytes[..MAGIC.len()] != MAGIC || &bytes[MAGIC.len()..head] != key {
                    return Err(Error::Settings(format!(
                        "{}: this belongs to another image (scene, camera or settings differ); \
                         delete it or drop --resume",
                        self.path.display()
                    )));
                }
                good = head;
                while let Some((number, band, length)) = read(&bytes[good..], &floats) {
                    bands.insert(number, band);
                    good += length;
                }
            }
        }
        let mut file =
            OpenOptions::new().create(true).write(true).truncate(false).open(&self.path).map_err(io)?;
        file.set_len(good as u64).map_err(io)?;
        file.seek(SeekFrom::End(0)).map_err(io)?;
        if good == 0 {
            file.write_all(&[&MAGIC[..], key].concat()).map_err(io)?;
        }
        Ok((bands, Writer { path: self.path.clone(), file: Mutex::new(file) }))
    }
}

/// Adds bands to the file; may be shared by threads.
pub(super) struct Writer {
    path: PathBuf,
    file: Mutex<File>,
}

impl Writer {
    /// Adds a finished band.
    pub fn add(&self, number: u32, floats: &[f32], stats: &SecondPassStats) -> Result<()> {
        let mut record = number.to_le_bytes().to_vec();
        record.extend(counts(stats).into_iter().flat_map(u64::to_le_bytes));
        record.extend(floats.iter().flat_map(|l| l.to_le_bytes()));
        let hash = blake3::hash(&record);
        record.extend(hash.as_bytes());
        // One write a record, so that a crash can only cut off the last.
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(&record).map_err(|e| Error::io(&self.path, e))
    }
}

/// The first record of `bytes` and its length, if it is whole.
fn read(bytes: &[u8], floats: impl Fn(u32) -> Option<usize>) -> Option<(u32, Band, usize)> {
    let (number, rest) = bytes.split_first_chunk::<4>()?;
    let number = u32::from_le_bytes(*number);
    let end = 4 + 8 * COUNTS + 4 * floats(number)?;
    let hash = bytes.get(end..end + HASH)?;
    if blake3::hash(&bytes[..end]).as_bytes() != hash {
        return None;
    }
    let (counts, floats) = rest[..end - 4].split_at(8 * COUNTS);
    let mut of = [0; COUNTS];
    for (count, bytes) in of.iter_mut().zip(counts.as_chunks::<8>().0) {
        *count = u64::from_le_bytes(*bytes);
    }
    let floats = floats.as_chunks::<4>().0.iter().map(|l| f32::from_le_bytes(*l)).collect();
    Some((number, Band { floats, stats: stats(of) }, end + HASH))
}

fn counts(stats: &SecondPassStats) -> [u64; COUNTS] {
    [
        stats.camera_rays,
        stats.reflected_rays,
        stats.transmitted_rays,
        stats.missed_rays,
        stats.paths_cut,
        stats.cut_share.to_bits(),
        stats.paths_ended,
        stats.gather_rays,
        stats.shadow_rays,
        stats.by_chance_share.to_bits(),
        stats.clamped_share.to_bits(),
    ]
}

fn stats(counts: [u64; COUNTS]) -> SecondPassStats {
    SecondPassStats {
        camera_rays: counts[0],
        reflected_rays: counts[1],
        transmitted_rays: counts[2],
        missed_rays: counts[3],
        paths_cut: counts[4],
        cut_share: f64::from_bits(counts[5]),
        paths_ended: counts[6],
        gather_rays: counts[7],
        shadow_rays: counts[8],
        by_chance_share: f64::from_bits(counts[9]),
        clamped_share: f64::from_bits(counts[10]),
        ..SecondPassStats::default()
    }
}

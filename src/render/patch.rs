//! Sums of some blocks of a frame, which one process takes and another adds up.

use super::{Blocks, Frame};
use crate::film::Film;
use std::ops::Range;

/// The exact sums of the same samples of each pixel of some blocks. Patches of a pass that have no sample in common add
/// up to the film of the pass in any order ([`super::Gathered`]); unlike a [`super::PartialFilm`], a patch is only as
/// large as its blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Patch {
    blocks: Vec<u32>,
    samples: Range<u32>,
    sums: Vec<u8>,
}

/// Error of adding a patch.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PatchError {
    /// The pass has ended or has not begun.
    #[error("pass {0} is not open")]
    Pass(u64),
    /// It has other blocks or samples than the pass.
    #[error("the pass does not have samples {}..{} of all of its blocks", .0.start, .0.end)]
    Foreign(Range<u32>),
    /// The sums are those of another film, or damaged.
    #[error("its sums are not those of its samples")]
    Damaged,
}

impl Patch {
    /// Sums of the samples that the frame's pass has taken, once its job has ended.
    pub fn of(frame: &Frame) -> Self {
        let (blocks, samples) = (frame.pass().blocks().to_vec(), frame.pass().samples());
        let mut sums = Vec::new();
        let saved = frame.film().save_pixels(&runs(frame.blocks(), &blocks), &mut sums);
        saved.expect("memory can be written");
        Self { blocks, samples, sums }
    }

    /// A patch of sums that [`Patch::sums`] returned.
    pub fn new(blocks: Vec<u32>, samples: Range<u32>, sums: Vec<u8>) -> Self {
        Self { blocks, samples, sums }
    }

    /// The blocks.
    pub fn blocks(&self) -> &[u32] {
        &self.blocks
    }

    /// The sample numbers, the same in each pixel.
    pub fn samples(&self) -> Range<u32> {
        self.samples.clone()
    }

    /// The sums, the same bytes on any machine: what [`Film::save_pixels`] writes for the rows of the blocks.
    pub fn sums(&self) -> &[u8] {
        &self.sums
    }

    /// The sums alone.
    pub fn into_sums(self) -> Vec<u8> {
        self.sums
    }

    /// Number of samples of all pixels of some blocks.
    pub(super) fn count(blocks: Blocks, some: &[u32], samples: &Range<u32>) -> u64 {
        let pixels: usize = some.iter().map(|&block| blocks.indices(block).count()).sum();
        pixels as u64 * samples.len() as u64
    }

    /// Adds the sums to a film. An error changes nothing.
    pub(super) fn add_to(&self, film: &Film, blocks: Blocks) -> Result<(), PatchError> {
        let added = film.add_pixels(&runs(blocks, &self.blocks), self.samples.len() as u32, &self.sums);
        added.ok_or(PatchError::Damaged)
    }
}

/// The pixels of blocks, row by row.
fn runs(blocks: Blocks, some: &[u32]) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    for &block in some {
        let rows = blocks.pixels(block).0.len().max(1);
        let indices: Vec<usize> = blocks.indices(block).collect();
        runs.extend(indices.chunks(rows).map(|row| row[0]..row[0] + row.len()));
    }
    runs
}

//! Layers that a film holds besides radiance.

use super::coverage_counts::CoverageCounts;
use serde::{Deserialize, Serialize};

/// The most different ids of a pixel that [`LayerPlan::coverage`] counts, on average over 64 neighbours in a row. If
/// they show more, those of the least hashes are kept, with exact counts; the choice does not depend on the order of
/// samples.
pub const MEAN_PIXEL_IDS: u32 = 8;

/// The most sums and counts that a file may ask for.
const MAX_ENTRIES: usize = 64;

/// Bits of an id of [`LayerPlan::coverage`].
pub const COVERAGE_ID_BITS: u32 = 26;

/// Layers that a film holds besides radiance, in one column for each entry.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct LayerPlan {
    /// Sums over samples. Each entry is the number of fraction bits of one channel:
    /// [`LayerPlan::fraction_bits`] gives the most that cannot overflow.
    pub sums: Vec<i32>,
    /// True if samples that hit something are counted.
    pub hits: bool,
    /// True if half of the samples have sums of radiance of their own ([`super::Film::HALF`]).
    pub halves: bool,
    /// True if the hits of rays through the centres of pixels are kept.
    pub centres: bool,
    /// Counts of (pixel, id). Each entry is the number of different ids, at most 2^[`COVERAGE_ID_BITS`].
    pub coverage: Vec<u32>,
    /// The most samples of a pixel.
    pub samples: u32,
}

impl LayerPlan {
    /// True if a film holds radiance alone.
    pub fn is_empty(&self) -> bool {
        let Self { sums, hits, halves, centres, coverage, .. } = self;
        sums.is_empty() && !hits && !halves && !centres && coverage.is_empty()
    }

    /// True if a file may ask for it.
    pub(super) fn is_sound(&self) -> bool {
        let Self { sums, coverage, .. } = self;
        sums.len() + coverage.len() <= MAX_ENTRIES && coverage.iter().all(|ids| *ids <= 1 << COVERAGE_ID_BITS)
    }

    /// The most fraction bits with which `samples` numbers of magnitude up to 2^`bound_bits` are added without
    /// overflow: their sum stays below 2⁶².
    pub fn fraction_bits(bound_bits: i32, samples: u32) -> i32 {
        62 - bound_bits - samples.max(1).next_power_of_two().trailing_zeros() as i32
    }

    /// Bytes of the layers of a film of this many pixels, at most: 8 a pixel for each sum, 4 for hits, 28 for halves,
    /// 12 for centres. Counts of (pixel, id) grow as ids are seen, up to 10 bytes for each of `min(samples, ids,
    /// `[`MEAN_PIXEL_IDS`]`)` ids of a pixel, and one byte more.
    pub fn bytes(&self, pixels: u64) -> u64 {
        let Self { sums, hits, halves, centres, coverage, samples } = self;
        let flags = [(*hits, 4), (*halves, 28), (*centres, 12)];
        let fixed =
            8 * sums.len() as u64 + flags.iter().map(|(is, bytes)| u64::from(*is) * bytes).sum::<u64>();
        let counts = coverage.iter().map(|&ids| CoverageCounts::bytes(pixels, ids.min(*samples)));
        let counts = counts.fold(0, u64::saturating_add);
        pixels.saturating_mul(fixed).saturating_add(counts)
    }
}

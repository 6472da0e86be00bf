//! Exact counts of (pixel, id).

use super::accumulation::take;
use super::layer_plan::{COVERAGE_ID_BITS, MEAN_PIXEL_IDS};
use super::stripe::{STRIPE_PIXELS, Stripes};
use crate::geom::mix;
use std::io::Write;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The most entries of a stripe.
const MAX_ENTRIES: usize = (MEAN_PIXEL_IDS * STRIPE_PIXELS) as usize;

const ID: u32 = (1 << COVERAGE_ID_BITS) - 1;
const _: () = assert!(STRIPE_PIXELS.is_power_of_two() && STRIPE_PIXELS <= 1 << (32 - COVERAGE_ID_BITS));

/// Number of each pixel's samples that show each thing.
///
/// # Why no order can change it
/// Counts are integers. A stripe keeps the [`MAX_ENTRIES`] entries of the least hashes among those seen so far. An
/// entry that is dropped never returns, and one that is kept at the end was never dropped, so its count is exact.
#[derive(Debug)]
pub(super) struct CoverageCounts(Vec<Mutex<Vec<Entry>>>);

/// A pixel of a stripe (upper bits) and its id, and the number of samples; ascending.
type Entry = (u32, u32);

impl CoverageCounts {
    pub fn new(pixels: usize) -> Self {
        Self(std::iter::repeat_with(Mutex::default).take(pixels.div_ceil(STRIPE_PIXELS as usize)).collect())
    }

    /// Bytes of the counts of this many pixels. Each shows at most `ids` ids.
    pub fn bytes(pixels: u64, ids: u32) -> u64 {
        // Stripes grow by a quarter.
        let entries = pixels.saturating_mul(u64::from(ids.min(MEAN_PIXEL_IDS)) * 10);
        entries.saturating_add(
            Stripes::bytes(pixels) * (size_of::<Mutex<Vec<Entry>>>() + 4 * size_of::<Entry>()) as u64,
        )
    }

    fn stripe(&self, number: usize) -> MutexGuard<'_, Vec<Entry>> {
        self.0[number].lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn clear(&mut self) {
        self.0.iter_mut().for_each(|stripe| stripe.get_mut().unwrap_or_else(PoisonError::into_inner).clear());
    }

    /// Counts samples of a pixel that show an id below 2^[`COVERAGE_ID_BITS`].
    pub fn count(&self, pixel: u32, id: u32, samples: u32) {
        debug_assert!(id <= ID, "id {id}");
        let key = (pixel % STRIPE_PIXELS) << COVERAGE_ID_BITS | id;
        count(&mut self.stripe((pixel / STRIPE_PIXELS) as usize), key, samples);
    }

    pub fn add(&self, other: &Self) {
        for number in 0..self.0.len() {
            let more = other.stripe(number);
            let mut stripe = self.stripe(number);
            more.iter().for_each(|&(key, samples)| count(&mut stripe, key, samples));
        }
    }

    /// The start of each pixel's entries, and all entries: ids ascend within a pixel.
    pub fn resolve(&self, pixels: usize) -> (Vec<u32>, Vec<(u32, u32)>) {
        let (mut starts, mut entries) = (Vec::with_capacity(pixels + 1), Vec::new());
        for number in 0..self.0.len() {
            let stripe = self.stripe(number);
            let mut rest = &stripe[..];
            for pixel in 0..STRIPE_PIXELS.min((pixels - number * STRIPE_PIXELS as usize) as u32) {
                starts.push(entries.len() as u32);
                let own = rest.partition_point(|entry| entry.0 >> COVERAGE_ID_BITS <= pixel);
                entries.extend(rest[..own].iter().map(|&(key, samples)| (key & ID, samples)));
                rest = &rest[own..];
            }
        }
        starts.push(entries.len() as u32);
        (starts, entries)
    }

    pub fn save(&self, to: &mut impl Write) -> std::io::Result<()> {
        for number in 0..self.0.len() {
            let stripe = self.stripe(number);
            to.write_all(&(stripe.len() as u32).to_le_bytes())?;
            for (key, samples) in &*stripe {
                to.write_all(&key.to_le_bytes())?;
                to.write_all(&samples.to_le_bytes())?;
            }
        }
        Ok(())
    }

    /// Reads what [`CoverageCounts::save`] wrote. `None` if bytes are missing or out of order.
    pub fn restore(&self, from: &mut &[u8]) -> Option<()> {
        for number in 0..self.0.len() {
            let mut stripe = self.stripe(number);
            for _ in 0..u32::from_le_bytes(*take(from)?) {
                let (key, samples) = (u32::from_le_bytes(*take(from)?), u32::from_le_bytes(*take(from)?));
                if stripe.last().is_some_and(|last| last.0 >= key) {
                    return None;
                }
                stripe.push((key, samples));
            }
        }
        Some(())
    }
}

/// Counts of some pixels.
impl CoverageCounts {
    /// Writes the counts of neighbouring pixels.
    pub fn save_pixels(&self, run: &Range<usize>, to: &mut impl Write) -> std::io::Result<()> {
        for (number, pixels) in stripes(run) {
            let stripe = self.stripe(number);
            let own = || stripe.iter().filter(|entry| pixels.contains(&(entry.0 >> COVERAGE_ID_BITS)));
            to.write_all(&(own().count() as u32).to_le_bytes())?;
            for (key, samples) in own() {
                to.write_all(&key.to_le_bytes())?;
                to.write_all(&samples.to_le_bytes())?;
            }
        }
        Ok(())
    }

    /// Adds what [`CoverageCounts::save_pixels`] wrote for the same pixels, or only looks at it. `None` if bytes are
    /// missing, out of order or of other pixels.
    pub fn add_pixels(&self, run: &Range<usize>, from: &mut &[u8], is_added: bool) -> Option<()> {
        for (number, pixels) in stripes(run) {
            let mut last = None;
            for _ in 0..u32::from_le_bytes(*take(from)?) {
                let (key, samples) = (u32::from_le_bytes(*take(from)?), u32::from_le_bytes(*take(from)?));
                if last.is_some_and(|last| last >= key) || !pixels.contains(&(key >> COVERAGE_ID_BITS)) {
                    return None;
                }
                last = Some(key);
                if is_added {
                    count(&mut self.stripe(number), key, samples);
                }
            }
        }
        Some(())
    }
}

/// The stripes of neighbouring pixels, and which of the pixels of each.
fn stripes(run: &Range<usize>) -> impl Iterator<Item = (usize, Range<u32>)> {
    let (Range { start, end }, each) = (run.clone(), STRIPE_PIXELS as usize);
    (start / each..end.div_ceil(each)).map(move |number| {
        let first = number * each;
        (number, (start.max(first) - first) as u32..(end.min(first + each) - first) as u32)
    })
}

fn count(stripe: &mut Vec<Entry>, key: u32, samples: u32) {
    let place = stripe.partition_point(|entry| entry.0 < key);
    if let Some(entry) = stripe.get_mut(place).filter(|entry| entry.0 == key) {
        entry.1 += samples;
        return;
    }
    if stripe.len() < MAX_ENTRIES {
        if stripe.len() == stripe.capacity() {
            stripe.reserve_exact(stripe.len() / 4 + 4);
        }
        return stripe.insert(place, (key, samples));
    }
    let greatest = stripe.iter().enumerate().max_by_key(|(_, entry)| mix(entry.0));
    let (last, greatest) = greatest.map(|(last, entry)| (last, mix(entry.0))).expect("there are entries");
    if mix(key) < greatest {
        stripe.remove(last);
        let place = stripe.partition_point(|entry| entry.0 < key);
        stripe.insert(place, (key, samples));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(samples: impl Iterator<Item = (u32, u32)>) -> CoverageCounts {
        let counts = CoverageCounts::new(100);
        samples.for_each(|(pixel, id)| counts.count(pixel, id, 1));
        counts
    }

    #[test]
    fn counts_are_exact_in_any_order_and_bounded() {
        // Pixel 70 shows 900 ids, id i as often as i % 3 + 1; the others show two.
        let crowd = (0..2700u32).filter(|i| i / 900 <= i % 900 % 3).map(|i| (70, i % 900));
        let samples: Vec<_> = crowd.chain((0..400).map(|i| (i % 100, i / 200))).collect();
        let forward = counted(samples.iter().copied());
        let backward = counted(samples.iter().rev().copied());
        let (starts, entries) = forward.resolve(100);
        assert_eq!((starts.clone(), entries.clone()), backward.resolve(100));
        let of = |pixel: usize| &entries[starts[pixel] as usize..starts[pixel + 1] as usize];
        assert_eq!(of(3), [(0, 2), (1, 2)]);
        let kept: usize = (64..100).map(|pixel| of(pixel).len()).sum();
        assert_eq!(kept, MAX_ENTRIES);
        for &(id, samples) in of(70) {
            assert_eq!(samples, id % 3 + 1 + if id < 2 { 2 } else { 0 }, "id {id}");
        }
    }

    #[test]
    fn counts_of_parts_add_up_and_are_restored() {
        let samples: Vec<_> = (0..5000u32).map(|i| (mix(i) % 100, mix(i + 9) % 90)).collect();
        let whole = counted(samples.iter().copied()).resolve(100);
        let part = counted(samples[..2000].iter().copied());
        part.add(&counted(samples[2000..].iter().copied()));
        assert_eq!(part.resolve(100), whole);
        let mut saved = Vec::new();
        part.save(&mut saved).expect("memory");
        let restored = CoverageCounts::new(100);
        restored.restore(&mut &saved[..]).expect("whole");
        assert_eq!(restored.resolve(100), whole);
        assert!(CoverageCounts::new(100).restore(&mut &saved[..saved.len() - 1]).is_none());
    }
}

//! Sums of some of a film's pixels, which travel alone.

use super::Film;
use super::accumulation::take;
use std::io::Write;
use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;

/// Bytes of a pixel without layers.
const PIXEL_BYTES: usize = 3 * size_of::<i64>() + size_of::<u32>();

/// Bytes before the pixels: the precision, and the numbers of dropped and clamped splats.
const START_BYTES: usize = size_of::<u32>() + 2 * size_of::<u64>();

impl Film {
    /// Writes all sums and counts of runs of pixels (row-major indices), as little-endian integers.
    ///
    /// # Errors
    /// When the writer fails.
    ///
    /// # Panics
    /// If the film does not have the pixels.
    pub fn save_pixels(&self, runs: &[Range<usize>], to: &mut impl Write) -> std::io::Result<()> {
        to.write_all(&self.fraction_bits().to_le_bytes())?;
        to.write_all(&self.dropped_splats().to_le_bytes())?;
        to.write_all(&self.clamped_splats().to_le_bytes())?;
        let (sums, samples) = self.all_sums();
        for run in runs {
            for sum in sums[run.clone()].as_flattened() {
                to.write_all(&sum.load(Relaxed).to_le_bytes())?;
            }
            for count in &samples[run.clone()] {
                to.write_all(&count.load(Relaxed).to_le_bytes())?;
            }
            self.layers.as_ref().map_or(Ok(()), |layers| layers.save_pixels(run, to))?;
        }
        for counts in self.layers.iter().flat_map(|layers| layers.coverage()) {
            runs.iter().try_for_each(|run| counts.save_pixels(run, to))?;
        }
        Ok(())
    }

    /// Adds what [`Film::save_pixels`] wrote for the same runs of a film of the same precision and layers, in which
    /// each of the pixels has this many samples. `None`, and nothing is changed, if it is anything else.
    ///
    /// # Panics
    /// If the film does not have the pixels.
    pub fn add_pixels(&self, runs: &[Range<usize>], each: u32, bytes: &[u8]) -> Option<()> {
        let pixels: usize = runs.iter().map(Range::len).sum();
        let pixel_bytes = PIXEL_BYTES + self.layers.as_ref().map_or(0, |layers| layers.pixel_bytes());
        let (mut start, rest) = bytes.split_at_checked(START_BYTES)?;
        let (mut fixed, coverage) = rest.split_at_checked(pixels.checked_mul(pixel_bytes)?)?;
        let bits = u32::from_le_bytes(*take(&mut start)?);
        let is_whole = bits == self.fraction_bits()
            && self.has_samples(runs, each, fixed)?
            && self.add_coverage(runs, coverage, false).is_some();
        if !is_whole {
            return None;
        }
        self.count_lost(u64::from_le_bytes(*take(&mut start)?), u64::from_le_bytes(*take(&mut start)?));
        let (sums, samples) = self.all_sums();
        for run in runs {
            for (pixel, sum) in run.clone().zip(&sums[run.clone()]) {
                let _stripe = self.lock(pixel as u32);
                for channel in sum {
                    let more = i64::from_le_bytes(*take(&mut fixed)?);
                    channel.store(channel.load(Relaxed) + more, Relaxed);
                }
            }
            for count in &samples[run.clone()] {
                count.fetch_add(u32::from_le_bytes(*take(&mut fixed)?), Relaxed);
            }
            self.layers.as_ref().map_or(Some(()), |layers| layers.add_pixels(run, &mut fixed))?;
        }
        self.add_coverage(runs, coverage, true)
    }

    /// True if each pixel has this many samples.
    fn has_samples(&self, runs: &[Range<usize>], each: u32, mut fixed: &[u8]) -> Option<bool> {
        let of_layers = self.layers.as_ref().map_or(0, |layers| layers.pixel_bytes());
        for run in runs {
            let (_, rest) = fixed.split_at_checked(run.len() * 3 * size_of::<i64>())?;
            let (counts, rest) = rest.split_at_checked(run.len() * size_of::<u32>())?;
            if !counts.as_chunks().0.iter().all(|count| u32::from_le_bytes(*count) == each) {
                return Some(false);
            }
            (_, fixed) = rest.split_at_checked(run.len() * of_layers)?;
        }
        Some(true)
    }

    fn add_coverage(&self, runs: &[Range<usize>], mut bytes: &[u8], is_added: bool) -> Option<()> {
        for counts in self.layers.iter().flat_map(|layers| layers.coverage()) {
            for run in runs {
                counts.add_pixels(run, &mut bytes, is_added)?;
            }
        }
        bytes.is_empty().then_some(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::LayerPlan;
    use super::*;
    use crate::geom::mix;
    use glam::Vec3;

    fn film() -> Film {
        let plan = LayerPlan { sums: vec![-8, -9], hits: true, halves: true, ..LayerPlan::default() };
        let plan = LayerPlan { centres: true, coverage: vec![64], samples: 64, ..plan };
        Film::new(40, 30, 64).expect("fits").with_layers(plan).expect("memory")
    }

    /// Two samples of each pixel of the runs.
    fn fill(film: &Film, runs: &[Range<usize>], seed: u32) {
        for pixel in runs.iter().cloned().flatten().map(|pixel| pixel as u32) {
            let value = mix(pixel + seed) as f32 / 1e9;
            film.splat(pixel, Vec3::new(value, 2.0 * value, 0.5));
            film.splat(pixel | Film::HALF, Vec3::splat(value));
            film.add_samples(pixel, 2);
            film.add_half_samples(pixel, 1);
            film.add_hits::<1>(&[pixel], (0, &[[i64::from(pixel)], [7]]), true);
            film.count_ids(0, &[pixel, pixel], &[pixel % 5, seed]);
            film.set_centre(pixel, None);
        }
    }

    fn bytes_of(film: &Film) -> Vec<u8> {
        let mut bytes = Vec::new();
        film.save(&mut bytes).expect("memory");
        bytes
    }

    #[test]
    fn pixels_add_up_to_the_whole_film() {
        let (top, bottom) = (vec![0..100, 130..190, 200..205], vec![100..130, 190..200, 205..1200]);
        let (whole, sum) = (film(), film());
        for (seed, runs) in [(1, &top), (2, &bottom), (3, &top)] {
            fill(&whole, runs, seed);
            let part = film();
            fill(&part, runs, seed);
            let mut bytes = Vec::new();
            part.save_pixels(runs, &mut bytes).expect("memory");
            sum.add_pixels(runs, 2, &bytes).expect("of this film");
            let before = bytes_of(&sum);
            assert_eq!(sum.add_pixels(runs, 3, &bytes), None, "other samples");
            assert_eq!(sum.add_pixels(runs, 2, &bytes[1..]), None, "cut at the start");
            assert_eq!(sum.add_pixels(runs, 2, &bytes[..bytes.len() - 1]), None, "cut at the end");
            assert_eq!(sum.add_pixels(&runs[1..], 2, &bytes), None, "other pixels");
            bytes[0] ^= 1;
            assert_eq!(sum.add_pixels(runs, 2, &bytes), None, "another precision");
            assert_eq!(bytes_of(&sum), before, "what is refused changes nothing");
        }
        assert_eq!(bytes_of(&sum), bytes_of(&whole));
    }
}

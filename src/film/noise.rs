//! Estimates the noise of a film's pixels.

use super::Film;
use super::accumulation::take;
use std::io::Write;
use std::ops::Range;

/// The variance of each pixel's luminance between the passes that were added to a film.
///
/// # Why passes
/// A path adds several splats, so a film does not know single samples, but it knows the sum of each pass. If the
/// passes of a pixel with `n` samples have means `x`, and all passes together have mean `m`, then `Σ n (x − m)² /
/// (passes − 1)` estimates the variance of one sample. Divided by the number of all samples, it estimates the
/// variance of `m`. A pass of stratified samples varies less than one of independent samples, and several passes
/// together less still, so the estimate is conservative.
///
/// # Why no thread can change it
/// Films of whole passes are exact sums, and one thread adds the passes in their order, so the estimate is
/// deterministic.
#[derive(Clone, Debug)]
pub struct Noise {
    width: usize,
    /// `Σ n (x − m)²` of each pixel.
    spread: Vec<f32>,
    passes: Vec<u16>,
}

impl Noise {
    /// An estimate for a film of this size, without any pass.
    pub fn new(film: &Film) -> Self {
        let (width, pixels) = (film.width() as usize, film.width() as usize * film.height() as usize);
        Self { width, spread: vec![0.0; pixels], passes: vec![0; pixels] }
    }

    /// Adds a pass to the estimate. `before` is the film of all earlier passes, to which the pass is about to be
    /// added.
    pub fn add_pass(&mut self, before: &Film, pass: &Film) {
        for (pixel, (spread, passes)) in self.spread.iter_mut().zip(&mut self.passes).enumerate() {
            let ((mean, samples), (x, more)) = (before.luminance(pixel), pass.luminance(pixel));
            if more > 0 {
                // The update of Chan, Golub and LeVeque (1979), which avoids differences of large numbers.
                let (samples, more) = (f64::from(samples), f64::from(more));
                *spread += ((x - mean) * (x - mean) * (samples * more / (samples + more))) as f32;
                *passes = passes.saturating_add(1);
            }
        }
    }

    /// Over a range of columns and rows: the root mean square of the pixels' standard errors in luminance, and the
    /// mean luminance. The error is infinite before the second pass.
    pub fn measure(&self, film: &Film, columns: Range<u32>, rows: Range<u32>) -> (f64, f64) {
        let (mut variance, mut sum, mut pixels) = (0.0, 0.0, 0.0);
        for y in rows {
            for x in columns.clone() {
                let pixel = y as usize * self.width + x as usize;
                let (luminance, samples) = film.luminance(pixel);
                let degrees = f64::from(self.passes[pixel].saturating_sub(1));
                variance += f64::from(self.spread[pixel]) / (degrees * f64::from(samples));
                sum += luminance;
                pixels += 1.0;
            }
        }
        let error = libm::sqrt(variance / pixels);
        (if error.is_nan() { f64::INFINITY } else { error }, sum / pixels)
    }

    /// Writes the estimate.
    ///
    /// # Errors
    /// When the writer fails.
    pub fn save(&self, to: &mut impl Write) -> std::io::Result<()> {
        for (spread, passes) in self.spread.iter().zip(&self.passes) {
            to.write_all(&spread.to_le_bytes())?;
            to.write_all(&passes.to_le_bytes())?;
        }
        Ok(())
    }

    /// Reads what [`Noise::save`] wrote for a film of this size. `None` if bytes are missing.
    pub fn restored(film: &Film, from: &mut &[u8]) -> Option<Self> {
        let mut noise = Self::new(film);
        for (spread, passes) in noise.spread.iter_mut().zip(&mut noise.passes) {
            *spread = f32::from_le_bytes(*take(from)?);
            *passes = u16::from_le_bytes(*take(from)?);
        }
        Some(noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Passes of `samples` random numbers each over a film. Returns the estimate and the film.
    fn passes(samples: &[u32], seed: u32) -> (Noise, Film) {
        let film = Film::new(16, 16, 4096).expect("fits");
        let mut noise = Noise::new(&film);
        let mut counter = seed << 20;
        for &samples in samples {
            let pass = film.blank();
            for pixel in 0..256 {
                for _ in 0..samples {
                    counter += 1;
                    let value = crate::geom::mix(counter) as f32 / u32::MAX as f32;
                    pass.splat(pixel, Vec3::splat(2.0 + value));
                    pass.add_samples(pixel, 1);
                }
            }
            noise.add_pass(&film, &pass);
            film.add(&pass);
        }
        (noise, film)
    }

    #[test]
    fn the_error_is_that_of_the_mean() {
        // The variance of a uniform number is 1/12.
        for (samples, all) in [(&[8, 8, 8, 8][..], 32.0), (&[2, 4, 8, 2, 16, 32], 64.0)] {
            let (noise, film) = passes(samples, all as u32);
            let (error, mean) = noise.measure(&film, 0..16, 0..16);
            let expected = libm::sqrt(1.0 / 12.0 / all);
            assert!((error / expected - 1.0).abs() < 0.1, "{error} where {expected} is expected");
            assert!((mean - 2.5).abs() < 0.02);
            // The true error agrees: the pixels' means deviate by as much from the expected value.
            let square = |pixel: usize| (film.luminance(pixel).0 - 2.5).powi(2);
            let real = libm::sqrt((0..256).map(square).sum::<f64>() / 256.0);
            assert!((error / real - 1.0).abs() < 0.15, "{error} where {real} is found");
        }
    }

    #[test]
    fn one_pass_gives_no_estimate() {
        let (noise, film) = passes(&[8], 0);
        assert_eq!(noise.measure(&film, 3..9, 0..4).0, f64::INFINITY);
        let (noise, film) = passes(&[], 0);
        assert_eq!(noise.measure(&film, 0..16, 0..16), (f64::INFINITY, 0.0));
    }

    #[test]
    fn a_saved_estimate_is_restored() {
        let (noise, film) = passes(&[4, 2, 3], 5);
        let mut saved = Vec::new();
        noise.save(&mut saved).expect("memory");
        let restored = Noise::restored(&film, &mut &saved[..]).expect("whole");
        assert_eq!(noise.measure(&film, 0..16, 0..9), restored.measure(&film, 0..16, 0..9));
        assert!(Noise::restored(&film, &mut &saved[1..]).is_none());
    }
}

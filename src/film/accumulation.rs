//! The film: radiance added in fixed point.

use super::stripe::{Stripe, Stripes};
use crate::lanes::{Int, Lanes, Vector};
use std::io::Write;
use std::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, Ordering::Relaxed};

/// Splats brighter than this are clamped to it, per channel.
pub const MAX_RADIANCE: f32 = (1u32 << MAX_RADIANCE_BITS) as f32;

const MAX_RADIANCE_BITS: u32 = 20;

/// Fewest bits after the point that a film works with: a rounding error of 2⁻¹³ per splat, far below
/// a step of an 8-bit picture.
const MIN_FRACTION_BITS: u32 = 12;

/// Most bits after the point; more would not be seen through the 24 bits of the `f32` that splats come in.
const MAX_FRACTION_BITS: u32 = 40;

/// Pixels that any number of threads add radiance to at once, with the same bytes in the end.
///
/// # Why no order can change a byte
/// A splat is rounded once to an integer multiple of 2^−`fraction_bits` and added with an integer
/// addition. Integer additions commute and associate exactly as long as none overflows.
///
/// # Why none overflows
/// A pixel receives at most `splats` splats, each at most [`MAX_RADIANCE`] = 2²⁰. With
/// `fraction_bits = 62 − 20 − ⌈log₂ splats⌉` the sum stays at or below
/// 2^(20 + fraction_bits) · splats ≤ 2⁶² < 2⁶³. A splat beyond the promised number could only
/// overflow after as many again.
#[derive(Debug)]
pub struct Film {
    width: u32,
    height: u32,
    fraction_bits: u32,
    sums: Vec<[AtomicI64; 3]>,
    samples: Vec<AtomicU32>,
    /// Guard `sums`.
    stripes: Stripes,
    dropped: AtomicU64,
}

/// A pixel would receive more splats than fit into its sum.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "each pixel may receive {splats} splats, at most {} can be added exactly; ask for fewer samples per pixel or a smaller depth",
    Film::MAX_SPLATS
)]
pub struct TooManySplats {
    /// The number asked for.
    pub splats: u64,
}

impl Film {
    /// The most splats that a pixel can be promised.
    pub const MAX_SPLATS: u64 = 1 << (62 - MAX_RADIANCE_BITS - MIN_FRACTION_BITS);

    /// A black film of `width` × `height` pixels, each of which will receive at most `splats` splats.
    ///
    /// # Errors
    /// When so many splats could overflow.
    pub fn new(width: u32, height: u32, splats: u64) -> Result<Self, TooManySplats> {
        if splats > Self::MAX_SPLATS {
            return Err(TooManySplats { splats });
        }
        let splat_bits = splats.max(1).next_power_of_two().trailing_zeros();
        let fraction_bits = (62 - MAX_RADIANCE_BITS - splat_bits).min(MAX_FRACTION_BITS);
        assert!(fraction_bits >= MIN_FRACTION_BITS && MAX_RADIANCE_BITS + splat_bits + fraction_bits <= 62);
        Ok(Self::black(width, height, fraction_bits))
    }

    fn black(width: u32, height: u32, fraction_bits: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self {
            width,
            height,
            fraction_bits,
            // Memory that nobody has touched costs nothing.
            sums: bytemuck::zeroed_vec(pixels),
            samples: bytemuck::zeroed_vec(pixels),
            stripes: Stripes::new(pixels),
            dropped: AtomicU64::new(0),
        }
    }

    /// A black film of the same size and precision.
    pub fn blank(&self) -> Self {
        Self::black(self.width, self.height, self.fraction_bits)
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Counts `samples` more camera rays for a pixel (row-major index, first row on top): its mean is
    /// taken over all of them, whatever they bring.
    pub fn add_samples(&self, pixel: u32, samples: u32) {
        self.samples[pixel as usize].fetch_add(samples, Relaxed);
    }

    /// Adds radiance to a pixel, clamped to [`MAX_RADIANCE`]. A splat with a negative channel or one
    /// that is not finite is dropped and counted.
    pub fn splat(&self, pixel: u32, radiance: glam::Vec3) {
        let sums = &self.sums[pixel as usize];
        if let Some(fixed) = self.fixed(radiance) {
            let _stripe = self.stripes.lock(pixel);
            add(sums, fixed);
        }
    }

    /// [`Film::splat`] of each lane of a mask. Neighbouring lanes often meet the same stripe, which is
    /// locked once for all of them.
    #[inline(always)]
    pub fn splat_lanes<L: Lanes>(&self, lanes: u32, pixel: Int<L>, radiance: Vector<L>) {
        if lanes != 0 {
            let radiance = [radiance.x.to_array(), radiance.y.to_array(), radiance.z.to_array()];
            self.splat_all(lanes, &pixel.to_array(), &radiance);
        }
    }

    fn splat_all(&self, mut lanes: u32, pixel: &[u32; 16], [r, g, b]: &[[f32; 16]; 3]) {
        let mut stripe = None;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let sums = &self.sums[pixel[lane] as usize];
            if let Some(fixed) = self.fixed(glam::Vec3::new(r[lane], g[lane], b[lane])) {
                if !stripe.as_ref().is_some_and(|stripe: &Stripe<'_>| stripe.has(pixel[lane])) {
                    // The last one is let go of first: whoever holds two could wait for ever.
                    drop(stripe.take());
                    stripe = Some(self.stripes.lock(pixel[lane]));
                }
                add(sums, fixed);
            }
        }
    }

    /// Radiance in fixed point; `None`, and counted, if it is none.
    fn fixed(&self, radiance: glam::Vec3) -> Option<[i64; 3]> {
        let valid = radiance.is_finite() && radiance.cmpge(glam::Vec3::ZERO).all();
        if !valid {
            self.dropped.fetch_add(1, Relaxed);
            return None;
        }
        let scale = (1u64 << self.fraction_bits) as f64;
        // The product is exact (a power of two), the rounding is the only error.
        Some(radiance.to_array().map(|value| round(f64::from(value.min(MAX_RADIANCE)) * scale) as i64))
    }

    /// Adds all that another film of the same size and precision has received.
    ///
    /// # Panics
    /// If it is of another size or precision.
    pub fn add(&self, other: &Self) {
        let kind = |film: &Self| (film.width, film.height, film.fraction_bits);
        assert_eq!(kind(self), kind(other), "films of one kind can be added");
        for (pixel, (sums, more)) in self.sums.iter().zip(&other.sums).enumerate() {
            let _stripe = self.stripes.lock(pixel as u32);
            add(sums, more.each_ref().map(|sum| sum.load(Relaxed)));
        }
        for (count, more) in self.samples.iter().zip(&other.samples) {
            count.fetch_add(more.load(Relaxed), Relaxed);
        }
        self.dropped.fetch_add(other.dropped_splats(), Relaxed);
    }

    /// A pixel's mean luminance (Rec. 709) and over how many samples; 0 if there is none.
    pub fn luminance(&self, pixel: usize) -> (f64, u32) {
        let samples = self.samples[pixel].load(Relaxed);
        let [r, g, b] = self.sums[pixel].each_ref().map(|sum| sum.load(Relaxed) as f64);
        let unit = 1.0 / ((1u64 << self.fraction_bits) as f64 * f64::from(samples.max(1)));
        ((0.2126 * r + 0.7152 * g + 0.0722 * b) * unit, samples)
    }

    /// Writes all that has been received, as integers.
    ///
    /// # Errors
    /// When the file system refuses.
    pub fn save(&self, to: &mut impl Write) -> std::io::Result<()> {
        to.write_all(&self.fraction_bits.to_le_bytes())?;
        to.write_all(&self.dropped_splats().to_le_bytes())?;
        for sum in self.sums.as_flattened() {
            to.write_all(&sum.load(Relaxed).to_le_bytes())?;
        }
        for count in &self.samples {
            to.write_all(&count.load(Relaxed).to_le_bytes())?;
        }
        Ok(())
    }

    /// A film of the same size and precision with what another has written by [`Film::save`]; none if it
    /// was of another precision, or longer.
    pub fn restored(&self, from: &mut &[u8]) -> Option<Self> {
        let film = self.blank();
        if u32::from_le_bytes(*take(from)?) != self.fraction_bits {
            return None;
        }
        film.dropped.store(u64::from_le_bytes(*take(from)?), Relaxed);
        for sum in film.sums.as_flattened() {
            sum.store(i64::from_le_bytes(*take(from)?), Relaxed);
        }
        for count in &film.samples {
            count.store(u32::from_le_bytes(*take(from)?), Relaxed);
        }
        Some(film)
    }

    /// Splats dropped so far because they were not radiance.
    pub fn dropped_splats(&self) -> u64 {
        self.dropped.load(Relaxed)
    }

    /// Samples taken of each pixel so far, row major, first row on top.
    pub fn sample_counts(&self) -> Vec<u32> {
        self.samples.iter().map(|n| n.load(Relaxed)).collect()
    }

    /// Samples taken of a pixel on average.
    pub fn mean_samples(&self) -> f64 {
        self.samples.iter().map(|n| f64::from(n.load(Relaxed))).sum::<f64>() / self.samples.len() as f64
    }

    /// The mean radiance of each pixel over its own samples, row major, first row on top; 0 where
    /// there is no sample yet.
    pub fn resolve(&self) -> Vec<[f32; 3]> {
        let unit = 1.0 / (1u64 << self.fraction_bits) as f64;
        self.sums
            .iter()
            .zip(&self.samples)
            .map(|(sums, samples)| match samples.load(Relaxed) {
                0 => [0.0; 3],
                n => sums.each_ref().map(|sum| (sum.load(Relaxed) as f64 * unit / f64::from(n)) as f32),
            })
            .collect()
    }
}

/// Adds to sums whose stripe is locked: no thread comes between, so reading and writing need not be one
/// operation, which is several times cheaper.
fn add(sums: &[AtomicI64; 3], fixed: [i64; 3]) {
    for (sum, fixed) in sums.iter().zip(fixed) {
        sum.store(sum.load(Relaxed) + fixed, Relaxed);
    }
}

/// The next bytes, if there are so many.
pub(crate) fn take<'a, const N: usize>(from: &mut &'a [u8]) -> Option<&'a [u8; N]> {
    let (bytes, rest) = from.split_first_chunk()?;
    *from = rest;
    Some(bytes)
}

/// The nearest integer to a number ≥ 0, ties to even.
fn round(x: f64) -> f64 {
    // From here on there is no fraction; below, adding it leaves none.
    const WHOLE: f64 = (1u64 << 52) as f64;
    if x < WHOLE { (x + WHOLE) - WHOLE } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_mean_is_over_the_pixels_own_samples() {
        let film = Film::new(2, 2, 16).expect("fits");
        film.add_samples(3, 4);
        film.splat(3, Vec3::new(1.0, 2.0, 3.0));
        film.splat(3, Vec3::new(3.0, 2.0, 1.0));
        film.add_samples(1, 1);
        assert_eq!(film.resolve(), vec![[0.0; 3], [0.0; 3], [0.0; 3], [1.0; 3]]);
        assert_eq!(film.sample_counts(), vec![0, 1, 0, 4]);
    }

    #[test]
    fn what_is_not_radiance_is_dropped_and_counted() {
        let film = Film::new(1, 1, 8).expect("fits");
        film.add_samples(0, 1);
        film.splat(0, Vec3::new(f32::NAN, 0.0, 0.0));
        film.splat(0, Vec3::new(0.0, f32::INFINITY, 0.0));
        film.splat(0, Vec3::new(0.0, 0.0, -1.0));
        film.splat(0, Vec3::new(0.5, 1e-30, f32::MAX));
        assert_eq!(film.dropped_splats(), 3);
        assert_eq!(film.resolve(), vec![[0.5, 0.0, MAX_RADIANCE]]);
    }

    #[test]
    fn rounding_is_to_nearest_even() {
        for (x, nearest) in [(0.5, 0.0), (1.5, 2.0), (2.5, 2.0), (0.499, 0.0), (2f64.powi(61), 2f64.powi(61))]
        {
            assert_eq!(round(x), nearest);
        }
        for i in 0..100_000u32 {
            let x = f64::from(crate::geom::mix(i)) * 2.0f64.powi((i % 90) as i32 - 45);
            assert_eq!(round(x), libm::rint(x), "{x}");
        }
    }

    #[test]
    fn the_brightest_splats_fill_a_pixel_without_overflow() {
        for splats in [1, 2, 3, 1000, 4096] {
            let film = Film::new(1, 1, splats).expect("fits");
            for _ in 0..splats {
                film.splat(0, Vec3::splat(f32::MAX));
            }
            film.add_samples(0, 1);
            assert_eq!(film.resolve()[0][0], MAX_RADIANCE * splats as f32);
        }
        assert!(Film::new(1, 1, Film::MAX_SPLATS).is_ok());
        assert_eq!(
            Film::new(1, 1, Film::MAX_SPLATS + 1).err(),
            Some(TooManySplats { splats: Film::MAX_SPLATS + 1 })
        );
    }

    #[test]
    fn parts_add_up_and_survive_being_saved() {
        let whole = Film::new(3, 2, 16).expect("fits");
        let parts = [whole.blank(), whole.blank()];
        for i in 0..40u32 {
            let (pixel, radiance) = (i % 6, Vec3::new(i as f32, 0.1 * i as f32, 1.0 / (i as f32)));
            for film in [&whole, &parts[usize::from(i > 11)]] {
                film.splat(pixel, radiance);
                film.add_samples(pixel, 1);
            }
        }
        parts[0].add(&parts[1]);
        let mut saved = Vec::new();
        parts[0].save(&mut saved).expect("memory");
        let restored = whole.restored(&mut &saved[..]).expect("the same kind");
        for film in [&parts[0], &restored] {
            assert_eq!(film.resolve(), whole.resolve());
            assert_eq!((film.sample_counts(), film.dropped_splats()), (whole.sample_counts(), 1));
        }
        assert!(whole.restored(&mut &saved[..saved.len() - 1]).is_none(), "cut");
        assert!(Film::new(3, 2, 1 << 20).expect("fits").restored(&mut &saved[..]).is_none(), "less precise");
        let (luminance, samples) = whole.luminance(1);
        let [r, g, b] = whole.resolve()[1].map(f64::from);
        assert_eq!(samples, 7);
        assert!((luminance - (0.2126 * r + 0.7152 * g + 0.0722 * b)).abs() < 1e-4);
    }

    #[test]
    fn order_and_threads_do_not_change_a_byte() {
        let values: Vec<Vec3> = (0..4000u32)
            .map(|i| {
                let x = crate::geom::mix(i) as f32 * 2.0f32.powi(-(i as i32 % 40));
                Vec3::new(x, 1.0 / (x + 1e-3), x * x)
            })
            .collect();
        let forward = Film::new(1, 1, 4000).expect("fits");
        values.iter().for_each(|&v| forward.splat(0, v));
        forward.add_samples(0, 7);
        let shuffled = Film::new(1, 1, 4000).expect("fits");
        std::thread::scope(|scope| {
            for part in values.chunks(997) {
                scope.spawn(|| part.iter().rev().for_each(|&v| shuffled.splat(0, v)));
            }
        });
        shuffled.add_samples(0, 3);
        shuffled.add_samples(0, 4);
        assert_eq!(forward.resolve(), shuffled.resolve());
    }
}

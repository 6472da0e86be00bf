//! The film: sums of radiance in fixed point.

use super::layer_sums::LayerSums;
use super::spare::Spare;
use super::stripe::{Stripe, Stripes};
use crate::lanes::{Int, Lanes, Mask, Num, Vector, nearest};
use crate::memory::OutOfMemory;
use std::io::Write;
use std::ops::Range;
use std::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, Ordering::Relaxed};

/// The largest value of a splat's channel. Brighter splats are clamped to it.
pub const MAX_RADIANCE: f32 = (1u32 << MAX_RADIANCE_BITS) as f32;

const MAX_RADIANCE_BITS: u32 = 20;

/// The fewest fraction bits of a film. The rounding error is at most 2⁻¹³ per splat, far below a step of an 8-bit
/// picture.
pub(super) const MIN_FRACTION_BITS: u32 = 12;

/// The most fraction bits. More would not show, because splats are `f32` values with a precision of 24 bits.
pub(super) const MAX_FRACTION_BITS: u32 = 40;

/// Pixels to which any number of threads add radiance at the same time. The sums do not depend on the order.
///
/// # Why no order can change a byte
/// A splat is rounded once to an integer multiple of 2^−`fraction_bits` and added with an integer addition. Integer
/// additions commute and associate exactly as long as none overflows.
///
/// # Why none overflows
/// A pixel receives at most `splats` splats, each at most [`MAX_RADIANCE`] = 2²⁰. With `fraction_bits = 62 − 20 −
/// ⌈log₂ splats⌉` the sum stays at or below 2^(20 + fraction_bits) · splats ≤ 2⁶² < 2⁶³. Splats beyond the
/// promised number overflow only after as many again.
#[derive(Debug)]
pub struct Film {
    width: u32,
    height: u32,
    fraction_bits: u32,
    sums: Sums,
    samples: Counts,
    /// Data besides radiance ([`super::LayerPlan`]).
    pub(super) layers: Option<Box<LayerSums>>,
    /// Locks that guard `sums`.
    stripes: Stripes,
    dropped: AtomicU64,
    clamped: AtomicU64,
    /// Memory of dropped films.
    spare: Spare,
}

/// The sums of all pixels.
pub(super) type Sums = Vec<[AtomicI64; 3]>;

/// The number of samples of all pixels.
pub(super) type Counts = Vec<AtomicU32>;

/// The memory of a film.
#[derive(Debug)]
pub(super) struct Memory {
    pub sums: Sums,
    pub samples: Counts,
    pub layers: Option<Box<LayerSums>>,
}

/// Error of making a film.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// A pixel could receive more splats than its sum can hold.
    #[error(
        "each pixel may receive {splats} splats, but at most {} can be added exactly; use fewer samples per pixel or a \
         smaller depth",
        Film::MAX_SPLATS
    )]
    TooManySplats {
        /// The requested number of splats per pixel.
        splats: u64,
    },
    /// There is too little memory.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

impl Film {
    /// The largest number of splats per pixel that a film supports.
    pub const MAX_SPLATS: u64 = 1 << (62 - MAX_RADIANCE_BITS - MIN_FRACTION_BITS);

    /// A black film of `width` × `height` pixels. Each will receive at most `splats` splats.
    ///
    /// # Errors
    /// When `splats` exceeds [`Film::MAX_SPLATS`], or the system does not give the memory.
    pub fn new(width: u32, height: u32, splats: u64) -> Result<Self, FilmError> {
        if splats > Self::MAX_SPLATS {
            return Err(FilmError::TooManySplats { splats });
        }
        let splat_bits = splats.max(1).next_power_of_two().trailing_zeros();
        let fraction_bits = (62 - MAX_RADIANCE_BITS - splat_bits).min(MAX_FRACTION_BITS);
        assert!(fraction_bits >= MIN_FRACTION_BITS && MAX_RADIANCE_BITS + splat_bits + fraction_bits <= 62);
        Ok(Self::black(width, height, fraction_bits)?)
    }

    pub(super) fn black(width: u32, height: u32, fraction_bits: u32) -> Result<Self, OutOfMemory> {
        let pixels = width as usize * height as usize;
        let refused = |()| OutOfMemory::Refused {
            what: format!("a film of {width}x{height} pixels"),
            needed: Self::bytes(width, height),
        };
        // The system maps zeroed pages only when they are written.
        let sums = bytemuck::try_zeroed_vec(pixels).map_err(refused)?;
        let samples = bytemuck::try_zeroed_vec(pixels).map_err(refused)?;
        let memory = Memory { sums, samples, layers: None };
        Ok(Self::with_memory((width, height), fraction_bits, memory, Spare::default()))
    }

    /// A film with zeroed memory.
    fn with_memory(
        (width, height): (u32, u32),
        fraction_bits: u32,
        Memory { sums, samples, layers }: Memory,
        spare: Spare,
    ) -> Self {
        let (stripes, dropped, clamped) = (Stripes::new(sums.len()), AtomicU64::new(0), AtomicU64::new(0));
        Self { width, height, fraction_bits, sums, samples, layers, stripes, dropped, clamped, spare }
    }

    /// A black film of the same size and precision, without layers.
    pub(super) fn black_of_kind(&self) -> Result<Self, OutOfMemory> {
        Self::black(self.width, self.height, self.fraction_bits)
    }

    /// Bytes of a film without layers: 28 a pixel, and one for 64 pixels. [`super::LayerPlan::bytes`] gives those of
    /// layers.
    pub fn bytes(width: u32, height: u32) -> u64 {
        let pixels = u64::from(width) * u64::from(height);
        let pixel = (size_of::<[AtomicI64; 3]>() + size_of::<AtomicU32>()) as u64;
        pixels.saturating_mul(pixel).saturating_add(Stripes::bytes(pixels))
    }

    /// A black film of the same size, precision and layers. It takes the memory of a film that was made from the same
    /// one and has been dropped, if there is one.
    ///
    /// # Panics
    /// If the system does not give the memory. A caller counts all films beforehand ([`Film::bytes`]).
    pub fn blank(&self) -> Self {
        if let Some(memory) = self.spare.take() {
            let size = (self.width, self.height);
            return Self::with_memory(size, self.fraction_bits, memory, self.spare.clone());
        }
        let film = match self.plan() {
            None => self.black_of_kind(),
            Some(plan) => self.with_layers(plan.clone()),
        };
        let mut film = film.unwrap_or_else(|error| panic!("{error}"));
        film.spare = self.spare.clone();
        film
    }

    /// Width in pixels.
    #[inline]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    #[inline]
    pub fn height(&self) -> u32 {
        self.height
    }

    pub(super) fn fraction_bits(&self) -> u32 {
        self.fraction_bits
    }

    /// Number of pixels.
    pub(super) fn pixels(&self) -> usize {
        self.sums.len()
    }

    /// The sums of all pixels, and their numbers of samples.
    pub(super) fn all_sums(&self) -> (&Sums, &Counts) {
        (&self.sums, &self.samples)
    }

    /// Counts splats that another film has dropped and clamped.
    pub(super) fn count_lost(&self, dropped: u64, clamped: u64) {
        self.dropped.fetch_add(dropped, Relaxed);
        self.clamped.fetch_add(clamped, Relaxed);
    }

    /// Locks the sums of a pixel and its neighbours.
    #[inline]
    pub(super) fn lock(&self, pixel: u32) -> Stripe<'_> {
        self.stripes.lock(pixel)
    }

    /// Number of samples of a pixel so far.
    #[inline]
    pub fn samples_of(&self, pixel: usize) -> u32 {
        self.samples[pixel].load(Relaxed)
    }

    /// The sums of a pixel and its number of samples.
    pub(super) fn sums_of(&self, pixel: usize) -> ([i64; 3], u32) {
        (self.sums[pixel].each_ref().map(|sum| sum.load(Relaxed)), self.samples[pixel].load(Relaxed))
    }

    /// The sums of the half of the samples that [`Film::HALF`] marks, if it has some.
    #[inline]
    pub(super) fn half(&self) -> Option<&Sums> {
        self.layers.as_ref().filter(|layers| layers.plan.halves).map(|layers| &layers.half)
    }

    /// Adds to a pixel's number of camera rays (row-major index, first row on top). The pixel's mean is taken over
    /// all of them, including rays that add no radiance.
    #[inline]
    pub fn add_samples(&self, pixel: u32, samples: u32) {
        self.samples[pixel as usize].fetch_add(samples, Relaxed);
    }

    /// Adds radiance to a pixel. A splat with a channel above [`MAX_RADIANCE`] is clamped and counted. One with a
    /// negative channel, or one that is not finite, is dropped and counted; then the result is false.
    pub fn splat(&self, pixel: u32, radiance: glam::Vec3) -> bool {
        let Some(fixed) = self.fixed(radiance) else { return false };
        let half = self.half().filter(|_| pixel & Self::HALF > 0);
        let pixel = if self.half().is_some() { pixel & !Self::HALF } else { pixel };
        let _stripe = self.stripes.lock(pixel);
        for sums in std::iter::once(&self.sums).chain(half) {
            add(&sums[pixel as usize], fixed);
        }
        true
    }

    /// [`Film::splat`] for each lane of a mask. Returns the lanes that were dropped. Neighbouring lanes often belong to
    /// one pixel, whose sums are then added to once, or to one stripe, which is then locked once.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn splat_lanes<L: Lanes>(&self, lanes: Mask<L>, pixel: Int<L>, radiance: Vector<L>) -> Mask<L> {
        if lanes.none() {
            return lanes;
        }
        let (x, y, z) = (radiance.x, radiance.y, radiance.z);
        let (zero, brightest) = (Num::zero(x.lanes()), x.max(y).max(z));
        // NaN is not at least 0.
        let valid = lanes & x.ge(zero) & y.ge(zero) & z.ge(zero) & brightest.below(f32::INFINITY);
        let dropped = lanes & !valid;
        if dropped.any() {
            self.count_dropped(dropped.count() as u64);
        }
        let Some(first) = valid.iter().next() else { return dropped };
        let (most, scale) = (Num::splat(x.lanes(), MAX_RADIANCE), self.scale());
        let clamped = valid & brightest.gt(most);
        if clamped.any() {
            self.count_clamped(clamped.count() as u64);
        }
        let fixed = [x.min(most).to_fixed(scale), y.min(most).to_fixed(scale), z.min(most).to_fixed(scale)];
        let mut pixel = pixel;
        if let Some(half) = self.half() {
            let marked = valid & !(pixel >> 31).is(0);
            pixel = pixel & !Self::HALF;
            if let Some(first) = marked.iter().next() {
                self.add_fixed(half, pixel, first, marked, &fixed);
            }
        }
        self.add_fixed(&self.sums, pixel, first, valid, &fixed);
        dropped
    }

    #[cold]
    #[inline(never)]
    fn count_clamped(&self, splats: u64) {
        self.clamped.fetch_add(splats, Relaxed);
    }

    /// Adds the lanes of a mask to sums; `first` is the first of them.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add_fixed<L: Lanes>(
        &self,
        sums: &Sums,
        pixel: Int<L>,
        first: usize,
        lanes: Mask<L>,
        fixed: &[L::Array<i64>; 3],
    ) {
        let pixels = pixel.to_array();
        if (lanes & !pixel.is(pixels[first])).none() {
            self.add_lanes(sums, pixels[first], lanes, fixed);
        } else {
            self.add_each(sums, &pixels, lanes, fixed);
        }
    }

    /// Counts splats that were dropped before they reached the film.
    #[cold]
    #[inline(never)]
    pub fn count_dropped(&self, splats: u64) {
        self.dropped.fetch_add(splats, Relaxed);
    }

    /// Adds the lanes of a mask to one pixel.
    #[inline]
    fn add_lanes<L: Lanes>(&self, to: &Sums, pixel: u32, lanes: Mask<L>, fixed: &[L::Array<i64>; 3]) {
        let mut sums = [0; 3];
        for (channel, sum) in sums.iter_mut().enumerate() {
            for (lane, fixed) in fixed[channel].as_ref().iter().enumerate() {
                *sum += fixed & -i64::from(lanes.test(lane));
            }
        }
        let _stripe = self.stripes.lock(pixel);
        add(&to[pixel as usize], sums);
    }

    /// Adds each lane of a mask to its pixel.
    #[inline]
    fn add_each<L: Lanes>(
        &self,
        to: &Sums,
        pixels: &L::Array<u32>,
        lanes: Mask<L>,
        [r, g, b]: &[L::Array<i64>; 3],
    ) {
        let mut stripe = None;
        for lane in lanes.iter() {
            let pixel = pixels[lane];
            if !stripe.as_ref().is_some_and(|stripe: &Stripe<'_>| stripe.has(pixel)) {
                // Unlock the previous stripe first. A thread that holds two could deadlock.
                drop(stripe.take());
                stripe = Some(self.stripes.lock(pixel));
            }
            add(&to[pixel as usize], [r[lane], g[lane], b[lane]]);
        }
    }

    /// The factor from radiance to fixed point.
    #[inline]
    pub(super) fn scale(&self) -> f64 {
        (1u64 << self.fraction_bits) as f64
    }

    /// Radiance in fixed point. `None` if it is negative or not finite; the dropped splat is counted.
    fn fixed(&self, radiance: glam::Vec3) -> Option<[i64; 3]> {
        let valid = radiance.is_finite() && radiance.cmpge(glam::Vec3::ZERO).all();
        if !valid {
            self.dropped.fetch_add(1, Relaxed);
            return None;
        }
        if radiance.max_element() > MAX_RADIANCE {
            self.clamped.fetch_add(1, Relaxed);
        }
        // The product is exact (a power of two), so the rounding is the only error.
        Some(radiance.to_array().map(|value| nearest(f64::from(value.min(MAX_RADIANCE)) * self.scale())))
    }

    /// Adds all sums and counts of another film of the same size, precision and layers.
    ///
    /// # Panics
    /// If the other film has another size, precision or other layers.
    pub fn add(&self, other: &Self) {
        assert!(self.is_of_kind(other), "films of one kind can be added");
        for (pixel, (sums, more)) in self.sums.iter().zip(&other.sums).enumerate() {
            let _stripe = self.stripes.lock(pixel as u32);
            add(sums, [more[0].load(Relaxed), more[1].load(Relaxed), more[2].load(Relaxed)]);
        }
        for (count, more) in self.samples.iter().zip(&other.samples) {
            count.fetch_add(more.load(Relaxed), Relaxed);
        }
        self.dropped.fetch_add(other.dropped_splats(), Relaxed);
        self.clamped.fetch_add(other.clamped_splats(), Relaxed);
        self.add_layers(other);
    }

    fn is_of_kind(&self, other: &Self) -> bool {
        let size = |film: &Self| (film.width, film.height, film.fraction_bits);
        size(self) == size(other) && self.plan() == other.plan()
    }

    /// A pixel's mean luminance (Rec. 709) and its number of samples. The mean is 0 without samples.
    pub fn luminance(&self, pixel: usize) -> (f64, u32) {
        let samples = self.samples[pixel].load(Relaxed);
        let [r, g, b] = self.sums[pixel].each_ref().map(|sum| sum.load(Relaxed) as f64);
        let unit = 1.0 / ((1u64 << self.fraction_bits) as f64 * f64::from(samples.max(1)));
        ((0.2126 * r + 0.7152 * g + 0.0722 * b) * unit, samples)
    }

    /// Writes all sums and counts as little-endian integers, then those of the layers.
    ///
    /// # Errors
    /// When the writer fails.
    pub fn save(&self, to: &mut impl Write) -> std::io::Result<()> {
        to.write_all(&self.fraction_bits.to_le_bytes())?;
        to.write_all(&self.dropped_splats().to_le_bytes())?;
        to.write_all(&self.clamped_splats().to_le_bytes())?;
        for sum in self.sums.as_flattened() {
            to.write_all(&sum.load(Relaxed).to_le_bytes())?;
        }
        for count in &self.samples {
            to.write_all(&count.load(Relaxed).to_le_bytes())?;
        }
        self.save_layers(to)
    }

    /// Reads what [`Film::save`] wrote for a film of the same size, precision and layers. `None` if the precision
    /// differs or bytes are missing.
    pub fn restored(&self, from: &mut &[u8]) -> Option<Self> {
        let film = self.blank();
        if u32::from_le_bytes(*take(from)?) != self.fraction_bits {
            return None;
        }
        film.dropped.store(u64::from_le_bytes(*take(from)?), Relaxed);
        film.clamped.store(u64::from_le_bytes(*take(from)?), Relaxed);
        for sum in film.sums.as_flattened() {
            sum.store(i64::from_le_bytes(*take(from)?), Relaxed);
        }
        for count in &film.samples {
            count.store(u32::from_le_bytes(*take(from)?), Relaxed);
        }
        film.restore_layers(from)?;
        Some(film)
    }

    /// Number of splats dropped so far, because they were negative or not finite.
    pub fn dropped_splats(&self) -> u64 {
        self.dropped.load(Relaxed)
    }

    /// Number of splats so far with a channel that was clamped to [`MAX_RADIANCE`].
    pub fn clamped_splats(&self) -> u64 {
        self.clamped.load(Relaxed)
    }

    /// Number of samples of each pixel so far, row major, first row on top.
    pub fn sample_counts(&self) -> Vec<u32> {
        self.samples.iter().map(|n| n.load(Relaxed)).collect()
    }

    /// Number of samples of all pixels together.
    pub fn samples(&self) -> u64 {
        self.samples.iter().map(|n| u64::from(n.load(Relaxed))).sum()
    }

    /// Mean number of samples of a pixel.
    pub fn mean_samples(&self) -> f64 {
        self.samples.iter().map(|n| f64::from(n.load(Relaxed))).sum::<f64>() / self.samples.len() as f64
    }

    /// The mean radiance of each pixel over its own samples, row major, first row on top. 0 for pixels without
    /// samples. Camera rays count as samples when they are emitted, so the film of a job that still runs is too dark by
    /// what is in flight.
    pub fn resolve(&self) -> Vec<[f32; 3]> {
        self.resolve_some(0..self.sums.len())
    }

    /// [`Film::resolve`] for some of the pixels.
    pub(super) fn resolve_some(&self, pixels: Range<usize>) -> Vec<[f32; 3]> {
        pixels.map(|pixel| self.mean_of(pixel)).collect()
    }

    /// [`Film::resolve`] for one pixel.
    #[inline]
    pub(super) fn mean_of(&self, pixel: usize) -> [f32; 3] {
        let unit = 1.0 / (1u64 << self.fraction_bits) as f64;
        let sums = &self.sums[pixel];
        match self.samples[pixel].load(Relaxed) {
            0 => [0.0; 3],
            n => {
                // No `map`, which is no inlined loop.
                let mean = |sum: &AtomicI64| (sum.load(Relaxed) as f64 * unit / f64::from(n)) as f32;
                [mean(&sums[0]), mean(&sums[1]), mean(&sums[2])]
            }
        }
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        let (sums, samples) = (std::mem::take(&mut self.sums), std::mem::take(&mut self.samples));
        self.spare.keep(Memory { sums, samples, layers: self.layers.take() });
    }
}

/// Adds to sums whose stripe is locked. No other thread writes them, so a load and a store suffice, which are several
/// times cheaper than an atomic addition.
#[inline]
fn add(sums: &[AtomicI64; 3], fixed: [i64; 3]) {
    for (channel, sum) in sums.iter().enumerate() {
        sum.store(sum.load(Relaxed).wrapping_add(fixed[channel]), Relaxed);
    }
}

/// The next `N` bytes, if there are so many.
pub(crate) fn take<'a, const N: usize>(from: &mut &'a [u8]) -> Option<&'a [u8; N]> {
    let (bytes, rest) = from.split_first_chunk()?;
    *from = rest;
    Some(bytes)
}

#[cfg(test)]
mod tests;

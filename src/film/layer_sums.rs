//! Sums of the layers that a film holds besides radiance, as its plan says.

use super::accumulation::{Counts, Film, Sums, take};
use super::coverage_counts::CoverageCounts;
use super::layer_plan::LayerPlan;
use super::stripe::Stripe;
use crate::lanes::{for_pairs, from_index};
use crate::memory::OutOfMemory;
use std::io::Write;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering::Relaxed};

/// The layers of a film. Sums and counts of other kinds than the plan's are empty.
#[derive(Debug)]
pub(super) struct LayerSums {
    pub plan: Arc<LayerPlan>,
    /// The sums of each pixel, one for each entry of [`LayerPlan::sums`].
    sums: Vec<AtomicI64>,
    hits: Counts,
    /// Radiance and number of the samples that [`Film::HALF`] marks.
    pub half: Sums,
    pub half_samples: Counts,
    centres: Vec<Centre>,
    coverage: Vec<CoverageCounts>,
}

/// The hit of the ray through a pixel's centre.
#[derive(Debug)]
struct Centre {
    /// 0 if the ray has not been traced, 1 if it missed; else the triangle plus 2.
    primitive: AtomicU32,
    /// Bits of the distance.
    t: AtomicU32,
    material: AtomicU32,
}

/// Layers of neighbouring pixels.
struct PixelLayers<'a> {
    sums: &'a [AtomicI64],
    half: &'a [AtomicI64],
    hits: &'a [AtomicU32],
    half_samples: &'a [AtomicU32],
    centres: &'a [Centre],
}

/// Hit of the ray through a pixel's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CentreHit {
    /// The triangle.
    pub primitive: u32,
    /// Distance along the ray.
    pub t: f32,
    /// The material, with mixes resolved.
    pub material: u32,
}

const MISSED: u32 = 1;
const FIRST: u32 = 2;

impl LayerSums {
    pub fn new(plan: Arc<LayerPlan>, pixels: usize) -> Result<Self, OutOfMemory> {
        let refused = |()| OutOfMemory::Refused {
            what: format!("layers of a film of {pixels} pixels"),
            needed: plan.bytes(pixels as u64),
        };
        let counts =
            |wanted: bool| bytemuck::try_zeroed_vec(if wanted { pixels } else { 0 }).map_err(refused);
        let centre = || Centre { primitive: 0.into(), t: 0.into(), material: 0.into() };
        Ok(Self {
            sums: bytemuck::try_zeroed_vec(plan.sums.len() * pixels).map_err(refused)?,
            hits: counts(plan.hits)?,
            half: bytemuck::try_zeroed_vec(if plan.halves { pixels } else { 0 }).map_err(refused)?,
            half_samples: counts(plan.halves)?,
            centres: std::iter::repeat_with(centre).take(if plan.centres { pixels } else { 0 }).collect(),
            coverage: plan.coverage.iter().map(|_| CoverageCounts::new(pixels)).collect(),
            plan,
        })
    }

    pub fn clear(&mut self) {
        let Self { plan: _, sums, hits, half, half_samples, centres, coverage } = self;
        sums.iter_mut().chain(half.as_flattened_mut()).for_each(|sum| *sum.get_mut() = 0);
        hits.iter_mut().chain(half_samples).for_each(|count| *count.get_mut() = 0);
        centres.iter_mut().for_each(|centre| *centre.primitive.get_mut() = 0);
        coverage.iter_mut().for_each(CoverageCounts::clear);
    }

    fn add(&self, other: &Self) {
        for (sum, more) in self.sums.iter().zip(&other.sums) {
            sum.fetch_add(more.load(Relaxed), Relaxed);
        }
        for (sum, more) in self.half.as_flattened().iter().zip(other.half.as_flattened()) {
            sum.fetch_add(more.load(Relaxed), Relaxed);
        }
        for (count, more) in self.counts().zip(other.counts()) {
            count.fetch_add(more.load(Relaxed), Relaxed);
        }
        for (centre, more) in self.centres.iter().zip(&other.centres) {
            if more.primitive.load(Relaxed) > 0 {
                centre.words().zip(more.words()).for_each(|(to, from)| to.store(from.load(Relaxed), Relaxed));
            }
        }
        for (counts, more) in self.coverage.iter().zip(&other.coverage) {
            counts.add(more);
        }
    }

    fn counts(&self) -> impl Iterator<Item = &AtomicU32> {
        self.hits.iter().chain(&self.half_samples)
    }

    fn save(&self, to: &mut impl Write) -> std::io::Result<()> {
        for sum in self.sums.iter().chain(self.half.as_flattened()) {
            to.write_all(&sum.load(Relaxed).to_le_bytes())?;
        }
        for count in self.counts().chain(self.centres.iter().flat_map(Centre::words)) {
            to.write_all(&count.load(Relaxed).to_le_bytes())?;
        }
        self.coverage.iter().try_for_each(|counts| counts.save(to))
    }

    /// Bytes that [`LayerSums::save_pixels`] writes for a pixel.
    pub fn pixel_bytes(&self) -> usize {
        let LayerPlan { hits, halves, centres, .. } = *self.plan;
        let counts = usize::from(hits) + usize::from(halves) + if centres { 3 } else { 0 };
        size_of::<i64>() * (self.plan.sums.len() + if halves { 3 } else { 0 }) + size_of::<u32>() * counts
    }

    /// The sums, counts and centres of neighbouring pixels; those that the plan lacks are empty.
    fn of_pixels(&self, run: &Range<usize>) -> PixelLayers<'_> {
        let each = self.plan.sums.len();
        let held = |wanted: bool| if wanted { run.clone() } else { 0..0 };
        PixelLayers {
            sums: &self.sums[run.start * each..run.end * each],
            half: self.half[held(self.plan.halves)].as_flattened(),
            hits: &self.hits[held(self.plan.hits)],
            half_samples: &self.half_samples[held(self.plan.halves)],
            centres: &self.centres[held(self.plan.centres)],
        }
    }

    /// Writes sums, counts and centres of neighbouring pixels.
    pub fn save_pixels(&self, run: &Range<usize>, to: &mut impl Write) -> std::io::Result<()> {
        let PixelLayers { sums, half, hits, half_samples, centres } = self.of_pixels(run);
        for sum in sums.iter().chain(half) {
            to.write_all(&sum.load(Relaxed).to_le_bytes())?;
        }
        for count in hits.iter().chain(half_samples).chain(centres.iter().flat_map(Centre::words)) {
            to.write_all(&count.load(Relaxed).to_le_bytes())?;
        }
        Ok(())
    }

    /// Adds what [`LayerSums::save_pixels`] wrote for the same pixels.
    pub fn add_pixels(&self, run: &Range<usize>, from: &mut &[u8]) -> Option<()> {
        let PixelLayers { sums, half, hits, half_samples, centres } = self.of_pixels(run);
        for sum in sums.iter().chain(half) {
            sum.fetch_add(i64::from_le_bytes(*take(from)?), Relaxed);
        }
        for count in hits.iter().chain(half_samples) {
            count.fetch_add(u32::from_le_bytes(*take(from)?), Relaxed);
        }
        for centre in centres {
            let mut words = [0; 3];
            for word in &mut words {
                *word = u32::from_le_bytes(*take(from)?);
            }
            if words[0] > 0 {
                centre.words().zip(words).for_each(|(to, word)| to.store(word, Relaxed));
            }
        }
        Some(())
    }

    /// The counts of each entry of [`LayerPlan::coverage`].
    pub fn coverage(&self) -> &[CoverageCounts] {
        &self.coverage
    }

    fn restore(&self, from: &mut &[u8]) -> Option<()> {
        for sum in self.sums.iter().chain(self.half.as_flattened()) {
            sum.store(i64::from_le_bytes(*take(from)?), Relaxed);
        }
        for count in self.counts().chain(self.centres.iter().flat_map(Centre::words)) {
            count.store(u32::from_le_bytes(*take(from)?), Relaxed);
        }
        self.coverage.iter().try_for_each(|counts| counts.restore(from))
    }
}

impl Centre {
    fn words(&self) -> impl Iterator<Item = &AtomicU32> {
        [&self.primitive, &self.t, &self.material].into_iter()
    }
}

/// Layers.
impl Film {
    /// Set in the number of a pixel, this bit says that a splat belongs to the half of the pixel's samples that has
    /// sums of its own. Only films with [`LayerPlan::halves`] know it.
    pub const HALF: u32 = 1 << 31;

    /// A black film of the same size and precision, with these layers.
    ///
    /// # Errors
    /// If the system does not give the memory.
    pub fn with_layers(&self, plan: LayerPlan) -> Result<Self, OutOfMemory> {
        let mut film = self.black_of_kind()?;
        if !plan.is_empty() {
            film.layers = Some(LayerSums::new(Arc::new(plan), film.pixels())?.into());
        }
        Ok(film)
    }

    /// Layers that the film holds besides radiance, if any.
    #[inline]
    pub fn plan(&self) -> Option<&LayerPlan> {
        self.layers.as_ref().map(|layers| &*layers.plan)
    }

    #[inline]
    fn held(&self) -> &LayerSums {
        self.layers.as_ref().expect("the film has layers")
    }

    /// Adds the numbers of hits to the sums of their pixels, from the entry `first` of [`LayerPlan::sums`] on, and
    /// counts the hits if `counts`. `columns` have one number in fixed point for each of `pixels`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) fn add_hits<const N: usize>(
        &self,
        pixels: &[u32],
        (first, columns): (usize, &[[i64; N]]),
        counts: bool,
    ) {
        let layers = self.held();
        let all = layers.plan.sums.len();
        let mut start = 0;
        while start < pixels.len() {
            let pixel = pixels[start];
            let mut end = start + 1;
            while end < pixels.len() && pixels[end] == pixel {
                end += 1;
            }
            let _stripe: Stripe<'_> = self.lock(pixel);
            let sums = &layers.sums[pixel as usize * all..][..all][first..][..columns.len()];
            // Of a fixed length: in lanes.
            let mask: [i64; N] = from_index(|i| -i64::from((start..end).contains(&i)));
            for_pairs(sums, columns, |sum, column| {
                let mut more = 0;
                for i in 0..N {
                    more += column[i] & mask[i];
                }
                sum.store(sum.load(Relaxed) + more, Relaxed);
            });
            if counts && layers.plan.hits {
                let hits = &layers.hits[pixel as usize];
                hits.store(hits.load(Relaxed) + (end - start) as u32, Relaxed);
            }
            start = end;
        }
    }

    /// Counts hits that show things: `ids` has one for each of `pixels`, or [`u32::MAX`] for nothing. `table` is the
    /// entry of [`LayerPlan::coverage`].
    pub(crate) fn count_ids(&self, table: usize, pixels: &[u32], ids: &[u32]) {
        let counts = &self.held().coverage[table];
        let mut start = 0;
        while start < pixels.len() {
            let mut end = start + 1;
            while end < pixels.len() && (pixels[end], ids[end]) == (pixels[start], ids[start]) {
                end += 1;
            }
            if ids[start] != u32::MAX {
                counts.count(pixels[start], ids[start], (end - start) as u32);
            }
            start = end;
        }
    }

    /// Keeps what the ray through a pixel's centre hit; `None` for a miss.
    pub(crate) fn set_centre(&self, pixel: u32, hit: Option<CentreHit>) {
        let centre = &self.held().centres[pixel as usize];
        let Some(CentreHit { primitive, t, material }) = hit else {
            return centre.primitive.store(MISSED, Relaxed);
        };
        centre.t.store(t.to_bits(), Relaxed);
        centre.material.store(material, Relaxed);
        centre.primitive.store(primitive + FIRST, Relaxed);
    }

    /// Hit of the ray through a pixel's centre; `None` for a miss, and for a ray that has not been traced.
    pub fn centre(&self, pixel: usize) -> Option<CentreHit> {
        let Centre { primitive, t, material } = &self.held().centres[pixel];
        let primitive = primitive.load(Relaxed).checked_sub(FIRST)?;
        let t = f32::from_bits(t.load(Relaxed));
        Some(CentreHit { primitive, t, material: material.load(Relaxed) })
    }

    /// Counts samples of the half that [`Film::HALF`] marks, which [`Film::add_samples`] counts as well.
    #[inline]
    pub(crate) fn add_half_samples(&self, pixel: u32, samples: u32) {
        self.held().half_samples[pixel as usize].fetch_add(samples, Relaxed);
    }

    /// Number of a pixel's samples that hit something. Needs [`LayerPlan::hits`].
    #[inline]
    pub fn hits(&self, pixel: usize) -> u32 {
        self.held().hits[pixel].load(Relaxed)
    }

    /// A sum of a pixel: an entry of [`LayerPlan::sums`].
    pub fn layer_sum(&self, pixel: usize, entry: usize) -> f64 {
        let LayerSums { plan, sums, .. } = self.held();
        let sum = sums[pixel * plan.sums.len() + entry].load(Relaxed);
        sum as f64 * power_of_two(-plan.sums[entry])
    }

    /// Three sums of a pixel from an entry of [`LayerPlan::sums`] on, times numbers that contain the powers of two of
    /// [`Film::layer_scale`].
    #[inline]
    pub(super) fn layer_sums(&self, pixel: usize, entry: usize, scale: [f64; 3]) -> [f32; 3] {
        let LayerSums { plan, sums, .. } = self.held();
        let sums = &sums[pixel * plan.sums.len() + entry..][..3];
        // No `map`, which is no inlined loop.
        let sum = |channel: usize| (sums[channel].load(Relaxed) as f64 * scale[channel]) as f32;
        [sum(0), sum(1), sum(2)]
    }

    /// The factors of three sums from an entry of [`LayerPlan::sums`] on.
    pub(super) fn layer_scale(&self, entry: usize) -> [f64; 3] {
        let bits = &self.held().plan.sums[entry..][..3];
        [power_of_two(-bits[0]), power_of_two(-bits[1]), power_of_two(-bits[2])]
    }

    /// The counts of an entry of [`LayerPlan::coverage`]: the start of each pixel's ids, and ids with their samples.
    pub fn coverage(&self, table: usize) -> (Vec<u32>, Vec<(u32, u32)>) {
        self.held().coverage[table].resolve(self.pixels())
    }

    /// An estimate of the variance of a pixel's mean from the means `a` and `b` of its two halves of `m` and `n`
    /// samples: `(a − b)² m n / (m + n)²`, which is a quarter of the squared difference if the halves are equally
    /// large. Infinite before both have a sample. Needs [`LayerPlan::halves`].
    pub fn variance(&self, pixel: usize) -> [f32; 3] {
        let LayerSums { half, half_samples, .. } = self.held();
        let (half, count) = (&half[pixel], half_samples[pixel].load(Relaxed));
        let (sums, all) = self.sums_of(pixel);
        let (a, b) = (f64::from(count), f64::from(all.saturating_sub(count)));
        if a == 0.0 || b == 0.0 {
            return [f32::INFINITY; 3];
        }
        std::array::from_fn(|channel| {
            let own = half[channel].load(Relaxed);
            let difference = own as f64 / a - (sums[channel] - own) as f64 / b;
            let difference = difference / self.scale();
            (difference * difference * (a * b / ((a + b) * (a + b)))) as f32
        })
    }

    /// The means of a pixel's two halves, 0 for one without samples, and their numbers of samples. Needs
    /// [`LayerPlan::halves`].
    pub(crate) fn half_means(&self, pixel: usize) -> ([[f64; 3]; 2], [u32; 2]) {
        let LayerSums { half, half_samples, .. } = self.held();
        let (sums, all) = self.sums_of(pixel);
        let own = half[pixel].each_ref().map(|sum| sum.load(Relaxed));
        let count = half_samples[pixel].load(Relaxed);
        let rest = all.saturating_sub(count);
        let mean = |sum: i64, count: u32| sum as f64 / (self.scale() * f64::from(count.max(1)));
        let first = std::array::from_fn(|channel| mean(sums[channel] - own[channel], rest));
        ([first, own.map(|sum| mean(sum, count))], [rest, count])
    }

    pub(super) fn add_layers(&self, other: &Self) {
        if let (Some(layers), Some(more)) = (&self.layers, &other.layers) {
            layers.add(more);
        }
    }

    pub(super) fn save_layers(&self, to: &mut impl Write) -> std::io::Result<()> {
        self.layers.as_ref().map_or(Ok(()), |layers| layers.save(to))
    }

    pub(super) fn restore_layers(&self, from: &mut &[u8]) -> Option<()> {
        self.layers.as_ref().map_or(Some(()), |layers| layers.restore(from))
    }
}

/// 2 to an integer power, exactly where `f64` has it.
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    libm::ldexp(1.0, exponent)
}

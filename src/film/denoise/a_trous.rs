//! A filter of noise for frames of a moving picture, which takes milliseconds: an à-trous wavelet transform that stops
//! at edges (Dammertz et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering"),
//! guided by the variance of the light (Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering").
//!
//! What is filtered is the light that surfaces reflect, divided by their colours: textures stay as they are. Each level
//! takes means over 3×3 pixels, whose distance is twice that of the level before. A neighbour counts as far as
//! it lies in the plane of the pixel's surface and has its normal; later levels also ask whether it is as bright within
//! the noise that is left. The noise is that of the nearest pixels before, since a frame of one sample has no halves.
//! Pixels that are far brighter than their neighbours are cut.
//!
//! The filter looks at most [`FILTER_REACH`] pixels away, so rows are the same if others are cut off beyond that.
//!
//! # Same bytes
//! What is computed in lanes, with one pixel in each lane, has a fixed order and no fused operations; everything else
//! is scalar. Each row is computed by one thread from inputs that do not change.

mod brightness;
mod rows;

use super::planes::in_parallel;
use crate::film::{Film, Image, Region};
use crate::lanes::{LaneTask, Lanes, Num, SimdLevel, Vector};
use brightness::{Cut, Measure};
use glam::Vec3;
use rows::Rows;
use std::cell::Cell;

/// Number of levels.
const LEVELS: usize = 4;
/// Pixels that the last level looks at lie this far away.
const MARGIN: usize = 1 << (LEVELS - 1);
/// Radius of the squares over which light and its variance are averaged before.
const NEAR: usize = 3;
/// The farthest pixels on which one depends, in rows or columns.
pub const FILTER_REACH: u32 = (2 * MARGIN - 1 + 2 * NEAR) as u32;

/// The first level that compares light: single samples differ too much.
const COMPARING: usize = 2;
/// Standard deviations by which light may differ.
const DEVIATIONS: f32 = 8.0;
/// Squarings of the cosine between normals.
const SQUARINGS: usize = 4;
/// Distances of neighbours at which one that far from a pixel's plane does not count.
const FROM_PLANE: f32 = 1.0;
/// Added to colours, which are divided by.
const LEAST_COLOUR: f32 = 0.02;
/// A number that keeps quotients finite.
const TINY: f32 = 1e-20;

/// Rows of a band, which one thread computes at a time.
const BAND: usize = 16;

/// Columns of [`GuidedPicture::guides`]: normal, position, and one by the distance of two neighbouring pixels there.
const GUIDES: usize = 7;
/// Columns of signals: light, its luminance, the variance of that.
const SIGNALS: usize = 5;
const LUMINANCE: usize = 3;
const VARIANCE: usize = 4;
/// Columns of [`GuidedPicture::surfaces`]: colour, which light is multiplied by, and what is added then.
const SURFACES: usize = 6;

thread_local! {
    /// The last picture, whose memory one of the same size uses: the system takes milliseconds for so much.
    static LAST: Cell<Option<GuidedPicture>> = const { Cell::new(None) };
}

/// The vectors whose numbers begin a slice, for pixels in lanes.
#[cfg_attr(not(unoptimised), inline(always))]
fn vector<L: Lanes>(l: L, from: &[f32], stride: usize) -> Vector<L> {
    let [x, y, z] = [&from[..stride], &from[stride..2 * stride], &from[2 * stride..]];
    Vector::new(Num::load(l, x), Num::load(l, y), Num::load(l, z))
}

/// A picture of few samples, and what its camera rays hit.
#[derive(Debug)]
pub struct GuidedPicture {
    width: usize,
    height: usize,
    guides: Rows,
    surfaces: Rows,
    signal: Rows,
    /// What is computed from the signal, which it then becomes.
    next: Rows,
}

/// A camera, as far as the filter knows it.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    /// The place of the camera.
    pub eye: Vec3,
    /// Distance of neighbouring pixels at the eye, and its increase with the distance from it.
    pub cone: [f32; 2],
}

/// The first of a film's sums that has a guide.
#[derive(Clone, Copy, Debug)]
pub struct GuideSums {
    /// Three sums of shading normals.
    pub normal: usize,
    /// Three sums of positions.
    pub position: usize,
    /// Three sums of colours.
    pub colour: usize,
    /// Three sums of emitted radiance.
    pub emission: usize,
}

/// A pixel as its film has it.
struct Guided {
    normal: Vec3,
    position: Vec3,
    colour: Vec3,
    emission: Vec3,
}

impl GuidedPicture {
    fn new(width: usize, height: usize) -> Self {
        let rows = |columns| Rows::new(columns, width, height);
        Self {
            width,
            height,
            guides: rows(GUIDES),
            surfaces: rows(SURFACES),
            signal: rows(SIGNALS),
            next: rows(SIGNALS),
        }
    }

    /// A region of a film with guides.
    ///
    /// # Panics
    /// If the film does not have these sums and counts of hits.
    pub fn of(film: &Film, region: Region, sums: GuideSums, viewpoint: Viewpoint, threads: usize) -> Self {
        let (width, height) = (region.width as usize, region.height as usize);
        let of_size = |last: &Self| (last.width, last.height) == (width, height);
        let mut own = LAST.take().filter(of_size).unwrap_or_else(|| Self::new(width, height));
        let stride = own.guides.stride;
        let scales =
            [sums.normal, sums.position, sums.colour, sums.emission].map(|first| film.layer_scale(first));
        let bands = own.guides.bands(height).zip(own.signal.bands(height)).zip(own.surfaces.bands(height));
        in_parallel(threads, bands.enumerate().collect(), |(band, ((guides, signal), surfaces))| {
            let signals = signal.chunks_exact_mut(SIGNALS * stride);
            let rows = guides.chunks_exact_mut(GUIDES * stride).zip(signals);
            let rows = rows.zip(surfaces.chunks_exact_mut(SURFACES * stride)).enumerate();
            for (row, ((guides, signal), surface)) in rows {
                let y = region.y as usize + band * BAND + row;
                for x in 0..width {
                    let pixel = y * film.width() as usize + region.x as usize + x;
                    let [guide, light, own] = viewpoint.columns(film, pixel, sums, &scales);
                    write(guides, stride, x, &guide);
                    write(signal, stride, x, &light[..=LUMINANCE]);
                    write(surface, stride, x, &own[..SURFACES]);
                }
                // Other lanes of the last pixels, which the last picture has written.
                for column in signal.chunks_exact_mut(stride) {
                    column[MARGIN + width..].fill(0.0);
                }
            }
        });
        own
    }

    /// The picture with less noise, computed by `threads` threads. Neither they nor the SIMD level change a bit of it.
    pub fn filtered(mut self, simd: SimdLevel, threads: usize) -> Image {
        let (width, height) = (self.width, self.height);
        let (guides, from) = (&self.guides, &self.signal);
        in_parallel(threads, self.next.bands(height).enumerate().collect(), |(band, to)| {
            simd.run(Cut { guides, from, to, width, height, band });
        });
        let from = &self.next;
        in_parallel(threads, self.signal.bands(height).enumerate().collect(), |(band, to)| {
            simd.run(Measure { from, to, width, height, band });
        });
        for level in 0..LEVELS {
            let (guides, from) = (&self.guides, &self.signal);
            in_parallel(threads, self.next.bands(height).enumerate().collect(), |(band, to)| {
                simd.run(Level { guides, from, to, width, top: MARGIN + band * BAND, level });
            });
            std::mem::swap(&mut self.signal, &mut self.next);
        }
        let mut pixels = vec![[0.0; 3]; width * height];
        in_parallel(threads, pixels.chunks_mut(BAND * width).enumerate().collect(), |(band, pixels)| {
            for (row, pixels) in pixels.chunks_exact_mut(width).enumerate() {
                let row = MARGIN + band * BAND + row;
                for channel in 0..3 {
                    let light = self.signal.row(row, channel)[MARGIN..].iter();
                    let colours = self.surfaces.row(row, channel)[MARGIN..].iter();
                    let added = self.surfaces.row(row, 3 + channel)[MARGIN..].iter();
                    for (((pixel, light), colour), added) in
                        pixels.iter_mut().zip(light).zip(colours).zip(added)
                    {
                        pixel[channel] = light * colour + added;
                    }
                }
            }
        });
        LAST.set(Some(self));
        Image::new(width as u32, height as u32, pixels)
    }
}

impl Viewpoint {
    /// The columns of a pixel: guides, signal, surface. All are zeros where nothing is hit, but for what is added.
    #[inline]
    fn columns(
        &self,
        film: &Film,
        pixel: usize,
        sums: GuideSums,
        scales: &[[f64; 3]; 4],
    ) -> [[f32; GUIDES]; 3] {
        let radiance = Vec3::from_array(film.mean_of(pixel));
        let Some(Guided { normal: n, position: p, colour, emission: e }) = guided(film, pixel, sums, scales)
        else {
            return [[0.0; GUIDES], [0.0; GUIDES], [0.0, 0.0, 0.0, radiance.x, radiance.y, radiance.z, 0.0]];
        };
        let c = colour + LEAST_COLOUR;
        let light = (radiance - e).max(Vec3::ZERO) / c;
        let width_there = self.cone[0] + self.cone[1] * p.distance(self.eye);
        let by_width = 1.0 / (width_there + TINY);
        [
            [n.x, n.y, n.z, p.x, p.y, p.z, by_width],
            [light.x, light.y, light.z, luminance(light), 0.0, 0.0, 0.0],
            [c.x, c.y, c.z, e.x, e.y, e.z, 0.0],
        ]
    }
}

/// Writes the columns of a pixel of a row.
#[inline(always)]
fn write(row: &mut [f32], stride: usize, x: usize, columns: &[f32]) {
    for (column, &number) in columns.iter().enumerate() {
        row[column * stride + MARGIN + x] = number;
    }
}

/// A pixel by its film's sums; `None` if nothing is hit, or nothing that has a normal.
#[inline]
fn guided(film: &Film, pixel: usize, sums: GuideSums, scales: &[[f64; 3]; 4]) -> Option<Guided> {
    let hits = film.hits(pixel);
    if hits == 0 {
        return None;
    }
    let mean = |first: usize, [a, b, c]: [f64; 3], share: f64| {
        Vec3::from_array(film.layer_sums(pixel, first, [a * share, b * share, c * share]))
    };
    let of_hits = 1.0 / f64::from(hits);
    let normal = mean(sums.normal, scales[0], of_hits);
    let length = normal.length();
    let of_samples = 1.0 / f64::from(film.samples_of(pixel).max(1));
    (length > 0.25).then(|| Guided {
        normal: normal / length,
        position: mean(sums.position, scales[1], of_hits),
        colour: mean(sums.colour, scales[2], of_samples),
        emission: mean(sums.emission, scales[3], of_samples),
    })
}

#[inline]
fn luminance(light: Vec3) -> f32 {
    light.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// A band of rows of a level.
struct Level<'a> {
    guides: &'a Rows,
    from: &'a Rows,
    /// The rows that are computed.
    to: &'a mut [f32],
    width: usize,
    /// The first of these rows, which counts from the margin.
    top: usize,
    level: usize,
}

impl LaneTask for Level<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { guides, from, to, width, top, level } = self;
        let stride = from.stride;
        let step = 1 << level;
        for (row, to) in to.chunks_exact_mut(SIGNALS * stride).enumerate() {
            let y = top + row;
            let near = [y - step, y, y + step];
            let near = Near {
                guides: near.map(|y| guides.whole(y)),
                from: near.map(|y| from.whole(y)),
                stride,
                level,
            };
            for x in (0..width).step_by(L::LANES) {
                let at = MARGIN + x;
                let signal = near.mean(l, at);
                for column in 0..SIGNALS {
                    signal[column].store(&mut to[column * stride + at..]);
                }
            }
        }
    }
}

/// A row and the rows of its neighbours above and below.
struct Near<'a> {
    guides: [&'a [f32]; 3],
    from: [&'a [f32]; 3],
    stride: usize,
    level: usize,
}

impl Near<'_> {
    /// The mean of each pixel in lanes and those of its neighbours that are like it: a signal's columns.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mean<L: Lanes>(&self, l: L, at: usize) -> [Num<L>; SIGNALS] {
        let &Self { guides, from, stride, level } = self;
        // Distance of neighbours in pixels.
        let step = 1 << level;
        let normal = vector(l, &guides[1][at..], stride);
        let position = vector(l, &guides[1][3 * stride + at..], stride);
        let by_width = Num::load(l, &guides[1][(GUIDES - 1) * stride + at..]) * (FROM_PLANE / step as f32);
        let own = vector(l, &from[1][at..], stride);
        let luminance = Num::load(l, &from[1][LUMINANCE * stride + at..]);
        let own_variance = Num::load(l, &from[1][VARIANCE * stride + at..]);
        let by_deviation = 1.0 / (own_variance.sqrt() * DEVIATIONS + TINY);
        let (mut light, mut variance, mut weights) = (own, own_variance, Num::splat(l, 1.0));
        for down in 0..3 {
            let (guides, from) = (guides[down], from[down]);
            for right in 0..3 {
                if (down, right) == (1, 1) {
                    continue;
                }
                let place = at + right * step - step;
                let share = if down == 1 || right == 1 { 0.5 } else { 0.25 };
                let mut like = normal.dot(vector(l, &guides[place..], stride)).max(Num::zero(l));
                for _ in 0..SQUARINGS {
                    like = like * like;
                }
                let apart =
                    normal.dot(vector(l, &guides[3 * stride + place..], stride) - position) * by_width;
                let near = (1.0 - apart * apart).max(Num::zero(l));
                let mut weight = like * (near * near) * share;
                if level >= COMPARING {
                    let brightness = Num::load(l, &from[LUMINANCE * stride + place..]);
                    let bright = (1.0 - (brightness - luminance).abs() * by_deviation).max(Num::zero(l));
                    weight *= bright * bright;
                }
                light += vector(l, &from[place..], stride) * weight;
                variance += Num::load(l, &from[VARIANCE * stride + place..]) * (weight * weight);
                weights += weight;
            }
        }
        let by_weights = 1.0 / weights;
        let light = light * by_weights;
        let luminance = light.x * 0.2126 + light.y * 0.7152 + light.z * 0.0722;
        [light.x, light.y, light.z, luminance, variance * (by_weights * by_weights)]
    }
}

#[cfg(test)]
mod tests;

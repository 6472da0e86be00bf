//! The light around a pixel: what is far brighter is cut, and the variance of the rest is the pixel's noise.

use super::rows::Rows;
use super::{BAND, GUIDES, LUMINANCE, MARGIN, NEAR, SIGNALS, TINY, VARIANCE, vector};
use crate::lanes::{LaneTask, Lanes, Num};

/// Light that is this many times brighter than the mean around it is cut.
const BRIGHTEST: f32 = 6.0;
/// Share of the mean light around a pixel by which light may differ, even without noise.
const LEAST_DIFFERENCE: f32 = 0.02;

/// Pixels along a side of the squares.
const SIDE: usize = 2 * NEAR + 1;

/// Cuts a band's light. The variance becomes the share of the pixels around that hit something.
pub(super) struct Cut<'a> {
    pub guides: &'a Rows,
    pub from: &'a Rows,
    /// The rows that are computed.
    pub to: &'a mut [f32],
    pub width: usize,
    pub height: usize,
    pub band: usize,
}

impl LaneTask for Cut<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { guides, from, to, width, height, band } = self;
        let stride = from.stride;
        let picture = Area { width, height, first: band * BAND, rows: to.len() / (SIGNALS * stride) };
        let there = Across::new(&picture, |y| guides.row(y, GUIDES - 1), |inverse| f32::from(inverse > 0.0));
        let light = Across::new(&picture, |y| from.row(y, LUMINANCE), |luminance| luminance);
        let (mut of_there, mut of_light) = (vec![0.0; stride], vec![0.0; stride]);
        for (row, to) in to.chunks_exact_mut(SIGNALS * stride).enumerate() {
            let y = picture.first + row;
            let own = from.whole(MARGIN + y);
            there.means(&picture, y, &mut of_there);
            light.means(&picture, y, &mut of_light);
            for x in (0..width).step_by(L::LANES) {
                let (at, there) = (MARGIN + x, Num::load(l, &of_there[x..]));
                let most = Num::load(l, &of_light[x..]) * BRIGHTEST / (there + TINY);
                let luminance = Num::load(l, &own[LUMINANCE * stride + at..]);
                let share = Num::select(luminance.gt(most), most / luminance, Num::splat(l, 1.0));
                let light = vector(l, &own[at..], stride) * share;
                let columns = [light.x, light.y, light.z, luminance * share, there];
                for (column, number) in columns.into_iter().enumerate() {
                    number.store(&mut to[column * stride + at..]);
                }
            }
        }
    }
}

/// Measures the variance of a band's light, which has been cut.
pub(super) struct Measure<'a> {
    pub from: &'a Rows,
    /// The rows that are computed.
    pub to: &'a mut [f32],
    pub width: usize,
    pub height: usize,
    pub band: usize,
}

impl LaneTask for Measure<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        let Self { from, to, width, height, band } = self;
        let stride = from.stride;
        let picture = Area { width, height, first: band * BAND, rows: to.len() / (SIGNALS * stride) };
        let light = Across::new(&picture, |y| from.row(y, LUMINANCE), |luminance| luminance);
        let squares = Across::new(&picture, |y| from.row(y, LUMINANCE), |luminance| luminance * luminance);
        let (mut of_light, mut of_squares) = (vec![0.0; stride], vec![0.0; stride]);
        for (row, to) in to.chunks_exact_mut(SIGNALS * stride).enumerate() {
            let y = picture.first + row;
            let own = from.whole(MARGIN + y);
            for column in 0..=LUMINANCE {
                to[column * stride..][..stride].copy_from_slice(&own[column * stride..][..stride]);
            }
            light.means(&picture, y, &mut of_light);
            squares.means(&picture, y, &mut of_squares);
            for x in (0..width).step_by(L::LANES) {
                let at = VARIANCE * stride + MARGIN + x;
                let by_there = 1.0 / (Num::load(l, &own[at..]) + TINY);
                let mean = Num::load(l, &of_light[x..]) * by_there;
                let square = Num::load(l, &of_squares[x..]) * by_there;
                let least = mean * (LEAST_DIFFERENCE * LEAST_DIFFERENCE) * mean;
                (square - mean * mean).max(least).store(&mut to[at..]);
            }
        }
    }
}

/// Rows of a picture that one thread computes.
struct Area {
    width: usize,
    height: usize,
    /// The first row.
    first: usize,
    rows: usize,
}

/// For each pixel in the reach of an area the sum of [`SIDE`] numbers of its row, itself in the middle. At the border
/// the nearest pixels repeat.
struct Across {
    /// The first row.
    first: usize,
    width: usize,
    sums: Vec<f32>,
}

impl Across {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn new<'a>(area: &Area, row: impl Fn(usize) -> &'a [f32], number: impl Fn(f32) -> f32) -> Self {
        let &Area { width, height, first, rows } = area;
        let (first, last) = (first.saturating_sub(NEAR), height.min(first + rows + NEAR));
        let (mut line, mut sums) = (vec![0.0; width + 2 * NEAR], vec![0.0; (last - first) * width]);
        for (y, sums) in (first..last).zip(sums.chunks_exact_mut(width)) {
            let row = &row(MARGIN + y)[MARGIN..][..width];
            for (to, &from) in line[NEAR..].iter_mut().zip(row) {
                *to = number(from);
            }
            let [left, right] = [line[NEAR], line[NEAR + width - 1]];
            line[..NEAR].fill(left);
            line[NEAR + width..].fill(right);
            let mut shifted = [&line[..]; SIDE];
            for (start, shifted) in shifted.iter_mut().enumerate() {
                *shifted = &line[start..];
            }
            sum(shifted, sums);
        }
        Self { first, width, sums }
    }

    /// The means over the squares around the pixels of a row.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn means(&self, area: &Area, y: usize, to: &mut [f32]) {
        let to = &mut to[..self.width];
        let mut near = [&self.sums[..]; SIDE];
        for (row, near) in (y..).zip(&mut near) {
            let row = row.saturating_sub(NEAR).min(area.height - 1) - self.first;
            *near = &self.sums[row * self.width..];
        }
        sum(near, to);
        to.iter_mut().for_each(|sum| *sum *= 1.0 / (SIDE * SIDE) as f32);
    }
}

/// The sums of numbers at the same places, in their order. A loop that becomes instructions for several.
#[cfg_attr(not(unoptimised), inline(always))]
fn sum(mut from: [&[f32]; SIDE], to: &mut [f32]) {
    for from in &mut from {
        *from = &from[..to.len()];
    }
    for (i, to) in to.iter_mut().enumerate() {
        let mut sum = 0.0;
        for from in from {
            sum += from[i];
        }
        *to = sum;
    }
}

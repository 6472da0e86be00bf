//! Weighted regression of each window's colours on its features, in lanes.

use super::planes::{Plane, all_blurred, greatest, in_parallel};
use super::{FEATURES, NoisyPicture, STRENGTHS, WIDE};
use crate::lanes::exponential::exp2;
use crate::lanes::{LaneTask, Lanes, MAX_LANES, Num, SimdLevel};
use std::f32::consts::LOG2_E;

/// Windows reach this many pixels from their middle.
const RADIUS: usize = 7;
/// Patches that are compared reach this many pixels from their middle.
const PATCH: usize = 3;
/// Radius of the squares over which variances, which have one degree of freedom, are averaged.
const VARIANCE_RADIUS: usize = 2;
/// Share of a pixel's own variance that counts if it is more than the average: a bright dot is not told from its
/// neighbours by a difference that its own halves contradict.
const OWN_VARIANCE: f32 = 0.5;
/// The most that a pixel's variance is, by the average of its nearest neighbours: what is dark and clean beside
/// something bright and noisy is not taken for it.
const NEAR_VARIANCE: f32 = 2.0;
/// Pixels around the picture that repeat its border.
const MARGIN: usize = RADIUS + PATCH;
/// Width of a tile; lanes of any number fill it.
const TILE_WIDTH: usize = 64;
/// Height of a tile.
const TILE_HEIGHT: usize = 16;
/// Rows of a patch's columns that a tile needs.
const TALL: usize = TILE_HEIGHT + 2 * PATCH;
/// Numbers in a row of differences: those of the tile, of patches that reach beyond it, of lanes beyond them.
const ROW: usize = TILE_WIDTH + 2 * MAX_LANES;

/// Factor of the distances of patches in the exponent of the weights of the wide filter. The narrow one has the eighth
/// power of its weights.
const STEEPNESS: f32 = 2.0;
/// Weights below count as 0.
const LEAST_WEIGHT: f32 = 1e-4;
/// Share of the sum of all weights that is added to the variance of each feature.
const RIDGE: f32 = 1e-3;
/// Squared relative difference of two pixels that counts as none, whatever their variance.
const LEAST_DIFFERENCE: f32 = 1e-6;
/// A number that keeps quotients finite.
const TINY: f32 = 1e-30;

/// Terms of the regression: features and a constant, which is the last.
const TERMS: usize = FEATURES + 1;
/// Sums of products of two terms.
const PRODUCTS: usize = TERMS * (TERMS + 1) / 2;
/// All sums of a pixel: products of terms, and of terms and channels.
const SUMS: usize = PRODUCTS + 3 * TERMS;

/// The filtered pictures and estimates of their errors.
pub(super) struct Estimates {
    /// The filtered picture for each strength.
    pub means: Vec<[Plane; 3]>,
    /// Squared differences of filtered halves to the other halves: for each strength the error of the filtered picture
    /// and twice the variance of a half.
    pub errors: Vec<Plane>,
    /// Squared differences of the picture to the one that is filtered most.
    pub residuals: Plane,
    /// Estimated variances of the picture's pixels.
    pub variances: Plane,
}

/// A plane with margins.
struct Padded {
    stride: usize,
    numbers: Vec<f32>,
}

impl Padded {
    /// A plane with the numbers of its border around it.
    fn new(plane: &[f32], width: usize, height: usize) -> Self {
        let stride = width.next_multiple_of(TILE_WIDTH) + 2 * MARGIN + 2 * MAX_LANES;
        let rows = height.next_multiple_of(TILE_HEIGHT) + 2 * MARGIN;
        let inner = |i: usize, size: usize| i.saturating_sub(MARGIN).min(size - 1);
        let number = |i: usize| plane[inner(i / stride, height) * width + inner(i % stride, width)];
        Self { stride, numbers: (0..stride * rows).map(number).collect() }
    }

    /// 1 in the picture, 0 around it.
    fn inside(width: usize, height: usize) -> Self {
        let Self { stride, mut numbers } = Self::new(&vec![1.0; width * height], width, height);
        for (i, number) in numbers.iter_mut().enumerate() {
            let (x, y) = (i % stride, i / stride);
            let is_inside = (MARGIN..MARGIN + width).contains(&x) && (MARGIN..MARGIN + height).contains(&y);
            *number = if is_inside { 1.0 } else { 0.0 };
        }
        Self { stride, numbers }
    }

    /// The number of a pixel whose coordinates count from the corner of the margin, and those after it.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn load<L: Lanes>(&self, l: L, x: usize, y: usize) -> Num<L> {
        Num::load(l, &self.numbers[y * self.stride + x..])
    }
}

/// Everything that windows read.
struct Inputs {
    halves: [[Padded; 3]; 2],
    variances: [[Padded; 3]; 2],
    features: [Padded; FEATURES],
    inside: Padded,
}

impl Inputs {
    fn new(noisy: &NoisyPicture, threads: usize) -> Self {
        let (width, height) = (noisy.width, noisy.height);
        let padded = |plane: &Plane| Padded::new(plane, width, height);
        let variances: Vec<&[f32]> = noisy.variances.iter().flatten().map(Vec::as_slice).collect();
        let mut smooth = all_blurred(threads, &variances, width, VARIANCE_RADIUS);
        let near = all_blurred(threads, &variances, width, 1);
        for ((smooth, near), own) in smooth.iter_mut().zip(near).zip(variances) {
            for ((smooth, near), own) in smooth.iter_mut().zip(near).zip(own) {
                *smooth = smooth.min(NEAR_VARIANCE * near).max(OWN_VARIANCE * own);
            }
        }
        Self {
            halves: noisy.halves.each_ref().map(|half| half.each_ref().map(padded)),
            variances: [0, 1].map(|half| std::array::from_fn(|channel| padded(&smooth[3 * half + channel]))),
            features: noisy.features.each_ref().map(padded),
            inside: Padded::inside(width, height),
        }
    }
}

/// Filters both halves with all strengths.
pub(super) fn estimates(noisy: &NoisyPicture, simd: SimdLevel, threads: usize) -> Estimates {
    let (width, pixels) = (noisy.width, noisy.width * noisy.height);
    let inputs = Inputs::new(noisy, threads);
    let plane = || vec![0.0; pixels];
    let mut all = Estimates {
        means: (0..STRENGTHS).map(|_| [plane(), plane(), plane()]).collect(),
        errors: (0..STRENGTHS).map(|_| plane()).collect(),
        residuals: plane(),
        variances: plane(),
    };
    let brightness = noisy.mean.each_ref().map(|plane| {
        let mean = plane.iter().map(|&value| f64::from(value)).sum::<f64>() / pixels as f64;
        (0.01 * mean * mean) as f32
    });
    let most = noisy.mean.each_ref().map(|plane| greatest(plane, width));
    let bands = bands(&mut all, width);
    in_parallel(threads, bands, |band| {
        let mut memory = Memory::new();
        let Band { top, mut rows } = band;
        for left in (0..width).step_by(TILE_WIDTH) {
            simd.run(Tile { inputs: &inputs, left, top, memory: &mut memory });
            keep(noisy, &memory, (brightness, &most), (left, top), &mut rows);
        }
    });
    all
}

/// Rows of the results that one thread writes.
struct Band<'a> {
    top: usize,
    rows: Rows<'a>,
}

/// Rows of [`Estimates`].
struct Rows<'a> {
    means: Vec<Vec<&'a mut [f32]>>,
    errors: Vec<&'a mut [f32]>,
    residuals: &'a mut [f32],
    variances: &'a mut [f32],
}

fn bands(all: &mut Estimates, width: usize) -> Vec<Band<'_>> {
    let size = TILE_HEIGHT * width;
    let Estimates { means, errors, residuals, variances } = all;
    let mut bands: Vec<Band<'_>> = residuals
        .chunks_mut(size)
        .zip(variances.chunks_mut(size))
        .enumerate()
        .map(|(i, (residuals, variances))| Band {
            top: i * TILE_HEIGHT,
            rows: Rows { means: Vec::new(), errors: Vec::new(), residuals, variances },
        })
        .collect();
    for mean in means {
        bands.iter_mut().for_each(|band| band.rows.means.push(Vec::new()));
        for channel in mean {
            for (band, rows) in bands.iter_mut().zip(channel.chunks_mut(size)) {
                band.rows.means.last_mut().expect("just added").push(rows);
            }
        }
    }
    for error in errors {
        for (band, rows) in bands.iter_mut().zip(error.chunks_mut(size)) {
            band.rows.errors.push(rows);
        }
    }
    bands
}

/// Writes a tile's results, from both filtered halves.
#[allow(clippy::needless_range_loop, reason = "a channel is read from several arrays")]
fn keep(
    noisy: &NoisyPicture,
    memory: &Memory,
    (brightness, most): ([f32; 3], &[Plane; 3]),
    (left, top): (usize, usize),
    rows: &mut Rows<'_>,
) {
    let width = noisy.width;
    for y in top..(top + TILE_HEIGHT).min(noisy.height) {
        for x in left..(left + TILE_WIDTH).min(width) {
            let (pixel, to) = (y * width + x, (y - top) * width + x);
            // No brighter than the brightest of the nearest pixels: regression may overshoot.
            let at = |half: usize, strength: usize, channel: usize| {
                let value = memory.filtered[half][strength][channel][(y - top) * TILE_WIDTH + x - left];
                value.min(most[channel][pixel])
            };
            for channel in 0..3 {
                let mean = |strength: usize| 0.5 * (at(0, strength, channel) + at(1, strength, channel));
                let darkest = (0..STRENGTHS).map(mean).fold(f32::INFINITY, f32::min).max(0.0);
                let scale = 1.0 / (darkest * darkest + brightness[channel] + TINY);
                let [a, b] = [0, 1].map(|half| noisy.halves[half][channel][pixel]);
                for strength in 0..STRENGTHS {
                    let (of_a, of_b) = (at(0, strength, channel), at(1, strength, channel));
                    let (to_b, to_a, apart) = (of_a - b, of_b - a, of_a - of_b);
                    let error = 0.5 * (to_b * to_b + to_a * to_a) - 0.25 * apart * apart;
                    rows.means[strength][channel][to] = mean(strength);
                    rows.errors[strength][to] += error * scale;
                }
                let residual = noisy.mean[channel][pixel] - mean(WIDE);
                rows.residuals[to] += residual * residual * scale;
                let [of_a, of_b] = [0, 1].map(|half| noisy.variances[half][channel][pixel]);
                rows.variances[to] += 0.25 * (of_a + of_b) * scale;
            }
        }
    }
}

/// Memory of a thread.
struct Memory {
    /// Squared differences of pixels, relative to their variances, and their sums along rows.
    differences: Vec<f32>,
    along: Vec<f32>,
    /// The sums of each group of pixels, for each strength.
    sums: Vec<f32>,
    /// The filtered halves of a tile, for each strength and channel.
    filtered: [[[Plane; 3]; STRENGTHS]; 2],
}

impl Memory {
    fn new() -> Self {
        let plane = || vec![0.0; TILE_WIDTH * TILE_HEIGHT];
        let planes = || std::array::from_fn(|_| std::array::from_fn(|_| plane()));
        Self {
            differences: vec![0.0; TALL * ROW],
            along: vec![0.0; TALL * ROW],
            sums: vec![0.0; TILE_WIDTH * TILE_HEIGHT * STRENGTHS * SUMS],
            filtered: [planes(), planes()],
        }
    }
}

/// A tile to be filtered.
struct Tile<'a> {
    inputs: &'a Inputs,
    left: usize,
    top: usize,
    memory: &'a mut Memory,
}

impl LaneTask for Tile<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(mut self, l: L) {
        for half in 0..2 {
            self.memory.sums.fill(0.0);
            for down in 0..=2 * RADIUS {
                for right in 0..=2 * RADIUS {
                    self.compare(l, 1 - half, right, down);
                    self.add_neighbours(l, half, right, down);
                }
            }
            self.solve(l, half);
        }
    }
}

impl Tile<'_> {
    /// Compares pixels of half `guide` with those that lie `right` and `down` less [`RADIUS`] away.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn compare<L: Lanes>(&mut self, l: L, guide: usize, right: usize, down: usize) {
        let Inputs { halves, variances, .. } = self.inputs;
        for row in 0..TALL {
            let y = self.top + row;
            let (own, other) = (y + RADIUS, y + down);
            for column in (0..TILE_WIDTH + 2 * PATCH).step_by(L::LANES) {
                let x = self.left + column;
                let mut sum = Num::zero(l);
                for channel in 0..3 {
                    let (values, variances) = (&halves[guide][channel], &variances[guide][channel]);
                    let (a, b) = (values.load(l, x + RADIUS, own), values.load(l, x + right, other));
                    let (of_a, of_b) =
                        (variances.load(l, x + RADIUS, own), variances.load(l, x + right, other));
                    let apart = (a - b) * (a - b) - (of_a + of_a.min(of_b));
                    let least = (a * a + b * b) * LEAST_DIFFERENCE + TINY;
                    sum += apart / (of_a + of_b + least);
                }
                sum.store(&mut self.memory.differences[row * ROW + column..]);
            }
            for column in (0..TILE_WIDTH).step_by(L::LANES) {
                let differences = &self.memory.differences[row * ROW + column..];
                let mut sum = Num::load(l, differences);
                for i in 1..=2 * PATCH {
                    sum += Num::load(l, &differences[i..]);
                }
                sum.store(&mut self.memory.along[row * ROW + column..]);
            }
        }
    }

    /// Adds the pixels of `half` that lie `right` and `down` less [`RADIUS`] away to the sums of the tile's pixels.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add_neighbours<L: Lanes>(&mut self, l: L, half: usize, right: usize, down: usize) {
        const SIDE: usize = 2 * PATCH + 1;
        let Inputs { halves, features, inside, .. } = self.inputs;
        let mut group = 0;
        for row in 0..TILE_HEIGHT {
            let (own, other) = (self.top + row + MARGIN, self.top + row + down + PATCH);
            for column in (0..TILE_WIDTH).step_by(L::LANES) {
                let (x, far) = (self.left + column + MARGIN, self.left + column + right + PATCH);
                let sums = &mut self.memory.sums[group * STRENGTHS * SUMS * L::LANES..];
                group += 1;
                let mut distance = Num::load(l, &self.memory.along[row * ROW + column..]);
                for i in 1..SIDE {
                    distance += Num::load(l, &self.memory.along[(row + i) * ROW + column..]);
                }
                let distance = distance.max(Num::zero(l)) * (-STEEPNESS * LOG2_E / (3 * SIDE * SIDE) as f32);
                let weight = likely(exp2(distance)) * inside.load(l, far, other);
                if !weight.above(0.0).any() {
                    continue;
                }
                let mut terms = [Num::splat(l, 1.0); TERMS];
                for (term, feature) in terms.iter_mut().zip(features) {
                    *term = feature.load(l, far, other) - feature.load(l, x, own);
                }
                let mut colour = [Num::zero(l); 3];
                for channel in 0..3 {
                    colour[channel] = halves[half][channel].load(l, far, other);
                }
                let squared = weight * weight;
                let fourth = squared * squared;
                let narrow = likely(fourth * fourth);
                add_terms(l, &mut sums[..SUMS * L::LANES], weight, &terms, &colour);
                if narrow.above(0.0).any() {
                    add_terms(l, &mut sums[SUMS * L::LANES..], narrow, &terms, &colour);
                }
            }
        }
    }

    /// Regresses the colours of each window on its features.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn solve<L: Lanes>(&mut self, l: L, half: usize) {
        for group in 0..TILE_WIDTH * TILE_HEIGHT / L::LANES {
            for strength in 0..STRENGTHS {
                let sums = &self.memory.sums[(group * STRENGTHS + strength) * SUMS * L::LANES..];
                let found = constant(l, &sums[..SUMS * L::LANES]);
                let filtered = &mut self.memory.filtered[half][strength];
                for channel in 0..3 {
                    found[channel].store(&mut filtered[channel][group * L::LANES..]);
                }
            }
        }
    }
}

/// Weights, and 0 for those that do not count.
#[cfg_attr(not(unoptimised), inline(always))]
fn likely<L: Lanes>(weight: Num<L>) -> Num<L> {
    weight.only(weight.above(LEAST_WEIGHT))
}

/// Adds weighted products of terms, and of terms and colours.
#[cfg_attr(not(unoptimised), inline(always))]
fn add_terms<L: Lanes>(
    l: L,
    sums: &mut [f32],
    weight: Num<L>,
    terms: &[Num<L>; TERMS],
    colour: &[Num<L>; 3],
) {
    let mut sums = sums.chunks_exact_mut(L::LANES);
    for i in 0..TERMS {
        let weighted = weight * terms[i];
        for term in &terms[..=i] {
            add(l, sums.next(), weighted * *term);
        }
        for channel in colour {
            add(l, sums.next(), weighted * *channel);
        }
    }
}

#[cfg_attr(not(unoptimised), inline(always))]
fn add<L: Lanes>(l: L, sum: Option<&mut [f32]>, more: Num<L>) {
    let sum = sum.expect("room for all sums");
    (Num::load(l, sum) + more).store(sum);
}

/// The constants of the regressions: the colours at the windows' middles. The matrix of products is factored by
/// Cholesky's method; the constant is its last term, so it needs no substitution backwards.
#[allow(clippy::needless_range_loop, reason = "a matrix is read by rows and columns")]
#[cfg_attr(not(unoptimised), inline(always))]
fn constant<L: Lanes>(l: L, sums: &[f32]) -> [Num<L>; 3] {
    let mut lower = [[Num::zero(l); TERMS]; TERMS];
    let mut right = [[Num::zero(l); 3]; TERMS];
    let mut at = 0;
    for i in 0..TERMS {
        for column in 0..=i {
            lower[i][column] = Num::load(l, &sums[at..]);
            at += L::LANES;
        }
        for channel in 0..3 {
            right[i][channel] = Num::load(l, &sums[at..]);
            at += L::LANES;
        }
    }
    let least = lower[FEATURES][FEATURES] * RIDGE;
    let mut inverse = [Num::zero(l); TERMS];
    for i in 0..TERMS {
        for column in 0..i {
            let mut value = lower[i][column];
            for k in 0..column {
                value -= lower[i][k] * lower[column][k];
            }
            lower[i][column] = value * inverse[column];
        }
        let mut diagonal = lower[i][i];
        if i < FEATURES {
            diagonal += least;
        }
        for k in 0..i {
            diagonal -= lower[i][k] * lower[i][k];
        }
        inverse[i] = 1.0 / diagonal.max(least * 1e-3).sqrt();
        for channel in 0..3 {
            let mut value = right[i][channel];
            for k in 0..i {
                value -= lower[i][k] * right[k][channel];
            }
            right[i][channel] = value * inverse[i];
        }
    }
    let mut found = right[FEATURES];
    for value in &mut found {
        *value *= inverse[FEATURES];
    }
    found
}

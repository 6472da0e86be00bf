//! One channel of a picture, and separable filters on it.

use rayon::prelude::*;

/// One channel, row major.
#[derive(Clone, Debug)]
pub struct Plane {
    width: usize,
    values: Vec<f64>,
}

impl Plane {
    /// A plane of these values.
    pub fn new(width: usize, values: Vec<f64>) -> Self {
        Self { width, values }
    }

    /// The values.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Products of the values of two planes.
    pub fn times(&self, other: &Self) -> Self {
        Self {
            width: self.width,
            values: self.values.iter().zip(&other.values).map(|(a, b)| a * b).collect(),
        }
    }

    /// Filtered by the product of two filters of odd lengths; the middle of a filter lies on the pixel. Outside the
    /// picture are the values of its border.
    pub fn filtered(&self, across: &[f64], down: &[f64]) -> Self {
        let Self { width, values } = self;
        let height = values.len() / width;
        let mut rows = vec![0.0; values.len()];
        rows.par_chunks_mut(*width).zip(values.par_chunks(*width)).for_each(|(to, from)| {
            for (x, to) in to.iter_mut().enumerate() {
                *to = sum(across, |i| from[clamped(x, i, across.len(), *width)]);
            }
        });
        let mut filtered = vec![0.0; values.len()];
        filtered.par_chunks_mut(*width).enumerate().for_each(|(y, to)| {
            for (i, factor) in down.iter().enumerate() {
                let from = &rows[clamped(y, i, down.len(), height) * width..][..*width];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
            }
        });
        Self { width: *width, values: filtered }
    }
}

fn sum(filter: &[f64], value: impl Fn(usize) -> f64) -> f64 {
    filter.iter().enumerate().map(|(i, factor)| factor * value(i)).sum()
}

/// The index below `bound` of tap `i` of a filter whose middle is at `place`.
fn clamped(place: usize, i: usize, taps: usize, bound: usize) -> usize {
    (place + i).saturating_sub(taps / 2).min(bound - 1)
}

/// A Gaussian with this standard deviation out to `radius`, its sum 1.
pub fn gaussian(radius: i32, deviation: f64) -> Vec<f64> {
    let weights = (-radius..=radius).map(|x| libm::exp(-0.5 * f64::from(x * x) / (deviation * deviation)));
    let weights: Vec<f64> = weights.collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}

//! What the denoiser is given, from a film's exact sums.

use super::FEATURES;
use super::planes::Plane;
use crate::film::{Film, Image, Region};

/// A picture with noise, and what a denoiser knows of it: the halves of its samples, and features.
#[derive(Clone, Debug)]
pub struct NoisyPicture {
    pub(super) width: usize,
    pub(super) height: usize,
    /// The mean of all samples.
    pub(super) mean: [Plane; 3],
    /// The means of the two halves of the samples.
    pub(super) halves: [[Plane; 3]; 2],
    /// Estimates of the variances of these means, with one degree of freedom each.
    pub(super) variances: [[Plane; 3]; 2],
    pub(super) features: [Plane; FEATURES],
}

impl NoisyPicture {
    /// A region of a film that has halves, and whose last sums are features.
    ///
    /// # Panics
    /// If the film has no halves, or fewer sums than there are features.
    pub fn of(film: &Film, region: Region) -> Self {
        let image = Image::of(film, region);
        let (width, height) = (region.width as usize, region.height as usize);
        let columns = region.columns();
        let pixels = region.rows().flat_map(|y| {
            let row = y as usize * film.width() as usize;
            columns.clone().map(move |x| row + x as usize)
        });
        let plane = || vec![0.0; width * height];
        let planes = || [plane(), plane(), plane()];
        let mut picture = Self {
            width,
            height,
            mean: planes(),
            halves: [planes(), planes()],
            variances: [planes(), planes()],
            features: std::array::from_fn(|_| plane()),
        };
        let sums = film.plan().map_or(0, |plan| plan.sums.len());
        let first = sums.checked_sub(FEATURES).expect("the film has features");
        for (i, pixel) in pixels.enumerate() {
            let samples = f64::from(film.samples_of(pixel).max(1));
            for (feature, plane) in picture.features.iter_mut().enumerate() {
                plane[i] = (film.layer_sum(pixel, first + feature) / samples) as f32;
            }
            let ([a, b], [in_a, in_b]) = film.half_means(pixel);
            for channel in 0..3 {
                let mean = image.pixels[i][channel];
                picture.mean[channel][i] = mean;
                if in_a == 0 || in_b == 0 {
                    // One half alone tells nothing about noise.
                    picture.halves.iter_mut().for_each(|half| half[channel][i] = mean);
                    continue;
                }
                let (a, b) = (a[channel], b[channel]);
                let squared = (a - b) * (a - b) / f64::from(in_a + in_b);
                let of = |value: f64, others: u32| (value as f32, (squared * f64::from(others)) as f32);
                for (half, (value, variance)) in [of(a, in_b), of(b, in_a)].into_iter().enumerate() {
                    picture.halves[half][channel][i] = value;
                    picture.variances[half][channel][i] = variance;
                }
            }
        }
        picture
    }
}

//! The choice of the filter's strength for each pixel, by estimates of the errors.

use super::planes::all_blurred;
use super::regression::Estimates;
use super::{NoisyPicture, STRENGTHS};
use crate::film::Image;

/// Radius of the squares over which estimates of errors are averaged.
const ERROR_RADIUS: usize = 4;

/// Radius of the squares over which choices are averaged, so that no seams show where they change.
const CHOICE_RADIUS: usize = 3;

/// Radius of the squares over which the noise of halves is compared to that of all samples.
const STRATIFICATION_RADIUS: usize = 20;

/// The least share of the variance that halves tell. Samples that are stratified together vary less than halves of them
/// do.
const LEAST_SHARE: f32 = 0.1;

/// Mixes the estimates of each pixel by the shares of its neighbours for which each is best. The picture as it is takes
/// part.
pub(super) fn select(noisy: &NoisyPicture, estimates: Estimates, threads: usize) -> Image {
    let (width, pixels) = (noisy.width, noisy.width * noisy.height);
    let Estimates { means, errors, residuals, variances } = estimates;
    let near: Vec<&[f32]> = errors.iter().chain([&variances]).map(Vec::as_slice).collect();
    let near = all_blurred(threads, &near, width, ERROR_RADIUS);
    let far = all_blurred(threads, &[&residuals, &variances], width, STRATIFICATION_RADIUS);
    let mut choices = vec![vec![0.0f32; pixels]; STRENGTHS + 1];
    for i in 0..pixels {
        // Halves that are stratified against each other differ by more than the mean of both tells.
        let share = if far[1][i] > 0.0 { (far[0][i] / far[1][i]).clamp(LEAST_SHARE, 1.0) } else { 1.0 };
        let variance = near[STRENGTHS][i];
        let (mut best, mut least) = (STRENGTHS, share * variance);
        for (strength, error) in near[..STRENGTHS].iter().enumerate() {
            let error = error[i] - (1.0 + share) * variance;
            if error < least {
                (best, least) = (strength, error);
            }
        }
        choices[best][i] = 1.0;
    }
    let choices: Vec<&[f32]> = choices.iter().map(Vec::as_slice).collect();
    let shares = all_blurred(threads, &choices, width, CHOICE_RADIUS);
    let mixed = |i: usize, channel: usize| {
        let own = noisy.mean[channel][i];
        let mut sum = own;
        // A picture that is best as it is keeps its bits.
        for (share, mean) in shares.iter().zip(&means) {
            sum += share[i] * (mean[channel][i] - own);
        }
        sum.max(0.0)
    };
    let pixels = (0..pixels).map(|i| std::array::from_fn(|channel| mixed(i, channel))).collect();
    Image::new(noisy.width as u32, noisy.height as u32, pixels)
}

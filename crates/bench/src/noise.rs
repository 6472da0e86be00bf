//! `raystream bench noise`: the error of pictures of a given number of samples, their time, and the product of both.

use super::Spread;
use super::frame::FrameError;
use super::pictures::Pictures;
use raystream::render::{PathTracer, ROULETTE_BOUNCES, Settings};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Share of the pixels, those with the largest errors, that robust errors leave out.
const OUTLIERS: f64 = 0.001;

/// Share of the squared mean of the reference that is added to each squared value that errors are relative to.
const DARK: f64 = 0.01;

/// Results of one way of ending paths.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `russian roulette`, or `depth alone`.
    pub configuration: &'static str,
    /// Host threads.
    pub threads: usize,
    /// Samples per pixel.
    pub spp: u32,
    /// Millions of camera rays per second.
    pub mpath_per_s: Spread,
    /// Seconds of the picture.
    pub seconds: Spread,
    /// Relative squared error: the mean of (a − b)² / (b² + 0.01·mean(b)²) over pixels and channels, where b is the
    /// reference.
    pub error: Spread,
    /// The same without the worst 0.1 % of the pixels.
    pub robust_error: Spread,
    /// Mean error × mean seconds: half as much is the same error in half the time.
    pub error_seconds: f64,
    /// Mean robust error × mean seconds.
    pub robust_error_seconds: f64,
    /// `robust_error_seconds` of the last row divided by that of this row: more than 1 is better.
    pub ratio: f64,
}

/// Relative squared errors of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Errors {
    mean: f64,
    robust: f64,
}

/// Measures paths that end by Russian roulette and paths that end by depth alone, in interleaved rounds.
///
/// # Errors
/// When a picture cannot be rendered.
pub fn run(pictures: &Pictures<'_>) -> Result<Vec<Row>, FrameError> {
    let (_, reference) = render(pictures, pictures.reference()?)?;
    let ways = [("russian roulette", Some(ROULETTE_BOUNCES)), ("depth alone", None)];
    let mut measured = [Vec::new(), Vec::new()];
    for round in 0..=pictures.rounds {
        for ((_, roulette), measured) in ways.iter().zip(&mut measured) {
            // The first round, which is the second's picture, warms caches and allocates streams.
            let path = pictures.of_round(round.saturating_sub(1), *roulette)?;
            let (seconds, picture) = render(pictures, path)?;
            if round > 0 {
                measured.push((seconds, Errors::of(&picture, &reference)));
            }
        }
    }
    let row = |((name, _), measured): (&(&'static str, _), &Vec<_>)| row(pictures, name, measured);
    let mut rows: Vec<_> = ways.iter().zip(&measured).map(row).collect();
    let last = rows[rows.len() - 1].robust_error_seconds;
    rows.iter_mut().for_each(|row| row.ratio = last / row.robust_error_seconds);
    Ok(rows)
}

/// Renders a picture; returns its seconds and its pixels.
fn render(pictures: &Pictures<'_>, path: PathTracer) -> Result<(f64, Vec<[f32; 3]>), FrameError> {
    let path = Arc::new(path);
    let started = Instant::now();
    let job = pictures.submit(&path)?;
    job.wait().map_err(|error| FrameError::Job { configuration: "a picture", error })?;
    Ok((started.elapsed().as_secs_f64(), path.film().resolve()))
}

fn row(pictures: &Pictures<'_>, configuration: &'static str, measured: &[(f64, Errors)]) -> Row {
    let Settings { width, height, spp, .. } = pictures.settings;
    let paths = f64::from(width) * f64::from(height) * f64::from(spp);
    let values = |of: fn(&(f64, Errors)) -> f64| measured.iter().map(of).collect::<Vec<f64>>();
    let mean = |of| values(of).iter().sum::<f64>() / measured.len() as f64;
    let seconds = mean(|(seconds, _)| *seconds);
    Row {
        configuration,
        threads: pictures.service.host_threads(),
        spp,
        mpath_per_s: Spread::of_rates(values(|(s, _)| *s).iter().map(|s| paths / (s * 1e6)).collect()),
        seconds: Spread::of_times(values(|(seconds, _)| *seconds)),
        error: Spread::of_times(values(|(_, errors)| errors.mean)),
        robust_error: Spread::of_times(values(|(_, errors)| errors.robust)),
        error_seconds: mean(|(_, errors)| errors.mean) * seconds,
        robust_error_seconds: mean(|(_, errors)| errors.robust) * seconds,
        ratio: 1.0,
    }
}

impl Errors {
    /// The errors of a picture with at least one pixel.
    fn of(picture: &[[f32; 3]], reference: &[[f32; 3]]) -> Self {
        let channels = reference.as_flattened();
        let mean = channels.iter().map(|&x| f64::from(x)).sum::<f64>() / channels.len() as f64;
        let pixel = |(a, b): (&[f32; 3], &[f32; 3])| {
            let squares = a.iter().zip(b).map(|(&a, &b)| {
                let (a, b) = (f64::from(a), f64::from(b));
                let scale = b * b + DARK * mean * mean;
                if a == b { 0.0 } else { (a - b) * (a - b) / scale }
            });
            squares.sum::<f64>() / 3.0
        };
        let mut errors: Vec<f64> = picture.iter().zip(reference).map(pixel).collect();
        errors.sort_by(f64::total_cmp);
        let kept = errors.len() - ((errors.len() as f64 * OUTLIERS).ceil() as usize).min(errors.len() - 1);
        let mean_of = |errors: &[f64]| errors.iter().sum::<f64>() / errors.len() as f64;
        Self { mean: mean_of(&errors), robust: mean_of(&errors[..kept]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_and_the_robust_one_leaves_out_the_worst() {
        let reference = vec![[2.0; 3]; 2000];
        let mut picture = reference.clone();
        assert_eq!(Errors::of(&picture, &reference), Errors { mean: 0.0, robust: 0.0 });
        // Two pixels of 2000 are a thousandth.
        picture[7] = [100.0; 3];
        picture[9] = [50.0; 3];
        let errors = Errors::of(&picture, &reference);
        let expected = (98.0f64.powi(2) + 48.0f64.powi(2)) / (4.0 + 0.04) / 2000.0;
        assert!((errors.mean / expected - 1.0).abs() < 1e-12 && errors.robust == 0.0, "{errors:?}");
        picture[11] = [2.2; 3];
        let robust = Errors::of(&picture, &reference).robust;
        assert!((robust / (0.04 / 4.04 / 1998.0) - 1.0).abs() < 1e-5, "{robust}");
        // A black picture of a black scene has no error, and a single pixel is never left out.
        let black = [[0.0; 3]];
        assert_eq!(Errors::of(&black, &black), Errors { mean: 0.0, robust: 0.0 });
    }
}

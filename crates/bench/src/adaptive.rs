//! `raystream bench adaptive`: even and adaptive samples, taken for the same time, compared with a reference picture
//! of very many samples.

use super::Spread;
use super::frame::FrameError;
use super::pictures::Pictures;
use raystream::film::Film;
use raystream::render::{Blocks, PassOptions, PathTracer, Progressive, ROULETTE_BOUNCES};
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Passes into which even samples are divided: a frame can end only between two passes.
const EVEN_PASSES: u32 = 32;

/// Results of one way of placing samples.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `adaptive`, or `even`: even samples for as long as the adaptive ones took.
    pub configuration: &'static str,
    /// The target: a relative standard error.
    pub noise: f32,
    /// Host threads.
    pub threads: usize,
    /// Seconds of the picture.
    pub seconds: Spread,
    /// Samples per pixel.
    pub mean_spp: Spread,
    /// Root mean square difference to the reference, over all pixels and channels.
    pub rmse: Spread,
    /// Root mean square relative difference; the reference counts as at least a tenth of its mean over the picture.
    pub relative_rmse: Spread,
    /// The root mean square relative error of the worst block of 16 × 16 pixels.
    pub worst_block: Spread,
    /// Efficiency relative to even samples: more than 1 is better.
    pub efficiency: Efficiency,
}

/// Squared error × time of even samples, divided by that of the row. The product is what stays the same while samples
/// are added, because squared errors fall in proportion to time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Efficiency {
    /// By [`Row::rmse`].
    pub absolute: f64,
    /// By [`Row::relative_rmse`].
    pub relative: f64,
    /// By [`Row::worst_block`].
    pub worst_block: f64,
}

/// Squared errors of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Errors {
    absolute: f64,
    relative: f64,
    worst_block: f64,
}

/// Measurements of one way of placing samples, one a round.
#[derive(Clone, Default)]
struct Measured {
    seconds: Vec<f64>,
    mean_spp: Vec<f64>,
    errors: Vec<Errors>,
}

/// Measures each target, a relative standard error at which adaptive pictures end, in interleaved rounds of adaptive
/// and even pictures. The pictures' samples are the most that a pixel gets.
///
/// # Errors
/// When a picture cannot be rendered.
pub fn run(pictures: &Pictures<'_>, targets: &[f32]) -> Result<Vec<Row>, FrameError> {
    let (_, truth) = render(pictures, pictures.reference()?, PassOptions::default(), None)?;
    let mut rows = Vec::new();
    for &noise in targets {
        let [mut adaptive, mut even] = [Measured::default(), Measured::default()];
        for round in 0..pictures.rounds {
            let path = || pictures.of_round(round, Some(ROULETTE_BOUNCES));
            let options = PassOptions::default().with_noise(noise);
            let (seconds, film) = render(pictures, path()?, options, None)?;
            adaptive.add(seconds, &film, &truth);
            let time = Duration::from_secs_f64(seconds);
            let options = PassOptions::default().with_pass_time(time / EVEN_PASSES);
            let (seconds, film) = render(pictures, path()?, options, Some(time))?;
            even.add(seconds, &film, &truth);
        }
        let reference = even.clone();
        let threads = pictures.service.host_threads();
        for (name, measured) in [("adaptive", adaptive), ("even", even)] {
            rows.push(measured.row(name, noise, threads, &reference));
        }
    }
    Ok(rows)
}

/// Renders a picture to its end, or until its time is over; returns its seconds and its film.
fn render(
    pictures: &Pictures<'_>,
    path: PathTracer,
    options: PassOptions,
    time: Option<Duration>,
) -> Result<(f64, Arc<Film>), FrameError> {
    let mut frame = Progressive::new(path, options);
    let started = Instant::now();
    loop {
        frame.begin(|pass| pictures.submit(pass))?;
        if time.is_some_and(|time| started.elapsed() >= time) {
            frame.stop();
        }
        if !frame.wait_for(Duration::from_millis(1)) {
            continue;
        }
        let pass = frame.finish_pass();
        if pass.map_err(|error| FrameError::Job { configuration: "a pass", error })?.is_none() {
            return Ok((started.elapsed().as_secs_f64(), frame.picture()));
        }
    }
}

impl Measured {
    fn add(&mut self, seconds: f64, film: &Film, truth: &Film) {
        self.seconds.push(seconds);
        self.mean_spp.push(film.mean_samples());
        let blocks = Blocks::new(film.width(), film.height());
        self.errors.push(Errors::of(&film.resolve(), &truth.resolve(), blocks));
    }

    fn row(&self, configuration: &'static str, noise: f32, threads: usize, even: &Self) -> Row {
        let spread = |error: fn(&Errors) -> f64| {
            Spread::of_times(self.errors.iter().map(|errors| error(errors).sqrt()).collect())
        };
        let efficiency = |error: fn(&Errors) -> f64| even.cost(error) / self.cost(error);
        Row {
            configuration,
            noise,
            threads,
            seconds: Spread::of_times(self.seconds.clone()),
            mean_spp: Spread::of_times(self.mean_spp.clone()),
            rmse: spread(|e| e.absolute),
            relative_rmse: spread(|e| e.relative),
            worst_block: spread(|e| e.worst_block),
            efficiency: Efficiency {
                absolute: efficiency(|e| e.absolute),
                relative: efficiency(|e| e.relative),
                worst_block: efficiency(|e| e.worst_block),
            },
        }
    }

    /// Squared error × time, over all rounds.
    fn cost(&self, error: fn(&Errors) -> f64) -> f64 {
        self.errors.iter().map(error).sum::<f64>() * self.seconds.iter().sum::<f64>()
    }
}

impl Errors {
    fn of(picture: &[[f32; 3]], truth: &[[f32; 3]], blocks: Blocks) -> Self {
        let mean = truth.as_flattened().iter().map(|&x| f64::from(x)).sum::<f64>() / (3 * truth.len()) as f64;
        let (mut absolute, mut relative, mut worst_block) = (0.0, 0.0, 0.0_f64);
        for block in 0..blocks.count() as u32 {
            let (mut in_block, mut channels) = (0.0, 0.0);
            for pixel in blocks.indices(block) {
                for (x, truth) in picture[pixel].iter().zip(truth[pixel]) {
                    let (square, truth) = (f64::from(x - truth).powi(2), f64::from(truth));
                    absolute += square;
                    in_block += square / truth.max(0.1 * mean).powi(2);
                    channels += 1.0;
                }
            }
            relative += in_block;
            worst_block = worst_block.max(in_block / channels);
        }
        let channels = (3 * truth.len()) as f64;
        Self { absolute: absolute / channels, relative: relative / channels, worst_block }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_to_what_is_there() {
        let blocks = Blocks::new(32, 16);
        let truth = vec![[2.0; 3]; 32 * 16];
        let mut picture = truth.clone();
        assert_eq!(Errors::of(&picture, &truth, blocks).absolute, 0.0);
        // One of two blocks is off by a tenth.
        blocks.indices(1).for_each(|pixel| picture[pixel] = [2.2; 3]);
        let errors = Errors::of(&picture, &truth, blocks);
        assert!(
            (errors.absolute - 0.02).abs() < 1e-6 && (errors.relative - 0.005).abs() < 1e-6,
            "{errors:?}"
        );
        assert!((errors.worst_block - 0.01).abs() < 1e-6, "{errors:?}");
    }
}

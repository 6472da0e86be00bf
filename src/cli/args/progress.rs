//! When a picture is finished, and what is saved meanwhile.

use crate::render::Settings;
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

/// Samples per pixel if no option says how many.
const DEFAULT_SPP: u32 = 64;

/// Maximum samples per pixel with `--seconds` or `--noise`, if `--spp` does not say.
const OPEN_ENDED_SPP: u32 = 1 << 16;

/// When a picture is finished, and what is saved meanwhile.
#[derive(Debug, Args)]
pub struct ProgressArgs {
    /// Samples per pixel; with --seconds or --noise the maximum [default: 64; 65536 with --seconds or --noise].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(Settings::MAX_SPP)))]
    pub spp: Option<u32>,
    /// Stop after this much rendering time.
    #[arg(long, value_name = "SECONDS", value_parser = duration, allow_hyphen_values = true)]
    pub seconds: Option<Duration>,
    /// Sample adaptively until the relative standard error of the pixels, root mean square over the picture, is X
    /// (0.05, say).
    #[arg(long, value_name = "X", value_parser = noise)]
    pub noise: Option<f32>,
    /// Write the unfinished picture and the checkpoint at this interval [default: 10 with --checkpoint].
    #[arg(long, value_name = "SECONDS", value_parser = duration, allow_hyphen_values = true)]
    pub save_every: Option<Duration>,
    /// Save what has been rendered, so that --resume can continue after this process ended in any way. For an
    /// animation: save which frames are finished.
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Continue from the checkpoint if it exists.
    #[arg(long, requires = "checkpoint")]
    pub resume: bool,
}

impl ProgressArgs {
    /// Maximum number of samples per pixel.
    pub fn samples(&self) -> u32 {
        self.spp.unwrap_or(if self.may_end_early() { OPEN_ENDED_SPP } else { DEFAULT_SPP })
    }

    /// Whether the picture may be finished before all samples are taken.
    pub fn may_end_early(&self) -> bool {
        self.seconds.is_some() || self.noise.is_some()
    }

    /// Interval at which pictures and checkpoints are written while rendering, if they are.
    pub fn interval(&self) -> Option<Duration> {
        self.save_every.or(self.checkpoint.as_ref().map(|_| Duration::from_secs(10)))
    }
}

/// A positive number of seconds.
pub(super) fn duration(text: &str) -> Result<Duration, String> {
    let seconds = text.trim().parse::<f64>().map_err(|e| format!("{text:?}: {e}"))?;
    let duration = Duration::try_from_secs_f64(seconds).map_err(|_| "write a positive number of seconds")?;
    if duration.is_zero() { Err("write a positive number of seconds".into()) } else { Ok(duration) }
}

/// A relative error.
pub(super) fn noise(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(x) if x > 0.0 && x <= 1.0 => Ok(x),
        _ => Err("write a relative error between 0 and 1, as in 0.05 for 5 %".into()),
    }
}

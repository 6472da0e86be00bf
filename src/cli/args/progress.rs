//! When a picture is done, and what is kept meanwhile.

use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

/// When a picture is done, and what is kept meanwhile.
#[derive(Debug, Args)]
pub struct ProgressArgs {
    /// Samples per pixel, at most with --seconds or --noise [default: 64; 65536 with --seconds or --noise].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: Option<u32>,
    /// End after so much time of rendering.
    #[arg(long, value_name = "SECONDS", value_parser = duration, allow_hyphen_values = true)]
    pub seconds: Option<Duration>,
    /// Take samples where they are needed, until the relative standard error of pixels is X, as 0.05: root mean square
    /// over the picture.
    #[arg(long, value_name = "X", value_parser = noise)]
    pub noise: Option<f32>,
    /// Write the picture so far (and the checkpoint) every so often [default: 10 with --checkpoint].
    #[arg(long, value_name = "SECONDS", value_parser = duration, allow_hyphen_values = true)]
    pub save_every: Option<Duration>,
    /// Keep what has been rendered in a file, from which --resume goes on whatever happened to this process; of several
    /// frames, which are done.
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Go on from the checkpoint if there is one.
    #[arg(long, requires = "checkpoint")]
    pub resume: bool,
}

impl ProgressArgs {
    /// The most samples per pixel.
    pub fn samples(&self) -> u32 {
        let open = self.seconds.is_some() || self.noise.is_some();
        self.spp.unwrap_or(if open { 1 << 16 } else { 64 })
    }

    /// How often pictures and checkpoints are written while rendering, if at all.
    pub fn interval(&self) -> Option<Duration> {
        self.save_every.or(self.checkpoint.as_ref().map(|_| Duration::from_secs(10)))
    }
}

/// Seconds, more than none.
fn duration(text: &str) -> Result<Duration, String> {
    let seconds = text.trim().parse::<f64>().map_err(|e| format!("{text:?}: {e}"))?;
    let duration = Duration::try_from_secs_f64(seconds).map_err(|_| "give a number of seconds")?;
    if duration.is_zero() { Err("give more than no time".into()) } else { Ok(duration) }
}

/// A relative error.
pub(super) fn noise(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(x) if x > 0.0 && x <= 1.0 => Ok(x),
        _ => Err("write a relative error between 0 and 1, as in 0.05 for 5 %".into()),
    }
}

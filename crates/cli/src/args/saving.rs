//! What is saved while a picture is rendered.

use clap::Args;
use raystream::picture::form::{Form, Seconds};
use std::path::PathBuf;
use std::time::Duration;

/// Options of saving while a picture is rendered.
#[derive(Debug, Args)]
pub struct SaveArgs {
    /// Write the unfinished picture and the checkpoint at this interval [default: 10 with --checkpoint].
    #[arg(long, value_name = "SECONDS", value_parser = Seconds::read, allow_hyphen_values = true)]
    pub save_every: Option<Duration>,
    /// Save what has been rendered, so that --resume can continue after this process ended in any way. For an
    /// animation: save which frames are finished.
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Continue from the checkpoint if it exists.
    #[arg(long, requires = "checkpoint")]
    pub resume: bool,
}

impl SaveArgs {
    /// Interval at which pictures and checkpoints are written while rendering, if they are.
    pub fn interval(&self) -> Option<Duration> {
        self.save_every.or(self.checkpoint.as_ref().map(|_| Duration::from_secs(10)))
    }
}

//! The progress bar.

use crate::schedule::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::time::{Duration, Instant};

/// Interval at which the bar moves and Ctrl-C is polled.
pub const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Shows a command's progress on stderr, if stderr is a terminal.
pub struct Bar {
    bar: ProgressBar,
    began: Instant,
    /// Tiles and rays of finished jobs.
    tiles_before: u64,
    rays_before: u64,
}

impl Bar {
    /// A bar of this many tiles.
    pub fn new(tiles: u64) -> Self {
        let bar = ProgressBar::new(tiles);
        let style = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {msg}  {eta} left")
            .expect("the template is valid");
        bar.set_style(style);
        Self { bar, began: Instant::now(), tiles_before: 0, rays_before: 0 }
    }

    /// Adds a finished job.
    pub fn finish_job(&mut self, tiles: u64, rays: u64) {
        self.tiles_before += tiles;
        self.rays_before += rays;
    }

    /// Shows the progress of finished and running jobs.
    pub fn show(&self, jobs: impl Iterator<Item = Progress>) {
        let (mut tiles, mut rays) = (self.tiles_before, self.rays_before);
        for job in jobs {
            tiles += job.tiles_done();
            rays += job.rays_traced();
        }
        self.bar.set_position(tiles);
        let micros = self.began.elapsed().as_secs_f64() * 1e6;
        self.bar.set_message(format!("{:.1} Mray/s", rays as f64 / micros));
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

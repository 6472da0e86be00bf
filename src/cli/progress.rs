//! The progress bar.

use super::interrupt;
use crate::schedule::JobHandle;
use indicatif::{ProgressBar, ProgressStyle};
use std::time::{Duration, Instant};

/// Shows a job's progress on stderr until it is over (quiet when stderr is not a terminal), and stops the job
/// when Ctrl-C asks for it.
pub fn watch(job: &JobHandle) {
    let bar = ProgressBar::new(job.progress().tiles);
    let style = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {msg}  {eta} left")
        .expect("the template is valid");
    bar.set_style(style);
    let started = Instant::now();
    while !job.wait_for(Duration::from_millis(100)) {
        if interrupt::asked() {
            job.stop();
        }
        let progress = job.progress();
        bar.set_position(progress.tiles_done());
        let micros = started.elapsed().as_secs_f64() * 1e6;
        bar.set_message(format!("{:.1} Mray/s", progress.rays_traced() as f64 / micros));
    }
    bar.finish_and_clear();
}

//! Tells how far a command is: as a bar, or as lines that come even while nothing moves.

mod lines;

use super::args::ProgressForm;
use super::{Outcome, with_causes};
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use lines::{Lines, Now, Stage};
use raystream::schedule;
use std::io::IsTerminal;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval at which the bar moves and Ctrl-C is polled.
pub const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Interval of lines. The promise is five seconds; a busy machine may wake the thread late.
const LINE_INTERVAL: Duration = Duration::from_secs(4);

/// Shows a command's progress until it is dropped or [`Progress::end`]ed.
pub struct Progress {
    shown: Shown,
    /// When rendering is to end, if time decides.
    deadline: Option<(Instant, Duration)>,
    /// Tiles of all jobs, and of those that have ended.
    tiles: u64,
    tiles_before: u64,
    rays_before: u64,
    /// When rendering began, and the share that had been taken before.
    rendering: Instant,
    taken: f64,
}

enum Shown {
    Bar(ProgressBar),
    Lines(Ticker),
}

/// Prints lines, from a thread of its own while nothing else happens.
struct Ticker {
    lines: Arc<Lines>,
    shared: Arc<(Mutex<Now>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl Progress {
    /// Shows that a command begins to read its scene.
    pub fn start(form: ProgressForm) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let shown = match form {
            ProgressForm::Auto if is_terminal => Shown::bar(),
            ProgressForm::Bar => Shown::bar(),
            ProgressForm::Auto | ProgressForm::Plain => Shown::lines(Lines::Plain),
            ProgressForm::Json => Shown::lines(Lines::Json),
            ProgressForm::Openjd => Shown::lines(Lines::OpenJd),
        };
        let rendering = Instant::now();
        Self { shown, deadline: None, tiles: 1, tiles_before: 0, rays_before: 0, rendering, taken: 0.0 }
    }

    /// Rendering of this many tiles begins. An earlier run has taken some of them. With `time` it may end before.
    pub fn begin(&mut self, tiles: u64, taken: u64, time: Option<Duration>) {
        let now = Instant::now();
        (self.tiles, self.tiles_before, self.rendering) = (tiles.max(1), taken, now);
        self.taken = taken as f64 / self.tiles as f64;
        self.deadline = time.map(|time| (now, time));
        match &self.shown {
            Shown::Bar(bar) => bar.set_length(self.tiles),
            Shown::Lines(ticker) => ticker.enter(Stage::Rendering),
        }
        self.show(std::iter::empty());
    }

    /// Adds a finished job.
    pub fn finish_job(&mut self, tiles: u64, rays: u64) {
        self.tiles_before += tiles;
        self.rays_before += rays;
    }

    /// Shows the progress of finished and running jobs.
    pub fn show(&self, jobs: impl Iterator<Item = schedule::Progress>) {
        let (mut tiles, mut rays) = (self.tiles_before, self.rays_before);
        for job in jobs {
            tiles += job.tiles_done();
            rays += job.rays_traced();
        }
        let of_tiles = tiles as f64 / self.tiles as f64;
        let of_time = self.deadline.map_or(0.0, |(began, time)| {
            began.elapsed().as_secs_f64() / time.as_secs_f64().max(f64::MIN_POSITIVE)
        });
        let share = of_tiles.max(of_time).min(1.0);
        let rendering_s = self.rendering.elapsed().as_secs_f64();
        let mray_per_s = rays as f64 / (rendering_s * 1e6).max(1.0);
        match &self.shown {
            Shown::Bar(bar) => {
                bar.set_position((share * self.tiles as f64) as u64);
                bar.set_message(format!("{mray_per_s:.1} Mray/s"));
            }
            Shown::Lines(ticker) => {
                let rate = (share - self.taken) / rendering_s;
                let left_s = (rate > 0.0).then(|| (1.0 - share) / rate);
                let mut now = ticker.lock();
                (now.share, now.rays, now.mray_per_s, now.left_s) = (share, rays, mray_per_s, left_s);
            }
        }
    }

    /// Files are written.
    pub fn write(&self) {
        self.show(std::iter::empty());
        match &self.shown {
            Shown::Bar(bar) => bar.finish_and_clear(),
            Shown::Lines(ticker) => ticker.enter(Stage::Writing),
        }
    }

    /// Tells how the command ends.
    pub fn end(mut self, result: &Result<Outcome>) {
        let Shown::Lines(ticker) = &mut self.shown else { return };
        ticker.stop();
        let now = ticker.lock().clone();
        match result {
            Ok(outcome) => ticker.lines.end(&now, outcome),
            Err(error) => ticker.lines.fail(&now, &with_causes(error)),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        match &mut self.shown {
            Shown::Bar(bar) => bar.finish_and_clear(),
            Shown::Lines(ticker) => ticker.stop(),
        }
    }
}

impl Shown {
    fn bar() -> Self {
        let bar = ProgressBar::new(1);
        let style = ProgressStyle::with_template("{wide_bar} {percent:>3} %  {msg}  {eta} left")
            .expect("the template is valid");
        bar.set_style(style);
        Self::Bar(bar)
    }

    fn lines(lines: Lines) -> Self {
        Self::Lines(Ticker::start(lines, LINE_INTERVAL))
    }
}

impl Ticker {
    fn start(lines: Lines, interval: Duration) -> Self {
        let (lines, shared) = (Arc::new(lines), Arc::new((Mutex::new(Now::new()), Condvar::new())));
        let ticker = Self { lines, shared, thread: None };
        ticker.lines.enter(&ticker.lock());
        let (lines, shared) = (Arc::clone(&ticker.lines), Arc::clone(&ticker.shared));
        let thread = std::thread::spawn(move || {
            let (now, changed) = &*shared;
            let mut now = now.lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                let (again, timeout) = changed
                    .wait_timeout_while(now, interval, |now| !now.is_over)
                    .unwrap_or_else(PoisonError::into_inner);
                now = again;
                if now.is_over {
                    return;
                }
                if timeout.timed_out() {
                    lines.tick(&now);
                }
            }
        });
        Self { thread: Some(thread), ..ticker }
    }

    fn lock(&self) -> MutexGuard<'_, Now> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn enter(&self, stage: Stage) {
        let mut now = self.lock();
        // What is left of rendering is known once it has begun.
        (now.stage, now.left_s) = (stage, None);
        self.lines.enter(&now);
    }

    fn stop(&mut self) {
        self.lock().is_over = true;
        self.shared.1.notify_all();
        if let Some(thread) = self.thread.take() {
            // It only prints, and printing does not panic.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_while_nothing_moves() {
        let (lines, told) = Lines::captured();
        let mut ticker = Ticker::start(lines, Duration::from_millis(1));
        let count = || told.lock().expect("no panic").len();
        while count() < 3 {
            std::thread::yield_now();
        }
        ticker.enter(Stage::Rendering);
        let before = count();
        while count() < before + 3 {
            std::thread::yield_now();
        }
        ticker.stop();
        let all = told.lock().expect("no panic").clone();
        assert!(
            all[0].contains("Loading") && all.last().is_some_and(|line| line.contains("Rendering")),
            "{all:?}"
        );
        assert_eq!(count(), all.len(), "it has stopped");
    }
}

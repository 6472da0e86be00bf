//! The viewer of `--tev`.

use crate::args::{RenderArgs, viewer};
use anyhow::Result;
use raystream::film::Picture;
use raystream::film::tev::{INTERVAL, Tev};
use std::time::{Duration, Instant};

/// Shows pictures in tev, if that is asked for.
pub struct Viewer {
    tev: Option<Tev>,
    shown: Instant,
}

impl Viewer {
    /// The viewer that the options name.
    pub fn of(args: &RenderArgs) -> Result<Self> {
        let tev = args.reporting.tev.as_deref().map(viewer).transpose()?;
        Ok(Self { tev, shown: Instant::now() })
    }

    /// Shows a picture.
    pub fn show(&self, name: &str, picture: &Picture) {
        if let Some(tev) = &self.tev {
            tev.show(name, picture);
        }
    }

    /// Shows an unfinished picture, if the last one has been shown for long enough.
    pub fn show_sometimes(&mut self, name: &str, picture: impl FnOnce() -> Picture) {
        if self.tev.is_some() && self.shown.elapsed() >= INTERVAL {
            self.show(name, &picture());
            self.shown = Instant::now();
        }
    }
}

/// The time of a pass: two are in flight between two pictures that are saved or shown. The first is short, so that
/// there is a picture when time is.
pub fn pass_time(args: &RenderArgs) -> Option<Duration> {
    let saved = args.saving.interval().map(|time| time / 2).or(args.spec.stop.seconds);
    let shown = args.reporting.tev.as_ref().map(|_| INTERVAL);
    saved.into_iter().chain(shown).min()
}

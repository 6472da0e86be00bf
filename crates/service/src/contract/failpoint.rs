//! Places at which tests end the process, as a kill at the worst moment would.

use std::sync::atomic::{AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};

/// The place where the process ends: `PLACE`, or `PLACE:N` after N passes of it.
#[derive(Clone, Debug)]
pub struct Failpoint {
    place: String,
    left: Arc<AtomicU64>,
}

static CHOSEN: OnceLock<Failpoint> = OnceLock::new();

/// The places.
const PLACES: [&str; 15] = [
    "before-commit",
    "after-commit",
    "film-written",
    "unit-kept",
    "frame-complete",
    "sums-written",
    "sums-committed",
    "folding",
    "unit-rendered",
    "result-sent",
    "job-deleted",
    "pictures-stored",
    "scene-stored",
    "objects-deleted",
    "folder-moved",
];

impl std::str::FromStr for Failpoint {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (place, count) = text.split_once(':').unwrap_or((text, "0"));
        let count = count.parse().ok().filter(|_| PLACES.contains(&place));
        let count =
            count.ok_or_else(|| format!("write PLACE or PLACE:N with one of {}", PLACES.join(", ")))?;
        Ok(Self { place: place.into(), left: Arc::new(AtomicU64::new(count)) })
    }
}

impl Failpoint {
    /// Chooses the place for this process. The first choice holds.
    pub fn choose(self) {
        let _ = CHOSEN.set(self);
    }
}

/// Ends the process here, if this place was chosen and has been passed often enough.
pub fn pass(place: &str) {
    let Some(chosen) = CHOSEN.get().filter(|chosen| chosen.place == place) else { return };
    let counted = chosen.left.fetch_update(SeqCst, SeqCst, |left| left.checked_sub(1));
    if counted.is_err() {
        let own = rustix::process::getpid();
        // As `kill -9` does: no destructor runs, nothing is flushed.
        let _ = rustix::process::kill_process(own, rustix::process::Signal::KILL);
        loop {
            std::thread::park();
        }
    }
}

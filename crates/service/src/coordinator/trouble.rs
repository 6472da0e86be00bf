//! Whether the data folder can be written, and the storage used. Trouble is told once, in the log, as a metric and by
//! `/readyz`, and not by each of the many who meet it.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a refusal counts: whoever was refused tries again sooner.
const LASTS: Duration = Duration::from_secs(15);

/// How often trouble that lasts is told again.
const TOLD_EVERY: Duration = Duration::from_secs(600);

/// The last refusal of the disk or the ledger, or of the storage.
#[derive(Debug)]
pub struct Trouble {
    /// The name of the gauge: 1 while there is trouble.
    gauge: &'static str,
    /// The log's line when it is over.
    over: &'static str,
    /// How long after the last refusal it may be over: while some requests are refused and others are not, it is not.
    quiet: Duration,
    state: Mutex<Option<Refusal>>,
}

#[derive(Debug)]
struct Refusal {
    why: String,
    last: Instant,
    told: Instant,
}

impl Trouble {
    /// That of the data folder.
    pub fn of_data_folder() -> Self {
        let (gauge, over) = ("raystream_data_folder_refuses", "the data folder can be written again");
        Self { gauge, over, quiet: Duration::ZERO, state: Mutex::default() }
    }

    /// That of the storage.
    pub fn of_storage() -> Self {
        let (gauge, over) = ("raystream_storage_refuses", "the storage can be used again");
        Self { gauge, over, quiet: LASTS, state: Mutex::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Refusal>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes note of a refusal. Whether it was told.
    pub fn note(&self, why: &str) -> bool {
        let (mut state, now) = (self.lock(), Instant::now());
        let told = state.as_ref().map(|refusal| refusal.told).filter(|told| now - *told < TOLD_EVERY);
        if told.is_none() {
            log::warn!("{why}; jobs and results wait until that is over");
        }
        metrics::gauge!(self.gauge).set(1.0);
        *state = Some(Refusal { why: why.to_owned(), last: now, told: told.unwrap_or(now) });
        told.is_none()
    }

    /// Takes note that something was done as it should be.
    pub fn end(&self) {
        let is_over = |refusal: &mut Refusal| refusal.last.elapsed() >= self.quiet;
        if self.lock().take_if(is_over).is_some() {
            log::warn!("{}", self.over);
            metrics::gauge!(self.gauge).set(0.0);
        }
    }

    /// Returns the reason of the last refusal, if it was lately.
    pub fn now(&self) -> Option<String> {
        let state = self.lock();
        state.as_ref().filter(|refusal| refusal.last.elapsed() < LASTS).map(|refusal| refusal.why.clone())
    }

    /// Returns the reason of the last refusal, until it is over.
    pub fn lasting(&self) -> Option<String> {
        self.lock().as_ref().map(|refusal| refusal.why.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trouble_is_told_once_until_it_ends() {
        let trouble = Trouble::of_data_folder();
        assert_eq!(trouble.now(), None);
        assert_eq!([trouble.note("full"), trouble.note("still full")], [true, false]);
        assert_eq!(trouble.now(), Some("still full".into()));
        trouble.end();
        assert_eq!(trouble.now(), None);
        assert!(trouble.note("full again"));
    }
}

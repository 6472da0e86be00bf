//! Whether the data folder can be written. A full disk is told once, in the log, as a metric and by `/readyz`, and not
//! by each of the many writes that it refuses.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a refusal counts: whoever writes tries again sooner.
const LASTS: Duration = Duration::from_secs(15);

/// How often trouble that lasts is told again.
const TOLD_EVERY: Duration = Duration::from_secs(600);

/// The name of the gauge: 1 while the data folder cannot be written.
const GAUGE: &str = "raystream_data_folder_refuses";

/// The last refusal of the disk or the ledger.
#[derive(Debug, Default)]
pub struct Trouble(Mutex<Option<Refusal>>);

#[derive(Debug)]
struct Refusal {
    why: String,
    last: Instant,
    told: Instant,
}

impl Trouble {
    fn lock(&self) -> MutexGuard<'_, Option<Refusal>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes note of a refusal. Whether it was told.
    pub fn note(&self, why: &str) -> bool {
        let (mut state, now) = (self.lock(), Instant::now());
        let told = state.as_ref().map(|refusal| refusal.told).filter(|told| now - *told < TOLD_EVERY);
        if told.is_none() {
            log::warn!("{why}; jobs and results wait until that is over");
        }
        metrics::gauge!(GAUGE).set(1.0);
        *state = Some(Refusal { why: why.to_owned(), last: now, told: told.unwrap_or(now) });
        told.is_none()
    }

    /// Takes note that something was written.
    pub fn end(&self) {
        if self.lock().take().is_some() {
            log::warn!("the data folder can be written again");
            metrics::gauge!(GAUGE).set(0.0);
        }
    }

    /// Returns the reason of the last refusal, if it was lately.
    pub fn now(&self) -> Option<String> {
        let state = self.lock();
        state.as_ref().filter(|refusal| refusal.last.elapsed() < LASTS).map(|refusal| refusal.why.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trouble_is_told_once_until_it_ends() {
        let trouble = Trouble::default();
        assert_eq!(trouble.now(), None);
        assert_eq!([trouble.note("full"), trouble.note("still full")], [true, false]);
        assert_eq!(trouble.now(), Some("still full".into()));
        trouble.end();
        assert_eq!(trouble.now(), None);
        assert!(trouble.note("full again"));
    }
}

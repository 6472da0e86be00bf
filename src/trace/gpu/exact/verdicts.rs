//! What probes have found in this process. A driver compiles the same module alike, so a device that replaces a lost
//! one, and a scene of a shape that was seen before, are not compared again.

use crate::device::Gpu;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Mutex, PoisonError};

/// Whether a module has the host's bits, or why not.
type Verdict = Result<(), String>;

/// As many as there are shapes of scenes, routes and adapters.
static VERDICTS: Mutex<Vec<(u64, Verdict)>> = Mutex::new(Vec::new());

/// The key of a module's source on an adapter and its driver.
pub(super) fn key(gpu: &Gpu, source: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    let info = gpu.info();
    (&info.name, &info.backend, &info.driver, source).hash(&mut hasher);
    hasher.finish()
}

/// The verdict about a module, if it has been compared.
pub(super) fn find(key: u64) -> Option<Verdict> {
    let verdicts = VERDICTS.lock().unwrap_or_else(PoisonError::into_inner);
    verdicts.iter().find(|(known, _)| *known == key).map(|(_, verdict)| verdict.clone())
}

/// Keeps a verdict.
pub(super) fn keep(key: u64, verdict: Verdict) {
    VERDICTS.lock().unwrap_or_else(PoisonError::into_inner).push((key, verdict));
}

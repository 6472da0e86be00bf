//! What replaces a lost device: another device of the same adapter. The first thread that needs it opens it, and all
//! threads share it. A lost device never comes back to life, so each has its own [`Gpu`], and their number is bounded.

use super::{AdapterChoice, Gpu};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// How many devices may be opened as replacements, failed attempts included. An adapter that loses more devices is of
/// no use.
const MOST: u32 = 8;

/// How long a driver may recover before the next attempt.
const RECOVERY: Duration = Duration::from_millis(250);

/// A device's position in the chain of devices that replace each other.
#[derive(Debug, Default)]
pub(super) struct DeviceReplacement {
    /// Attempts to open a device before this one was opened.
    number: u32,
    /// Whether the chain ends here.
    is_forbidden: AtomicBool,
    next: OnceLock<Option<Arc<Gpu>>>,
}

impl DeviceReplacement {
    /// Forbids further replacements.
    pub fn forbid(&self) {
        self.is_forbidden.store(true, Ordering::Relaxed);
    }
}

impl Gpu {
    /// The number of attempts to replace a lost device before this one was opened.
    pub(crate) fn replacements(&self) -> u32 {
        self.replacement.number
    }

    /// The first device of the chain, from this one on, that is not lost; if all are, the last one.
    pub(crate) fn latest(self: Arc<Self>) -> Arc<Self> {
        let mut gpu = self;
        while gpu.lost().is_some() {
            match gpu.successor(&AtomicBool::new(false)) {
                Some(next) => gpu = next,
                None => break,
            }
        }
        gpu
    }

    /// The replacement of this lost device. Opens it, unless another thread has. `None` when replacements are forbidden
    /// or used up, no device can be opened, or `cancelled` is set.
    pub(crate) fn successor(&self, cancelled: &AtomicBool) -> Option<Arc<Self>> {
        let DeviceReplacement { number, is_forbidden, next } = &self.replacement;
        if is_forbidden.load(Ordering::Relaxed) || cancelled.load(Ordering::Relaxed) {
            return None;
        }
        next.get_or_init(|| {
            let choice = AdapterChoice { name: Some(self.info.name.clone()), allow_software: true };
            for number in number + 1..=MOST {
                if let Ok(gpu) = Self::open(&choice) {
                    let replacement = DeviceReplacement { number, ..DeviceReplacement::default() };
                    return Some(Arc::new(gpu.replacing(self, replacement)));
                }
                std::thread::sleep(RECOVERY);
            }
            None
        })
        .clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open() -> Gpu {
        let choice = AdapterChoice { name: None, allow_software: true };
        Gpu::open(&choice).expect("tests need a GPU; a software adapter will do")
    }

    #[test]
    fn lost_devices_are_replaced_a_bounded_number_of_times_and_untrusted_ones_never() {
        let never = AtomicBool::new(false);
        let mut gpu = Arc::new(open());
        let mut count = 0;
        loop {
            gpu.simulate_loss();
            let Some(next) = gpu.successor(&never) else { break };
            let again = gpu.successor(&never).expect("as before");
            assert!(Arc::ptr_eq(&next, &again), "one successor for all threads");
            count += 1;
            assert_eq!((next.lost(), next.replacements()), (None, count));
            gpu = next;
        }
        assert_eq!(count, MOST);
        let untrusted = Arc::new(open());
        untrusted.mark_untrusted("wrong answers".into());
        assert!(untrusted.successor(&never).is_none());
        assert!(Arc::new(open()).successor(&AtomicBool::new(true)).is_none(), "cancelled");
    }
}

//! What comes after a loss: another device of the same adapter, opened by whoever needs it first and shared by
//! all. A device never comes back to life, so each stays behind its own wall, and their number is bounded.

use super::{AdapterChoice, Gpu};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// How many devices may be opened in the place of the first, tries that fail included. An adapter that loses more
/// is of no use.
pub(super) const MOST: u32 = 8;

/// How long a driver is given to recover before it is asked again.
const RECOVERY: Duration = Duration::from_millis(250);

/// A device's place in the line.
#[derive(Debug, Default)]
pub(super) struct DeviceReplacement {
    /// Tries to open a device before this one was there.
    number: u32,
    /// No other may follow.
    ended: AtomicBool,
    next: OnceLock<Option<Arc<Gpu>>>,
}

impl DeviceReplacement {
    /// How many tries to open a device there were before this one.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Has no other device follow.
    pub fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
    }
}

impl Gpu {
    /// This device; or, if it is lost, the first after it that is not, or the last there may be.
    pub(super) fn latest(self: Arc<Self>) -> Arc<Self> {
        let mut gpu = self;
        while gpu.lost().is_some() {
            match gpu.successor(&AtomicBool::new(false)) {
                Some(next) => gpu = next,
                None => break,
            }
        }
        gpu
    }

    /// The device in the place of this lost one; opens it if nobody has yet. `None` when no other may follow, none
    /// can be had, or `over` says that nobody wants it any more.
    pub(super) fn successor(&self, over: &AtomicBool) -> Option<Arc<Self>> {
        let DeviceReplacement { number, ended, next } = &self.succession;
        if ended.load(Ordering::Relaxed) || over.load(Ordering::Relaxed) {
            return None;
        }
        next.get_or_init(|| {
            let choice = AdapterChoice { name: Some(self.info.name.clone()), allow_software: true };
            for number in number + 1..=MOST {
                if let Ok(gpu) = Self::open(&choice) {
                    let succession = DeviceReplacement { number, ..DeviceReplacement::default() };
                    return Some(Arc::new(gpu.in_place_of(self, succession)));
                }
                std::thread::sleep(RECOVERY);
            }
            None
        })
        .clone()
    }
}

//! The bus of one process: calls.

use super::bell::Bell;
use super::{BusError, LiveAnswered, WorkBus};
use crate::contract::{Answer, Ask, Coordinator, LEASE, LiveAsk, TileServer};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// The key of the worker that asks.
const KEY: &str = "0";

/// A bus between threads of one process. One worker asks; several may listen, whose keys are their numbers.
pub struct LocalBus {
    bell: Bell,
    lease_time: Duration,
    coordinator: OnceLock<Arc<dyn Coordinator>>,
    /// Who answers for live views.
    listeners: Mutex<Vec<Arc<dyn TileServer>>>,
}

impl std::fmt::Debug for LocalBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LocalBus").finish_non_exhaustive()
    }
}

impl Default for LocalBus {
    fn default() -> Self {
        let (coordinator, listeners) = (OnceLock::new(), Mutex::default());
        Self { bell: Bell::default(), lease_time: LEASE, coordinator, listeners }
    }
}

impl WorkBus for LocalBus {
    fn attend(&self, coordinator: Arc<dyn Coordinator>) -> Result<(), BusError> {
        self.coordinator.set(coordinator).map_err(|_| BusError::Refused("the bus has a coordinator".into()))
    }

    fn ask(&self, ask: Ask) -> Result<Answer, BusError> {
        let coordinator = self.coordinator.get().ok_or_else(|| BusError::Silent("the coordinator".into()))?;
        Ok(coordinator.answer(KEY, ask))
    }

    fn ring(&self) {
        self.bell.ring();
    }

    fn bell(&self) -> &Bell {
        &self.bell
    }

    fn lease_time(&self) -> Duration {
        self.lease_time
    }

    fn listen(&self, tiles: Arc<dyn TileServer>) -> Result<(), BusError> {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner).push(tiles);
        Ok(())
    }

    fn request(&self, key: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered) {
        let listeners = self.listeners.lock().unwrap_or_else(PoisonError::into_inner);
        let found = key.parse().ok().and_then(|place: usize| listeners.get(place).cloned());
        drop(listeners);
        let silent = BusError::Silent(format!("the worker {key}"));
        let wait = move || {
            let Some(tiles) = found else { return answered(Err(silent)) };
            let (tell, told) = channel();
            // Who asked may have lost its patience.
            tiles.take(ask, Box::new(move |answer| drop(tell.send(answer))));
            answered(told.recv_timeout(patience).map_err(|_| silent));
        };
        let thread = std::thread::Builder::new().name("live request".into()).spawn(wait);
        thread.map_or_else(|error| log::warn!("a worker is not asked: {error}"), drop);
    }
}

#[cfg(test)]
mod tests {
    use super::{KEY, LocalBus, WorkBus};
    use crate::bus::promises;
    use std::sync::Arc;

    #[test]
    fn the_promises_hold() {
        promises::check(|| {
            let bus: Arc<dyn WorkBus> = Arc::new(LocalBus::default());
            (Arc::clone(&bus), bus, KEY.into())
        });
    }
}

//! The bus of one process: calls.

use super::LEASE;
use super::bell::Bell;
use super::bus::{BusError, WorkBus};
use super::desk::{Answer, Ask, Desk};
use super::live::{LiveAnswered, LiveAsk, LiveDesk};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// The key of the worker that asks.
const KEY: &str = "0";

/// A bus between threads of one process. One worker asks; several may listen, whose keys are their numbers.
pub struct LocalBus {
    bell: Bell,
    lease_time: Duration,
    desk: OnceLock<Arc<dyn Desk>>,
    /// Who answers for live views.
    listeners: Mutex<Vec<Arc<dyn LiveDesk>>>,
}

impl std::fmt::Debug for LocalBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LocalBus").finish_non_exhaustive()
    }
}

impl Default for LocalBus {
    fn default() -> Self {
        let (desk, listeners) = (OnceLock::new(), Mutex::default());
        Self { bell: Bell::default(), lease_time: LEASE, desk, listeners }
    }
}

impl WorkBus for LocalBus {
    fn attend(&self, desk: Arc<dyn Desk>) -> Result<(), BusError> {
        self.desk.set(desk).map_err(|_| BusError::Refused("the bus has a desk".into()))
    }

    fn ask(&self, ask: Ask) -> Result<Answer, BusError> {
        let desk = self.desk.get().ok_or_else(|| BusError::Silent("the coordinator".into()))?;
        Ok(desk.answer(KEY, ask))
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

    fn listen(&self, desk: Arc<dyn LiveDesk>) -> Result<(), BusError> {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner).push(desk);
        Ok(())
    }

    fn request(&self, key: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered) {
        let listeners = self.listeners.lock().unwrap_or_else(PoisonError::into_inner);
        let found = key.parse().ok().and_then(|place: usize| listeners.get(place).cloned());
        drop(listeners);
        let silent = BusError::Silent(format!("the worker {key}"));
        let wait = move || {
            let Some(desk) = found else { return answered(Err(silent)) };
            let (tell, told) = channel();
            // Who asked may have lost its patience.
            desk.take(ask, Box::new(move |answer| drop(tell.send(answer))));
            answered(told.recv_timeout(patience).map_err(|_| silent));
        };
        let thread = std::thread::Builder::new().name("live request".into()).spawn(wait);
        thread.map_or_else(|error| log::warn!("a worker is not asked: {error}"), drop);
    }
}

#[cfg(test)]
mod tests {
    use super::super::WorkBus;
    use super::super::contract;
    use super::{KEY, LocalBus};
    use std::sync::Arc;

    #[test]
    fn the_contract_holds() {
        contract::check(|| {
            let bus: Arc<dyn WorkBus> = Arc::new(LocalBus::default());
            (Arc::clone(&bus), bus, KEY.into())
        });
    }
}

//! The bus of one process: a queue, and calls.

use super::bus::{Backlog, BusError, Lane, Lease, Offered, WorkBus};
use super::desk::{Answer, Ask, Desk};
use super::live::{LiveAnswered, LiveAsk, LiveDesk};
use super::unit::Unit;
use super::{BEATS, LEASE, QUEUED_UNITS};
use std::collections::VecDeque;
use std::sync::mpsc::channel;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// A bus between threads of one process.
pub struct LocalBus {
    queue: Arc<Queue>,
    desk: OnceLock<Arc<dyn Desk>>,
    /// Who answers for live views; an address is a place in it.
    listeners: Mutex<Vec<Arc<dyn LiveDesk>>>,
}

impl std::fmt::Debug for LocalBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LocalBus").field("units", &self.queue.lock().len()).finish_non_exhaustive()
    }
}

/// The units, in the order in which they were offered, lane by lane.
struct Queue {
    entries: Mutex<VecDeque<Entry>>,
    changed: Condvar,
    lease_time: Duration,
    most: usize,
}

struct Entry {
    lane: Lane,
    unit: Arc<Unit>,
    round: u32,
    deliveries: u64,
    /// When it may be leased: now, after a pause, or when a lease ends.
    from: Instant,
    /// Whether someone has it.
    is_leased: bool,
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, VecDeque<Entry>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Default for LocalBus {
    fn default() -> Self {
        Self::new(LEASE, QUEUED_UNITS)
    }
}

impl LocalBus {
    /// A bus whose leases last this long, with room for so many units.
    pub fn new(lease_time: Duration, most: usize) -> Self {
        let (entries, changed) = (Mutex::default(), Condvar::new());
        let queue = Arc::new(Queue { entries, changed, lease_time, most });
        Self { queue, desk: OnceLock::new(), listeners: Mutex::default() }
    }
}

impl WorkBus for LocalBus {
    fn offer(&self, lane: Lane, unit: &Unit, round: u32) -> Result<Offered, BusError> {
        let mut queue = self.queue.lock();
        if queue.iter().any(|entry| entry.unit.id == unit.id && entry.round == round) {
            return Ok(Offered::Duplicate);
        }
        if queue.len() >= self.queue.most {
            return Ok(Offered::Full);
        }
        let entry = Entry {
            lane,
            unit: Arc::new(unit.clone()),
            round,
            deliveries: 0,
            from: Instant::now(),
            is_leased: false,
        };
        let place = queue.partition_point(|other| other.lane <= lane);
        queue.insert(place, entry);
        self.queue.changed.notify_one();
        Ok(Offered::New)
    }

    fn backlog(&self) -> Result<Backlog, BusError> {
        Ok(Backlog { units: self.queue.lock().len() as u64, is_new: false })
    }

    fn attend(&self, desk: Arc<dyn Desk>) -> Result<(), BusError> {
        self.desk.set(desk).map_err(|_| BusError::Refused("the bus has a desk".into()))
    }

    fn lease(&self, patience: Duration) -> Result<Option<Box<dyn Lease>>, BusError> {
        let until = Instant::now() + patience;
        let mut queue = self.queue.lock();
        loop {
            let now = Instant::now();
            if let Some(entry) = queue.iter_mut().find(|entry| entry.from <= now) {
                entry.deliveries += 1;
                entry.from = now + self.queue.lease_time;
                entry.is_leased = true;
                let (unit, round, deliveries) = (Arc::clone(&entry.unit), entry.round, entry.deliveries);
                let queue = Arc::clone(&self.queue);
                return Ok(Some(Box::new(LocalLease { queue, unit, round, deliveries })));
            }
            if now >= until {
                return Ok(None);
            }
            let next = queue.iter().map(|entry| entry.from).min().map_or(until, |from| from.min(until));
            let waited = self.queue.changed.wait_timeout(queue, next.saturating_duration_since(now));
            queue = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn ask(&self, ask: Ask) -> Result<Answer, BusError> {
        let desk = self.desk.get().ok_or_else(|| BusError::Silent("the coordinator".into()))?;
        Ok(desk.answer(ask))
    }

    fn lease_time(&self) -> Duration {
        self.queue.lease_time
    }

    fn listen(&self, desk: Arc<dyn LiveDesk>) -> Result<String, BusError> {
        let mut listeners = self.listeners.lock().unwrap_or_else(PoisonError::into_inner);
        listeners.push(desk);
        Ok((listeners.len() - 1).to_string())
    }

    fn request(&self, address: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered) {
        let listeners = self.listeners.lock().unwrap_or_else(PoisonError::into_inner);
        let found = address.parse().ok().and_then(|place: usize| listeners.get(place).cloned());
        drop(listeners);
        let silent = BusError::Silent(format!("the worker at {address}"));
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

struct LocalLease {
    queue: Arc<Queue>,
    unit: Arc<Unit>,
    round: u32,
    deliveries: u64,
}

impl LocalLease {
    /// Changes the entry, unless another has leased it since.
    fn change(&self, change: impl FnOnce(&mut VecDeque<Entry>, usize)) {
        let mut queue = self.queue.lock();
        let own = |entry: &Entry| {
            entry.unit.id == self.unit.id
                && entry.round == self.round
                && entry.deliveries == self.deliveries
                && entry.is_leased
        };
        if let Some(place) = queue.iter().position(own) {
            change(&mut queue, place);
        }
        drop(queue);
        self.queue.changed.notify_all();
    }
}

impl Lease for LocalLease {
    fn unit(&self) -> &Unit {
        &self.unit
    }

    fn deliveries(&self) -> u64 {
        self.deliveries
    }

    fn beat(&self) {
        self.change(|queue, place| queue[place].from = Instant::now() + self.queue.lease_time);
    }

    fn done(&self) {
        self.change(|queue, place| drop(queue.remove(place)));
    }

    fn give_back(&self, delay: Duration) {
        self.change(|queue, place| {
            queue[place].from = Instant::now() + delay;
            queue[place].is_leased = false;
        });
    }
}

const _: () = assert!(BEATS > 1);

#[cfg(test)]
mod tests {
    use super::super::contract;
    use super::super::{Lane, Offered, Unit, UnitId, WorkBus};
    use super::LocalBus;
    use std::sync::Arc;

    #[test]
    fn the_contract_holds() {
        contract::check(|| {
            let bus: Arc<dyn WorkBus> = Arc::new(LocalBus::new(contract::LEASE, 100));
            (Arc::clone(&bus), bus)
        });
    }

    #[test]
    fn a_full_bus_says_so() {
        let bus = LocalBus::new(contract::LEASE, 2);
        let offer = |number| {
            let id = UnitId { job: "a".into(), frame: 0, pass: 0, number, copy: 0 };
            let (scene, entry, spec, priority) = ("s".into(), None, Default::default(), "normal".into());
            bus.offer(Lane::Lo, &Unit { id, scene, entry, spec, priority, blocks: vec![0], samples: 0..1 }, 0)
        };
        assert_eq!(
            [offer(0), offer(1), offer(2)].map(Result::ok),
            [Some(Offered::New), Some(Offered::New), Some(Offered::Full)]
        );
    }
}

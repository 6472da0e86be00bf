//! Who works for the service, and what each has done.

use crate::farm::{Build, Card, Report, Welcome};
use serde::Serialize;
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Workers that were not heard of for this long are forgotten.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(600);

/// What is known of a worker.
struct Known {
    card: Card,
    seen: Instant,
    units: usize,
    is_draining: bool,
    cache: (u64, u64),
    rays: u64,
    done: u64,
    samples: u64,
    /// Pixels × samples a second of its units under way together.
    speed: f64,
    redeliveries: u64,
}

/// A worker, as answers show it.
#[derive(Clone, Debug, Serialize)]
pub struct ShownWorker {
    name: String,
    host: String,
    tracing: String,
    slots: u32,
    state: &'static str,
    seen_ms_ago: u64,
    units_now: usize,
    units_done: u64,
    samples: u64,
    samples_per_second: f64,
    rays: u64,
    scenes_cached: u64,
    scenes_fetched: u64,
    redeliveries: u64,
    reason: Option<String>,
}

/// All workers.
#[derive(Default)]
pub struct Workers {
    known: HashMap<String, Known>,
    /// Those that may take no units, and why.
    quarantined: HashMap<String, String>,
}

impl Workers {
    /// With those that an earlier process has quarantined.
    pub fn new(quarantined: Vec<(String, String)>) -> Self {
        Self { known: HashMap::new(), quarantined: quarantined.into_iter().collect() }
    }

    /// Lets a worker join, unless it is of another build or quarantined.
    pub fn join(&mut self, card: Card, lease: Duration) -> Welcome {
        if let Some(difference) = Build::own().difference(&card.build) {
            log::warn!("worker {}: refused: {difference}", card.worker);
            return Welcome::Refused(format!(
                "{difference}; its pictures would differ, so install the same one"
            ));
        }
        if let Some(reason) = self.quarantined.get(&card.worker) {
            return Welcome::Refused(reason.clone());
        }
        // One that comes back goes on counting.
        let known = self.known.entry(card.worker.clone()).or_insert_with(|| Known {
            card: card.clone(),
            seen: Instant::now(),
            units: 0,
            is_draining: false,
            cache: (0, 0),
            rays: 0,
            done: 0,
            samples: 0,
            speed: 0.0,
            redeliveries: 0,
        });
        (known.card, known.seen, known.is_draining) = (card, Instant::now(), false);
        Welcome::Joined { lease_ms: lease.as_millis() as u64 }
    }

    /// Takes note of a report. False if the worker is not known.
    pub fn report(&mut self, report: &Report) -> bool {
        let Some(known) = self.known.get_mut(&report.worker) else { return false };
        known.seen = Instant::now();
        known.units = report.units.len();
        known.is_draining = report.is_draining;
        known.cache = report.cache;
        known.rays = report.rays;
        true
    }

    /// Takes note that a worker is there.
    pub fn seen(&mut self, worker: &str) {
        if let Some(known) = self.known.get_mut(worker) {
            known.seen = Instant::now();
        }
    }

    /// Takes note of a unit that a worker has rendered.
    pub fn done(&mut self, worker: &str, samples: u64, seconds: f64) {
        let Some(known) = self.known.get_mut(worker) else { return };
        known.done += 1;
        known.samples += samples;
        let now = samples as f64 / seconds.max(1e-4);
        known.speed = if known.speed == 0.0 { now } else { 0.8 * known.speed + 0.2 * now };
    }

    /// Takes note that a worker has got a unit that another one had before.
    pub fn redelivered(&mut self, worker: &str) {
        if let Some(known) = self.known.get_mut(worker) {
            known.redeliveries += 1;
        }
    }

    /// Takes note that a worker leaves.
    pub fn leave(&mut self, worker: &str) {
        self.known.remove(worker);
    }

    /// Why a worker may take no units.
    pub fn refusal(&self, worker: &str) -> Option<&String> {
        self.quarantined.get(worker)
    }

    /// Lets a worker take no more units.
    pub fn quarantine(&mut self, worker: &str, reason: &str) {
        self.quarantined.entry(worker.to_owned()).or_insert_with(|| reason.to_owned());
    }

    /// Forgets workers that are gone. Returns the slots of the others that take units and were heard of within a time.
    pub fn slots(&mut self, within: Duration) -> usize {
        self.known.retain(|_, known| known.seen.elapsed() < FORGOTTEN_AFTER);
        let take = |known: &&Known| !known.is_draining && known.seen.elapsed() < within;
        let quarantined = |known: &&Known| !self.quarantined.contains_key(&known.card.worker);
        self.known.values().filter(take).filter(quarantined).map(|known| known.card.slots as usize).sum()
    }

    /// Whether a worker other than this one takes units and was heard of within a time.
    pub fn has_other(&self, than: &str, within: Duration) -> bool {
        self.known.values().any(|known| {
            let name = &*known.card.worker;
            name != than
                && !known.is_draining
                && known.seen.elapsed() < within
                && !self.quarantined.contains_key(name)
        })
    }

    /// Names and addresses of the workers that were heard of within this time and render tiles of live views.
    pub fn live(&self, within: Duration) -> Vec<(String, String)> {
        let known = self.known.iter().filter(|(name, known)| {
            !known.is_draining && known.seen.elapsed() < within && !self.quarantined.contains_key(*name)
        });
        let mut live: Vec<_> =
            known.filter_map(|(name, known)| Some((name.clone(), known.card.live.clone()?))).collect();
        live.sort();
        live
    }

    /// All workers, by name.
    pub fn shown(&self, within: Duration) -> Vec<ShownWorker> {
        let mut shown: Vec<ShownWorker> = self.known.values().map(|known| self.show(known, within)).collect();
        shown.sort_by(|a, b| a.name.cmp(&b.name));
        shown
    }

    fn show(&self, known: &Known, within: Duration) -> ShownWorker {
        let name = known.card.worker.clone();
        let reason = self.quarantined.get(&name).cloned();
        let state = match () {
            () if reason.is_some() => "quarantined",
            () if known.seen.elapsed() >= within => "silent",
            () if known.is_draining => "draining",
            () if known.units > 0 => "busy",
            () => "idle",
        };
        ShownWorker {
            name,
            host: known.card.host.clone(),
            tracing: known.card.units.clone(),
            slots: known.card.slots,
            state,
            seen_ms_ago: known.seen.elapsed().as_millis() as u64,
            units_now: known.units,
            units_done: known.done,
            samples: known.samples,
            samples_per_second: known.speed,
            rays: known.rays,
            scenes_cached: known.cache.0,
            scenes_fetched: known.cache.1,
            redeliveries: known.redeliveries,
            reason,
        }
    }
}

impl ShownWorker {
    /// All states that a worker can be in.
    const STATES: [&str; 5] = ["busy", "idle", "draining", "silent", "quarantined"];

    /// The number of workers in each state.
    pub fn counts(workers: &[Self]) -> [(&'static str, usize); 5] {
        Self::STATES.map(|state| (state, workers.iter().filter(|worker| worker.state == state).count()))
    }
}

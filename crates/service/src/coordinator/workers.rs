//! Who works for the service, and what each has done.

use super::decisions::{REST_LEASES, is_fruitless};
use crate::contract::{Build, JoinReply, MOST_SLOTS, Report, WorkerInfo, is_name};
use serde::Serialize;
use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

/// Workers that were not heard of for this long are forgotten.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(600);

/// Keys that are known at the same time: a guard.
const MOST_KNOWN: usize = 20_000;

/// Leases after which a worker that was not heard of counts as silent, and not as one that holds units.
const SILENT_LEASES: u32 = 2;

/// Scenes of a worker that are remembered.
const MOST_SCENES: usize = 64;

/// Complaints of a worker that are logged; then one in a hundred is.
const LOGGED: u64 = 5;

/// What is known of a worker.
struct Known {
    info: WorkerInfo,
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
    /// Since when it has had units and has returned nothing.
    owes_since: Option<Instant>,
    /// Scenes whose picture was another one at this worker, and when it was told so.
    foreign: HashMap<String, Instant>,
    /// Why this process of it may take no more units.
    sent_home: Option<String>,
    complaints: u64,
    /// When it last gave a unit back that was counted.
    gave_back: Option<Instant>,
    /// Its place in the order in which workers have joined.
    place: u64,
    /// False if it does not help: there are others enough, or it would have the scene too late.
    helps: bool,
    /// The scenes of the units that it has returned.
    scenes: HashSet<String>,
}

/// The standing of a worker that asks for a unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It has not joined, or another process of its key has since.
    Unknown,
    /// It may take no units, and why.
    Refused(String),
    /// It gets none for a while, and why.
    Rests(String),
    /// It may have so many units.
    Welcome(usize),
}

const QUARANTINED: &str = "quarantined";

/// A worker, as answers show it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ShownWorker {
    name: String,
    key: String,
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

/// All workers, by their keys.
#[derive(Default)]
pub struct Workers {
    known: HashMap<String, Known>,
    /// Names of those that may take no units, and why.
    quarantined: HashMap<String, (String, String)>,
    /// Until when those get no units that have returned nothing, and why.
    resting: HashMap<String, (Instant, String)>,
    /// How often in a row a worker has lost or given back what it had.
    fruitless: HashMap<String, u32>,
    /// The number of workers that have ever joined.
    joined: u64,
    /// The number of workers that help, since that was last decided.
    most: Option<usize>,
}

impl Known {
    /// Takes note that the worker is heard. Time in which it was silent is none that it has held units.
    fn hear(&mut self, lease: Duration) {
        if self.seen.elapsed() >= SILENT_LEASES * lease {
            self.owes_since = self.owes_since.map(|_| Instant::now());
        }
        self.seen = Instant::now();
    }
}

impl Workers {
    /// With those that an earlier process has quarantined: key, name, reason.
    pub fn new(quarantined: Vec<(String, String, String)>) -> Self {
        let quarantined = quarantined.into_iter().map(|(key, name, reason)| (key, (name, reason)));
        Self { quarantined: quarantined.collect(), ..Self::default() }
    }

    /// Lets a worker join, unless it is of another build or quarantined. Whether another process of its key was there
    /// before, whose units it does not have.
    pub fn join(&mut self, key: &str, info: WorkerInfo, lease: Duration) -> (JoinReply, bool) {
        let refused = |why: String| (JoinReply::Refused(why), false);
        if !is_name(&info.worker) || !is_name(&info.host) || info.units.len() > 1000 {
            return refused("names of workers and machines have 1 to 64 characters".into());
        }
        if let Some(difference) = Build::own().difference(&info.build) {
            log::warn!("worker {}: refused: {difference}", info.worker);
            return refused(format!("{difference}; its pictures would differ, so install the same one"));
        }
        if !(1..=MOST_SLOTS).contains(&info.slots) {
            return refused(format!("a worker has 1 to {MOST_SLOTS} slots, and this one {}", info.slots));
        }
        if let Some((_, reason)) = self.quarantined.get(key) {
            return refused(reason.clone());
        }
        if self.known.len() >= MOST_KNOWN && !self.known.contains_key(key) {
            return refused("there are too many workers".into());
        }
        let lease_ms = lease.as_millis() as u64;
        let another = self.known.get(key).is_some_and(|known| known.info.session != info.session);
        self.joined += 1;
        let (place, helps) = (self.joined, self.most.is_none_or(|most| self.known.len() < most));
        // One that comes back goes on counting.
        let known = self.known.entry(key.to_owned()).or_insert_with(|| Known {
            info: info.clone(),
            seen: Instant::now(),
            units: 0,
            is_draining: false,
            cache: (0, 0),
            rays: 0,
            done: 0,
            samples: 0,
            speed: 0.0,
            redeliveries: 0,
            owes_since: None,
            foreign: HashMap::new(),
            sent_home: None,
            complaints: 0,
            gave_back: None,
            place,
            helps,
            scenes: HashSet::new(),
        });
        if another {
            (known.sent_home, known.owes_since) = (None, None);
            known.foreign.clear();
            known.scenes.clear();
        }
        (known.info, known.seen, known.is_draining) = (info, Instant::now(), false);
        (JoinReply::Joined { lease_ms }, another)
    }

    /// Returns the standing of a worker's process.
    pub fn standing(&self, key: &str, session: u64) -> Standing {
        if let Some((_, reason)) = self.quarantined.get(key) {
            return Standing::Refused(reason.clone());
        }
        let Some(known) = self.known.get(key).filter(|known| known.info.session == session) else {
            return Standing::Unknown;
        };
        match (&known.sent_home, self.rests(key)) {
            (Some(why), _) => Standing::Refused(why.clone()),
            (None, Some(why)) => Standing::Rests(why.to_owned()),
            (None, None) => Standing::Welcome(known.info.slots as usize),
        }
    }

    /// Why a worker gets no units now.
    fn rests(&self, key: &str) -> Option<&str> {
        let resting = self.resting.get(key).filter(|(until, _)| Instant::now() < *until);
        resting.map(|(_, why)| &**why)
    }

    /// The name of a worker, with the beginning of its key: another one may say that it has the same name.
    pub fn label(&self, key: &str) -> String {
        let short: String = key.chars().take(8).collect();
        let name = self.known.get(key).map(|known| &*known.info.worker);
        name.map_or_else(|| format!("({short})"), |name| format!("{name} ({short})"))
    }

    /// The name of a worker.
    pub fn name(&self, key: &str) -> String {
        self.known.get(key).map_or_else(|| key.to_owned(), |known| known.info.worker.clone())
    }

    /// Names a worker in the log that does what none does. One that does it again and again fills no log.
    pub fn complain(&mut self, key: &str, what: &str) {
        metrics::counter!("raystream_refused_messages_total", "reason" => "not its own").increment(1);
        let label = self.label(key);
        let Some(known) = self.known.get_mut(key) else { return log::debug!("worker {label}: {what}") };
        known.complaints += 1;
        if known.complaints <= LOGGED || known.complaints.is_multiple_of(100) {
            log::warn!("worker {label}: {what} ({} complaints)", known.complaints);
        }
    }

    /// Takes note of a report. False if the worker is not known.
    pub fn report(&mut self, key: &str, report: &Report, lease: Duration) -> bool {
        let Some(known) = self.known.get_mut(key) else { return false };
        known.hear(lease);
        known.units = report.units.len();
        known.is_draining = report.is_draining;
        known.cache = report.cache;
        known.rays = report.rays;
        true
    }

    /// Takes note that a worker is there.
    pub fn seen(&mut self, key: &str, lease: Duration) {
        self.known.get_mut(key).into_iter().for_each(|known| known.hear(lease));
    }

    /// Takes note that a worker was given a unit, perhaps one that another had before.
    pub fn lent(&mut self, key: &str, is_again: bool) {
        let Some(known) = self.known.get_mut(key) else { return };
        known.owes_since.get_or_insert_with(Instant::now);
        known.redeliveries += u64::from(is_again);
    }

    /// Takes note that a worker has none of the units any more that it was given.
    pub fn has_none(&mut self, key: &str) {
        self.known.get_mut(key).into_iter().for_each(|known| known.owes_since = None);
    }

    /// Takes note that a worker has returned what it was asked for.
    pub fn returned(&mut self, key: &str) {
        self.fruitless.remove(key);
        if self.resting.remove(key).is_some() {
            log::info!("worker {}: it has returned a unit, and gets others again", self.label(key));
        }
        let known = self.known.get_mut(key);
        known.into_iter().for_each(|known| known.owes_since = known.owes_since.map(|_| Instant::now()));
    }

    /// Takes note that a worker gives a unit back. One that ends gives several back at once, which counts as one.
    pub fn gave_back(&mut self, key: &str, lease: Duration) {
        let Some(known) = self.known.get_mut(key) else { return };
        let is_one = known.gave_back.is_some_and(|last| last.elapsed() < lease / 5);
        if !is_one {
            known.gave_back = Some(Instant::now());
            self.failed(key, "it gives units back", lease);
        }
    }

    /// Takes note that a worker has lost or given back what it had, or has said what is not so.
    pub fn failed(&mut self, key: &str, what: &str, lease: Duration) {
        let count = self.fruitless.entry(key.to_owned()).or_default();
        *count += 1;
        let count = *count;
        if is_fruitless(None, count, lease) {
            self.rest(key, &format!("{what}, {count} times in a row"), lease);
        }
    }

    /// The workers that have had units for too long without returning any.
    pub fn debtors(&self, lease: Duration) -> Vec<String> {
        // Who cannot be heard holds nothing back: its lease ends by itself.
        let owes = |known: &Known| {
            known
                .owes_since
                .filter(|_| known.seen.elapsed() < SILENT_LEASES * lease)
                .map(|since| since.elapsed())
        };
        let debtors = self.known.iter().filter(|(_, known)| is_fruitless(owes(known), 0, lease));
        debtors.map(|(key, _)| key.clone()).collect()
    }

    /// Gives a worker no units for a while, or until it returns one that it still has.
    pub fn rest(&mut self, key: &str, why: &str, lease: Duration) {
        let rest = REST_LEASES * lease;
        let why = format!("{why}; it gets no units for {} s", rest.as_secs());
        log::error!("worker {}: {why}", self.label(key));
        self.fruitless.remove(key);
        self.has_none(key);
        self.resting.insert(key.to_owned(), (Instant::now() + rest, why));
    }

    /// Takes note that a worker has brought another picture of a scene, of a unit that it was given at a time. First it
    /// is to fetch the scene anew; then its process is sent home. Whether it is to fetch it.
    pub fn is_to_fetch_anew(
        &mut self,
        key: &str,
        scene: &str,
        given: Option<Instant>,
        lease: Duration,
    ) -> bool {
        let Some(known) = self.known.get_mut(key) else { return false };
        match known.foreign.get(scene) {
            // It had this unit when it was told.
            Some(told) if given.is_none_or(|given| given <= *told) => return true,
            Some(_) => {}
            None => {
                known.foreign.insert(scene.to_owned(), Instant::now());
                return true;
            }
        }
        let short: String = scene.chars().take(12).collect();
        let why = format!(
            "its picture of scene {short} is another, also after it has fetched the scene anew: its program or its \
             memory differs"
        );
        known.sent_home = Some(why.clone());
        self.rest(key, &why, lease);
        false
    }

    /// Takes note of a unit that a worker has rendered.
    pub fn done(&mut self, worker: &str, samples: u64, seconds: f64) {
        let Some(known) = self.known.get_mut(worker) else { return };
        known.done += 1;
        known.samples += samples;
        let now = samples as f64 / seconds.max(1e-4);
        known.speed = if known.speed == 0.0 { now } else { 0.8 * known.speed + 0.2 * now };
    }

    /// Takes note that a worker leaves.
    pub fn leave(&mut self, key: &str) {
        self.known.remove(key);
    }

    /// The number of units that a worker has brought.
    pub fn brought(&self, key: &str) -> u64 {
        self.known.get(key).map_or(0, |known| known.done)
    }

    /// The reason why a worker may take no units, if it is in quarantine.
    pub fn refusal(&self, key: &str) -> Option<&String> {
        self.quarantined.get(key).map(|(_, reason)| reason)
    }

    /// Lets a worker take no more units.
    pub fn quarantine(&mut self, key: &str, name: &str, reason: &str) {
        let entry = || (name.to_owned(), reason.to_owned());
        self.quarantined.entry(key.to_owned()).or_insert_with(entry);
    }

    /// Lets a worker take units again that was quarantined or rests. False if it was neither.
    pub fn trust(&mut self, key: &str) -> bool {
        self.fruitless.remove(key);
        self.known.get_mut(key).into_iter().for_each(|known| known.sent_home = None);
        self.quarantined.remove(key).is_some() | self.resting.remove(key).is_some()
    }

    /// True if a worker takes units and was heard of within a time.
    fn is_there(&self, key: &str, known: &Known, within: Duration) -> bool {
        !known.is_draining
            && known.seen.elapsed() < within
            && known.sent_home.is_none()
            && !self.quarantined.contains_key(key)
            && self.rests(key).is_none()
    }

    /// Forgets workers that are gone. Returns the number of the others that help and were heard of within a time, and
    /// their slots.
    pub fn slots(&mut self, within: Duration) -> (usize, usize) {
        self.known.retain(|_, known| known.seen.elapsed() < FORGOTTEN_AFTER);
        let there = self.known.iter().filter(|(key, known)| known.helps && self.is_there(key, known, within));
        there.fold((0, 0), |(count, slots), (_, known)| (count + 1, slots + known.info.slots as usize))
    }

    /// Lets the first so many workers help that were heard of within a time; the others stand by.
    pub fn invite(&mut self, most: usize, within: Duration) {
        self.most = Some(most);
        let there = self.known.iter().filter(|(key, known)| self.is_there(key, known, within));
        let mut places: Vec<u64> = there.map(|(_, known)| known.place).collect();
        let last =
            if places.len() > most && most > 0 { *places.select_nth_unstable(most - 1).1 } else { u64::MAX };
        self.known.values_mut().for_each(|known| known.helps = known.place <= last);
    }

    /// True if a worker is one of those that help.
    pub fn helps(&self, key: &str) -> bool {
        self.known.get(key).is_none_or(|known| known.helps)
    }

    /// True if a worker has returned a unit of a scene, so that it has the scene.
    pub fn has_scene(&self, key: &str, scene: &str) -> bool {
        self.known.get(key).is_some_and(|known| known.scenes.contains(scene))
    }

    /// The slots of the workers that have a scene and were heard of within a time.
    pub fn slots_with(&self, scene: &str, within: Duration) -> usize {
        let has = |known: &Known| known.scenes.contains(scene);
        let there = self.known.iter().filter(|(key, known)| has(known) && self.is_there(key, known, within));
        there.map(|(_, known)| known.info.slots as usize).sum()
    }

    /// Takes note that a worker has a scene.
    pub fn has_fetched(&mut self, key: &str, scene: &str) {
        let Some(known) = self.known.get_mut(key) else { return };
        if known.scenes.len() >= MOST_SCENES {
            known.scenes.clear();
        }
        known.scenes.insert(scene.to_owned());
    }

    /// True if a worker that is none of these takes units and was heard of within a time.
    pub fn has_other(&self, than: impl Fn(&str) -> bool, within: Duration) -> bool {
        self.known.iter().any(|(key, known)| !than(key) && self.is_there(key, known, within))
    }

    /// True if any worker was heard of within a time.
    pub fn is_any_heard(&self, within: Duration) -> bool {
        self.known.values().any(|known| known.seen.elapsed() < within)
    }

    /// Names and keys of the workers that were heard of within this time and render tiles of live views.
    pub fn live(&self, within: Duration) -> Vec<(String, String)> {
        let there = self.known.iter().filter(|(key, known)| self.is_there(key, known, within));
        let live = there.filter(|(_, known)| known.info.is_live);
        let mut live: Vec<_> = live.map(|(key, known)| (known.info.worker.clone(), key.clone())).collect();
        live.sort();
        live
    }

    /// All workers, by name: those that are known, and those in quarantine.
    pub fn shown(&self, within: Duration) -> Vec<ShownWorker> {
        let mut shown: Vec<ShownWorker> =
            self.known.iter().map(|(key, known)| self.show(key, known, within)).collect();
        let gone = self.quarantined.iter().filter(|(key, _)| !self.known.contains_key(*key));
        shown.extend(gone.map(|(key, (name, reason))| ShownWorker {
            name: name.clone(),
            key: key.clone(),
            state: QUARANTINED,
            reason: Some(reason.clone()),
            ..ShownWorker::default()
        }));
        shown.sort_by(|a, b| (&a.name, &a.key).cmp(&(&b.name, &b.key)));
        shown
    }

    fn show(&self, key: &str, known: &Known, within: Duration) -> ShownWorker {
        let quarantined = self.refusal(key).cloned();
        let rests = known.sent_home.as_deref().or_else(|| self.rests(key)).map(str::to_owned);
        let state = match () {
            () if quarantined.is_some() => QUARANTINED,
            () if rests.is_some() => "resting",
            () if known.seen.elapsed() >= within => "silent",
            () if known.is_draining => "draining",
            () if known.units > 0 => "busy",
            () if !known.helps => "standing by",
            () => "idle",
        };
        let reason = quarantined.or(rests);
        ShownWorker {
            name: known.info.worker.clone(),
            key: key.to_owned(),
            host: known.info.host.clone(),
            tracing: known.info.units.clone(),
            slots: known.info.slots,
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
    const STATES: [&str; 7] = ["busy", "idle", "standing by", "draining", "silent", "resting", QUARANTINED];

    /// The number of workers in each state.
    pub fn counts(workers: &[Self]) -> [(&'static str, usize); 7] {
        Self::STATES.map(|state| (state, workers.iter().filter(|worker| worker.state == state).count()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    fn join(workers: &mut Workers, key: &str) {
        let info = WorkerInfo {
            worker: key.into(),
            host: "here".into(),
            build: Build::own(),
            session: 1,
            slots: 2,
            units: "one".into(),
            is_live: false,
        };
        assert!(matches!(workers.join(key, info, LONG).0, JoinReply::Joined { .. }));
    }

    #[test]
    fn the_first_to_join_help_and_the_next_one_does_when_one_leaves() {
        let mut workers = Workers::default();
        ["a", "b", "c", "d"].iter().for_each(|key| join(&mut workers, key));
        assert_eq!(workers.slots(LONG), (4, 8));
        let helping = |workers: &mut Workers, most| {
            workers.invite(most, LONG);
            ["a", "b", "c", "d"].map(|key| workers.helps(key))
        };
        assert_eq!(helping(&mut workers, 2), [true, true, false, false]);
        assert_eq!(workers.slots(LONG), (2, 4));
        // Who joins again keeps its place; who rests has none.
        join(&mut workers, "a");
        assert_eq!(helping(&mut workers, 1), [true, false, false, false]);
        workers.rest("a", "a test", LONG);
        assert_eq!(helping(&mut workers, 2)[1..], [true, true, false]);
        workers.leave("b");
        assert_eq!(helping(&mut workers, 2)[2..], [true, true]);
        assert_eq!(helping(&mut workers, usize::MAX), [true; 4]);
        let shown = workers.shown(LONG);
        assert!(shown.iter().all(|worker| worker.state != "standing by"));
        workers.invite(1, LONG);
        join(&mut workers, "e");
        assert!(!workers.helps("e"), "who joins later does not help until it is decided anew");
        workers.leave("e");
        assert_eq!(ShownWorker::counts(&workers.shown(LONG))[2], ("standing by", 1));
    }

    #[test]
    fn who_has_returned_a_unit_has_its_scene() {
        let mut workers = Workers::default();
        ["a", "b"].iter().for_each(|key| join(&mut workers, key));
        workers.has_fetched("a", "s");
        assert!(workers.has_scene("a", "s") && !workers.has_scene("b", "s") && !workers.has_scene("a", "t"));
        assert_eq!((workers.slots_with("s", LONG), workers.slots_with("t", LONG)), (2, 0));
    }

    #[test]
    fn who_brings_another_picture_again_after_it_has_fetched_the_scene_is_sent_home() {
        let mut workers = Workers::default();
        ["a", "b"].iter().for_each(|key| join(&mut workers, key));
        let before = Instant::now();
        assert!(workers.is_to_fetch_anew("a", "s", Some(before), LONG));
        assert!(workers.is_to_fetch_anew("a", "s", Some(before), LONG), "it had this unit when it was told");
        assert!(workers.is_to_fetch_anew("a", "t", Some(Instant::now()), LONG), "that is another scene");
        assert_eq!(workers.slots(LONG), (2, 4));
        assert!(!workers.is_to_fetch_anew("a", "s", Some(Instant::now()), LONG));
        assert_eq!(workers.slots(LONG), (1, 2));
        let told = |workers: &Workers| match workers.standing("a", 1) {
            Standing::Refused(why) => why,
            _ => String::new(),
        };
        assert!(told(&workers).contains("also after it has fetched the scene anew"));
        assert!(matches!(workers.standing("b", 1), Standing::Welcome(2)));
        assert!(workers.trust("a") && told(&workers).is_empty(), "people may let it in again");
    }
}

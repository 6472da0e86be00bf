//! Units on their way: which there are, who has them, and when they are given to someone else.

use super::decisions::{self, Asked, Holding, MOST_ATTEMPTS, Taking, UnitRow};
use super::ledger::JobState;
use super::task::Task;
use super::workers::Standing;
use super::{Run, Runner, State};
use crate::contract::{Granted, Held, Leased, MOST_SLOTS, Unit, UnitId, Wanted};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often is looked for units whose holders are gone.
const SWEEP: Duration = Duration::from_millis(250);

/// A unit that workers may have, and who has it.
pub(super) struct Outstanding {
    /// The place in the order in which units are given out: true if the job is not interactive, since such units come
    /// later; then the place in the order in which they were offered.
    pub order: (bool, u64),
    pub unit: Arc<Unit>,
    pub row: UnitRow,
    pub holders: Vec<Holder>,
    /// The number of times that it was given to a worker, as far as this process knows.
    pub deliveries: u64,
    /// The keys of those that said that they cannot render it, and why.
    pub failed: Vec<(String, String)>,
    /// The keys of those that fell silent or ended while they had it, and how often that has happened.
    pub lost: HashMap<String, u32>,
    /// The rendering of another worker with which this one is compared, if it is a second one.
    pub compared: Option<Comparison>,
    /// True if this process renders it.
    pub is_home: bool,
}

/// Who has a unit.
#[derive(Debug)]
pub(super) struct Holder {
    pub key: String,
    pub since: Instant,
    pub seen: Instant,
}

/// A unit that two workers render.
#[derive(Clone, Debug)]
pub(super) struct Comparison {
    /// Its name as a second rendering.
    pub id: UnitId,
    pub row: UnitRow,
    pub blocks: Vec<u32>,
    /// The worker that was first: its key, its name, and the digest of its sums.
    pub first: Party,
}

/// Who has rendered a unit, and the digest of what it has become.
#[derive(Clone, Debug)]
pub(super) struct Party {
    pub key: String,
    pub name: String,
    pub digest: String,
}

impl Outstanding {
    /// A unit that no one has.
    pub fn new(order: (bool, u64), unit: Arc<Unit>, row: UnitRow, compared: Option<Comparison>) -> Self {
        Self {
            order,
            unit,
            row,
            holders: Vec::new(),
            deliveries: 0,
            failed: Vec::new(),
            lost: HashMap::new(),
            compared,
            is_home: false,
        }
    }

    /// True if any worker may render it: it is no second rendering, and no worker has failed at it.
    fn is_plain(&self) -> bool {
        self.compared.is_none() && self.failed.is_empty() && self.lost.is_empty()
    }

    fn holder(&self, key: &str) -> Option<&Holder> {
        self.holders.iter().find(|holder| holder.key == key)
    }

    /// True if a worker could not render it before, or has rendered it already.
    fn is_no_good(&self, key: &str) -> bool {
        let has_failed = self.failed.iter().any(|(failed, _)| failed == key);
        has_failed
            || self.lost.contains_key(key)
            || self.compared.as_ref().is_some_and(|first| first.first.key == key)
    }

    /// What becomes of a unit when the worker of a key asks for one.
    fn taking(&self, key: &str, state: &State, lease: Duration) -> Taking {
        if self.is_home {
            return Taking::No;
        }
        let holding = |holder: &Holder| Holding {
            is_asker: holder.key == key,
            silent: holder.seen.elapsed(),
            held: holder.since.elapsed(),
        };
        let holdings: Vec<Holding> = self.holders.iter().map(holding).collect();
        let is_own = self.compared.as_ref().is_some_and(|first| first.first.key == key);
        let has_failed = self.failed.iter().any(|(failed, _)| failed == key)
            || self.lost.contains_key(key) && state.workers.has_other(|other| self.is_no_good(other), lease);
        decisions::taking(&Asked { holdings: &holdings, is_own, has_failed }, lease, lease)
    }
}

impl Runner {
    /// The token of a worker's lease.
    fn token(&self, id: &UnitId, key: &str) -> String {
        self.secret.token(&id.to_string(), key)
    }

    /// True if a worker was given a unit, by this process or an earlier one.
    pub(super) fn is_holder(&self, key: &str, held: &Held) -> bool {
        self.secret.is_token(&held.unit.to_string(), key, &held.token)
    }

    /// Gives a unit to a worker that asks for one.
    pub(super) fn grant(&self, key: &str, wanted: &Wanted) -> Granted {
        let lease = self.bus.lease_time();
        let state = &mut *self.state();
        state.workers.seen(key, lease);
        let slots = match state.workers.standing(key, wanted.session) {
            Standing::Unknown => return Granted::Unknown,
            Standing::Refused(why) => return Granted::Refused(why),
            Standing::Rests(why) => return Granted::Rests(why),
            Standing::Welcome(slots) => slots,
        };
        if wanted.have.len() > MOST_SLOTS as usize {
            state.workers.complain(key, "it says that it has more units than any worker");
            return Granted::None;
        }
        let is_lost =
            |unit: &&mut Outstanding| unit.holder(key).is_some() && !wanted.have.contains(&unit.unit.id);
        let has = state.outstanding.values().filter(|unit| unit.holder(key).is_some()).count();
        let again = state.outstanding.values_mut().find(is_lost);
        let unit = match again {
            // The answer was lost.
            Some(unit) => Arc::clone(&unit.unit),
            None if has >= slots => return Granted::None,
            None => {
                // What others cannot do is for those that stand by, too.
                let stands_by = !state.workers.helps(key);
                let late = Self::too_late(key, state, lease);
                let taking = |unit: &Outstanding| match unit.taking(key, state, lease) {
                    _ if unit.is_plain() && (stands_by || late.contains(&unit.unit.id.job)) => {
                        (Taking::No, unit.order)
                    }
                    taking => (taking, unit.order),
                };
                let best = state.outstanding.values().min_by_key(|unit| taking(unit));
                let best = best.filter(|unit| taking(unit).0 != Taking::No);
                let Some(id) = best.map(|unit| unit.unit.id.clone()) else {
                    if stands_by && has == 0 {
                        return Granted::StandBy;
                    }
                    state.is_hungry = true;
                    return Granted::None;
                };
                let Some(unit) = state.outstanding.get_mut(&id) else { return Granted::None };
                unit.deliveries += 1;
                let now = Instant::now();
                unit.holders.push(Holder { key: key.to_owned(), since: now, seen: now });
                let is_again = unit.deliveries > 1;
                if is_again {
                    metrics::counter!("raystream_redeliveries_total").increment(1);
                }
                let (unit, times) = (Arc::clone(&unit.unit), unit.deliveries);
                state.workers.lent(key, is_again);
                log::debug!(
                    "{}: given to worker {} (the {times}. time)",
                    state.subject(&id),
                    state.workers.label(key)
                );
                unit
            }
        };
        let token = self.token(&unit.id, key);
        Granted::Unit(Box::new(Leased { unit: (*unit).clone(), token }))
    }

    /// The jobs whose scenes a worker does not have and would have too late.
    fn too_late(key: &str, state: &State, lease: Duration) -> HashSet<String> {
        let lacks = |run: &&Run| !run.frames.is_empty() && !state.workers.has_scene(key, &run.job.scene);
        let is_late = |run: &&Run| {
            let scene = &run.job.scene;
            let units = state.outstanding.values().filter(|unit| unit.unit.scene == *scene);
            let holders = units.flat_map(|unit| &unit.holders).map(|holder| &*holder.key);
            let fetching: HashSet<&str> =
                holders.filter(|other| *other != key && !state.workers.has_scene(other, scene)).collect();
            let slots = state.workers.slots_with(scene, lease) + fetching.len();
            !state.measured.is_to_fetch(run.scene_bytes, run.rest_s(), fetching.len(), slots)
        };
        state.runs.values().filter(lacks).filter(is_late).map(|run| run.job.id.clone()).collect()
    }

    /// Takes a unit back that a worker returns without sums.
    pub(super) fn take_back(&self, key: &str, held: &Held) {
        if !self.is_holder(key, held) {
            return self.state().workers.complain(key, "it gives back a unit that it was not given");
        }
        let lease = self.bus.lease_time();
        let state = &mut *self.state();
        let Some(unit) = state.outstanding.get_mut(&held.unit) else { return };
        let before = unit.holders.len();
        unit.holders.retain(|holder| holder.key != key);
        if unit.holders.len() < before {
            state.workers.gave_back(key, lease);
            state.settle(key);
            self.ring(state);
        }
    }

    /// Takes all units from a worker whose process has ended or has begun again.
    pub(super) fn take_all(&self, key: &str, why: &str) {
        let lost = self.state().release(key);
        if lost.is_empty() {
            return;
        }
        self.state().workers.failed(key, why, self.bus.lease_time());
        self.count_losses(lost.into_iter().map(|id| (id, key.to_owned())).collect());
        self.ring(&mut self.state());
    }

    /// Tells workers that wait that there are units, if there are such workers.
    pub(super) fn ring(&self, state: &mut State) {
        if std::mem::take(&mut state.is_hungry) {
            self.bus.ring();
        }
    }

    /// Takes units from workers that are silent, gives no more to those that return nothing, and renders here what no
    /// worker can.
    pub(super) fn sweep(&self) {
        let lease = self.bus.lease_time();
        let mut state = self.state();
        let now = Instant::now();
        let last = state.swept.replace(now);
        if last.is_some_and(|last| now - last < SWEEP) {
            state.swept = last;
            return;
        }
        if state.outstanding.is_empty() {
            return;
        }
        let own = &mut *state;
        let slept = last.is_some_and(|last| now - last > lease / 2);
        if slept || !own.workers.is_any_heard(lease) {
            // This process slept, or the bus is down: no one can be blamed, and no one else is there.
            own.outstanding
                .values_mut()
                .flat_map(|unit| &mut unit.holders)
                .for_each(|holder| holder.seen = now);
            return;
        }
        let mut lost = Vec::new();
        for unit in own.outstanding.values_mut() {
            let id = &unit.unit.id;
            let gone = unit.holders.extract_if(.., |holder| holder.seen.elapsed() > lease);
            lost.extend(gone.map(|holder| (id.clone(), holder.key)));
        }
        let silent: HashSet<&String> = lost.iter().map(|(_, key)| key).collect();
        for key in silent {
            own.workers.failed(key, "it falls silent with units", lease);
            own.settle(key);
        }
        for key in own.workers.debtors(lease) {
            own.release(&key);
            let why = format!("it has had units for {} s and has returned none", (3 * lease).as_secs());
            own.workers.rest(&key, &why, lease);
            own.is_hungry = true;
        }
        let homeless = own.homeless(lease);
        let has_lost = !lost.is_empty();
        if has_lost {
            own.is_hungry = true;
        }
        self.ring(own);
        drop(state);
        self.count_losses(lost);
        for id in homeless {
            self.render_home(&id);
        }
    }

    /// Counts that holders of units have gone. Too many have: perhaps the units end them.
    fn count_losses(&self, lost: Vec<(UnitId, String)>) {
        for (id, key) in lost {
            metrics::counter!("raystream_units_offered_again_total").increment(1);
            let mut state = self.state();
            let label = state.workers.label(&key);
            log::info!("{}: worker {label} has gone; others may have it", state.subject(&id));
            let Some(unit) = state.outstanding.get_mut(&id) else { continue };
            *unit.lost.entry(key.clone()).or_default() += 1;
            let losses = decisions::losses(unit.lost.values().copied());
            let (row, is_compared) = (unit.row.clone(), unit.compared.is_some());
            drop(state);
            if is_compared {
                continue;
            }
            let workers = self.ledger.note_attempt(&id.job, &row, &key);
            let workers = workers.unwrap_or_else(|error| {
                log::warn!("job {}: {error}", id.job);
                0
            });
            if workers >= MOST_ATTEMPTS || losses >= MOST_ATTEMPTS {
                let state = self.state();
                let unit = state.outstanding.get(&id);
                let has_other = unit.is_some_and(|unit| {
                    state.workers.has_other(|key| unit.is_no_good(key), self.bus.lease_time())
                });
                drop(state);
                if workers >= MOST_ATTEMPTS || !has_other {
                    let count = losses.max(workers);
                    let why = "the workers that rendered it ended or fell silent";
                    self.fail_job(&id, &format!("has failed {count} times: {why}"));
                }
            }
        }
    }

    /// Lets a job fail because of a unit.
    fn fail_job(&self, id: &UnitId, what: &str) {
        let active = &[JobState::Queued, JobState::Running];
        let told = format!("a unit of frame {} {what}", id.frame);
        log::warn!("{}: {told}", self.state().subject(id));
        let failed = self.ledger.set_state(&id.job, active, JobState::Failed, Some(told));
        failed.map(drop).unwrap_or_else(|error| log::warn!("job {}: {error}", id.job));
    }

    /// Lets this process render a unit that no worker can, or compare what no other worker can.
    pub(super) fn render_home(&self, id: &UnitId) {
        let mut state = self.state();
        let Some(unit) = state.outstanding.get_mut(id).filter(|unit| !unit.is_home) else { return };
        unit.is_home = true;
        let (row, blocks) = (unit.row.clone(), unit.unit.blocks.clone());
        let task = match &unit.compared {
            Some(first) => {
                Task::Arbitrate { id: id.clone(), row, blocks, parties: vec![first.first.clone()] }
            }
            None => Task::Prove { id: id.clone(), row, blocks, failed: unit.failed.clone() },
        };
        let Some(run) = state.runs.get(&id.job) else { return };
        let (job, under_way) = (run.job.clone(), run.tasks.iter().map(|task| task.0).collect::<Vec<_>>());
        drop(state);
        self.give(&job, task, &under_way);
    }
}

impl State {
    /// A unit, its job and the request that submitted it, as lines of the log begin.
    pub fn subject(&self, id: &UnitId) -> String {
        let run = self.runs.get(&id.job);
        let job = run.map_or_else(|| format!("job {}", id.job), |run| run.job.subject());
        format!("{job}, unit {id}")
    }

    /// Takes all units from a worker. Returns which.
    fn release(&mut self, key: &str) -> Vec<UnitId> {
        let mut released = Vec::new();
        for unit in self.outstanding.values_mut() {
            let before = unit.holders.len();
            unit.holders.retain(|holder| holder.key != key);
            if unit.holders.len() < before {
                released.push(unit.unit.id.clone());
            }
        }
        self.workers.has_none(key);
        released
    }

    /// Takes note if a worker has no units any more.
    pub fn settle(&mut self, key: &str) {
        if !self.outstanding.values().any(|unit| unit.holder(key).is_some()) {
            self.workers.has_none(key);
        }
    }

    /// Units that no worker that is there can render, though some have tried, and comparisons that no other worker can
    /// make.
    fn homeless(&self, lease: Duration) -> Vec<UnitId> {
        let is_homeless = |unit: &&Outstanding| {
            let is_tried = !unit.failed.is_empty() || unit.compared.is_some();
            !unit.is_home
                && is_tried
                && unit.holders.is_empty()
                && (unit.failed.len() >= MOST_ATTEMPTS as usize
                    || !self.workers.has_other(|key| unit.is_no_good(key), lease))
        };
        self.outstanding.values().filter(is_homeless).map(|unit| unit.unit.id.clone()).collect()
    }

    /// Takes note that the service could not render a unit now.
    pub fn is_not_home(&mut self, id: &UnitId) {
        self.outstanding.get_mut(id).into_iter().for_each(|unit| unit.is_home = false);
    }

    /// Forgets the units of a frame, which begins anew or is finished.
    pub fn forget_frame(&mut self, job: &str, frame: u32) {
        let is_of = |id: &UnitId| id.job == job && id.frame == frame;
        self.comparisons.retain(|comparison| !is_of(&comparison.id));
        self.forget(|id| !is_of(id));
    }

    /// Forgets units unless they are to be kept.
    pub fn forget(&mut self, keeps: impl Fn(&UnitId) -> bool) {
        let mut holders = HashSet::new();
        self.outstanding.retain(|id, unit| {
            let keeps = keeps(id);
            if !keeps {
                holders.extend(unit.holders.drain(..).map(|holder| holder.key));
            }
            keeps
        });
        holders.iter().for_each(|key| self.settle(key));
    }
}

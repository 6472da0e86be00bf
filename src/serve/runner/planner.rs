//! Decides what is done next: which frames are open, which units are offered, which are offered again.

use super::decisions::{self, Candidate, PLANNER_PAUSE, Share, Sizes, UnitRow};
use super::frame::OpenFrame;
use super::task::{Task, TaskKey};
use super::{NAP, Outstanding, Run, Runner, State, UNITS_IN_FLIGHT};
use crate::farm::{Backlog, Lane, Offered, Unit, UnitId, UnitWatch};
use crate::schedule::Priority;
use crate::serve::Kind;
use crate::serve::api::JobRequest;
use crate::serve::ledger::{Job, JobState, LedgerError};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// Active jobs that are looked at for the next unit.
const LOOKED_AT: usize = 64;

/// How often the bus is asked what it holds.
const RECONCILE: Duration = Duration::from_millis(500);

/// A unit that is about to be offered.
struct Offer {
    id: UnitId,
    job: Job,
    row: UnitRow,
    blocks: Vec<u32>,
    frame: Option<Arc<OpenFrame>>,
    is_new: bool,
}

impl Runner {
    /// The planner's thread.
    pub(super) fn plan_jobs(&self) {
        let mut seen = 0;
        while !self.ending.load(SeqCst) {
            let planned = self.plan_once();
            if let Err(error) = planned {
                log::warn!("{error}; the next try is in {} s", NAP.as_secs());
                std::thread::sleep(NAP / 4);
            }
            let state = self.state();
            if state.wakes == seen && !self.ending.load(SeqCst) {
                drop(self.changed.wait_timeout(state, PLANNER_PAUSE));
                seen = self.state().wakes;
            } else {
                seen = state.wakes;
            }
        }
    }

    fn plan_once(&self) -> Result<(), LedgerError> {
        let jobs = self.ledger.active(LOOKED_AT)?;
        self.note_jobs(&jobs);
        for job in &jobs {
            self.give_tasks(job)?;
        }
        self.offer_units()?;
        self.reconcile();
        Ok(())
    }

    /// Takes note of jobs. Those that are not active any more are forgotten; what the bus has of them is skipped when a
    /// worker asks.
    fn note_jobs(&self, jobs: &[Job]) {
        let state = &mut *self.state();
        let active: HashSet<&str> = jobs.iter().map(|job| &*job.id).collect();
        state.runs.retain(|id, run| {
            let is_kept = active.contains(&**id) || !run.tasks.is_empty();
            if !active.contains(&**id) {
                run.frames.clear();
                run.has_more = false;
            }
            is_kept
        });
        let entry = decisions::entry(state.runs.values().map(|run| run.given));
        for job in jobs {
            let run = state.runs.entry(job.id.clone()).or_insert_with(|| Run {
                job: job.clone(),
                given: entry,
                speed: Default::default(),
                frames: BTreeMap::new(),
                has_more: false,
                tasks: Vec::new(),
                rests_until: None,
            });
            run.job = job.clone();
            run.frames.retain(|_, frame| !frame.is_broken());
        }
        let runs = &state.runs;
        let is_open = |id: &UnitId| runs.get(&id.job).is_some_and(|run| run.frames.contains_key(&id.frame));
        state.outstanding.retain(|id, _| is_open(id));
        state.comparisons.retain(|comparison| is_open(&comparison.id));
    }

    /// Gives the threads what is to be done for a job besides units.
    fn give_tasks(&self, job: &Job) -> Result<(), LedgerError> {
        let (under_way, open, complete) = {
            let state = self.state();
            let Some(run) = state.runs.get(&job.id) else { return Ok(()) };
            if run.rests_until.is_some_and(|until| Instant::now() < until) {
                return Ok(());
            }
            let under_way: Vec<TaskKey> = run.tasks.iter().map(|task| task.0).collect();
            let is_judged = |number: u32| {
                !under_way
                    .iter()
                    .any(|key| matches!(key, TaskKey::Arbitrate { frame, .. } if *frame == number))
            };
            let is_ready = |frame: &&Arc<OpenFrame>| {
                let is_compared = |id: &UnitId| id.copy > 0 && id.job == job.id && id.frame == frame.frame;
                !state.outstanding.keys().any(is_compared)
                    && !state.comparisons.iter().any(|comparison| is_compared(&comparison.id))
                    && is_judged(frame.frame)
                    && frame.is_complete()
            };
            let complete: Vec<Arc<OpenFrame>> = run.frames.values().filter(is_ready).cloned().collect();
            (under_way, run.frames.keys().copied().collect::<Vec<u32>>(), complete)
        };
        if !job.is_planned {
            self.give(job, Task::Plan, &under_way);
            return Ok(());
        }
        for frame in complete {
            self.give(job, Task::Finish(frame), &under_way);
        }
        let most = open.len() + under_way.len() + 1;
        let frames = self.ledger.open_frames(&job.id, most)?;
        if frames.is_empty() && under_way.is_empty() {
            return self.ledger.finish_if_whole(&job.id);
        }
        let is_busy = |frame: u32| {
            let of_frame = |key: &TaskKey| key.frame() == Some(frame);
            open.contains(&frame) || under_way.iter().any(of_frame)
        };
        let next = frames.into_iter().find(|frame| !is_busy(*frame));
        if let Some(run) = self.state().runs.get_mut(&job.id) {
            run.has_more = next.is_some();
        }
        let Some(frame) = next else { return Ok(()) };
        if job.demand.kind == Kind::Seconds {
            if under_way.len() < UNITS_IN_FLIGHT as usize {
                self.give(job, Task::Whole { frame }, &under_way);
            }
        } else if self.wants_frame(job, open.len()) {
            self.give(job, Task::Open { frame }, &under_way);
        }
        Ok(())
    }

    /// Whether another frame of a job is to be opened: if it has none, or those that are open have too few units.
    fn wants_frame(&self, job: &Job, open: usize) -> bool {
        let state = self.state();
        let opening =
            |run: &Run| run.tasks.iter().filter(|task| matches!(task.0, TaskKey::Open { .. })).count();
        let all: usize = state.runs.values().map(|run| run.frames.len() + opening(run)).sum();
        let own = state.runs.get(&job.id).map_or(0, opening);
        decisions::wants_frame(open, own, all, state.is_short)
    }

    /// Gives a task to the threads, unless it is under way.
    pub(super) fn give(&self, job: &Job, task: Task, under_way: &[TaskKey]) {
        let key = task.key();
        if under_way.contains(&key) {
            return;
        }
        let watch = Arc::new(UnitWatch::new(job.priority));
        let mut state = self.state();
        let Some(run) = state.runs.get_mut(&job.id) else { return };
        run.tasks.push((key, Arc::clone(&watch)));
        drop(state);
        let mut queued = self.queued.lock().expect("no holder panics");
        match task {
            Task::Finish(_) => queued.push_front((job.clone(), task, watch)),
            _ => queued.push_back((job.clone(), task, watch)),
        }
        drop(queued);
        self.has_queued.notify_one();
    }

    /// Offers units until enough are outstanding, in fair shares.
    fn offer_units(&self) -> Result<(), LedgerError> {
        let offers = self.choose_units();
        let mut cut: HashMap<String, Vec<UnitRow>> = HashMap::new();
        for offer in offers.iter().filter(|offer| offer.is_new) {
            cut.entry(offer.job.id.clone()).or_default().push(offer.row.clone());
        }
        for (job, rows) in cut {
            if let Err(error) = self.ledger.add_units(&job, rows) {
                // What was cut is not known, so it is cut again.
                offers.iter().filter_map(|offer| offer.frame.as_ref()).for_each(|frame| frame.break_off());
                offers.iter().for_each(|offer| drop(self.state().outstanding.remove(&offer.id)));
                return Err(error);
            }
        }
        for offer in offers {
            self.offer(&offer);
        }
        Ok(())
    }

    /// Chooses units and takes note of them.
    fn choose_units(&self) -> Vec<Offer> {
        let state = &mut *self.state();
        let heard = self.bus.lease_time().max(Duration::from_secs(2));
        let slots = state.workers.slots(heard);
        let wanted = decisions::wanted(slots);
        let open = state.runs.values().map(|run| run.frames.len()).sum();
        let more = state.runs.values().any(|run| run.has_more);
        let sizes = self.sizes(decisions::at_once(slots, open, more));
        let mut offers = Vec::new();
        while state.outstanding.len() < wanted
            && let Some(offer) = next_comparison(state).or_else(|| next_unit(state, sizes))
        {
            let outstanding =
                Outstanding { changed: Instant::now(), deliveries: 0, holder: None, compared: None };
            state.outstanding.entry(offer.id.clone()).or_insert(outstanding);
            offers.push(offer);
        }
        state.is_short = state.outstanding.len() < wanted;
        offers
    }

    /// Offers a unit on the bus.
    fn offer(&self, offer: &Offer) {
        let Offer { id, job, row, blocks, frame, .. } = offer;
        let Some(request) = JobRequest::of(job) else { return };
        let unit = Unit {
            id: id.clone(),
            scene: request.scene,
            entry: request.entry,
            spec: request.spec,
            priority: job.priority.name().into(),
            blocks: blocks.clone(),
            samples: row.first..row.end,
        };
        let lane = if job.priority == Priority::Interactive { Lane::Hi } else { Lane::Lo };
        let offered = self.bus.offer(lane, &unit, self.rounds.fetch_add(1, SeqCst));
        if matches!(offered, Ok(Offered::New | Offered::Duplicate)) {
            return;
        }
        if let Err(error) = offered {
            log::debug!("unit {id}: {error}");
        }
        self.state().outstanding.remove(id);
        if let Some(frame) = frame {
            frame.put_back(row.pass, row.number);
        }
    }

    /// Finds units that the bus has lost or that no one has, and lets them be offered again.
    fn reconcile(&self) {
        let mut state = self.state();
        let now = Instant::now();
        if state.reconciled.is_some_and(|last| now - last < RECONCILE) || state.outstanding.is_empty() {
            return;
        }
        state.reconciled = Some(now);
        drop(state);
        let Ok(Backlog { units, is_new }) = self.bus.backlog() else { return };
        let lease = self.bus.lease_time();
        let state = &mut *self.state();
        let held = state.outstanding.values().filter(|unit| unit.holder.is_some()).count();
        let patience = decisions::patience(is_new, units, held, state.workers.slots(lease), lease);
        let is_lost = |unit: &Outstanding| {
            let silent = unit.holder.as_ref().map(|holder| holder.seen.elapsed());
            decisions::is_lost(silent, unit.changed.elapsed(), lease, patience)
        };
        let lost: Vec<UnitId> =
            state.outstanding.iter().filter(|(_, unit)| is_lost(unit)).map(|(id, _)| id.clone()).collect();
        for id in lost {
            metrics::counter!("raystream_units_offered_again_total").increment(1);
            log::info!("unit {id}: no one has it; it is offered again");
            let Some(unit) = state.outstanding.remove(&id) else { continue };
            match unit.compared {
                Some(comparison) => state.comparisons.push_back(comparison),
                None => {
                    let frame = state.runs.get(&id.job).and_then(|run| run.frames.get(&id.frame)).cloned();
                    frame.inspect(|frame| frame.put_back(id.pass, id.number));
                }
            }
        }
    }
}

impl Share for &mut Run {
    fn candidate(&self) -> Candidate {
        Candidate { priority: self.job.priority, given: self.given, seq: self.job.seq }
    }

    fn give(&mut self, samples: u64) {
        self.given += samples;
    }
}

/// A unit that a second worker is to render.
fn next_comparison(state: &mut State) -> Option<Offer> {
    let comparison = state.comparisons.pop_front()?;
    let job = state.runs.get(&comparison.id.job)?.job.clone();
    let (id, row, blocks) = (comparison.id.clone(), comparison.row.clone(), comparison.blocks.clone());
    let outstanding =
        Outstanding { changed: Instant::now(), deliveries: 0, holder: None, compared: Some(comparison) };
    state.outstanding.insert(id.clone(), outstanding);
    Some(Offer { id, job, row, blocks, frame: None, is_new: false })
}

/// The next unit of the job whose turn it is.
fn next_unit(state: &mut State, sizes: Sizes) -> Option<Offer> {
    let mut runs: Vec<&mut Run> = state.runs.values_mut().filter(|run| !run.frames.is_empty()).collect();
    decisions::next(&mut runs, |run| {
        run.frames.values().find_map(|frame| {
            let (row, blocks, is_new) = frame.take(sizes, run.speed)?;
            let samples = row.samples();
            let (id, frame) = (frame.id(&row), Some(Arc::clone(frame)));
            Some((Offer { id, job: run.job.clone(), row, blocks, frame, is_new }, samples))
        })
    })
}

/// Whether a job is worked on in this state.
pub(super) fn is_active(state: JobState) -> bool {
    matches!(state, JobState::Queued | JobState::Running)
}

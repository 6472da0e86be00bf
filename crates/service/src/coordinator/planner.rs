//! Decides what is done next: which frames are open, which units workers may have.

use super::decisions::{self, Candidate, PLANNER_PAUSE, Share, Sizes, UnitRow};
use super::frame::OpenFrame;
use super::ledger::{Job, JobState, LedgerError};
use super::lending::{Comparison, Outstanding};
use super::request::JobRequest;
use super::task::{Task, TaskKey};
use super::{NAP, Run, Runner, State, UNITS_IN_FLIGHT};
use crate::backend::StopRule;
use crate::contract::{Unit, UnitId, UnitWatch};
use raystream::schedule::Priority;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// Active jobs that are looked at for the next unit.
const LOOKED_AT: usize = 64;

/// A unit that workers are about to be allowed to have.
struct Offer {
    id: UnitId,
    job: Job,
    row: UnitRow,
    blocks: Vec<u32>,
    frame: Option<Arc<OpenFrame>>,
    is_new: bool,
    compared: Option<Comparison>,
}

impl Runner {
    /// The planner's thread.
    pub(super) fn plan_jobs(&self) {
        let mut seen = 0;
        while !self.ending.load(SeqCst) {
            let planned = self.plan_once();
            self.state().plans += 1;
            if let Err(error) = planned {
                self.trouble.note(&error.to_string());
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
        self.sweep();
        Ok(())
    }

    /// Takes note of jobs. Those that are not active any more are forgotten; workers stop their units when they report.
    fn note_jobs(&self, jobs: &[Job]) {
        // The ledger is read before the state is locked.
        let is_new = |job: &&Job| !self.state().runs.contains_key(&job.id);
        let begun: HashMap<&str, (f64, u64)> =
            jobs.iter().filter(is_new).map(|job| (&*job.id, self.begun(job))).collect();
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
                kept: begun.get(&*job.id).map_or(0.0, |begun| begun.0),
                scene_bytes: begun.get(&*job.id).map_or(0, |begun| begun.1),
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
        let open: HashSet<(String, u32, u32)> = runs
            .iter()
            .flat_map(|(job, run)| run.frames.values().map(|frame| (job.clone(), frame.frame, frame.round)))
            .collect();
        let is_open = |id: &UnitId| open.contains(&(id.job.clone(), id.frame, id.round));
        state.comparisons.retain(|comparison| is_open(&comparison.id));
        state.forget(is_open);
    }

    /// The samples that the ledger knows of a job, and the bytes of its scene.
    fn begun(&self, job: &Job) -> (f64, u64) {
        let share = self.ledger.totals(&job.id).map_or(0.0, |totals| totals.share);
        let bytes = self.ledger.scene(&job.scene).ok().flatten().unwrap_or(0);
        (share * job.demand.samples() as f64, bytes)
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
                !under_way.iter().any(|key| matches!(key, TaskKey::Judge { frame, .. } if *frame == number))
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
        if job.demand.kind == StopRule::Seconds {
            if under_way.len() < UNITS_IN_FLIGHT as usize {
                self.give(job, Task::Whole { frame }, &under_way);
            }
        } else if self.wants_frame(job, open.len()) {
            self.give(job, Task::Open { frame }, &under_way);
        }
        Ok(())
    }

    /// True if another frame of a job is to be opened: if it has none, or those that are open have too few units.
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

    /// Lets workers have units until enough are outstanding, in fair shares.
    fn offer_units(&self) -> Result<(), LedgerError> {
        let offers = self.choose_units();
        let mut cut: HashMap<String, Vec<(u32, UnitRow)>> = HashMap::new();
        for offer in offers.iter().filter(|offer| offer.is_new) {
            cut.entry(offer.job.id.clone()).or_default().push((offer.id.round, offer.row.clone()));
        }
        for (job, rows) in cut {
            if let Err(error) = self.ledger.add_units(&job, rows) {
                // What was cut is not known, so it is cut again.
                offers.iter().filter_map(|offer| offer.frame.as_ref()).for_each(|frame| frame.break_off());
                return Err(error);
            }
        }
        let state = &mut *self.state();
        let some = !offers.is_empty();
        for offer in offers {
            state.offer(offer);
        }
        if some {
            self.ring(state);
        }
        Ok(())
    }

    /// Chooses units.
    fn choose_units(&self) -> Vec<Offer> {
        let state = &mut *self.state();
        let heard = self.bus.lease_time().max(Duration::from_secs(2));
        let open = state.runs.values().map(|run| run.frames.len()).sum();
        let more = state.runs.values().any(|run| run.has_more);
        let most = self.farm.most_workers.unwrap_or(usize::MAX);
        state.invite(if more { decisions::OPEN_FRAMES } else { open }, most, heard);
        let (_, slots) = state.workers.slots(heard);
        let wanted = decisions::wanted(slots);
        let sizes = self.sizes(decisions::at_once(slots, open, more));
        let mut offers: Vec<Offer> = Vec::new();
        while state.outstanding.len() + offers.len() < wanted
            && let Some(offer) = next_comparison(state).or_else(|| next_unit(state, sizes))
        {
            if !state.outstanding.contains_key(&offer.id) {
                offers.push(offer);
            }
        }
        state.is_short = state.outstanding.len() + offers.len() < wanted;
        offers
    }
}

impl State {
    /// Decides how many workers help with so many frames, from time to time: at most so many.
    fn invite(&mut self, frames: usize, most: usize, heard: Duration) {
        if self.invited.is_some_and(|last| last.elapsed() < PLANNER_PAUSE) {
            return;
        }
        self.invited = Some(Instant::now());
        let (workers, slots) = self.workers.slots(heard);
        let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let slots = slots as f64 / workers.max(1) as f64;
        let helping = self.measured.most_workers(threads as f64, slots.max(1.0), frames.max(1));
        self.workers.invite(helping.min(most), heard);
    }

    /// Lets workers have a unit.
    fn offer(&mut self, offer: Offer) {
        let Offer { id, job, row, blocks, compared, .. } = offer;
        let Some(request) = JobRequest::of(&job) else { return };
        let samples = row.first..row.end;
        let unit = Arc::new(Unit {
            id: id.clone(),
            scene: request.scene,
            entry: request.entry,
            spec: request.spec,
            priority: job.priority.name().into(),
            blocks,
            samples,
        });
        let order = (job.priority != Priority::Interactive, self.offered);
        self.offered += 1;
        self.outstanding.insert(id, Outstanding::new(order, unit, row, compared));
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
    Some(Offer { id, job, row, blocks, frame: None, is_new: false, compared: Some(comparison) })
}

/// The next unit of the job whose turn it is.
fn next_unit(state: &mut State, sizes: Sizes) -> Option<Offer> {
    let mut runs: Vec<&mut Run> = state.runs.values_mut().filter(|run| !run.frames.is_empty()).collect();
    decisions::next(&mut runs, |run| {
        run.frames.values().find_map(|frame| {
            let (row, blocks, is_new) = frame.take(sizes, run.speed)?;
            let samples = row.samples();
            let (id, frame) = (frame.id(&row), Some(Arc::clone(frame)));
            let offer = Offer { id, job: run.job.clone(), row, blocks, frame, is_new, compared: None };
            Some((offer, samples))
        })
    })
}

/// True if a job is worked on in this state.
pub(super) fn is_active(state: JobState) -> bool {
    matches!(state, JobState::Queued | JobState::Running)
}

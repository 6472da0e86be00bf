//! Answers workers.

use super::decisions::{self, Asked, Begin, Holding, MOST_ATTEMPTS};
use super::frame::{Kept, Leased};
use super::planner::is_active;
use super::task::{Failure, Task};
use super::{Comparison, Holder, Outstanding, Runner};
use crate::farm::{
    Answer, Ask, Desk, FailureReport, FilePart, FinishedUnit, Orders, Report, SceneFile, Start, UnitId,
    Verdict,
};
use crate::serve::failpoint;
use crate::serve::ledger::{JobState, UnitRow};
use std::sync::{Arc, Weak};
use std::time::Instant;

/// The desk of a runner, for as long as it is there.
struct RunnersDesk(Weak<Runner>);

/// The desk of a runner.
pub(super) fn of(runner: &Arc<Runner>) -> Arc<dyn Desk> {
    Arc::new(RunnersDesk(Arc::downgrade(runner)))
}

impl Desk for RunnersDesk {
    fn answer(&self, ask: Ask) -> Answer {
        let Some(runner) = self.0.upgrade() else {
            return match ask {
                Ask::Result(_) => Answer::Verdict(Verdict::Later),
                _ => Answer::Noted,
            };
        };
        match ask {
            Ask::Join(card) => Answer::Welcome(runner.state().workers.join(card, runner.bus.lease_time())),
            Ask::Report(report) => Answer::Orders(runner.orders(&report)),
            Ask::Leave(worker) => {
                runner.state().workers.leave(&worker);
                Answer::Noted
            }
            Ask::Start(unit, worker, deliveries) => Answer::Start(runner.begin(&unit, &worker, deliveries)),
            Ask::Files(scene, from) => Answer::Files(runner.list_files(&scene, from)),
            Ask::File(part) => Answer::File(runner.read_file(&part)),
            Ask::Result(finished) => Answer::Verdict(runner.take_result(finished)),
            Ask::Failure(failure) => {
                runner.take_failure(&failure);
                Answer::Noted
            }
        }
    }
}

impl Runner {
    /// Files of a scene, from a number on, and the number of all. None if workers may not have them.
    fn list_files(&self, scene: &str, from: u32) -> Option<(Vec<SceneFile>, u32)> {
        let folder = self.is_shared(scene).then(|| self.store.scene_folder(scene))?;
        self.files.list(scene, &folder, from).ok()
    }

    /// Bytes of a file of a scene. None if workers may not have them.
    fn read_file(&self, part: &FilePart) -> Option<Vec<u8>> {
        let folder = self.is_shared(&part.scene).then(|| self.store.scene_folder(&part.scene))?;
        self.files.read(part, &folder).ok()
    }

    /// Takes note of what a worker does, and tells it what to stop.
    fn orders(&self, report: &Report) -> Orders {
        let mut stop = Vec::new();
        for id in &report.units {
            if !self.is_wanted(id, &report.worker) {
                stop.push(id.clone());
            }
        }
        let mut state = self.state();
        let is_unknown = !state.workers.report(report);
        let refused = state.workers.refusal(&report.worker).cloned();
        Orders { stop, refused, is_unknown }
    }

    /// Whether a unit that a worker has is still to be rendered by it.
    fn is_wanted(&self, id: &UnitId, worker: &str) -> bool {
        let mut state = self.state();
        if let Some(unit) = state.outstanding.get_mut(id) {
            let holder =
                unit.holder.get_or_insert_with(|| Holder { worker: worker.into(), seen: Instant::now() });
            if holder.worker == worker {
                holder.seen = Instant::now();
            }
            return true;
        }
        let Some(run) = state.runs.get(&id.job) else {
            drop(state);
            // A job that has not been looked at since this process began is no reason to stop anything.
            return self.ledger.job(&id.job).map_or(true, |job| job.is_some_and(|job| is_active(job.state)));
        };
        if !is_active(run.job.state) {
            return false;
        }
        match run.frames.get(&id.frame) {
            Some(frame) if id.copy == 0 => frame.find(id.pass, id.number).map_or(true, |unit| unit.is_some()),
            Some(_) => false,
            None => true,
        }
    }

    /// Whether a worker is to render a unit that it has leased.
    fn begin(&self, id: &UnitId, worker: &str, deliveries: u64) -> Start {
        let silence = self.silence();
        let mut state = self.state();
        state.workers.seen(worker);
        if let Some(why) = state.workers.refusal(worker) {
            return Start::Refused(why.clone());
        }
        if deliveries > 1 {
            metrics::counter!("raystream_redeliveries_total").increment(1);
            state.workers.redelivered(worker);
        }
        let has_other = state.workers.has_other(worker, self.bus.lease_time());
        let Some(unit) = state.outstanding.get_mut(id) else { return Start::Skip };
        let holding = unit
            .holder
            .as_ref()
            .map(|holder| Holding { is_asker: holder.worker == worker, silent: holder.seen.elapsed() });
        let is_own = unit.compared.as_ref().is_some_and(|first| first.worker == worker);
        let is_lost = match decisions::begin(&Asked { holding, deliveries, is_own, has_other }, silence) {
            Begin::Go { is_lost } => is_lost,
            Begin::Wait => return Start::Wait,
            Begin::Alone => {
                state.outstanding.remove(id);
                drop(state);
                self.wake();
                return Start::Skip;
            }
        };
        unit.holder = Some(Holder { worker: worker.into(), seen: Instant::now() });
        unit.changed = Instant::now();
        unit.deliveries = deliveries;
        let is_compared = unit.compared.is_some();
        drop(state);
        if is_lost && !is_compared {
            self.count_loss(id);
        }
        Start::Go
    }

    /// Counts that the holder of a unit has gone. Too many have: perhaps the unit ends them.
    fn count_loss(&self, id: &UnitId) {
        let why = "the workers that rendered it ended or fell silent";
        let failure = FailureReport { unit: id.clone(), worker: String::new(), error: why.into() };
        self.count_failure(&failure, false);
    }

    /// Keeps the sums of a unit.
    fn take_result(&self, finished: FinishedUnit) -> Verdict {
        let id = finished.unit.clone();
        let mut state = self.state();
        state.workers.seen(&finished.worker);
        if let Some(why) = state.workers.refusal(&finished.worker) {
            return Verdict::Refused(why.clone());
        }
        let frame = state.runs.get(&id.job).and_then(|run| run.frames.get(&id.frame)).cloned();
        let outstanding = state.outstanding.get(&id);
        let compared = outstanding.and_then(|unit| unit.compared.clone());
        let is_holder = |holder: &Holder| holder.worker == finished.worker;
        // An earlier process may have told the worker.
        let is_told =
            |unit: &&Outstanding| unit.deliveries > 0 && unit.holder.as_ref().is_some_and(is_holder);
        let leased = Leased {
            began: outstanding.filter(is_told).map(|unit| unit.changed),
            deliveries: outstanding.map_or(1, |unit| unit.deliveries.max(1)),
        };
        drop(state);
        if id.copy > 0 {
            return self.take_comparison(&finished, compared);
        }
        let Some(frame) = frame else { return self.without_frame(&id) };
        let (worker, seconds, digest) = (finished.worker.clone(), finished.seconds, finished.digest.clone());
        let compare = decisions::is_compared(&id, self.farm.compared_share)
            .then(|| frame.find(id.pass, id.number))
            .and_then(Result::ok)
            .flatten();
        let kept = frame.keep(&self.ledger, finished, leased);
        let (verdict, name) = match kept {
            Ok(Kept::New { samples, is_complete }) => {
                metrics::histogram!("raystream_unit_seconds").record(seconds);
                let mut state = self.state();
                state.workers.done(&worker, samples, seconds);
                state.runs.get_mut(&id.job).into_iter().for_each(|run| run.speed.add(samples, seconds));
                state.outstanding.remove(&id);
                if let Some((row, blocks)) = compare
                    && state.workers.has_other(&worker, self.bus.lease_time())
                {
                    let id = UnitId { copy: 1, ..id.clone() };
                    state.comparisons.push_back(Comparison { id, row, blocks, worker, digest });
                }
                drop(state);
                failpoint::pass(if is_complete { "frame-complete" } else { "unit-kept" });
                (Verdict::Kept, "done")
            }
            Ok(Kept::Before) => {
                self.state().outstanding.remove(&id);
                (Verdict::Duplicate, "duplicate")
            }
            Ok(Kept::Wrong(why)) => {
                let failure = FailureReport { unit: id, worker, error: why.clone() };
                self.take_failure(&failure);
                (Verdict::Refused(why), "refused")
            }
            Err(error) => {
                let (Failure::Disk(why) | Failure::Job(why)) = error else { return Verdict::Later };
                log::warn!("unit {id}: {why}; the worker keeps it for now");
                (Verdict::Later, "disk")
            }
        };
        metrics::counter!("raystream_units_total", "result" => name).increment(1);
        self.wake();
        verdict
    }

    /// What becomes of a result whose frame is not open.
    fn without_frame(&self, id: &UnitId) -> Verdict {
        match self.ledger.job(&id.job) {
            Ok(Some(job)) if is_active(job.state) => {
                let frames = self.ledger.frames(&id.job).unwrap_or_default();
                let is_finished = frames.iter().any(|row| row.number == id.frame && row.hash.is_some());
                if is_finished { Verdict::Duplicate } else { Verdict::Later }
            }
            Ok(_) => Verdict::Stale,
            Err(_) => Verdict::Later,
        }
    }

    /// Compares what two workers have made of a unit.
    fn take_comparison(&self, second: &FinishedUnit, first: Option<Comparison>) -> Verdict {
        let Some(first) = first else { return Verdict::Stale };
        self.state().outstanding.remove(&second.unit);
        if first.digest == second.digest {
            metrics::counter!("raystream_units_compared_total", "result" => "equal").increment(1);
        } else {
            metrics::counter!("raystream_units_compared_total", "result" => "different").increment(1);
            let Comparison { id, row, blocks, worker, digest } = first;
            log::error!("unit {id}: workers {worker} and {} disagree", second.worker);
            let parties = [(worker, digest), (second.worker.clone(), second.digest.clone())];
            let state = self.state();
            let run = state.runs.get(&id.job);
            let job =
                run.map(|run| (run.job.clone(), run.tasks.iter().map(|task| task.0).collect::<Vec<_>>()));
            drop(state);
            if let Some((job, under_way)) = job {
                let task = Task::Arbitrate { row, blocks, parties };
                self.give(&job, task, &under_way);
            }
        }
        self.wake();
        Verdict::Kept
    }

    fn take_failure(&self, failure: &FailureReport) {
        self.state().workers.seen(&failure.worker);
        if failure.unit.copy > 0 {
            self.state().outstanding.remove(&failure.unit);
        } else {
            self.count_failure(failure, true);
        }
        self.wake();
    }

    /// Counts that a unit has failed. After too many failures its job fails.
    fn count_failure(&self, failure: &FailureReport, is_offered_again: bool) {
        let FailureReport { unit: id, worker, error } = failure;
        let mut state = self.state();
        let frame = state.runs.get(&id.job).and_then(|run| run.frames.get(&id.frame)).cloned();
        if is_offered_again {
            state.outstanding.remove(id);
        }
        drop(state);
        let Some(frame) = frame else { return };
        let counted = frame.find(id.pass, id.number).ok().flatten();
        let Some((row, _)) = counted else { return };
        metrics::counter!("raystream_units_total", "result" => "failed").increment(1);
        log::warn!(
            "unit {id}: {}{error}",
            if worker.is_empty() { String::new() } else { format!("{worker}: ") }
        );
        if is_offered_again {
            frame.put_back(id.pass, id.number);
        }
        self.count_attempt(id, row, error);
    }

    fn count_attempt(&self, id: &UnitId, row: UnitRow, error: &str) {
        let attempts = self.ledger.reopen_unit(&id.job, row);
        let failed = attempts.and_then(|attempts| {
            if attempts < MOST_ATTEMPTS {
                return Ok(());
            }
            let active = &[JobState::Queued, JobState::Running];
            let told = format!("a unit of frame {} has failed {attempts} times: {error}", id.frame);
            self.ledger.set_state(&id.job, active, JobState::Failed, Some(told)).map(drop)
        });
        failed.unwrap_or_else(|error| log::warn!("job {}: {error}", id.job));
    }
}

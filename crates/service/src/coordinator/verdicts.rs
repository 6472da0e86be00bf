//! What becomes of what workers send: sums that are kept or compared, units that could not be rendered.

use super::frame::{By, Kept, LeasedFor, OpenFrame};
use super::lending::{Comparison, Outstanding, Party};
use super::planner::is_active;
use super::task::{Failure, Task};
use super::{Runner, State, decisions};
use crate::contract::{self, FailureReport, FinishedUnit, ResultReply, UnitId, failpoint, sentence};

/// The longest time of a unit that is believed, in seconds.
const MOST_SECONDS: f64 = 1e6;

impl Runner {
    /// Keeps the sums of a unit.
    pub(super) fn take_result(&self, key: &str, mut finished: FinishedUnit) -> ResultReply {
        if !self.is_holder(key, &finished.held) {
            self.state().workers.complain(key, "it sends sums of a unit that it was not given");
            return ResultReply::Refused("no such unit was given to this worker".into());
        }
        let seconds = |seconds: f64| if seconds.is_finite() { seconds.clamp(0.0, MOST_SECONDS) } else { 0.0 };
        (finished.seconds, finished.opening_s) = (seconds(finished.seconds), seconds(finished.opening_s));
        let id = finished.held.unit.clone();
        let finished_id = id.clone();
        let mut state = self.state();
        state.workers.seen(key, self.bus.lease_time());
        if let Some(why) = state.workers.refusal(key) {
            return ResultReply::Refused(why.clone());
        }
        let run = state.runs.get(&id.job);
        let frame = run.and_then(|run| run.frames.get(&id.frame)).cloned();
        let (outstanding, name) = (state.outstanding.get(&id), state.workers.name(key));
        let since = |unit: &Outstanding| {
            unit.holders.iter().find(|holder| holder.key == key).map(|holder| holder.since)
        };
        let leased = LeasedFor {
            began: outstanding.and_then(since),
            deliveries: outstanding.map_or(1, |unit| unit.deliveries.max(1)),
        };
        let compared = outstanding.and_then(|unit| unit.compared.clone());
        let drawn = self.secret.draw(&id.to_string());
        let is_compared = decisions::is_compared(drawn, self.farm.compared_share, state.workers.brought(key));
        drop(state);
        let Some(frame) = frame else { return self.without_frame(&id) };
        if id.copy > 0 {
            return self.take_comparison(key, &name, &finished, compared, &frame);
        }
        let (digest, blocks) = (finished.digest.clone(), finished.blocks.clone());
        let (seconds, opening_s) = (finished.seconds, finished.opening_s);
        let by = By { key, name: &name, is_compared };
        let (verdict, label) = match frame.keep(&self.ledger, finished, by, leased) {
            Ok(Kept::New { unit: row, is_complete, locked_s }) => {
                self.trouble.end();
                metrics::histogram!("raystream_unit_seconds").record(seconds);
                let first = Party { key: key.to_owned(), name, digest };
                let samples = row.samples();
                let id = UnitId { copy: 1, ..id.clone() };
                let comparison = is_compared.then_some(Comparison { id, row, blocks, first });
                self.state().measured.kept(locked_s, (seconds - opening_s).max(0.0));
                self.note_kept(key, &finished_id, samples, seconds, comparison);
                failpoint::pass(if is_complete { "frame-complete" } else { "unit-kept" });
                (ResultReply::Kept, "done")
            }
            Ok(Kept::Before) => {
                self.state().remove(&id);
                (ResultReply::Duplicate, "duplicate")
            }
            Ok(Kept::Foreign) => (self.take_foreign(key, &id), "foreign"),
            Ok(Kept::Wrong(why)) => (self.take_wrong(key, &id, why), "refused"),
            Err(error) => {
                let (Failure::Disk(why) | Failure::Job(why)) = error else { return ResultReply::Later };
                self.trouble.note(&why);
                log::debug!("unit {id}: {why}; the worker keeps it for now");
                (ResultReply::Later, "disk")
            }
        };
        metrics::counter!("raystream_units_total", "result" => label).increment(1);
        self.wake();
        verdict
    }

    /// Takes note of a unit whose sums are kept. If its worker was found wrong meanwhile, its frame begins anew.
    pub(super) fn note_kept(
        &self,
        key: &str,
        id: &UnitId,
        samples: u64,
        seconds: f64,
        comparison: Option<Comparison>,
    ) {
        let lease = self.bus.lease_time();
        let mut guard = self.state();
        let state = &mut *guard;
        state.workers.returned(key);
        state.workers.done(key, samples, seconds);
        if let Some(run) = state.runs.get_mut(&id.job) {
            run.speed.add(samples, seconds);
            run.kept += samples as f64;
            state.workers.has_fetched(key, &run.job.scene);
        }
        for (failed, error) in state.remove(id).map_or(Vec::new(), |unit| unit.failed) {
            let what = format!("it says that it cannot render what others can ({error})");
            state.workers.failed(&failed, &what, lease);
        }
        state.comparisons.extend(comparison);
        let found = state.workers.refusal(key).cloned();
        let name = state.workers.name(key);
        drop(guard);
        if let Some(reason) = found
            && let Err(error) = self.undo(key, &name, &reason)
        {
            log::warn!("job {}: {error:?}", id.job);
        }
    }

    /// What becomes of sums that are of another picture: the worker fetches the scene anew, and then goes home. The
    /// unit is not to blame.
    fn take_foreign(&self, key: &str, id: &UnitId) -> ResultReply {
        let lease = self.bus.lease_time();
        let state = &mut *self.state();
        let holders = state.outstanding.get(id).into_iter().flat_map(|unit| &unit.holders);
        let given = holders.filter(|holder| holder.key == key).map(|holder| holder.since).next();
        state.put_back(key, id);
        let scene = state.runs.get(&id.job).map(|run| run.job.scene.clone()).unwrap_or_default();
        let why = "it is of another picture: scene, options or program differ";
        log::warn!("worker {}: unit {id}: {why}", state.workers.label(key));
        if state.workers.is_to_fetch_anew(key, &scene, given, lease) {
            ResultReply::Anew(why.into())
        } else {
            ResultReply::Refused(why.into())
        }
    }

    /// What becomes of sums that are not what was asked for. The unit is not to blame.
    fn take_wrong(&self, key: &str, id: &UnitId, why: String) -> ResultReply {
        let lease = self.bus.lease_time();
        let state = &mut *self.state();
        state.put_back(key, id);
        state.workers.failed(key, &format!("it sends sums that are none of the unit's ({why})"), lease);
        log::warn!("worker {}: unit {id}: {why}", state.workers.label(key));
        ResultReply::Refused(why)
    }

    /// What becomes of a result whose frame is not open.
    fn without_frame(&self, id: &UnitId) -> ResultReply {
        match self.ledger.job(&id.job) {
            Ok(Some(job)) if is_active(job.state) => {
                let frames = self.ledger.frames(&id.job).unwrap_or_default();
                let is_finished = frames.iter().any(|row| row.number == id.frame && row.hash.is_some());
                if is_finished { ResultReply::Duplicate } else { ResultReply::Later }
            }
            Ok(_) => ResultReply::Stale,
            Err(_) => ResultReply::Later,
        }
    }

    /// Compares what two workers have made of a unit.
    fn take_comparison(
        &self,
        key: &str,
        name: &str,
        second: &FinishedUnit,
        first: Option<Comparison>,
        frame: &OpenFrame,
    ) -> ResultReply {
        let id = &second.held.unit;
        let Some(Comparison { row, blocks, first, .. }) = first else { return ResultReply::Stale };
        if id.round != frame.round {
            return ResultReply::Stale;
        }
        if !frame.is_of(&second.identity) {
            return self.take_foreign(key, id);
        }
        let samples = row.first..row.end;
        let digest = contract::digest(id, &blocks, &samples, &second.sums);
        if second.blocks != blocks || second.samples != samples || second.digest != digest {
            return self.take_wrong(key, id, "its sums are damaged".into());
        }
        let second = Party { key: key.to_owned(), name: name.to_owned(), digest };
        let is_equal = first.digest == second.digest;
        let result = if is_equal { "equal" } else { "different" };
        metrics::counter!("raystream_units_compared_total", "result" => result).increment(1);
        if is_equal {
            let ended = self.ledger.end_comparison(&id.job, &row, [first.key, second.key]);
            if let Err(error) = ended {
                log::warn!("job {}: {error}", id.job);
                return ResultReply::Later;
            }
            let mut state = self.state();
            log::debug!("{}: compared: its sums are those of worker {}, too", state.subject(id), name);
            state.remove(id);
            state.workers.returned(key);
        } else {
            let mut state = self.state();
            log::error!(
                "{}: compared: workers {} and {} disagree",
                state.subject(id),
                state.workers.label(&first.key),
                state.workers.label(&second.key)
            );
            // It stays where it is until it is judged: the frame is not finished before.
            let Some(unit) = state.outstanding.get_mut(id).filter(|unit| !unit.is_home) else {
                return ResultReply::Kept;
            };
            unit.is_home = true;
            unit.holders.clear();
            state.settle(key);
            let run = state.runs.get(&id.job);
            let job =
                run.map(|run| (run.job.clone(), run.tasks.iter().map(|task| task.0).collect::<Vec<_>>()));
            drop(state);
            if let Some((job, under_way)) = job {
                let task = Task::Arbitrate { id: id.clone(), row, blocks, parties: vec![first, second] };
                self.give(&job, task, &under_way);
            }
        }
        self.wake();
        ResultReply::Kept
    }

    /// Takes note that a worker cannot render a unit that it has. Others try it; if none of them can, this process
    /// does.
    pub(super) fn take_failure(&self, key: &str, failure: FailureReport) {
        if !self.is_holder(key, &failure.held) {
            return self
                .state()
                .workers
                .complain(key, "it reports a failure of a unit that it was not given");
        }
        let (id, error) = (failure.held.unit, sentence(&failure.error));
        let mut state = self.state();
        state.workers.seen(key, self.bus.lease_time());
        let label = state.workers.label(key);
        let Some(unit) = state.outstanding.get_mut(&id) else { return };
        let before = unit.holders.len();
        unit.holders.retain(|holder| holder.key != key);
        if unit.holders.len() == before {
            return;
        }
        metrics::counter!("raystream_units_total", "result" => "failed").increment(1);
        unit.failed.push((key.to_owned(), error.clone()));
        log::warn!("{}: worker {label}: {error}", state.subject(&id));
        state.settle(key);
        self.ring(&mut state);
        drop(state);
        self.wake();
    }
}

impl State {
    /// Takes a unit away that needs no more work.
    pub fn remove(&mut self, id: &UnitId) -> Option<Outstanding> {
        let unit = self.outstanding.remove(id)?;
        unit.holders.iter().for_each(|holder| self.settle(&holder.key));
        Some(unit)
    }

    /// Takes a unit from a worker; others may have it.
    fn put_back(&mut self, key: &str, id: &UnitId) {
        if let Some(unit) = self.outstanding.get_mut(id) {
            unit.holders.retain(|holder| holder.key != key);
            self.settle(key);
        }
    }
}

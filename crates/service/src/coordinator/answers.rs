//! Answers workers. What they say is checked here, where it comes in.

use super::Runner;
use super::lending::Holder;
use super::planner::is_active;
use super::thread_clock::ThreadClock;
use crate::contract::{
    Answer, Ask, Coordinator, FilePart, FinishedUnit, Held, MOST_SLOTS, Report, ReportReply, ResultReply,
    SceneFile, UnitId,
};
use std::sync::{Arc, Weak};
use std::time::Instant;

/// The most bytes of a name, an identity or a digest in a message.
const MOST_TEXT: usize = 128;

/// The coordinator's side of a bus: a runner, for as long as it is there.
struct RunnerHandle(Weak<Runner>);

/// A runner as workers see it.
pub(super) fn of(runner: &Arc<Runner>) -> Arc<dyn Coordinator> {
    Arc::new(RunnerHandle(Arc::downgrade(runner)))
}

impl Coordinator for RunnerHandle {
    fn answer(&self, key: &str, ask: Ask) -> Answer {
        let Some(runner) = self.0.upgrade() else {
            return match ask {
                Ask::Result(_) => Answer::Result(ResultReply::Later),
                _ => Answer::Noted,
            };
        };
        let clock = ThreadClock::start();
        let answer = runner.answer(key, ask);
        let seconds = clock.seconds();
        runner.state().measured.answered(&answer, seconds);
        answer
    }

    fn expects(&self, key: &str, finished: &FinishedUnit, _: u64) -> bool {
        let is_short = |text: &str| text.len() <= MOST_TEXT;
        let is_readable = is_short(&finished.digest) && is_short(&finished.identity);
        self.0.upgrade().is_some_and(|runner| is_readable && runner.is_holder(key, &finished.held))
    }
}

impl Runner {
    fn answer(&self, key: &str, ask: Ask) -> Answer {
        match ask {
            Ask::Join(info) => {
                let (reply, is_another) = self.state().workers.join(key, info, self.bus.lease_time());
                if is_another {
                    self.take_all(key, "it has begun again with units");
                }
                Answer::Joined(reply)
            }
            Ask::Report(report) => Answer::Reported(self.orders(key, &report)),
            Ask::Leave => {
                self.take_all(key, "it leaves with units");
                self.state().workers.leave(key);
                Answer::Noted
            }
            Ask::Lease(wanted) => Answer::Granted(self.grant(key, &wanted)),
            Ask::GiveBack(held) => {
                self.take_back(key, &held);
                Answer::Noted
            }
            Ask::Files(scene, from) => Answer::Files(self.list_files(key, &scene, from)),
            Ask::File(part) => Answer::File(self.read_file(key, &part)),
            Ask::Result(finished) => Answer::Result(self.take_result(key, finished)),
            Ask::Failure(failure) => {
                self.take_failure(key, failure);
                Answer::Noted
            }
        }
    }

    /// Files of a scene, from a number on, and the number of all. None if workers may not have them.
    fn list_files(&self, key: &str, scene: &str, from: u32) -> Option<(Vec<SceneFile>, u32)> {
        if !self.is_shared(scene) {
            self.state().workers.complain(key, "it asks for files of a scene that no job or view has");
            return None;
        }
        self.files.list(scene, &self.store.scene_folder(scene), from).ok()
    }

    /// Bytes of a file of a scene. None if workers may not have them.
    fn read_file(&self, key: &str, part: &FilePart) -> Option<Vec<u8>> {
        if !self.is_shared(&part.scene) {
            self.state().workers.complain(key, "it asks for a file of a scene that no job or view has");
            return None;
        }
        let bytes = self.files.read(part, &self.store.scene_folder(&part.scene)).ok()?;
        self.state().measured.sent(bytes.len(), Instant::now());
        Some(bytes)
    }

    /// Takes note of what a worker does, and tells it what to stop.
    fn orders(&self, key: &str, report: &Report) -> ReportReply {
        let refused = self.state().workers.refusal(key).cloned();
        if report.units.len() > MOST_SLOTS as usize {
            self.state().workers.complain(key, "it reports more units than any worker has");
            return ReportReply { refused, ..ReportReply::default() };
        }
        let is_stopped = |held: &&Held| refused.is_some() || !self.is_wanted(key, held);
        let stop = report.units.iter().filter(is_stopped).map(|held| held.unit.clone()).collect();
        let is_unknown =
            !self.state().workers.report(key, report, self.bus.lease_time()) && refused.is_none();
        ReportReply { stop, refused, is_unknown }
    }

    /// True if a unit that a worker has is still to be rendered by it. Its lease is renewed.
    fn is_wanted(&self, key: &str, held: &Held) -> bool {
        if !self.is_holder(key, held) {
            self.state().workers.complain(key, "it reports a unit that it was not given");
            return false;
        }
        let id = &held.unit;
        let mut state = self.state();
        if let Some(unit) = state.outstanding.get_mut(id) {
            let now = Instant::now();
            if let Some(holder) = unit.holders.iter_mut().find(|holder| holder.key == key) {
                holder.seen = now;
            } else if unit.holders.is_empty() && !unit.is_home {
                // An earlier process has given it the unit, or it was silent and no one has it yet.
                unit.holders.push(Holder { key: key.to_owned(), since: now, seen: now });
                state.workers.lent(key, false);
            }
            return true;
        }
        self.is_wanted_unknown(id, state)
    }

    /// The same for a unit that is not on its way.
    fn is_wanted_unknown(&self, id: &UnitId, state: std::sync::MutexGuard<'_, super::State>) -> bool {
        let Some(run) = state.runs.get(&id.job) else {
            drop(state);
            // A job that has not been looked at since this process began is no reason to stop anything.
            return self.ledger.job(&id.job).map_or(true, |job| job.is_some_and(|job| is_active(job.state)));
        };
        if !is_active(run.job.state) {
            return false;
        }
        match run.frames.get(&id.frame) {
            Some(frame) if frame.round != id.round => false,
            Some(frame) if id.copy == 0 => frame.find(id.pass, id.number).map_or(true, |unit| unit.is_some()),
            Some(_) => false,
            None => true,
        }
    }
}

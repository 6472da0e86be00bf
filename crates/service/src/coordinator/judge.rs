//! What the service renders itself because it cannot take the word of its workers.

use super::Runner;
use super::frame::{By, Kept, LeasedFor};
use super::ledger::{Job, UnitRow};
use super::lending::Party;
use super::task::Failure;
use crate::contract::{self, FinishedUnit, Held, UnitId, UnitWatch};
use raystream::render::Pass;
use std::sync::Arc;
use std::time::Instant;

/// The key and the name under which the service's own sums are kept.
const HOME: &str = "coordinator";

/// A unit that is rendered here: its name, its row and its blocks.
type Home<'a> = (&'a UnitId, &'a UnitRow, &'a [u32]);

impl Runner {
    /// Renders a unit and compares its sums with those of workers. Who was wrong gets no more units, and frames to
    /// which it has contributed begin anew.
    pub(super) fn arbitrate(
        &self,
        job: &Job,
        (id, row, blocks): Home<'_>,
        parties: &[Party],
        watch: &UnitWatch,
    ) -> Result<(), Failure> {
        let open_job = self.open(job)?;
        let samples = row.first..row.end;
        let patch = open_job.patch(row.frame, Pass::new(blocks.into(), samples.clone()), watch);
        let own = contract::digest(id, blocks, &samples, patch.map_err(Failure::Job)?.sums());
        for party in parties.iter().filter(|party| party.digest != own) {
            let reason = format!(
                "samples {}..{} of frame {} of job {} have other sums there than here; check its memory and drivers",
                row.first, row.end, row.frame, job.id
            );
            self.quarantine(party, &reason)?;
        }
        let Some(first) = parties.first().filter(|first| first.digest == own) else { return Ok(()) };
        // Whoever else was right has compared them, or the service.
        let second = parties.get(1).filter(|second| second.digest == own);
        let second = second.map_or_else(|| HOME.to_owned(), |second| second.key.clone());
        self.ledger.end_comparison(&job.id, row, [first.key.clone(), second])?;
        log::debug!("{}, unit {id}: compared: its sums are those of this process, too", job.subject());
        self.state().remove(id);
        Ok(())
    }

    /// Gives a worker no more units, names it, and lets frames with its sums begin anew.
    fn quarantine(&self, party: &Party, reason: &str) -> Result<(), Failure> {
        let mut state = self.state();
        let label = state.workers.label(&party.key);
        log::error!("worker {label}: quarantined: {reason}");
        // First, so that nothing of it is kept from here on that is not found below.
        state.workers.quarantine(&party.key, &party.name, reason);
        drop(state);
        self.undo(&party.key, &party.name, reason)
    }

    /// Writes down that a worker was found wrong; frames of jobs that go on and have its sums begin anew.
    pub(super) fn undo(&self, key: &str, name: &str, reason: &str) -> Result<(), Failure> {
        for (job, frame) in self.ledger.quarantine(key, name, reason)? {
            log::warn!("job {job}: frame {frame} begins anew: it has sums of worker {name}");
            let state = self.state();
            let open = state.runs.get(&job).and_then(|run| run.frames.get(&frame)).cloned();
            drop(state);
            open.inspect(|open| open.break_off());
            self.state().forget_frame(&job, frame);
        }
        self.wake();
        Ok(())
    }

    /// Renders a unit that workers say they cannot render. If they are right, its job fails; if not, they are named.
    pub(super) fn prove(
        &self,
        job: &Job,
        (id, row, blocks): Home<'_>,
        failed: &[(String, String)],
        watch: &UnitWatch,
    ) -> Result<(), Failure> {
        let (open_job, began) = (self.open(job)?, Instant::now());
        let samples = row.first..row.end;
        let patch = open_job.patch(row.frame, Pass::new(blocks.into(), samples.clone()), watch);
        let patch = patch.map_err(|error| {
            let times = failed.len() + 1;
            Failure::Job(format!("a unit of frame {} has failed {times} times: {error}", row.frame))
        })?;
        let state = self.state();
        let frame = state.runs.get(&job.id).and_then(|run| run.frames.get(&row.frame)).cloned();
        drop(state);
        let Some(frame) = frame else { return Err(Failure::Stopped) };
        let identity = open_job.identity(row.frame).map_err(Failure::Job)?;
        let sums = Arc::new(patch.into_sums());
        let finished = FinishedUnit {
            held: Held { unit: id.clone(), token: String::new() },
            identity,
            blocks: blocks.to_vec(),
            digest: contract::digest(id, blocks, &samples, &sums),
            samples,
            seconds: began.elapsed().as_secs_f64(),
            opening_s: 0.0,
            sums,
        };
        let (seconds, by) = (finished.seconds, By { key: HOME, name: HOME, is_compared: false });
        let leased = LeasedFor { began: Some(began), deliveries: 1 + failed.len() as u64 };
        match frame.keep(&self.ledger, finished, by, leased)? {
            Kept::New { unit, .. } => self.note_kept(HOME, id, unit.samples(), seconds, None),
            Kept::Before => drop(self.state().remove(id)),
            Kept::Foreign => return Err(Failure::Stopped),
            Kept::Wrong(why) => return Err(Failure::Job(why)),
        }
        Ok(())
    }
}

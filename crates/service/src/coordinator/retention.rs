//! Deletes what is not to be kept any longer, and removes the files of what was deleted.

use super::Runner;
use super::ledger::{Deleted, LedgerError, Leftover};
use super::storage::StorageError;
use crate::contract::failpoint;
use std::fs::File;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// How often is looked for what may go.
const PAUSE: Duration = Duration::from_secs(1);

/// How often is looked for copies of what lies in the storage, and for objects there that are no one's.
const EVICT: Duration = Duration::from_secs(5);
const SWEEP: Duration = Duration::from_secs(86_400);

/// Jobs that are deleted, or whose bytes are counted, before other work of the ledger comes again.
const AT_ONCE: usize = 200;

/// The file of a data folder that a backup locks: what it has begun to copy stays.
pub(super) const BACKUP_LOCK: &str = "backup.lock";

/// Bounds of what is kept of jobs that have ended. Pinned jobs are kept in any case.
#[derive(Clone, Copy, Debug, Default)]
pub struct Retention {
    /// The time for which a job is kept after it has ended or was last an answer, and an upload after it was last used;
    /// `None` for ever.
    pub keep_for: Option<Duration>,
    /// The most bytes of results of jobs that have ended; `None` for no bound.
    pub keep_bytes: Option<u64>,
}

impl Runner {
    /// The thread that deletes.
    pub(super) fn retain(&self) {
        let (mut evicted, mut swept) = (None, None);
        while !self.ending.load(SeqCst) {
            let retained = self.expire().and_then(|()| self.remove_leftovers());
            if let Err(error) = retained {
                self.trouble.note(&error.to_string());
            }
            self.tidy_storage(&mut evicted, &mut swept);
            let queued = self.queued.lock().expect("no holder panics");
            if !self.ending.load(SeqCst) {
                drop(self.has_ended.wait_timeout(queued, PAUSE));
            }
        }
    }

    /// Removes copies beyond their bound, and objects that are no one's.
    fn tidy_storage(&self, evicted: &mut Option<Instant>, swept: &mut Option<Instant>) {
        let is_due = |last: &Option<Instant>, pause| last.is_none_or(|last| last.elapsed() >= pause);
        let Some(storage) = self.store.storage().filter(|_| is_due(evicted, EVICT)) else { return };
        storage.look_again();
        *evicted = Some(Instant::now());
        let tidied = self.store.evict(&self.scenes_in_use()).and_then(|()| {
            if is_due(swept, SWEEP) {
                self.store.sweep()?;
                *swept = Some(Instant::now());
            }
            Ok(())
        });
        if let Some(error) = tidied.err().filter(|error| !error.is_of_storage()) {
            self.trouble.note(&error.to_string());
        }
    }

    /// Deletes jobs and scenes that are not to be kept.
    fn expire(&self) -> Result<(), LedgerError> {
        let Retention { keep_for, keep_bytes } = self.retention;
        let keep_ms = keep_for.map(|time| i64::try_from(time.as_millis()).unwrap_or(i64::MAX / 2));
        if let Some(keep_ms) = keep_ms {
            for id in self.ledger.expired_jobs(keep_ms, AT_ONCE)? {
                self.expire_job(&id, "it has ended long ago")?;
            }
        }
        if let Some(most) = keep_bytes {
            for id in self.ledger.uncounted_jobs(AT_ONCE)? {
                if self.is_quiet(&id) {
                    let bytes = self.store.bytes_of_job(&id, &self.ledger.frames(&id)?);
                    self.ledger.count_bytes(&id, bytes)?;
                }
            }
            for id in self.ledger.jobs_beyond(most)?.into_iter().take(AT_ONCE) {
                self.expire_job(&id, "results have too many bytes")?;
            }
        }
        self.ledger.forget_scenes(keep_ms, self.scenes_in_use())?;
        Ok(())
    }

    fn expire_job(&self, id: &str, why: &str) -> Result<(), LedgerError> {
        let Some(job) = self.ledger.job(id)? else { return Ok(()) };
        if self.ledger.delete_job(id)? == Deleted::Gone {
            metrics::counter!("raystream_expired_jobs_total").increment(1);
            log::info!("{}: deleted: {why}", job.subject());
        }
        Ok(())
    }

    /// Removes the folders of what was deleted, once nothing works in them.
    fn remove_leftovers(&self) -> Result<(), LedgerError> {
        let leftovers = self.ledger.leftovers()?;
        if leftovers.is_empty() {
            return Ok(());
        }
        // While a backup is made, they stay.
        let Ok(lock) = File::create(self.store.data().join(BACKUP_LOCK)) else { return Ok(()) };
        if lock.try_lock().is_err() {
            return Ok(());
        }
        for leftover in leftovers {
            let removed = match &leftover {
                Leftover::Job(id) if !self.is_quiet(id) => continue,
                Leftover::Job(id) => self.store.discard_job(id),
                Leftover::Scene(sha256) => self.store.discard_scene(sha256, || {
                    // It may have been uploaded again meanwhile.
                    self.ledger.scene(sha256).is_ok_and(|bytes| bytes.is_none())
                }),
            };
            match removed {
                Ok(()) => self.ledger.clear(leftover)?,
                Err(StorageError::File(error)) => log::warn!("{leftover:?}: cannot be removed now: {error}"),
                // The others would be refused as well.
                Err(error) if error.is_of_storage() => break,
                Err(error) => {
                    self.trouble.note(&error.to_string());
                    break;
                }
            }
        }
        Ok(())
    }

    /// True if nothing works on a job, nor will: it has no task, no open frame, and the planner has looked twice since
    /// it first might have been given one.
    fn is_quiet(&self, job: &str) -> bool {
        let state = &mut *self.state();
        state.opened.retain(|frame| frame.strong_count() > 0);
        let is_open = state.opened.iter().filter_map(std::sync::Weak::upgrade).any(|frame| frame.job == job);
        if state.runs.contains_key(job) || is_open {
            state.resting.remove(job);
            return false;
        }
        let (plans, since) = (state.plans, *state.resting.entry(job.to_owned()).or_insert(state.plans));
        let is_quiet = plans >= since + 2;
        if is_quiet {
            state.resting.remove(job);
        } else {
            state.wakes += 1;
            self.changed.notify_all();
        }
        is_quiet
    }

    /// Scenes that are needed though no job of the ledger may say so.
    fn scenes_in_use(&self) -> Vec<String> {
        let state = self.state();
        let of_runs = state.runs.values().map(|run| run.job.scene.clone());
        let of_views = state.views.iter().filter(|(_, view)| view.strong_count() > 0);
        of_runs.chain(of_views.map(|(scene, _)| scene.clone())).chain(self.own_scene.clone()).collect()
    }

    /// Deletes a job that has ended. Its files go soon after.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn delete_job(&self, id: &str) -> Result<Deleted, LedgerError> {
        let deleted = self.ledger.delete_job(id)?;
        if deleted == Deleted::Gone {
            failpoint::pass("job-deleted");
            self.has_ended.notify_all();
        }
        Ok(deleted)
    }
}

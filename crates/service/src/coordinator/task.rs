//! What the service's own threads do for a job: plan it, open and finish its frames, render frames whose samples the
//! time decides, and judge between workers that disagree.

use super::frame::OpenFrame;
use super::ledger::{FrameRow, Job, JobState, LedgerError, Pending, UnitRow};
use super::lending::{Comparison, Party};
use super::request::JobRequest;
use super::results::{self, PICTURE};
use super::storage::{Storage, StorageError};
use super::{NAP, Runner, planner};
use crate::backend::OpenJob;
use crate::contract::{UnitId, UnitWatch, failpoint};
use axum::http::StatusCode;
use raystream::files::sync_folder;
use raystream::film::Picture;
use raystream::picture::{RenderSpec, Watch};
use raystream::render::Blocks;
use std::fs::File;
use std::io;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

/// Something to do for a job.
#[derive(Clone)]
pub(super) enum Task {
    /// Find out its frames.
    Plan,
    /// Read what the disk has of a frame.
    Open { frame: u32 },
    /// Write the pictures of a frame that has all samples.
    Finish(Arc<OpenFrame>),
    /// Render a frame whose samples the time decides.
    Whole { frame: u32 },
    /// Render a unit whose sums are to be compared with those of workers: of two that disagree, or of one beside whom
    /// there is no other.
    Arbitrate { id: UnitId, row: UnitRow, blocks: Vec<u32>, parties: Vec<Party> },
    /// Render a unit that no worker could: keys, and what they have said.
    Prove { id: UnitId, row: UnitRow, blocks: Vec<u32>, failed: Vec<(String, String)> },
}

/// Which task of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskKey {
    Plan,
    Open { frame: u32 },
    Finish { frame: u32 },
    Whole { frame: u32 },
    Judge { frame: u32, pass: u64, number: u32, copy: u32 },
}

impl TaskKey {
    /// The frame that it opens or renders.
    pub fn frame(self) -> Option<u32> {
        match self {
            Self::Open { frame } | Self::Finish { frame } | Self::Whole { frame } => Some(frame),
            Self::Plan | Self::Judge { .. } => None,
        }
    }
}

impl Task {
    /// The key by which it is known.
    pub fn key(&self) -> TaskKey {
        match self {
            Self::Plan => TaskKey::Plan,
            Self::Open { frame } => TaskKey::Open { frame: *frame },
            Self::Finish(frame) => TaskKey::Finish { frame: frame.frame },
            Self::Whole { frame } => TaskKey::Whole { frame: *frame },
            Self::Arbitrate { id, .. } | Self::Prove { id, .. } => {
                let UnitId { frame, pass, number, copy, .. } = *id;
                TaskKey::Judge { frame, pass, number, copy }
            }
        }
    }
}

/// Why a task was not done.
#[derive(Debug)]
pub(super) enum Failure {
    /// The job is to wait, or the service ends.
    Stopped,
    /// Files or the ledger cannot be written now.
    Disk(String),
    /// The storage cannot be used now, which it has told.
    Storage(String),
    /// The job cannot be done as it is.
    Job(String),
}

impl From<LedgerError> for Failure {
    fn from(error: LedgerError) -> Self {
        Self::Disk(error.to_string())
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Disk(format!("the data folder cannot be written: {error}"))
    }
}

impl From<StorageError> for Failure {
    fn from(error: StorageError) -> Self {
        if error.is_of_storage() { Self::Storage(error.to_string()) } else { Self::Disk(error.to_string()) }
    }
}

impl Runner {
    /// A thread: does tasks until the service ends.
    pub(super) fn do_tasks(&self) {
        loop {
            let mut queued = self.queued.lock().expect("no holder panics");
            let (job, task, watch) = loop {
                if self.ending.load(SeqCst) {
                    return;
                }
                match queued.pop_front() {
                    Some(next) => break next,
                    None => {
                        let waited = self.has_queued.wait_timeout(queued, NAP);
                        queued = waited.expect("no holder panics").0;
                    }
                }
            };
            drop(queued);
            self.perform(&job, &task, &watch);
        }
    }

    /// Does a task, whatever happens in it.
    fn perform(&self, job: &Job, task: &Task, watch: &Arc<UnitWatch>) {
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.run(job, task, watch)));
        let result = done.unwrap_or_else(|_| Err(Failure::Job("it panicked; see the log".into())));
        let rests = self.conclude(job, result);
        let mut state = self.state();
        if let Some(run) = state.runs.get_mut(&job.id) {
            run.tasks.retain(|(_, other)| !Arc::ptr_eq(other, watch));
            if rests {
                run.rests_until = Some(Instant::now() + NAP);
            }
        }
        drop(state);
        self.wake();
    }

    /// Writes down what became of a task. Returns whether the job is to rest before the next.
    fn conclude(&self, job: &Job, result: Result<(), Failure>) -> bool {
        match result {
            Ok(()) => {
                self.trouble.end();
                false
            }
            Err(Failure::Stopped) => false,
            Err(Failure::Disk(error)) => {
                self.trouble.note(&error);
                log::debug!("{}: {error}; the next try is in {} s", job.subject(), NAP.as_secs());
                true
            }
            Err(Failure::Storage(error)) => {
                log::debug!("{}: {error}; the next try is in {} s", job.subject(), NAP.as_secs());
                true
            }
            Err(Failure::Job(error)) => {
                log::warn!("{}: {error}", job.subject());
                let active = &[JobState::Queued, JobState::Running];
                self.stop_job(&job.id);
                let failed = self.ledger.set_state(&job.id, active, JobState::Failed, Some(error));
                failed.inspect_err(|error| log::warn!("{}: {error}", job.subject())).is_err()
            }
        }
    }

    fn run(&self, job: &Job, task: &Task, watch: &UnitWatch) -> Result<(), Failure> {
        // The planner may have read the ledger before the job was cancelled, and deleted after that.
        let is_active = |job: Job| planner::is_active(job.state);
        if watch.is_stopped_now() || !self.ledger.job(&job.id)?.is_some_and(is_active) {
            return Err(Failure::Stopped);
        }
        if job.is_planned && job.state == JobState::Queued {
            self.ledger.set_state(&job.id, &[JobState::Queued], JobState::Running, None)?;
        }
        let done = match task {
            Task::Plan => self.plan(job),
            Task::Open { frame } => self.open_frame(job, *frame),
            Task::Finish(frame) => self.finish_frame(job, frame),
            Task::Whole { frame } => self.whole(job, *frame, watch),
            Task::Arbitrate { id, row, blocks, parties } => {
                let judged = self.arbitrate(job, (id, row, blocks), parties, watch);
                judged.inspect_err(|_| self.state().is_not_home(id))
            }
            Task::Prove { id, row, blocks, failed } => {
                let proved = self.prove(job, (id, row, blocks), failed, watch);
                proved.inspect_err(|_| self.state().is_not_home(id))
            }
        };
        // Whatever a stopped task says, nothing is wrong with it: its job may even have been deleted.
        if watch.is_stopped() && done.is_err() { Err(Failure::Stopped) } else { done }
    }

    /// Reads the scene of a job, or finds it in the cache.
    pub(super) fn open(&self, job: &Job) -> Result<OpenJob, Failure> {
        let request = JobRequest::of(job);
        let request = request.ok_or_else(|| Failure::Job("the ledger's request is not readable".into()))?;
        // A storage that cannot be used now is no fault of the job.
        let is_away = || self.store.storage().is_some_and(Storage::is_in_trouble);
        self.store.present(&request.scene).map_err(|problem| match problem.status() {
            StatusCode::SERVICE_UNAVAILABLE if is_away() => Failure::Storage(problem.to_string()),
            StatusCode::SERVICE_UNAVAILABLE | StatusCode::INSUFFICIENT_STORAGE => {
                Failure::Disk(problem.to_string())
            }
            _ => Failure::Job(problem.to_string()),
        })?;
        self.open_scene(&request).map_err(Failure::Job)
    }

    /// Reads the scene of a request. A process of its own reads it first, whose end ends nothing else.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn open_scene(&self, request: &JobRequest) -> Result<OpenJob, String> {
        let JobRequest { scene, entry, spec, .. } = request;
        let path = self.store.entry(scene, entry.as_deref()).map_err(|problem| problem.to_string())?;
        let folder = self.store.scene_folder(scene);
        self.reader.open(spec, &path, &folder)
    }

    /// Reads a scene that was uploaded, without options, as those of jobs are read.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn read(&self, path: &Path, folder: &Path) -> Result<OpenJob, String> {
        self.reader.open(&RenderSpec::default(), path, folder)
    }

    fn plan(&self, job: &Job) -> Result<(), Failure> {
        let open_job = self.open(job)?;
        let frames = open_job.frames();
        let (count, most) = (frames.len() as u64, u64::from(self.limits.frames));
        if count > most {
            return Err(Failure::Job(format!(
                "frames: the job has {count}, and the limit is {most}; split it"
            )));
        }
        let samples = job.demand.pixels().saturating_mul(job.demand.spp.into()).saturating_mul(count);
        let most = self.limits.job_samples;
        if samples > most {
            return Err(Failure::Job(format!(
                "pixels × samples × frames: the job asks for {samples}, and the limit is {most}; split it"
            )));
        }
        let (width, height) = job.demand.size;
        let blocks = Blocks::new(width, height).count() as u64;
        Ok(self.ledger.plan(&job.id, frames, blocks * u64::from(job.demand.spp))?)
    }

    /// Opens a frame, with what the disk has of it.
    fn open_frame(&self, job: &Job, frame: u32) -> Result<(), Failure> {
        let open_job = self.open(job)?;
        let folder = self.frame_folder(&job.id, frame);
        let most_files = self.farm.most_files;
        let opened = OpenFrame::open(&self.ledger, (&job.id, frame), folder, open_job, most_files)?;
        let pending = self.ledger.pending(&job.id, frame)?;
        let comparisons: Vec<Comparison> =
            pending.into_iter().map(|pending| comparison(pending, &opened)).collect();
        let state = &mut *self.state();
        if let Some(run) = state.runs.get_mut(&job.id) {
            let opened = Arc::new(opened);
            state.opened.push(Arc::downgrade(&opened));
            run.frames.insert(frame, opened);
            state.comparisons.extend(comparisons);
        }
        Ok(())
    }

    /// Writes the pictures of a frame that has all samples.
    fn finish_frame(&self, job: &Job, frame: &OpenFrame) -> Result<(), Failure> {
        failpoint::pass("folding");
        if !self.ledger.pending(&job.id, frame.frame)?.is_empty() {
            // It looked complete before its last comparison was known.
            return Err(Failure::Stopped);
        }
        let picture = frame.state.lock().expect("no holder panics").gathering.develop();
        self.finish(job, (frame.frame, Some(frame.round)), &frame.open_job, &picture)?;
        frame.remove_files();
        let mut state = self.state();
        if let Some(run) = state.runs.get_mut(&job.id) {
            run.frames.remove(&frame.frame);
        }
        Ok(())
    }

    /// Renders a frame whose samples the time decides.
    fn whole(&self, job: &Job, frame: u32, watch: &UnitWatch) -> Result<(), Failure> {
        let open_job = self.open(job)?;
        let folder = self.frame_folder(&job.id, frame);
        std::fs::create_dir_all(&folder)?;
        let checkpoint = folder.join("checkpoint");
        let (began, spent) = (Instant::now(), Duration::from_millis(job.spent_ms.max(0) as u64));
        let picture = open_job.whole(frame, &checkpoint, spent, watch).map_err(Failure::Job)?;
        let spent = spent + began.elapsed();
        self.ledger.set_spent(&job.id, spent.as_millis() as i64)?;
        let picture = picture.ok_or(Failure::Stopped)?;
        self.finish(job, (frame, None), &open_job, &picture)?;
        results::remove(&checkpoint);
        Ok(())
    }

    /// Writes the pictures of a frame, also to the storage if there is one, and then its row of the ledger.
    fn finish(
        &self,
        job: &Job,
        (frame, round): (u32, Option<u32>),
        open_job: &OpenJob,
        picture: &Picture,
    ) -> Result<(), Failure> {
        let folder = self.frame_folder(&job.id, frame);
        std::fs::create_dir_all(&folder)?;
        let write = |extension: &str| {
            let path = folder.join(PICTURE).with_extension(extension);
            open_job.write(picture, &path).map_err(Failure::Disk)?;
            Ok(File::open(&path)?.sync_all()?)
        };
        // At the same time: compressing them is most of the time between a job's last unit and its end.
        std::thread::scope(|scope| {
            let writing = ["npz", "exr", "png"].map(|extension| scope.spawn(move || write(extension)));
            writing.map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
        })
        .into_iter()
        .collect::<Result<(), Failure>>()?;
        let mut folder = Some(&*folder);
        for _ in 0..3 {
            // The folder of the frame, of the job, and of all jobs.
            folder.map_or(Ok(()), sync_folder)?;
            folder = folder.and_then(Path::parent);
        }
        let objects = self.store.put_pictures(&job.id, frame)?;
        let json = |value: serde_json::Result<String>| value.map_err(|error| Failure::Job(error.to_string()));
        let row = FrameRow {
            number: frame,
            name: String::new(),
            hash: Some(picture.hash()),
            layers: Some(json(serde_json::to_string(&picture.layer_hashes()))?),
            metadata: Some(json(serde_json::to_string(&picture.metadata))?),
            objects,
        };
        // A frame that has begun anew meanwhile is not finished.
        if self.ledger.finish_frame(&job.id, row, round)? { Ok(()) } else { Err(Failure::Stopped) }
    }

    fn frame_folder(&self, job: &str, frame: u32) -> PathBuf {
        self.store.job_folder(job).join(format!("frame-{frame}"))
    }
}

/// A comparison that an earlier opening of a frame has left.
fn comparison(pending: Pending, frame: &OpenFrame) -> Comparison {
    let Pending { unit, blocks, name } = pending;
    let (key, digest) = (unit.worker.clone().unwrap_or_default(), unit.digest.clone().unwrap_or_default());
    let id = UnitId { copy: 1, ..frame.id(&unit) };
    Comparison { id, row: unit, blocks, first: Party { key, name, digest } }
}

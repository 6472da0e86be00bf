//! What the service's own threads do for a job: plan it, open and finish its frames, render frames whose samples the
//! time decides, and judge between workers that disagree.

use super::frame::OpenFrame;
use super::results::{self, PICTURE};
use super::{NAP, Runner};
use crate::farm::UnitWatch;
use crate::files::sync_folder;
use crate::film::Picture;
use crate::picture::Watch;
use crate::render::{Blocks, Pass};
use crate::serve::api::JobRequest;
use crate::serve::ledger::{FrameRow, Job, JobState, LedgerError, UnitRow};
use crate::serve::{OpenJob, failpoint, hex};
use sha2::{Digest, Sha256};
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
    /// Render a unit that has other sums from one worker than from another.
    Arbitrate { row: UnitRow, blocks: Vec<u32>, parties: [(String, String); 2] },
}

/// Which task of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskKey {
    Plan,
    Open { frame: u32 },
    Finish { frame: u32 },
    Whole { frame: u32 },
    Arbitrate { frame: u32, pass: u64, number: u32 },
}

impl TaskKey {
    /// The frame that it opens or renders.
    pub fn frame(self) -> Option<u32> {
        match self {
            Self::Open { frame } | Self::Finish { frame } | Self::Whole { frame } => Some(frame),
            Self::Plan | Self::Arbitrate { .. } => None,
        }
    }
}

impl Task {
    /// Which it is.
    pub fn key(&self) -> TaskKey {
        match self {
            Self::Plan => TaskKey::Plan,
            Self::Open { frame } => TaskKey::Open { frame: *frame },
            Self::Finish(frame) => TaskKey::Finish { frame: frame.frame },
            Self::Whole { frame } => TaskKey::Whole { frame: *frame },
            Self::Arbitrate { row, .. } => {
                TaskKey::Arbitrate { frame: row.frame, pass: row.pass, number: row.number }
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
            Ok(()) | Err(Failure::Stopped) => false,
            Err(Failure::Disk(error)) => {
                log::warn!("job {}: {error}; the next try is in {} s", job.id, NAP.as_secs());
                true
            }
            Err(Failure::Job(error)) => {
                log::warn!("job {}: {error}", job.id);
                let active = &[JobState::Queued, JobState::Running];
                self.stop_job(&job.id);
                let failed = self.ledger.set_state(&job.id, active, JobState::Failed, Some(error));
                failed.inspect_err(|error| log::warn!("job {}: {error}", job.id)).is_err()
            }
        }
    }

    fn run(&self, job: &Job, task: &Task, watch: &UnitWatch) -> Result<(), Failure> {
        if watch.is_stopped_now() {
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
            Task::Arbitrate { row, blocks, parties } => self.arbitrate(job, row, blocks, parties, watch),
        };
        // Whatever a stopped task says, nothing is wrong with it.
        if watch.is_stopped() && matches!(done, Err(Failure::Job(_))) { Err(Failure::Stopped) } else { done }
    }

    /// Reads the scene of a job, or finds it in the cache.
    fn open(&self, job: &Job) -> Result<OpenJob, Failure> {
        let request = JobRequest::of(job);
        let request = request.ok_or_else(|| Failure::Job("the ledger's request is not readable".into()))?;
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

    fn plan(&self, job: &Job) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let frames = shots.frames();
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
        let shots = self.open(job)?;
        let folder = self.frame_folder(&job.id, frame);
        let most_files = self.farm.most_files;
        let opened = OpenFrame::open(&self.ledger, (&job.id, frame), folder, shots, most_files)?;
        let mut state = self.state();
        if let Some(run) = state.runs.get_mut(&job.id) {
            run.frames.insert(frame, Arc::new(opened));
        }
        Ok(())
    }

    /// Writes the pictures of a frame that has all samples.
    fn finish_frame(&self, job: &Job, frame: &OpenFrame) -> Result<(), Failure> {
        failpoint::pass("folding");
        let picture = frame.state.lock().expect("no holder panics").gathering.develop();
        self.finish(job, frame.frame, &frame.shots, &picture)?;
        frame.remove_files();
        let mut state = self.state();
        if let Some(run) = state.runs.get_mut(&job.id) {
            run.frames.remove(&frame.frame);
        }
        Ok(())
    }

    /// Renders a frame whose samples the time decides.
    fn whole(&self, job: &Job, frame: u32, watch: &UnitWatch) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let folder = self.frame_folder(&job.id, frame);
        std::fs::create_dir_all(&folder)?;
        let checkpoint = folder.join("checkpoint");
        let (began, spent) = (Instant::now(), Duration::from_millis(job.spent_ms.max(0) as u64));
        let picture = shots.whole(frame, &checkpoint, spent, watch).map_err(Failure::Job)?;
        let spent = spent + began.elapsed();
        self.ledger.set_spent(&job.id, spent.as_millis() as i64)?;
        let picture = picture.ok_or(Failure::Stopped)?;
        self.finish(job, frame, &shots, &picture)?;
        results::remove(&checkpoint);
        Ok(())
    }

    /// Renders a unit that has other sums from one worker than from another. Who was wrong gets no more units, and
    /// frames to which it has contributed begin anew.
    fn arbitrate(
        &self,
        job: &Job,
        row: &UnitRow,
        blocks: &[u32],
        parties: &[(String, String); 2],
        watch: &UnitWatch,
    ) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let piece = Pass::new(blocks.into(), row.first..row.end);
        let patch = shots.patch(row.frame, piece, watch).map_err(Failure::Job)?;
        let own = hex(&Sha256::digest(patch.sums()));
        for (worker, _) in parties.iter().filter(|(_, digest)| *digest != own) {
            let reason = format!(
                "samples {}..{} of frame {} of job {} have other sums there than on two other machines; check its \
                 memory and drivers",
                row.first, row.end, row.frame, job.id
            );
            log::error!("worker {worker}: quarantined: {reason}");
            self.ledger.quarantine(worker, &reason)?;
            self.state().workers.quarantine(worker, &reason);
            for (job, frame) in self.ledger.frames_of_worker(worker)? {
                let state = self.state();
                let open = state.runs.get(&job).and_then(|run| run.frames.get(&frame)).cloned();
                drop(state);
                match open {
                    Some(open) => open.begin_anew(&self.ledger)?,
                    None => self.ledger.begin_anew(&job, frame)?,
                }
            }
        }
        Ok(())
    }

    /// Writes the pictures of a frame and then its row of the ledger.
    fn finish(&self, job: &Job, frame: u32, shots: &OpenJob, picture: &Picture) -> Result<(), Failure> {
        let folder = self.frame_folder(&job.id, frame);
        std::fs::create_dir_all(&folder)?;
        let write = |extension: &str| {
            let path = folder.join(PICTURE).with_extension(extension);
            shots.write(picture, &path).map_err(Failure::Disk)?;
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
        let json = |value: serde_json::Result<String>| value.map_err(|error| Failure::Job(error.to_string()));
        let row = FrameRow {
            number: frame,
            name: String::new(),
            hash: Some(picture.image.hash()),
            layers: Some(json(serde_json::to_string(&picture.layer_hashes()))?),
            metadata: Some(json(serde_json::to_string(&picture.metadata))?),
        };
        Ok(self.ledger.finish_frame(&job.id, row)?)
    }

    fn frame_folder(&self, job: &str, frame: u32) -> PathBuf {
        self.store.job_folder(job).join(format!("frame-{frame}"))
    }
}

//! What a thread does for a job: plans it, renders a unit, adds up the films of a frame.

use super::results::{self, FILM, PICTURE};
use super::watch::UnitWatch;
use super::{Runner, units};
use crate::files::sync_folder;
use crate::film::Picture;
use crate::render::{PartialFilm, PartialFilmError};
use crate::serve::api::JobRequest;
use crate::serve::ledger::{FrameRow, Job, JobState, LedgerError, UnitRow};
use crate::serve::{Kind, Shots, Watch, failpoint};
use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often a unit is tried before its job fails.
pub(super) const MOST_ATTEMPTS: u32 = 3;

/// Something to do for a job.
#[derive(Clone, Debug)]
pub(super) enum Task {
    /// Find out its frames and units.
    Plan,
    /// Render samples of a frame.
    Unit(UnitRow),
    /// Add up the films of a frame and write its pictures.
    Fold { frame: u32 },
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
    /// Does a task.
    pub(super) fn run(&self, job: &Job, task: &Task, watch: &UnitWatch) -> Result<(), Failure> {
        if watch.is_stopped() {
            return Err(Failure::Stopped);
        }
        if job.is_planned && job.state == JobState::Queued {
            self.ledger.set_state(&job.id, &[JobState::Queued], JobState::Running, None)?;
        }
        let done = match task {
            Task::Plan => self.plan(job),
            Task::Unit(unit) if job.demand.kind == Kind::Samples => self.film(job, unit, watch),
            Task::Unit(unit) => self.whole(job, unit, watch),
            Task::Fold { frame } => self.fold(job, *frame),
        };
        // Whatever a stopped unit says, nothing is wrong with it.
        if watch.is_stopped() && matches!(done, Err(Failure::Job(_))) { Err(Failure::Stopped) } else { done }
    }

    /// Reads the scene of a job, or finds it in the cache.
    fn open(&self, job: &Job) -> Result<Box<dyn Shots>, Failure> {
        let request = JobRequest::of(job);
        let request = request.ok_or_else(|| Failure::Job("the ledger's request is not readable".into()))?;
        self.open_scene(&request).map_err(Failure::Job)
    }

    /// Reads the scene of a request. A process of its own reads it first, whose end ends nothing else.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn open_scene(&self, request: &JobRequest) -> Result<Box<dyn Shots>, String> {
        let JobRequest { scene, entry, options, .. } = request;
        let path = self.store.entry(scene, entry.as_deref()).map_err(|problem| problem.to_string())?;
        let folder = self.store.scene_folder(scene);
        self.reader.open(options, &path, &folder)
    }

    fn plan(&self, job: &Job) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let frames = shots.frames().map_err(Failure::Job)?;
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
        Ok(self.ledger.plan(&job.id, frames, units::cut(&job.demand, self.limits.unit_samples))?)
    }

    /// Renders a range of samples and keeps its film. A frame of one unit gets its pictures at once.
    fn film(&self, job: &Job, unit: &UnitRow, watch: &UnitWatch) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let film = shots.film(unit.frame, unit.first..unit.end, watch).map_err(Failure::Job)?;
        if film.header().missing().is_empty() {
            let picture = shots.develop(unit.frame, &film).map_err(Failure::Job)?;
            return self.finish(job, unit.frame, &*shots, &picture);
        }
        let path = self.film_path(&job.id, unit.frame, unit.first);
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder)?;
        results::write_film(&path, &film).map_err(|error| Failure::Disk(error.to_string()))?;
        sync_folder(folder)?;
        failpoint::pass("film-written");
        self.ledger.finish_unit(&job.id, unit.clone())?;
        Ok(())
    }

    /// Renders a frame whose samples its noise or the time decides.
    fn whole(&self, job: &Job, unit: &UnitRow, watch: &UnitWatch) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let folder = self.frame_folder(&job.id, unit.frame);
        std::fs::create_dir_all(&folder)?;
        let checkpoint = folder.join("checkpoint");
        let (began, spent) = (Instant::now(), Duration::from_millis(job.spent_ms.max(0) as u64));
        let picture = shots.whole(unit.frame, &checkpoint, spent, watch).map_err(Failure::Job)?;
        let spent = spent + began.elapsed();
        if job.demand.kind == Kind::Seconds {
            self.ledger.set_spent(&job.id, spent.as_millis() as i64)?;
        }
        let picture = picture.ok_or(Failure::Stopped)?;
        self.finish(job, unit.frame, &*shots, &picture)?;
        results::remove(&checkpoint);
        Ok(())
    }

    /// Adds up the films of a frame, one after another.
    fn fold(&self, job: &Job, frame: u32) -> Result<(), Failure> {
        let shots = self.open(job)?;
        let units = self.ledger.units_of(&job.id, frame)?;
        let mut sum: Option<PartialFilm> = None;
        for unit in &units {
            let path = self.film_path(&job.id, frame, unit.first);
            let added = read_film(&path).and_then(|film| match &mut sum {
                None => {
                    sum = Some(film);
                    Ok(())
                }
                Some(sum) => sum.add(&film),
            });
            match added {
                Ok(()) => {}
                Err(PartialFilmError::Memory(error)) => return Err(Failure::Disk(error.to_string())),
                Err(error) => {
                    log::warn!("{}: {error}; its samples are rendered again", path.display());
                    self.ledger.reopen_unit(&job.id, unit.clone())?;
                    return Err(Failure::Stopped);
                }
            }
        }
        let sum = sum.ok_or_else(|| Failure::Job(format!("frame {frame} has no units")))?;
        failpoint::pass("folding");
        let picture = shots.develop(frame, &sum).map_err(Failure::Job)?;
        self.finish(job, frame, &*shots, &picture)?;
        units.iter().for_each(|unit| results::remove(&self.film_path(&job.id, frame, unit.first)));
        Ok(())
    }

    /// Writes the pictures of a frame and then its row of the ledger.
    fn finish(&self, job: &Job, frame: u32, shots: &dyn Shots, picture: &Picture) -> Result<(), Failure> {
        let folder = self.frame_folder(&job.id, frame);
        std::fs::create_dir_all(&folder)?;
        for extension in ["npz", "exr", "png"] {
            let path = folder.join(PICTURE).with_extension(extension);
            shots.write(picture, &path).map_err(Failure::Disk)?;
            File::open(&path)?.sync_all()?;
        }
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

    fn film_path(&self, job: &str, frame: u32, first: u32) -> PathBuf {
        self.frame_folder(job, frame).join(format!("{FILM}{first}.rayfilm"))
    }
}

fn read_film(path: &Path) -> Result<PartialFilm, PartialFilmError> {
    PartialFilm::read(BufReader::new(File::open(path)?))
}

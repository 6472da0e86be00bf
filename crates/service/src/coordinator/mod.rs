//! Works on jobs: plans them, lets workers render their units, and adds up what comes back.
//!
//! ```text
//! planner: jobs ─▶ open frames ─▶ units ─▶ answers, lending ─▶ workers   tasks: plan, open, finish a frame
//!                       ▲                                       │
//!                       └── verdicts: sums on the disk, in the ledger, in memory ◀┘
//! ```
//!
//! A unit is a piece of a frame's pass. The ledger is the record: whatever ends the process, a bus or a worker, units
//! without sums are given out again, and no sample is counted twice (`frame.rs`). Without a bus of many machines the
//! workers are threads of this process, and everything else is the same.

mod answers;
mod audit;
mod backup;
pub mod copies;
mod data_folder;
pub mod decisions;
mod files;
mod frame;
mod judge;
pub mod ledger;
mod lending;
mod measured;
mod own_scene;
mod planner;
mod request;
pub mod results;
mod retention;
mod secret;
pub mod storage;
pub mod store;
mod task;
mod thread_clock;
mod trouble;
mod verdicts;
mod workers;

pub use audit::AuditLog;
pub use backup::{BackupError, Copied, backup, restore};
pub use data_folder::{DataFolder, FolderError};
pub use own_scene::{KeptScene, OwnScene};
pub use request::{JobRequest, Webhook, parse_priority};
pub use retention::Retention;
pub use secret::{Secret, hmac};
pub use workers::ShownWorker;

use crate::backend::{RenderBackend, SceneReader};
use crate::bus::{LocalBus, WorkBus};
use crate::contract::{LEASE, Limits, UnitId, UnitWatch, is_sha256};
use crate::worker::{NoScene, SceneSource, Worker, WorkerOptions};
use decisions::{Sizes, Speed, TASK_THREADS};
use files::SceneFiles;
use frame::OpenFrame;
use ledger::{Job, Ledger, LedgerError};
use lending::{Comparison, Outstanding};
use measured::Measured;
use raystream::schedule::Priority;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use store::Store;
use task::{Task, TaskKey};
use trouble::Trouble;
use workers::Workers;

/// Units under way at the same time in this process: while the last paths of one end, others keep the threads busy.
const UNITS_IN_FLIGHT: u32 = 3;

/// How long a task rests after the disk or the ledger has refused.
const NAP: Duration = Duration::from_secs(2);

/// The way in which the units of jobs reach their workers.
#[derive(Clone, Default)]
pub struct FarmOptions {
    /// The bus to workers on other machines. None: this process renders by itself.
    pub bus: Option<Arc<dyn WorkBus>>,
    /// Cut units at random with this seed, for tests.
    pub random_units: Option<u64>,
    /// Files of units of a frame before they are added up into one, for tests.
    pub most_files: Option<usize>,
    /// The share of units that two workers render, from 0 to 1.
    pub compared_share: f64,
    /// Workers that render units at the same time, at most; others stand by. None: as many as help.
    pub most_workers: Option<usize>,
}

impl std::fmt::Debug for FarmOptions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FarmOptions").field("has_bus", &self.bus.is_some()).finish_non_exhaustive()
    }
}

/// The content of a data folder, and bounds of what is kept of it.
#[derive(Debug)]
pub struct Record {
    /// The ledger.
    pub ledger: Arc<Ledger>,
    /// The files.
    pub store: Arc<Store>,
    /// The key of leases and draws.
    pub secret: Secret,
    /// Bounds of what is kept.
    pub retention: Retention,
    /// The SHA-256 of the service's own scene, which stays.
    pub own_scene: Option<String>,
}

/// Works on jobs.
pub struct Runner {
    pub(super) ledger: Arc<Ledger>,
    pub(super) store: Arc<Store>,
    secret: Secret,
    pub(super) reader: SceneReader,
    pub(super) limits: Limits,
    farm: FarmOptions,
    bus: Arc<dyn WorkBus>,
    /// What renders in this process.
    own: Option<Arc<Worker>>,
    files: SceneFiles,
    pub(super) trouble: Trouble,
    state: Mutex<State>,
    changed: Condvar,
    queued: Mutex<VecDeque<(Job, Task, Arc<UnitWatch>)>>,
    has_queued: Condvar,
    /// Called when a job was deleted, or the service ends.
    has_ended: Condvar,
    retention: Retention,
    /// The scene of the service itself.
    own_scene: Option<String>,
    ending: AtomicBool,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

/// What is under way.
#[derive(Default)]
struct State {
    runs: HashMap<String, Run>,
    /// Units that workers may have, or have.
    outstanding: HashMap<UnitId, Outstanding>,
    /// Units that a second worker is to render.
    comparisons: VecDeque<Comparison>,
    workers: Workers,
    measured: Measured,
    /// When it was last decided how many workers help.
    invited: Option<Instant>,
    /// Scenes of views, each for as long as its view is open.
    views: Vec<(String, Weak<()>)>,
    /// True if open frames have fewer units than are wanted.
    is_short: bool,
    /// The place of the next unit among those that workers may have.
    offered: u64,
    /// True if a worker has asked for a unit in vain since the bell was last rung.
    is_hungry: bool,
    /// When silent workers were last looked for.
    swept: Option<Instant>,
    /// Counts calls of [`Runner::wake`].
    wakes: u64,
    /// Counts how often the planner has looked at the ledger.
    plans: u64,
    /// Frames that were opened, and may still be written to.
    opened: Vec<Weak<OpenFrame>>,
    /// Jobs on which nothing has worked since the planner had looked so often.
    resting: HashMap<String, u64>,
}

/// A job that is worked on.
struct Run {
    job: Job,
    given: u64,
    /// Samples that it has, those of an earlier process as far as they are known.
    kept: f64,
    /// Bytes of its scene.
    scene_bytes: u64,
    /// How fast its units are.
    speed: Speed,
    frames: BTreeMap<u32, Arc<OpenFrame>>,
    /// True if it has frames that are neither open nor being opened.
    has_more: bool,
    /// The tasks under way: which, and what steers it.
    tasks: Vec<(TaskKey, Arc<UnitWatch>)>,
    /// No task begins before.
    rests_until: Option<Instant>,
}

impl Run {
    /// Seconds of a slot that the rest of it takes.
    fn rest_s(&self) -> f64 {
        (self.job.demand.samples() as f64 - self.kept).max(0.0) / self.speed.samples_per_second()
    }
}

impl std::fmt::Debug for Runner {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Runner").field("limits", &self.limits).finish_non_exhaustive()
    }
}

impl Runner {
    /// Starts the threads. Jobs that an earlier process left go on.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn start(
        record: Record,
        backend: Arc<RenderBackend>,
        limits: Limits,
        farm: FarmOptions,
    ) -> std::io::Result<Arc<Self>> {
        let Record { ledger, store, secret, retention, own_scene } = record;
        let bus = farm.bus.clone().unwrap_or_else(|| Arc::new(LocalBus::default()));
        let own = farm.bus.is_none().then(|| {
            let options = WorkerOptions {
                name: "this process".into(),
                host: "localhost".into(),
                units: "this process".into(),
                slots: UNITS_IN_FLIGHT,
                idle: None,
                // Views of this process have its threads anyway.
                is_live: false,
                mischief: None,
            };
            let scenes = Arc::new(StoredScenes(Arc::clone(&store)));
            Worker::new(options, Arc::clone(&bus), scenes, SceneReader::new(Arc::clone(&backend), limits))
        });
        let quarantined = ledger.quarantined().map_err(std::io::Error::other)?;
        let state = State { workers: Workers::new(quarantined), ..State::default() };
        let runner = Arc::new(Self {
            ledger,
            store,
            secret,
            reader: SceneReader::new(backend, limits),
            limits,
            farm,
            bus,
            own,
            files: SceneFiles::default(),
            trouble: Trouble::of_data_folder(),
            state: Mutex::new(state),
            changed: Condvar::new(),
            queued: Mutex::default(),
            has_queued: Condvar::new(),
            has_ended: Condvar::new(),
            retention,
            own_scene,
            ending: AtomicBool::new(false),
            threads: Mutex::default(),
        });
        runner.start_threads()?;
        Ok(runner)
    }

    fn start_threads(self: &Arc<Self>) -> std::io::Result<()> {
        self.bus.attend(answers::of(self)).map_err(std::io::Error::other)?;
        let spawn = |name: String, work: fn(&Self)| {
            let own = Arc::clone(self);
            let thread = std::thread::Builder::new().name(name).stack_size(8 << 20);
            thread.spawn(move || work(&own))
        };
        let mut threads =
            vec![spawn("planner".into(), Self::plan_jobs)?, spawn("retention".into(), Self::retain)?];
        for index in 0..TASK_THREADS {
            threads.push(spawn(format!("task {index}"), Self::do_tasks)?);
        }
        if let Some(worker) = self.own.clone() {
            let thread = std::thread::Builder::new().name("worker".into());
            threads.push(thread.spawn(move || {
                worker.run().unwrap_or_else(|error| log::error!("this process does not render: {error}"));
            })?);
        }
        self.threads.lock().expect("no holder panics").extend(threads);
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no holder panics")
    }

    /// How units are cut.
    fn sizes(&self, at_once: usize) -> Sizes {
        let is_local = self.own.is_some();
        Sizes { samples: self.limits.unit_samples, random: self.farm.random_units, at_once, is_local }
    }

    /// Tells that there may be something to do.
    pub fn wake(&self) {
        self.state().wakes += 1;
        self.changed.notify_all();
    }

    /// Stops what is under way for a job that the ledger does not call active any more. Returns at once.
    pub fn stop_job(&self, job: &str) {
        let state = self.state();
        let tasks = state.runs.get(job).into_iter().flat_map(|run| &run.tasks);
        tasks.for_each(|(_, watch)| watch.stop());
        drop(state);
        if let Some(worker) = &self.own {
            worker.stop_job(job);
        }
        self.wake();
    }

    /// Changes how urgent the units of a job are that are under way in this process, and those that will be offered.
    pub fn set_priority(&self, job: &str, priority: Priority) {
        let state = self.state();
        let tasks = state.runs.get(job).into_iter().flat_map(|run| &run.tasks);
        tasks.for_each(|(_, watch)| watch.set_priority(priority));
        drop(state);
        if let Some(worker) = &self.own {
            worker.set_priority(job, priority);
        }
        self.wake();
    }

    /// The share of a job that frames under way have done whose samples the time decides.
    pub fn share(&self, job: &str) -> f64 {
        let state = self.state();
        let Some(run) = state.runs.get(job) else { return 0.0 };
        let frames = f64::from(run.job.demand.frames.unwrap_or(1).max(1));
        run.tasks.iter().map(|(_, watch)| watch.share() / frames).sum()
    }

    /// The bus to workers on other machines, if this process is a coordinator.
    pub fn bus(&self) -> Option<&Arc<dyn WorkBus>> {
        self.farm.bus.as_ref()
    }

    /// A function that names the workers that may render tiles of a scene, with their addresses. They may fetch the
    /// scene for as long as it is held.
    pub fn tile_workers(
        self: &Arc<Self>,
        sha256: &str,
    ) -> impl Fn() -> Vec<(String, String)> + Send + Sync + use<> {
        let (own, view) = (Arc::downgrade(self), Arc::new(()));
        let mut state = self.state();
        state.views.retain(|(_, view)| view.strong_count() > 0);
        state.views.push((sha256.to_owned(), Arc::downgrade(&view)));
        drop(state);
        move || {
            let _is_open = &view;
            let runner = own.upgrade();
            runner.map_or_else(Vec::new, |runner| runner.state().workers.live(runner.bus.lease_time()))
        }
    }

    /// True if workers may have the files of a scene: one that was uploaded, of a job that runs or of an open view.
    fn is_shared(&self, scene: &str) -> bool {
        let is_wanted = || {
            let state = self.state();
            let is_run = |run: &Run| planner::is_active(run.job.state) && run.job.scene == scene;
            let is_viewed = |(own, view): &(String, Weak<()>)| own == scene && view.strong_count() > 0;
            state.runs.values().any(is_run) || state.views.iter().any(is_viewed)
        };
        is_sha256(scene) && is_wanted() && self.ledger.scene(scene).is_ok_and(|bytes| bytes.is_some())
    }

    /// The workers, by name.
    pub fn workers(&self) -> Vec<ShownWorker> {
        self.state().workers.shown(LEASE)
    }

    /// Lets a worker take units again, by its key. False if it was neither in quarantine nor at rest.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn trust(&self, key: &str) -> Result<bool, LedgerError> {
        let was_quarantined = self.ledger.trust(key)?;
        Ok(self.state().workers.trust(key) || was_quarantined)
    }

    /// The number of units that workers may have, or have.
    pub fn outstanding(&self) -> usize {
        self.state().outstanding.len()
    }

    /// Stops all units of this process and waits for the threads. Jobs go on when the service is started again.
    pub fn stop(&self) {
        self.ending.store(true, SeqCst);
        for run in self.state().runs.values() {
            run.tasks.iter().for_each(|(_, watch)| watch.stop());
        }
        self.reader.end();
        if let Some(worker) = &self.own {
            worker.end();
        }
        self.wake();
        self.has_queued.notify_all();
        self.has_ended.notify_all();
        for thread in std::mem::take(&mut *self.threads.lock().expect("no holder panics")) {
            // Its panic has been reported.
            let _ = thread.join();
        }
    }
}

/// The scenes of the service's own folder.
struct StoredScenes(Arc<Store>);

impl SceneSource for StoredScenes {
    fn scene(&self, sha256: &str, entry: Option<&str>) -> Result<(PathBuf, PathBuf), NoScene> {
        self.0.present(sha256).map_err(|problem| NoScene::Now(problem.to_string()))?;
        let path = self.0.entry(sha256, entry).map_err(|problem| NoScene::Ever(problem.to_string()))?;
        Ok((path, self.0.scene_folder(sha256)))
    }

    fn counts(&self) -> (u64, u64) {
        (0, 0)
    }

    fn folder(&self, _: &str) -> Option<PathBuf> {
        None
    }

    /// The service's own scenes are what others are compared with.
    fn discard(&self, _: &str) {}
}

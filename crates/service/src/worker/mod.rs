//! Takes units from a bus, renders them, and sends back what they have become.

mod scene_source;
mod tile_renderer;

pub use scene_source::{DiskScenes, NoScene, SceneSource};

use crate::backend::{OpenJob, SceneReader};
use crate::bus::{BusError, WorkBus};
use crate::contract::{
    Answer, Ask, BEATS, Build, FailureReport, FinishedUnit, Granted, Held, JoinReply, Leased, REPORT, Report,
    ReportReply, ResultReply, TileServer, Unit, UnitId, UnitWatch, Wanted, WorkerInfo, digest, failpoint,
};
use raystream::render::{Pass, Patch};
use raystream::schedule::Priority;
use std::collections::HashMap;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tile_renderer::TileRenderer;

/// How long a slot waits for a unit before it asks again, and looks whether it is to end.
const LEASE_PATIENCE: Duration = Duration::from_millis(500);

/// How long a slot rests after what it could not render now, and a worker that is given no units.
const REST: Duration = Duration::from_secs(1);

/// How long a worker tries to send what it has rendered before it gives the unit back.
const SEND_PATIENCE: Duration = Duration::from_secs(60);

/// The first pause between two tries; each is twice as long as the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
const LAST_PAUSE: Duration = Duration::from_secs(2);

/// A unit to which nothing happens for this long hangs: another worker gets it.
const HANGS_AFTER: Duration = Duration::from_secs(600);

/// The byte that a worker changes that is to be found out: in the sum of the first pixel.
const CORRUPT: usize = 22;

/// Units that are kept back at the same time by a worker that holds them, for tests.
const HOARD: Duration = Duration::from_secs(3600);

/// The options with which a worker is started.
#[derive(Clone, Debug)]
pub struct WorkerOptions {
    /// Its name: no other worker's.
    pub name: String,
    /// Its machine.
    pub host: String,
    /// The units that trace, in words.
    pub units: String,
    /// Units that it renders at the same time: while the last paths of one end, others keep the threads busy.
    pub slots: u32,
    /// The time for which it waits for a unit before it leaves; `None` for ever.
    pub idle: Option<Duration>,
    /// True if it renders tiles of live views, too.
    pub is_live: bool,
    /// A fault that it commits on purpose, for tests.
    pub mischief: Option<Mischief>,
}

/// A fault that a worker of tests commits on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mischief {
    /// It changes a byte of the sums.
    Lie,
    /// It says that units cannot be rendered.
    Spoil,
    /// It keeps units and returns nothing.
    Hoard,
    /// It gives units back at once.
    Return,
}

impl FromStr for Mischief {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "lie" => Ok(Self::Lie),
            "spoil" => Ok(Self::Spoil),
            "hoard" => Ok(Self::Hoard),
            "return" => Ok(Self::Return),
            _ => Err("write lie, spoil, hoard or return".into()),
        }
    }
}

/// A worker.
pub struct Worker {
    options: WorkerOptions,
    bus: Arc<dyn WorkBus>,
    scenes: Arc<dyn SceneSource>,
    reader: Arc<SceneReader>,
    tiles: Arc<TileRenderer>,
    /// A number of this process's own.
    session: u64,
    /// Whether it hears what the coordinator asks.
    is_listening: AtomicBool,
    /// Held while a slot asks for a unit: one at a time, so that each names all units of the others.
    asking: Mutex<()>,
    active: Mutex<HashMap<UnitId, Active>>,
    is_draining: AtomicBool,
    /// The units under way are given back too.
    is_ending: AtomicBool,
    refused: Mutex<Option<String>>,
    /// Why it was last given no units.
    rests: Mutex<String>,
    /// Whether it stands by: the coordinator has workers enough.
    stands_by: AtomicBool,
    /// When scenes were last forgotten.
    discarded: Mutex<HashMap<String, Instant>>,
    last_unit: Mutex<Instant>,
    rays: AtomicU64,
    lease_time: Mutex<Duration>,
    /// Whether a unit has been stopped since the last report: who cancels a job waits for that.
    has_stopped: AtomicBool,
}

/// A unit under way.
struct Active {
    token: String,
    watch: Arc<UnitWatch>,
}

/// What has become of a unit.
struct Rendered {
    identity: String,
    patch: Patch,
    /// How long opening its scene took.
    opening_s: f64,
}

/// Why a unit has no film.
enum Failed {
    /// It is to be tried again, by anyone.
    GiveBack(String),
    /// It cannot be rendered.
    Unit(String),
}

impl std::fmt::Debug for Worker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Worker").field("options", &self.options).finish_non_exhaustive()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Worker {
    /// A worker that has not begun.
    pub fn new(
        options: WorkerOptions,
        bus: Arc<dyn WorkBus>,
        scenes: Arc<dyn SceneSource>,
        reader: SceneReader,
    ) -> Arc<Self> {
        let (lease_time, reader) = (Mutex::new(bus.lease_time()), Arc::new(reader));
        let tiles = TileRenderer::new(Arc::clone(&scenes), Arc::clone(&reader));
        Arc::new(Self {
            options,
            bus,
            scenes,
            reader,
            tiles,
            session: RandomState::new().build_hasher().finish(),
            is_listening: AtomicBool::new(false),
            asking: Mutex::default(),
            active: Mutex::default(),
            is_draining: AtomicBool::new(false),
            is_ending: AtomicBool::new(false),
            refused: Mutex::default(),
            rests: Mutex::default(),
            stands_by: AtomicBool::new(false),
            discarded: Mutex::default(),
            last_unit: Mutex::new(Instant::now()),
            rays: AtomicU64::new(0),
            lease_time,
            has_stopped: AtomicBool::new(false),
        })
    }

    /// Takes no more units and renders no more tiles; units under way are finished.
    pub fn drain(&self) {
        self.is_draining.store(true, Relaxed);
        self.tiles.end();
    }

    /// Takes no more units and gives back those under way.
    pub fn end(&self) {
        self.drain();
        self.is_ending.store(true, Relaxed);
        lock(&self.active).values().for_each(|unit| unit.watch.stop());
        self.reader.end();
    }

    /// Stops the units of a job.
    pub fn stop_job(&self, job: &str) {
        let active = lock(&self.active);
        active.iter().filter(|(id, _)| id.job == job).for_each(|(_, unit)| unit.watch.stop());
    }

    /// Changes how urgent the units of a job are that are under way.
    pub fn set_priority(&self, job: &str, priority: Priority) {
        let active = lock(&self.active);
        active.iter().filter(|(id, _)| id.job == job).for_each(|(_, unit)| unit.watch.set_priority(priority));
    }

    /// Works until it is drained or has been idle for long enough, or is refused.
    ///
    /// # Errors
    /// Why the coordinator refuses the worker, or the system refuses threads.
    pub fn run(self: &Arc<Self>) -> Result<(), String> {
        if self.options.is_live {
            match self.bus.listen(Arc::clone(&self.tiles) as Arc<dyn TileServer>) {
                Ok(()) => self.is_listening.store(true, Relaxed),
                Err(error) => log::warn!("the worker renders no tiles of live views: {error}"),
            }
        }
        self.join()?;
        let refused = |error: std::io::Error| format!("the system refuses a thread: {error}");
        let threads = self.start().map_err(refused)?;
        for thread in threads {
            // Its panic has been reported.
            let _ = thread.join();
        }
        // The coordinator would miss it soon anyway.
        let _ = self.bus.ask(Ask::Leave);
        lock(&self.refused).take().map_or(Ok(()), Err)
    }

    /// Starts the threads: one for each slot, one that reports, and one that renders tiles.
    fn start(self: &Arc<Self>) -> std::io::Result<Vec<JoinHandle<()>>> {
        let mut threads = Vec::new();
        let live = Arc::new(AtomicU64::new(u64::from(self.options.slots)));
        for slot in 0..self.options.slots {
            let (own, live) = (Arc::clone(self), Arc::clone(&live));
            let thread = std::thread::Builder::new().name(format!("unit {slot}")).stack_size(8 << 20);
            threads.push(thread.spawn(move || {
                own.slot();
                live.fetch_sub(1, Relaxed);
            })?);
        }
        let own = Arc::clone(self);
        threads.push(std::thread::Builder::new().name("report".into()).spawn(move || {
            let mut last = Instant::now();
            while live.load(Relaxed) > 0 {
                std::thread::sleep(Duration::from_millis(20));
                let rarely = *lock(&own.lease_time) / BEATS;
                let every = if own.stands_by.load(Relaxed) { rarely } else { REPORT.min(rarely) };
                if own.has_stopped.swap(false, Relaxed) || last.elapsed() >= every {
                    last = Instant::now();
                    own.report();
                }
            }
        })?);
        let tiles = Arc::clone(&self.tiles);
        threads.push(std::thread::Builder::new().name("live tiles".into()).spawn(move || tiles.run())?);
        Ok(threads)
    }

    /// Introduces itself, as often as it takes.
    fn join(&self) -> Result<(), String> {
        let WorkerOptions { name, host, units, slots, .. } = &self.options;
        let info = WorkerInfo {
            worker: name.clone(),
            host: host.clone(),
            build: Build::own(),
            session: self.session,
            slots: *slots,
            units: units.clone(),
            is_live: self.is_listening.load(Relaxed),
        };
        let mut told = false;
        loop {
            match self.bus.ask(Ask::Join(info.clone())) {
                Ok(Answer::Joined(JoinReply::Joined { lease_ms })) => {
                    *lock(&self.lease_time) = Duration::from_millis(lease_ms);
                    return Ok(());
                }
                Ok(Answer::Joined(JoinReply::Refused(why))) => return Err(why),
                Ok(_) | Err(_) if self.is_draining.load(Relaxed) => return Ok(()),
                other => {
                    if !told {
                        told = true;
                        let why = other.map_or_else(|error| error.to_string(), |_| "it answers oddly".into());
                        log::warn!("{why}; the worker waits for it");
                    }
                    std::thread::sleep(Duration::from_millis(200));
                }
            }
        }
    }

    /// Tells what it does, which renews its leases.
    fn report(&self) {
        let active = lock(&self.active);
        let lives = |unit: &&Active| unit.watch.still_for() < HANGS_AFTER || self.options.mischief.is_some();
        let held = active.iter().filter(|(_, unit)| lives(unit));
        let units = held.map(|(id, unit)| Held { unit: id.clone(), token: unit.token.clone() }).collect();
        drop(active);
        let report = Report {
            units,
            is_draining: self.is_draining.load(Relaxed),
            cache: self.scenes.counts(),
            rays: self.rays.load(Relaxed),
        };
        // An answer that does not come is asked for again.
        let Ok(Answer::Reported(ReportReply { stop, refused, is_unknown })) =
            self.bus.ask(Ask::Report(report))
        else {
            return;
        };
        let active = lock(&self.active);
        stop.iter().filter_map(|id| active.get(id)).for_each(|unit| unit.watch.stop());
        drop(active);
        if let Some(why) = refused {
            self.refuse(why);
        }
        if is_unknown && let Err(why) = self.join() {
            self.refuse(why);
        }
    }

    fn refuse(&self, why: String) {
        lock(&self.refused).get_or_insert(why);
        self.end();
    }

    /// A slot: one unit after another.
    fn slot(&self) {
        while !self.is_draining.load(Relaxed) {
            if let Some((leased, watch)) = self.lease() {
                *lock(&self.last_unit) = Instant::now();
                self.work(&leased, &watch);
                *lock(&self.last_unit) = Instant::now();
                continue;
            }
            let waited = lock(&self.last_unit).elapsed();
            if self.options.idle.is_some_and(|idle| waited >= idle) && lock(&self.active).is_empty() {
                self.drain();
            }
        }
    }

    /// Asks for a unit. If there is none, waits until there may be some.
    fn lease(&self) -> Option<(Box<Leased>, Arc<UnitWatch>)> {
        let _turn = lock(&self.asking);
        if self.is_draining.load(Relaxed) {
            return None;
        }
        let rings = self.bus.bell().rings();
        let have = lock(&self.active).keys().cloned().collect();
        let mut pause = LEASE_PATIENCE;
        match self.bus.ask(Ask::Lease(Wanted { session: self.session, have })) {
            Ok(Answer::Granted(Granted::Unit(leased))) => {
                let unit = &leased.unit;
                let priority = Priority::ALL.into_iter().find(|priority| priority.name() == unit.priority);
                let watch = Arc::new(UnitWatch::new(priority.unwrap_or(Priority::Normal)));
                let active = Active { token: leased.token.clone(), watch: Arc::clone(&watch) };
                lock(&self.active).insert(unit.id.clone(), active);
                self.stands_by.store(false, Relaxed);
                return Some((leased, watch));
            }
            Ok(Answer::Granted(Granted::None)) => {}
            Ok(Answer::Granted(Granted::StandBy)) => {
                self.stand_by();
                return None;
            }
            Ok(Answer::Granted(Granted::Rests(why))) => {
                let mut last = lock(&self.rests);
                if *last != why {
                    log::warn!("the coordinator gives no units: {why}");
                    *last = why;
                }
                pause = REST;
            }
            Ok(Answer::Granted(Granted::Refused(why))) => self.refuse(why),
            Ok(Answer::Granted(Granted::Unknown)) => {
                self.join().unwrap_or_else(|why| self.refuse(why));
                pause = Duration::ZERO;
            }
            other => {
                log::debug!("no unit: {other:?}");
                pause = FIRST_PAUSE;
            }
        }
        self.bus.bell().wait(rings, pause);
        None
    }

    /// Waits for a lease's time before it asks again, whatever units there may be meanwhile.
    fn stand_by(&self) {
        if !self.stands_by.swap(true, Relaxed) {
            log::info!("the coordinator has workers enough; this one stands by");
        }
        let (began, wait) = (Instant::now(), *lock(&self.lease_time));
        while began.elapsed() < wait && !self.is_draining.load(Relaxed) {
            std::thread::sleep(LEASE_PATIENCE.min(wait - began.elapsed().min(wait)));
        }
    }

    /// Renders a unit, whatever happens.
    fn work(&self, leased: &Leased, watch: &UnitWatch) {
        self.render(leased, watch);
        self.rays.fetch_add(watch.rays(), Relaxed);
        lock(&self.active).remove(&leased.unit.id);
        if watch.is_stopped_now() {
            self.has_stopped.store(true, Relaxed);
        }
    }

    /// Lets someone else have a unit.
    fn give_back(&self, held: Held) {
        // If that is lost, its lease ends a little later.
        if let Err(error) = self.bus.ask(Ask::GiveBack(held)) {
            log::debug!("{error}");
        }
    }

    fn render(&self, Leased { unit, token }: &Leased, watch: &UnitWatch) {
        let began = Instant::now();
        let held = || Held { unit: unit.id.clone(), token: token.clone() };
        let rendered = match self.options.mischief {
            Some(Mischief::Spoil) => Err(Failed::Unit("it is broken".into())),
            Some(Mischief::Return) => return self.give_back(held()),
            Some(Mischief::Hoard) => return self.hoard(watch),
            Some(Mischief::Lie) | None => self.try_patch(unit, watch),
        };
        if watch.is_stopped_now() {
            // Someone else renders it, or no one wants it.
            return if self.is_ending.load(Relaxed) {
                self.give_back(held())
            };
        }
        match rendered {
            Ok((Rendered { identity, patch, opening_s }, seconds)) => {
                failpoint::pass("unit-rendered");
                let mut sums = patch.into_sums();
                if self.options.mischief == Some(Mischief::Lie) && sums.len() > CORRUPT {
                    sums[CORRUPT] ^= 1;
                }
                let (blocks, samples) = (unit.blocks.clone(), unit.samples.clone());
                let digest = digest(&unit.id, &blocks, &samples, &sums);
                let (held, sums) = (held(), Arc::new(sums));
                let finished =
                    FinishedUnit { held, identity, blocks, samples, digest, seconds, opening_s, sums };
                self.send((unit, began), watch, finished);
            }
            Err(Failed::GiveBack(why)) => {
                log::warn!("unit {}: {why}; it is given back", unit.id);
                self.give_back(held());
                std::thread::sleep(REST);
            }
            Err(Failed::Unit(error)) => {
                log::warn!("unit {}: {error}", unit.id);
                let failure = Ask::Failure(FailureReport { held: held(), error });
                if self.persist(watch, || self.bus.ask(failure.clone())).is_none() {
                    self.give_back(held());
                }
            }
        }
    }

    /// Renders a unit; a panic is a failure. Returns the seconds that it has taken, too.
    fn try_patch(&self, unit: &Unit, watch: &UnitWatch) -> Result<(Rendered, f64), Failed> {
        let began = Instant::now();
        unit.check().map_err(Failed::Unit)?;
        let rendered = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| self.patch(unit, watch)));
        let panicked = |_| Err(Failed::Unit("it panicked; see the worker's log".into()));
        let rendered = rendered.unwrap_or_else(panicked)?;
        Ok((rendered, began.elapsed().as_secs_f64()))
    }

    /// Does nothing with a unit, for tests.
    fn hoard(&self, watch: &UnitWatch) {
        let began = Instant::now();
        while began.elapsed() < HOARD && !watch.is_stopped_now() && !self.is_draining.load(Relaxed) {
            std::thread::sleep(FIRST_PAUSE);
        }
    }

    /// Sends a film until the coordinator has it on its disk. Only then does the lease end.
    fn send(&self, (unit, began): (&Unit, Instant), watch: &UnitWatch, result: FinishedUnit) {
        let held = result.held.clone();
        let ask = Ask::Result(result);
        let answer = self.persist(watch, || match self.bus.ask(ask.clone())? {
            Answer::Result(ResultReply::Later) => Err(BusError::Refused("its disk or ledger refuses".into())),
            answer => Ok(answer),
        });
        failpoint::pass("result-sent");
        match answer {
            Some(Answer::Result(ResultReply::Anew(why))) => {
                log::warn!("unit {}: the coordinator refuses it: {why}; the scene is fetched anew", unit.id);
                self.discard(&unit.scene, began);
            }
            Some(Answer::Result(ResultReply::Refused(why))) => {
                log::warn!("unit {}: the coordinator refuses it: {why}", unit.id);
            }
            Some(_) => {}
            None => self.give_back(held),
        }
    }

    /// Forgets a scene, on the disk and in memory, unless that has been done since a unit of it began.
    fn discard(&self, scene: &str, began: Instant) {
        let mut discarded = lock(&self.discarded);
        if discarded.get(scene).is_some_and(|last| began < *last) {
            return;
        }
        if let Some(folder) = self.scenes.folder(scene) {
            self.scenes.discard(scene);
            self.reader.forget(&folder);
        }
        discarded.insert(scene.to_owned(), Instant::now());
    }

    /// Asks again and again, with pauses. `None` if there is no answer for too long, or the unit is stopped.
    fn persist(&self, watch: &UnitWatch, ask: impl Fn() -> Result<Answer, BusError>) -> Option<Answer> {
        let (began, mut pause) = (Instant::now(), FIRST_PAUSE);
        loop {
            match ask() {
                Ok(answer) => return Some(answer),
                Err(error) => log::debug!("{error}"),
            }
            if began.elapsed() > SEND_PATIENCE || watch.is_stopped_now() {
                return None;
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(LAST_PAUSE);
        }
    }

    fn patch(&self, unit: &Unit, watch: &UnitWatch) -> Result<Rendered, Failed> {
        let began = Instant::now();
        let open_job = self.open(unit)?;
        let opening_s = began.elapsed().as_secs_f64();
        let frame = unit.id.frame;
        let identity = open_job.identity(frame).map_err(Failed::Unit)?;
        let piece = Pass::new(unit.blocks.clone().into(), unit.samples.clone());
        let patch = open_job.patch(frame, piece, watch).map_err(Failed::Unit)?;
        Ok(Rendered { identity, patch, opening_s })
    }

    /// The job of a unit, whose scene is read once for many units.
    fn open(&self, unit: &Unit) -> Result<OpenJob, Failed> {
        let (path, folder) =
            self.scenes.scene(&unit.scene, unit.entry.as_deref()).map_err(|error| match error {
                NoScene::Now(_) => Failed::GiveBack(error.to_string()),
                NoScene::Ever(_) => Failed::Unit(error.to_string()),
            })?;
        self.reader.open(&unit.spec, &path, &folder).map_err(Failed::Unit)
    }
}

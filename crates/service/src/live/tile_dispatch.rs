//! Workers on other machines that render rows of a view's moving frames.

use super::decisions::{self, Division, Late, MOST_MISSES, REST, Record, Speed};
use super::inbox::Inbox;
use super::strips::{self, STRIP_ROWS};
use super::{WorkerShare, encoder};
use crate::bus::{BusError, WorkBus};
use crate::contract::{LiveAnswer, LiveAsk, LiveScene, Tile, TileAsk};
use std::fmt;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The pause between two looks at who is there.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// The longest wait for an answer. A worker from which none has come is not asked meanwhile.
const PATIENCE: Duration = Duration::from_millis(500);

/// Workers that have not been there for this long are not shown any more.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(60);

/// How a view reaches workers.
#[derive(Clone)]
pub(crate) struct TileWorkers {
    bus: Arc<dyn WorkBus>,
    scene: LiveScene,
    /// Names and addresses of those that are there now.
    workers: Arc<dyn Fn() -> Vec<(String, String)> + Send + Sync>,
}

impl fmt::Debug for TileWorkers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TileWorkers").field("scene", &self.scene).finish_non_exhaustive()
    }
}

impl TileWorkers {
    /// Workers for a view of a scene. `workers` tells names and addresses of those that are there now.
    pub fn new(
        bus: Arc<dyn WorkBus>,
        scene: LiveScene,
        workers: impl Fn() -> Vec<(String, String)> + Send + Sync + 'static,
    ) -> Self {
        Self { bus, scene, workers: Arc::new(workers) }
    }
}

/// What a worker has answered.
#[derive(Debug)]
pub(super) struct Arrival {
    address: String,
    /// The frame and the rows that were asked for; `None` if it was asked for a scene.
    tile: Option<(u64, Range<u32>)>,
    seconds: f64,
    answer: Result<LiveAnswer, BusError>,
}

/// What an arrival means for a frame.
#[derive(Debug)]
pub(super) enum Arrived {
    /// A tile of the frame with this number.
    Tile(u64, Tile),
    /// These rows of the frame with this number will not come.
    Lost(u64, Range<u32>),
}

/// A worker.
#[derive(Debug)]
struct TileWorker {
    name: String,
    address: String,
    /// When it was last there.
    seen: Instant,
    is_ready: bool,
    /// Questions without an answer.
    open: u32,
    /// When it may be asked whether it is ready.
    asks_at: Instant,
    record: Record,
    tiles: u64,
    late: u64,
    /// Milliseconds and rows of its last tile, and bytes of all.
    last_ms: f64,
    last_rows: u32,
    bytes: u64,
}

/// Who renders which rows of a frame.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Split {
    /// The coordinator's rows, at the top.
    pub own: Range<u32>,
    /// The addresses of workers, and their rows.
    pub tiles: Vec<(String, Range<u32>)>,
}

/// The workers of a view.
#[derive(Debug)]
pub(super) struct TileDispatch {
    tile_workers: TileWorkers,
    inbox: Arc<Inbox>,
    view: u64,
    frame: u64,
    members: Vec<TileWorker>,
    own_speed: Speed,
    own_tiles: u64,
    own: (f64, u32),
    looked: Option<Instant>,
    /// A tile as it must be, by its width.
    model: (u32, Vec<u8>),
}

impl TileDispatch {
    /// No workers yet. What they answer goes to the inbox.
    pub fn new(tile_workers: TileWorkers, inbox: Arc<Inbox>) -> Self {
        // A number that no other view has.
        let view = RandomState::new().build_hasher().finish();
        Self {
            tile_workers,
            inbox,
            view,
            frame: 0,
            members: Vec::new(),
            own_speed: Speed::default(),
            own_tiles: 0,
            own: (0.0, 0),
            looked: None,
            model: (0, Vec::new()),
        }
    }

    /// Looks who is there, and asks those that do not have the scene to read it.
    pub fn look(&mut self) {
        let now = Instant::now();
        if self.looked.is_some_and(|looked| now - looked < LOOK_EVERY) {
            return;
        }
        self.looked = Some(now);
        let there = (self.tile_workers.workers)();
        for member in &mut self.members {
            member.is_ready &=
                there.iter().any(|(name, address)| (name, address) == (&member.name, &member.address));
        }
        for (name, address) in there {
            match self.members.iter_mut().find(|member| member.name == name) {
                Some(member) if member.address == address => member.seen = now,
                // It has been started again.
                Some(member) => (member.address, member.seen, member.open) = (address, now, 0),
                None => self.members.push(TileWorker::new(name, address, now)),
            }
        }
        // What those that have gone have done is shown a while longer.
        self.members.retain(|member| now - member.seen < FORGOTTEN_AFTER);
        self.members.sort_by(|a, b| a.name.cmp(&b.name));
        for place in 0..self.members.len() {
            let member = &self.members[place];
            if member.seen == now && !member.is_ready && member.open == 0 && now >= member.asks_at {
                self.request(place, None, LiveAsk::Prepare(self.tile_workers.scene.clone()));
            }
        }
    }

    fn request(&mut self, place: usize, tile: Option<(u64, Range<u32>)>, ask: LiveAsk) {
        let member = &mut self.members[place];
        member.open += 1;
        let (address, inbox, sent) = (member.address.clone(), Arc::clone(&self.inbox), Instant::now());
        let told = address.clone();
        let answered = move |answer| {
            inbox.arrive(Arrival { address: told, tile, seconds: sent.elapsed().as_secs_f64(), answer });
        };
        self.tile_workers.bus.request(&address, ask, PATIENCE, Box::new(answered));
    }

    /// Divides a frame by what workers and this process have been able to do. `None` if no one helps.
    pub fn split(&self, size: [u32; 2]) -> Option<Split> {
        let ready: Vec<&TileWorker> =
            self.members.iter().filter(|member| member.is_ready && member.open == 0).collect();
        let speeds: Vec<Speed> = ready.iter().map(|member| member.record.speed()).collect();
        let Division { own, tiles } = decisions::divide(size, self.own_speed, &speeds)?;
        let tiles = tiles.into_iter().map(|(place, rows)| (ready[place].address.clone(), rows)).collect();
        Some(Split { own, tiles })
    }

    /// Asks for the tiles of a frame. `ask` has all but view, frame, rows and time. Returns the frame's number.
    pub fn ask(&mut self, split: &Split, ask: &TileAsk, deadline: Instant) -> u64 {
        self.frame += 1;
        let (width, _) = ask.spec.size;
        if self.model.0 != width {
            let grey = vec![128; (3 * STRIP_ROWS * width) as usize];
            let model = strips::encode(&grey, [width, STRIP_ROWS], encoder::MOVING_QUALITY);
            self.model = (width, model.unwrap_or_default());
        }
        for (address, rows) in &split.tiles {
            let Some(place) = self.members.iter().position(|member| member.address == *address) else {
                continue;
            };
            let budget_ms = deadline.saturating_duration_since(Instant::now()).as_millis() as u32;
            let (view, frame, rows) = (self.view, self.frame, rows.clone());
            let ask = TileAsk { view, frame, rows: rows.clone(), budget_ms, ..ask.clone() };
            self.request(place, Some((frame, rows)), LiveAsk::Tile(self.tile_workers.scene.clone(), ask));
        }
        self.frame
    }

    /// Takes note of an answer.
    pub fn take(&mut self, arrival: Arrival) -> Option<Arrived> {
        let Arrival { address, tile: asked, seconds, answer } = arrival;
        let width = self.model.0;
        let member = self.members.iter_mut().find(|member| member.address == address)?;
        member.open = member.open.saturating_sub(1);
        let now = Instant::now();
        let lost = |asked: Option<(u64, Range<u32>)>| asked.map(|(frame, rows)| Arrived::Lost(frame, rows));
        match answer {
            Ok(LiveAnswer::Tile(tile)) => {
                let (frame, rows) = asked?;
                let is_right =
                    tile.rows == rows && strips::is_tile(&tile.jpeg, &self.model.1, rows.len() as u32);
                if !is_right {
                    member.refuse(now, "it sends something else than was asked for");
                    return Some(Arrived::Lost(frame, rows));
                }
                let height = rows.len() as u32;
                if member.record.came(frame, height, width, seconds) {
                    member.count(height, seconds, tile.jpeg.len());
                }
                return Some(Arrived::Tile(frame, tile));
            }
            Ok(LiveAnswer::Ready) => member.is_ready = true,
            Ok(LiveAnswer::Loading) => (member.is_ready, member.asks_at) = (false, now + LOOK_EVERY),
            Ok(LiveAnswer::Late) => {
                asked.iter().for_each(|(frame, _)| member.miss(*frame, now));
                return lost(asked);
            }
            Ok(LiveAnswer::Refused(why)) => member.refuse(now, &why),
            Err(error) => {
                asked.iter().for_each(|(frame, _)| member.miss(*frame, now));
                // It may have gone.
                (member.is_ready, member.asks_at) = (false, member.asks_at.max(now + LOOK_EVERY));
                log::debug!("{error}");
            }
        }
        lost(asked)
    }

    /// Takes note that these rows of a frame have not come in time.
    pub fn miss(&mut self, frame: u64, split: &Split, late: &[Range<u32>]) {
        let now = Instant::now();
        for (address, _) in split.tiles.iter().filter(|(_, rows)| late.contains(rows)) {
            let member = self.members.iter_mut().find(|member| member.address == *address);
            member.into_iter().for_each(|member| member.miss(frame, now));
        }
    }

    /// Takes note of what this process has rendered.
    pub fn count_own(&mut self, rows: u32, width: u32, time: Duration) {
        let seconds = time.as_secs_f64();
        self.own_speed.add(rows, width, seconds);
        self.own_tiles += 1;
        self.own = (1e3 * seconds, rows);
    }

    /// The shares of the machines, this process first.
    pub fn shares(&self) -> Vec<WorkerShare> {
        let own = WorkerShare {
            name: "coordinator".into(),
            state: "ready",
            rows: self.own.1,
            ms: self.own.0,
            tiles: self.own_tiles,
            late: 0,
            bytes: 0,
        };
        std::iter::once(own).chain(self.members.iter().map(TileWorker::share)).collect()
    }
}

impl TileWorker {
    fn new(name: String, address: String, now: Instant) -> Self {
        Self {
            name,
            address,
            seen: now,
            is_ready: false,
            open: 0,
            asks_at: now,
            record: Record::default(),
            tiles: 0,
            late: 0,
            last_ms: 0.0,
            last_rows: 0,
            bytes: 0,
        }
    }

    fn count(&mut self, rows: u32, seconds: f64, bytes: usize) {
        self.tiles += 1;
        (self.last_ms, self.last_rows) = (1e3 * seconds, rows);
        self.bytes += bytes as u64;
        metrics::counter!("raystream_live_tiles_total", "result" => "in time").increment(1);
        metrics::counter!("raystream_live_tile_bytes_total").increment(bytes as u64);
        metrics::histogram!("raystream_live_tile_seconds").record(seconds);
    }

    /// A tile of a frame is late. A frame counts once.
    fn miss(&mut self, frame: u64, now: Instant) {
        let late = self.record.late(frame);
        if late == Late::Known {
            return;
        }
        self.late += 1;
        metrics::counter!("raystream_live_tiles_total", "result" => "late").increment(1);
        if late == Late::Rests {
            log::warn!(
                "a live view: worker {} has missed {MOST_MISSES} deadlines and is left alone",
                self.name
            );
            (self.is_ready, self.asks_at) = (false, now + REST);
        }
    }

    fn refuse(&mut self, now: Instant, why: &str) {
        log::warn!("a live view: worker {}: {why}", self.name);
        metrics::counter!("raystream_live_tiles_total", "result" => "refused").increment(1);
        (self.is_ready, self.asks_at) = (false, now + REST);
    }

    fn share(&self) -> WorkerShare {
        WorkerShare {
            name: self.name.clone(),
            state: match (self.is_ready, self.record.misses()) {
                (false, _) => "away",
                (true, 0) => "ready",
                _ => "late",
            },
            rows: if self.is_ready { self.last_rows } else { 0 },
            ms: self.last_ms,
            tiles: self.tiles,
            late: self.late,
            bytes: self.bytes,
        }
    }
}

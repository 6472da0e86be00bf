//! Renders tiles of live views for a worker, beside its units.

use super::scene_source::{NoScene, SceneSource};
use crate::backend::SceneReader;
use crate::contract::{LiveAnswer, LiveAsk, LiveReply, LiveScene, Tile, TileAsk, TileServer};
use crate::live::TileScene;
use raystream::picture::RenderSpec;
use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Scenes that are kept ready. Their triangles stay in memory.
const SCENES: usize = 2;

/// How long a scene that could not be had is not tried again.
const RETRY: Duration = Duration::from_secs(5);

/// The most tiles that wait, of all views together.
const QUEUED: usize = 64;

/// Views that are remembered.
const VIEWS: usize = 64;

/// Without a tile for this long, units of jobs have the threads to themselves again.
const CALM_AFTER: Duration = Duration::from_secs(2);

/// A scene as something that renders tiles ([`TileScene::tile`]). As a type of its own it would make the types that
/// hold workers deeper than the compiler looks.
type Render = Arc<dyn Fn(&TileAsk, &dyn Fn() -> bool) -> Result<Option<Tile>, String> + Send + Sync>;

/// Where a scene is: the SHA-256 of an upload, and the scene file in it.
type Place = (String, Option<String>);

/// A scene.
enum Held {
    Loading,
    Ready { scene: Render, identity: String },
    Failed { why: String, at: Instant },
}

/// A tile that waits.
struct Queued {
    scene: Render,
    ask: TileAsk,
    until: Instant,
    reply: LiveReply,
}

#[derive(Default)]
struct State {
    /// Scenes, the one that was asked for last at the end.
    scenes: Vec<(Place, Held)>,
    queue: Vec<Queued>,
    /// The newest frame of each view, and when it came.
    newest: HashMap<u64, (u64, Instant)>,
    is_over: bool,
}

/// Keeps scenes ready and renders the tiles that are asked for, one at a time. A tile that is not wanted any more, or
/// cannot be ready in time, is dropped.
pub struct TileRenderer {
    scenes: Arc<dyn SceneSource>,
    reader: Arc<SceneReader>,
    state: Mutex<State>,
    changed: Condvar,
    own: Weak<Self>,
}

impl TileRenderer {
    /// A tiles with these scenes.
    pub fn new(scenes: Arc<dyn SceneSource>, reader: Arc<SceneReader>) -> Arc<Self> {
        let (state, changed) = (Mutex::default(), Condvar::new());
        Arc::new_cyclic(|own| Self { scenes, reader, state, changed, own: own.clone() })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Renders no more.
    pub fn end(&self) {
        self.lock().is_over = true;
        self.changed.notify_all();
    }

    /// Renders until it is to end.
    pub fn run(&self) {
        let service = Arc::clone(self.reader.service());
        let mut client = None;
        let mut state = self.lock();
        while !state.is_over {
            if let Some(next) = (!state.queue.is_empty()).then(|| state.queue.remove(0)) {
                drop(state);
                // Tasks of units are small from here on, so that tiles get threads soon.
                client.get_or_insert_with(|| service.interactive());
                self.paint(next);
                state = self.lock();
                continue;
            }
            let waited = self.changed.wait_timeout(state, CALM_AFTER);
            let (guard, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
            state = guard;
            if timeout.timed_out() && state.queue.is_empty() {
                client = None;
            }
        }
        for queued in state.queue.drain(..) {
            (queued.reply)(LiveAnswer::Late);
        }
    }

    fn paint(&self, Queued { scene, ask, until, reply }: Queued) {
        let is_wanted = || {
            let state = self.lock();
            let is_newest = state.newest.get(&ask.view).is_none_or(|newest| newest.0 <= ask.frame);
            is_newest && !state.is_over && Instant::now() < until
        };
        if !is_wanted() {
            return reply(LiveAnswer::Late);
        }
        let tile = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| scene(&ask, &is_wanted)));
        reply(match tile {
            Ok(Ok(Some(tile))) if Instant::now() < until => LiveAnswer::Tile(tile),
            Ok(Ok(_)) => LiveAnswer::Late,
            Ok(Err(why)) => LiveAnswer::Refused(why),
            Err(_) => LiveAnswer::Refused("it panicked; see the worker's log".into()),
        });
    }

    /// The scene if it is ready, or what to answer. A scene that is not there is fetched.
    fn scene(&self, state: &mut State, wanted: &LiveScene) -> Result<Render, LiveAnswer> {
        let place = (wanted.sha256.clone(), wanted.entry.clone());
        let index = state.scenes.iter().position(|(own, _)| *own == place);
        if let Some((_, held)) = index.map(|index| state.scenes.remove(index)) {
            let found = match &held {
                Held::Loading => Some(Err(LiveAnswer::Loading)),
                Held::Ready { identity, .. } if *identity != wanted.identity => {
                    Some(Err(LiveAnswer::Refused(
                        "the scene is another one here: its files, its shaders or the loader differ".into(),
                    )))
                }
                Held::Ready { scene, .. } => Some(Ok(Arc::clone(scene))),
                Held::Failed { why, at } if at.elapsed() < RETRY => {
                    Some(Err(LiveAnswer::Refused(why.clone())))
                }
                Held::Failed { .. } => None,
            };
            if let Some(found) = found {
                state.scenes.push((place, held));
                return found;
            }
        }
        self.load(state, place);
        Err(LiveAnswer::Loading)
    }

    /// Begins to fetch and to read a scene.
    fn load(&self, state: &mut State, place: Place) {
        // Those being loaded are waited for.
        let is_loading = |held: &Held| matches!(held, Held::Loading);
        if state.scenes.iter().filter(|(_, held)| is_loading(held)).count() >= SCENES {
            return;
        }
        while state.scenes.len() >= SCENES
            && let Some(oldest) = state.scenes.iter().position(|(_, held)| !is_loading(held))
        {
            state.scenes.remove(oldest);
        }
        let Some(own) = self.own.upgrade() else { return };
        let wanted = place.clone();
        let thread = std::thread::Builder::new().name("live scene".into()).stack_size(8 << 20);
        let spawned = thread.spawn(move || {
            let read = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| own.read(&wanted)));
            let held = match read.unwrap_or_else(|_| Err("reading it panicked; see the worker's log".into()))
            {
                Ok((scene, identity)) => Held::Ready { scene, identity },
                Err(why) => {
                    log::warn!("a live view: {why}");
                    Held::Failed { why, at: Instant::now() }
                }
            };
            if let Some(scene) = own.lock().scenes.iter_mut().find(|(own, _)| *own == wanted) {
                scene.1 = held;
            }
        });
        match spawned {
            Ok(_) => state.scenes.push((place, Held::Loading)),
            Err(error) => log::warn!("a live view: the system refuses a thread: {error}"),
        }
    }

    fn read(&self, (sha256, entry): &Place) -> Result<(Render, String), String> {
        let told = |error: NoScene| error.to_string();
        let (path, folder) = self.scenes.scene(sha256, entry.as_deref()).map_err(told)?;
        let open_job = self.reader.open(&RenderSpec::default(), &path, &folder)?;
        let identity = open_job.identity(0)?;
        let scene = TileScene::new(open_job.prepared(), self.reader.service());
        let scene = scene.with_times(open_job.timed());
        Ok((
            Arc::new(move |ask: &TileAsk, is_wanted: &dyn Fn() -> bool| scene.tile(ask, is_wanted)),
            identity,
        ))
    }

    /// Puts a tile in the queue. Tiles of older frames of its view leave.
    fn queue(&self, state: &mut State, new: Queued) -> Vec<LiveReply> {
        let TileAsk { view, frame, .. } = new.ask;
        let newest = state.newest.entry(view).or_insert((frame, Instant::now()));
        if newest.0 > frame {
            return vec![new.reply];
        }
        *newest = (frame, Instant::now());
        if state.newest.len() > VIEWS
            && let Some(oldest) =
                state.newest.iter().min_by_key(|(_, newest)| newest.1).map(|(&view, _)| view)
        {
            state.newest.remove(&oldest);
        }
        let is_old = |queued: &mut Queued| queued.ask.view == view && queued.ask.frame < frame;
        let mut late: Vec<LiveReply> =
            state.queue.extract_if(.., is_old).map(|queued| queued.reply).collect();
        if state.queue.len() < QUEUED {
            state.queue.push(new);
            self.changed.notify_all();
        } else {
            late.push(new.reply);
        }
        late
    }
}

impl TileServer for TileRenderer {
    fn take(&self, ask: LiveAsk, reply: LiveReply) {
        let mut state = self.lock();
        if state.is_over {
            drop(state);
            return reply(LiveAnswer::Refused("the worker leaves".into()));
        }
        let (LiveAsk::Prepare(wanted) | LiveAsk::Tile(wanted, _)) = &ask;
        let scene = match self.scene(&mut state, wanted) {
            Ok(scene) => scene,
            Err(answer) => {
                drop(state);
                return reply(answer);
            }
        };
        let LiveAsk::Tile(_, ask) = ask else {
            drop(state);
            return reply(LiveAnswer::Ready);
        };
        let until = Instant::now() + Duration::from_millis(ask.budget_ms.into());
        let late = self.queue(&mut state, Queued { scene, ask, until, reply });
        drop(state);
        late.into_iter().for_each(|reply| reply(LiveAnswer::Late));
    }
}

//! A view whose moving frames workers render, on the bus of one process.

use super::tests::{PATIENCE, view_scene};
use super::{Frame, LiveView, Reply, Request, TileScene, TileWorkers, WorkerShare};
use crate::bus::{LocalBus, WorkBus};
use crate::contract::{LiveAnswer, LiveAsk, LiveReply, LiveScene, Pose, TileServer};
use glam::Vec3;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A worker that answers at once, or never.
struct Hand {
    scene: TileScene,
    is_dead: AtomicBool,
    /// What a dead one was asked: answers that are kept are never given.
    kept: Mutex<Vec<LiveReply>>,
    asked: Mutex<Vec<(u64, std::ops::Range<u32>)>>,
}

impl TileServer for Hand {
    fn take(&self, ask: LiveAsk, reply: LiveReply) {
        if self.is_dead.load(Relaxed) {
            return self.kept.lock().expect("no panic").push(reply);
        }
        let LiveAsk::Tile(_, ask) = ask else { return reply(LiveAnswer::Ready) };
        self.asked.lock().expect("no panic").push((ask.frame, ask.rows.clone()));
        let tile = self.scene.tile(&ask, || true).expect("a tile").expect("it is wanted");
        reply(LiveAnswer::Tile(tile));
    }
}

struct Shared {
    view: LiveView,
    woken: Receiver<()>,
    hands: Vec<Arc<Hand>>,
    shares: Vec<WorkerShare>,
    generation: u32,
}

impl Shared {
    /// A view with so many workers.
    fn new(workers: usize) -> Self {
        let view_scene = view_scene(1);
        let mut spec = view_scene.spec.clone();
        spec.size = (96, 96);
        let view_scene = view_scene.with_spec(spec);
        let bus: Arc<dyn WorkBus> = Arc::new(LocalBus::default());
        let hand = || {
            let scene = TileScene::new(&view_scene.prepared, &view_scene.service);
            let (is_dead, kept, asked) = (AtomicBool::new(false), Mutex::default(), Mutex::default());
            Arc::new(Hand { scene, is_dead, kept, asked })
        };
        let hands: Vec<Arc<Hand>> = (0..workers).map(|_| hand()).collect();
        let addresses: Vec<(String, String)> = hands
            .iter()
            .enumerate()
            .map(|(number, hand)| {
                bus.listen(Arc::clone(hand) as Arc<dyn TileServer>).expect("it listens");
                (format!("w{number}"), number.to_string())
            })
            .collect();
        let scene = LiveScene { sha256: "0".repeat(64), entry: None, identity: "i".into() };
        let tile_workers = (workers > 0).then(|| TileWorkers::new(bus, scene, move || addresses.clone()));
        let (wake, woken) = channel();
        let view = LiveView::new(view_scene.with_workers(tile_workers), move || {
            wake.send(()).ok();
        });
        Self { view: view.expect("threads"), woken, hands, shares: Vec::new(), generation: 0 }
    }

    fn take_replies(&mut self) {
        for reply in std::iter::from_fn(|| self.view.take_reply()) {
            if let Reply::Statistics(statistics) = reply {
                self.shares = statistics.workers;
            }
        }
    }

    /// Looks from a place; returns the moving frame and how long it took.
    fn frame(&mut self, eye: Vec3) -> (Frame, Duration) {
        self.generation += 1;
        let pose = Pose { eye, target: Vec3::ZERO, up: Vec3::Y, fov: Some(40.0), lens: None };
        let began = Instant::now();
        self.view.ask(Request::Camera { generation: self.generation, pose });
        loop {
            self.take_replies();
            let frame = self.view.take_frame().filter(|frame| frame.generation == self.generation);
            if let Some(frame) = frame {
                if frame.flags.moving {
                    return (frame, began.elapsed());
                }
                // This thread came too late: the full picture has replaced the moving frame.
                return self.frame(eye);
            }
            self.woken.recv_timeout(PATIENCE).expect("a frame");
        }
    }

    /// Frames from a place until one is of this height, and `is_it`.
    fn until(&mut self, eye: Vec3, what: &str, is_it: impl Fn(&Self, &Frame) -> bool) -> Frame {
        let began = Instant::now();
        loop {
            let (frame, _) = self.frame(eye);
            if is_it(self, &frame) {
                return frame;
            }
            assert!(began.elapsed() < PATIENCE, "{what} does not come: {:?}", self.shares);
        }
    }
}

fn pixels(frame: &Frame) -> image::RgbImage {
    image::load_from_memory(&frame.bytes).expect("a JPEG").into_rgb8()
}

/// True if a JPEG has restart markers: several machines have made it.
fn is_shared(frame: &Frame) -> bool {
    frame.bytes.windows(2).any(|pair| pair == [0xff, 0xdd])
}

#[test]
fn several_workers_show_the_pixels_of_one_process() {
    let eye = Vec3::new(1.0, 2.0, 3.0);
    let full = |frame: &Frame| frame.size == [96, 96];
    let alone = Shared::new(0).until(eye, "a full frame", |_, frame| full(frame));
    assert!(!is_shared(&alone), "without workers nothing changes");
    let mut view = Shared::new(2);
    let all_helped =
        |view: &Shared| view.shares.len() == 3 && view.shares.iter().all(|share| share.tiles > 0);
    let shared =
        view.until(eye, "a shared frame", |view, frame| full(frame) && is_shared(frame) && all_helped(view));
    assert!(pixels(&shared) == pixels(&alone), "other pixels");
    let names: Vec<&str> = view.shares.iter().map(|share| &*share.name).collect();
    assert_eq!(names, ["coordinator", "w0", "w1"]);
    assert!(view.hands.iter().all(|hand| !hand.asked.lock().expect("no panic").is_empty()));
}

#[test]
fn a_worker_that_dies_costs_one_late_tile() {
    let eye = Vec3::new(0.0, 2.0, 3.0);
    let mut view = Shared::new(2);
    view.until(eye, "a shared frame", |_, frame| is_shared(frame));
    view.hands[0].is_dead.store(true, Relaxed);
    let mut slow = 0;
    for step in 0..20 {
        let (_, time) = view.frame(Vec3::new(0.1 * step as f32, 2.0, 3.0));
        slow += u32::from(time > Duration::from_millis(75));
        assert!(time < Duration::from_millis(500), "frame {step} takes {time:?}");
    }
    assert!(slow <= 2, "{slow} of 20 frames have waited for the dead one");
    let own = |view: &Shared, name: &str| view.shares.iter().find(|share| share.name == name).cloned();
    view.until(eye, "word of the dead one", |view, _| own(view, "w0").is_some_and(|share| share.late > 0));
    let (dead, other) = (own(&view, "w0").expect("w0"), own(&view, "w1").expect("w1"));
    assert!(dead.late == 1 && dead.state != "ready", "{dead:?}");
    assert!(other.late == 0 && other.tiles > dead.tiles, "{other:?}");
    // It comes back.
    view.hands[0].is_dead.store(false, Relaxed);
    view.until(eye, "its return", |view, _| own(view, "w0").is_some_and(|share| share.tiles > dead.tiles));
}

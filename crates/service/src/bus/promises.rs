//! What every bus promises, tested in the same words.

use super::{BusError, WorkBus};
use crate::contract::{
    Answer, Ask, Coordinator, FinishedUnit, Granted, Held, Leased, LiveAnswer, LiveAsk, LiveReply, LiveScene,
    ResultReply, Tile, TileAsk, TileServer, Unit, UnitId, Wanted, WorkerInfo,
};
use raystream::picture::RenderSpec;
use std::sync::mpsc::channel;
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

/// Longer than anything takes here.
const PATIENCE: Duration = Duration::from_millis(200);

fn unit(job: &str, number: u32) -> Unit {
    Unit {
        id: UnitId { job: job.into(), frame: 1, round: 3, pass: 2, number, copy: 0 },
        scene: "0".repeat(64),
        entry: Some("a b/c.obj".into()),
        spec: serde_json::from_str(r#"{ "size": "4x4" }"#).expect("a spec"),
        priority: "normal".into(),
        blocks: vec![3, 1, 2],
        samples: 5..9,
    }
}

/// A coordinator that remembers what it was asked, and by whom.
#[derive(Default)]
struct Listener(Mutex<Vec<(String, Ask)>>);

impl Coordinator for Listener {
    fn answer(&self, key: &str, ask: Ask) -> Answer {
        self.0.lock().expect("no panic").push((key.into(), ask.clone()));
        match ask {
            Ask::Lease(Wanted { session: 7, .. }) => Answer::Granted(Granted::None),
            Ask::Lease(_) => {
                let leased = Leased { unit: unit("a", 5), token: "t".into() };
                Answer::Granted(Granted::Unit(leased.into()))
            }
            Ask::File(part) => Answer::File((part.file == 0).then(|| vec![9; part.offset as usize])),
            Ask::Result(_) => Answer::Result(ResultReply::Kept),
            _ => Answer::Noted,
        }
    }

    fn expects(&self, _: &str, finished: &FinishedUnit, _: u64) -> bool {
        finished.held.token == "t"
    }
}

/// The coordinator's end of a bus, a worker's, and the worker's key.
type Ends = (Arc<dyn WorkBus>, Arc<dyn WorkBus>, String);

/// All promises. `bus` gives the ends of one bus.
pub fn check(bus: impl Fn() -> Ends) {
    questions_are_answered(&bus());
    results_are_answered_at_the_same_time(&bus());
    the_bell_wakes_who_waits(&bus());
    tiles_are_answered_by_the_worker_that_is_asked(&bus());
}

fn info() -> WorkerInfo {
    let (worker, host, units) = ("w".into(), "h".into(), "CPU".into());
    WorkerInfo {
        worker,
        host,
        build: crate::contract::Build::own(),
        session: 1,
        slots: 1,
        units,
        is_live: false,
    }
}

fn questions_are_answered((coordinator, worker, key): &Ends) {
    assert!(worker.ask(Ask::Leave).is_err(), "no one is there");
    let listener = Arc::new(Listener::default());
    coordinator.attend(Arc::clone(&listener) as Arc<dyn Coordinator>).expect("a coordinator");
    // A server may need a moment to tell others of the coordinator.
    let began = Instant::now();
    while worker.ask(Ask::Leave).is_err() {
        assert!(began.elapsed() < 100 * PATIENCE, "the coordinator is not found");
    }
    let last = || listener.0.lock().expect("no panic").last().cloned();
    assert_eq!(last(), Some((key.clone(), Ask::Leave)), "the coordinator knows who asks");
    for ask in [Ask::Join(info()), Ask::GiveBack(Held { unit: unit("a", 1).id, token: "t".into() })] {
        assert_eq!(worker.ask(ask.clone()), Ok(Answer::Noted));
        assert_eq!(last(), Some((key.clone(), ask)));
    }
    let lease = |session| worker.ask(Ask::Lease(Wanted { session, have: vec![unit("b", 2).id] }));
    assert_eq!(lease(7), Ok(Answer::Granted(Granted::None)));
    let Ok(Answer::Granted(Granted::Unit(leased))) = lease(8) else { panic!("no unit") };
    assert_eq!((leased.unit, &*leased.token), (unit("a", 5), "t"), "units come whole");
    let file = |file, offset| {
        let part = crate::contract::FilePart { scene: "s".into(), file, offset };
        worker.ask(Ask::File(part)).expect("an answer")
    };
    assert_eq!(file(0, 3), Answer::File(Some(vec![9; 3])));
    assert_eq!(file(0, 0), Answer::File(Some(Vec::new())));
    assert_eq!(file(1, 3), Answer::File(None));
    // Films of no, one and several parts.
    for bytes in [
        0,
        1,
        crate::contract::PART_BYTES,
        crate::contract::PART_BYTES + 1,
        3 * crate::contract::PART_BYTES + 5,
    ] {
        let sums: Vec<u8> = (0..bytes).map(|byte| (byte % 251) as u8).collect();
        let finished = finished(0, sums);
        let answer = worker.ask(Ask::Result(finished.clone())).expect("an answer");
        assert_eq!(answer, Answer::Result(ResultReply::Kept));
        assert_eq!(last(), Some((key.clone(), Ask::Result(finished))), "{bytes} bytes");
    }
}

/// The sums of a unit.
fn finished(number: u32, sums: Vec<u8>) -> FinishedUnit {
    FinishedUnit {
        held: Held { unit: unit("a", number).id, token: "t".into() },
        identity: "i".into(),
        blocks: vec![3, 1, 2],
        samples: 5..9,
        digest: sums.len().to_string(),
        seconds: 1.5,
        opening_s: 0.25,
        sums: Arc::new(sums),
    }
}

/// A coordinator that keeps sums once those of so many units are being kept.
#[derive(Default)]
struct Together {
    results: Mutex<usize>,
    more: Condvar,
}

/// Results that are kept at the same time.
const TOGETHER: usize = 4;

impl Coordinator for Together {
    fn answer(&self, _: &str, ask: Ask) -> Answer {
        if !matches!(ask, Ask::Result(_)) {
            return Answer::Noted;
        }
        let mut results = self.results.lock().expect("no panic");
        *results += 1;
        self.more.notify_all();
        let is_alone = |results: &mut usize| *results < TOGETHER;
        let waited = self.more.wait_timeout_while(results, 50 * PATIENCE, is_alone).expect("no panic");
        Answer::Result(if waited.1.timed_out() { ResultReply::Later } else { ResultReply::Kept })
    }

    fn expects(&self, _: &str, _: &FinishedUnit, _: u64) -> bool {
        true
    }
}

fn results_are_answered_at_the_same_time((coordinator, worker, _): &Ends) {
    coordinator.attend(Arc::new(Together::default())).expect("a coordinator");
    let began = Instant::now();
    while worker.ask(Ask::Leave).is_err() {
        assert!(began.elapsed() < 100 * PATIENCE, "the coordinator is not found");
    }
    std::thread::scope(|scope| {
        let send = |number| scope.spawn(move || worker.ask(Ask::Result(finished(number, vec![1, 2, 3]))));
        let sent: Vec<_> = (0..TOGETHER as u32).map(send).collect();
        for answer in sent {
            assert_eq!(answer.join().expect("no panic"), Ok(Answer::Result(ResultReply::Kept)));
        }
    });
}

fn the_bell_wakes_who_waits((coordinator, worker, _): &Ends) {
    worker.listen(Arc::new(TileRenderer(Mutex::default()))).expect("it listens");
    let (rings, began) = (worker.bell().rings(), Instant::now());
    worker.bell().wait(rings, PATIENCE);
    assert!(began.elapsed() >= PATIENCE, "no one has rung");
    while worker.bell().rings() == rings {
        assert!(began.elapsed() < 100 * PATIENCE, "it does not hear the bell");
        coordinator.ring();
        worker.bell().wait(rings, PATIENCE);
    }
    let began = Instant::now();
    worker.bell().wait(rings, 10 * PATIENCE);
    assert!(began.elapsed() < 5 * PATIENCE, "it was rung between two looks");
}

/// A worker that answers for tiles with their number of rows, at once or late, and keeps no answer for `Prepare`.
struct TileRenderer(Mutex<Vec<LiveReply>>);

impl TileServer for TileRenderer {
    fn take(&self, ask: LiveAsk, reply: LiveReply) {
        match ask {
            LiveAsk::Prepare(_) => self.0.lock().expect("no panic").push(reply),
            LiveAsk::Tile(_, ask) => {
                let bytes = ask.rows.len();
                let jpeg = Arc::new((0..bytes).map(|byte| (byte % 253) as u8).collect());
                let tile = Tile { rows: ask.rows, light: (-1.5, 7), seconds: 0.25, jpeg };
                reply(LiveAnswer::Tile(tile));
            }
        }
    }
}

fn tile_ask(rows: u32) -> TileAsk {
    let spec = r#"{ "eye": [0.1, -2, 3e-7], "target": [0, 0, 0], "fov": 40, "spp": 1, "exposure": -0.37,
        "surface": "wall=wall.wgsl", "material": "door,roughness=0.1" }"#;
    let mut spec: RenderSpec = serde_json::from_str(spec).expect("a spec");
    spec.size = (64, rows);
    TileAsk {
        view: u64::MAX,
        frame: 3,
        spec: Box::new(spec),
        shaders: [("wall.wgsl".to_owned(), "fn pattern".to_owned())].into(),
        rows: 0..rows,
        is_denoised: true,
        is_metered: true,
        budget_ms: 80,
    }
}

fn tiles_are_answered_by_the_worker_that_is_asked((coordinator, worker, address): &Ends) {
    let scene = LiveScene { sha256: "0".repeat(64), entry: None, identity: "i".into() };
    let ask = |address: &str, ask: LiveAsk, patience: Duration| {
        let (tell, told) = channel();
        coordinator.request(
            address,
            ask,
            patience,
            Box::new(move |answer| tell.send(answer).expect("asked")),
        );
        told.recv_timeout(5 * PATIENCE + patience).expect("an answer, or why there is none")
    };
    let silent = |answer| matches!(answer, Err(BusError::Silent(_)));
    let tile = |rows| LiveAsk::Tile(scene.clone(), tile_ask(rows));
    assert!(silent(ask("0123", tile(1), PATIENCE)), "no one is there");
    let tiles = Arc::new(TileRenderer(Mutex::default()));
    worker.listen(Arc::clone(&tiles) as Arc<dyn TileServer>).expect("it listens");
    // A server may need a moment to tell others of the worker.
    let began = Instant::now();
    while silent(ask(address, tile(1), PATIENCE)) {
        assert!(began.elapsed() < 10 * PATIENCE, "the worker is not found");
    }
    for rows in [1, 1000, 900_000] {
        let Ok(LiveAnswer::Tile(tile)) = ask(address, tile(rows), 10 * PATIENCE) else { panic!("no tile") };
        assert_eq!((tile.rows, tile.light, tile.seconds), (0..rows, (-1.5, 7), 0.25));
        assert!(
            tile.jpeg.len() == rows as usize
                && tile.jpeg.iter().zip(0..).all(|(&byte, i)| byte == (i % 253) as u8)
        );
    }
    // Without an answer in time there is an error soon after; an answer that comes later changes nothing.
    let began = Instant::now();
    assert!(silent(ask(address, LiveAsk::Prepare(scene.clone()), PATIENCE)));
    let waited = began.elapsed();
    assert!(waited > PATIENCE * 8 / 10 && waited < 3 * PATIENCE, "{waited:?}");
    tiles.0.lock().expect("no panic").pop().expect("it was asked")(LiveAnswer::Ready);
    assert!(matches!(ask(address, tile(5), 5 * PATIENCE), Ok(LiveAnswer::Tile(tile)) if tile.rows == (0..5)));
    // Who listens at another address is not asked.
    assert!(silent(ask("4567", tile(1), PATIENCE)));
}

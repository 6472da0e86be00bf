//! What every bus promises, tested in the same words.

use super::{
    Answer, Ask, BusError, Desk, FinishedUnit, Lane, Lease, LiveAnswer, LiveAsk, LiveDesk, LiveReply,
    LiveScene, Offered, Start, Tile, TileAsk, Unit, UnitId, Verdict, WorkBus,
};
use crate::serve::live::{EditList, Pose};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Leases of the buses under test.
pub const LEASE: Duration = Duration::from_millis(1000);

/// Longer than anything takes here.
const PATIENCE: Duration = Duration::from_millis(200);

fn unit(job: &str, number: u32) -> Unit {
    Unit {
        id: UnitId { job: job.into(), frame: 1, pass: 2, number, copy: 0 },
        scene: "0".repeat(64),
        entry: Some("a b/c.obj".into()),
        spec: serde_json::from_str(r#"{ "size": "4x4" }"#).expect("a spec"),
        priority: "normal".into(),
        blocks: vec![3, 1, 2],
        samples: 5..9,
    }
}

fn lease(bus: &dyn WorkBus) -> Option<Box<dyn Lease>> {
    bus.lease(PATIENCE).expect("the bus answers")
}

/// The numbers of all units that can be leased now; the leases are ended.
fn drained(bus: &dyn WorkBus) -> Vec<u32> {
    let each = std::iter::from_fn(|| lease(bus));
    each.map(|lease| {
        lease.done();
        lease.unit().id.number
    })
    .collect()
}

/// A desk that remembers what it was asked.
#[derive(Default)]
struct Listener(Mutex<Vec<Ask>>);

impl Desk for Listener {
    fn answer(&self, ask: Ask) -> Answer {
        self.0.lock().expect("no panic").push(ask.clone());
        match ask {
            Ask::Start(unit, ..) if unit.number == 7 => Answer::Start(Start::Skip),
            Ask::File(part) => Answer::File((part.file == 0).then(|| vec![9; part.offset as usize])),
            Ask::Result(_) => Answer::Verdict(Verdict::Kept),
            _ => Answer::Noted,
        }
    }
}

/// All promises. `bus` gives two ends of one bus: the coordinator's and a worker's.
pub fn check(bus: impl Fn() -> (Arc<dyn WorkBus>, Arc<dyn WorkBus>)) {
    units_come_whole_and_once(&bus());
    lanes_have_precedence(&bus());
    a_silent_holder_loses_its_unit(&bus());
    beats_keep_a_unit(&bus());
    what_is_given_back_comes_again(&bus());
    questions_are_answered(&bus());
    tiles_are_answered_by_the_worker_that_is_asked(&bus());
}

type Ends = (Arc<dyn WorkBus>, Arc<dyn WorkBus>);

fn units_come_whole_and_once((coordinator, worker): &Ends) {
    assert_eq!(coordinator.backlog().expect("a bus").units, 0);
    for number in 0..5 {
        assert_eq!(coordinator.offer(Lane::Lo, &unit("a", number), 0), Ok(Offered::New));
    }
    assert_eq!(coordinator.offer(Lane::Lo, &unit("a", 2), 0), Ok(Offered::Duplicate));
    assert_eq!(coordinator.backlog().expect("a bus").units, 5);
    let first = lease(&**worker).expect("a unit");
    assert_eq!((first.unit(), first.deliveries()), (&unit("a", 0), 1));
    assert_eq!(coordinator.backlog().expect("a bus").units, 5, "a leased unit counts");
    first.done();
    assert_eq!(drained(&**worker), [1, 2, 3, 4]);
    let backlog = coordinator.backlog().expect("a bus");
    assert_eq!((backlog.units, backlog.is_new), (0, false));
    // The same unit in another round is another offer.
    assert_eq!(coordinator.offer(Lane::Lo, &unit("a", 2), 1), Ok(Offered::New));
    assert_eq!(drained(&**worker), [2]);
}

fn lanes_have_precedence((coordinator, worker): &Ends) {
    for (lane, number) in [(Lane::Lo, 0), (Lane::Lo, 1), (Lane::Hi, 2), (Lane::Hi, 3)] {
        coordinator.offer(lane, &unit("a", number), 0).expect("offered");
    }
    assert_eq!(drained(&**worker), [2, 3, 0, 1]);
}

fn a_silent_holder_loses_its_unit((coordinator, worker): &Ends) {
    coordinator.offer(Lane::Lo, &unit("a", 0), 0).expect("offered");
    let (lost, began) = (lease(&**worker).expect("a unit"), Instant::now());
    assert!(lease(&**worker).is_none(), "no one else has it meanwhile");
    let again = worker.lease(2 * LEASE).expect("a bus").expect("it comes again");
    let waited = began.elapsed();
    assert!(waited > LEASE * 8 / 10 && waited < LEASE * 2, "{waited:?}");
    assert_eq!(again.deliveries(), 2);
    // What the first holder gives back now changes nothing for the second.
    lost.give_back(Duration::ZERO);
    assert!(lease(&**worker).is_none());
    again.done();
    std::thread::sleep(LEASE + PATIENCE);
    assert!(lease(&**worker).is_none());
}

fn beats_keep_a_unit((coordinator, worker): &Ends) {
    coordinator.offer(Lane::Lo, &unit("a", 0), 0).expect("offered");
    let kept = lease(&**worker).expect("a unit");
    for _ in 0..8 {
        std::thread::sleep(LEASE / 4);
        kept.beat();
    }
    assert!(lease(&**worker).is_none(), "twice as long as a lease");
    kept.done();
}

fn what_is_given_back_comes_again((coordinator, worker): &Ends) {
    coordinator.offer(Lane::Lo, &unit("a", 0), 0).expect("offered");
    lease(&**worker).expect("a unit").give_back(Duration::ZERO);
    let again = lease(&**worker).expect("at once");
    assert_eq!(again.deliveries(), 2);
    again.give_back(2 * PATIENCE);
    assert!(lease(&**worker).is_none(), "not yet");
    let third = worker.lease(3 * PATIENCE).expect("a bus").expect("after the pause");
    third.done();
}

fn questions_are_answered((coordinator, worker): &Ends) {
    assert!(worker.ask(Ask::Leave("w".into())).is_err(), "no one is there");
    let listener = Arc::new(Listener::default());
    coordinator.attend(Arc::clone(&listener) as Arc<dyn Desk>).expect("a desk");
    // A server may need a moment to tell others of the desk.
    let began = Instant::now();
    while worker.ask(Ask::Leave("w".into())).is_err() {
        assert!(began.elapsed() < 10 * PATIENCE, "the desk is not found");
    }
    let start = |number| worker.ask(Ask::Start(unit("a", number).id, "w".into(), 1));
    assert_eq!((start(7), start(8)), (Ok(Answer::Start(Start::Skip)), Ok(Answer::Noted)));
    let file = |file, offset| {
        let part = super::FilePart { scene: "s".into(), file, offset };
        worker.ask(Ask::File(part)).expect("an answer")
    };
    assert_eq!(file(0, 3), Answer::File(Some(vec![9; 3])));
    assert_eq!(file(0, 0), Answer::File(Some(Vec::new())));
    assert_eq!(file(1, 3), Answer::File(None));
    // Films of no, one and several parts.
    for bytes in [0, 1, super::PART_BYTES, super::PART_BYTES + 1, 3 * super::PART_BYTES + 5] {
        let sums: Vec<u8> = (0..bytes).map(|byte| (byte % 251) as u8).collect();
        let finished = FinishedUnit {
            unit: unit("a", 0).id,
            worker: "w".into(),
            identity: "i".into(),
            digest: bytes.to_string(),
            seconds: 1.5,
            opening_s: 0.25,
            sums: Arc::new(sums),
        };
        let answer = worker.ask(Ask::Result(finished.clone())).expect("an answer");
        assert_eq!(answer, Answer::Verdict(Verdict::Kept));
        assert_eq!(
            listener.0.lock().expect("no panic").last(),
            Some(&Ask::Result(finished)),
            "{bytes} bytes"
        );
    }
}

/// A worker that answers for tiles with their number of rows, at once or late, and keeps no answer for `Prepare`.
struct Painter(Mutex<Vec<LiveReply>>);

impl LiveDesk for Painter {
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
    let pose = r#"{ "eye": [0.1, -2, 3e-7], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 40, "lens": null }"#;
    let pose: Pose = serde_json::from_str(pose).expect("a pose");
    TileAsk {
        view: u64::MAX,
        frame: 3,
        pose,
        edits: EditList::default(),
        size: [64, rows],
        rows: 0..rows,
        spp: 1,
        max_bounces: 2,
        seed: 9,
        transform: "agx".into(),
        stops: -0.37,
        is_metered: true,
        budget_ms: 80,
    }
}

fn tiles_are_answered_by_the_worker_that_is_asked((coordinator, worker): &Ends) {
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
    let painter = Arc::new(Painter(Mutex::default()));
    let address = worker.listen(Arc::clone(&painter) as Arc<dyn LiveDesk>).expect("an address");
    let is_token = |byte: u8| byte.is_ascii_alphanumeric();
    assert!(!address.is_empty() && address.bytes().all(is_token), "{address} is part of a subject");
    // A server may need a moment to tell others of the worker.
    let began = Instant::now();
    while silent(ask(&address, tile(1), PATIENCE)) {
        assert!(began.elapsed() < 10 * PATIENCE, "the worker is not found");
    }
    for rows in [1, 1000, 900_000] {
        let Ok(LiveAnswer::Tile(tile)) = ask(&address, tile(rows), 10 * PATIENCE) else { panic!("no tile") };
        assert_eq!((tile.rows, tile.light, tile.seconds), (0..rows, (-1.5, 7), 0.25));
        assert!(
            tile.jpeg.len() == rows as usize
                && tile.jpeg.iter().zip(0..).all(|(&byte, i)| byte == (i % 253) as u8)
        );
    }
    // Without an answer in time there is an error soon after; an answer that comes later changes nothing.
    let began = Instant::now();
    assert!(silent(ask(&address, LiveAsk::Prepare(scene.clone()), PATIENCE)));
    let waited = began.elapsed();
    assert!(waited > PATIENCE * 8 / 10 && waited < 3 * PATIENCE, "{waited:?}");
    painter.0.lock().expect("no panic").pop().expect("it was asked")(LiveAnswer::Ready);
    assert!(
        matches!(ask(&address, tile(5), 5 * PATIENCE), Ok(LiveAnswer::Tile(tile)) if tile.rows == (0..5))
    );
    // Who listens at another address is not asked.
    assert!(silent(ask("4567", tile(1), PATIENCE)));
}

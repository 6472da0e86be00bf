//! Tests of the ledger.

use super::*;
use crate::schedule::Priority;
use crate::serve::{Demand, Frame, Kind};

fn new(id: &str, key: Option<&str>) -> NewJob {
    NewJob {
        id: id.into(),
        request: "{}".into(),
        request_hash: format!("hash of {}", &id[..1]),
        demand: Demand::new((4, 4), 8, Some(2), Kind::Samples),
        scene: "s".into(),
        priority: Priority::Normal,
        idempotency_key: key.map(str::to_owned),
        has_webhook: false,
    }
}

/// Four of the eight blocks × samples of a frame in two units.
fn unit(frame: u32, number: u32) -> UnitRow {
    UnitRow {
        frame,
        pass: 0,
        number,
        block: 0,
        blocks: 1,
        first: 2 * number,
        end: 2 * number + 2,
        state: UnitState::Open,
        attempts: 0,
        worker: None,
        digest: None,
    }
}

#[test]
fn a_job_goes_from_its_request_to_its_pictures_across_restarts() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    assert_eq!(ledger.accept(new("a1", Some("k")), 2).expect("accepted"), Accepted::New);
    assert_eq!(ledger.accept(new("a2", Some("k")), 2).expect("known"), Accepted::Earlier("a1".into(), true));
    assert_eq!(ledger.accept(new("b1", Some("k")), 2).expect("other"), Accepted::Earlier("a1".into(), false));
    assert_eq!(ledger.accept(new("c1", None), 1).expect("counted"), Accepted::TooMany(1));
    let frames = vec![Frame::new(0, "front"), Frame::new(1, "back")];
    for _ in 0..2 {
        ledger.plan("a1", frames.clone(), 8).expect("planned once");
    }
    for _ in 0..2 {
        ledger.add_units("a1", vec![unit(0, 0), unit(0, 1)]).expect("cut once");
    }
    drop(ledger);
    let ledger = Ledger::open(folder.path()).expect("the same ledger");
    assert_eq!(ledger.active(9).expect("jobs").len(), 1);
    let units = || ledger.units_of("a1", 0).expect("units").1;
    assert_eq!(units(), [unit(0, 0), unit(0, 1)]);
    let by = |number| UnitRow { worker: Some("w".into()), digest: Some("d".into()), ..unit(0, number) };
    let rendering = Rendering { seconds: 0.5, samples: 512, deliveries: 2, ..Rendering::default() };
    let share = || ledger.totals("a1").expect("totals").share;
    assert!(ledger.keep_unit("a1", by(0), rendering).expect("kept"));
    assert!(!ledger.keep_unit("a1", by(0), rendering).expect("kept before"));
    assert_eq!(share(), 0.125);
    assert!(ledger.keep_unit("a1", by(1), rendering).expect("kept"));
    assert_eq!(ledger.reopen_unit("a1", units()[1].clone()).expect("again"), 1);
    assert_eq!((units()[0].state, units()[1].state), (UnitState::Kept, UnitState::Open));
    assert!(ledger.keep_unit("a1", by(1), rendering).expect("kept again"));
    ledger.fold("a1", 0, 7).expect("folded");
    let (sums, rows) = ledger.units_of("a1", 0).expect("units");
    assert_eq!((sums, rows.len(), rows[0].number, rows[0].state), (7, 1, 1, UnitState::Folded));
    let totals = ledger.totals("a1").expect("totals");
    assert_eq!((totals.units, totals.units_done, totals.share), (2, 2, 0.25));
    assert_eq!(ledger.frames_of_worker("w").expect("frames"), [("a1".into(), 0)]);
    ledger.begin_anew("a1", 0).expect("begun");
    assert_eq!((ledger.units_of("a1", 0).expect("units"), share()), ((0, vec![]), 0.0));
    assert_eq!(ledger.open_frames("a1", 9).expect("frames"), [0, 1]);
    for number in 0..2 {
        let hash = Some(format!("hash {number}"));
        let row = FrameRow { number, name: String::new(), hash, layers: None, metadata: None };
        ledger.finish_frame("a1", row).expect("finished");
    }
    let job = ledger.job("a1").expect("a ledger").expect("the job");
    assert_eq!(
        (job.state, ledger.known("hash of a").expect("a ledger")),
        (JobState::Done, Some("a1".into()))
    );
    let refused = ledger.set_state("a1", &[JobState::Running], JobState::Cancelled, None).expect("a ledger");
    assert_eq!(refused, Some(JobState::Done));
    let kinds: Vec<String> =
        ledger.events(Some("a1"), 0, 99).expect("events").into_iter().map(|event| event.kind).collect();
    assert_eq!(kinds, ["queued", "running", "unit", "unit", "unit", "frame", "frame", "done"]);
    let unit = &ledger.events(Some("a1"), 0, 99).expect("events")[3];
    let told: serde_json::Value = serde_json::from_str(&unit.data).expect("JSON");
    assert_eq!((&told["number"], &told["worker"]), (&1.into(), &"w".into()));
    let kept: Rendering = serde_json::from_value(told["rendering"].clone()).expect("how it was rendered");
    assert_eq!(kept, rendering);
}

#[test]
fn a_change_that_fails_undoes_itself_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    let failed = ledger.change(|connection| {
        connection.execute("INSERT INTO scene VALUES ('half', 1, 1)", [])?;
        connection.execute("INSERT INTO nowhere VALUES (1)", [])
    });
    assert!(failed.is_err());
    ledger.keep_scene("whole", 7).expect("kept");
    assert_eq!(ledger.scene("half").expect("a ledger"), None);
    assert_eq!(ledger.scene("whole").expect("a ledger"), Some(7));
}

#[test]
fn damage_and_newer_versions_are_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    ledger.change(|connection| connection.pragma_update(None, "user_version", 99)).expect("changed");
    drop(ledger);
    assert!(matches!(Ledger::open(folder.path()), Err(LedgerError::Newer { version: 99, .. })));
    std::fs::write(folder.path().join(FILE), b"SQLite format 3\0 and no more than that").expect("a file");
    assert!(Ledger::open(folder.path()).is_err());
}

#[test]
fn a_clock_that_is_set_back_delays_no_call() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    let hooked = NewJob { has_webhook: true, ..new("a1", None) };
    assert_eq!(ledger.accept(hooked, 2).expect("accepted"), Accepted::New);
    ledger.set_state("a1", &[JobState::Queued], JobState::Cancelled, None).expect("ended");
    assert_eq!(ledger.due_calls().expect("calls"), [("a1".into(), 0)]);
    ledger.called("a1", Some(3_600_000)).expect("again in an hour");
    assert!(ledger.due_calls().expect("calls").is_empty(), "not before");
    // An hour is what the longest pause lasts; a year is the clock's doing.
    ledger.called("a1", Some(365 * 24 * 3_600_000)).expect("the clock was a year ahead");
    assert_eq!(ledger.due_calls().expect("calls"), [("a1".into(), 2)]);
}

//! Tests of the ledger.

use super::*;
use crate::backend::{FrameId, JobCost, StopRule};
use crate::coordinator::Webhook;
use raystream::schedule::Priority;

/// A job as a request makes it.
pub fn new(id: &str, key: Option<&str>) -> NewJob {
    NewJob {
        id: id.into(),
        tenant: "t".into(),
        request: "{}".into(),
        request_id: "r".into(),
        trace_parent: String::new(),
        request_hash: format!("hash of {}", &id[..1]),
        demand: JobCost::new((4, 4), 8, Some(2), StopRule::Samples),
        scene: "s".into(),
        priority: Priority::Normal,
        idempotency_key: key.map(str::to_owned),
        webhook: None,
        title: String::new(),
        labels: vec![],
        quotas: Quotas::default(),
        shared_after: None,
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
    let frames = vec![FrameId::new(0, "front"), FrameId::new(1, "back")];
    for _ in 0..2 {
        ledger.plan("a1", frames.clone(), 8).expect("planned once");
    }
    for _ in 0..2 {
        ledger.add_units("a1", vec![(0, unit(0, 0)), (0, unit(0, 1))]).expect("cut once");
    }
    drop(ledger);
    let ledger = Ledger::open(folder.path()).expect("the same ledger");
    assert_eq!(ledger.active(9).expect("jobs").len(), 1);
    let units = || ledger.units_of("a1", 0).expect("units").2;
    assert_eq!(units(), [unit(0, 0), unit(0, 1)]);
    let by = |number| UnitRow { worker: Some("w".into()), digest: Some("d".into()), ..unit(0, number) };
    let rendering = Rendering { seconds: 0.5, samples: 512, deliveries: 2, ..Rendering::default() };
    let keep = |number| ledger.keep_unit("a1", by(number), "w", rendering, None).expect("a ledger");
    let share = || ledger.totals("a1").expect("totals").share;
    assert!(keep(0));
    assert!(!keep(0), "kept before");
    assert_eq!(share(), 0.125);
    assert!(keep(1));
    ledger.reopen_unit("a1", &units()[1]).expect("again");
    assert_eq!((units()[0].state, units()[1].state), (UnitState::Kept, UnitState::Open));
    assert!(keep(1), "kept again");
    assert!(ledger.fold("a1", (0, 0), 7).expect("folded"));
    let (round, sums, rows) = ledger.units_of("a1", 0).expect("units");
    assert_eq!((round, sums, rows.len(), rows[0].number, rows[0].state), (0, 7, 1, 1, UnitState::Folded));
    let totals = ledger.totals("a1").expect("totals");
    assert_eq!((totals.units, totals.units_done, totals.share), (2, 2, 0.25));
    ledger.begin_anew("a1", 0).expect("begun");
    assert_eq!((ledger.units_of("a1", 0).expect("units"), share()), ((1, 0, vec![]), 0.0));
    assert_eq!(ledger.open_frames("a1", 9).expect("frames"), [0, 1]);
    for number in 0..2 {
        let hash = Some(format!("hash {number}"));
        let row = FrameRow { number, name: String::new(), hash, layers: None, metadata: None, objects: None };
        assert!(ledger.finish_frame("a1", row, None).expect("finished"));
    }
    let job = ledger.job("a1").expect("a ledger").expect("the job");
    assert_eq!(
        (job.state, ledger.known("t", "hash of a").expect("a ledger").map(|job| job.id)),
        (JobState::Done, Some("a1".into()))
    );
    let refused = ledger.set_state("a1", &[JobState::Running], JobState::Cancelled, None).expect("a ledger");
    assert_eq!(refused, Some(JobState::Done));
    let kinds: Vec<String> = ledger
        .events(EventsOf::Job("a1"), 0, 99)
        .expect("events")
        .into_iter()
        .map(|event| event.kind)
        .collect();
    assert_eq!(kinds, ["queued", "running", "unit", "unit", "unit", "frame", "frame", "done"]);
    let unit = &ledger.events(EventsOf::Job("a1"), 0, 99).expect("events")[3];
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
    ledger.keep_scene(None, "whole", 7).expect("kept");
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
    std::fs::write(folder.path().join(Ledger::FILE), b"SQLite format 3\0 and no more than that")
        .expect("a file");
    assert!(Ledger::open(folder.path()).is_err());
}

#[test]
fn a_clock_that_is_set_back_delays_no_call() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    let hook = |url: &str| Webhook { url: url.into(), secret: "s".into() };
    let hooked = NewJob { webhook: Some(hook("http://a/")), ..new("a1", None) };
    assert_eq!(ledger.accept(hooked, 2).expect("accepted"), Accepted::New);
    let due = || {
        ledger.due_calls(9).expect("calls").into_iter().map(|due| (due.job, due.attempts)).collect::<Vec<_>>()
    };
    assert!(due().is_empty(), "the job has not ended");
    ledger.set_state("a1", &[JobState::Queued], JobState::Cancelled, None).expect("ended");
    assert_eq!(due(), [("a1".into(), 0)]);
    let id = ledger.deliveries("a1").expect("deliveries")[0].id.clone();
    let fails = |again_in_ms| Outcome {
        status: Some(503),
        error: Some("busy".into()),
        again_in_ms: Some(again_in_ms),
    };
    ledger.called(&id, fails(3_600_000)).expect("again in an hour");
    assert!(due().is_empty(), "not before");
    // An hour is what the longest pause lasts; a year is the clock's doing.
    ledger.called(&id, fails(365 * 24 * 3_600_000)).expect("the clock was a year ahead");
    assert_eq!(due(), [("a1".into(), 2)]);
    ledger.called(&id, Outcome { status: Some(200), ..Outcome::default() }).expect("delivered");
    assert!(due().is_empty());
    // A job that goes on calls the same addresses when it ends again, each once.
    assert!(ledger.add_delivery("a1", hook("http://b/")).expect("a ledger"));
    ledger.set_state("a1", &[JobState::Cancelled], JobState::Queued, None).expect("it goes on");
    assert!(due().is_empty());
    ledger.set_state("a1", &[JobState::Queued], JobState::Failed, Some("why".into())).expect("ended");
    assert_eq!(due().len(), 2);
    let states = ledger.deliveries("a1").expect("deliveries").into_iter().map(|one| one.state);
    let delivered = states.filter(|state| *state == DeliveryState::Delivered).count();
    assert_eq!((delivered, ledger.due_calls(1).expect("calls").len()), (1, 1));
    while ledger.add_delivery("a1", hook("http://c/")).expect("a ledger") {}
    assert_eq!(due().len(), 9, "no more of a tenant than were asked for");
    assert_eq!(ledger.due_calls(1000).expect("calls").len(), 100, "and no more of a job");
}

#[test]
fn calls_of_earlier_tables_are_deliveries() {
    let folder = tempfile::tempdir().expect("a folder");
    let connection = Connection::open(folder.path().join(Ledger::FILE)).expect("a database");
    schema::migrate_to(&connection, 7).expect("the tables of version 7");
    connection
        .execute_batch(
            "INSERT INTO job (id, state, request, request_hash, demand, scene, priority, created_ms) VALUES
                 ('a1', 'done', '{\"scene\":\"s\",\"spp\":2,\"webhook\":{\"url\":\"http://a/\",\"secret\":\"k\"}}',
                  'h', '{\"size\":[4,4],\"spp\":8,\"frames\":1,\"kind\":\"samples\"}', 's', 'normal', 1),
                 ('a2', 'done', '{\"scene\":\"s\",\"webhook\":{\"url\":\"http://b/\",\"secret\":\"k\"}}',
                  'h', '{\"size\":[4,4],\"spp\":8,\"frames\":1,\"kind\":\"samples\"}', 's', 'normal', 1);
             INSERT INTO call VALUES ('a1', 3, 7);",
        )
        .expect("rows");
    drop(connection);
    let ledger = Ledger::open(folder.path()).expect("it is brought up to date");
    let [due] = &ledger.due_calls(9).expect("calls")[..] else { panic!("one was not answered yet") };
    assert_eq!((&*due.job, &*due.hook.url, &*due.hook.secret, due.attempts), ("a1", "http://a/", "k", 3));
    let request = |id: &str| ledger.job(id).expect("a ledger").expect("a job").request;
    assert_eq!((&*request("a1"), &*request("a2")), (r#"{"scene":"s","spp":2}"#, r#"{"scene":"s"}"#));
}

/// A job of two frames, planned.
fn planned(ledger: &Ledger, id: &str) {
    assert_eq!(ledger.accept(new(id, None), 9).expect("accepted"), Accepted::New);
    ledger.plan(id, vec![FrameId::new(0, ""), FrameId::new(1, "")], 8).expect("planned");
    let units = [unit(0, 0), unit(0, 1), unit(1, 0)].map(|unit| (0, unit));
    ledger.add_units(id, units.to_vec()).expect("cut");
}

fn finish(ledger: &Ledger, id: &str, number: u32) {
    let row = FrameRow {
        number,
        name: String::new(),
        hash: Some("h".into()),
        layers: None,
        metadata: None,
        objects: None,
    };
    assert!(ledger.finish_frame(id, row, Some(0)).expect("finished"));
}

#[test]
fn comparisons_outlive_the_process_and_are_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    planned(&ledger, "a1");
    let row = UnitRow { worker: Some("K".into()), digest: Some("d".into()), ..unit(0, 1) };
    let blocks = vec![7, 1 << 30];
    assert!(
        ledger.keep_unit("a1", row.clone(), "w", Rendering::default(), Some(blocks.clone())).expect("kept")
    );
    assert!(ledger.fold("a1", (0, 0), 1).expect("folded"));
    drop(ledger);
    let ledger = Ledger::open(folder.path()).expect("the same ledger");
    let pending = ledger.pending("a1", 0).expect("pending");
    let expected = UnitRow { blocks: 2, state: UnitState::Kept, ..row.clone() };
    assert_eq!(pending, [Pending { unit: expected, blocks, name: "w".into() }]);
    assert!(ledger.pending("a1", 1).expect("pending").is_empty());
    let early = first_frame();
    assert!(!ledger.finish_frame("a1", early, Some(0)).expect("a ledger"), "it is to be compared first");
    for _ in 0..2 {
        ledger.end_comparison("a1", &row, ["K".into(), "L".into()]).expect("ended once");
    }
    assert!(ledger.pending("a1", 0).expect("pending").is_empty());
    assert_eq!(ledger.checks("a1").expect("checks"), Checks { compared: 1, keys: 2, suspects: vec![] });
}

/// A finished frame 0.
fn first_frame() -> FrameRow {
    FrameRow {
        number: 0,
        name: String::new(),
        hash: Some("h".into()),
        layers: None,
        metadata: None,
        objects: None,
    }
}

#[test]
fn who_is_found_wrong_makes_ended_jobs_suspect_and_others_begin_anew() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    for id in ["a1", "b1", "c1"] {
        planned(&ledger, id);
        let worker = if id == "c1" { "honest" } else { "liar" };
        let row = UnitRow { worker: Some(worker.into()), digest: Some("d".into()), ..unit(0, 0) };
        assert!(ledger.keep_unit(id, row, worker, Rendering::default(), None).expect("kept"));
        finish(&ledger, id, 0);
    }
    finish(&ledger, "a1", 1);
    assert_eq!(ledger.known("t", "hash of a").expect("a ledger").map(|job| job.id), Some("a1".into()));
    // The job that goes on loses a picture, and the one that has ended is suspect.
    let anew = ledger.quarantine("liar", "w1", "it lies").expect("quarantined");
    assert_eq!(anew, [("b1".into(), 0)]);
    ledger.add_units("b1", vec![(0, unit(0, 5))]).expect("a ledger");
    assert_eq!(
        ledger.units_of("b1", 0).expect("units"),
        (1, 0, vec![]),
        "what was cut before is no unit any more"
    );
    let late = first_frame();
    assert!(!ledger.finish_frame("b1", late, Some(0)).expect("a ledger"), "a picture of the round before");
    assert!(!ledger.fold("b1", (0, 0), 9).expect("read"), "sums of the round before");
    assert_eq!(ledger.open_frames("b1", 9).expect("frames"), [0, 1]);
    let suspects = |id: &str| ledger.checks(id).expect("checks").suspects;
    assert_eq!((suspects("a1"), suspects("b1"), suspects("c1")), (vec!["w1".into()], vec![], vec![]));
    assert!(ledger.known("t", "hash of a").expect("a ledger").is_none(), "it answers no other request");
    let last = ledger.events(EventsOf::Job("a1"), 0, 99).expect("events").pop().expect("one");
    assert_eq!((&*last.kind, last.data.contains("w1")), ("suspect", true));
    assert_eq!(ledger.quarantined().expect("one"), [("liar".into(), "w1".into(), "it lies".into())]);
    assert!(
        ledger.trust("liar").expect("trusted") && !ledger.trust("liar").expect("it is not there any more")
    );
    assert!(ledger.quarantined().expect("none").is_empty());
    assert_eq!(suspects("a1"), ["w1"], "what it has sent stays suspect");
}

#[test]
fn attempts_are_those_of_different_workers() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    planned(&ledger, "a1");
    let tried = |worker| ledger.note_attempt("a1", &unit(0, 0), worker).expect("noted");
    assert_eq!(["v", "w", "v", "v", "x"].map(tried), [1, 2, 2, 2, 3]);
    ledger.forgive("a1").expect("forgiven");
    assert_eq!(tried("v"), 1);
}

#[test]
fn an_older_ledger_goes_on_and_its_loose_sums_are_taken_anew() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(Ledger::FILE);
    let connection = Connection::open(&path).expect("a database");
    schema::migrate_to(&connection, 2).expect("the tables of version 2");
    connection
        .execute_batch(
            "INSERT INTO job (id, state, request, request_hash, demand, scene, priority, created_ms, planned) VALUES
                 ('a1', 'running', '{}', 'h', '{\"size\":[4,4],\"spp\":8,\"frames\":1,\"kind\":\"samples\"}', 's',
                  'normal', 1, 1);
             INSERT INTO frame (job, number, name) VALUES ('a1', 0, '');
             INSERT INTO unit (job, frame, pass, number, block, blocks, first, end, state, worker, digest)
                 VALUES ('a1', 0, 0, 0, 0, 1, 0, 2, 1, 'w', 'd'), ('a1', 0, 0, 1, 0, 1, 2, 4, 2, 'w', 'd');
             INSERT INTO quarantine VALUES ('w', 'why', 1);",
        )
        .expect("rows");
    drop(connection);
    let ledger = Ledger::open(folder.path()).expect("it is brought up to date");
    let (round, _, units) = ledger.units_of("a1", 0).expect("units");
    let states: Vec<UnitState> = units.iter().map(|unit| unit.state).collect();
    assert_eq!((round, states), (0, vec![UnitState::Open, UnitState::Folded]));
    assert!(ledger.quarantined().expect("names are no keys").is_empty());
    assert_eq!(ledger.active(9).expect("jobs").len(), 1);
}

#[test]
fn what_there_was_before_tenants_is_the_first_tokens() {
    let folder = tempfile::tempdir().expect("a folder");
    let connection = Connection::open(folder.path().join(Ledger::FILE)).expect("a database");
    schema::migrate_to(&connection, 3).expect("the tables of version 3");
    connection
        .execute_batch(
            "INSERT INTO job (id, state, request, request_hash, demand, scene, priority, idempotency_key, created_ms)
                 VALUES ('a1', 'done', '{}', 'h', '{\"size\":[4,4],\"spp\":8,\"frames\":1,\"kind\":\"samples\"}',
                  's', 'normal', 'k', 1);
             INSERT INTO event (job, time_ms, kind, data) VALUES ('a1', 1, 'queued', '{}');
             INSERT INTO scene VALUES ('s', 7, 1);",
        )
        .expect("rows");
    drop(connection);
    let ledger = Ledger::open(folder.path()).expect("it is brought up to date");
    assert_eq!(ledger.job("a1").expect("a ledger").expect("a job").subject(), "job a1");
    let of = |tenant: &str| JobFilter { tenant: Some(tenant.into()), ..JobFilter::default() };
    for (tenant, count) in [("admin", 1), ("other", 0)] {
        assert_eq!(ledger.jobs(&of(tenant), None, 9).expect("jobs").len(), count, "{tenant}");
        assert_eq!(ledger.events(EventsOf::Tenant(tenant), 0, 9).expect("events").len(), count, "{tenant}");
        assert_eq!(ledger.known(tenant, "h").expect("a ledger").is_some(), count > 0, "{tenant}");
        assert_eq!(ledger.scene_of(Some(tenant), "s").expect("a ledger").is_some(), count > 0, "{tenant}");
        let again = NewJob { tenant: tenant.into(), request_hash: "h".into(), ..new(tenant, Some("k")) };
        let accepted = if count > 0 { Accepted::Earlier("a1".into(), true) } else { Accepted::New };
        assert_eq!(ledger.accept(again, 9).expect("accepted"), accepted, "{tenant}");
    }
    assert_eq!(ledger.jobs(&JobFilter::default(), None, 9).expect("jobs").len(), 2, "all");
}

#[test]
fn equal_requests_share_a_job_until_it_is_of_no_use() {
    let folder = tempfile::tempdir().expect("a folder");
    let ledger = Ledger::open(folder.path()).expect("a ledger");
    let accept = |id: &str, tenant: &str, shared_after| {
        ledger.accept(NewJob { tenant: tenant.into(), shared_after, ..new(id, None) }, 9).expect("accepted")
    };
    let shared = Accepted::Shared("a1".into());
    assert_eq!(accept("a1", "t", Some(0)), Accepted::New);
    assert_eq!(accept("a2", "t", Some(0)), shared);
    assert_eq!(accept("a3", "t", None), Accepted::New, "it is to be rendered anew");
    assert_eq!(accept("a4", "u", Some(0)), Accepted::New, "it is another tenant's");
    ledger.set_state("a3", &[JobState::Queued], JobState::Cancelled, None).expect("a ledger");
    ledger.set_state("a1", &[JobState::Queued], JobState::Done, None).expect("a ledger");
    assert_eq!(accept("a5", "t", Some(0)), shared, "it has ended meanwhile");
    let seq = ledger.job("a1").expect("a ledger").expect("the job").seq;
    assert_eq!(accept("a6", "t", Some(seq)), Accepted::New, "its pictures are gone");
    assert_eq!(accept("a7", "t", Some(seq)), Accepted::Shared("a6".into()));
    for state in [JobState::Failed, JobState::Cancelled, JobState::Paused] {
        ledger.set_state("a6", &JobState::ALL, state, None).expect("a ledger");
        let id = format!("a8{state}");
        assert_eq!(accept(&id, "t", Some(seq)), Accepted::New, "{state}");
        ledger.set_state(&id, &[JobState::Queued], JobState::Cancelled, None).expect("a ledger");
    }
}

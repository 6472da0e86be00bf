//! One thing goes wrong at a time.

use crate::machines::worker_output;
use crate::{Nats, SIZE, Worker, coordinator, folder, rendered, shipped, still};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A job of many short units. It outlasts the tests here on the fastest machine too.
fn long() -> serde_json::Value {
    json!({ "size": "64x48", "spp": 8192, "seed": 3 })
}

#[test]
fn workers_that_die_or_fall_silent_lose_their_units_to_others() {
    let (job, hash) = still();
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let mut killed = Worker::start(&nats.url(), "killed", &["--failpoint", "unit-rendered:2"]);
    let mut sent = Worker::start(&nats.url(), "sent", &["--failpoint", "result-sent:2"]);
    let id = service.submit(&scene, &job);
    assert_eq!((killed.process.wait().code(), sent.process.wait().code()), (None, None), "both are dead");
    let paused = Worker::start(&nats.url(), "paused", &[]);
    std::thread::sleep(Duration::from_millis(300));
    paused.process.pause(Duration::from_millis(2500));
    assert_eq!(service.hashes(&id), [hash]);
}

#[test]
fn a_worker_that_is_asked_to_end_leaves_in_good_order() {
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &long());
    let mut first = Worker::start(&nats.url(), "first", &[]);
    service.wait_for(&id, &["running"]);
    while service.job(&id)["units_done"].as_u64() < Some(3) {
        std::thread::sleep(Duration::from_millis(20));
    }
    first.process.terminate();
    assert_eq!(first.process.wait().code(), Some(0));
    let workers = service.get("/api/v1/workers").json();
    assert_eq!(workers["workers"], json!([]), "it has said good-bye");
    let cancelled = service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({}));
    assert_eq!(cancelled.status, 200);
    // With nothing to do it ends by itself.
    let cache = folder();
    let (code, told) = worker_output(&nats.url(), cache.path(), &["--drain"]);
    assert_eq!(code, Some(0), "{told}");
}

#[test]
fn a_cancelled_job_ends_everywhere_within_a_second() {
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let _worker = Worker::start(&nats.url(), "w", &[]);
    let busy = || service.get("/api/v1/workers").json()["workers"][0]["state"] == "busy";
    let id = service.submit(&scene, &json!({ "size": "640x480", "spp": 4096 }));
    let began = Instant::now();
    while !busy() {
        assert!(began.elapsed() < crate::service::PATIENCE, "the worker has no unit");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({})).status, 200);
    let began = Instant::now();
    while busy() {
        assert!(began.elapsed() < Duration::from_secs(1), "it goes on");
        std::thread::sleep(Duration::from_millis(20));
    }
    println!("{} ms from the cancellation to the last unit", began.elapsed().as_millis());
}

#[test]
fn the_coordinator_may_die_anywhere() {
    let (job, hash) = still();
    for place in [
        "film-written:1",
        "before-commit:6",
        "after-commit:6",
        "unit-kept:2",
        "sums-written:0",
        "sums-committed:0",
        "frame-complete:0",
        "folding:0",
    ] {
        let (nats, data) = (Nats::start(), folder());
        let options = ["--most-files", "3", "--failpoint", place];
        let mut service = coordinator(data.path(), &nats.url(), &options);
        let scene = service.upload_file(&shipped("cornell.json"));
        let _workers = Worker::some(&nats.url(), 2);
        let id = service.submit(&scene, &job);
        assert_eq!(service.wait_for_end(), None, "{place}: it is dead");
        let service = coordinator(data.path(), &nats.url(), &["--most-files", "3"]);
        assert_eq!(service.hashes(&id), std::slice::from_ref(&hash), "{place}");
    }
}

#[test]
fn a_server_that_dies_costs_time_alone() {
    let (job, hash) = still();
    let (mut nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let first = service.submit(&scene, &long());
    let second = service.submit(&scene, &job);
    let _workers = Worker::some(&nats.url(), 2);
    while service.job(&first)["units_done"].as_u64() < Some(3) {
        std::thread::sleep(Duration::from_millis(20));
    }
    nats.kill();
    nats.restart();
    assert_eq!(service.hashes(&second), [hash]);
    let began = Instant::now();
    let done = || service.job(&first)["units_done"].as_u64().expect("a number");
    let before = done();
    while done() < before + 3 {
        assert!(began.elapsed() < crate::service::PATIENCE, "no unit comes back any more");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_worker_whose_sums_are_wrong_is_found_and_named() {
    let (job, hash) = still();
    let (nats, data) = (Nats::start(), folder());
    let service = crate::Service::start(
        data.path(),
        &["--nats", &nats.url(), "--lease", "1", "--compared", "1", "--most-files", "3"],
    );
    let scene = service.upload_file(&shipped("cornell.json"));
    let mut wrong = Worker::start(&nats.url(), "wrong", &["--mischief", "lie"]);
    let _right = Worker::start(&nats.url(), "right", &[]);
    let began = Instant::now();
    while service.get("/api/v1/workers").json()["workers"].as_array().map(Vec::len) < Some(2) {
        assert!(began.elapsed() < crate::service::PATIENCE, "the workers do not join");
        std::thread::sleep(Duration::from_millis(20));
    }
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
    assert_eq!(wrong.process.wait().code(), Some(2));
    let cache = folder();
    let (code, told) = worker_output(&nats.url(), cache.path(), &["--name", "wrong"]);
    assert_eq!(code, Some(2));
    assert!(told.contains("worker wrong is refused") && told.contains("check its memory"), "{told}");
}

#[test]
fn a_worker_that_cannot_render_fails_no_job_and_is_named() {
    // So few units that the job ends before the worker is asked again.
    let job = json!({ "size": SIZE, "spp": 4, "seed": 7 });
    let hash = rendered(&shipped("cornell.json"), &["--size", SIZE, "--spp", "4", "--seed", "7"]);
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    // Caches that are too small for the scene: the coordinator proves that the unit is not to blame.
    let _small = Worker::start(&nats.url(), "small", &["--cache-size", "10"]);
    let id = service.submit(&scene, &job);
    let resting = crate::state_of(&service, "small", "resting");
    assert_eq!(service.hashes(&id), [hash]);
    assert!(resting["reason"].as_str().is_some_and(|why| why.contains("--cache-size")), "{resting}");
}

#[test]
fn a_full_disk_delays_results_and_loses_none() {
    use rustix::process::{Resource, Rlimit, prlimit};
    let (job, hash) = still();
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    let process = Pid::from_raw(service.process() as i32).expect("a process");
    let _workers = Worker::some(&nats.url(), 2);
    while service.job(&id)["units_done"].as_u64() < Some(2) {
        std::thread::sleep(Duration::from_millis(10));
    }
    let space = |bytes| {
        let limit = Rlimit { current: bytes, maximum: None };
        prlimit(Some(process), Resource::Fsize, limit).expect("the limit is set");
    };
    space(Some(0));
    let refuses = || {
        let measurements = service.get("/metrics").body;
        String::from_utf8_lossy(&measurements).lines().any(|line| line == "raystream_data_folder_refuses 1")
    };
    let wait_for = |status: u16| {
        let began = Instant::now();
        while service.get("/readyz").status != status {
            assert!(began.elapsed() < crate::service::PATIENCE, "it is not {status}");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    // What was being written when the limit was set may still end well.
    let began = Instant::now();
    loop {
        let answer = service.get("/readyz");
        let told = String::from_utf8_lossy(&answer.body).into_owned();
        let is_named = ["cannot be written", "ledger cannot be used"].iter().any(|why| told.contains(why));
        if answer.status == 503 && is_named && refuses() {
            break;
        }
        assert!(began.elapsed() < crate::service::PATIENCE, "{told}");
        std::thread::sleep(Duration::from_millis(20));
    }
    // Whoever uploads is told, too, however much it sends.
    let large = [&b"glTF"[..], &vec![0; 8 << 20]].concat();
    assert_eq!(service.upload(&large).1.status / 100, 5);
    space(None);
    assert_eq!(service.hashes(&id), [hash]);
    wait_for(200);
    assert!(!refuses());
}

/// Kills the server that a service has started, however a test ends.
struct Spawned(PathBuf);

impl Drop for Spawned {
    fn drop(&mut self) {
        let written = std::fs::read_to_string(self.0.join("nats/pid")).unwrap_or_default();
        if let Some(process) = written.trim().parse().ok().and_then(Pid::from_raw) {
            // It may have ended.
            let _ = kill_process(process, Signal::KILL);
        }
    }
}

#[test]
fn a_server_of_ones_own_is_started_and_found_again() {
    let (job, hash) = still();
    let data = folder();
    let _spawned = Spawned(data.path().into());
    let options = ["--spawn-nats", "--lease", "1"];
    let service = crate::Service::start(data.path(), &options);
    let port = || std::fs::read_to_string(data.path().join("nats/port")).expect("a port");
    let url = format!("nats://127.0.0.1:{}", port());
    let keys = data.path().join("nats/workers");
    let with_key = ["--nats-key", keys.to_str().expect("UTF-8")];
    // Who has no key is no worker.
    let (code, told) = worker_output(&url, folder().path(), &[]);
    assert_eq!(code, Some(2));
    assert!(told.contains("name this process's with --nats-key"), "{told}");
    let listens = || TcpStream::connect(("127.0.0.1", port().trim().parse().expect("a number"))).is_ok();
    let worker = Worker::start(&url, "w", &with_key);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    // Its server outlives it.
    service.kill();
    assert!(listens());
    let mut service = crate::Service::start(data.path(), &options);
    assert_eq!(url, format!("nats://127.0.0.1:{}", port()));
    assert_eq!(service.hashes(&id), [hash]);
    drop(worker);
    // A service that ends in good order ends the server too, although it has found it.
    let process = Pid::from_raw(service.process() as i32).expect("a process");
    kill_process(process, Signal::TERM).expect("it is there");
    assert_eq!(service.wait_for_end(), Some(0));
    let began = Instant::now();
    while listens() {
        assert!(began.elapsed() < Duration::from_secs(5), "the server is left behind");
        std::thread::sleep(Duration::from_millis(20));
    }
}

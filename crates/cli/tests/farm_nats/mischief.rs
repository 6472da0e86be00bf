//! Workers that lie, spoil, hold and return units. No picture is wrong, no job fails, and each is named.

use crate::machines::{Worker, worker_output};
use crate::secured::{Farm, wait_for_workers};
use crate::service::{PATIENCE, Service, raystream};
use crate::{folder, shipped, state_of, still};
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A job of many units.
fn many() -> Value {
    json!({ "size": "96x64", "spp": 64, "seed": 3 })
}

/// What a farm lives in: it ends with it.
type Home = (Vec<Worker>, Farm, TempDir);

/// A farm of honest workers and one that is not; how long the job takes, and its hash.
fn with_one(what: Option<&str>, job: &Value) -> (Duration, String, Service, Home) {
    let (farm, data) = (Farm::new(4), folder());
    let service = farm.comparing(data.path(), "0");
    let mut workers: Vec<Worker> =
        ["worker-2", "worker-3", "worker-4"].map(|name| farm.worker(name)).into_iter().collect();
    let options: Vec<&str> = what.into_iter().flat_map(|what| ["--mischief", what]).collect();
    workers.push(farm.worker_that("worker-1", &options));
    wait_for_workers(&service, 4);
    let scene = service.upload_file(&shipped("cornell.json"));
    // They all have the scene before the clock runs.
    let first = service.submit(&scene, &json!({ "size": "24x16", "spp": 32 }));
    service.hashes(&first);
    let began = Instant::now();
    let id = service.submit(&scene, job);
    let hash = service.hashes(&id).remove(0);
    (began.elapsed(), hash, service, (workers, farm, data))
}

#[test]
fn with_all_units_compared_no_lie_ends_in_a_picture() {
    let (job, hash) = still();
    for seed in ["1", "2"] {
        let (farm, data) = (Farm::new(3), folder());
        let service = farm.comparing(data.path(), "1");
        let scene = service.upload_file(&shipped("cornell.json"));
        let _honest = ["worker-2", "worker-3"].map(|name| farm.worker(name));
        let mut liar = farm.worker_that("worker-1", &["--mischief", "lie"]);
        let id = service.submit(&scene, &job);
        assert_eq!(service.hashes(&id), [hash.as_str()], "{seed}");
        let other = service.submit(&scene, &json!({ "size": "24x16", "spp": 16, "seed": seed }));
        service.hashes(&other);
        let shown = service.job(&id);
        assert_eq!(shown["compared"]["share"], 1.0, "{shown}");
        assert!(
            shown["compared"]["workers"].as_u64() >= Some(2) && shown["suspects"] == json!([]),
            "{shown}"
        );
        let found = state_of(&service, "worker-1", "quarantined");
        assert!(found["reason"].as_str().is_some_and(|why| why.contains("check its memory")), "{found}");
        assert_eq!(liar.process.wait().code(), Some(2));
        // No honest one is in quarantine because a frame has begun anew.
        let workers = service.get("/api/v1/workers").json();
        let quarantined = workers["workers"].as_array().expect("workers").iter();
        assert_eq!(quarantined.filter(|worker| worker["state"] == "quarantined").count(), 1, "{workers}");
    }
}

#[test]
fn a_liar_alone_is_found_by_the_coordinator_itself() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.comparing(data.path(), "1");
    let scene = service.upload_file(&shipped("cornell.json"));
    let mut liar = farm.worker_that("worker-1", &["--mischief", "lie"]);
    let id = service.submit(&scene, &job);
    assert_eq!(liar.process.wait().code(), Some(2));
    let _honest = farm.worker("worker-2");
    assert_eq!(service.hashes(&id), [hash]);
}

#[test]
fn the_first_units_of_a_new_key_are_compared_whatever_the_share() {
    let (farm, data) = (Farm::new(3), folder());
    let service = farm.comparing(data.path(), "0.000001");
    let scene = service.upload_file(&shipped("cornell.json"));
    let _honest = ["worker-2", "worker-3"].map(|name| farm.worker(name));
    wait_for_workers(&service, 2);
    let id = service.submit(&scene, &many());
    service.hashes(&id);
    let job = service.job(&id);
    assert!(job["compared"]["units"].as_u64() >= Some(8), "{job}");
    assert_eq!(job["compared"]["workers"], 2, "{job}");
    // Units after a key's first are not compared: the share says so.
    let [units, share] = ["units", "share"].map(|name| job["compared"][name].as_f64().expect("a number"));
    let done = job["units_done"].as_f64().expect("a number");
    assert!(share == units / done && (0.01..1.0).contains(&share), "{job}");
    let token = data.path().join("token").to_str().expect("UTF-8").to_owned();
    let output = raystream(&["jobs", "--server", &service.url, "--token-file", &token, &id]);
    let line = format!("  compared: {:.1} % of its units, by 2 workers", 100.0 * share);
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(printed.lines().any(|printed| printed == line), "{printed} has no {line:?}");
    // A liar that comes later is found by its first units.
    let mut liar = farm.worker_that("worker-1", &["--mischief", "lie"]);
    wait_for_workers(&service, 3);
    let (job, hash) = still();
    let id = service.submit(&scene, &job);
    assert_eq!(liar.process.wait().code(), Some(2));
    state_of(&service, "worker-1", "quarantined");
    assert_eq!(service.hashes(&id), [hash]);
}

#[test]
fn done_jobs_with_sums_of_a_liar_are_suspect_and_trust_is_given_back_by_hand() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.comparing(data.path(), "0");
    let scene = service.upload_file(&shipped("cornell.json"));
    // Nothing is compared: the lie ends in a picture.
    let liar = farm.worker_that("worker-1", &["--mischief", "lie"]);
    let first = service.submit(&scene, &job);
    assert_ne!(service.hashes(&first), [hash.as_str()]);
    assert_eq!(service.job(&first)["compared"], json!({ "units": 0, "share": 0.0, "workers": 0 }));
    drop(liar);
    service.kill();
    // From here on all are, and the old lie comes out.
    let service = farm.comparing(data.path(), "1");
    let _honest = farm.worker("worker-2");
    let mut liar = farm.worker_that("worker-1", &["--mischief", "lie"]);
    wait_for_workers(&service, 2);
    let second = service.submit(&scene, &json!({ "size": "24x16", "spp": 16, "seed": 8 }));
    service.hashes(&second);
    assert_eq!(liar.process.wait().code(), Some(2));
    let shown = service.job(&first);
    assert_eq!((&shown["state"], &shown["suspects"]), (&json!("done"), &json!(["worker-1"])), "{shown}");
    assert_eq!(service.job(&second)["suspects"], json!([]));
    let again = service.submit(&scene, &job);
    assert_ne!(again, first, "a suspect picture answers no request");
    assert_eq!(service.hashes(&again), [hash]);
    // Its machine has been mended.
    let cache = folder();
    let key = farm.of("workers/worker-1");
    let path = |name: &str| key.join(name).to_str().expect("UTF-8").to_owned();
    let options = ["--name", "worker-1", "--nats-key", &path("nats.key"), "--nats-ca", &path("ca.pem")];
    let (code, told) = worker_output(&farm.url, cache.path(), &options);
    assert!(code == Some(2) && told.contains("is refused") && told.contains("check its memory"), "{told}");
    let token = data.path().join("token").to_str().expect("UTF-8").to_owned();
    let trust =
        |name: &str| raystream(&["farm", "trust", "--server", &service.url, "--token-file", &token, name]);
    let output = trust("worker-1");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!trust("nobody").status.success());
    let _mended = farm.worker("worker-1");
    wait_for_workers(&service, 2);
    assert_ne!(state_of_any(&service, "worker-1")["state"], "quarantined");
}

pub fn state_of_any(service: &Service, name: &str) -> Value {
    let shown = service.get("/api/v1/workers").json();
    let workers = shown["workers"].as_array().expect("workers").clone();
    workers.into_iter().find(|worker| worker["name"] == name).expect("it is there")
}

#[test]
fn a_worker_that_holds_units_and_returns_nothing_delays_the_others_little() {
    let samples: Option<u32> =
        std::env::var("RAYSTREAM_HOARDER_SAMPLES").ok().and_then(|text| text.parse().ok());
    let mut job = many();
    if let Some(samples) = samples {
        job["spp"] = json!(samples);
    }
    let (without, hash, ..) = with_one(None, &job);
    let (with, same, service, _home) = with_one(Some("hoard"), &job);
    assert_eq!(hash, same);
    let share = with.as_secs_f64() / without.as_secs_f64();
    println!(
        "{:.1} s with a hoarder, {:.1} s without: {share:.2} times",
        with.as_secs_f64(),
        without.as_secs_f64()
    );
    // A job of seconds: the pause before its last units are given to others counts.
    let slack = if samples.is_none() { 4.0 } else { 0.0 };
    assert!(with.as_secs_f64() < 1.6 * without.as_secs_f64() + slack, "{share}");
    let scene = service.upload_file(&shipped("cornell.json"));
    let next = service.submit(&scene, &json!({ "size": "96x64", "spp": 60_000, "seed": 4 }));
    let resting = state_of(&service, "worker-1", "resting");
    assert!(resting["reason"].as_str().is_some_and(|why| why.contains("has returned none")), "{resting}");
    service.post(&format!("/api/v1/jobs/{next}/cancel"), &json!({}));
}

#[test]
fn a_worker_that_says_of_all_units_that_they_fail_fails_no_job() {
    let (_, hash, service, _home) = with_one(Some("spoil"), &many());
    let (_, right, ..) = with_one(None, &many());
    assert_eq!(hash, right);
    let resting = state_of(&service, "worker-1", "resting");
    assert!(resting["reason"].as_str().is_some_and(|why| why.contains("what others can")), "{resting}");
}

#[test]
fn a_worker_that_gives_all_units_back_gets_no_more() {
    let (_, _, service, _home) = with_one(Some("return"), &many());
    let resting = state_of(&service, "worker-1", "resting");
    assert!(resting["reason"].as_str().is_some_and(|why| why.contains("gives units back")), "{resting}");
}

#[test]
fn two_processes_of_one_key_disturb_no_one() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.comparing(data.path(), "1");
    let scene = service.upload_file(&shipped("cornell.json"));
    let _own = farm.worker("worker-1");
    // Who has stolen the key works beside its owner, and spoils what it gets.
    let _thief = farm.worker_that("worker-1", &["--mischief", "spoil"]);
    let _other = farm.worker("worker-2");
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
}

#[test]
fn leases_outlive_the_coordinator() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(1), folder());
    let service = farm.comparing(data.path(), "0");
    let scene = service.upload_file(&shipped("cornell.json"));
    let worker = farm.worker("worker-1");
    let id = service.submit(&scene, &json!({ "size": "64x48", "spp": 4096, "seed": 2 }));
    while service.job(&id)["units_done"].as_u64() < Some(2) {
        std::thread::sleep(Duration::from_millis(10));
    }
    let before = units_of(data.path());
    service.kill();
    let service = farm.comparing(data.path(), "0");
    let began = Instant::now();
    while service.job(&id)["units_done"].as_u64() < Some(before + 3) {
        assert!(began.elapsed() < PATIENCE, "the worker's sums are not taken");
        std::thread::sleep(Duration::from_millis(10));
    }
    service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({}));
    let second = service.submit(&scene, &job);
    assert_eq!(service.hashes(&second), [hash]);
    drop(worker);
}

/// The number of files of sums that there are.
fn units_of(data: &Path) -> u64 {
    let jobs = std::fs::read_dir(data.join("jobs")).into_iter().flatten().flatten();
    let frames = jobs.flat_map(|job| std::fs::read_dir(job.path()).into_iter().flatten().flatten());
    frames.flat_map(|frame| std::fs::read_dir(frame.path()).into_iter().flatten().flatten()).count() as u64
}

//! Many things go wrong, at moments that a seed chooses. Every job ends with the right hash.

use crate::machines::{Nats, Worker};
use crate::relay::{Relay, mix};
use crate::{SIZE, Service, coordinator, folder, rendered, shipped};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Runs unless `RAYSTREAM_CHAOS` asks for more.
const RUNS: u64 = 3;

/// No new run begins after this time, unless all are asked for.
const TIME: Duration = Duration::from_secs(25);

/// Faults of a run.
const FAULTS: u64 = 4;

/// Jobs and their hashes.
fn jobs() -> Vec<(Value, String)> {
    let scene = shipped("cornell.json");
    let hash = |options: &[&str]| rendered(&scene, &[&["--size", SIZE][..], options].concat());
    vec![
        (json!({ "size": SIZE, "spp": 16, "seed": 7 }), hash(&["--spp", "16", "--seed", "7"])),
        (json!({ "size": SIZE, "noise": 0.5, "spp": 64 }), hash(&["--noise", "0.5", "--spp", "64"])),
        (json!({ "size": SIZE, "spp": 8, "aov": "depth" }), hash(&["--spp", "8", "--aov", "depth"])),
    ]
}

#[test]
fn every_job_ends_with_the_right_hash_whatever_dies() {
    let asked = std::env::var("RAYSTREAM_CHAOS").ok().and_then(|text| text.parse().ok());
    let first: u64 =
        std::env::var("RAYSTREAM_CHAOS_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let (jobs, began) = (jobs(), Instant::now());
    let (mut slowest, mut runs) = (Duration::ZERO, 0);
    for seed in first..first + asked.unwrap_or(RUNS) {
        if asked.is_none() && began.elapsed() > TIME {
            break;
        }
        let recovered = run(seed, &jobs);
        slowest = slowest.max(recovered);
        runs += 1;
        println!("seed {seed}: {:.1} s from the last fault to the last hash", recovered.as_secs_f64());
    }
    println!("{runs} runs, {} faults; slowest recovery {:.1} s", runs * FAULTS, slowest.as_secs_f64());
}

/// One run. Returns the time from the last fault until all jobs are done.
fn run(seed: u64, jobs: &[(Value, String)]) -> Duration {
    let mut random = (0..).map(|step: u64| mix(mix(seed) ^ step));
    let mut next = |of: u64| random.next().expect("endless") % of;
    let (mut nats, data) = (Nats::start(), folder());
    let relay = Relay::start(nats.port(), next(1 << 40));
    let (own, cuts) = (nats.url(), next(1000).to_string());
    let start = |place: Option<&str>| {
        let failpoint = place.into_iter().flat_map(|place| ["--failpoint", place]);
        let options: Vec<&str> =
            ["--most-files", "3", "--random-units", &cuts].into_iter().chain(failpoint).collect();
        coordinator(data.path(), &own, &options)
    };
    let mut service = Some(start(None));
    let url = relay.url();
    let mut workers: Vec<Worker> =
        (0..3).map(|number| Worker::start(&url, &format!("w{number}"), &[])).collect();
    let uploaded = service.as_ref().expect("it runs").upload_file(&shipped("cornell.json"));
    let submit = |service: &Service, job: &Value| service.submit(&uploaded, job);
    let ids: Vec<String> =
        jobs.iter().map(|(job, _)| submit(service.as_ref().expect("it runs"), job)).collect();
    for fault in 0..FAULTS {
        std::thread::sleep(Duration::from_millis(100 + next(700)));
        match next(8) {
            0 | 1 => {
                let index = next(workers.len() as u64) as usize;
                workers[index].process.kill();
                let places = ["unit-rendered", "result-sent"];
                let place = format!("{}:{}", places[next(2) as usize], next(5));
                let name = format!("w{index}-{fault}");
                workers[index] = Worker::start(&url, &name, &["--failpoint", &place]);
            }
            2 => {
                let index = next(workers.len() as u64) as usize;
                workers[index].process.pause(Duration::from_millis(next(2500)));
            }
            3 => {
                service.take().expect("it runs").kill();
                service = Some(start(None));
            }
            4 => {
                let places = [
                    "before-commit",
                    "after-commit",
                    "film-written",
                    "unit-kept",
                    "sums-written",
                    "sums-committed",
                    "frame-complete",
                    "folding",
                ];
                let place = format!("{}:{}", places[next(places.len() as u64) as usize], next(4));
                service.take().expect("it runs").kill();
                let mut failing = start(Some(&place));
                std::thread::sleep(Duration::from_millis(next(1500)));
                if failing.has_ended() {
                    drop(failing);
                } else {
                    failing.kill();
                }
                service = Some(start(None));
            }
            5 => {
                nats.kill();
                if next(2) == 0 {
                    nats.lose_store();
                }
                std::thread::sleep(Duration::from_millis(next(800)));
                nats.restart();
            }
            6 => nats.pause(Duration::from_millis(next(2500))),
            _ => relay.cut(Duration::from_millis(next(3000))),
        }
    }
    let began = Instant::now();
    // Those with failpoints may all be dead.
    for (index, worker) in workers.iter_mut().enumerate() {
        if !worker.process.is_alive() {
            *worker = Worker::start(&url, &format!("last{index}"), &[]);
        }
    }
    let service = service.expect("it runs");
    for (id, (job, hash)) in ids.iter().zip(jobs) {
        // A failpoint may be passed long after the faults: someone must be there to go on.
        for (index, worker) in workers.iter_mut().enumerate() {
            if !worker.process.is_alive() {
                *worker = Worker::start(&url, &format!("very-last{index}"), &[]);
            }
        }
        assert_eq!(service.hashes(id), [hash.as_str()], "seed {seed}: {job}");
    }
    began.elapsed()
}
